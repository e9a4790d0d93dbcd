//! Light by maps on the CPU, for points that share them: by photons, from the environment, straight from the lights, and on metals.

use std::f32::consts::PI;

use anyhow::Result;
use glam::Vec3;
use isophote_ldm_ambient::{
    Photons,
    cpu::{Points, Triangles, photons::Gathered},
};
use isophote_scene::{
    Bsdf, DirectLight, Pass, Seen, SurfaceMaterial, Tracer,
    reference::{Progress, Quantity},
    sample::Sampler,
};
use rayon::prelude::*;

use super::{DepositChoice, DirectChoice, Found, GlossyChoice, LdmTechnique};
use crate::reference::Order;

/// Reflected rays that are answered together.
const RAYS: usize = 1 << 20;

/// Radiance and irradiance of each pixel.
#[derive(Clone, Default)]
pub(super) struct Light {
    pub(super) radiance: Vec<Vec3>,
    pub(super) irradiance: Vec<Vec3>,
}

/// The light of a picture.
#[derive(Default)]
pub(super) struct Lit {
    /// Straight from the lights and from the environment.
    pub(super) direct: Light,
    /// That bounced.
    pub(super) indirect: Light,
}

/// The sums of a pixel.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// By cosines: of photons and of the environment.
    light: [Shares; 2],
    weight: f32,
    /// Samples that see a surface.
    seen: u32,
    /// By points: straight from the lights, and what is mirrored of surfaces and of the environment.
    direct: Shares,
    mirrored: [Vec3; 2],
}

#[derive(Clone, Copy, Default)]
struct Shares {
    radiance: Vec3,
    irradiance: Vec3,
}

/// Rays that metals reflect, with what they count and their pixels.
#[derive(Default)]
struct Rays {
    seen: Vec<Seen>,
    towards: Vec<Vec3>,
    counts: Vec<(u32, Vec3)>,
}

/// How points are lit.
pub(super) struct Lighting<'a, 'b> {
    pub(super) technique: &'a LdmTechnique,
    pub(super) triangles: &'a Triangles<'a>,
    pub(super) exact: &'a dyn Tracer,
    pub(super) order: &'a Order<'b>,
    pub(super) progress: &'a dyn Progress,
}

impl Lighting<'_, '_> {
    /// All that is asked for; what is splatted is left out.
    pub(super) fn gather(&self, found: &mut Found) -> Result<Lit> {
        let (order, technique) = (self.order, self.technique);
        let params = technique.gathered(order, technique.ldm_deposit == DepositChoice::Gathered);
        let photons = Photons::emit(self.triangles, self.exact, &params)?;
        found.passes.extend_from_slice(photons.passes());
        let pixels = order.size[0] as usize * order.size[1] as usize;
        let kinds = (order.settings.normals, order.settings.materials);
        let maps = order.maps.maps.saturating_mul(technique.ldm_frames);
        let samples = technique.ldm_samples.min(maps);
        // Where nothing is seen there is no light: the mean cosine over a hemisphere is a half.
        let missing = 0.5 * maps as f32 / samples as f32;
        let mut sums = vec![Sums::default(); pixels];
        let mut rays = Rays::default();
        for sample in 0..samples {
            let scene = self.triangles.scene();
            let (points, seen) = Pass::timed(&mut found.passes, "camera", || {
                let (camera, size) = (order.camera, order.size);
                let points = Points::with_seen(scene, self.exact, camera, size, sample, kinds);
                (points, [pixels as u64, 0])
            });
            if !photons.is_dark() {
                let (light, passes) = photons.light(&points, [sample, samples], self.progress);
                found.passes.extend(passes);
                for ((&index, light), seen) in points.indices().iter().zip(&light).zip(&seen) {
                    sums[index as usize].add(light, seen.albedo());
                }
            }
            if self.wants_direct() {
                let direct = self.direct(&photons, &points, &seen, sample, found);
                for (&index, direct) in points.indices().iter().zip(direct) {
                    let sum = &mut sums[index as usize].direct;
                    sum.radiance += direct.radiance;
                    sum.irradiance += direct.irradiance;
                }
            }
            if technique.ldm_glossy == GlossyChoice::Nearest {
                rays.reflect(&points, &seen, order.settings.seed, sample);
            }
            if rays.towards.len() >= RAYS || sample + 1 == samples {
                self.mirror(&photons, std::mem::take(&mut rays), &mut sums, found);
            }
        }
        Ok(Lit::of(&sums, samples, missing))
    }

    fn wants_direct(&self) -> bool {
        self.order.wants(is_direct)
    }

