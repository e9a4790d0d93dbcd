//! The columns of both storeys and the balustrade.

use std::f32::consts::{PI, TAU};

use glam::{Quat, Vec2, Vec3};

use super::{BAY, FLOORS, HALF, Materials, sides};
use crate::builtin::{
    shapes::{Shape, arc, profile},
    stage::Stage,
};

pub(super) fn build(stage: &mut Stage, materials: &Materials) {
    let lower = stage.mesh(lower(materials));
    let upper = stage.mesh(upper(materials));
    for (column, floor) in [(lower, FLOORS[0]), (upper, FLOORS[1])] {
        for place in sides(HALF, floor, 9, 2) {
            stage.put(column, place);
        }
    }
    let balustrade = stage.mesh(balustrade(materials));
    for place in sides(HALF, FLOORS[1], 10, 3) {
        stage.put(balustrade, place);
    }
}

/// 3.25 m high with fluted shaft, attic base and a capital of two rings of leaves.
fn lower(materials: &Materials) -> Shape {
    let mut column = Shape::new("column_lower", materials.limestone);
    column.chamfered([-0.34, -0.01, -0.34], [0.34, 0.14, 0.34], 0.008);
    let base = [
        arc([0.275, 0.185], 0.055, -90.0, 90.0, 5),
        profile([[0.262, 0.245], [0.25, 0.265], [0.255, 0.285]]),
        arc([0.255, 0.31], 0.026, -80.0, 90.0, 4),
        profile([[0.235, 0.342], [0.228, 0.37]]),
    ]
    .concat();
    column.lathe(&base, 24);
    fluted_shaft(&mut column);
    column.lathe(&arc([0.195, 2.70], 0.024, -90.0, 90.0, 4), 24);
    column.lathe(
        &profile([[0.188, 2.70], [0.195, 2.86], [0.22, 3.0], [0.28, 3.09]]),
        24,
    );
    for i in 0..8 {
        let turn = TAU * i as f32 / 8.0;
        leaf(&mut column, turn, 2.71, 0.2, 0.17);
        leaf(&mut column, turn + PI / 8.0, 2.73, 0.33, 0.14);
    }
    for i in 0..4 {
        volute(&mut column, TAU * (i as f32 + 0.5) / 4.0);
    }
    column.place(glam::Affine3A::IDENTITY);
    column.chamfered([-0.3, 3.085, -0.3], [0.3, 3.135, 0.3], 0.012);
    column.chamfered([-0.345, 3.13, -0.345], [0.345, 3.26, 0.345], 0.015);
    column
}

/// Sixteen flutes that run out at both ends; the shaft swells a little (entasis).
fn fluted_shaft(column: &mut Shape) {
    let (flutes, per_flute) = (16, 4);
    let rows = [0.0, 0.02, 0.05, 0.5, 0.95, 0.98, 1.0_f32];
    let around = flutes * per_flute;
    column.grid([rows.len() - 1, around], [false, true], |i, j| {
        let t = rows[i];
        let radius = 0.228 - 0.038 * t * t;
        let fade = ((t - 0.02).min(0.98 - t) / 0.03).clamp(0.0, 1.0);
        let hollow = (PI * (j % per_flute) as f32 / per_flute as f32).sin();
        let r = radius * (1.0 - 0.11 * fade * hollow);
        let (sin, cos) = (TAU * j as f32 / around as f32).sin_cos();
        Vec3::new(r * cos, 0.36 + 2.35 * t, r * sin)
    });
}

/// A leaf that clings to the bell and curls over at its tip.
fn leaf(column: &mut Shape, turn: f32, foot: f32, height: f32, width: f32) {
    column.place(glam::Affine3A::from_quat(Quat::from_rotation_y(turn)));
    column.grid([6, 2], [false; 2], |i, j| {
        let t = i as f32 / 6.0;
        let across = j as f32 - 1.0;
        let bend = (t - 0.55).max(0.0) / 0.45;
        let out = 0.20 + 0.03 * t + 0.09 * bend * bend + 0.012 * (1.0 - across.abs());
        let y = foot + height * (t - 0.28 * bend * bend);
        let half = 0.5 * width * (0.75 + 0.5 * t - 1.05 * t.powi(4));
        Vec3::new(out, y, across * half)
    });
}

