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
//! phases as the factor says, and in a phase neighbouring lanes need neighbouring samples. The few pixels of a phase
//! that need samples farther away are computed once more, together, and gather theirs.

use rayon::prelude::*;

use crate::{
    EdgeStop, Guides, ImageView, Neighborhood, Result,
    error::require,
    guides::{EdgeKernel, Here, There},
    image::{Rows, check_length},
    lanes::{self, Kernel, LANES, Lanes, chunks, exp, load, load_apart},
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
    near_steps: Vec<Step>,
    far_steps: Vec<Step>,
    taps: Vec<Tap>,
    /// Weighted sums, channel by channel.
    totals: Vec<Lanes>,
    /// The pixels of a phase that no near sample is like.
    lonely: Vec<usize>,
}

/// Pixels of a phase that are computed together.
trait Together: Copy {
    /// Their numbers in the phase.
    fn number(&self, lane: usize) -> usize;

    /// What lies so many places from each of them in a row, `outside` where that leaves it.
    fn load(&self, row: &[f32], steps: isize, outside: f32) -> Lanes;
}

/// Neighbours, by the first of them.
#[derive(Clone, Copy)]
struct Beside(usize);

/// Any.
#[derive(Clone, Copy)]
struct Apart([usize; LANES]);

impl Together for Beside {
    #[inline(always)]
    fn number(&self, lane: usize) -> usize {
        self.0 + lane
    }

    #[inline(always)]
    fn load(&self, row: &[f32], steps: isize, outside: f32) -> Lanes {
        load(row, self.0 as isize + steps, outside)
    }
}

impl Together for Apart {
    #[inline(always)]
    fn number(&self, lane: usize) -> usize {
        self.0[lane]
    }

    #[inline(always)]
    fn load(&self, row: &[f32], steps: isize, outside: f32) -> Lanes {
        load_apart(row, &self.0, steps, outside)
    }
}

/// Where a sample lies for all pixels of a phase in a row.
#[derive(Clone, Copy)]
struct Step {
    /// Columns from the number of a pixel in its phase, and row.
    at: [isize; 2],
    /// Right and down from the pixel.
    pixels: [f32; 2],
    /// f.
    spatial: f32,
}

/// A sample and what it weighs for the pixels being computed.
struct Tap {
    step: Step,
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
            let mut steps = std::mem::take(&mut self.scratch.near_steps);
            steps.clear();
            steps.extend(self.steps(phase, false));
            self.scratch.near_steps = steps;
            self.scratch.lonely.clear();
            for start in chunks::<LANES>(count) {
                let unlike = self.pixels::<false, _>(phase, count, Beside(start), LANES.min(count));
                let lonely = &mut self.scratch.lonely;
                for number in (0..LANES.min(count)).filter(|&lane| unlike[lane] > 0.0) {
                    // The last chunk begins in the one before.
                    if lonely.last().is_none_or(|&last| last < start + number) {
                        lonely.push(start + number);
                    }
                }
            }
            let lonely = std::mem::take(&mut self.scratch.lonely);
            if !lonely.is_empty() {
                let mut steps = std::mem::take(&mut self.scratch.far_steps);
                steps.clear();
                steps.extend(self.steps(phase, true));
                self.scratch.far_steps = steps;
            }
            for some in lonely.chunks(LANES) {
                let mut numbers = [some[0]; LANES];
                numbers[..some.len()].copy_from_slice(some);
                self.pixels::<true, _>(phase, count, Apart(numbers), some.len());
            }
            self.scratch.lonely = lonely;
        }
    }
}

