//! Panoramas as light sources.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use crate::{Error, Result};

/// An equirectangular panorama: its top row looks up (+Y), the middle of the picture looks along −Z, its right
/// quarter along +X.
///
/// Each texel is a patch of constant radiance, so that sampling by importance is exact.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    width: u32,
    height: u32,
    texels: Vec<Vec3>,
    /// Probability up to and including each row, then within each row up to and including each texel.
    row_cdf: Vec<f32>,
    texel_cdf: Vec<f32>,
}

impl EnvironmentMap {
    /// A panorama of `width` × `height` linear RGB radiances, row by row from the top.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the number of texels is not `width * height` or 0, or a value is negative or not
    /// finite.
    pub fn new(width: u32, height: u32, texels: Vec<Vec3>) -> Result<Self> {
        if texels.is_empty() || texels.len() != width as usize * height as usize {
            return Err(Error::Parameter {
                name: "the environment's size",
                value: format!("{width}x{height} with {} texels", texels.len()),
                expected: "there must be one texel per pixel, and at least one",
            });
        }
        if let Some(texel) = texels
            .iter()
            .find(|texel| !texel.is_finite() || texel.min_element() < 0.0)
        {
            return Err(Error::Parameter {
                name: "a texel of the environment",
                value: texel.to_string(),
                expected: "radiance must be finite and not negative",
            });
        }
        let (mut row_cdf, mut texel_cdf) = (Vec::new(), Vec::with_capacity(texels.len()));
        let mut total = 0.0_f64;
        for (y, row) in texels.chunks_exact(width as usize).enumerate() {
            let mut sum = 0.0_f64;
            let start = texel_cdf.len();
            for texel in row {
                sum += f64::from(texel.element_sum());
                texel_cdf.push(sum as f32);
            }
            for value in &mut texel_cdf[start..] {
                *value = if sum > 0.0 {
                    (f64::from(*value) / sum) as f32
                } else {
                    0.0
                };
            }
            total += sum * row_solid_angle(y as u32, height);
            row_cdf.push(total);
        }
        let row_cdf = row_cdf
            .iter()
            .map(|sum| {
                if total > 0.0 {
                    (sum / total) as f32
                } else {
                    0.0
                }
            })
            .collect();
        Ok(Self {
            width,
            height,
            texels,
            row_cdf,
            texel_cdf,
        })
    }

    /// Width and height in texels.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// Linear RGB radiances, row by row from the top.
    pub fn texels(&self) -> &[Vec3] {
        &self.texels
    }

    /// Of every row the probability up to and including it, the cosines of its edges, and its solid angle.
    #[cfg(feature = "gpu")]
    pub(crate) fn row_chances(&self) -> impl Iterator<Item = [f32; 4]> {
        (0..self.height).zip(&self.row_cdf).map(|(y, &sum)| {
            let [top, bottom] = [y, y + 1].map(|edge| row_cosine(edge, self.height));
            [sum, top, bottom, row_solid_angle(y, self.height) as f32]
        })
    }

    /// Of every texel the probability of those up to and including it in its row.
    #[cfg(feature = "gpu")]
    pub(crate) fn texel_chances(&self) -> &[f32] {
        &self.texel_cdf
    }

    /// Whether no light comes from it.
    pub fn is_black(&self) -> bool {
        self.row_cdf.last().is_none_or(|&sum| sum == 0.0)
    }

    /// Radiance that arrives from a unit direction.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let [x, y] = self.texel(direction);
        self.texels[y * self.width as usize + x]
    }

    /// A unit direction with a density proportional to the sum of the radiance's channels, and that density; `None` when black.
    pub fn sample(&self, u: Vec2) -> Option<(Vec3, f32)> {
        let (y, v) = pick(&self.row_cdf, u.y)?;
        let width = self.width as usize;
        let (x, s) = pick(&self.texel_cdf[y * width..][..width], u.x)?;
        let azimuth = ((x as f32 + s) / self.width as f32 - 0.5) * TAU;
        // Within a row equal steps of cosθ are equal solid angles.
        let (top, bottom) = (
            row_cosine(y as u32, self.height),
            row_cosine(y as u32 + 1, self.height),
        );
        let cosine = top + v * (bottom - top);
        let radius = (1.0 - cosine * cosine).max(0.0).sqrt();
        let direction = Vec3::new(radius * azimuth.sin(), cosine, -radius * azimuth.cos());
        Some((direction, self.texel_pdf(x, y)))
    }

    /// Density of [`sample`](Self::sample) at a unit direction.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let [x, y] = self.texel(direction);
        self.texel_pdf(x, y)
    }

    fn texel(&self, direction: Vec3) -> [usize; 2] {
        let u = 0.5 + direction.x.atan2(-direction.z) / TAU;
        let v = direction.y.clamp(-1.0, 1.0).acos() / PI;
        let index = |x: f32, size: u32| ((x * size as f32) as usize).min(size as usize - 1);
        [index(u, self.width), index(v, self.height)]
    }

    fn texel_pdf(&self, x: usize, y: usize) -> f32 {
        let row = &self.texel_cdf[y * self.width as usize..][..self.width as usize];
        let probability = step(&self.row_cdf, y) * step(row, x);
        probability * self.width as f32 / row_solid_angle(y as u32, self.height) as f32
    }
}

