//! How finely a field is sampled, and how it is kept.

use crate::{Directions, Error, Positions, Result};

/// How finely a field is sampled, and how it is kept. The default is the paper's compromise, 4226 positions of 32 × 32
/// directions at a byte each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldParams {
    /// Where on the bounding sphere rays are traced from.
    pub positions: Positions,
    /// How the directions of a hemisphere lie in a square map.
    pub directions: Directions,
    /// Directions on each side of a map, 1..=1024.
    pub resolution: u32,
    /// What is kept of each ray.
    pub storage: Storage,
    /// Fields that would take more than this many bytes are refused.
    pub max_bytes: u64,
}

impl Default for FieldParams {
    fn default() -> Self {
        Self {
            positions: Positions::default(),
            directions: Directions::Concentric,
            resolution: 32,
            storage: Storage::Byte,
            max_bytes: 1 << 30,
        }
    }
}

/// What a field keeps of each ray. A miss has a value of its own and is never mixed with a distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Storage {
    /// Distances of 32 bits.
    Float,
    /// Distances of 16 bits: off by R/65,534 at most.
    Word,
    /// Distances of 8 bits (§3): off by R/254 at most.
    Byte,
    /// Only whether anything is hit (§4). How far it is away is that of a plane across the position's normal at the mean
    /// depth of all that is hit from there.
    Bit,
}

impl Storage {
    /// Every storage.
    pub const ALL: [Self; 4] = [Self::Float, Self::Word, Self::Byte, Self::Bit];

    /// Bits for each direction.
    pub const fn bits(self) -> u32 {
        match self {
            Self::Float => 32,
            Self::Word => 16,
            Self::Byte => 8,
            Self::Bit => 1,
        }
    }
}

impl FieldParams {
    /// Directions of a map.
    pub(crate) const fn cells(&self) -> usize {
        self.resolution as usize * self.resolution as usize
    }

    /// Bytes of a field's samples; the largest number there is where it would be more.
    pub fn bytes(&self) -> u64 {
        let positions = self.positions.count() as u64;
        let cells = u64::from(self.resolution) * u64::from(self.resolution);
        match self.storage {
            // Maps start at whole words, and each has a depth.
            Storage::Bit => positions.saturating_mul(8 * cells.div_ceil(64) + 4),
            storage => positions
                .saturating_mul(cells)
                .saturating_mul(u64::from(storage.bits() / 8)),
        }
    }

    /// # Errors
    /// [`Error::Parameter`] when something is out of its range, [`Error::TooLarge`] when there would be too much of it.
    pub(crate) fn check(&self) -> Result<()> {
        self.positions.check()?;
        if !(1..=1024).contains(&self.resolution) {
            return Err(Error::Parameter {
                name: "the number of directions on a map's side",
                value: self.resolution.to_string(),
                expected: "it must be within 1..=1024",
            });
        }
        if self.bytes() > self.max_bytes {
            return Err(Error::TooLarge {
                bytes: self.bytes(),
                limit: self.max_bytes,
            });
        }
        Ok(())
    }
}
