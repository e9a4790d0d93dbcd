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
    /// Times the number of maps at most 2²².
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

    /// Refuses numbers of frames that are out of their range, or have more directions than can be held.
    pub(crate) fn check_frames(&self, frames: u32) -> Result<()> {
        if !(1..=1 << 16).contains(&frames) {
            return Err(Error::parameter(
                "the number of frames",
                frames,
                "it must be 1 to 65536",
            ));
        }
        let directions = u64::from(self.maps) * u64::from(frames);
        if directions > 1 << 22 {
            return Err(Error::parameter(
                "the number of maps of all frames",
                directions,
                "it must be at most 4194304: take fewer maps or fewer frames",
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
        self.maps.check_frames(self.frames)
    }
}
