//! Stage 1: the directions of a hemisphere in a square map, and the place in the map of a direction (§3.4).

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use glam::{Vec2, Vec3};
use isophote_scene::sample::cosine_hemisphere;

use crate::{
    lanes::Lanes,
    math::{quarter, whole},
};

/// How the directions around +z lie in the unit square.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Directions {
    /// Equal steps of both angles: crowded around +z ("uniform" in the paper's figures).
    Polar,
    /// A disk within the square, lifted to the hemisphere (Malley): the square's corners, 21.5 % of it, are not used.
    Rejection,
    /// The square bent into the disk, squares to circles (Shirley and Chiu), lifted to the hemisphere (Malley).
    Concentric,
}

impl Directions {
    /// Every mapping.
    pub const ALL: [Self; 3] = [Self::Polar, Self::Rejection, Self::Concentric];

    /// The unit direction, z ≥ 0, of a place in 0..=1 squared; `None` where the mapping has none.
    pub fn direction(self, place: Vec2) -> Option<Vec3> {
        match self {
            Self::Polar => {
                let (sine, cosine) = (FRAC_PI_2 * place.x).sin_cos();
                Some((sine * Vec2::from_angle(TAU * place.y)).extend(cosine.max(0.0)))
            }
            Self::Rejection => {
                let disk = 2.0 * place - 1.0;
                let height = 1.0 - disk.length_squared();
                (height >= 0.0).then(|| disk.extend(height.sqrt()))
            }
            Self::Concentric => Some(cosine_hemisphere(place)),
        }
    }

    /// The place of a unit direction with z ≥ 0: the inverse of [`direction`](Self::direction).
    pub fn place(self, direction: Vec3) -> Vec2 {
        match self {
            Self::Polar => {
                let polar = direction.truncate().length().atan2(direction.z) / FRAC_PI_2;
                let around = direction.y.atan2(direction.x) / TAU;
                let around = if around < 0.0 { around + 1.0 } else { around };
                Vec2::new(polar.min(1.0), around)
            }
            Self::Rejection => 0.5 * (direction.truncate() + 1.0),
            Self::Concentric => {
                let (x, y) = concentric(direction.x, direction.y);
                Vec2::new(x, y)
            }
        }
    }

    /// The density of directions over solid angle when places are uniform in the square, those without a direction left
    /// out; 1/sr.
    pub fn density(self, direction: Vec3) -> f32 {
        match self {
            Self::Polar => {
                let sine = direction.truncate().length();
                1.0 / (FRAC_PI_2 * TAU * sine.max(1e-6))
            }
            Self::Rejection | Self::Concentric => direction.z.max(0.0) / PI,
        }
    }

    /// Four cells around the place of a unit direction with z ≥ 0 and their weights, which sum to 1 and change continuously
    /// with it.
    pub(crate) fn around(self, direction: Vec3, resolution: u32) -> ([u32; 4], [f32; 4]) {
        let place = self.place(direction);
        let (cells, weights) = corners_at(place.x, place.y, resolution as f32);
        let mut cells = cells.map(|cell| cell as u32);
        if self == Self::Polar {
            // The second angle goes around.
            let row = (place.y * resolution as f32 + 0.5) as u32;
            for (index, cell) in cells.iter_mut().enumerate() {
                let wrapped = (row + resolution - 1 + index as u32 / 2) % resolution;
                *cell = wrapped * resolution + *cell % resolution;
            }
        }
        (cells, weights)
    }

    /// A unit direction in a map's cell, that of its middle if there is one; `None` where the mapping has none.
    pub(crate) fn of_cell(self, cell: usize, resolution: u32) -> Option<Vec3> {
        let side = resolution as usize;
        let corner = Vec2::new((cell % side) as f32, (cell / side) as f32);
        let middle = (corner + 0.5) / resolution as f32;
        self.direction(middle)
            .or_else(|| at_rim(2.0 * middle - 1.0, 1.0 / resolution as f32))
    }

    /// The cell of a map that a unit direction with z ≥ 0 lies in.
    pub fn cell(self, direction: Vec3, resolution: u32) -> u32 {
        let place = self.place(direction);
        cell_at(place.x, place.y, resolution as f32) as u32
    }
}