/// cosθ at the upper edge of a row.
fn row_cosine(y: u32, height: u32) -> f32 {
    (PI * y as f32 / height as f32).cos()
}

/// Solid angle of a whole row.
fn row_solid_angle(y: u32, height: u32) -> f64 {
    let cosine = |y: u32| (std::f64::consts::PI * f64::from(y) / f64::from(height)).cos();
    std::f64::consts::TAU * (cosine(y) - cosine(y + 1))
}

/// Probability of one entry of a cumulative table.
fn step(cdf: &[f32], index: usize) -> f32 {
    cdf[index] - if index == 0 { 0.0 } else { cdf[index - 1] }
}

/// The entry that `u` in [0, 1) falls into, and how far; `None` for a table of zeros.
fn pick(cdf: &[f32], u: f32) -> Option<(usize, f32)> {
    let last = *cdf.last()?;
    if last <= 0.0 {
        return None;
    }
    // Only an entry with a positive probability can be the first that exceeds u.
    let target = (u * last).min(last * (1.0 - f32::EPSILON));
    let index = cdf.partition_point(|&sum| sum <= target).min(cdf.len() - 1);
    let below = if index == 0 { 0.0 } else { cdf[index - 1] };
    Some((
        index,
        ((target - below) / (cdf[index] - below)).clamp(0.0, 1.0),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::Sampler;

    #[test]
    fn orientation() {
        let mut texels = vec![Vec3::ZERO; 8 * 4];
        texels[2] = Vec3::X; // top row
        texels[8 + 6] = Vec3::Y; // right quarter, upper middle
        let map = EnvironmentMap::new(8, 4, texels).expect("valid");
        assert_eq!(map.radiance(Vec3::new(1.0, 0.1, 0.0).normalize()), Vec3::Y);
        assert_eq!(
            map.radiance(Vec3::new(-0.1, 1.0, -0.05).normalize()),
            Vec3::X
        );
        assert_eq!(map.radiance(Vec3::NEG_Z), Vec3::ZERO);
    }

    #[test]
    fn sampling_integrates_the_radiance() {
        let texels = (0..32 * 16)
            .map(|i| Vec3::splat(((i * 7919) % 97) as f32 / 10.0))
            .collect();
        let map = EnvironmentMap::new(32, 16, texels).expect("valid");
        let (mut sampled, mut weighed, count) = (0.0, 0.0, 1 << 14);
        for index in 0..count {
            let sampler = Sampler::new(0, 0, index);
            let (direction, pdf) = map.sample(sampler.get_2d(0)).expect("not black");
            assert!(
                (map.pdf(direction) - pdf).abs() <= 0.02 * pdf,
                "{direction} {pdf}"
            );
            sampled += map.radiance(direction).x / pdf;
            let uniform = crate::sample::uniform_sphere(sampler.get_2d(1));
            weighed += map.radiance(uniform).x * 4.0 * PI;
        }
        let ratio: f32 = sampled / weighed;
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    }

    #[test]
    fn black_and_broken_maps() {
        let black = EnvironmentMap::new(2, 1, vec![Vec3::ZERO; 2]).expect("valid");
        assert!(black.is_black() && black.sample(Vec2::splat(0.5)).is_none());
        assert!(EnvironmentMap::new(2, 2, vec![Vec3::ONE; 3]).is_err());
        assert!(EnvironmentMap::new(1, 1, vec![Vec3::NAN]).is_err());
    }
}
