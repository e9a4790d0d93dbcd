//! Joint bilateral upsampling: a coarse picture at the full resolution of its guides.

use crate::{
    EdgeStop, Guides, ImageView, Result,
    error::require,
    image::check_length,
    upsample::{Upsampling, check_factor},
};

/// Joint bilateral upsampling (Kopf et al. 2007) of a picture that was computed at every s-th pixel, the samples of a
/// [`SampleGrid`](crate::SampleGrid): MS10 Eq. (2), §4.2.
///
/// ```text
/// O(p) = Σ_q f(p, q) w(p, q) I(q) / Σ_q f(p, q) w(p, q), f(p, q) = e^(−‖p − q‖² / 2σ²s²)
/// ```
///
/// over the samples q of a [`Neighborhood`], ‖p − q‖ in pixels of the full resolution, w the weight of an
/// [`EdgeStop`]. [`EdgeStop::COSINE`] is the paper's weight, in which the cosine is taken as 0 where it is negative.
/// It mixes surfaces that face alike, which shows at their edges (§5.2); weights with depths repair that.
///
/// The weights are normalised after those of a pixel were divided by the largest: where no sample is like the pixel,
/// the least unlike counts. A background pixel between surfaces takes what is near, and so does a lone surface in the
/// background. A factor of 1 copies the samples.
///
/// Cost per pixel: 4r² weights of about 30 operations (r the radius) and as many multiply-adds per channel; four
/// times the square of the reach where it is needed.
#[derive(Clone, Debug, PartialEq)]
pub struct JointBilateral {
    pub(crate) upsampling: Upsampling,
}

/// Which samples around a pixel count, and the Gaussian f that weighs them by their distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighborhood {
    /// Samples on each side of a pixel, 1 to 4: 1 takes 2×2 samples, 2 takes 4×4.
    pub radius: usize,
    /// Standard deviation of f over them, 0.5 to 10, in distances between samples.
    pub sigma: f32,
    /// Samples on each side, `radius` to 8, of a pixel whose near samples are all unlike it: as the largest of their
    /// weights w falls from e⁻¹ to e⁻⁴, those up to here come in, with a Gaussian of σ = `reach` / 2. So thin things
    /// that fall between the samples find one farther along. `radius` switches it off.
    pub reach: usize,
}

impl Default for Neighborhood {
    fn default() -> Self {
        Self {
            radius: 2,
            sigma: 0.7,
            reach: 6,
        }
    }
}

impl Neighborhood {
    pub(crate) fn check(&self) -> Result<()> {
        require(
            (1..=4).contains(&self.radius),
            "the neighbourhood's radius",
            self.radius,
            "it must be 1 to 4 samples",
        )?;
        require(
            (0.5..=10.0).contains(&self.sigma),
            "the neighbourhood's σ",
            self.sigma,
            "it must be 0.5 to 10 distances between samples",
        )?;
        require(
            (self.radius..=8).contains(&self.reach),
            "the neighbourhood's reach",
            self.reach,
            "it must be the radius or more, up to 8 samples",
        )
    }
}

impl JointBilateral {
    /// Upsampling by a `factor` of 1 to 64 in both directions.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when a parameter is out of its range.
    pub fn new(factor: usize, neighborhood: Neighborhood, edges: EdgeStop) -> Result<Self> {
        check_factor(factor)?;
        neighborhood.check()?;
        Ok(Self {
            upsampling: Upsampling {
                factor,
                tile: [1, 1],
                around: neighborhood,
                edges,
            },
        })
    }

    /// Upsamples the samples of a [`SampleGrid`](crate::SampleGrid) into `output`, of the size of the guides.
    ///
    /// # Errors
    /// [`Error::Length`](crate::Error::Length) and [`Error::Size`](crate::Error::Size) when the images do not fit
    /// together.
    pub fn apply(&self, samples: ImageView<'_>, guides: &Guides, output: &mut [f32]) -> Result<()> {
        if self.upsampling.factor > 1 {
            return self.upsampling.apply(samples, guides, output);
        }
        guides.expect_size("the image of samples", samples)?;
        check_length("the output", output, samples.size())?;
        output.copy_from_slice(samples.data());
        Ok(())
    }
}