/// The direction of a square whose middle is off the unit disk, by half its side: halfway from its innermost corner to the
/// rim; `None` where it does not reach the disk.
fn at_rim(middle: Vec2, half: f32) -> Option<Vec3> {
    let inner = (middle.abs() - half).max(Vec2::ZERO) * middle.signum();
    let way = middle - inner;
    // Where inner + t way lies on the rim.
    let (a, b, c) = (
        way.length_squared(),
        inner.dot(way),
        inner.length_squared() - 1.0,
    );
    let t = ((b * b - a * c).max(0.0).sqrt() - b) / a;
    let place = inner + 0.5 * t * way;
    let height = 1.0 - place.length_squared();
    (c < 0.0).then(|| place.extend(height.max(0.0).sqrt()))
}

/// The cell that a place lies in.
#[inline(always)]
pub(crate) fn cell_at<L: Lanes>(x: L, y: L, resolution: f32) -> L {
    let (scale, last) = (L::splat(resolution), L::splat(resolution - 1.0));
    whole(y * scale).min(last) * scale + whole(x * scale).min(last)
}

/// Four cells around a place, and their weights; beyond the square's edge the cell at it.
#[inline(always)]
pub(crate) fn corners_at<L: Lanes>(x: L, y: L, resolution: f32) -> ([L; 4], [L; 4]) {
    let (scale, one) = (L::splat(resolution), L::splat(1.0));
    // From 1 on, so that the conversion rounds down.
    let (x, y) = (x * scale + L::splat(0.5), y * scale + L::splat(0.5));
    let (column, row) = (whole(x), whole(y));
    let (right, down) = (x - column, y - row);
    let (left, up) = (one - right, one - down);
    let inside = |index: L| index.max(L::splat(0.0)).min(L::splat(resolution - 1.0));
    let (west, east) = (inside(column - one), inside(column));
    let (north, south) = (inside(row - one) * scale, inside(row) * scale);
    (
        [north + west, north + east, south + west, south + east],
        [left * up, right * up, left * down, right * down],
    )
}

/// The inverse of [`concentric_disk`](isophote_scene::sample::concentric_disk).
#[inline(always)]
pub(crate) fn concentric<L: Lanes>(x: L, y: L) -> (L, L) {
    let k = L::splat;
    let radius = (x * x + y * y).sqrt().min(k(1.0));
    // 0 on the x axis, 1 on the diagonal, 2 on the y axis.
    let turn = k(2.0) * quarter(x.abs(), y.abs());
    let a = radius * (k(2.0) - turn).min(k(1.0));
    let b = radius * turn.min(k(1.0));
    let half = k(0.5);
    (half + half * a.copysign(x), half + half * b.copysign(y))
}

/// Half the angle that a map's cells span, where they are the largest, radians: how far off a direction may be.
pub(crate) fn reach(directions: Directions, resolution: u32) -> f32 {
    let step = match directions {
        // Along the circle at the horizon, and half as far across.
        Directions::Polar => TAU,
        Directions::Rejection => 2.0,
        Directions::Concentric => 2.0 * FRAC_PI_4 + 0.6,
    };
    (0.75 * step / resolution as f32).min(PI)
}

#[cfg(test)]
mod tests {
    use isophote_scene::sample::{Sampler, uniform_sphere};

    use super::*;

    #[test]
    fn the_cell_of_a_direction_has_one() {
        for directions in Directions::ALL {
            for resolution in [1, 2, 5, 16, 32, 33] {
                for index in 0..4000 {
                    let mut direction = uniform_sphere(Sampler::new(0, 0, index).get_2d(0));
                    direction.z = direction.z.abs();
                    if direction.z < 0.02 {
                        continue;
                    }
                    let cell = directions.cell(direction, resolution);
                    let own = directions.of_cell(cell as usize, resolution);
                    let own = own.expect("a direction");
                    assert!((own.length() - 1.0).abs() < 1e-5 && own.z >= 0.0);
                    assert_eq!(directions.cell(own, resolution), cell, "{directions:?}");
                }
            }
        }
    }
}
