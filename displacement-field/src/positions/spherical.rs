//! Equal steps of both angles (§3.3): easy to invert, crowded at the poles.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::Arrangement;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Spherical {
    rows: u32,
    columns: u32,
}

impl Spherical {
    pub(crate) const fn new(rows: u32, columns: u32) -> Self {
        Self { rows, columns }
    }

    /// The angles of a direction, in steps.
    fn steps(&self, direction: Vec3) -> (f32, f32) {
        let polar = direction.truncate().length().atan2(direction.z) / PI;
        let around = direction.y.atan2(direction.x) / TAU;
        let around = if around < 0.0 { around + 1.0 } else { around };
        (polar * self.rows as f32, around * self.columns as f32)
    }

    fn index(&self, row: f32, column: u32) -> u32 {
        let row = (row.max(0.0) as u32).min(self.rows - 1);
        row * self.columns + column % self.columns
    }
}

impl Arrangement for Spherical {
    fn count(&self) -> usize {
        self.rows as usize * self.columns as usize
    }

    fn point(&self, index: usize) -> Vec3 {
        let (row, column) = (index as u32 / self.columns, index as u32 % self.columns);
        let polar = PI * (row as f32 + 0.5) / self.rows as f32;
        let around = TAU * column as f32 / self.columns as f32;
        (polar.sin() * Vec2::from_angle(around)).extend(polar.cos())
    }

    fn nearest(&self, direction: Vec3) -> u32 {
        let (row, column) = self.steps(direction);
        self.index(row, (column + 0.5) as u32)
    }

    fn around(&self, direction: Vec3) -> [(u32, f32); 3] {
        let (row, column) = self.steps(direction);
        let row = (row - 0.5).clamp(0.0, self.rows as f32 - 1.0);
        let (down, right) = (row.fract(), column.fract());
        let (row, column) = (row.floor(), column as u32);
        let at = |r: f32, c: u32| self.index(row + r, column + c);
        if down + right < 1.0 {
            [
                (at(0.0, 0), 1.0 - down - right),
                (at(0.0, 1), right),
                (at(1.0, 0), down),
            ]
        } else {
            [
                (at(1.0, 1), down + right - 1.0),
                (at(0.0, 1), 1.0 - down),
                (at(1.0, 0), 1.0 - right),
            ]
        }
    }

    /// From a corner to the middle of a cell at the equator, at most.
    fn reach(&self) -> f32 {
        let (down, right) = (PI / self.rows as f32, TAU / self.columns as f32);
        0.51 * (down * down + right * right).sqrt()
    }
}
