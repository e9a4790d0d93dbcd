//! Temporal accumulation: what earlier pictures knew, carried to where it is seen now.
//!
//! 1. [`camera_motion`] says where each pixel's surface was in the picture before, if only the camera moved.
//! 2. [`Temporal::apply`] looks there, rejects what shows something else, and blends the new picture in.
//! 3. [`History`] keeps the result for the next picture.

use rayon::prelude::*;

use crate::{
    Guides, ImageView, Pinhole, Result, Thresholds, error::require, guides::inverse_depth,
};

/// Least part of the four pixels around the place in the picture before that must show the same surface.
const LEAST_FOUND: f32 = 0.01;
/// A place that is in no picture, and a depth that no surface has.
const NOWHERE: [f32; 3] = [-1e9, -1e9, 0.0];

/// Temporal accumulation with reprojection (Nehab et al. 2007) and history rejection.
///
/// ```text
/// N(p) = min(L(p') + 1, N_max)
/// O(p) = H(p') + (I(p) − H(p')) / N(p)
/// ```
///
/// p' is the place of p's surface in the picture before, H the result there and L the number of pictures it was made
/// of, both interpolated between those of the four pixels around p' that show the same surface: both normals are
/// within the angle of [`Thresholds`], and their tangent plane passes p's former depth within its relative
/// threshold. Where those pixels have less than 1 % of the bilinear weight, or p' lies outside, the history is rejected:
/// L = 0, and the new value counts alone.
///
/// With [`clamp`](TemporalParams::clamp), H(p') is first moved into μ ± γσ of the 3×3 new pixels around p, channel by
/// channel (Salvi 2016), so that light that changed is not carried on.
///
/// Cost per pixel: 4 comparisons of about 20 operations and 10 operations per channel; 9 more reads and 30 operations
/// per channel with the clamp. A history takes 28 bytes a pixel and 4 per channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Temporal {
    pub(crate) params: TemporalParams,
}

/// What [`Temporal`] can be told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TemporalParams {
    /// `N_max`: from then on the mean becomes an exponential one, each new picture weighing 1/`N_max`. 1 to 65536.
    pub max_pictures: u32,
    /// Up to where the pixel before shows the same surface.
    pub thresholds: Thresholds,
    /// γ, how many standard deviations the history may lie from the new pixels' mean: positive; infinite for no
    /// limit.
    pub clamp: f32,
}

impl Default for TemporalParams {
    fn default() -> Self {
        Self {
            max_pictures: 32,
            thresholds: Thresholds::default(),
            clamp: f32::INFINITY,
        }
    }
}

/// The result of [`Temporal`] so far; `default()` is empty. It takes the size of the first picture that is added.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History(Option<Accumulated>);

#[derive(Clone, Debug, PartialEq)]
struct Accumulated {
    size: [usize; 3],
    values: Vec<f32>,
    /// Pictures in every pixel's value.
    lengths: Vec<f32>,
    /// What the last picture saw.
    guides: Guides,
}

impl History {
    /// The accumulated picture; `None` before the first.
    pub fn values(&self) -> Option<ImageView<'_>> {
        let past = self.0.as_ref()?;
        let [width, height, channels] = past.size;
        Some(ImageView::trusted(&past.values, width, height, channels))
    }

    /// In how many pictures each pixel's surface was seen, fractions by interpolation; at most `N_max`.
    pub fn lengths(&self) -> Option<ImageView<'_>> {
        let past = self.0.as_ref()?;
        let [width, height, _] = past.size;
        Some(ImageView::trusted(&past.lengths, width, height, 1))
    }

    /// What the last picture saw.
    pub fn guides(&self) -> Option<&Guides> {
        self.0.as_ref().map(|past| &past.guides)
    }
}

impl Temporal {
    /// A filter with parameters in their ranges.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when one is not.
    pub fn new(params: TemporalParams) -> Result<Self> {
        require(
            (1..=65_536).contains(&params.max_pictures),
            "the number of pictures in the history",
            params.max_pictures,
            "it must be 1 to 65536",
        )?;
        require(
            params.clamp > 0.0,
            "the history's clamp",
            params.clamp,
            "it must be positive; infinity switches it off",
        )?;
        params.thresholds.check()?;
        Ok(Self { params })
    }

    /// Adds a picture to the history; one of another size or number of channels starts it anew.
    ///
    /// `motion` has three channels: where the pixel's surface was in the picture before, in pixels from its top left
    /// corner (pixel centres are at one half), and its depth there, of the kind that [`Guides::new`] takes;
    /// [`camera_motion`] makes it. A place outside the picture has no history; a depth of 0, or any other that no surface
    /// has, is background. Normals must be in a space that does not move with the camera.
    ///
    /// # Errors
    /// [`Error::Size`](crate::Error::Size) when the images do not fit together.
    pub fn apply(
        &self,
        image: ImageView<'_>,
        guides: Guides,
        motion: ImageView<'_>,
        history: &mut History,
    ) -> Result<()> {
        let [width, height, channels] = image.size();
        guides.expect_size("the image", image)?;
        motion.expect_size("the motion", [width, height, 3])?;
        let past = history.0.as_ref();
        let past = past.filter(|past| past.size == image.size());
        let mut values = vec![0.0; image.data().len()];
        let mut lengths = vec![0.0; width * height];
        values
            .par_chunks_exact_mut(width * channels)
            .zip(lengths.par_chunks_exact_mut(width))
            .enumerate()
            .for_each(|(y, (values, lengths))| {
                let pixels = values.chunks_exact_mut(channels).zip(lengths).enumerate();
                for (x, (value, length)) in pixels {
                    let moved = &motion.data()[3 * (y * width + x)..][..3];
                    let before =
                        past.map_or(0.0, |past| self.before(guides.at(x, y), moved, past, value));
                    *length = self.blend(before, image, [x, y], value);
                }
            });
        history.0 = Some(Accumulated {
            size: image.size(),
            values,
            lengths,
            guides,
        });
        Ok(())
    }

