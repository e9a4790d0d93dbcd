//! Discontinuity buffer and joint bilateral upsampling in one pass.

use crate::{
    EdgeStop, Guides, ImageView, Neighborhood, Result,
    discontinuity::check_tile,
    upsample::{Upsampling, check_factor},
};

/// Upsampling and joining of interleaved tiles in a single pass, which MS10 §6 leaves as future work.
///
/// The picture was computed at every s-th pixel ([`SampleGrid`](crate::SampleGrid)), and of m×n neighbouring samples
/// each computed another part of the light, so that their mean is all of it. One filter after the other repeats the
/// pattern of the tiles (MS10 §5.2): near an edge some parts weigh more than others. Here every part k is upsampled
/// by itself, with normalised weights, and then the mean of the parts is taken:
///
/// ```text
/// O(p) = Σ_k c_k(p) O_k(p) / Σ_k c_k(p)
/// O_k(p) = Σ_q f(p, q) w(p, q) I(q) / Σ_q f(p, q) w(p, q), q in the samples of part k around p
/// c_k(p) = max_q w(p, q), q as before
/// ```
///
/// with w and the rest as for [`JointBilateral`](crate::JointBilateral), f and the neighbourhood as many times as wide
/// as the tile: a radius of 1 has four samples of every part. The confidence c is the same for all parts that have a sample on p's surface, so they count alike, and takes those
/// out that have none. A tile of 1×1 is joint bilateral upsampling; a factor of 1 joins tiles at full resolution.
///
/// Cost per pixel: 4r²·m·n weights of about 30 operations (r the [`Neighborhood`]'s radius) and as many
/// multiply-adds per channel; 36 for the paper's 3×3 with r = 1, where the two filters in a row take 16 + 9/s² with
/// r = 2.
#[derive(Clone, Debug, PartialEq)]
pub struct SinglePass {
    pub(crate) upsampling: Upsampling,
}

impl SinglePass {
    /// Upsampling by a `factor` of 1 to 64 of samples interleaved in tiles of `[m, n]` of them, each 1 to 32; the
    /// neighbourhood counts samples of one part.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when a parameter is out of its range.
    pub fn new(
        factor: usize,
        tile: [usize; 2],
        neighborhood: Neighborhood,
        edges: EdgeStop,
    ) -> Result<Self> {
        check_factor(factor)?;
        check_tile(tile)?;
        neighborhood.check()?;
        Ok(Self {
            upsampling: Upsampling {
                factor,
                tile,
                around: neighborhood,
                edges,
            },
        })
    }

    /// Filters the samples of a [`SampleGrid`](crate::SampleGrid) into `output`, of the size of the guides.
    ///
    /// # Errors
    /// [`Error::Length`](crate::Error::Length) and [`Error::Size`](crate::Error::Size) when the images do not fit
    /// together.
    pub fn apply(&self, samples: ImageView<'_>, guides: &Guides, output: &mut [f32]) -> Result<()> {
        self.upsampling.apply(samples, guides, output)
    }
}
