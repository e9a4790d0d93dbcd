//! The right answer, refined pass by pass.

use glam::Vec3;

use super::{flags::Values, studio::next_id};

/// Passes come in pairs of equal samples: one for each half.
const MOST_SAMPLES_OF_A_PASS: u32 = 16;
/// Where refinement ends: samples a pixel, and the noise that nobody sees.
const ENOUGH_SAMPLES: u32 = 1 << 16;
const ENOUGH: f32 = 5e-4;

/// Sums over passes, in two independent halves that tell the noise.
pub(super) struct Sums {
    /// What it is of.
    key: Values,
    size: [u32; 2],
    halves: [Vec<Vec3>; 2],
    samples: [u32; 2],
    passes: u32,
    noise: f32,
    seconds: f64,
}

/// The right answer as far as it is known.
pub(super) struct Truth {
    pub(super) id: u64,
    pub(super) key: Values,
    pub(super) size: [u32; 2],
    pub(super) values: Vec<Vec3>,
    /// A pixel.
    pub(super) samples: u32,
    /// relRMSE; NaN as long as it is not known.
    pub(super) noise: f32,
    pub(super) seconds: f64,
    /// By how much it is smaller than asked for.
    pub(super) divisor: u32,
}

impl Sums {
    pub(super) fn new(key: Values, size: [u32; 2]) -> Self {
        let pixels = size[0] as usize * size[1] as usize;
        Self {
            key,
            size,
            halves: [vec![Vec3::ZERO; pixels], vec![Vec3::ZERO; pixels]],
            samples: [0; 2],
            passes: 0,
            noise: f32::NAN,
            seconds: 0.0,
        }
    }

    pub(super) fn key(&self) -> &Values {
        &self.key
    }

    pub(super) fn is_of(&self, key: &Values, size: [u32; 2]) -> bool {
        self.key == *key && self.size == size
    }

    pub(super) fn is_enough(&self) -> bool {
        self.samples.iter().sum::<u32>() >= ENOUGH_SAMPLES || self.noise < ENOUGH
    }

    /// The samples of the next pass: 1, 1, 2, 2, 4, 4, … so that there is soon something to see.
    pub(super) fn next_samples(&self) -> u32 {
        MOST_SAMPLES_OF_A_PASS.min(1 << (self.passes / 2).min(16))
    }

    /// The number of the next pass, which chooses its random numbers.
    pub(super) fn pass(&self) -> u32 {
        self.passes
    }

    /// Adds the means of a pass's samples.
    pub(super) fn add(&mut self, values: &[Vec3], samples: u32, seconds: f64) {
        let half = (self.passes % 2) as usize;
        for (sum, value) in self.halves[half].iter_mut().zip(values) {
            *sum += samples as f32 * *value;
        }
        self.samples[half] += samples;
        self.passes += 1;
        self.seconds += seconds;
        if self.samples[0] == self.samples[1] {
            self.noise = noise(&self.halves);
        }
    }

    pub(super) fn truth(&self, divisor: u32) -> Truth {
        let samples: u32 = self.samples.iter().sum();
        let scale = 1.0 / samples.max(1) as f32;
        let pairs = self.halves[0].iter().zip(&self.halves[1]);
        Truth {
            id: next_id(),
            key: self.key.clone(),
            size: self.size,
            values: pairs.map(|(a, b)| scale * (*a + *b)).collect(),
            samples,
            noise: self.noise,
            seconds: self.seconds,
            divisor,
        }
    }
}

/// relRMSE of the mean of two independent halves: half of their RMS difference over the mean.
fn noise([a, b]: &[Vec<Vec3>; 2]) -> f32 {
    let (mut squares, mut sum) = (0.0_f64, 0.0_f64);
    for (a, b) in a.iter().zip(b) {
        squares += f64::from((*a - *b).length_squared());
        sum += f64::from((*a + *b).element_sum());
    }
    // Both are of sums rather than of means, which cancels out.
    let count = 3.0 * a.len() as f64;
    ((squares / count).sqrt() / (sum / count)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_are_averaged_by_their_samples() {
        let mut sums = Sums::new(Values::new(), [2, 1]);
        let passes = [1.0, 3.0, 2.0, 2.0_f32];
        for value in passes {
            let samples = sums.next_samples();
            sums.add(&[Vec3::splat(value); 2], samples, 1.0);
        }
        // 1·1 + 1·3 + 2·2 + 2·2 over 6.
        let truth = sums.truth(1);
        assert!((truth.values[1].x - 2.0).abs() < 1e-6);
        assert_eq!((truth.samples, truth.seconds), (6, 4.0));
        // The halves are (1 + 4) / 3 and (3 + 4) / 3: half of their difference is 1/3, over a mean of 2.
        assert!((truth.noise - 1.0 / 6.0).abs() < 1e-6, "{}", truth.noise);
        assert!(!sums.is_enough());
    }

    #[test]
    fn equal_halves_are_enough() {
        let mut sums = Sums::new(Values::new(), [1, 1]);
        for _ in 0..2 {
            assert!(!sums.is_enough());
            sums.add(&[Vec3::ONE], 1, 0.0);
        }
        assert!(sums.is_enough());
    }
}
