//! Floors, outer walls, roofs and the beams over the court.

use glam::{Affine3A, Mat3, Vec2, Vec3};

use super::{FLOORS, HALF, INNER, Materials, TOP, at, loop_at, sides};
use crate::builtin::{
    shapes::{Shape, arc, profile},
    stage::Stage,
};

/// The outer wall stands a little into the vaults, so that they end in it.
const WALL_INSET: f32 = 0.005;

pub(super) fn build(stage: &mut Stage, materials: &Materials) {
    stage.single(court_floor(materials));
    stage.single(gallery_floors(materials));
    stage.single(walls(materials));
    stage.single(mouldings(materials));
    beams(stage, materials);
    doors(stage, materials);
}

/// A rectangular ring from height `y[0]` to `y[1]`, its hole `inner`.
fn ring(shape: &mut Shape, outer: [f32; 2], inner: [f32; 2], y: [f32; 2]) {
    let flat = Affine3A::from_mat3(Mat3::from_cols(Vec3::X, Vec3::NEG_Z, Vec3::Y));
    let rectangle = |half: [f32; 2]| [[-half[0], -half[1]], half];
    shape
        .place(flat)
        .frame(rectangle(outer), rectangle(inner), y)
        .place(Affine3A::IDENTITY);
}

fn grown(half: [f32; 2], by: f32) -> [f32; 2] {
    half.map(|side| side + by)
}

fn court_floor(materials: &Materials) -> Shape {
    let mut floor = Shape::new("court_floor", materials.pavement);
    let [x, z] = HALF;
    floor.cuboid([-x, -0.3, -z], [x, 0.0, z]);
    floor
}

/// The lower gallery lies one step above the court.
fn gallery_floors(materials: &Materials) -> Shape {
    let mut floors = Shape::new("gallery_floors", materials.terracotta);
    let [low, high] = FLOORS;
    let edge = grown(HALF, -0.56);
    ring(
        &mut floors,
        grown(INNER, 0.3),
        grown(HALF, -0.3),
        [-0.26, low],
    );
    ring(
        &mut floors,
        grown(INNER, 0.2),
        grown(HALF, -0.1),
        [high - 0.3, high],
    );
    // The step is of stone and a little higher than the tiles behind it.
    floors.material(materials.limestone);
    ring(&mut floors, grown(HALF, 0.41), edge, [-0.22, low + 0.004]);
    floors
}

fn walls(materials: &Materials) -> Shape {
    let mut walls = Shape::new("walls", materials.ashlar);
    ring(
        &mut walls,
        grown(INNER, 0.5),
        grown(INNER, -WALL_INSET),
        [-0.31, 10.75],
    );
    // Over the galleries: the band between the storeys, the roof, and the attic round the court.
    walls.material(materials.limestone);
    ring(
        &mut walls,
        grown(HALF, 0.27),
        grown(HALF, -0.27),
        [5.12, 5.52],
    );
    ring(
        &mut walls,
        grown(INNER, 0.3),
        grown(HALF, -0.1),
        [10.25, 10.6],
    );
    ring(
        &mut walls,
        grown(HALF, 0.26),
        grown(HALF, -0.26),
        [10.085, TOP],
    );
    // Piers where the arcades meet.
    for [sx, sz] in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0_f32]] {
        walls.at(sx * HALF[0], 0.0, sz * HALF[1]);
        let mut block = |half: f32, y0: f32, y1: f32, bevel: f32| {
            walls.chamfered([-half, y0, -half], [half, y1, half], bevel);
        };
        block(0.31, 0.05, 10.2, 0.03);
        for (floor, spring) in [(0.15, 3.4), (5.5, 8.4)] {
            block(0.40, floor - 0.03, floor + 0.16, 0.01);
            block(0.36, floor + 0.14, floor + 0.30, 0.03);
            block(0.36, spring - 0.26, spring - 0.12, 0.03);
            block(0.40, spring - 0.14, spring + 0.02, 0.01);
        }
    }
    walls.place(Affine3A::IDENTITY);
    walls
}

/// Everything that is drawn round the court and round the galleries in one line.
fn mouldings(materials: &Materials) -> Shape {
    let mut mouldings = Shape::new("mouldings", materials.limestone);
    let entablature = [
        profile([
            [-0.03, -0.5],
            [0.03, -0.5],
            [0.03, -0.4],
            [0.055, -0.385],
            [0.055, -0.26],
        ]),
        arc([0.055, -0.18], 0.08, -90.0, 0.0, 4),
        profile([
            [0.15, -0.16],
            [0.2, -0.13],
            [0.215, -0.12],
            [0.215, -0.03],
            [0.16, 0.0],
            [-0.03, 0.01],
        ]),
    ]
    .concat();
    mouldings.moulding(&entablature, &loop_at(HALF, 0.25, 5.49), true);
    mouldings.moulding(&entablature, &loop_at(HALF, 0.25, 10.58), true);
    let coping = profile([
        [-0.03, -0.16],
        [0.04, -0.16],
        [0.07, -0.1],
        [0.07, 0.03],
        [-0.54, 0.03],
    ]);
    mouldings.moulding(&coping, &loop_at(HALF, 0.26, TOP), true);
    let skirting = profile([[0.05, -0.02], [0.05, 0.22], [0.03, 0.26], [-0.02, 0.27]]);
    let dado = profile([
        [-0.02, -0.05],
        [0.03, -0.03],
        [0.045, 0.0],
        [0.03, 0.03],
        [-0.02, 0.05],
    ]);
    for floor in FLOORS {
        mouldings.moulding(&skirting, &loop_at(INNER, WALL_INSET, floor), true);
        mouldings.moulding(&dado, &loop_at(INNER, WALL_INSET, floor + 2.55), true);
    }
    mouldings
}

