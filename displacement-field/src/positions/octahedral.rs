//! The middles of the cells of a square that is folded over the sphere, equal areas to equal areas (after P. Clarberg,
//! "Fast equal-area mapping of the (hemi)sphere using SIMD", 2008).

use std::f32::consts::FRAC_PI_2;

use glam::{Vec2, Vec3};

use super::Arrangement;
use crate::math::quadrant;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Octahedral {
    side: i32,
}

impl Octahedral {
    pub(crate) const fn new(side: u32) -> Self {
        Self { side: side as i32 }
    }

    /// −1..=1 in both coordinates; the upper hemisphere is the diamond in the middle.
    fn to_square(direction: Vec3) -> Vec2 {
        let radius = (1.0 - direction.z.abs()).max(0.0).sqrt();
        let (number, share) = quadrant(direction.x, direction.y);
        let (along, across) = (radius * (1.0 - share), radius * share);
        let (x, y) = if number as i32 % 2 == 0 {
            (along, across)
        } else {
            (across, along)
        };
        let (x, y) = if direction.z < 0.0 {
            (1.0 - y, 1.0 - x)
        } else {
            (x, y)
        };
        Vec2::new(x.copysign(direction.x), y.copysign(direction.y))
    }

    fn to_sphere(square: Vec2) -> Vec3 {
        let (x, y) = (square.x.abs(), square.y.abs());
        let lower = x + y > 1.0;
        let (x, y) = if lower { (1.0 - y, 1.0 - x) } else { (x, y) };
        let radius = x + y;
        let share = if radius > 0.0 { y / radius } else { 0.0 };
        let height = 1.0 - radius * radius;
        let flat = (1.0 - height * height).max(0.0).sqrt() * Vec2::from_angle(FRAC_PI_2 * share);
        Vec3::new(
            flat.x.copysign(square.x),
            flat.y.copysign(square.y),
            if lower { -height } else { height },
        )
        .normalize()
    }

    /// A cell by its column and row, which may lie one step beyond an edge: there the square meets itself, mirrored.
    fn index(&self, column: i32, row: i32) -> u32 {
        let last = self.side - 1;
        let (mut x, mut y) = (column, row);
        if x < 0 || x > last {
            x = x.clamp(0, last);
            y = last - y;
        }
        if y < 0 || y > last {
            y = y.clamp(0, last);
            x = last - x;
        }
        (y * self.side + x) as u32
    }
}

impl Arrangement for Octahedral {
    fn count(&self) -> usize {
        (self.side * self.side) as usize
    }

    fn point(&self, index: usize) -> Vec3 {
        let cell = Vec2::new(
            (index as i32 % self.side) as f32,
            (index as i32 / self.side) as f32,
        );
        Self::to_sphere((cell + 0.5) * 2.0 / self.side as f32 - 1.0)
    }

    fn nearest(&self, direction: Vec3) -> u32 {
        let cell = (0.5 * (Self::to_square(direction) + 1.0) * self.side as f32).floor();
        let last = self.side - 1;
        let [x, y] = [cell.x as i32, cell.y as i32].map(|side| side.clamp(0, last));
        (y * self.side + x) as u32
    }

    fn around(&self, direction: Vec3) -> [(u32, f32); 3] {
        let place = 0.5 * (Self::to_square(direction) + 1.0) * self.side as f32 - 0.5;
        let corner = place.floor();
        let (right, down) = (place.x - corner.x, place.y - corner.y);
        let at = |x: i32, y: i32| self.index(corner.x as i32 + x, corner.y as i32 + y);
        if right + down < 1.0 {
            [
                (at(0, 0), 1.0 - right - down),
                (at(1, 0), right),
                (at(0, 1), down),
            ]
        } else {
            [
                (at(1, 1), right + down - 1.0),
                (at(1, 0), 1.0 - down),
                (at(0, 1), 1.0 - right),
            ]
        }
    }

    /// Measured: cells on the creases along the axes are the longest.
    fn reach(&self) -> f32 {
        4.0 / self.side as f32
    }
}
