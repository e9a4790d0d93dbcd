//! The way through the samples: bands of slots that fit into a buffer, pieces that take a moment.

use std::{
    ops::Range,
    time::{Duration, Instant},
};

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::{
    passes::Pass,
    tables::{COUNTERS, ReceiverWords},
};
use crate::{
    Error, Result,
    gpu::{Context, Dispatch, PassTime, Timer, UniformArray},
    reference::Progress,
};

/// Drivers give up after some seconds; this leaves room, and is long enough to hide what surrounds a submission.
const MOMENT: Duration = Duration::from_millis(200);
/// Samples of a first submission: even a slow tracer does so many in a moment.
const FIRST: u32 = 1 << 12;
const MOST: u32 = 1 << 26;
/// Most slots in a dispatch: a dimension holds 65,535 workgroups.
const LARGEST_PIECE: u32 = 1 << 21;
/// Most pieces in a submission.
const PIECES: u32 = 64;
const WORKGROUP: u32 = 64;
/// Most bytes of sums at a time.
const BAND_BYTES: u64 = 1 << 28;

/// The uniform `piece`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Piece {
    first: u32,
    count: u32,
    number: u32,
    band: u32,
}

/// What the samples sum up to.
pub(super) struct Sums {
    /// Of every slot the sum of every quantity.
    pub(super) halves: Vec<Vec3>,
    pub(super) rays: u64,
}

/// How far a band is: the next sample to take.
struct Place {
    band: Range<u32>,
    samples: u32,
    number: u32,
    slot: u32,
}

impl Place {
    /// The next piece of at most `most` slots; `None` at the end.
    fn next(&mut self, most: u32) -> Option<Piece> {
        if self.number == self.samples {
            return None;
        }
        let count = most.min(LARGEST_PIECE).min(self.band.end - self.slot);
        let piece = Piece {
            first: self.slot,
            count,
            number: self.number,
            band: self.band.start,
        };
        self.slot += count;
        if self.slot == self.band.end {
            self.slot = self.band.start;
            self.number += 1;
        }
        Some(piece)
    }
}

/// What stays the same from piece to piece.
pub(super) struct Work<'a> {
    pub(super) context: &'a Context,
    pub(super) passes: Vec<Pass>,
    pub(super) scene: &'a wgpu::BindGroup,
    pub(super) settings: wgpu::Buffer,
    /// `None` for a camera's pixels.
    pub(super) receivers: Option<&'a [ReceiverWords]>,
    /// Words of a slot's record.
    pub(super) record: u32,
    /// Of both halves.
    pub(super) samples: [u32; 2],
}

/// What one band is worked on with.
struct Band<'a> {
    work: &'a Work<'a>,
    place: Place,
    pieces: UniformArray<Piece>,
    sums: wgpu::Buffer,
    /// Group 0 of every pass.
    groups: Vec<wgpu::BindGroup>,
}

impl Work<'_> {
    /// Takes all samples of slots 0 to `slots`.
    pub(super) fn run(
        &self,
        slots: u32,
        times: &mut Vec<PassTime>,
        progress: &dyn Progress,
    ) -> Result<Sums> {
        let context = self.context;
        let total = u64::from(slots) * u64::from(self.samples[0]);
        let mut sums = Sums {
            halves: Vec::new(),
            rays: 0,
        };
        let (mut done, mut budget, mut first) = (0, FIRST, 0);
        let mut timer = Timer::new(context, PIECES * self.passes.len() as u32);
        while first < slots {
            let last = first + self.band_slots().min(slots - first);
            let mut band = Band::new(self, first..last)?;
            loop {
                let start = Instant::now();
                let taken = band.submit(budget, &mut timer)?;
                if taken == 0 {
                    break;
                }
                let passes = timer.read(context)?;
                context.wait("reference")?;
                for pass in passes {
                    match times.iter_mut().find(|one| one.name == pass.name) {
                        Some(one) => one.time += pass.time,
                        None => times.push(pass),
                    }
                }
                budget = adapted(budget, start.elapsed(), taken);
                done += u64::from(taken);
                progress.advance(done, total);
            }
            band.read(&mut sums)?;
            first = last;
        }
        Ok(sums)
    }

    /// Group 0 of every pass.
    fn bind(
        &self,
        pieces: &UniformArray<Piece>,
        starts: &wgpu::Buffer,
        sums: &wgpu::Buffer,
    ) -> Result<Vec<wgpu::BindGroup>> {
        let resources = [
            self.settings.as_entire_binding(),
            pieces.binding(),
            starts.as_entire_binding(),
            sums.as_entire_binding(),
        ];
        let resources: Vec<_> = (0..).zip(resources).collect();
        let passes = self.passes.iter();
        passes
            .map(|pass| pass.compute.bind(self.context, &resources))
            .collect()
    }

    /// Of how many slots the sums, and the receivers, can be bound.
    fn band_slots(&self) -> u32 {
        let limits = self.context.device().limits();
        let most = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size)
            .min(BAND_BYTES);
        let of_pixel = (8 * u64::from(self.record)).max(16 * 6);
        // Both halves of a pixel or receiver stay together.
        2 * (most / of_pixel).max(1) as u32
    }
}

