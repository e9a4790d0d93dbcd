//! Separable Gaussian blur, plain or stopped at edges.
//!
//! 1. Plain, [`Gaussian::apply`]: each block of rows is blurred down the columns into a few rows of scratch memory
//!    that stay in the first cache, and along the rows from there into the output.
//! 2. Stopped at edges, [`Gaussian::apply_guided`]: two passes of [`stencil`](crate::stencil).

use rayon::prelude::*;

use crate::{
    EdgeStop, Guides, ImageView, Result,
    error::require,
    guides::EdgeKernel,
    image::{Rows, check_length},
    lanes::{self, Kernel, LANES, chunks, multiply_add},
    stencil::{self, Tap},
};

/// Widest kernel.
const MAX_WIDTH: usize = 1023;
/// Rows of the output that are computed together, so that an input row is loaded once for all of them.
const BLOCK: usize = 4;
/// Numbers of a row that are summed together.
const WIDE: usize = 4 * LANES;
/// Rows a task takes at a time.
const ROWS_PER_TASK: usize = 4 * BLOCK;

/// A Gaussian of odd width w = 2r + 1 pixels and standard deviation σ: the two-pass filter of NSS10 §5 (11×11 in §7).
///
/// ```text
/// O(x) = Σₖ g(k) I(x + k) / Σₖ g(k), k = −r … r, g(k) = e^(−k²/2σ²)
/// ```
///
/// down the columns and then along the rows. Taps outside the picture are left out of both sums.
///
/// Cost per pixel and channel: 2w multiply-adds; one read and one write of memory for both passes together. Stopped
/// at edges: 2w weights of about 25 operations per pixel, and 2w multiply-adds per channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussian {
    /// g(−r) … g(r), normalised.
    pub(crate) weights: Vec<f32>,
}

impl Default for Gaussian {
    /// NSS10's width of 11. The paper gives no σ; 2 pixels leave the outermost tap 4 % of the middle's weight.
    fn default() -> Self {
        Self {
            weights: weights(11, 2.0),
        }
    }
}

impl Gaussian {
    /// A Gaussian of an odd `width` from 1 to 1023 pixels and standard deviation `sigma`, in pixels, from 0.1 to 1000.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when a parameter is out of its range.
    pub fn new(width: usize, sigma: f32) -> Result<Self> {
        require(
            width % 2 == 1 && width <= MAX_WIDTH,
            "the Gaussian's width",
            width,
            "it must be odd and 1 to 1023 pixels",
        )?;
        require(
            (0.1..=1000.0).contains(&sigma),
            "the Gaussian's σ",
            sigma,
            "it must be 0.1 to 1000 pixels",
        )?;
        Ok(Self {
            weights: weights(width, sigma),
        })
    }

    /// Blurs an image into `output`, of the same size and channels.
    ///
    /// # Errors
    /// [`Error::Length`](crate::Error::Length) when `output` is not as long as the image.
    pub fn apply(&self, image: ImageView<'_>, output: &mut [f32]) -> Result<()> {
        check_length("the output", output, image.size())?;
        self.blur(image, output, |blur| lanes::run(blur));
        Ok(())
    }

