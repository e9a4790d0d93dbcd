//! Joint bilateral upsampling: a coarse picture at the full resolution of its guides.

use crate::{
    EdgeStop, Guides, ImageView, Result,
    error::require,
    image::check_length,
    upsample::{Upsampling, check_factor},
};

/// Joint bilateral upsampling of a picture that was computed at every s-th pixel ([`SampleGrid`](crate::SampleGrid)).
#[derive(Clone, Debug, PartialEq)]
pub struct JointBilateral {
    upsampling: Upsampling,
}

/// What weighs the samples around a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighborhood {
    /// Samples on each side of a pixel, 1 to 4: 1 takes 2×2 samples, 2 takes 4×4.
    pub radius: usize,
    /// Standard deviation of the spatial Gaussian f, 0.5 to 10, in distances between samples.
    pub sigma: f32,
}

impl Default for Neighborhood {
    fn default() -> Self {
        Self {
            radius: 3,
            sigma: 0.7,
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
                radius: neighborhood.radius,
                sigma: neighborhood.sigma,
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
