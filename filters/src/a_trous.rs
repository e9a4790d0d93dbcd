//! The edge-avoiding à-trous wavelet: a wide blur in a few levels of few taps.

use crate::{
    EdgeStop, Guides, ImageView, Result,
    error::require,
    guides::{EdgeKernel, Likeness},
    image::{Rows, check_length},
    lanes::{LANES, Lanes, exp, load},
    stencil::{self, Tap, Weigh},
};

/// Most levels: the last one's taps lie 2 · 2⁹ pixels away.
const MAX_LEVELS: usize = 10;
/// The cubic B-spline at the integers.
const B3: [f32; 5] = [1.0 / 16.0, 0.25, 0.375, 0.25, 1.0 / 16.0];

/// The edge-avoiding à-trous wavelet transform of Dammertz, Sewtz, Hanika and Lensch 2010, as a smoothing filter.
///
/// ```text
/// c₀ = I
/// cᵢ₊₁(p) = Σ_q h(q − p) w(p, q) r(p, q) cᵢ(q) / Σ_q h(q − p) w(p, q) r(p, q), i = 0 … levels − 1
/// r(p, q) = e^(−‖cᵢ(p) − cᵢ(q)‖² / σᵢ²), σᵢ = 2⁻ⁱ σ
/// ```
///
/// over the 5×5 taps of the cubic B-spline h (1/16, 1/4, 3/8, 1/4, 1/16) that lie 2ⁱ pixels apart: the blur reaches
/// 2 · (2^levels − 1) pixels. w is the weight of an [`EdgeStop`]; where the paper compares positions, it compares the
/// depth with the tangent plane. r compares the values themselves (`w_rt` in the paper). Taps outside the picture are
/// left out.
///
/// Cost per pixel and level: 25 weights of about 30 operations, and 25 times 3 operations per channel.
#[derive(Clone, Debug, PartialEq)]
pub struct ATrous {
    pub(crate) levels: usize,
    sigma: f32,
    pub(crate) edges: EdgeStop,
}

impl ATrous {
    /// A filter of 1 to 10 `levels`. `sigma`, σ above, is in the unit of the image and positive; infinite to blur
    /// whatever the values are.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when a parameter is out of its range.
    pub fn new(levels: usize, sigma: f32, edges: EdgeStop) -> Result<Self> {
        require(
            (1..=MAX_LEVELS).contains(&levels),
            "the number of levels",
            levels,
            "it must be 1 to 10",
        )?;
        require(
            sigma >= 1e-12,
            "the à-trous filter's σ",
            sigma,
            "it must be at least 10⁻¹²; infinity ignores values",
        )?;
        Ok(Self {
            levels,
            sigma,
            edges,
        })
    }

    /// Filters an image into `output`, of the same size and channels.
    ///
    /// # Errors
    /// [`Error::Length`](crate::Error::Length) and [`Error::Size`](crate::Error::Size) when the images do not fit
    /// together.
    pub fn apply(&self, image: ImageView<'_>, guides: &Guides, output: &mut [f32]) -> Result<()> {
        check_length("the output", output, image.size())?;
        guides.expect_size("the image", image)?;
        let mut source = Rows::of(image);
        let mut target = Rows::new(source.width, source.height, source.channels);
        for level in 0..self.levels {
            let alike = Alike {
                edges: EdgeKernel::from(self.edges),
                per_square: self.per_square(level),
            };
            stencil::run(&source, guides, &taps(1 << level), alike, &mut target);
            std::mem::swap(&mut source, &mut target);
        }
        source.interleave(output);
        Ok(())
    }

    /// 1 / σᵢ².
    pub(crate) fn per_square(&self, level: usize) -> f32 {
        let sigma = self.sigma / (1_u32 << level) as f32;
        1.0 / (sigma * sigma)
    }
}

/// h, with `spacing` pixels between its taps.
fn taps(spacing: isize) -> Vec<Tap> {
    let axis = || {
        let steps = (-2..=2).map(move |step| step * spacing);
        steps.zip(B3)
    };
    axis()
        .flat_map(|(dy, row)| {
            axis().map(move |(dx, column)| Tap {
                dx,
                dy,
                weight: row * column,
            })
        })
        .collect()
}

/// w · r.
struct Alike {
    edges: EdgeKernel,
    per_square: f32,
}

impl Weigh for Alike {
    #[inline(always)]
    fn weights(
        &self,
        likeness: &Likeness,
        source: &Rows,
        here: [isize; 2],
        there: [isize; 2],
    ) -> Lanes {
        let mut squares = [0.0; LANES];
        for channel in 0..source.channels {
            let (Some(a), Some(b)) = (source.row(here[1], channel), source.row(there[1], channel))
            else {
                continue;
            };
            let (a, b) = (load(a, here[0], 0.0), load(b, there[0], 0.0));
            for lane in 0..LANES {
                squares[lane] += (a[lane] - b[lane]) * (a[lane] - b[lane]);
            }
        }
        let (exponent, factor) = self.edges.parts(likeness);
        let mut weights = [0.0; LANES];
        for lane in 0..LANES {
            // Bounded, so that it is 0 and not NaN times an infinite σ.
            let values = self.per_square * squares[lane].min(1e36);
            weights[lane] = factor[lane] * exp(exponent[lane] - values);
        }
        weights
    }
}