impl<'a> Band<'a> {
    fn new(work: &'a Work<'a>, slots: Range<u32>) -> Result<Self> {
        let context = work.context;
        let count = slots.end - slots.start;
        let starts = match work.receivers {
            Some(words) => {
                let words = &words[slots.start as usize / 2..slots.end as usize / 2];
                context.buffer("receivers", words, wgpu::BufferUsages::STORAGE)?
            }
            None => context.storage("camera hits", 16 * u64::from(count.min(LARGEST_PIECE)))?,
        };
        // The device clears it.
        let sums = context.storage("sums", 4 * u64::from(work.record) * u64::from(count))?;
        let pieces = UniformArray::new(context, "pieces", &[Piece::zeroed(); PIECES as usize])?;
        let groups = work.bind(&pieces, &starts, &sums)?;
        Ok(Self {
            work,
            place: Place {
                samples: work.samples[0],
                number: 0,
                slot: slots.start,
                band: slots,
            },
            pieces,
            sums,
            groups,
        })
    }

    /// Submits the next samples, at most `budget`, and returns how many.
    fn submit(&mut self, budget: u32, timer: &mut Timer) -> Result<u32> {
        let mut taken = 0;
        let mut pieces = Vec::new();
        while taken < budget && pieces.len() < PIECES as usize {
            let Some(piece) = self.place.next(budget - taken) else {
                break;
            };
            taken += piece.count;
            pieces.push(piece);
        }
        if pieces.is_empty() {
            return Ok(0);
        }
        let context = self.work.context;
        context.check("reference", |device| {
            self.pieces.write(context, &pieces);
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("reference"),
            });
            for (index, piece) in (0..).zip(&pieces) {
                self.record(&mut encoder, index, piece, timer);
            }
            timer.resolve(&mut encoder);
            context.queue().submit([encoder.finish()]);
        })?;
        Ok(taken)
    }

    fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        index: u32,
        piece: &Piece,
        timer: &mut Timer,
    ) {
        let dispatch = Dispatch {
            offset: Some(UniformArray::<Piece>::offset(index)),
            workgroups: [piece.count.div_ceil(WORKGROUP), 1, 1],
        };
        for (one, group) in self.work.passes.iter().zip(&self.groups) {
            let groups = [group, &one.tracer, self.work.scene];
            let timer = Some(&mut *timer);
            one.compute
                .record(encoder, one.name, timer, &groups, &[dispatch]);
        }
    }

    /// Reads the sums, which every pass must have added to for every sample.
    fn read(&self, sums: &mut Sums) -> Result<()> {
        let Work {
            context,
            record,
            samples,
            ref passes,
            ..
        } = *self.work;
        let Range { start, end } = self.place.band;
        let count = (end - start) as usize * record as usize;
        let words: Vec<u32> = context.read("reference", &self.sums, count)?;
        sums.halves.reserve(count);
        for (slot, record) in (start..).zip(words.chunks_exact(record as usize)) {
            let wrong = |what: String| {
                let half = slot % 2;
                let reason = format!(
                    "{what} in pixel or receiver {}, half {half}: its driver is broken",
                    slot / 2
                );
                Error::gpu("the reference integrator", reason)
            };
            let expected = samples[slot as usize % 2] * passes.len() as u32;
            if record[0] != expected {
                let done = record[0];
                return Err(wrong(format!(
                    "the device did not finish, {done} of {expected} passes are done"
                )));
            }
            sums.rays += u64::from(record[1]);
            for words in record[COUNTERS as usize..].chunks_exact(3) {
                let value = Vec3::from_array([words[0], words[1], words[2]].map(f32::from_bits));
                if !value.is_finite() {
                    return Err(wrong(format!("the device calculated {value}")));
                }
                sums.halves.push(value);
            }
        }
        Ok(())
    }
}

/// How many samples come next.
fn adapted(budget: u32, took: Duration, taken: u32) -> u32 {
    if took > MOMENT {
        (budget / 2).max(WORKGROUP)
    } else if took < MOMENT / 3 && taken == budget {
        (budget * 2).min(MOST)
    } else {
        budget
    }
}
