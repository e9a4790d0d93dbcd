//! Stage 1: points on the unit sphere, the one next to a direction in constant time, and those around it.
//!
//! [`Positions::Slater`] has the points of a triangle subdivided over and over (§3.3): two hemispheres of rings of 4k
//! points, which is the lattice |i| + |j| ≤ n, wound up. The rings' heights are chosen so that every point stands for the
//! same area. The others are spherical coordinates, which the paper compares with, and an equal-area octahedral map.

mod octahedral;
mod slater;
mod spherical;

use glam::Vec3;

pub(crate) use self::slater::Slater;
use self::{octahedral::Octahedral, spherical::Spherical};
use crate::{Error, Result};

/// Where on the unit sphere a field has maps.
///
/// Numbers that are out of their ranges count as the nearest that is not; fields of them are refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Positions {
    /// Two hemispheres of 2n² + 2n + 1 points: 290, 1090, 4226, 16642 for n = 8, 16, 32, 64.
    Slater {
        /// Rings between pole and equator, 1..=256.
        rings: u32,
    },
    /// Equal steps of both angles: crowded at the poles.
    Spherical {
        /// Steps from pole to pole, 2..=512.
        rows: u32,
        /// Steps around, 3..=1024.
        columns: u32,
    },
    /// The cells of a square that is folded over the sphere, all of the same area.
    Octahedral {
        /// Cells on each side of the square, 2..=512.
        side: u32,
    },
}

impl Default for Positions {
    /// 4226 points.
    fn default() -> Self {
        Self::Slater { rings: 32 }
    }
}

/// What every arrangement of points can do.
trait Arrangement {
    fn count(&self) -> usize;
    fn point(&self, index: usize) -> Vec3;
    fn nearest(&self, direction: Vec3) -> u32;
    fn around(&self, direction: Vec3) -> [(u32, f32); 3];
    fn reach(&self) -> f32;
}

impl Positions {
    /// The paper's 1122 points by spherical coordinates; it does not say in how many rows.
    pub const PAPER_SPHERICAL: Self = Self::Spherical {
        rows: 22,
        columns: 51,
    };

    /// How many points there are.
    pub fn count(self) -> usize {
        self.with(|points| points.count())
    }

    /// A point of the unit sphere, by its number below [`count`](Self::count).
    pub fn point(self, index: usize) -> Vec3 {
        self.with(|points| points.point(index))
    }

    /// The number of the point whose cell a unit direction lies in; no further away than [`reach`](Self::reach).
    pub fn nearest(self, direction: Vec3) -> u32 {
        self.with(|points| points.nearest(direction))
    }

    /// Three points around a unit direction and their weights, which sum to 1 and change continuously with it, but for
    /// the poles of [`Spherical`](Self::Spherical), which no point is at. A point's own weight at the point is 1.
    pub fn around(self, direction: Vec3) -> [(u32, f32); 3] {
        self.with(|points| points.around(direction))
    }

    /// The largest distance between a unit direction and its [`nearest`](Self::nearest) point.
    pub fn reach(self) -> f32 {
        self.with(|points| points.reach())
    }

    fn with<T>(self, ask: impl Fn(&dyn Arrangement) -> T) -> T {
        match self {
            Self::Slater { rings } => ask(&Slater::new(rings.clamp(1, 256))),
            Self::Spherical { rows, columns } => {
                ask(&Spherical::new(rows.clamp(2, 512), columns.clamp(3, 1024)))
            }
            Self::Octahedral { side } => ask(&Octahedral::new(side.clamp(2, 512))),
        }
    }

    pub(crate) fn check(self) -> Result<()> {
        let wrong = |name, value: u32, expected| {
            Err(Error::Parameter {
                name,
                value: value.to_string(),
                expected,
            })
        };
        match self {
            Self::Slater { rings } if !(1..=256).contains(&rings) => {
                wrong("the number of rings", rings, "it must be within 1..=256")
            }
            Self::Spherical { rows, .. } if !(2..=512).contains(&rows) => {
                wrong("the number of rows", rows, "it must be within 2..=512")
            }
            Self::Spherical { columns, .. } if !(3..=1024).contains(&columns) => wrong(
                "the number of columns",
                columns,
                "it must be within 3..=1024",
            ),
            Self::Octahedral { side } if !(2..=512).contains(&side) => wrong(
                "the octahedral map's side",
                side,
                "it must be within 2..=512",
            ),
            _ => Ok(()),
        }
    }
}
