//! The weighted sum that the upsampling filters compute, from samples on a coarse grid of pixels:
//!
//! ```text
//! O(p) = Σ_g c_g(p) O_g(p) / Σ_g c_g(p)
//! O_g(p) = Σ_q f(p, q) w(p, q) I(q) / Σ_q f(p, q) w(p, q), q in group g
//! ```
//!
//! with w the weight of an [`EdgeStop`](crate::EdgeStop) and f a Gaussian over the near samples, and over those farther
//! away where none of the near ones is like the pixel. The samples of a group are those of one place in the tiles of
//! interleaved sampling; without tiles there is one group and c does not matter.
//!
//! All pixels of a row with the same place between the samples have the same f. So a row is computed in as many
//! phases as the factor says, and in a phase neighbouring lanes need neighbouring samples.

use rayon::prelude::*;

use crate::{
    EdgeStop, Guides, ImageView, Neighborhood, Result,
    error::require,
    guides::{EdgeKernel, Here, There},
    image::{Rows, check_length},
    lanes::{self, Kernel, LANES, Lanes, chunks, exp, load},
};

/// Largest number of pixels from one sample to the next.
const MAX_FACTOR: usize = 64;

/// Which pixels of a picture are computed when every `factor`-th is, in both directions.
///
/// Sample (i, j) is the pixel (i · factor + o, j · factor + o') with o = ⌊factor / 2⌋, or the last pixel where a side
/// has fewer than that. There are as many samples as there are such pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleGrid {
    factor: usize,
    full: [usize; 2],
}

impl SampleGrid {
    /// The samples of a picture of `[width, height]` pixels; `factor` is 1 to 64.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when the factor is out of range or a side is 0.
    pub fn new(full: [usize; 2], factor: usize) -> Result<Self> {
        check_factor(factor)?;
        for side in full {
            require(
                side > 0,
                "a side of the picture",
                side,
                "it must be at least 1",
            )?;
        }
        Ok(Self { factor, full })
    }

    /// Columns and rows of samples.
    pub fn size(&self) -> [usize; 2] {
        [0, 1].map(|axis| (self.full[axis] - 1 - self.offset()[axis]) / self.factor + 1)
    }

    /// The pixel of sample `[i, j]`.
    pub fn pixel(&self, [i, j]: [usize; 2]) -> [usize; 2] {
        let [x, y] = self.offset();
        [i * self.factor + x, j * self.factor + y]
    }

    /// Takes the samples out of a picture that has them all.
    ///
    /// # Errors
    /// [`Error::Size`](crate::Error::Size) when the picture is not of the grid's size.
    pub fn gather(&self, image: ImageView<'_>) -> Result<Vec<f32>> {
        let [width, height] = self.full;
        let channels = image.channels();
        image.expect_size("the image", [width, height, channels])?;
        let [columns, rows] = self.size();
        let samples = (0..rows).flat_map(|j| (0..columns).map(move |i| [i, j]));
        let pixel = |sample| {
            let [x, y] = self.pixel(sample);
            &image.data()[(y * width + x) * channels..][..channels]
        };
        Ok(samples.flat_map(pixel).copied().collect())
    }

    fn offset(&self) -> [usize; 2] {
        self.full.map(|side| (self.factor / 2).min(side - 1))
    }
}

pub(crate) fn check_factor(factor: usize) -> Result<()> {
    require(
        (1..=MAX_FACTOR).contains(&factor),
        "the upsampling factor",
        factor,
        "it must be 1 to 64",
    )
}

/// What all upsampling filters have in common.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Upsampling {
    pub(crate) factor: usize,
    /// Columns and rows of the tiles of interleaved sampling.
    pub(crate) tile: [usize; 2],
    pub(crate) around: Neighborhood,
    pub(crate) edges: EdgeStop,
}

impl Upsampling {
    pub(crate) fn apply(
        &self,
        image: ImageView<'_>,
        guides: &Guides,
        output: &mut [f32],
    ) -> Result<()> {
        let (width, height, channels) = (guides.width(), guides.height(), image.channels());
        check_length("the output", output, [width, height, channels])?;
        let grid = SampleGrid::new([width, height], self.factor)?;
        let [columns, rows] = grid.size();
        image.expect_size("the image of samples", [columns, rows, channels])?;
        let samples = Samples {
            values: Rows::of(image),
            guides: guides_of_samples(guides, grid),
            grid,
        };
        let [near, far] = self.groups();
        let edges = EdgeKernel::from(self.edges);
        output
            .par_chunks_exact_mut(width * channels)
            .enumerate()
            .for_each_init(Scratch::default, |scratch, (y, output)| {
                lanes::run(Row {
                    upsampling: self,
                    samples: &samples,
                    guides: &guides.rows,
                    near: &near,
                    far: &far,
                    edges,
                    scratch,
                    y,
                    output,
                });
            });
        Ok(())
    }

