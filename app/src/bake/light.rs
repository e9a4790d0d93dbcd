//! Values for receivers, by the technique that was asked for.
//!
//! Receivers are put in order along a curve through space and cut into pieces of a fixed number, and every piece is computed on
//! its own: so it does not matter who computes which piece, and layered depth maps are fitted around points that are close
//! to each other.

use std::{
    f32::consts::PI,
    ops::Range,
    sync::atomic::{AtomicU64, Ordering},
};

use anyhow::{Context, Result, ensure};
use glam::{UVec3, Vec3};
use isophote_instant_gi::{InstantGi, Shot};
use isophote_ldm_ambient::{
    MapParams, OcclusionParams, Photons,
    cpu::{
        Points, Triangles,
        occlusion::{Occlusion, Sky},
        photons::Gathered,
    },
};
use isophote_scene::{
    Aabb, Bsdf, DirectLight, Receiver, Receivers, Scene, Selection, Tracer,
    reference::{self, Progress, Quantity, Settings, Tracers},
    sample::{Sampler, hash},
};
use rayon::prelude::*;

use super::techniques::Techniques;
use crate::technique::TechniqueChoice;

/// Receivers of a piece.
const REFERENCE_PIECE: usize = 1 << 12;
const LDM_PIECE: usize = 1 << 18;

/// What is to be computed, and how.
pub(super) struct Light<'a> {
    pub(super) scene: &'a Scene,
    pub(super) tracers: Tracers<'a, dyn Tracer, dyn Tracer>,
    pub(super) selection: &'a Selection,
    pub(super) technique: TechniqueChoice,
    pub(super) quantity: Quantity,
    pub(super) settings: Settings,
    /// Of the technique `ldm`.
    pub(super) maps: MapParams,
    pub(super) techniques: Techniques,
}

/// The virtual lights of the technique `igi`.
type Gi<'a> = InstantGi<'a, dyn Tracer + 'a, dyn Tracer + 'a>;

/// What came of some pieces.
#[derive(Default)]
pub(super) struct Lit {
    /// In the order of the pieces.
    pub(super) values: Vec<Vec3>,
    /// Rays, or look-ups in maps.
    pub(super) rays: u64,
    /// The noise of `values` as relRMSE, where the technique tells.
    pub(super) noise: Option<f64>,
}

/// What came of one piece.
struct Piece {
    values: Vec<Vec3>,
    rays: u64,
    /// As relRMSE; 0 where the technique does not tell.
    noise: f64,
    mean: f64,
}

/// How many receivers a piece has.
pub(super) fn piece_size(technique: TechniqueChoice) -> usize {
    match technique {
        TechniqueChoice::Ldm => LDM_PIECE,
        _ => REFERENCE_PIECE,
    }
}

/// The numbers of receivers along a curve through space, so that neighbours are close to each other.
pub(super) fn order(receivers: &[Receiver]) -> Vec<u32> {
    let bounds = Aabb::around(receivers.iter().map(|receiver| receiver.point.position));
    let extent = (bounds.max - bounds.min)
        .max_element()
        .max(f32::MIN_POSITIVE);
    let code = |receiver: &Receiver| {
        let cell = (receiver.point.position - bounds.min) / extent * 1023.0;
        let UVec3 { x, y, z } = cell.max(Vec3::ZERO).as_uvec3();
        spread(x) | spread(y) << 1 | spread(z) << 2
    };
    let mut keys: Vec<(u32, u32)> = receivers.iter().map(code).zip(0..).collect();
    keys.sort_unstable();
    keys.into_iter().map(|(_, number)| number).collect()
}

/// Ten bits with two empty ones between each.
fn spread(x: u32) -> u32 {
    let x = (x | x << 16) & 0x0300_00FF;
    let x = (x | x << 8) & 0x0300_F00F;
    let x = (x | x << 4) & 0x030C_30C3;
    (x | x << 2) & 0x0924_9249
}

