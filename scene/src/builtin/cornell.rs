//! The Cornell box as it was measured.
//!
//! Geometry, camera and emitter position: Cornell University Program of Computer Graphics, "Cornell Box Data", in
//! millimetres there and metres here. Their axes are right-handed already: the camera looks along +z with +y up,
//! so x grows to the left of the picture, and the red wall stands at x = 0.55 on the left. Their spectra are given as
//! linear Rec. 709 reflectances, as most renderers do. The ceiling has a hole where the lamp is, so that the two
//! do not lie in one plane.

use glam::Vec3;

use super::{shapes::Shape, stage::Stage};
use crate::{Material, Scene};

const WHITE: [f32; 3] = [0.725, 0.71, 0.68];
const RED: [f32; 3] = [0.63, 0.065, 0.05];
const GREEN: [f32; 3] = [0.14, 0.45, 0.091];
/// Reflectance of the lamp itself at all wavelengths.
const LAMP: [f32; 3] = [0.78, 0.78, 0.78];
/// What the lamp emits, W/(sr·m²). The published spectrum has no unit; its colour is the usual 17 : 12 : 4, and the
/// factor exposes the picture well.
const EMISSION: Vec3 = Vec3::new(68.0, 48.0, 16.0);

pub(super) fn build() -> Scene {
    let mut stage = Stage::default();
    let white = stage.matt("white", WHITE);
    let red = stage.matt("red", RED);
    let green = stage.matt("green", GREEN);
    let lamp = stage.material(Material {
        emissive: EMISSION,
        ..Material::diffuse("lamp", LAMP.into())
    });
    stage.single(room(white, red, green));
    stage.single(ceiling_lamp(lamp));
    for (name, top) in [("short_block", SHORT), ("tall_block", TALL)] {
        let mut block = Shape::new(name, white);
        let top = top.map(metres);
        block.polygon(&top);
        for i in 0..4 {
            let [a, b] = [top[i], top[(i + 1) % 4]];
            block.polygon(&[b, a, a.with_y(0.0), b.with_y(0.0)]);
        }
        stage.single(block);
    }
    // 35 mm focal length before a film of 25 mm.
    let yfov = 2.0 * (0.0125_f32 / 0.035).atan().to_degrees();
    stage.camera(
        "camera_main",
        [0.278, 0.273, -0.8],
        [0.278, 0.273, 0.0],
        yfov,
    );
    stage.finish()
}

/// The tops of the blocks, counter-clockwise from above.
const SHORT: [[f32; 3]; 4] = [
    [130.0, 165.0, 65.0],
    [82.0, 165.0, 225.0],
    [240.0, 165.0, 272.0],
    [290.0, 165.0, 114.0],
];
const TALL: [[f32; 3]; 4] = [
    [423.0, 330.0, 247.0],
    [265.0, 330.0, 296.0],
    [314.0, 330.0, 456.0],
    [472.0, 330.0, 406.0],
];
/// The lamp's rectangle: x and z, millimetres.
const LAMP_X: [f32; 2] = [213.0, 343.0];
const LAMP_Z: [f32; 2] = [227.0, 332.0];
const CEILING: f32 = 548.8;

fn metres(millimetres: [f32; 3]) -> Vec3 {
    Vec3::from(millimetres) / 1000.0
}

fn room(white: u32, red: u32, green: u32) -> Shape {
    let mut room = Shape::new("room", white);
    let mut wall = |material: u32, corners: [[f32; 3]; 4]| {
        room.material(material).polygon(&corners.map(metres));
    };
    let (h, d) = (CEILING, 559.2);
    wall(
        white,
        [
            [552.8, 0.0, 0.0],
            [0.0, 0.0, 0.0],
            [0.0, 0.0, d],
            [549.6, 0.0, d],
        ],
    );
    wall(
        white,
        [[549.6, 0.0, d], [0.0, 0.0, d], [0.0, h, d], [556.0, h, d]],
    );
    wall(
        green,
        [[0.0, 0.0, d], [0.0, 0.0, 0.0], [0.0, h, 0.0], [0.0, h, d]],
    );
    wall(
        red,
        [
            [552.8, 0.0, 0.0],
            [549.6, 0.0, d],
            [556.0, h, d],
            [556.0, h, 0.0],
        ],
    );
    // The ceiling goes round the lamp in four pieces, each from a corner to the next.
    let outer = [[556.0, h, 0.0], [556.0, h, d], [0.0, h, d], [0.0, h, 0.0]];
    let inner = lamp_corners();
    for i in 0..4 {
        let j = (i + 1) % 4;
        wall(white, [outer[i], outer[j], inner[j], inner[i]]);
    }
    room
}

/// Counter-clockwise from below.
fn lamp_corners() -> [[f32; 3]; 4] {
    let ([x0, x1], [z0, z1], h) = (LAMP_X, LAMP_Z, CEILING);
    [[x1, h, z0], [x1, h, z1], [x0, h, z1], [x0, h, z0]]
}

fn ceiling_lamp(material: u32) -> Shape {
    let mut lamp = Shape::new("ceiling_lamp", material);
    lamp.polygon(&lamp_corners().map(metres));
    lamp
}