impl Row<'_> {
    /// Computes the first `pixels` of some of the `count` pixels of a phase, by near samples alone or also by `FAR` ones.
    /// Returns how unlike them the near samples are.
    #[inline(always)]
    fn pixels<const FAR: bool, T: Together>(
        &mut self,
        phase: usize,
        count: usize,
        together: T,
        pixels: usize,
    ) -> Lanes {
        let guides = |channel| {
            let row = &self.scratch.guides[channel * count..][..count];
            together.load(row, 0, 0.0)
        };
        let here = Here::of([0, 1, 2, 3, 4, 5].map(guides));
        self.scratch.taps.clear();
        self.weigh(&here, together, None);
        let unlike = unlikeness(&self.scratch.taps);
        if FAR {
            self.weigh(&here, together, Some(unlike));
        }
        relate(&mut self.scratch.taps);
        self.sum::<FAR, T>(together);
        let channels = self.scratch.totals.len();
        for (channel, total) in self.scratch.totals.iter().enumerate() {
            for (lane, value) in total[..pixels].iter().enumerate() {
                let x = together.number(lane) * self.upsampling.factor + phase;
                self.output[x * channels + channel] = *value;
            }
        }
        unlike
    }

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

    /// How the near or the far samples lie around the pixels of a phase.
    fn steps(&self, phase: usize, is_far: bool) -> impl Iterator<Item = Step> + use<'_> {
        let around = self.upsampling.around;
        let (samples, sigma) = match is_far {
            false => (self.near, around.sigma),
            true => (self.far, 0.5 * around.reach as f32),
        };
        let factor = self.upsampling.factor as isize;
        let offset = self.samples.grid.offset().map(|side| side as isize);
        let place = [phase as isize, self.y as isize];
        let near = [0, 1].map(|axis| (place[axis] - offset[axis]).div_euclid(factor));
        let spacing = self.upsampling.tile;
        let spacing = spacing.map(|side| sigma * (side * self.upsampling.factor) as f32);
        samples.iter().flatten().map(move |[a, b]| {
            let at = [near[0] + a, near[1] + b];
            let [dx, dy] =
                [0, 1].map(|axis| (at[axis] * factor + offset[axis] - place[axis]) as f32);
            let (u, v) = (dx / spacing[0], dy / spacing[1]);
            Step {
                at,
                pixels: [dx, dy],
                spatial: exp(-0.5 * (u * u + v * v)),
            }
        })
    }

    /// Finds how alike pixels of a phase and the samples around them are; far ones count as much as is said.
    #[inline(always)]
    fn weigh(&mut self, here: &Here, together: impl Together, far: Option<Lanes>) {
        let Scratch {
            near_steps,
            far_steps,
            taps,
            ..
        } = &mut *self.scratch;
        let steps = if far.is_some() { far_steps } else { near_steps };
        for &step in &*steps {
            let mut tap = Tap {
                step,
                fallback: [0.0; LANES],
                exponent: [0.0; LANES],
                edge: [0.0; LANES],
            };
            let ([column, row], [dx, dy]) = (step.at, step.pixels);
            let load = |row: &[f32], outside| together.load(row, column, outside);
            if let Some(there) = There::load_with(&self.samples.guides, row, load) {
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
            taps.push(tap);
        }
    }

    /// Weighted means of the groups, and of them the mean.
    #[inline(always)]
    fn sum<const FAR: bool, T: Together>(&mut self, together: T) {
        let Scratch { taps, totals, .. } = &mut *self.scratch;
        totals.clear();
        totals.resize(self.samples.values.channels, [0.0; LANES]);
        let mut norm = [0.0; LANES];
        let (mut near, mut far) = taps.split_at(self.near.iter().map(Vec::len).sum());
        for (near_group, far_group) in self.near.iter().zip(self.far) {
            let (near_taps, near_rest) = near.split_at(near_group.len());
            let (far_taps, far_rest) = far.split_at(if FAR { far_group.len() } else { 0 });
            (near, far) = (near_rest, far_rest);
            let group = || near_taps.iter().chain(far_taps);
            let (mut weight, mut best) = ([0.0; LANES], [0.0_f32; LANES]);
            for tap in group() {
                for lane in 0..LANES {
                    weight[lane] += tap.step.spatial * tap.edge[lane];
                    best[lane] = best[lane].max(tap.edge[lane]);
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
            // Channel by channel, so that a sum stays in registers.
            for (channel, total) in totals.iter_mut().enumerate() {
                let mut sum = [0.0; LANES];
                for tap in group() {
                    let [column, row] = tap.step.at;
                    let Some(row) = self.samples.values.row(row, channel) else {
                        continue;
                    };
                    let values = together.load(row, column, 0.0);
                    for lane in 0..LANES {
                        sum[lane] += tap.step.spatial * tap.edge[lane] * values[lane];
                    }
                }
                for lane in 0..LANES {
                    total[lane] += weight[lane] * sum[lane];
                }
            }
        }
        for total in totals {
            for lane in 0..LANES {
                total[lane] /= norm[lane];
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