impl Light<'_> {
    /// Computes some pieces of ordered receivers.
    pub(super) fn compute(
        &self,
        receivers: &[Receiver],
        order: &[u32],
        pieces: &[usize],
        progress: &dyn Progress,
    ) -> Result<Lit> {
        let size = piece_size(self.technique);
        let range =
            |piece: usize| -> Range<usize> { piece * size..order.len().min((piece + 1) * size) };
        let total: usize = pieces.iter().map(|&piece| range(piece).len()).sum();
        let maps = match self.technique {
            TechniqueChoice::Ldm => Some(Triangles::new(
                self.scene,
                &self.scene.transforms(),
                self.selection,
            )?),
            _ => None,
        };
        let photons = match &maps {
            Some(triangles) if !self.quantity.is_occlusion() => Some(Photons::emit(
                triangles,
                self.tracers.exact,
                &self
                    .techniques
                    .photons(self.quantity, self.maps, &self.settings),
            )?),
            _ => None,
        };
        let lights = match self.technique {
            TechniqueChoice::Igi => {
                let params = self.techniques.virtual_lights(&self.settings);
                let gi = InstantGi::new(self.scene, self.tracers, &params)?;
                let shot = gi.shoot()?;
                Some((gi, shot))
            }
            _ => None,
        };
        let done = AtomicU64::new(0);
        // Pieces at the same time, so that the threads are busy when one of them comes to its end.
        let parts = pieces.par_iter().map(|&piece| {
            let points = order[range(piece)].iter().map(|&i| receivers[i as usize]);
            let receivers = Receivers {
                points: points.collect(),
            };
            let (count, told) = (receivers.points.len() as u64, AtomicU64::new(0));
            let advance = |part: u64, all: u64| {
                let share = count * part / all.max(1);
                let before = told.fetch_max(share, Ordering::Relaxed);
                let more = share.saturating_sub(before);
                let sum = done.fetch_add(more, Ordering::Relaxed) + more;
                progress.advance(sum, total as u64);
            };
            match (&maps, &photons, &lights) {
                (.., Some(lights)) => Ok(self.by_lights(lights, &receivers, &advance)),
                (_, Some(photons), _) => Ok(self.by_photons(photons, &receivers, &advance)),
                (Some(triangles), ..) => self.by_maps(triangles, receivers, &advance),
                _ => self.by_rays(piece, &receivers, &advance),
            }
        });
        let parts: Vec<Piece> = parts.collect::<Result<_>>()?;
        let mut lit = Lit::default();
        let (mut squares, mut sum) = (0.0, 0.0);
        for part in parts {
            let count = part.values.len() as f64;
            squares += count * (part.noise * part.mean).powi(2);
            sum += count * part.mean;
            lit.rays += part.rays;
            lit.values.extend(part.values);
        }
        let noise = (squares * total as f64).sqrt() / sum;
        lit.noise = Some(noise).filter(|noise| noise.is_finite() && *noise > 0.0);
        ensure!(
            lit.values.iter().all(|value| value.is_finite()),
            "some values are not finite: the scene's lights or materials are out of all proportion"
        );
        Ok(lit)
    }

    fn by_rays(
        &self,
        piece: usize,
        receivers: &Receivers,
        progress: &dyn Progress,
    ) -> Result<Piece> {
        let mut settings = self.settings;
        // Every piece has random numbers of its own.
        settings.seed ^= u64::from(hash(piece as u32)) << 32;
        let quantities = [self.quantity];
        let (estimates, rays) = reference::bake(
            self.scene,
            self.tracers,
            receivers,
            &quantities,
            &settings,
            progress,
        )?;
        let estimate = estimates.into_iter().next().context("one quantity")?;
        let values = estimate.values;
        let sum: f64 = values
            .iter()
            .map(|value| value.as_dvec3().element_sum() / 3.0)
            .sum();
        let noise = f64::from(estimate.noise);
        Ok(Piece {
            rays,
            noise: if noise.is_finite() { noise } else { 0.0 },
            mean: sum / values.len().max(1) as f64,
            values,
        })
    }

    fn by_lights(
        &self,
        (gi, shot): &(Gi<'_>, Shot),
        receivers: &Receivers,
        progress: &dyn Progress,
    ) -> Piece {
        let (values, rays) = gi.irradiance(shot, receivers, self.settings.normals, progress);
        Piece {
            values,
            rays,
            // There are no two halves.
            noise: 0.0,
            mean: 0.0,
        }
    }

    fn by_photons(
        &self,
        photons: &Photons<'_>,
        receivers: &Receivers,
        progress: &dyn Progress,
    ) -> Piece {
        let points = Points::of_receivers(receivers, self.settings.normals);
        let (light, passes) = photons.light(&points, [0, 1], progress);
        let mut rays = passes.iter().map(|pass| pass.rays).sum();
        let values = match self.quantity {
            Quantity::IrradianceDirect => {
                let (values, traced) = self.direct(receivers, &light);
                rays += traced;
                values
            }
            _ => light.iter().map(Gathered::irradiance).collect(),
        };
        Piece {
            values,
            rays,
            // There are no two halves.
            noise: 0.0,
            mean: 0.0,
        }
    }

    /// Light straight from the lights, by rays, and from the environment, by the maps.
    fn direct(&self, receivers: &Receivers, sky: &[Gathered]) -> (Vec<Vec3>, u64) {
        let lights = DirectLight::without_environment(self.scene, self.tracers.exact);
        let samples = match lights.is_noisy() {
            true => self.settings.samples,
            false => 1,
        };
        let lit = |(receiver, sky): (&Receiver, &Gathered)| {
            let point = &receiver.point;
            let normal = point.shading_normal;
            let bsdf = Bsdf::diffuse(normal, Vec3::splat(PI));
            let (mut sum, mut rays) = (Vec3::ZERO, 0);
            for sample in 0..samples {
                let sampler = Sampler::new(self.settings.seed, receiver.index, sample);
                let (light, traced) = lights.scattered(point, normal, &bsdf, &sampler);
                (sum, rays) = (sum + light, rays + traced);
            }
            (sky.sky_irradiance() + sum / samples as f32, rays)
        };
        let lit: (Vec<Vec3>, Vec<u64>) = receivers.points.par_iter().zip(sky).map(lit).unzip();
        (lit.0, lit.1.iter().sum())
    }

    fn by_maps(
        &self,
        triangles: &Triangles<'_>,
        mut receivers: Receivers,
        progress: &dyn Progress,
    ) -> Result<Piece> {
        let count = receivers.points.len();
        for (receiver, index) in receivers.points.iter_mut().zip(0..) {
            receiver.index = index;
        }
        let params = OcclusionParams {
            maps: self.maps,
            d_max: self.settings.d_max,
            frames: 1,
            seed: self.settings.seed,
        };
        let points = Points::of_receivers(&receivers, self.settings.normals);
        drop(receivers);
        let mut occlusion = Occlusion::new(triangles, count, &params)?;
        occlusion.add(&points, [0, 1], progress);
        let value = |sky: &Sky| match self.quantity {
            Quantity::Obscurance => sky.obscurance,
            _ => sky.ao,
        };
        let skies = occlusion.skies();
        Ok(Piece {
            values: skies.iter().map(|sky| Vec3::splat(value(sky))).collect(),
            rays: occlusion.lookups(),
            // There are no two halves.
            noise: 0.0,
            mean: 0.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_spread_to_every_third_place() {
        for bit in 0..10 {
            assert_eq!(spread(1 << bit), 1 << (3 * bit));
        }
        assert_eq!(spread(1023), 0x0924_9249);
    }
}