    /// Interpolates the history into `value`; returns how many pictures it holds, 0 where it is rejected.
    fn before(&self, here: [f32; 6], moved: &[f32], past: &Accumulated, value: &mut [f32]) -> f32 {
        let [width, height, channels] = past.size;
        let (u, v) = (moved[0] - 0.5, moved[1] - 0.5);
        if !(u > -1.0 && v > -1.0 && u < width as f32 && v < height as f32) {
            return 0.0;
        }
        let inverse = inverse_depth(moved[2]);
        let (left, top) = (u.floor(), v.floor());
        let (mut found, mut length) = (0.0, 0.0);
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (x, y) = (left + dx, top + dy);
            if x < 0.0 || y < 0.0 || x >= width as f32 || y >= height as f32 {
                continue;
            }
            let there = past.guides.at(x as usize, y as usize);
            if !self.continues(here, inverse, there, [u - x, v - y]) {
                continue;
            }
            let weight = (1.0 - (u - x).abs()) * (1.0 - (v - y).abs());
            let pixel = y as usize * width + x as usize;
            found += weight;
            length += weight * past.lengths[pixel];
            let values = &past.values[pixel * channels..][..channels];
            for (sum, value) in value.iter_mut().zip(values) {
                *sum += weight * value;
            }
        }
        if found < LEAST_FOUND {
            return 0.0;
        }
        value.iter_mut().for_each(|value| *value /= found);
        length / found
    }

    /// Blends a new pixel into a history of `before` pictures and returns its new length.
    fn blend(
        &self,
        before: f32,
        image: ImageView<'_>,
        [x, y]: [usize; 2],
        value: &mut [f32],
    ) -> f32 {
        let new = &image.data()[(y * image.width() + x) * image.channels()..];
        if before == 0.0 {
            value.copy_from_slice(&new[..value.len()]);
            return 1.0;
        }
        let length = (before + 1.0).min(self.params.max_pictures as f32);
        for (channel, (value, &new)) in value.iter_mut().zip(new).enumerate() {
            if self.params.clamp < f32::INFINITY {
                let (low, high) = self.bounds(image, [x, y], channel);
                *value = value.max(low).min(high);
            }
            *value += (new - *value) / length;
        }
        length
    }

    /// Whether a pixel of the picture before, `offset` pixels away from the place, shows the same surface.
    fn continues(&self, here: [f32; 6], inverse: f32, there: [f32; 6], offset: [f32; 2]) -> bool {
        if inverse == 0.0 || there[3] == 0.0 || here[3] == 0.0 {
            return inverse == there[3] && here[3] == there[3];
        }
        let cosine = here[0] * there[0] + here[1] * there[1] + here[2] * there[2];
        let plane = 1.0 + there[4] * offset[0] + there[5] * offset[1];
        cosine >= self.params.thresholds.cosine()
            && (inverse / there[3] - plane).abs() <= self.params.thresholds.depth
    }

    /// μ ± γσ of the new pixels around one.
    fn bounds(&self, image: ImageView<'_>, [x, y]: [usize; 2], channel: usize) -> (f32, f32) {
        let [width, height, channels] = image.size();
        let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for y in y.saturating_sub(1)..(y + 2).min(height) {
            for x in x.saturating_sub(1)..(x + 2).min(width) {
                let value = f64::from(image.data()[(y * width + x) * channels + channel]);
                count += 1.0;
                sum += value;
                squares += value * value;
            }
        }
        let mean: f64 = sum / count;
        let deviation = (squares / count - mean * mean).max(0.0).sqrt();
        let reach = f64::from(self.params.clamp) * deviation;
        ((mean - reach) as f32, (mean + reach) as f32)
    }
}

/// Where the surfaces of a still scene were in the picture before: what [`Temporal::apply`] takes as motion.
///
/// `depths` are distances along the viewing direction of `now`, in the unit of the cameras' positions. Background is
/// taken to be infinitely far away. What was behind the camera is given a place outside.
///
/// Cost per pixel: about 40 operations.
///
/// # Errors
/// [`Error::Size`](crate::Error::Size) when `depths` has more than one channel.
pub fn camera_motion(depths: ImageView<'_>, now: &Pinhole, before: &Pinhole) -> Result<Vec<f32>> {
    let [width, height, _] = depths.size();
    depths.expect_size("the depths", [width, height, 1])?;
    let size = [width, height];
    let moved: [f32; 3] = std::array::from_fn(|axis| now.position[axis] - before.position[axis]);
    let place = |x: usize, y: usize, depth: f32| {
        let ray = now.ray([x as f32 + 0.5, y as f32 + 0.5], size);
        if inverse_depth(depth) > 0.0 {
            let point = std::array::from_fn(|axis| ray[axis] * depth + moved[axis]);
            return before.project(point, size).unwrap_or(NOWHERE);
        }
        match before.project(ray, size) {
            Some([x, y, _]) => [x, y, 0.0],
            None => NOWHERE,
        }
    };
    let mut motion = vec![0.0; 3 * width * height];
    motion
        .par_chunks_exact_mut(3 * width)
        .zip(depths.data().par_chunks_exact(width))
        .enumerate()
        .for_each(|(y, (motion, depths))| {
            for (x, (motion, &depth)) in motion.chunks_exact_mut(3).zip(depths).enumerate() {
                motion.copy_from_slice(&place(x, y, depth));
            }
        });
    Ok(motion)
}
