//! What can be chosen when maps are built and pictures made.

use isophote_filters::EdgeStop;
use isophote_scene::reference::Materials;

use crate::{
    Error, Result,
    cpu::maps::{Pixel, TILE},
};

/// How many maps there are, how fine they are, and what they hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LdiParams {
    /// k: directions are the cells of a k × k grid on each face of a cube (§3.1), 6k² in all, answered by 3k² maps.
    /// 1 to 64; 4 gives the paper's 96 directions, 5 its 150, 8 its 384.
    pub cells: u32,
    /// Pixels on each side of a map, rounded up to a multiple of 4; 8 to 4096. The paper takes 128 for diffuse and glossy light, 512 for shadows.
    pub resolution: u32,
    /// What a pixel's layers are.
    pub coverage: Coverage,
    /// How far beside its triangle a layer still stops rays, in pixels of its map: the paper's ε (§3.2). Only for
    /// [`Coverage::Center`]; 0 to 2. More leaks less at edges, and stops more rays that pass them.
    pub epsilon: f32,
    /// The largest admissible error of a layer's depths, pixels of its map (the longer side of one): how far the range that is
    /// kept may reach beyond what the layer is of, at either end. 1/64 to 4096. From it follow the bits of a depth, 5 to 16,
    /// and with those of the triangles' numbers the bytes of a layer, 2 to 8 ([`Packing`](crate::cpu::maps::Packing)). It is
    /// kept as far as 65,536 steps of the map's depth do. Ranges are rounded outwards, so no hit is lost by it: coarser depths
    /// take less memory and make rays ask more triangles in vain.
    pub depth_error: f32,
    /// The most memory that maps may take, bytes.
    pub max_bytes: u64,
}

/// What a pixel's layers are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Coverage {
    /// The triangles that cover the pixel's centre, as a rasteriser finds them (the paper). A ray stops where it meets
    /// a layer's plane within the pixel. Layers do not become more with the number of triangles; edges are as fine as the
    /// pixels.
    Center,
    /// All triangles that touch the pixel, in groups of up to eight; a ray stops where it meets one of them. Every
    /// hit is exact, and none is lost.
    #[default]
    Touched,
}

impl Default for LdiParams {
    /// 96 directions, 128 × 128 pixels, exact, depths to 4 pixels, and at most 4 GiB.
    fn default() -> Self {
        Self {
            cells: 4,
            resolution: 128,
            coverage: Coverage::default(),
            epsilon: 0.6,
            depth_error: 4.0,
            max_bytes: 4 << 30,
        }
    }
}

impl LdiParams {
    /// An error unless every parameter is in its range.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn check(&self) -> Result<()> {
        let wrong = |name, value: String, expected| {
            Err(Error::Parameter {
                name,
                value,
                expected,
            })
        };
        if !(1..=64).contains(&self.cells) {
            return wrong(
                "the number of cells on a side of the cube",
                self.cells.to_string(),
                "it must be 1 to 64",
            );
        }
        if !(8..=4096).contains(&self.resolution) {
            return wrong(
                "the resolution of the maps",
                self.resolution.to_string(),
                "it must be 8 to 4096 pixels",
            );
        }
        if !(0.0..=2.0).contains(&self.epsilon) {
            return wrong(
                "the tolerance of the maps",
                self.epsilon.to_string(),
                "it must be 0 to 2 pixels",
            );
        }
        if !(1.0 / 64.0..=4096.0).contains(&self.depth_error) {
            return wrong(
                "the error of the maps' depths",
                self.depth_error.to_string(),
                "it must be 1/64 to 4096 pixels",
            );
        }
        if self.pixels() * size_of::<Pixel>() as u64 > self.max_bytes {
            return Err(Error::TooLarge {
                limit: self.max_bytes,
                remedy: "take fewer directions or a lower resolution",
            });
        }
        Ok(())
    }

    /// Pixels of all maps together.
    pub(crate) fn pixels(&self) -> u64 {
        let side = self.resolution.next_multiple_of(TILE);
        3 * u64::from(self.cells).pow(2) * u64::from(side).pow(2)
    }
}

/// How a picture is made; the defaults are the paper's, but for [`edges`](Self::edges).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HybridParams {
    /// Samples a pixel, 1 or 4; what meets the same triangle is shaded once (§4), with its part of the pixel's rays.
    pub samples: u32,
    /// Diffuse secondary rays a pixel, 1 to 65,536 (§7: 8).
    pub diffuse_rays: u32,
    /// Glossy secondary rays a pixel, also through glass, 1 to 65,536 (§7: 16). Mirrors take one.
    pub glossy_rays: u32,
    /// Shadow rays a pixel towards the lights, 1 to 65,536 (§7: 16 for area lights).
    pub light_rays: u32,
    /// Who answers the shadow rays of what the camera sees.
    pub shadows: Shadows,
    /// Width of the Gaussian over the diffuse light that bounced, pixels, odd (§7: 11); 1 does not filter.
    pub filter_width: u32,
    /// Width of the Gaussian over the light straight from the lights, where surfaces are diffuse alone; pixels, odd.
    /// 1, the default, does not filter. The paper filters soft shadows (§7) and tells no width.
    pub light_filter_width: u32,
    /// Standard deviation of both Gaussians, pixels, 0.1 to 1000. The paper gives none.
    pub filter_sigma: f32,
    /// Where the Gaussians stop; with `None` they blur across everything, as the paper's do (§5).
    pub edges: Option<EdgeStop>,
    /// The mip level at which textures are read where diffuse and glossy rays hit (§5); each further 1 halves the resolution.
    /// Mirrors and glass show them as they are.
    pub texture_level: f32,
    /// Which part of the materials counts.
    pub materials: Materials,
    /// Chooses the samples.
    pub seed: u64,
}

/// Who answers the shadow rays of what the camera sees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Shadows {
    /// The exact tracer, in the place of the paper's shadow map (§5).
    #[default]
    Exact,
    /// The tracer of the secondary rays (§7, Fig. 8). What is not in its maps casts no shadow.
    Secondary,
}

impl Default for HybridParams {
    fn default() -> Self {
        Self {
            samples: 1,
            diffuse_rays: 8,
            glossy_rays: 16,
            light_rays: 16,
            shadows: Shadows::default(),
            filter_width: 11,
            light_filter_width: 1,
            filter_sigma: 2.0,
            edges: Some(EdgeStop::default()),
            texture_level: 3.0,
            materials: Materials::default(),
            seed: 0,
        }
    }
}

impl HybridParams {
    /// An error unless every parameter is in its range. The Gaussians' are checked by the filter.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn check(&self) -> Result<()> {
        let wrong = |name, value: String, expected| {
            Err(Error::Parameter {
                name,
                value,
                expected,
            })
        };
        if ![1, 4].contains(&self.samples) {
            return wrong(
                "the number of samples a pixel",
                self.samples.to_string(),
                "it must be 1 or 4",
            );
        }
        for rays in [self.diffuse_rays, self.glossy_rays, self.light_rays] {
            if !(1..=1 << 16).contains(&rays) {
                return wrong(
                    "a number of rays a pixel",
                    rays.to_string(),
                    "it must be 1 to 65536",
                );
            }
        }
        if !(0.0..=32.0).contains(&self.texture_level) {
            return wrong(
                "the mip level of textures",
                self.texture_level.to_string(),
                "it must be 0 to 32",
            );
        }
        Ok(())
    }
}
