//! The way through the rays: dispatches of which each takes a moment, and pictures in submissions that do.

use std::{
    ops::Range,
    time::{Duration, Instant},
};

use bytemuck::{Pod, Zeroable};
use isophote_scene::{
    Camera, Material,
    gpu::{Context, PassTime, Timer, reference::World},
    reference::{Materials, Progress},
};

use super::Hybrid;
use crate::{HybridParams, Result};

/// Most samples of a dispatch: even a slow tracer lights so many in a moment.
pub(super) const MOST_SAMPLES: u32 = 1 << 16;
/// As in light.wesl.
const MOST_LIGHT_RAYS: u32 = 16;
/// Uniform buffers are bound at multiples of this on every device.
const STRIDE: usize = 256;
/// Drivers give up after some seconds; this leaves room, and is long enough to hide what surrounds a submission.
const MOMENT: Duration = Duration::from_millis(200);
/// Most passes of a submission that are timed.
const PASSES: u32 = 8;

/// `Piece` of fragments.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Piece {
    first: u32,
    count: u32,
    number: u32,
    stage: u32,
}

/// The stages that take rays, as numbered in fragments.wesl.
pub(super) const DIRECT: u32 = 0;
pub(super) const DIFFUSE: u32 = 1;
pub(super) const GLOSSY: u32 = 2;

/// The dispatches of the stages that take rays.
#[derive(Debug)]
pub(super) struct Pieces {
    all: Vec<Piece>,
    pub(super) buffer: wgpu::Buffer,
}

impl Pieces {
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) where there are too many for a buffer.
    pub(super) fn new(
        context: &Context,
        world: &World<'_>,
        params: &HybridParams,
        samples: u32,
        shadow_maps: bool,
    ) -> Result<Self> {
        // With shadow maps no light is chosen.
        let light_rays = if shadow_maps { 1 } else { params.light_rays };
        let counts = [light_rays, params.diffuse_rays, glossy_rays(world, params)];
        let steps = [MOST_LIGHT_RAYS, 1, 1];
        let of_sample: u64 = (counts.iter().zip(steps))
            .map(|(count, step)| u64::from(count.div_ceil(step)))
            .sum();
        let pieces = of_sample * u64::from(samples.div_ceil(MOST_SAMPLES));
        let what = "the dispatches of the hybrid renderer";
        context.check_storage_size(what, STRIDE as u64 * pieces)?;
        let mut all = Vec::with_capacity(pieces as usize);
        for ((stage, count), step) in [DIRECT, DIFFUSE, GLOSSY].into_iter().zip(counts).zip(steps) {
            for number in (0..count).step_by(step as usize) {
                all.extend(
                    (0..samples)
                        .step_by(MOST_SAMPLES as usize)
                        .map(|first| Piece {
                            first,
                            count: MOST_SAMPLES.min(samples - first),
                            number,
                            stage,
                        }),
                );
            }
        }
        let mut bytes = vec![0_u8; STRIDE * all.len()];
        for (place, piece) in bytes.chunks_exact_mut(STRIDE).zip(&all) {
            place[..size_of::<Piece>()].copy_from_slice(bytemuck::bytes_of(piece));
        }
        let buffer = context.buffer("pieces", &bytes, wgpu::BufferUsages::UNIFORM)?;
        Ok(Self { all, buffer })
    }

    pub(super) fn count(&self) -> usize {
        self.all.len()
    }

    /// Those of a stage among some: where each lies in the buffer, and its number of samples.
    pub(super) fn of(&self, stage: u32, some: &Range<usize>) -> impl Iterator<Item = (u32, u32)> {
        (some.clone().map(|number| (number * STRIDE) as u32))
            .zip(&self.all[some.clone()])
            .filter(move |(_, piece)| piece.stage == stage)
            .map(|(offset, piece)| (offset, piece.count))
    }
}

/// Rays of the glossy stage: none where nothing is glossy; those through glass after those of metal.
fn glossy_rays(world: &World<'_>, params: &HybridParams) -> u32 {
    let has = |what: fn(&Material) -> f32| {
        let pbr = params.materials == Materials::Pbr;
        pbr && world.scene.materials.iter().any(|one| what(one) > 0.0)
    };
    match (has(|one| one.metallic), has(|one| one.transmission)) {
        (_, true) => 2 * params.glossy_rays,
        (true, false) => params.glossy_rays,
        (false, false) => 0,
    }
}

impl Hybrid {
    /// As [`record`](Self::record), in submissions that take a moment each, and waits for them. Tells how long the passes took,
    /// by the device's own clock where it has one; `progress` hears of dispatches.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device fails.
    pub fn render(
        &self,
        context: &Context,
        world: World<'_>,
        camera: &Camera,
        progress: &dyn Progress,
    ) -> Result<Vec<PassTime>> {
        let what = "the hybrid renderer";
        let mut timer = Timer::new(context, PASSES);
        let mut times: Vec<PassTime> = Vec::new();
        let (mut done, mut budget) = (0, 1);
        while done < self.pieces.count() {
            let start = Instant::now();
            let next = self.pieces.count().min(done + budget);
            let mut encoder = context.device().create_command_encoder(&Default::default());
            if done == 0 {
                self.record_start(context, &mut encoder, world, camera, Some(&mut timer))?;
            }
            self.record_pieces(&mut encoder, &world, done..next, Some(&mut timer));
            if next == self.pieces.count() {
                self.record_end(context, &mut encoder, &world, Some(&mut timer))?;
            }
            timer.resolve(&mut encoder);
            context.submit(what, encoder)?;
            for pass in timer.read(context)? {
                match times.iter_mut().find(|one| one.name == pass.name) {
                    Some(one) => one.time += pass.time,
                    None => times.push(pass),
                }
            }
            context.wait(what)?;
            budget = match start.elapsed() {
                took if took > MOMENT => (budget / 2).max(1),
                took if took < MOMENT / 3 => 2 * budget,
                _ => budget,
            };
            done = next;
            progress.advance(done as u64, self.pieces.count() as u64);
        }
        Ok(times)
    }
}
