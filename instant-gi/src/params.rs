//! What can be chosen.

use isophote_scene::{Answers, reference::Materials};

use crate::{Error, Result};

/// How a picture is made. By default with as many light paths as the paper's largest setting and without its shortcuts; but light
/// paths start along a lattice and not the paper's Halton sequence, and where shortcuts are chosen, filters compare depths too.
/// [`Sequence::Halton`] and [`Filter::Paper`] are the paper's way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GiParams {
    /// Light paths that are shot, 1 to 65,536; each makes up to `bounces` virtual point lights.
    pub paths: u32,
    /// Where light paths start.
    pub sequence: Sequence,
    /// How many virtual point lights are kept for a picture, 1 to 65,536, by what they would bring it if nothing were in the
    /// way. Of eight times as many light paths they make half to nine tenths of the error that as many paths make. 0, the paper's
    /// way, keeps all.
    pub kept: u32,
    /// How many virtual point lights a point asks for, 1 to 65,536, picked by what they would bring it if nothing were in the
    /// way; of each part of them where they are interleaved. 0, the paper's way, asks for all. What compensating rays meet is lit by all.
    pub selection: u32,
    /// Surfaces that a light path meets, 1 to 16. Only with 1 the indirect light is `indirect`, one bounce; further
    /// bounces count towards `path`.
    pub bounces: u32,
    /// The bounding distance of Eq. (1), metres: light that travelled less than 0.8 times as far is left out, from 1.2
    /// times on all of it counts. 0 is off.
    pub min_d: f32,
    /// Rays a point by which the light that the bound leaves out is found again (Kollig and Keller 2004), 0 to 1024; 0
    /// is the paper's way, and leaves corners dark.
    pub compensation: u32,
    /// How many mirrors and panes of glass a path from the eye goes through, 0 to 16.
    pub depth: u32,
    /// Metres between the points at which light on what mirrors and glass show is computed, to be interpolated between them
    /// (instant caching, §6); at least 0, which computes it at all that they show. CPU only.
    pub caching: f32,
    /// Samples a pixel of light from lights with an extent, 1 to 1024; others need one.
    pub light_rays: u32,
    /// Rays a pixel into the highlights of rough metal, 1 to 1024.
    pub glossy_rays: u32,
    /// Indirect light is computed at every s-th pixel in both directions (§4.2), 1 to 16; the paper takes 4.
    pub downsampling: u32,
    /// The lights are divided among m × n neighbouring samples (§4.3), each side 1 to 8; the paper takes 3 × 3.
    pub interleaving: [u32; 2],
    /// Which sample of a tile has which part of the lights.
    pub pattern: Pattern,
    /// How samples become a picture.
    pub filter: Filter,
    /// How many of the four samples around a pixel must lie on its surface, 0 to 4; pixels with fewer are lit themselves, after the
    /// filter. With 1 or 2 those are a few percent, along silhouettes.
    pub refinement: u32,
    /// How points see the virtual point lights.
    pub visibility: Visibility,
    /// Which part of the materials counts.
    pub materials: Materials,
    /// Chooses the samples. Another seed shoots other light paths.
    pub seed: u64,
}

/// Where light paths start: which light, where on it and in which direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sequence {
    /// The paper's Halton sequence (§4), whose numbers choose the light too.
    Halton,
    /// A stretch of the paths for each light in proportion to its power, and in each stretch a lattice: around point lights a
    /// spherical Fibonacci lattice.
    #[default]
    Lattice,
}

/// How points see the virtual point lights: V of Eq. (1).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Visibility {
    /// By a ray of the secondary tracer for each point and light (§4).
    #[default]
    Rays,
    /// By shadow maps of the lights, which the secondary tracer fills (§6): a ray for each texel. It must answer
    /// [`Distance`](isophote_scene::Answers::Distance).
    Maps(ShadowMaps),
}

/// Paraboloid shadow maps of the virtual point lights (proposed in §6).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadowMaps {
    /// Texels of a map's side, 8 to 1024, a multiple of 8. Each light has a map of four bytes a texel.
    pub resolution: u32,
    /// How much nearer than a point what hides it must be, 0 to 16 texels' widths there. Less darkens corners and curved
    /// surfaces, more lets light through near what stands on something.
    pub bias: f32,
    /// How points look texels up.
    pub lookup: Lookup,
}

/// How points look the texels of shadow maps up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lookup {
    /// The texel they fall on says whether they see the light.
    Nearest,
    /// The four around them do, weighted by how near they are (percentage-closer filtering): smooth shadows of single lights. Of
    /// many lights the nearest texels give pictures as near to rays, in two thirds of the time on CPUs.
    #[default]
    Smooth,
}

impl Default for ShadowMaps {
    fn default() -> Self {
        Self {
            resolution: 128,
            bias: 0.5,
            lookup: Lookup::default(),
        }
    }
}

/// Which sample of a tile of interleaved sampling has which part of the lights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pattern {
    /// The same in every tile (§4.3). [`Filter::Edges`] upsamples each part by itself, so that no pattern shows.
    #[default]
    Regular,
    /// Shuffled in every tile, so that no pattern repeats (proposed in §6); noise takes its place.
    Irregular,
}

