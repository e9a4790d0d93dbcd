//! The integrators that define the right answer.
//!
//! [`Integrator`] estimates the quantities of [`Quantity`] at one point with one sample of a low-discrepancy
//! sequence; [`render`] does so for pixels, box-filtered, and [`bake`] for any [`Receivers`](crate::Receivers). Both keep two
//! independent halves of the samples, so that every result knows its own noise.
//!
//! 1. Occlusion (`ao`, `obscurance`): one cosine-distributed ray a sample. [`occlusion`](mod@self)
//! 2. Light transport (everything else): one path a sample, light sampled at every bounce, and
//!    combined with the found emitters by multiple importance sampling (Veach 1997, power heuristic).
//!
//! Camera rays and the shadow rays of the first surface are traced exactly; all other rays go to the tracer under
//! test, see [`Tracers`]. Results do not depend on the number of threads.

pub(crate) mod light_sampling;
mod occlusion;
pub(crate) mod path;
pub(crate) mod render;

use std::{fmt, str::FromStr};

use glam::Vec3;

use self::light_sampling::LightSampler;
pub use self::render::{Estimate, Layers, Progress, Render, bake, render};
use crate::{
    Answers, Error, Result, Scene, SurfacePoint, Tracer, sample::Sampler, surface::facing,
};

/// What is computed. The names ([`Display`](fmt::Display)) are those of the command line, of layers and of reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Quantity {
    /// `ao`: A(x) = 1/π ∫ V(x, ω) cosθ dω over the hemisphere of the shading normal; V = 1 where nothing is hit
    /// within [`Settings::d_max`], 0 elsewhere and below the surface. 1 where a pixel sees no surface.
    Ao,
    /// `obscurance`: as `ao` with V = min(1, t / `d_max`).
    Obscurance,
    /// `direct`: radiance leaving the first visible surface by light that came straight from the lights.
    Direct,
    /// `indirect`: the same after exactly one bounce in between.
    Indirect,
    /// `path`: everything, up to [`Settings::path_bounces`] surface bounces.
    Path,
    /// `irradiance.direct`: `direct` before the multiplication with the surface's BRDF, W/m².
    IrradianceDirect,
    /// `irradiance.indirect`: the same of `indirect`.
    IrradianceIndirect,
    /// `irradiance.path`: the same of `path`.
    IrradiancePath,
}

impl Quantity {
    /// Every quantity.
    pub const ALL: [Self; 8] = [
        Self::Ao,
        Self::Obscurance,
        Self::Direct,
        Self::Indirect,
        Self::Path,
        Self::IrradianceDirect,
        Self::IrradianceIndirect,
        Self::IrradiancePath,
    ];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ao => "ao",
            Self::Obscurance => "obscurance",
            Self::Direct => "direct",
            Self::Indirect => "indirect",
            Self::Path => "path",
            Self::IrradianceDirect => "irradiance.direct",
            Self::IrradianceIndirect => "irradiance.indirect",
            Self::IrradiancePath => "irradiance.path",
        }
    }

    /// The least a tracer must answer so that the quantity can be computed with it.
    pub const fn needs(self) -> Answers {
        match self {
            Self::Ao | Self::Direct | Self::IrradianceDirect => Answers::Occlusion,
            Self::Obscurance => Answers::Distance,
            _ => Answers::Surface,
        }
    }

    /// Whether it is occlusion rather than light.
    pub const fn is_occlusion(self) -> bool {
        matches!(self, Self::Ao | Self::Obscurance)
    }
}

impl fmt::Display for Quantity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Quantity {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|quantity| quantity.name() == name).ok_or_else(|| Error::Parameter {
            name: "the quantity",
            value: name.into(),
            expected: "known are ao, obscurance, direct, indirect, path, irradiance.direct, irradiance.indirect \
                       and irradiance.path",
        })
    }
}

/// f(0.8 · `min_d`, 1.2 · `min_d`, d) of MS10 Eq. (1): how much counts of light that travelled d metres between two surfaces,
/// none when near, all when far, and a smoothstep between. 1 where `min_d` is 0.
pub fn bound(min_d: f32, distance: f32) -> f32 {
    let (a, b) = (0.8 * min_d, 1.2 * min_d);
    if b == 0.0 {
        return 1.0;
    }
    let s = ((distance - a) / (b - a)).clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

/// Which part of the materials counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Materials {
    /// Every surface is diffuse with its base colour.
    Lambert,
    /// Metallic-roughness and transmission, see [`Bsdf`](crate::Bsdf).
    #[default]
    Pbr,
}