    /// The near and the far samples around a pixel, as distances from the one to the left and above, group by group.
    fn groups(&self) -> [Vec<Vec<[isize; 2]>>; 2] {
        let [m, n] = self.tile.map(|side| side as isize);
        let [radius, reach] = [self.around.radius, self.around.reach].map(|side| side as isize);
        let window = |side: isize| 1 - reach * side..=reach * side;
        let is_near = |[a, b]: [isize; 2]| {
            (1 - radius * m..=radius * m).contains(&a) && (1 - radius * n..=radius * n).contains(&b)
        };
        [true, false].map(|near| {
            let places = (0..n).flat_map(|row| (0..m).map(move |column| [column, row]));
            let group = |[column, row]: [isize; 2]| {
                let samples = window(n).flat_map(|b| window(m).map(move |a| [a, b]));
                let own = samples.filter(|&[a, b]| {
                    a.rem_euclid(m) == column && b.rem_euclid(n) == row && is_near([a, b]) == near
                });
                own.collect()
            };
            places.map(group).collect()
        })
    }
}

/// The low resolution.
struct Samples {
    values: Rows,
    guides: Rows,
    grid: SampleGrid,
}

/// The normal and inverse depth of every sample.
fn guides_of_samples(guides: &Guides, grid: SampleGrid) -> Rows {
    let [columns, rows] = grid.size();
    let mut samples = Rows::new(columns, rows, 4);
    samples.rows_mut().enumerate().for_each(|(j, row)| {
        for (channel, plane) in row.chunks_exact_mut(columns).enumerate() {
            for (i, value) in plane.iter_mut().enumerate() {
                let [x, y] = grid.pixel([i, j]);
                *value =
                    guides.rows.data[(y * guides.rows.channels + channel) * guides.width() + x];
            }
        }
    });
    samples
}

/// Memory of a thread.
#[derive(Default)]
struct Scratch {
    /// The guides of the pixels of a phase, channel by channel.
    guides: Vec<f32>,
    taps: Vec<Tap>,
    /// Weighted sums of a group and of all, channel by channel.
    sums: Vec<Lanes>,
    totals: Vec<Lanes>,
}

/// A sample and what it weighs for the pixels being computed.
struct Tap {
    /// Column of the first lane, and row.
    at: [isize; 2],
    spatial: f32,
    /// The weight where no sample is of the pixel's kind: 1 where there is a near one.
    fallback: Lanes,
    exponent: Lanes,
    /// The weight without f; before [`relate`] its factor alone.
    edge: Lanes,
}

struct Row<'a> {
    upsampling: &'a Upsampling,
    samples: &'a Samples,
    guides: &'a Rows,
    near: &'a [Vec<[isize; 2]>],
    far: &'a [Vec<[isize; 2]>],
    edges: EdgeKernel,
    scratch: &'a mut Scratch,
    y: usize,
    output: &'a mut [f32],
}

impl Kernel for Row<'_> {
    #[inline(always)]
    fn run<const FMA: bool>(mut self) {
        let factor = self.upsampling.factor;
        let width = self.guides.width;
        for phase in 0..factor.min(width) {
            let count = (width - phase).div_ceil(factor);
            self.gather_guides(phase, count);
            for start in chunks::<LANES>(count) {
                let guides = |channel| {
                    let row = &self.scratch.guides[channel * count..][..count];
                    load(row, start as isize, 0.0)
                };
                let here = Here::of([0, 1, 2, 3, 4, 5].map(guides));
                self.scratch.taps.clear();
                self.weigh(&here, phase, start, None);
                let unlike = unlikeness(&self.scratch.taps);
                let is_far = unlike.iter().any(|&unlike| unlike > 0.0);
                if is_far {
                    self.weigh(&here, phase, start, Some(unlike));
                }
                relate(&mut self.scratch.taps);
                self.sum(is_far);
                let pixels = LANES.min(count - start);
                let channels = self.scratch.totals.len();
                for (channel, total) in self.scratch.totals.iter().enumerate() {
                    for (lane, value) in total[..pixels].iter().enumerate() {
                        let x = (start + lane) * factor + phase;
                        self.output[x * channels + channel] = *value;
                    }
                }
            }
        }
    }
}