    /// The light of lights alone: that of the environment comes by the maps.
    fn direct(
        &self,
        photons: &Photons<'_>,
        points: &Points,
        seen: &[Seen],
        sample: u32,
        found: &mut Found,
    ) -> Vec<Shares> {
        if self.technique.ldm_direct == DirectChoice::Photons {
            let arriving = Pass::timed(&mut found.passes, "direct", || {
                (photons.direct(points), [0, 0])
            });
            let share = |(irradiance, seen): (Vec3, &Seen)| Shares {
                radiance: shown(seen).unwrap_or_else(|| seen.albedo() / PI * irradiance),
                irradiance,
            };
            return arriving.into_iter().zip(seen).map(share).collect();
        }
        let lights = DirectLight::without_environment(self.triangles.scene(), self.exact);
        let seed = self.order.settings.seed;
        let lit = |(&pixel, seen): (&u32, &Seen)| {
            let sampler = Sampler::new(seed, pixel, sample);
            let scattered = |bsdf| lights.scattered(&seen.point, seen.view, &bsdf, &sampler);
            let normal = seen.normal();
            let (radiance, rays) = match shown(seen) {
                Some(color) => (color, 0),
                None => scattered(Bsdf::new(normal, &seen.material, seen.is_outside())),
            };
            let (irradiance, more) = match self.order.wants(is_irradiance) {
                true => scattered(Bsdf::diffuse(normal, Vec3::splat(PI))),
                false => (Vec3::ZERO, 0),
            };
            let shares = Shares {
                radiance,
                irradiance,
            };
            (shares, rays + more)
        };
        Pass::timed(&mut found.passes, "direct", || {
            let pairs = points.indices().par_iter().zip(seen);
            let (shares, rays): (Vec<Shares>, Vec<u64>) = pairs.map(lit).unzip();
            (shares, [rays.iter().sum(), 0])
        })
    }

    fn mirror(&self, photons: &Photons<'_>, rays: Rays, sums: &mut [Sums], found: &mut Found) {
        if rays.towards.is_empty() {
            return;
        }
        let points = Points::of_seen(&rays.seen, self.order.settings.normals);
        let (mirrored, passes) = photons.mirrored(&points, &rays.towards, self.progress);
        found.passes.extend(passes);
        for (mirrored, (pixel, count)) in mirrored.iter().zip(rays.counts) {
            let [light, sky] = &mut sums[pixel as usize].mirrored;
            *light += count * mirrored.light;
            *sky += count * mirrored.sky;
        }
    }
}

impl Rays {
    /// A ray of each point that is metal, chosen by how it scatters.
    fn reflect(&mut self, points: &Points, seen: &[Seen], seed: u64, sample: u32) {
        let ray = |(&pixel, seen): (&u32, &Seen)| {
            let metallic = seen.material.metallic;
            if metallic <= 0.0 {
                return None;
            }
            let metal = SurfaceMaterial {
                base_color: metallic * seen.material.base_color,
                metallic: 1.0,
                transmission: 0.0,
                ..seen.material
            };
            let bsdf = Bsdf::new(seen.normal(), &metal, seen.is_outside());
            let u = Sampler::new(seed ^ 0x6c64_6d67, pixel, sample).get_2d(0);
            let chosen = bsdf.sample(seen.view, 0.0, u)?;
            Some((*seen, chosen.light, (pixel, chosen.weight)))
        };
        let pairs = points.indices().par_iter().zip(seen);
        let rays: Vec<_> = pairs.filter_map(ray).collect();
        for (seen, towards, count) in rays {
            self.seen.push(seen);
            self.towards.push(towards);
            self.counts.push(count);
        }
    }
}

impl Sums {
    fn add(&mut self, light: &Gathered, albedo: Vec3) {
        for (sum, more) in self.light.iter_mut().zip([light.light, light.sky]) {
            sum.radiance += albedo / PI * more;
            sum.irradiance += more;
        }
        self.weight += light.weight;
        self.seen += 1;
    }
}

impl Lit {
    fn of(sums: &[Sums], samples: u32, missing: f32) -> Self {
        let light = |of: &dyn Fn(&Sums) -> Shares| Light {
            radiance: sums.iter().map(|sums| of(sums).radiance).collect(),
            irradiance: sums.iter().map(|sums| of(sums).irradiance).collect(),
        };
        let share = 1.0 / samples as f32;
        let mean = |sums: &Sums, which: usize| {
            let weight = sums.weight + (samples - sums.seen) as f32 * missing;
            let (sum, weight) = (sums.light[which], weight.max(f32::MIN_POSITIVE));
            Shares {
                radiance: sum.radiance / weight + share * sums.mirrored[which],
                irradiance: sum.irradiance / weight,
            }
        };
        Self {
            indirect: light(&|sums| mean(sums, 0)),
            direct: light(&|sums| {
                let sky = mean(sums, 1);
                Shares {
                    radiance: sky.radiance + share * sums.direct.radiance,
                    irradiance: sky.irradiance + share * sums.direct.irradiance,
                }
            }),
        }
    }
}

impl Light {
    pub(super) fn sum(&self, other: &Self) -> Self {
        let sum = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| *a + *b).collect();
        Self {
            radiance: sum(&self.radiance, &other.radiance),
            irradiance: sum(&self.irradiance, &other.irradiance),
        }
    }
}

/// What is unlit shows its colour, whatever light there is.
fn shown(seen: &Seen) -> Option<Vec3> {
    seen.material.unlit.then_some(seen.material.base_color)
}

pub(super) fn is_direct(quantity: Quantity) -> bool {
    !quantity.is_occlusion()
        && !matches!(quantity, Quantity::Indirect | Quantity::IrradianceIndirect)
}

pub(super) fn is_bounced(quantity: Quantity) -> bool {
    !quantity.is_occlusion() && !matches!(quantity, Quantity::Direct | Quantity::IrradianceDirect)
}

pub(super) fn is_irradiance(quantity: Quantity) -> bool {
    matches!(
        quantity,
        Quantity::IrradianceDirect | Quantity::IrradianceIndirect | Quantity::IrradiancePath
    )
}
