//! The weighted sum that every filter at one resolution computes:
//!
//! ```text
//! O(p) = Σₜ gₜ w(p, p + t) I(p + t) / Σₜ gₜ w(p, p + t)
//! ```
//!
//! over taps t with weights gₜ of their own, w saying how alike the two pixels are.

use rayon::prelude::*;

use crate::{
    Guides,
    guides::{EdgeKernel, Here, Likeness, There},
    image::Rows,
    lanes::{self, Kernel, LANES, Lanes, chunks, load},
};

/// A neighbour and its weight.
#[derive(Clone, Copy)]
pub(crate) struct Tap {
    pub(crate) dx: isize,
    pub(crate) dy: isize,
    pub(crate) weight: f32,
}

/// How alike pixels and their neighbours are, from 0 to 1. A pixel itself must have a weight above 0.
pub(crate) trait Weigh: Sync {
    /// The weights of the pixels from `there` on for those from `here` on.
    fn weights(
        &self,
        likeness: &Likeness,
        source: &Rows,
        here: [isize; 2],
        there: [isize; 2],
    ) -> Lanes;
}

impl Weigh for EdgeKernel {
    #[inline(always)]
    fn weights(&self, likeness: &Likeness, _: &Rows, _: [isize; 2], _: [isize; 2]) -> Lanes {
        Self::weights(self, likeness)
    }
}

/// Filters `source` into `target`, of the same size.
pub(crate) fn run(
    source: &Rows,
    guides: &Guides,
    taps: &[Tap],
    weigh: impl Weigh,
    target: &mut Rows,
) {
    let weigh = &weigh;
    let sums = || vec![[0.0; LANES]; source.channels];
    target
        .rows_mut()
        .enumerate()
        .for_each_init(sums, |sums, (y, output)| {
            lanes::run(Row {
                source,
                guides: &guides.rows,
                taps,
                weigh,
                sums,
                y,
                output,
            });
        });
}

struct Row<'a, W> {
    source: &'a Rows,
    guides: &'a Rows,
    taps: &'a [Tap],
    weigh: &'a W,
    /// One per channel.
    sums: &'a mut [Lanes],
    y: usize,
    output: &'a mut [f32],
}

impl<W: Weigh> Kernel for Row<'_, W> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let width = self.source.width;
        for x in chunks::<LANES>(width) {
            let here = Here::load(self.guides, x, self.y);
            let mut total = [0.0; LANES];
            self.sums.fill([0.0; LANES]);
            for tap in self.taps {
                let from = [x as isize, self.y as isize];
                let at = [from[0] + tap.dx, from[1] + tap.dy];
                let Some(there) = There::load(self.guides, at[0], at[1]) else {
                    continue;
                };
                let likeness = here.likeness(&there, tap.dx as f32, tap.dy as f32);
                let mut weights = self.weigh.weights(&likeness, self.source, from, at);
                for (weight, total) in weights.iter_mut().zip(&mut total) {
                    *weight *= tap.weight;
                    *total += *weight;
                }
                for (channel, sums) in self.sums.iter_mut().enumerate() {
                    let Some(row) = self.source.row(at[1], channel) else {
                        continue;
                    };
                    let values = load(row, at[0], 0.0);
                    for lane in 0..LANES {
                        sums[lane] += weights[lane] * values[lane];
                    }
                }
            }
            let count = LANES.min(width);
            for (channel, sums) in self.sums.iter().enumerate() {
                let output = &mut self.output[channel * width + x..][..count];
                for ((output, sum), total) in output.iter_mut().zip(sums).zip(total) {
                    *output = sum / total;
                }
            }
        }
    }
}
