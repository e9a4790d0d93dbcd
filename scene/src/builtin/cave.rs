//! A hollow with wavy walls, seen from inside: one closed surface of one shape, as finely tessellated as is asked for.

use std::f32::consts::TAU;

use glam::Vec3;

use super::{
    Number,
    shapes::{Shape, pole_to_pole},
    stage::Stage,
};
use crate::Scene;

pub(super) const TRIANGLES: Number = Number {
    name: "the number of triangles of builtin:cave",
    default: 100_000,
    min: 1_000,
    max: 5_000_000,
    expected: "a whole number within 1_000..=5_000_000 is expected",
};

/// Metres, without the waves.
const RADIUS: f32 = 3.0;

pub(super) fn build(triangles: usize) -> Scene {
    let mut stage = Stage::default();
    let stone = stage.matt("stone", [0.62, 0.55, 0.47]);
    // Two triangles a cell, one a cell at the poles: s² − 2s of them for s segments and s / 2 rings.
    let segments = 2 * ((1.0 + (1.0 + triangles as f64).sqrt()) / 2.0) as usize;
    let rings = segments / 2;
    let mut wall = Shape::new("cave", stone);
    wall.grid([rings, segments], [false, true], |i, j| {
        let (sin, cos) = pole_to_pole(i, rings);
        let (s, c) = (TAU * j as f32 / segments as f32).sin_cos();
        // A sphere's with the other handedness: the front is inside.
        let direction = Vec3::new(sin * c, cos, sin * s);
        RADIUS * waves(direction) * direction
    });
    stage.single(wall);
    stage.point_light("lamp", [0.9, 1.3, -0.6], [16.0, 15.0, 13.0]);
    stage.camera("camera_main", [-1.6, -0.2, 1.2], [0.8, -0.1, -0.9], 70.0);
    stage.finish()
}

/// How far out the wall lies in a direction; coarser than the fewest triangles.
fn waves(at: Vec3) -> f32 {
    let Vec3 { x, y, z } = at;
    1.0 + 0.1 * (5.0 * x + 1.0).sin() * (4.0 * y).cos() + 0.08 * (4.0 * z + 3.0 * y + 2.0).sin()
}
