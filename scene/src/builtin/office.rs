//! A furnished room: desks, chairs, shelves of books, lamps, a window with the sun in it.
//!
//! Most of its light has bounced. Chromed and brushed metal and a mirror show what is not diffuse. Whatever rests on
//! something goes a millimetre into it, so that no faces coincide.

mod desk;
mod room;
mod seat;
mod shelf;

use std::f32::consts::FRAC_PI_2;

use glam::{Affine3A, Vec3};

use super::{
    paint::{clouds, noise, paint, smoothstep},
    stage::Stage,
};
use crate::{LightKind, Scene};

/// What the room and its furniture are made of.
struct Materials {
    wall: u32,
    ceiling: u32,
    carpet: u32,
    wood: u32,
    lacquer: u32,
    plastic: u32,
    fabric: u32,
    chrome: u32,
    steel: u32,
    mirror: u32,
    paper: u32,
    screen: u32,
    yellow: u32,
    clay: u32,
    leaf: u32,
    covers: [u32; 6],
}

pub(super) fn build() -> Scene {
    let mut stage = Stage::default();
    let materials = materials(&mut stage);
    room::build(&mut stage, &materials);
    furnish(&mut stage, &materials);
    shelf::build(&mut stage, &materials);
    lights(&mut stage);
    stage.camera("camera_main", [2.62, 1.68, 2.25], [-0.9, 0.82, -1.15], 54.0);
    stage.finish()
}

fn materials(stage: &mut Stage) -> Materials {
    let carpet = paint("carpet", 128, |at| {
        let loops = noise(at, 64, 3) * 0.5 + clouds(at, 8, 4) * 0.5;
        Vec3::new(0.20, 0.25, 0.31) * (0.6 + 0.8 * loops)
    });
    let wood = paint("wood", 256, |at| {
        // Rings of a trunk that is cut along: lines along u, bent by noise.
        let bent = at.y * 6.0 + 0.35 * clouds(at, 3, 5);
        let ring = (bent - bent.floor() - 0.5).abs() * 2.0;
        let fibre = noise(glam::Vec2::new(at.x * 0.25, at.y), 128, 6);
        let tone = 0.72 + 0.2 * smoothstep(0.1, 0.9, ring) + 0.12 * fibre;
        Vec3::new(0.56, 0.36, 0.20) * tone
    });
    Materials {
        wall: stage.matt("wall", [0.76, 0.74, 0.70]),
        ceiling: stage.matt("ceiling", [0.82, 0.82, 0.82]),
        carpet: stage.textured(carpet, 0.8, [1.0; 3]),
        wood: stage.textured(wood, 0.9, [1.0; 3]),
        lacquer: stage.matt("white_lacquer", [0.74, 0.74, 0.73]),
        plastic: stage.matt("black_plastic", [0.05, 0.05, 0.055]),
        fabric: stage.matt("blue_fabric", [0.10, 0.20, 0.42]),
        chrome: stage.metal("chrome", [0.75, 0.76, 0.78], 0.12),
        steel: stage.metal("brushed_steel", [0.56, 0.56, 0.57], 0.4),
        mirror: stage.metal("mirror", [0.92, 0.93, 0.93], 0.0),
        paper: stage.matt("paper", [0.80, 0.79, 0.75]),
        screen: stage.matt("screen", [0.03, 0.035, 0.045]),
        yellow: stage.matt("yellow_paint", [0.75, 0.46, 0.05]),
        clay: stage.matt("clay", [0.55, 0.24, 0.13]),
        leaf: stage.matt("leaf", [0.12, 0.32, 0.08]),
        covers: [
            ("red_cloth", [0.48, 0.08, 0.06]),
            ("blue_cloth", [0.07, 0.15, 0.38]),
            ("green_cloth", [0.08, 0.28, 0.14]),
            ("ochre_cloth", [0.58, 0.38, 0.10]),
            ("grey_cloth", [0.32, 0.32, 0.34]),
            ("cream_cloth", [0.70, 0.62, 0.46]),
        ]
        .map(|(name, albedo)| stage.matt(name, albedo)),
    }
}

/// Two desks face each other in the middle of the room, one stands under the window.
fn furnish(stage: &mut Stage, materials: &Materials) {
    let mirrored = |x: f32, z: f32, quarters: u32| {
        Affine3A::from_translation(Vec3::new(x, 0.0, z))
            * super::shapes::quarter_turn(quarters)
            * Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0))
    };
    let turned = |x: f32, z: f32, quarters: u32| {
        Affine3A::from_translation(Vec3::new(x, 0.0, z)) * super::shapes::quarter_turn(quarters)
    };
    let desk = stage.mesh(desk::desk(materials));
    let near = turned(0.35, 0.03, 0);
    let far = mirrored(0.35, -0.75, 2);
    let window = turned(-2.52, 0.0, 1);
    for place in [near, far, window] {
        stage.put(desk, place);
    }

    let chair = stage.mesh(seat::chair(materials));
    for (x, z, angle) in [
        (0.15, 0.78, 2.7),
        (0.55, -1.5, 0.25),
        (-1.75, -0.25, -FRAC_PI_2 - 0.5),
    ] {
        stage.put_at(chair, [x, 0.0, z], angle);
    }

    desk::equip(stage, materials, [near, far, window]);
}

fn lights(stage: &mut Stage) {
    // Just below the rims of the pendant lamps, within which they would be reflected to dazzling spots.
    for (name, [x, z]) in [
        ("pendant_a", room::PENDANTS[0]),
        ("pendant_b", room::PENDANTS[1]),
    ] {
        let kind = LightKind::Spot {
            inner: 0.9,
            outer: 1.45,
        };
        stage.aimed_light(name, kind, [14.0, 12.7, 10.6], [x, 2.04, z], [x, 0.0, z]);
    }
    stage.aimed_light(
        "desk_lamp",
        LightKind::Spot {
            inner: 0.35,
            outer: 0.95,
        },
        [2.0, 1.75, 1.3],
        desk::LAMP_BULB,
        desk::LAMP_TARGET,
    );
    stage.aimed_light(
        "sun",
        LightKind::Directional,
        [24.0, 22.0, 19.0],
        [-5.0, 4.0, 1.3],
        [0.0, 0.0, 0.0],
    );
}
