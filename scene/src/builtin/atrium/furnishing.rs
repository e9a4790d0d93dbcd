//! What stands and hangs in the hall: curtains, vases with plants, a basin, chandeliers.

use std::f32::consts::{PI, TAU};

use glam::{Affine3A, Quat, Vec2, Vec3};

use super::{BAY, FLOORS, HALF, Materials, SPRINGS, at};
use crate::builtin::{
    paint::smoothstep,
    random::Random,
    shapes::{Shape, arc, profile},
    stage::Stage,
};

/// x of the chandeliers, and the height of their rings.
pub(super) const CHANDELIERS: [f32; 2] = [-3.0 * BAY, 3.0 * BAY];
pub(super) const CHANDELIER_RING: f32 = 6.9;

pub(super) fn build(stage: &mut Stage, materials: &Materials) {
    curtains(stage, materials);
    let vase = stage.mesh(vase(materials));
    for (i, x) in [-3.0, -1.0, 1.0, 3.0_f32].into_iter().enumerate() {
        for side in [-1.0, 1.0] {
            stage.put_at(vase, [x * BAY, 0.0, side * 2.55], i as f32 * 1.3 + side);
        }
    }
    stage.single(basin(materials));
    let chandelier = stage.mesh(chandelier(materials));
    for x in CHANDELIERS {
        stage.put(chandelier, at(x, CHANDELIER_RING, 0.0, 0));
    }
}

/// Pairs of curtains, drawn aside, in some of the lower arches of the long sides; the right one of a pair is the left
/// one mirrored.
fn curtains(stage: &mut Stage, materials: &Materials) {
    let names = ["curtain_red", "curtain_green", "curtain_blue"];
    let curtains = [0, 1, 2].map(|color| stage.mesh(curtain(names[color], materials, color)));
    let mut rod = Shape::new("curtain_rod", materials.brass);
    let ends = [-1.0, 1.0].map(|x| Vec3::new(x, 0.0, 0.0));
    rod.tube(&ends, 10, |_| 0.016);
    let rod = stage.mesh(rod);
    let mirror = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    for (i, bay) in [1, 3, 5, 7, 8].into_iter().enumerate() {
        let x = (bay as f32 - 4.5) * BAY;
        for (z, quarters, color) in [(-HALF[1], 0, i % 3), (HALF[1], 2, (i + 1) % 3)] {
            let place = at(x, SPRINGS[0] - 0.12, z, quarters);
            stage.put(rod, place);
            stage.put(curtains[color], place);
            stage.put(curtains[color], place * mirror);
        }
    }
}

/// The left half of a pair, hanging from y = 0, gathered by a cord towards the column at −x.
fn curtain(name: &str, materials: &Materials, color: usize) -> Shape {
    let mut curtain = Shape::new(name, materials.cloths[color]);
    let height = SPRINGS[0] - 0.12 - FLOORS[0] - 0.06;
    let tied = 0.56;
    let width = |v: f32| {
        if v < tied {
            0.93 - 0.71 * smoothstep(0.0, 1.0, v / tied)
        } else {
            0.22 + 0.2 * smoothstep(0.0, 0.8, (v - tied) / (1.0 - tied))
        }
    };
    let shift = 0.37 * color as f32;
    curtain.grid([34, 14], [false; 2], |i, j| {
        let (u, v) = (i as f32 / 34.0, 1.0 - j as f32 / 14.0);
        let w = width(v);
        // The narrower it is, the deeper its folds.
        let depth = 0.028 + 0.03 * (1.0 - w / 0.93);
        let folds = (TAU * (4.5 * u + shift) + 0.8 * (4.0 * v + shift).sin()).sin();
        let wave = folds + 0.25 * (TAU * 2.3 * u + 5.0 * v).sin();
        let x = -0.95 + w * u;
        // Cloth that goes aside hangs lower between rod and cord.
        let sag = 0.12 * u * (PI * (v / tied).min(1.0)).sin();
        Vec3::new(x, -height * v - sag * (1.0 - v), depth * wave)
    });
    curtain.material(materials.brass);
    let cord: Vec<Vec3> = (0..14)
        .map(|i| {
            let (sin, cos) = (TAU * i as f32 / 14.0).sin_cos();
            let y = -height * tied + 0.03 * cos;
            Vec3::new(-0.95 + 0.11 + 0.145 * cos, y, 0.115 * sin)
        })
        .collect();
    curtain.ring(&cord, 5, 0.012);
    curtain
}

