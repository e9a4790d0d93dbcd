//! Textures made by calculation; all of them tile.

use glam::{IVec2, Vec2, Vec3};

use super::random::lattice;
use crate::{ColorSpace, Texture, linear_to_srgb};

/// Paints a square base-colour texture; `paint` is given the middle of each texel in 0..1 and answers linear RGB.
pub(super) fn paint(name: &str, size: u32, paint: impl Fn(Vec2) -> Vec3) -> Texture {
    let byte = |value: f32| (linear_to_srgb(value.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8;
    let texels = (0..size * size)
        .map(|i| {
            let at = Vec2::new((i % size) as f32 + 0.5, (i / size) as f32 + 0.5) / size as f32;
            let color = paint(at);
            [byte(color.x), byte(color.y), byte(color.z), 255]
        })
        .collect();
    Texture::new(name, size, size, texels, ColorSpace::Srgb)
}

/// Smooth noise in 0..1 over 0..1 squared that repeats, with so many cells a side.
pub(super) fn noise(at: Vec2, cells: i32, seed: u64) -> f32 {
    let at = at * cells as f32;
    let corner = at.floor();
    let f = at - corner;
    let weight = f * f * (Vec2::splat(3.0) - 2.0 * f);
    let corner = corner.as_ivec2();
    let value = |offset: IVec2| {
        let cell = (corner + offset).rem_euclid(IVec2::splat(cells));
        lattice(cell.x, cell.y, seed)
    };
    let row = |y: i32| {
        let [a, b] = [value(IVec2::new(0, y)), value(IVec2::new(1, y))];
        a + (b - a) * weight.x
    };
    let [a, b] = [row(0), row(1)];
    a + (b - a) * weight.y
}

/// Four octaves of [`noise`], 0..1.
pub(super) fn clouds(at: Vec2, cells: i32, seed: u64) -> f32 {
    let mut sum = 0.0;
    for octave in 0..4 {
        let n = noise(at, cells << octave, seed + octave);
        sum += n * 0.5_f32.powi(octave as i32 + 1);
    }
    sum / 0.9375
}

/// Thin dark lines through marble, 0 on a vein and 1 away from it.
pub(super) fn veins(at: Vec2, cells: i32, seed: u64) -> f32 {
    let bend = Vec2::new(clouds(at, cells, seed + 10), clouds(at, cells, seed + 20));
    let n = noise(at + 0.6 * bend / cells as f32, cells, seed);
    ((n - 0.5).abs() * 9.0).clamp(0.0, 1.0).sqrt()
}

/// A wall of stones: which one (column, row) a point is in, and how far it is from the joints, in texture widths.
/// Every other row is shifted by half a stone.
pub(super) fn courses(at: Vec2, columns: i32, rows: i32) -> (IVec2, f32) {
    let row = (at.y * rows as f32).floor();
    let shift = if row as i32 % 2 == 0 { 0.0 } else { 0.5 };
    let along = at.x * columns as f32 + shift;
    let f = Vec2::new(along.rem_euclid(1.0), (at.y * rows as f32).rem_euclid(1.0));
    let edge = f.min(Vec2::ONE - f) / Vec2::new(columns as f32, rows as f32);
    let stone = IVec2::new((along.floor() as i32).rem_euclid(columns), row as i32);
    (stone, edge.min_element())
}

/// 0 below `low`, 1 above `high`, smooth between.
pub(super) fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