    fn blur(&self, image: ImageView<'_>, output: &mut [f32], run: impl Fn(Blur<'_>) + Sync) {
        let length = image.width() * image.channels();
        let columns = self.inside(image.height());
        let rows = self.inside(image.width());
        // Zeros on both sides of the weights, so that all rows of a block take the same steps.
        let mut padded = vec![0.0; self.weights.len() + 2 * (BLOCK - 1)];
        padded[BLOCK - 1..][..self.weights.len()].copy_from_slice(&self.weights);
        let scratch_row = length + (self.weights.len() - 1) * image.channels();
        output
            .par_chunks_mut(ROWS_PER_TASK * length)
            .enumerate()
            .for_each_init(
                || vec![0.0; BLOCK * scratch_row],
                |scratch, (task, output)| {
                    run(Blur {
                        weights: &self.weights,
                        padded: &padded,
                        image,
                        columns: &columns,
                        rows: &rows,
                        scratch,
                        first: task * ROWS_PER_TASK,
                        output,
                    });
                },
            );
    }

    /// Blurs an image, each tap weighted with w(p, q) of an [`EdgeStop`], into `output`, of the same size and
    /// channels.
    ///
    /// The weights make the two passes an approximation: the second pass mixes pixels that the first has mixed
    /// with the weights of their own columns, so around a corner light may take a way that the direct weight
    /// forbids. On one smooth surface it is the plain blur.
    ///
    /// # Errors
    /// [`Error::Length`](crate::Error::Length) and [`Error::Size`](crate::Error::Size) when the images do not fit
    /// together.
    pub fn apply_guided(
        &self,
        image: ImageView<'_>,
        guides: &Guides,
        edges: &EdgeStop,
        output: &mut [f32],
    ) -> Result<()> {
        check_length("the output", output, image.size())?;
        guides.expect_size("the image", image)?;
        let edges = EdgeKernel::from(*edges);
        let taps = |direction: [isize; 2]| {
            let radius = (self.weights.len() / 2) as isize;
            let tap = |(index, &weight)| {
                let [dx, dy] = direction.map(|step| step * (index as isize - radius));
                Tap { dx, dy, weight }
            };
            self.weights.iter().enumerate().map(tap).collect::<Vec<_>>()
        };
        let source = Rows::of(image);
        let mut half = Rows::new(source.width, source.height, source.channels);
        stencil::run(&source, guides, &taps([0, 1]), edges, &mut half);
        let mut whole = source;
        stencil::run(&half, guides, &taps([1, 0]), edges, &mut whole);
        whole.interleave(output);
        Ok(())
    }

    /// One over the sum of the weights that lie inside, for every position on a side of the picture.
    fn inside(&self, side: usize) -> Vec<f32> {
        let radius = self.weights.len() / 2;
        let sum = |at: usize| -> f64 {
            let first = radius.saturating_sub(at);
            let last = (radius + side - at).min(self.weights.len());
            let inside = self.weights[first..last].iter();
            inside.map(|&weight| f64::from(weight)).sum()
        };
        (0..side).map(|at| (1.0 / sum(at)) as f32).collect()
    }
}

fn weights(width: usize, sigma: f32) -> Vec<f32> {
    let weight = |k: usize| {
        let distance = (k as f64 - (width / 2) as f64) / f64::from(sigma);
        (-0.5 * distance * distance).exp()
    };
    let sum: f64 = (0..width).map(weight).sum();
    (0..width).map(|k| (weight(k) / sum) as f32).collect()
}

/// Blurs some rows of an image.
struct Blur<'a> {
    weights: &'a [f32],
    /// The weights with `BLOCK − 1` zeros on both sides.
    padded: &'a [f32],
    image: ImageView<'a>,
    /// What to scale every row and every column with, as [`Gaussian::inside`] says.
    columns: &'a [f32],
    rows: &'a [f32],
    /// `BLOCK` rows with r pixels of zeros on both sides.
    scratch: &'a mut [f32],
    /// The first row of the output.
    first: usize,
    output: &'a mut [f32],
}

impl Kernel for Blur<'_> {
    #[inline(always)]
    fn run<const FMA: bool>(mut self) {
        if self.image.width() * self.image.channels() >= WIDE {
            self.blur::<FMA, LANES, WIDE>();
        } else {
            self.blur::<FMA, 1, 1>();
        }
    }
}

