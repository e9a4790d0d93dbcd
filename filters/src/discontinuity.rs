//! The discontinuity buffer: joins the tiles of interleaved sampling where depth and normal agree.

use crate::{
    Guides, ImageView, Result,
    error::require,
    guides::Likeness,
    image::{Rows, check_length},
    lanes::{LANES, Lanes},
    stencil::{self, Tap, Weigh},
};

/// Widest tile.
const MAX_TILE: usize = 32;

/// The discontinuity buffer of MS10 §4.3 (Wald et al. 2002, Keller and Heidrich 2001).
///
/// In interleaved sampling each pixel of a tile of m×n pixels computes another part of the light, and the mean of the
/// tile is all of it. Every pixel takes the mean over the window of m×n pixels around it, in which each part occurs
/// once, of those pixels whose surface continues its own:
///
/// ```text
/// O(p) = Σ_q V(p, q) I(q) / Σ_q V(p, q)
/// V(p, q) = 1 if θ ≤ θ₀ and |z⁻¹(q) − ẑ⁻¹(p, q)| ≤ d · z⁻¹(p), else 0
/// ```
///
/// with θ the angle between the normals and ẑ⁻¹ the inverse depth of p's tangent plane (see [`Guides`]; the paper
/// compares the depths themselves, which breaks up surfaces seen at a grazing angle). Pixels outside the picture do
/// not count. Odd windows lie around p, even ones reach one pixel further to the left and up.
///
/// Cost per pixel: m·n comparisons of about 20 operations, and m·n additions per channel. The paper's tile is 3×3.
#[derive(Clone, Debug, PartialEq)]
pub struct DiscontinuityBuffer {
    pub(crate) tile: [usize; 2],
    pub(crate) thresholds: Thresholds,
}

/// Up to where two pixels show one surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    /// Largest angle between the normals in radians, 0 to π.
    pub angle: f32,
    /// Largest distance from the tangent plane relative to the depth: 0 or more; infinite to ignore depths.
    pub depth: f32,
}

impl Default for Thresholds {
    /// 25° and 3 %.
    fn default() -> Self {
        Self {
            angle: 25_f32.to_radians(),
            depth: 0.03,
        }
    }
}

impl Thresholds {
    pub(crate) fn check(&self) -> Result<()> {
        require(
            (0.0..=std::f32::consts::PI).contains(&self.angle),
            "the threshold for the angle between normals",
            self.angle,
            "it must be 0 to π radians",
        )?;
        require(
            self.depth >= 0.0,
            "the threshold for the relative difference of depths",
            self.depth,
            "it must be 0 or more; infinity ignores depths",
        )
    }

    /// The smallest cosine; a little less than that of the angle, so that rounding does not part equal normals.
    pub(crate) fn cosine(&self) -> f32 {
        self.angle.cos() - 1e-6
    }
}

impl DiscontinuityBuffer {
    /// Joins tiles of `[m, n]` pixels, each 1 to 32.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when a parameter is out of its range.
    pub fn new(tile: [usize; 2], thresholds: Thresholds) -> Result<Self> {
        check_tile(tile)?;
        thresholds.check()?;
        Ok(Self { tile, thresholds })
    }

    /// Filters an image into `output`, of the same size and channels.
    ///
    /// # Errors
    /// [`Error::Length`](crate::Error::Length) and [`Error::Size`](crate::Error::Size) when the images do not fit
    /// together.
    pub fn apply(&self, image: ImageView<'_>, guides: &Guides, output: &mut [f32]) -> Result<()> {
        check_length("the output", output, image.size())?;
        guides.expect_size("the image", image)?;
        let window = |side: usize| (0..side).map(move |k| k as isize - (side / 2) as isize);
        let [m, n] = self.tile;
        let taps: Vec<_> = window(n)
            .flat_map(|dy| {
                window(m).map(move |dx| Tap {
                    dx,
                    dy,
                    weight: 1.0,
                })
            })
            .collect();
        let source = Rows::of(image);
        let mut target = Rows::new(source.width, source.height, source.channels);
        let continues = Continues {
            cosine: self.thresholds.cosine(),
            depth: self.thresholds.depth,
        };
        stencil::run(&source, guides, &taps, continues, &mut target);
        target.interleave(output);
        Ok(())
    }
}

pub(crate) fn check_tile(tile: [usize; 2]) -> Result<()> {
    tile.into_iter().try_for_each(|side| {
        require(
            (1..=MAX_TILE).contains(&side),
            "a side of the tile",
            side,
            "it must be 1 to 32",
        )
    })
}

/// V(p, q).
struct Continues {
    cosine: f32,
    depth: f32,
}

impl Weigh for Continues {
    #[inline(always)]
    fn weights(&self, likeness: &Likeness, _: &Rows, _: [isize; 2], _: [isize; 2]) -> Lanes {
        let mut weights = [0.0; LANES];
        for (lane, weight) in weights.iter_mut().enumerate() {
            let holds = likeness.same_kind[lane]
                & (likeness.cosine[lane] >= self.cosine)
                & (likeness.distance[lane] <= self.depth);
            *weight = if holds { 1.0 } else { 0.0 };
        }
        weights
    }
}