/// How the samples of downsampling and interleaving become a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// The discontinuity buffer (§4.3), then joint bilateral upsampling by normals alone (§4.2, Eq. (2)).
    Paper,
    /// Both with depths too, so that surfaces that face alike do not mix.
    #[default]
    Edges,
    /// Parts of the lights that no neighbouring sample on a sample's surface has are computed at the sample, so that every
    /// sample has all light; then upsampling by normals and depths.
    Fill,
}

impl Default for GiParams {
    fn default() -> Self {
        Self {
            paths: 180,
            sequence: Sequence::default(),
            kept: 0,
            selection: 0,
            bounces: 1,
            min_d: 0.1,
            compensation: 0,
            depth: 4,
            caching: 0.0,
            light_rays: 4,
            glossy_rays: 4,
            downsampling: 1,
            interleaving: [1, 1],
            pattern: Pattern::default(),
            filter: Filter::default(),
            refinement: 0,
            visibility: Visibility::default(),
            materials: Materials::default(),
            seed: 0,
        }
    }
}

impl GiParams {
    /// Whether there is anything to compensate.
    pub(crate) fn compensates(&self) -> bool {
        self.compensation > 0 && self.min_d > 0.0
    }

    /// The shadow maps, where points see by them.
    #[cfg(feature = "gpu")]
    pub(crate) fn shadow_maps(&self) -> Option<&ShadowMaps> {
        match &self.visibility {
            Visibility::Rays => None,
            Visibility::Maps(maps) => Some(maps),
        }
    }

    /// Whether samples compute the parts of the lights that they are not given.
    #[cfg(feature = "gpu")]
    pub(crate) fn fills(&self) -> bool {
        self.filter == Filter::Fill && self.interleaving != [1, 1]
    }

    /// Whether lights are sorted along a curve.
    pub(crate) fn sorts(&self) -> bool {
        self.kept > 0 || self.selection > 0
    }

    /// How many virtual point lights there may be when points are lit.
    #[cfg(feature = "gpu")]
    pub(crate) fn most_lights(&self) -> u32 {
        match self.kept {
            0 => self.paths * self.bounces,
            kept => kept.min(self.paths * self.bounces),
        }
    }

    /// Whether there are pixels between the samples that are to be looked at.
    pub(crate) fn refines(&self) -> bool {
        self.refinement > 0 && self.downsampling > 1
    }

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
        let counts: [(&'static str, u32, u32, u32, &'static str); 12] = [
            (
                "the number of light paths",
                self.paths,
                1,
                1 << 16,
                "it must be 1 to 65536",
            ),
            (
                "the number of lights that are kept",
                self.kept,
                0,
                1 << 16,
                "it must be 0 to 65536",
            ),
            (
                "the number of lights that points pick",
                self.selection,
                0,
                1 << 16,
                "it must be 0 to 65536",
            ),
            (
                "the number of bounces",
                self.bounces,
                1,
                16,
                "it must be 1 to 16",
            ),
            (
                "the number of compensating rays",
                self.compensation,
                0,
                1024,
                "it must be 0 to 1024",
            ),
            (
                "the depth of reflections",
                self.depth,
                0,
                16,
                "it must be 0 to 16",
            ),
            (
                "the number of light rays",
                self.light_rays,
                1,
                1024,
                "it must be 1 to 1024",
            ),
            (
                "the number of glossy rays",
                self.glossy_rays,
                1,
                1024,
                "it must be 1 to 1024",
            ),
            (
                "the number of samples that are like a pixel",
                self.refinement,
                0,
                4,
                "it must be 0 to 4",
            ),
            (
                "the downsampling",
                self.downsampling,
                1,
                16,
                "it must be 1 to 16",
            ),
            (
                "a side of the interleaved tile",
                self.interleaving[0],
                1,
                8,
                "it must be 1 to 8",
            ),
            (
                "a side of the interleaved tile",
                self.interleaving[1],
                1,
                8,
                "it must be 1 to 8",
            ),
        ];
        for (name, value, least, most, expected) in counts {
            if !(least..=most).contains(&value) {
                return wrong(name, value.to_string(), expected);
            }
        }
        if !(self.caching >= 0.0 && self.caching.is_finite()) {
            return wrong(
                "the distance of cached light",
                self.caching.to_string(),
                "it must be at least 0",
            );
        }
        if !(self.min_d >= 0.0 && self.min_d.is_finite()) {
            return wrong("min_d", self.min_d.to_string(), "it must be 0 or positive");
        }
        if let Visibility::Maps(maps) = &self.visibility {
            let side = maps.resolution;
            if !(8..=1024).contains(&side) || !side.is_multiple_of(8) {
                return wrong(
                    "the side of the shadow maps",
                    side.to_string(),
                    "it must be 8 to 1024 texels, a multiple of 8",
                );
            }
            if !(0.0..=16.0).contains(&maps.bias) {
                return wrong(
                    "the bias of the shadow maps",
                    maps.bias.to_string(),
                    "it must be 0 to 16 texels",
                );
            }
        }
        Ok(())
    }

    /// What the secondary tracer must answer.
    pub(crate) fn needs(&self) -> Answers {
        match self.visibility {
            _ if self.compensates() => Answers::Surface,
            Visibility::Maps(_) => Answers::Distance,
            Visibility::Rays => Answers::Occlusion,
        }
    }
}