impl Blur<'_> {
    /// Takes `COLUMN` numbers at a time down the columns and `ROW` along the rows, none wider than a row.
    #[inline(always)]
    fn blur<const FMA: bool, const COLUMN: usize, const ROW: usize>(&mut self) {
        let [width, _, channels] = self.image.size();
        let radius = self.weights.len() / 2;
        let scratch_row = self.scratch.len() / BLOCK;
        let mut weights = self.weights.to_vec();
        for (block, output) in self.output.chunks_mut(BLOCK * width * channels).enumerate() {
            let first = self.first + block * BLOCK;
            let scratch = self.scratch.chunks_exact_mut(scratch_row);
            let scratch = scratch.map(|row| &mut row[radius * channels..][..width * channels]);
            blur_columns::<FMA, COLUMN>(self.padded, self.image, first, scratch);
            let scratch = self.scratch.chunks_exact(scratch_row);
            for (row, (output, scratch)) in output
                .chunks_exact_mut(width * channels)
                .zip(scratch)
                .enumerate()
            {
                for (weight, plain) in weights.iter_mut().zip(self.weights) {
                    *weight = plain * self.columns[first + row];
                }
                blur_row::<FMA, ROW>(&weights, scratch, channels, output);
                scale_ends(self.rows, radius, channels, output);
            }
        }
    }
}

/// Blurs `BLOCK` rows from `first` on down the columns. Rows below the picture get something that nobody reads.
#[inline(always)]
fn blur_columns<'a, const FMA: bool, const N: usize>(
    padded: &[f32],
    image: ImageView<'_>,
    first: usize,
    mut output: impl Iterator<Item = &'a mut [f32]>,
) {
    let length = image.width() * image.channels();
    let radius = (padded.len() - 2 * (BLOCK - 1)) / 2;
    let top = first.saturating_sub(radius);
    let bottom = (first + BLOCK + radius).min(image.height());
    let rows = &image.data()[top * length..bottom * length];
    // Of every window of weights the last is that for the block's first row.
    let weights = &padded[top + radius - first..];
    let mut output: [&mut [f32]; BLOCK] =
        std::array::from_fn(|_| output.next().unwrap_or_default());
    for start in chunks::<N>(length) {
        let mut sums = [[0.0; N]; BLOCK];
        for (row, weights) in rows.chunks_exact(length).zip(weights.windows(BLOCK)) {
            let values = &row[start..start + N];
            for (sums, weight) in sums.iter_mut().zip(weights.iter().rev()) {
                for (sum, value) in sums.iter_mut().zip(values) {
                    *sum = multiply_add::<FMA>(*weight, *value, *sum);
                }
            }
        }
        for (output, sums) in output.iter_mut().zip(&sums) {
            output[start..start + N].copy_from_slice(sums);
        }
    }
}

/// Blurs a row of scratch memory into a row of the output.
#[inline(always)]
fn blur_row<const FMA: bool, const N: usize>(
    weights: &[f32],
    scratch: &[f32],
    channels: usize,
    output: &mut [f32],
) {
    for start in chunks::<N>(output.len()) {
        let mut sums = [0.0; N];
        let neighbours = scratch[start..].windows(N).step_by(channels);
        for (values, weight) in neighbours.zip(weights) {
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum = multiply_add::<FMA>(*weight, *value, *sum);
            }
        }
        output[start..start + N].copy_from_slice(&sums);
    }
}

/// Makes up for the taps that lie outside at the ends of a row.
fn scale_ends(scales: &[f32], radius: usize, channels: usize, output: &mut [f32]) {
    let width = scales.len();
    let right = width.saturating_sub(radius).max(radius);
    for x in (0..radius.min(width)).chain(right..width) {
        for value in &mut output[x * channels..][..channels] {
            *value *= scales[x];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_processors_agree() {
        let image: Vec<f32> = (0..100 * 40).map(|i| (i * i % 97) as f32 / 97.0).collect();
        let view = ImageView::new(&image, 100, 40, 1).unwrap();
        let (mut best, mut plain) = (vec![0.0; image.len()], vec![0.0; image.len()]);
        Gaussian::default().apply(view, &mut best).unwrap();
        Gaussian::default().blur(view, &mut plain, |blur| blur.run::<false>());
        for (best, plain) in best.iter().zip(plain) {
            assert!((best - plain).abs() <= 4e-7, "{best} {plain}");
        }
    }
}
