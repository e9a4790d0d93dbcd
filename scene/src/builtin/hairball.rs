//! A ball of long thin strands before a backdrop: depth complexity without end, the hardest case for anything
//! that samples visibility.

use glam::{Vec2, Vec3};

use super::{
    Number,
    random::Random,
    shapes::{Shape, arc, frames_along},
    stage::Stage,
};
use crate::Scene;

pub(super) const TRIANGLES: Number = Number {
    name: "the number of triangles of builtin:hairball",
    default: 250_000,
    min: 1_000,
    max: 5_000_000,
    expected: "a whole number within 1_000..=5_000_000 is expected",
};

const CENTER: Vec3 = Vec3::new(0.0, 0.5, 0.0);
/// Strands start on a sphere of this radius and turn back at the outer one, metres.
const CORE: f32 = 0.12;
const OUTER: f32 = 0.5;

pub(super) fn build(triangles: usize) -> Scene {
    let mut stage = Stage::default();
    let hair = stage.matt("hair", [0.62, 0.42, 0.25]);
    let paper = stage.matt("paper", [0.6, 0.6, 0.62]);

    let mut backdrop = Shape::new("backdrop", paper);
    let section: Vec<Vec2> = [
        vec![Vec2::new(-4.0, 0.0)],
        arc([0.6, 1.0], 1.0, -90.0, 0.0, 8),
    ]
    .concat()
    .into_iter()
    .chain([Vec2::new(1.6, 5.0)])
    .collect();
    backdrop.grid([section.len() - 1, 1], [false; 2], |i, j| {
        Vec3::new(if j == 0 { 4.0 } else { -4.0 }, section[i].y, -section[i].x)
    });
    let mut left = triangles - backdrop.triangle_count();
    stage.single(backdrop);

    // More triangles make both more strands and smoother ones.
    let segments = ((triangles as f32).sqrt() / 16.0).clamp(8.0, 40.0) as usize;
    let segments_of_core = if triangles < 10_000 { 8 } else { 24 };
    let mut ball = Shape::new("hairball", hair);
    ball.sphere(CENTER, CORE, segments_of_core);
    let core = segments_of_core * (segments_of_core - 2);
    left -= core;
    let strands = left as f32 / strand_triangles(segments) as f32;
    // The share of a ray's way that is covered stays about the same.
    let radius = (0.06 / strands.sqrt()).min(0.006);
    let mut random = Random::new(7);
    while left >= strand_triangles(1) {
        // The last strand is as long as triangles are left.
        let length = segments.min(1 + (left - strand_triangles(1)) / 6);
        left -= strand_triangles(length);
        let curve = strand(&mut random, segments);
        add_strand(&mut ball, &curve[..=length], radius);
    }
    stage.single(ball);

    stage.point_light("key", [1.6, 2.4, 1.9], [28.0, 26.6, 24.5]);
    stage.point_light("fill", [-1.7, 1.1, 1.6], [5.0, 5.6, 6.6]);
    stage.camera("camera_main", [0.35, 0.95, 1.75], [0.0, 0.45, 0.0], 42.0);
    stage.finish()
}

/// A three-sided tube that ends in a point.
const fn strand_triangles(segments: usize) -> usize {
    6 * segments - 3
}

fn add_strand(shape: &mut Shape, curve: &[Vec3], radius: f32) {
    let last = curve.len() - 1;
    let frames = frames_along(curve);
    shape.grid([3, last], [true, false], |i, j| {
        let (sin, cos) = (std::f32::consts::TAU * i as f32 / 3.0).sin_cos();
        // Thinner towards the tip, whose three corners are one.
        let thin = if j == last {
            0.0
        } else {
            1.0 - 0.5 * j as f32 / last as f32
        };
        frames[j].transform_point3(radius * thin * Vec3::new(cos, sin, 0.0))
    });
}

/// A random walk whose direction changes slowly and that is bent back before it leaves the ball.
fn strand(random: &mut Random, segments: usize) -> Vec<Vec3> {
    let start = random.direction();
    let step = 1.6 / segments as f32;
    let turn = 1.1 * (6.0 / segments as f32).sqrt();
    let mut at = CENTER + 0.95 * CORE * start;
    let mut along = start;
    let mut curve = vec![at];
    for _ in 0..segments {
        along = (along + turn * random.direction()).normalize_or(start);
        let out = (at + step * along - CENTER).length();
        let outward = (at - CENTER).normalize_or(start);
        if out > OUTER {
            along = (along - 1.2 * along.dot(outward).max(0.0) * outward - 0.1 * outward)
                .normalize_or(-outward);
        } else if out < CORE {
            along = (along + outward).normalize_or(outward);
        }
        at += step * along;
        // The bend may not suffice when a step is long.
        at = CENTER + (at - CENTER).clamp_length_max(OUTER - 0.01);
        curve.push(at);
    }
    curve
}
