//! What can be chosen, and in which ranges.

use crate::{Error, Result};

/// The maps: how many, how fine, and how near a layer may be that still is the point it is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapParams {
    /// N, the number of maps; each answers for its direction and the opposite one. 1 to 65536.
    pub maps: u32,
    /// r: a map has at most r² pixels, as square as they can be. 1 to 4096.
    pub resolution: u32,
    /// Layers that are nearer than this are the surface that is asked from, pixels of the map. 0 to 16.
    pub tolerance: f32,
    /// What stored maps may take, bytes.
    pub max_bytes: u64,
}

impl Default for MapParams {
    fn default() -> Self {
        Self {
            maps: 512,
            resolution: 200,
            tolerance: 0.3,
            max_bytes: 8 << 30,
        }
    }
}

/// Ambient occlusion and obscurance (§3.3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OcclusionParams {
    /// The maps.
    pub maps: MapParams,
    /// How far occluders may be, metres; infinite for all of them.
    pub d_max: f32,
    /// Frames that are accumulated, each with its directions turned at random (§6); the first is not. 1 to 65536.
    pub frames: u32,
    /// Chooses the random rotations.
    pub seed: u64,
}

impl Default for OcclusionParams {
    fn default() -> Self {
        Self {
            maps: MapParams::default(),
            d_max: f32::INFINITY,
            frames: 1,
            seed: 0,
        }
    }
}

impl MapParams {
    /// Refuses what is out of its range.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn check(&self) -> Result<()> {
        if !(1..=1 << 16).contains(&self.maps) {
            return Err(Error::parameter(
                "the number of maps",
                self.maps,
                "it must be 1 to 65536",
            ));
        }
        if !(1..=1 << 12).contains(&self.resolution) {
            return Err(Error::parameter(
                "the resolution of the maps",
                self.resolution,
                "it must be 1 to 4096",
            ));
        }
        if !(0.0..=16.0).contains(&self.tolerance) {
            return Err(Error::parameter(
                "the tolerance",
                self.tolerance,
                "it must be 0 to 16 pixels",
            ));
        }
        Ok(())
    }
}

impl OcclusionParams {
    /// Refuses what is out of its range.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn check(&self) -> Result<()> {
        self.maps.check()?;
        if self.d_max.is_nan() || self.d_max <= 0.0 {
            return Err(Error::parameter("d_max", self.d_max, "it must be positive"));
        }
        if !(1..=1 << 16).contains(&self.frames) {
            return Err(Error::parameter(
                "the number of frames",
                self.frames,
                "it must be 1 to 65536",
            ));
        }
        Ok(())
    }
}