/// Beams on corbels every half bay, and three purlins over them.
fn beams(stage: &mut Stage, materials: &Materials) {
    let inside = HALF[1] - 0.26;
    let mut beam = Shape::new("beam", materials.timber);
    beam.chamfered(
        [-0.11, 10.95, -inside - 0.12],
        [0.11, 11.55, inside + 0.12],
        0.025,
    );
    for side in [-1.0, 1.0_f32] {
        for (reach, y0, y1, half) in [(0.42, 10.82, 10.97, 0.1), (0.26, 10.66, 10.83, 0.09)] {
            // Each ends in the wall at a depth of its own.
            let [a, b] = [side * (inside - reach), side * (inside + half)];
            beam.cuboid([-half, y0, a.min(b)], [half, y1, a.max(b)]);
        }
    }
    let beam = stage.mesh(beam);
    for k in -9..=9 {
        stage.put(beam, at(k as f32 * 0.5 * super::BAY, 0.0, 0.0, 0));
    }
    let mut purlins = Shape::new("purlins", materials.timber);
    for z in [-2.1, 0.0, 2.1] {
        let end = HALF[0] - 0.2;
        purlins.chamfered([-end, 11.5, z - 0.07], [end, 11.68, z + 0.07], 0.015);
    }
    stage.single(purlins);
}

/// Arched doors in every other bay of the lower outer wall, and in all bays but the doors' above.
fn doors(stage: &mut Stage, materials: &Materials) {
    let door = stage.mesh(door(materials));
    let lower = sides(INNER, FLOORS[0], 9, 3);
    let upper = sides(INNER, FLOORS[1], 10, 3);
    for (i, place) in lower.into_iter().enumerate() {
        if i % 4 < 2 && i < 18 || i >= 20 {
            let half_bay = if i < 18 { 0.5 * super::BAY } else { 0.0 };
            stage.put(door, place * at(half_bay, 0.0, 0.0, 0));
        }
    }
    for (i, place) in upper.into_iter().enumerate() {
        if i % 4 >= 2 {
            stage.put(
                door,
                place * Affine3A::from_scale(Vec3::new(-1.0, 0.9, 1.0)),
            );
        }
    }
}

/// Two leaves of boards in an arched stone frame; the wall's face is z = 0.
fn door(materials: &Materials) -> Shape {
    let (half, spring) = (0.55, 1.75);
    let steps = 14;
    // Up the right side, over the arch, down the left side.
    let way = |radius: f32| {
        let mut points = vec![Vec2::new(radius, -0.02)];
        points.extend((0..=steps).map(|i| {
            let angle = std::f32::consts::PI * i as f32 / steps as f32;
            Vec2::new(0.0, spring) + radius * Vec2::from_angle(angle)
        }));
        points.push(Vec2::new(-radius, -0.02));
        points
    };
    let mut door = Shape::new("door", materials.timber);
    let leaf: Vec<Vec3> = way(half + 0.03).iter().map(|p| p.extend(0.022)).collect();
    door.polygon(&leaf);
    door.material(materials.limestone);
    // (distance from the opening's axis, distance from the wall)
    let section = profile([
        [0.70, -0.02],
        [0.70, 0.05],
        [0.67, 0.075],
        [0.60, 0.075],
        [0.55, 0.045],
        [0.55, 0.0],
    ]);
    let count = steps + 2;
    for pair in section.windows(2) {
        let rings = [way(pair[0].x), way(pair[1].x)];
        door.grid([1, count], [false; 2], |i, j| {
            // Downwards along the frame the outside of the section is the front.
            rings[i][count - j].extend(pair[i].y)
        });
    }
    door.material(materials.bronze);
    door.cuboid([-0.012, -0.01, 0.01], [0.012, 2.27, 0.034]);
    for y in [0.45, 1.55] {
        for side in [-1.0, 1.0_f32] {
            let [a, b] = [side * 0.08, side * 0.56];
            door.cuboid([a.min(b), y - 0.03, 0.012], [a.max(b), y + 0.03, 0.032]);
        }
    }
    for x in [-0.07, 0.07] {
        door.sphere(Vec3::new(x, 1.0, 0.05), 0.03, 8);
    }
    door
}
