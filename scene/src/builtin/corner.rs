//! A corner of three planes with objects on the floor, for ambient occlusion.
//!
//! The planes are grids, since ambient occlusion per vertex needs vertices; AFB15 uses 33 × 33 a plane.

use std::f32::consts::TAU;

use glam::{Affine3A, Quat, Vec3};

use super::{
    Number,
    shapes::{Shape, profile},
    stage::Stage,
};
use crate::Scene;

pub(super) const VERTICES: Number = Number {
    name: "the number of vertices a plane of builtin:corner has a side",
    default: 33,
    min: 2,
    max: 1025,
    expected: "a whole number within 2..=1025 is expected",
};

/// Length of a plane's side, metres.
const SIDE: f32 = 4.0;

pub(super) fn build(vertices: usize) -> Scene {
    let mut stage = Stage::default();
    let white = stage.matt("plaster", [0.75, 0.74, 0.72]);
    let red = stage.matt("red", [0.6, 0.12, 0.1]);
    let blue = stage.matt("blue", [0.13, 0.25, 0.55]);
    let yellow = stage.matt("yellow", [0.7, 0.5, 0.12]);
    let green = stage.matt("green", [0.2, 0.45, 0.2]);
    let cells = vertices - 1;
    for (name, [u, v]) in [
        ("floor", [Vec3::Z, Vec3::X]),
        ("back_wall", [Vec3::X, Vec3::Y]),
        ("left_wall", [Vec3::Y, Vec3::Z]),
    ] {
        let mut plane = Shape::new(name, white);
        let step = SIDE / cells as f32;
        plane.grid([cells, cells], [false; 2], |i, j| {
            step * (i as f32 * u + j as f32 * v)
        });
        stage.single(plane);
    }

    let mut sphere = Shape::new("sphere", red);
    sphere.sphere(Vec3::new(0.0, 0.5, 0.0), 0.5, 64);
    let sphere = stage.mesh(sphere);
    stage.put_at(sphere, [1.0, 0.0, 1.1], 0.0);
    let small = Affine3A::from_scale_rotation_translation(
        Vec3::splat(0.4),
        Quat::IDENTITY,
        Vec3::new(1.75, 0.0, 2.1),
    );
    stage.put(sphere, small);

    // Boxes and cylinders go a little into the floor, so that no face lies in its plane.
    let mut cuboid = Shape::new("box", blue);
    cuboid.cuboid([-0.4, -0.01, -0.4], [0.4, 0.8, 0.4]);
    let cuboid = stage.mesh(cuboid);
    stage.put_at(cuboid, [2.45, 0.0, 0.8], 0.4);
    let flat = Affine3A::from_scale_rotation_translation(
        Vec3::new(0.5, 0.3, -0.5),
        Quat::from_rotation_y(-0.3),
        Vec3::new(0.7, 0.0, 2.35),
    );
    stage.put(cuboid, flat);

    let mut torus = Shape::new("torus", yellow);
    let curve: Vec<Vec3> = (0..64)
        .map(|i| {
            let (sin, cos) = (TAU * i as f32 / 64.0).sin_cos();
            Vec3::new(0.38 * cos, 0.14, 0.38 * sin)
        })
        .collect();
    torus.ring(&curve, 32, 0.14);
    let torus = stage.mesh(torus);
    stage.put_at(torus, [2.6, 0.0, 2.2], 0.0);

    let mut cylinder = Shape::new("cylinder", green);
    cylinder.lathe(
        &profile([[0.0, -0.01], [0.2, -0.01], [0.2, 1.5], [0.0, 1.5]]),
        64,
    );
    let cylinder = stage.mesh(cylinder);
    stage.put_at(cylinder, [0.45, 0.0, 0.45], 0.0);

    stage.point_light("key", [3.2, 3.4, 2.6], [15.0, 14.4, 13.4]);
    stage.point_light("fill", [1.0, 2.6, 3.8], [5.2, 5.6, 6.4]);
    stage.camera("camera_main", [4.4, 2.5, 4.7], [1.35, 0.55, 1.2], 42.0);
    stage.finish()
}
