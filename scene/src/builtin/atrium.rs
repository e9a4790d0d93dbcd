//! A colonnaded hall on two storeys round a court, 29.5 × 12 × 12.9 m.
//!
//! The plan is a grid of square bays. The court is ten bays long and three wide; arcades stand on its edges, and a
//! gallery one bay deep runs round it on either storey, under groin vaults that spring from the columns and from
//! pilasters on the outer wall. Beams cross the open roof; the sun falls through them onto one long side.
//!
//! A bay is a sum of powers of two wide, so that neighbouring instances share their edges to the bit.

mod arcade;
mod column;
mod furnishing;
mod shell;

use glam::{Affine3A, Vec3};

use super::{
    paint::{clouds, courses, noise, paint, smoothstep, veins},
    shapes::quarter_turn,
    stage::Stage,
};
use crate::{LightKind, Scene, Texture};

/// Width of a bay, metres.
const BAY: f32 = 2.375;
/// Half the court, from column axis to column axis, along x and z.
const HALF: [f32; 2] = [5.0 * BAY, 1.5 * BAY];
/// Half the inside of the outer wall.
const INNER: [f32; 2] = [6.0 * BAY, 2.5 * BAY];
/// Heights of the storeys' floors, of the springings of their arches, and of the top.
const FLOORS: [f32; 2] = [0.15, 5.5];
const SPRINGS: [f32; 2] = [3.4, 8.4];
const TOP: f32 = 12.0;
/// Above its springing an arcade's wall is this high.
const SPANDREL: f32 = 1.75;
/// Half the thickness of the arcades' walls.
const HALF_WALL: f32 = 0.25;

struct Materials {
    limestone: u32,
    ashlar: u32,
    plaster: u32,
    pavement: u32,
    terracotta: u32,
    timber: u32,
    bronze: u32,
    brass: u32,
    clay: u32,
    soil: u32,
    leaf: u32,
    wax: u32,
    cloths: [u32; 3],
}

pub(super) fn build() -> Scene {
    let mut stage = Stage::default();
    let materials = materials(&mut stage);
    shell::build(&mut stage, &materials);
    arcade::build(&mut stage, &materials);
    column::build(&mut stage, &materials);
    furnishing::build(&mut stage, &materials);
    stage.aimed_light(
        "sun",
        LightKind::Directional,
        [15.5, 14.9, 13.8],
        [-2.6, 12.0, -4.2],
        [0.0, 0.0, 0.0],
    );
    for (name, x) in ["chandelier_a", "chandelier_b"]
        .iter()
        .zip(furnishing::CHANDELIERS)
    {
        let below = furnishing::CHANDELIER_RING - 0.4;
        stage.point_light(name, [x, below, 0.0], [38.0, 34.5, 29.0]);
    }
    stage.camera("camera_main", [-11.0, 1.95, -1.55], [0.0, 3.75, 0.45], 60.0);
    stage.finish()
}

fn materials(stage: &mut Stage) -> Materials {
    Materials {
        limestone: stage.textured(limestone(), BAY, [1.0; 3]),
        ashlar: stage.textured(ashlar(), BAY, [1.0; 3]),
        plaster: stage.matt("plaster", [0.72, 0.67, 0.57]),
        pavement: stage.textured(pavement(), BAY, [1.0; 3]),
        terracotta: stage.textured(terracotta(), BAY, [1.0; 3]),
        timber: stage.textured(timber(), 1.2, [1.0; 3]),
        bronze: stage.metal("bronze", [0.36, 0.25, 0.14], 0.45),
        brass: stage.metal("brass", [0.80, 0.60, 0.28], 0.25),
        clay: stage.matt("clay", [0.50, 0.25, 0.14]),
        soil: stage.matt("soil", [0.09, 0.06, 0.04]),
        leaf: stage.matt("leaf", [0.13, 0.30, 0.07]),
        wax: stage.matt("wax", [0.80, 0.76, 0.64]),
        cloths: [
            ("red_cloth", [0.52, 0.05, 0.04]),
            ("green_cloth", [0.07, 0.28, 0.10]),
            ("blue_cloth", [0.06, 0.13, 0.42]),
        ]
        .map(|(name, albedo)| stage.matt(name, albedo)),
    }
}

fn limestone() -> Texture {
    paint("limestone", 256, |at| {
        let tone = 0.88 + 0.16 * clouds(at, 4, 21) + 0.06 * noise(at, 96, 22);
        Vec3::new(0.66, 0.59, 0.48) * tone
    })
}