/// Which normals surfaces are shaded with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Normals {
    /// Interpolated from the vertices.
    #[default]
    Smooth,
    /// The triangles' own.
    Flat,
}

/// What the integrators can be told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// How far occlusion reaches, metres; infinite by default. `obscurance` needs a finite one.
    pub d_max: f32,
    /// Bounds the geometry term of `indirect` as MS10 Eq. (1) does: light that travelled less than 0.8 · `min_d`
    /// between the two surfaces is left out, up to 1.2 · `min_d` it is faded in by a smoothstep. Metres; 0 is off.
    pub min_d: f32,
    /// Which part of the materials counts.
    pub materials: Materials,
    /// Which normals are used.
    pub normals: Normals,
    /// Samples per pixel or receiver; at least 1. Powers of two have the least noise.
    pub samples: u32,
    /// Chooses the sequence of samples.
    pub seed: u64,
    /// How many surfaces a light path of `path` may meet; 8 by default, at least 1.
    pub path_bounces: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            d_max: f32::INFINITY,
            min_d: 0.0,
            materials: Materials::default(),
            normals: Normals::default(),
            samples: 64,
            seed: 0,
            path_bounces: 8,
        }
    }
}

/// Who answers which rays.
#[derive(Debug)]
pub struct Tracers<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> {
    /// Camera rays and the shadow rays of the first surface; must answer [`Answers::Surface`].
    pub exact: &'a E,
    /// All other rays.
    pub secondary: &'a S,
}

// Derived, these would ask the tracers themselves to be `Copy`.
impl<E: Tracer + ?Sized, S: Tracer + ?Sized> Clone for Tracers<'_, E, S> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<E: Tracer + ?Sized, S: Tracer + ?Sized> Copy for Tracers<'_, E, S> {}

/// Estimates quantities at a point, one sample at a time.
pub struct Integrator<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> {
    scene: &'a Scene,
    tracers: Tracers<'a, E, S>,
    settings: Settings,
    lights: LightSampler<'a>,
    wanted: Wanted,
}

/// What the list of quantities asks of the two kinds of estimates.
#[derive(Clone, Debug)]
pub(crate) struct Wanted {
    pub(crate) quantities: Vec<Quantity>,
    pub(crate) occlusion: bool,
    pub(crate) radiance: Bounces,
    pub(crate) irradiance: Bounces,
}

/// The first and last number of surface bounces whose light is wanted; empty when `last` is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Bounces {
    pub(crate) first: u32,
    pub(crate) last: u32,
}

impl Wanted {
    fn new(quantities: &[Quantity], settings: &Settings) -> Self {
        use Quantity::{
            Direct, Indirect, IrradianceDirect, IrradianceIndirect, IrradiancePath, Path,
        };
        let bounces = |names| Bounces::of(quantities, names, settings.path_bounces);
        Self {
            quantities: quantities.to_vec(),
            occlusion: quantities.iter().any(|quantity| quantity.is_occlusion()),
            radiance: bounces([Direct, Indirect, Path]),
            irradiance: bounces([IrradianceDirect, IrradianceIndirect, IrradiancePath]),
        }
    }

    /// What quantities ask for, if settings are in their range and tracers know enough; `can_be_hit` says whether
    /// scattered rays can find light.
    pub(crate) fn checked(
        quantities: &[Quantity],
        settings: &Settings,
        can_be_hit: bool,
        [exact, secondary]: [Answers; 2],
    ) -> Result<Self> {
        settings.check(quantities)?;
        exact.require(Answers::Surface, "reference", "the exact tracer")?;
        let needs = quantities.iter().map(|quantity| quantity.needs());
        // Emitters with an extent are also found by scattered rays, whose hits must be known.
        let needed = match quantities.iter().all(|quantity| quantity.is_occlusion()) {
            false if can_be_hit => Answers::Surface,
            _ => needs.max().unwrap_or(Answers::Occlusion),
        };
        secondary.require(needed, "reference", "the secondary tracer")?;
        Ok(Self::new(quantities, settings))
    }
}