/// A stem that rises to the abacus's corner and rolls up there.
fn volute(column: &mut Shape, turn: f32) {
    column.place(glam::Affine3A::from_quat(Quat::from_rotation_y(turn)));
    let mut curve = vec![Vec3::new(0.205, 2.84, 0.0), Vec3::new(0.26, 2.98, 0.0)];
    let center = Vec2::new(0.34, 3.02);
    curve.extend((0..=10).map(|i| {
        let angle = 2.75 - 0.62 * i as f32;
        (center + (0.072 - 0.0055 * i as f32) * Vec2::from_angle(angle)).extend(0.0)
    }));
    column.tube(&curve, 5, |j| 0.024 - 0.0012 * j as f32);
}

/// 2.9 m high: a pedestal as high as the balustrade, and a plain column on it.
fn upper(materials: &Materials) -> Shape {
    let mut column = Shape::new("column_upper", materials.limestone);
    for (half, y0, y1, bevel) in [
        (0.29, -0.02, 0.14, 0.012),
        (0.25, 0.10, 0.93, 0.01),
        (0.29, 0.90, 1.02, 0.02),
        (0.22, 1.0, 1.09, 0.008),
    ] {
        column.chamfered([-half, y0, -half], [half, y1, half], bevel);
    }
    let turned = [
        arc([0.17, 1.125], 0.038, -90.0, 90.0, 5),
        profile([
            [0.165, 1.175],
            [0.158, 1.2],
            [0.155, 1.5],
            [0.148, 1.9],
            [0.136, 2.45],
        ]),
        arc([0.136, 2.47], 0.018, -90.0, 90.0, 4),
        profile([[0.134, 2.5], [0.134, 2.58], [0.15, 2.59], [0.15, 2.61]]),
        arc([0.15, 2.70], 0.09, -80.0, 0.0, 4),
    ]
    .concat();
    column.lathe(&turned, 20);
    // Scrolls on the four sides of the capital.
    for side in [-1.0, 1.0_f32] {
        for scroll in [-1.0, 1.0_f32] {
            let upright = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
            column.place(glam::Affine3A::from_rotation_translation(
                upright,
                Vec3::new(0.19 * scroll, 2.66, 0.15 * side),
            ));
            column.lathe(
                &profile([
                    [0.0, -0.06],
                    [0.075, -0.045],
                    [0.06, 0.0],
                    [0.075, 0.045],
                    [0.0, 0.06],
                ]),
                12,
            );
        }
    }
    column.place(glam::Affine3A::IDENTITY);
    column.chamfered([-0.32, 2.74, -0.27], [0.32, 2.80, 0.27], 0.012);
    column.chamfered([-0.345, 2.785, -0.345], [0.345, 2.91, 0.345], 0.015);
    column
}

/// One bay between two pedestals: rails and six turned balusters.
fn balustrade(materials: &Materials) -> Shape {
    let mut balustrade = Shape::new("balustrade", materials.limestone);
    let end = 0.5 * BAY - 0.23;
    balustrade.chamfered([-end, 0.005, -0.13], [end, 0.12, 0.13], 0.01);
    balustrade.chamfered([-end, 0.84, -0.12], [end, 0.91, 0.12], 0.02);
    balustrade.chamfered([-end, 0.895, -0.155], [end, 0.99, 0.155], 0.025);
    let baluster = profile([
        [0.06, 0.11],
        [0.06, 0.16],
        [0.042, 0.175],
        [0.04, 0.2],
        [0.072, 0.27],
        [0.08, 0.33],
        [0.066, 0.41],
        [0.036, 0.56],
        [0.034, 0.66],
        [0.052, 0.69],
        [0.036, 0.72],
        [0.058, 0.78],
        [0.058, 0.85],
    ]);
    for i in 0..6 {
        balustrade.at((i as f32 - 2.5) * 0.31, 0.0, 0.0);
        balustrade.lathe(&baluster, 8);
    }
    balustrade
}