/// A vase on a plinth with a plant of sword-shaped leaves.
fn vase(materials: &Materials) -> Shape {
    let mut vase = Shape::new("vase", materials.limestone);
    vase.chamfered([-0.3, -0.01, -0.3], [0.3, 0.09, 0.3], 0.01);
    vase.chamfered([-0.25, 0.06, -0.25], [0.25, 0.5, 0.25], 0.012);
    vase.chamfered([-0.29, 0.48, -0.29], [0.29, 0.56, 0.29], 0.02);
    let body = [
        profile([
            [0.0, 0.55],
            [0.15, 0.55],
            [0.15, 0.58],
            [0.09, 0.62],
            [0.085, 0.66],
        ]),
        profile([
            [0.16, 0.74],
            [0.23, 0.86],
            [0.255, 0.98],
            [0.235, 1.1],
            [0.19, 1.17],
            [0.185, 1.2],
        ]),
        arc([0.215, 1.225], 0.02, -60.0, 150.0, 4),
        profile([[0.175, 1.2], [0.0, 1.19]]),
    ]
    .concat();
    vase.material(materials.clay).lathe(&body, 24);
    vase.material(materials.soil)
        .lathe(&profile([[0.19, 1.195], [0.12, 1.21], [0.0, 1.215]]), 20);
    vase.material(materials.leaf);
    let mut random = Random::new(17);
    for i in 0..22 {
        let (sin, cos) = (2.399_963 * i as f32).sin_cos();
        let (out, side) = (Vec3::new(cos, 0.0, sin), Vec3::new(-sin, 0.0, cos));
        let young = i as f32 / 21.0;
        let reach = random.range(0.38, 0.52) * (1.0 - 0.75 * young);
        let rise = random.range(0.5, 0.7) * (0.65 + 0.45 * young);
        let droop = 0.42 * (1.0 - young);
        vase.grid([2, 7], [false; 2], |c, r| {
            let t = r as f32 / 7.0;
            let across = c as f32 - 1.0;
            let width = 0.034 * (1.0 - t).powf(0.6) * (0.6 + 1.2 * t) + 0.002 * (1.0 - t);
            let stem = out * (0.03 + reach * t) + Vec3::Y * (1.2 + rise * t - droop * t * t);
            stem + side * (across * width) + Vec3::Y * (0.5 * width * across.abs())
        });
    }
    vase
}

/// An octagonal basin with a bowl on a baluster in its middle.
fn basin(materials: &Materials) -> Shape {
    let mut basin = Shape::new("basin", materials.limestone);
    let octagon = Quat::from_rotation_y(PI / 8.0);
    basin.place(Affine3A::from_rotation_translation(
        octagon,
        Vec3::new(0.0, 0.0, 0.0),
    ));
    // Each side on its own, for eight sharp edges.
    let rim = profile([
        [1.28, -0.01],
        [1.28, 0.1],
        [1.2, 0.12],
        [1.16, 0.2],
        [1.16, 0.42],
        [1.24, 0.47],
        [1.24, 0.56],
        [1.2, 0.585],
        [1.0, 0.585],
        [0.98, 0.56],
        [0.98, 0.2],
        [0.0, 0.19],
    ]);
    for side in 0..8 {
        basin.sweep(&rim, 1, false, |j| {
            let (sin, cos) = (TAU * (side + j) as f32 / 8.0).sin_cos();
            let out = Vec3::new(cos, 0.0, sin);
            Affine3A::from_mat3(glam::Mat3::from_cols(out, Vec3::Y, Vec3::ZERO))
        });
    }
    basin.place(Affine3A::IDENTITY);
    let stem = [
        profile([
            [0.26, 0.18],
            [0.26, 0.24],
            [0.2, 0.28],
            [0.12, 0.4],
            [0.105, 0.5],
        ]),
        profile([
            [0.16, 0.62],
            [0.17, 0.72],
            [0.12, 0.84],
            [0.09, 0.92],
            [0.13, 0.96],
        ]),
        profile([
            [0.3, 1.0],
            [0.5, 1.08],
            [0.62, 1.18],
            [0.66, 1.26],
            [0.69, 1.27],
            [0.69, 1.3],
            [0.64, 1.3],
        ]),
        profile([
            [0.58, 1.2],
            [0.45, 1.12],
            [0.25, 1.07],
            [0.1, 1.06],
            [0.08, 1.1],
        ]),
        profile([
            [0.06, 1.3],
            [0.1, 1.38],
            [0.1, 1.44],
            [0.05, 1.5],
            [0.03, 1.58],
            [0.0, 1.62],
        ]),
    ]
    .concat();
    basin.lathe(&stem, 40);
    basin
}

/// A wheel of candles; its ring is at y = 0, its chain ends in a beam.
fn chandelier(materials: &Materials) -> Shape {
    let mut chandelier = Shape::new("chandelier", materials.bronze);
    let radius = 0.85;
    let around = |n: usize, i: usize, r: f32, y: f32| {
        let turn = r * Vec2::from_angle(TAU * i as f32 / n as f32);
        Vec3::new(turn.x, y, turn.y)
    };
    for (y, thick) in [(0.0, 0.03), (0.14, 0.016)] {
        let ring: Vec<Vec3> = (0..40).map(|i| around(40, i, radius, y)).collect();
        chandelier.ring(&ring, 8, thick);
    }
    let hub = Vec3::new(0.0, 1.25, 0.0);
    chandelier.sphere(hub, 0.09, 16);
    chandelier.sphere(Vec3::ZERO, 0.07, 16);
    for i in 0..5 {
        chandelier.tube(&[Vec3::ZERO, around(5, i, radius, 0.0)], 6, |_| 0.014);
        chandelier.tube(&[around(5, i, radius, 0.13), hub], 6, |_| 0.01);
    }
    let beam = 10.98 - CHANDELIER_RING;
    chandelier.tube(&[hub, Vec3::new(0.0, beam, 0.0)], 8, |_| 0.014);
    for i in 0..10 {
        let foot = around(10, i, radius, 0.0);
        chandelier.at(foot.x, 0.14, foot.z);
        chandelier.material(materials.bronze).lathe(
            &profile([
                [0.0, -0.03],
                [0.03, 0.0],
                [0.075, 0.035],
                [0.08, 0.045],
                [0.0, 0.035],
            ]),
            12,
        );
        chandelier.material(materials.wax).lathe(
            &profile([[0.025, 0.03], [0.025, 0.2], [0.018, 0.21], [0.0, 0.205]]),
            10,
        );
    }
    chandelier
}
