//! Stage 5, interleaved sampling without gaps: what the neighbours of a sample lack, the sample computes.
//!
//! In a tile of interleaved sampling every sample has another part of the lights (§4.3). The samples of the window around one
//! that lie on its surface give it their parts; near an edge some parts lie on other surfaces. The discontinuity buffer then
//! goes without them and takes the rest for all: a part stands for others that it is not like, which is the pattern that the
//! paper shows. Here such parts are computed at the sample itself, so that every sample has the light of all lights, and only
//! where surfaces end more rays are traced.

use std::ops::Range;

use glam::Vec3;
use isophote_scene::{Pinhole, Seen};
use rayon::prelude::*;

/// Largest angle between the normals of one surface, as a cosine: 25°.
const COSINE: f32 = 0.906;
/// Largest distance from a tangent plane, relative to the depth.
const DISTANCE: f32 = 0.01;

/// Whether one surface is seen at two pixels.
pub(super) fn is_continued(here: &Seen, there: &Seen, eye: &Pinhole) -> bool {
    let normal = here.normal();
    let offset = there.point.position - here.point.position;
    let reach = DISTANCE * eye.depth(here.point.position);
    normal.dot(there.normal()) >= COSINE && normal.dot(offset).abs() <= reach
}

/// Which samples give parts to which.
pub(super) struct Fill<'a> {
    size: [usize; 2],
    tile: [u32; 2],
    parts: &'a [u32],
    /// Of each sample the places of its window that lie on its surface, a bit for each.
    like: Vec<u64>,
    /// Of each sample the parts that are not among those.
    missing: Vec<u64>,
}

impl<'a> Fill<'a> {
    /// Compares the samples of a grid, of each of which the part is given and what it sees.
    pub(super) fn new<'s>(
        size: [usize; 2],
        tile: [u32; 2],
        parts: &'a [u32],
        eye: &Pinhole,
        seen: impl Fn(usize) -> Option<&'s Seen> + Sync,
    ) -> Self {
        let count = tile[0] * tile[1];
        let all = u64::MAX >> (64 - count);
        let of = |number: usize| {
            let Some(here) = seen(number) else {
                return (0, 0);
            };
            let (mut like, mut found) = (0, 0);
            for (place, neighbour) in window(number, size, tile) {
                let continues = seen(neighbour).is_some_and(|there| is_continued(here, there, eye));
                if continues || neighbour == number {
                    like |= 1 << place;
                    found |= 1 << parts[neighbour];
                }
            }
            (like, all & !found)
        };
        let (mut like, mut missing) = (Vec::new(), Vec::new());
        let both = (0..parts.len()).into_par_iter().map(of);
        both.unzip_into_vecs(&mut like, &mut missing);
        Self {
            size,
            tile,
            parts,
            like,
            missing,
        }
    }

    /// The parts that a sample computes beside its own, a bit for each.
    pub(super) fn missing(&self, number: usize) -> u64 {
        self.missing[number]
    }

    /// The light of all parts at every sample: of what the samples of its window have of each the mean, and what it has
    /// computed of the others.
    pub(super) fn joined(&self, own: &[Vec3], missing: &[Vec3]) -> Vec<Vec3> {
        let light = (0..own.len()).into_par_iter().map(|number| {
            let like = || {
                window(number, self.size, self.tile)
                    .filter(|(place, _)| self.like[number] >> place & 1 != 0)
                    .map(|(_, neighbour)| neighbour)
            };
            let mut counts = [0_u8; 64];
            like().for_each(|neighbour| counts[self.parts[neighbour] as usize] += 1);
            let given = like().map(|neighbour| {
                own[neighbour] / f32::from(counts[self.parts[neighbour] as usize])
            });
            missing[number] + given.sum::<Vec3>()
        });
        light.collect()
    }
}

/// The samples of the window of a tile's size around one that lie in the grid, each with its place in the window. Odd windows
/// lie around it, even ones reach one further to the left and up.
fn window(
    number: usize,
    [columns, rows]: [usize; 2],
    [m, n]: [u32; 2],
) -> impl Iterator<Item = (u32, usize)> {
    let [i, j] = [number % columns, number / columns];
    // The places of the window of which the sample is in the grid.
    let inside = |at: usize, count: usize, side: u32| -> Range<u32> {
        let half = side / 2;
        let first = half.saturating_sub(at as u32);
        first..side.min((count - at) as u32 + half)
    };
    let (across, down) = (inside(i, columns, m), inside(j, rows, n));
    down.flat_map(move |b| across.clone().map(move |a| (a, b)))
        .map(move |(a, b)| {
            let (x, y) = (
                i + a as usize - (m / 2) as usize,
                j + b as usize - (n / 2) as usize,
            );
            (b * m + a, y * columns + x)
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_stay_in_the_grid() {
        let numbers = |number, tile| window(number, [4, 3], tile).collect::<Vec<_>>();
        assert_eq!(numbers(0, [3, 3]), [(4, 0), (5, 1), (7, 4), (8, 5)]);
        assert_eq!(numbers(5, [2, 1]), [(0, 4), (1, 5)]);
        assert_eq!(numbers(11, [3, 3]), [(0, 6), (1, 7), (3, 10), (4, 11)]);
        assert_eq!(numbers(5, [1, 1]), [(0, 5)]);
        let all: usize = (0..12).map(|number| numbers(number, [3, 3]).len()).sum();
        // Columns have windows of 2, 3, 3 and 2 samples, rows of 2, 3 and 2.
        assert_eq!(all, 70);
    }
}