impl Bounces {
    fn of(
        quantities: &[Quantity],
        [direct, indirect, path]: [Quantity; 3],
        path_bounces: u32,
    ) -> Self {
        let has = |quantity| quantities.contains(&quantity);
        let first = if has(direct) || has(path) { 1 } else { 2 };
        let last = match (has(path), has(indirect), has(direct)) {
            (true, true, _) => path_bounces.max(2),
            (true, false, _) => path_bounces,
            (false, true, _) => 2,
            (false, false, true) => 1,
            (false, false, false) => 0,
        };
        Self { first, last }
    }
}

impl<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> Integrator<'a, E, S> {
    /// An integrator of some quantities.
    ///
    /// # Errors
    /// [`Error::TracerKnowsLess`] when a tracer's answers hold too little, [`Error::Parameter`] when a setting is
    /// out of its range.
    pub fn new(
        scene: &'a Scene,
        tracers: Tracers<'a, E, S>,
        quantities: &[Quantity],
        settings: &Settings,
    ) -> Result<Self> {
        let lights = LightSampler::new(scene);
        let answers = [tracers.exact.answers(), tracers.secondary.answers()];
        let wanted = Wanted::checked(quantities, settings, lights.can_be_hit(), answers)?;
        Ok(Self {
            scene,
            tracers,
            settings: *settings,
            lights,
            wanted,
        })
    }

    /// Adds one sample of every quantity to `sums`, in the order they were given to [`new`](Self::new). `view`
    /// is the unit direction towards the viewer. Returns the number of rays.
    pub fn estimate(
        &self,
        point: &SurfacePoint,
        view: Vec3,
        sampler: &Sampler,
        sums: &mut [Vec3],
    ) -> u64 {
        let point = &self.with_normals(*point);
        let mut rays = 0;
        let occlusion = if self.wanted.occlusion {
            self.occlusion(point, view, sampler, &mut rays)
        } else {
            [0.0; 2]
        };
        let radiance = self.light(point, view, sampler, self.wanted.radiance, false, &mut rays);
        let irradiance = self.light(
            point,
            view,
            sampler,
            self.wanted.irradiance,
            true,
            &mut rays,
        );
        for (quantity, sum) in self.wanted.quantities.iter().zip(sums) {
            *sum += match quantity {
                Quantity::Ao => Vec3::splat(occlusion[0]),
                Quantity::Obscurance => Vec3::splat(occlusion[1]),
                Quantity::Direct => radiance.direct,
                Quantity::Indirect => radiance.indirect,
                Quantity::Path => radiance.path,
                Quantity::IrradianceDirect => irradiance.direct,
                Quantity::IrradianceIndirect => irradiance.indirect,
                Quantity::IrradiancePath => irradiance.path,
            };
        }
        rays
    }

    /// The value of every quantity where a camera ray meets nothing.
    fn background(&self, sums: &mut [Vec3]) {
        for (quantity, sum) in self.wanted.quantities.iter().zip(sums) {
            if quantity.is_occlusion() {
                *sum += Vec3::ONE;
            }
        }
    }

    fn with_normals(&self, mut point: SurfacePoint) -> SurfacePoint {
        if self.settings.normals == Normals::Flat {
            point.shading_normal = point.geometric_normal;
        }
        point
    }
}

impl Settings {
    fn check(&self, quantities: &[Quantity]) -> Result<()> {
        let wrong = |name, value: String, expected| {
            Err(Error::Parameter {
                name,
                value,
                expected,
            })
        };
        if quantities.is_empty() {
            return wrong(
                "the list of quantities",
                "empty".into(),
                "there must be at least one",
            );
        }
        if self.samples == 0 {
            return wrong(
                "the number of samples",
                "0".into(),
                "there must be at least one",
            );
        }
        if self.path_bounces == 0 || self.path_bounces > 1024 {
            return wrong(
                "the number of bounces",
                self.path_bounces.to_string(),
                "it must be 1 to 1024",
            );
        }
        if self.d_max.is_nan() || self.d_max <= 0.0 {
            return wrong("d_max", self.d_max.to_string(), "it must be positive");
        }
        if quantities.contains(&Quantity::Obscurance) && self.d_max.is_infinite() {
            return wrong(
                "d_max",
                "infinite".into(),
                "obscurance falls off with t/d_max and needs a finite one",
            );
        }
        if !(self.min_d >= 0.0 && self.min_d.is_finite()) {
            return wrong("min_d", self.min_d.to_string(), "it must be 0 or positive");
        }
        Ok(())
    }
}
