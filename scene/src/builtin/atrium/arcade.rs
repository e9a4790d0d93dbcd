//! Arches, vaults, ribs, pilasters and the ornaments between the arches.

use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Affine3A, Mat3, Quat, Vec2, Vec3};

use super::{BAY, FLOORS, HALF, HALF_WALL, INNER, Materials, SPANDREL, SPRINGS, at, sides};
use crate::builtin::{
    shapes::{Shape, profile},
    stage::Stage,
};

/// Radius of an arcade's arch.
const ARCH: f32 = 0.9;
/// Half the way across a bay.
const SIDE: f32 = 0.5 * BAY;

pub(super) fn build(stage: &mut Stage, materials: &Materials) {
    let bay = stage.mesh(bay(materials));
    let vault = stage.mesh(vault(materials));
    let rib = stage.mesh(rib(materials));
    let pilaster = stage.mesh(pilaster(materials));
    let roundel = stage.mesh(roundel(materials));
    let middle = [0, 1].map(|axis| 0.5 * (HALF[axis] + INNER[axis]));
    for (floor, spring) in FLOORS.into_iter().zip(SPRINGS) {
        for place in sides(HALF, spring, 10, 3) {
            stage.put(bay, place);
        }
        for place in sides(middle, spring, 12, 3) {
            stage.put(vault, place);
        }
        for place in sides(middle, spring, 11, 4) {
            stage.put(rib, place);
        }
        // Made for the lower storey, lowered for the upper one.
        let lowered = (spring - floor) / (SPRINGS[0] - FLOORS[0]);
        for place in sides(INNER, floor, 11, 4) {
            stage.put(
                pilaster,
                place * Affine3A::from_scale(Vec3::new(1.0, lowered, 1.0)),
            );
        }
        for place in sides(HALF, spring + 1.08, 9, 2) {
            stage.put(roundel, place);
        }
    }
}

/// A bay of an arcade's wall from the springing up; its court side is +z, its ends are its neighbours' ends.
fn bay(materials: &Materials) -> Shape {
    let mut bay = Shape::new("arcade_bay", materials.limestone);
    let steps = 24;
    let arch = |i: usize| ARCH * Vec2::from_angle(PI * i as f32 / steps as f32);
    // Up the right edge in six steps, along the top in twelve, down the left edge in six.
    let edge = |i: usize| match i {
        0..=6 => Vec2::new(SIDE, SPANDREL * i as f32 / 6.0),
        7..=18 => Vec2::new(SIDE * (1.0 - (i - 6) as f32 / 6.0), SPANDREL),
        _ => Vec2::new(-SIDE, SPANDREL * (24 - i) as f32 / 6.0),
    };
    for z in [HALF_WALL, -HALF_WALL] {
        bay.grid([steps, 1], [false; 2], |i, j| {
            let inner = (j == 1) == (z > 0.0);
            (if inner { arch(i) } else { edge(i) }).extend(z)
        });
    }
    bay.grid([steps, 1], [false; 2], |i, j| {
        arch(i).extend(if j == 0 { HALF_WALL } else { -HALF_WALL })
    });
    // The archivolt: (radius, z), from outside in.
    let archivolt = profile([
        [1.12, 0.24],
        [1.12, 0.275],
        [1.08, 0.30],
        [1.02, 0.30],
        [1.0, 0.28],
        [0.93, 0.28],
        [0.905, 0.24],
    ]);
    bay.sweep(&archivolt, steps, false, |j| {
        let radial = Vec2::from_angle(PI * (1.0 - j as f32 / steps as f32)).extend(0.0);
        Affine3A::from_mat3(Mat3::from_cols(radial, Vec3::Z, radial.cross(Vec3::Z)))
    });
    bay.chamfered([-0.085, 0.87, -0.29], [0.085, 1.22, 0.35], 0.02);
    bay
}

/// A groin vault over one bay, its springing at y = 0: two half cylinders, of which the higher counts.
fn vault(materials: &Materials) -> Shape {
    let mut vault = Shape::new("vault", materials.plaster);
    let (around, along) = (12, 4);
    for quarters in 0..4 {
        let turn = crate::builtin::shapes::quarter_turn(quarters);
        vault.place(turn);
        // The web from the middle towards +z: a piece of the cylinder along z.
        vault.grid([around, along], [false; 2], |i, j| {
            let angle = PI * (i as f32 / around as f32 - 0.5);
            let (sin, cos) = match i {
                0 => (-1.0, 0.0),
                _ if i == around => (1.0, 0.0),
                _ => angle.sin_cos(),
            };
            let x: f32 = SIDE * sin;
            let from = x.abs();
            // Seen from below the front is where x × −z points down.
            let z = SIDE + (from - SIDE) * (1.0 - j as f32 / along as f32);
            Vec3::new(x, SIDE * cos, z)
        });
    }
    vault.place(Affine3A::IDENTITY);
    vault
}

/// An arch across the gallery: along z, thick along x.
fn rib(materials: &Materials) -> Shape {
    let mut rib = Shape::new("rib", materials.limestone);
    // No edge at 45°, so that two ribs that cross in a corner share no plane.
    let section = profile([
        [1.2, 0.16],
        [1.10, 0.16],
        [1.06, 0.126],
        [1.06, -0.126],
        [1.10, -0.16],
        [1.2, -0.16],
    ]);
    let steps = 12;
    rib.sweep(&section, steps, false, |j| {
        let (sin, cos) = (PI * j as f32 / steps as f32).sin_cos();
        let radial = Vec3::new(0.0, sin, cos);
        Affine3A::from_mat3(Mat3::from_cols(radial, Vec3::X, radial.cross(Vec3::X)))
    });
    rib
}

/// Against the outer wall, whose face is z = 0.
fn pilaster(materials: &Materials) -> Shape {
    let mut pilaster = Shape::new("pilaster", materials.limestone);
    let parts = [
        (0.27, -0.01, 0.17, 0.20, 0.0),
        (0.24, 0.15, 0.32, 0.17, 0.03),
        (0.20, 0.20, 3.05, 0.13, 0.0),
        (0.225, 2.86, 2.91, 0.155, 0.0),
        (0.235, 3.0, 3.15, 0.165, 0.03),
        (0.28, 3.12, 3.26, 0.21, 0.0),
    ];
    for (i, (half, y0, y1, front, bevel)) in parts.into_iter().enumerate() {
        // Their backs lie in the wall, each at a depth of its own.
        let back = -0.03 - 0.004 * i as f32;
        pilaster.chamfered([-half, y0, back], [half, y1, front], bevel);
    }
    pilaster
}

/// A boss in a ring on the wall between two arches.
fn roundel(materials: &Materials) -> Shape {
    let mut roundel = Shape::new("roundel", materials.limestone);
    let to_court = Quat::from_rotation_x(FRAC_PI_2);
    roundel.place(Affine3A::from_rotation_translation(
        to_court,
        Vec3::new(0.0, 0.0, HALF_WALL),
    ));
    roundel.lathe(
        &profile([
            [0.28, -0.01],
            [0.28, 0.03],
            [0.255, 0.055],
            [0.225, 0.04],
            [0.215, 0.012],
            [0.15, 0.012],
            [0.12, 0.05],
            [0.0, 0.08],
        ]),
        20,
    );
    roundel.place(at(0.0, 0.0, 0.0, 0));
    roundel
}
