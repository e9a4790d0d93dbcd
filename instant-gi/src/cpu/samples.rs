//! Stage 5 over the picture: at which pixels light is gathered (§4.2), and by which part of the lights (§4.3).

use glam::Vec3;
use isophote_filters::SampleGrid;
use isophote_scene::{GBuffer, Pinhole, Seen, Tracer, sample::hash};
use rayon::prelude::*;

use super::{
    Meter,
    fill::Fill,
    indirect::{Gather, Receiver, Share},
};
use crate::{Filter, GiParams, Pattern};

/// Points that are lit together.
const CHUNK: usize = 256;

/// Who gathers where.
pub(super) struct Samples<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> {
    pub(super) seen: &'a GBuffer,
    pub(super) gather: &'a Gather<'a, E, S>,
    pub(super) grid: SampleGrid,
    pub(super) params: &'a GiParams,
    pub(super) meter: &'a Meter<'a>,
}

impl<E: Tracer + ?Sized, S: Tracer + ?Sized> Samples<'_, E, S> {
    /// Irradiance at the samples, row by row, and the number of rays.
    pub(super) fn irradiance(&self, eye: &Pinhole) -> (Vec<Vec3>, u64) {
        let [columns, rows] = self.grid.size();
        let numbers = (0..columns * rows).into_par_iter();
        let parts: Vec<u32> = numbers
            .map(|number| self.part([number % columns, number / columns]))
            .collect();
        let [m, n] = self.params.interleaving;
        let count = m * n;
        let of_part = |number: usize| 1 << parts[number];
        if self.params.filter != Filter::Fill || count == 1 {
            let share = Share {
                parts: count,
                scale: count as f32,
                compensate: true,
            };
            return self.gathered(&share, of_part);
        }
        let seen = |number: usize| self.seen(number).and_then(|(_, seen)| seen);
        let fill = Fill::new([columns, rows], [m, n], &parts, eye, seen);
        let share = |compensate| Share {
            parts: count,
            scale: 1.0,
            compensate,
        };
        let (own, rays) = self.gathered(&share(false), of_part);
        let (missing, more) = self.gathered(&share(true), |number| fill.missing(number));
        (fill.joined(&own, &missing), rays + more)
    }

    /// Light of some parts of the lights, a bit for each, at every sample.
    fn gathered(&self, share: &Share, parts: impl Fn(usize) -> u64 + Sync) -> (Vec<Vec3>, u64) {
        let [columns, rows] = self.grid.size();
        let mut light = vec![Vec3::ZERO; columns * rows];
        let rays = light
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(|(chunk, light)| {
                let mut receivers = Vec::with_capacity(light.len());
                let mut places = Vec::with_capacity(light.len());
                for place in 0..light.len() {
                    let number = chunk * CHUNK + place;
                    // Metal too, whose irradiance its neighbours may need.
                    if let Some((pixel, Some(seen))) = self.seen(number) {
                        places.push(place);
                        receivers.push(Receiver {
                            point: &seen.point,
                            normal: seen.normal(),
                            parts: parts(number),
                            stream: pixel as u32,
                        });
                    }
                }
                let mut found = vec![Vec3::ZERO; receivers.len()];
                let rays = self.gather.irradiance(&receivers, share, &mut found);
                for (place, found) in places.into_iter().zip(found) {
                    light[place] = found;
                }
                self.meter.advance(light.len());
                rays
            })
            .sum();
        (light, rays)
    }

    /// The pixel of a sample, and what it sees.
    fn seen(&self, number: usize) -> Option<(usize, Option<&Seen>)> {
        let columns = self.grid.size()[0];
        let [x, y] = self.grid.pixel([number % columns, number / columns]);
        let pixel = y * self.seen.size[0] as usize + x;
        let seen = self.seen.pixels.get(pixel)?;
        Some((pixel, seen.as_ref()))
    }

    /// Which part of the lights lights a sample.
    fn part(&self, [i, j]: [usize; 2]) -> u32 {
        let [m, n] = self.params.interleaving;
        let (i, j) = (i as u32, j as u32);
        let place = (j % n) * m + i % m;
        match self.params.pattern {
            Pattern::Regular => place,
            Pattern::Irregular => shuffled(place, m * n, hash((i / m) ^ hash(j / n))),
        }
    }
}

/// Where a place comes in a shuffled row of as many (Fisher and Yates).
fn shuffled(place: u32, count: u32, mut seed: u32) -> u32 {
    let mut order = [0_u8; 64];
    for (number, slot) in (0..count as u8).zip(&mut order) {
        *slot = number;
    }
    for last in (1..count as usize).rev() {
        seed = hash(seed.wrapping_add(0x9e37_79b9));
        order.swap(last, seed as usize % (last + 1));
    }
    u32::from(order[place as usize])
}