impl Row<'_> {
    fn gather_guides(&mut self, phase: usize, count: usize) {
        let guides = &mut self.scratch.guides;
        guides.clear();
        for channel in 0..self.guides.channels {
            let start = (self.y * self.guides.channels + channel) * self.guides.width;
            let row = &self.guides.data[start..start + self.guides.width];
            guides.extend(
                row[phase..]
                    .iter()
                    .step_by(self.upsampling.factor)
                    .take(count),
            );
        }
    }

    /// Finds the near samples around the pixels from number `start` of a phase on, and how alike they are; or the
    /// far ones, that count as much as is said.
    #[inline(always)]
    fn weigh(&mut self, here: &Here, phase: usize, start: usize, far: Option<Lanes>) {
        let around = self.upsampling.around;
        let (samples, sigma) = match far {
            None => (self.near, around.sigma),
            Some(_) => (self.far, 0.5 * around.reach as f32),
        };
        let factor = self.upsampling.factor as isize;
        let offset = self.samples.grid.offset().map(|side| side as isize);
        let place = [phase as isize, self.y as isize];
        let near = [0, 1].map(|axis| (place[axis] - offset[axis]).div_euclid(factor));
        let spacing = self.upsampling.tile;
        let spacing = spacing.map(|side| sigma * (side * self.upsampling.factor) as f32);
        for [a, b] in samples.iter().flatten() {
            let steps = [near[0] + a, near[1] + b];
            let [dx, dy] =
                [0, 1].map(|axis| (steps[axis] * factor + offset[axis] - place[axis]) as f32);
            let (u, v) = (dx / spacing[0], dy / spacing[1]);
            let at = [start as isize + steps[0], steps[1]];
            let mut tap = Tap {
                at,
                spatial: exp(-0.5 * (u * u + v * v)),
                fallback: [0.0; LANES],
                exponent: [0.0; LANES],
                edge: [0.0; LANES],
            };
            if let Some(there) = There::load(&self.samples.guides, at[0], at[1]) {
                (tap.exponent, tap.edge) = self.edges.parts(&here.likeness(&there, dx, dy));
                match far {
                    None => tap.fallback = there.inside(),
                    Some(share) => {
                        for (edge, share) in tap.edge.iter_mut().zip(share) {
                            *edge *= share;
                        }
                    }
                }
            }
            self.scratch.taps.push(tap);
        }
    }

    /// Weighted means of the groups, and of them the mean.
    #[inline(always)]
    fn sum(&mut self, is_far: bool) {
        let Scratch {
            taps, sums, totals, ..
        } = &mut *self.scratch;
        let channels = self.samples.values.channels;
        totals.clear();
        totals.resize(channels, [0.0; LANES]);
        let mut norm = [0.0; LANES];
        let (near, far) = taps.split_at(self.near.iter().map(Vec::len).sum());
        let (mut near, mut far) = (near.iter(), far.iter());
        for (near_group, far_group) in self.near.iter().zip(self.far) {
            sums.clear();
            sums.resize(channels, [0.0; LANES]);
            let (mut weight, mut best) = ([0.0; LANES], [0.0_f32; LANES]);
            let near = near.by_ref().take(near_group.len());
            let far = far.by_ref().take(if is_far { far_group.len() } else { 0 });
            for tap in near.chain(far) {
                let mut weights = [0.0; LANES];
                for lane in 0..LANES {
                    weights[lane] = tap.spatial * tap.edge[lane];
                    weight[lane] += weights[lane];
                    best[lane] = best[lane].max(tap.edge[lane]);
                }
                for (channel, sums) in sums.iter_mut().enumerate() {
                    let Some(row) = self.samples.values.row(tap.at[1], channel) else {
                        continue;
                    };
                    let values = load(row, tap.at[0], 0.0);
                    for lane in 0..LANES {
                        sums[lane] += weights[lane] * values[lane];
                    }
                }
            }
            for lane in 0..LANES {
                let found = weight[lane] > 0.0;
                weight[lane] = if found {
                    best[lane] / weight[lane]
                } else {
                    0.0
                };
                norm[lane] += if found { best[lane] } else { 0.0 };
            }
            for (totals, sums) in totals.iter_mut().zip(sums.iter()) {
                for lane in 0..LANES {
                    totals[lane] += weight[lane] * sums[lane];
                }
            }
        }
        for totals in totals {
            for lane in 0..LANES {
                totals[lane] /= norm[lane];
            }
        }
    }
}

/// How much far samples count: not at all if a near one weighs 1/e or more, fully if none weighs e⁻⁴.
#[inline(always)]
fn unlikeness(taps: &[Tap]) -> Lanes {
    best_exponents(taps).map(|best| ((-1.0 - best) / 3.0).clamp(0.0, 1.0))
}

/// Of the samples of a pixel's kind; −∞ where there is none.
#[inline(always)]
fn best_exponents(taps: &[Tap]) -> Lanes {
    let mut best = [f32::NEG_INFINITY; LANES];
    for tap in taps {
        for (lane, best) in best.iter_mut().enumerate() {
            let candidate = if tap.edge[lane] > 0.0 {
                tap.exponent[lane]
            } else {
                f32::NEG_INFINITY
            };
            *best = best.max(candidate);
        }
    }
    best
}

/// Scales the weights of each pixel so that the best exponent becomes 0: where all samples are unlike the pixel,
/// the least unlike counts. Where none is of its kind, all count alike.
#[inline(always)]
fn relate(taps: &mut [Tap]) {
    let best = best_exponents(taps);
    for tap in taps {
        for (lane, &best) in best.iter().enumerate() {
            let found = best > f32::NEG_INFINITY;
            // Samples that do not count may be above the best.
            let exponent = (tap.exponent[lane] - best).min(0.0);
            let weight = tap.edge[lane] * exp(exponent);
            tap.edge[lane] = if found { weight } else { tap.fallback[lane] };
        }
    }
}