/// Squared blocks, three to a bay, each of its own tone, with sunken joints.
fn ashlar() -> Texture {
    paint("ashlar", 512, |at| {
        let (stone, edge) = courses(at, 3, 6);
        let own = super::random::lattice(stone.x, stone.y, 31);
        let tone = 0.74 + 0.22 * own + 0.16 * clouds(at, 6, 32) + 0.05 * noise(at, 128, 33);
        let warm = Vec3::new(0.60, 0.50, 0.38).lerp(Vec3::new(0.58, 0.53, 0.45), own);
        warm * tone * (0.62 + 0.38 * smoothstep(0.0, 0.006, edge))
    })
}

/// Marble lozenges in two colours between light bands.
fn pavement() -> Texture {
    paint("pavement", 512, |at| {
        let diagonal = glam::Vec2::new(at.x + at.y, at.x - at.y) * 2.0;
        let tile = diagonal.floor().as_ivec2();
        let f = diagonal - diagonal.floor();
        let edge = f.min(glam::Vec2::ONE - f).min_element();
        let dark = (tile.x + tile.y).rem_euclid(2) == 1;
        let seed = if dark { 41 } else { 61 };
        let vein = veins(at, 5, seed);
        let (stone, streak) = if dark {
            (Vec3::new(0.30, 0.13, 0.09), Vec3::new(0.48, 0.34, 0.27))
        } else {
            (Vec3::new(0.60, 0.55, 0.46), Vec3::new(0.40, 0.36, 0.31))
        };
        let marble = streak.lerp(stone, 0.35 + 0.65 * vein) * (0.9 + 0.2 * clouds(at, 6, seed + 1));
        let band = Vec3::new(0.44, 0.41, 0.35) * (0.9 + 0.2 * noise(at, 64, 81));
        band.lerp(marble, smoothstep(0.045, 0.05, edge))
            * (0.55 + 0.45 * smoothstep(0.0, 0.012, edge))
    })
}

fn terracotta() -> Texture {
    paint("terracotta", 256, |at| {
        let (tile, edge) = courses(at, 6, 12);
        let own = super::random::lattice(tile.x, tile.y, 51);
        let tone = 0.75 + 0.35 * own + 0.2 * clouds(at, 8, 52);
        Vec3::new(0.40, 0.21, 0.13) * tone * (0.55 + 0.45 * smoothstep(0.001, 0.007, edge))
    })
}

/// Boards along v.
fn timber() -> Texture {
    paint("timber", 256, |at| {
        let board = (at.x * 6.0).floor();
        let own = super::random::lattice(board as i32, 0, 71);
        let gap = (at.x * 6.0 - board).min(1.0 + board - at.x * 6.0) / 6.0;
        let fibre = noise(glam::Vec2::new(at.x, at.y * 0.125), 96, 72);
        let tone = 0.65 + 0.35 * own + 0.3 * fibre;
        Vec3::new(0.27, 0.15, 0.075) * tone * (0.35 + 0.65 * smoothstep(0.002, 0.009, gap))
    })
}

/// Turned by quarters, then moved.
fn at(x: f32, y: f32, z: f32, quarters: u32) -> Affine3A {
    Affine3A::from_translation(Vec3::new(x, y, z)) * quarter_turn(quarters)
}

/// Places on the four sides of a rectangle of half extents `half`, +z turned to its middle: at whole
/// bays from the middle plus `offset` bays, `long` and `short` of them on its sides along x and along z.
fn sides(half: [f32; 2], y: f32, long: u32, short: u32) -> Vec<Affine3A> {
    let along = |count: u32| (0..count).map(move |i| BAY * (i as f32 - 0.5 * (count as f32 - 1.0)));
    let mut places = Vec::new();
    for x in along(long) {
        places.push(at(x, y, -half[1], 0));
        places.push(at(x, y, half[1], 2));
    }
    for z in along(short) {
        places.push(at(-half[0], y, z, 1));
        places.push(at(half[0], y, z, 3));
    }
    places
}

/// The corners of a rectangle at a height, in the order in which mouldings project inwards.
fn loop_at(half: [f32; 2], inset: f32, y: f32) -> [Vec3; 4] {
    let (x, z) = (half[0] - inset, half[1] - inset);
    [[-x, -z], [-x, z], [x, z], [x, -z]].map(|[x, z]| Vec3::new(x, y, z))
}
