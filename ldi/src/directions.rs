//! The directions of the maps and the one nearest to a ray's (§3.1).
//!
//! A cube around the origin carries a k × k grid on each face; each of the 6k² cells stands for the directions through
//! it. Opposite cells look along the same lines, so one map answers both and there are 3k² maps: a ray whose direction
//! is longest along axis a belongs to a map of that axis, whichever way it goes.
//!
//! The paper's cells are squares of equal size, whose solid angles differ by 5.2 to 1. Here the grid is bent so that
//! cells are of nearly equal angles, which makes the largest angle between a ray and its map smaller (16.1° instead
//! of 19.5° for k = 4), and hence the number of pixels that a ray crosses.

use glam::{Vec2, Vec3};

/// The second coefficient of atan(p) · 4/π ≈ p · (1 + BEND − BEND · |p|); off by less than 0.005.
pub(crate) const BEND: f32 = 0.3476;

/// The grid of directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Directions {
    cells: u32,
}

/// The three axes of a map: the first is that of its depth, the others those of its picture.
#[inline]
pub(crate) fn axes(depth: usize) -> [usize; 3] {
    [depth, (depth + 1) % 3, (depth + 2) % 3]
}

impl Directions {
    /// A k × k grid on each face of the cube.
    pub const fn new(cells: u32) -> Self {
        Self { cells }
    }

    /// k, on a side of a face.
    #[cfg(target_arch = "x86_64")]
    pub(crate) const fn cells(self) -> u32 {
        self.cells
    }

    /// Number of directions, 6k².
    pub const fn count(self) -> usize {
        2 * self.maps()
    }

    /// Number of maps, 3k²: one for each direction and its opposite.
    pub const fn maps(self) -> usize {
        3 * self.cells as usize * self.cells as usize
    }

    /// The axis along which a map's direction is longest: 0, 1 or 2.
    #[inline]
    pub const fn axis(self, map: usize) -> usize {
        map / (self.cells as usize * self.cells as usize)
    }

    /// The map for rays of a direction of any length but 0: that of the cell it goes through.
    #[inline]
    pub fn nearest(self, direction: Vec3) -> usize {
        let longest = direction.abs().max_position();
        let [a, b, c] = axes(longest);
        // Dividing by the signed length turns a direction over to the positive face.
        let scale = 1.0 / direction[a];
        let cell = |p: f32| {
            let bent = p * (1.0 + BEND - BEND * p.abs());
            // A float that is negative becomes 0.
            let cell = ((0.5 * bent + 0.5) * self.cells as f32) as usize;
            cell.min(self.cells as usize - 1)
        };
        let k = self.cells as usize;
        (longest * k + cell(direction[b] * scale)) * k + cell(direction[c] * scale)
    }

    /// Where a map's direction goes in its picture per unit of depth: the direction is 1 along the axis of depth and
    /// this along the other two.
    pub fn slope(self, map: usize) -> Vec2 {
        let k = self.cells as usize;
        let center = |cell: usize| {
            let bent = (2.0 * cell as f32 + 1.0) / k as f32 - 1.0;
            // The inverse of the bend.
            let b = 1.0 + BEND;
            let root = (b * b - 4.0 * BEND * bent.abs()).sqrt();
            (2.0 * bent.abs() / (b + root)).copysign(bent)
        };
        Vec2::new(center(map / k % k), center(map % k))
    }

    /// The unit direction of a map; it also answers for the opposite one.
    pub fn direction(self, map: usize) -> Vec3 {
        let [a, b, c] = axes(self.axis(map));
        let slope = self.slope(map);
        let mut direction = Vec3::ZERO;
        direction[a] = 1.0;
        direction[b] = slope.x;
        direction[c] = slope.y;
        direction.normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isophote_scene::sample::{Sampler, uniform_sphere};

    #[test]
    fn every_direction_finds_itself_and_its_opposite() {
        for cells in [1, 2, 3, 4, 5, 8, 16] {
            let directions = Directions::new(cells);
            assert_eq!(directions.count(), 6 * (cells * cells) as usize);
            for map in 0..directions.maps() {
                let direction = directions.direction(map);
                assert_eq!(directions.nearest(direction), map);
                assert_eq!(directions.nearest(-3.0 * direction), map);
            }
        }
    }

    /// The cell's own direction is nearest or nearly so, and never farther than half a cell's diagonal.
    #[test]
    fn cells_are_as_good_as_a_search() {
        let directions = Directions::new(4);
        let all: Vec<Vec3> = (0..directions.maps())
            .map(|map| directions.direction(map))
            .collect();
        let angle = |a: Vec3, b: Vec3| a.dot(b).abs().min(1.0).acos().to_degrees();
        let (mut largest, mut excess) = (0.0_f32, 0.0_f32);
        for index in 0..20_000 {
            let direction = uniform_sphere(Sampler::new(1, 0, index).get_2d(0));
            let found = angle(direction, all[directions.nearest(direction)]);
            let best = all
                .iter()
                .map(|&other| angle(direction, other))
                .fold(f32::MAX, f32::min);
            largest = largest.max(found);
            excess = excess.max(found - best);
        }
        assert!(largest < 16.2 && excess < 3.4, "{largest} {excess}");
    }

    #[test]
    fn ties_and_axes_are_in_range() {
        let directions = Directions::new(3);
        for x in [-1.0, -0.0, 0.0, 1.0, 1e-38, -1e30] {
            for y in [-1.0, 0.0, 1.0, 1e30] {
                for z in [-1.0, 0.0, 1.0] {
                    let direction = Vec3::new(x, y, z);
                    if direction != Vec3::ZERO {
                        assert!(directions.nearest(direction) < directions.maps());
                    }
                }
            }
        }
    }
}
