//! Photons, how they spread, and who finds whom.

use glam::Vec3;
use isophote_scene::reference::{Materials, Normals};

use crate::{Directions, Error, MapParams, Result};

/// Who finds whom: photons the pixels that they light, or points the photons that light them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Deposit {
    /// Every point looks along the maps for the surface that lights it, and takes the footprints of the photons there.
    #[default]
    Gathered,
    /// Every part of a photon is splatted where it lands, as in the paper (§4.2).
    Splatted,
}

/// How the parts of a photon and of its neighbours spread after it is split.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Spread {
    /// Not at all: parts of neighbours run along the same map. Footprints tile what they meet.
    #[default]
    Parallel,
    /// As the photon did, with its directional differential turned by α (§3.4). Since its positional differential is not
    /// turned, the two may cancel: some footprints shrink to bright points.
    Turned,
}

/// By how much splats are wider than their differentials where those of a raster sum up to a flat picture.
const TILING: f32 = 2.0;

/// Photons and their splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonParams {
    /// The maps.
    pub maps: MapParams,
    /// Photons along each side of a light's view, of each of its faces. 1 to 4096.
    pub raster: u32,
    /// Photons along each side of a light's view where those that are gathered meet edges and shadows: there they are halved
    /// until they are as small. 1 to 4096; nothing is halved where it is below twice the raster.
    pub finest: u32,
    /// Who finds whom.
    pub deposit: Deposit,
    /// What splitting does to the differentials; those of photons that are gathered stay parallel.
    pub spread: Spread,
    /// Diffuse reflections between the lights and what is lit. 0 to 16; with 0 there is light straight from the
    /// environment, and from the lights if [`direct`](Self::direct), alone.
    pub bounces: u32,
    /// Directions in which photons go on to the second reflection; a half of them to the third, and so on. 1 to 1024.
    pub branches: u32,
    /// By how much splats are wider than the differentials say; less is sharper. Below 2 those of neighbours leave gaps: where
    /// they are gathered as many more photons are sent as fill them. Positive.
    pub splat_size: f32,
    /// How far a splat reaches out of its plane, in its own mean radii: what a of Eq. (7) is for. Positive.
    pub flatness: f32,
    /// Whether light that comes straight from the lights is that of photons too (§6). The environment is none of them.
    pub direct: bool,
    /// Whether the environment shines: it sends photons, and lights the points from which maps see nothing in its way.
    pub environment: bool,
    /// Which part of the materials counts.
    pub materials: Materials,
    /// Which normals photons are reflected with.
    pub normals: Normals,
    /// Frames that are accumulated, each with its directions turned at random (§6). 1 to 65536.
    pub frames: u32,
    /// Chooses the photons of lights without a raster, and how directions are turned.
    pub seed: u64,
}

impl Default for PhotonParams {
    fn default() -> Self {
        Self {
            maps: MapParams::default(),
            raster: 64,
            finest: 256,
            deposit: Deposit::default(),
            spread: Spread::default(),
            bounces: 1,
            branches: 8,
            splat_size: 2.0,
            flatness: 0.1,
            direct: false,
            environment: true,
            materials: Materials::Pbr,
            normals: Normals::Smooth,
            frames: 1,
            seed: 0,
        }
    }
}

impl PhotonParams {
    /// Refuses what is out of its range.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn check(&self) -> Result<()> {
        self.maps.check()?;
        for (name, side) in [
            ("the raster of photons", self.raster),
            ("the finest raster of photons", self.finest),
        ] {
            if !(1..=1 << 12).contains(&side) {
                return Err(Error::parameter(name, side, "it must be 1 to 4096"));
            }
        }
        self.maps.check_frames(self.frames)?;
        if self.bounces > 16 {
            return Err(Error::parameter(
                "the number of bounces",
                self.bounces,
                "it must be 0 to 16",
            ));
        }
        if self.spread == Spread::Turned && self.deposit == Deposit::Gathered {
            return Err(Error::parameter(
                "how photons spread",
                "turned",
                "photons that are gathered spread in parallel",
            ));
        }
        if !(1..=1 << 10).contains(&self.branches) {
            return Err(Error::parameter(
                "the number of branches",
                self.branches,
                "it must be 1 to 1024",
            ));
        }
        for (name, value) in [
            ("the size of splats", self.splat_size),
            ("the flatness of splats", self.flatness),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::parameter(name, value, "it must be positive"));
            }
        }
        Ok(())
    }

    /// The directions of the maps of all frames.
    pub(crate) fn directions(&self) -> Vec<Vec3> {
        let directions = Directions::new(self.maps.maps);
        (0..self.frames)
            .flat_map(|frame| directions.turned(self.seed, frame).vectors().to_vec())
            .collect()
    }

    /// The directions in which photons leave again after their first landing, after the second, and so on.
    pub(crate) fn branches_of_bounces(&self) -> Vec<Vec<Vec3>> {
        let directions = Directions::new(self.maps.maps);
        let subset = |bounce: u32| directions.subset((self.branches >> bounce).max(1));
        (0..self.bounces.saturating_sub(1)).map(subset).collect()
    }

    /// As many photons as it takes that kernels of gathered ones overlap. Those of a raster's pixels are flat together where
    /// they are twice as wide; narrower ones leave gaps.
    pub(super) fn without_gaps(&self) -> Self {
        if self.deposit == Deposit::Splatted || self.splat_size >= TILING {
            return *self;
        }
        let raster = (self.raster as f32 * TILING / self.splat_size).round();
        Self {
            raster: raster.min(4096.0) as u32,
            splat_size: TILING,
            ..*self
        }
    }
}
