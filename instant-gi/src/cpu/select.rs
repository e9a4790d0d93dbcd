//! Stage 5 by some of the lights (past the paper: many-light importance): each point weighs what every light would bring it if
//! nothing were in the way, picks some in that proportion, and asks for V of those alone.
//!
//! Weighing a light takes a hundredth of what asking a ray takes. A light that is picked counts as many times more as it was
//! unlikely to be, so that nothing is lost in the mean; what is left is noise, since every point picks anew.
//!
//! Lights are picked at even steps along the sum of all weights, and lie in the order of a curve through space: so those that are
//! picked are as spread as all are.

use glam::Vec3;
use isophote_scene::{Aabb, reference::bound};

use super::{
    emission::Vpl,
    indirect::{Receiver, Share},
};

/// Numbers that say which lights are picked are random numbers of their own.
pub(crate) const SELECTION: u64 = 0x5e1ec7;

/// A light that a point has picked.
#[derive(Clone, Copy)]
pub(super) struct Pick {
    /// Numbers of light and receiver.
    pub(super) light: u32,
    pub(super) receiver: u32,
    /// What of the light's intensity arrives, if nothing is in the way; per square metre.
    pub(super) share: f32,
}

/// The lights of a part, coordinate by coordinate: what they bring to a point is calculated for several at once.
pub(super) struct Lights {
    positions: [Vec<f32>; 3],
    normals: [Vec<f32>; 3],
    /// Sums of the colours' intensities.
    powers: Vec<f32>,
}

impl Lights {
    /// Every so-manieth light, from number `part` on.
    pub(super) fn of_part(vpls: &[Vpl], part: u32, share: &Share) -> Self {
        let lights = || {
            vpls.iter()
                .skip(part as usize)
                .step_by(share.parts as usize)
        };
        let axes = [0, 1, 2];
        Self {
            positions: axes.map(|axis| lights().map(|vpl| vpl.point.position[axis]).collect()),
            normals: axes.map(|axis| lights().map(|vpl| vpl.normal[axis]).collect()),
            powers: lights().map(|vpl| vpl.intensity.element_sum()).collect(),
        }
    }

    /// What each would bring to a point: all colours together.
    fn weigh(&self, receiver: &Receiver<'_>, min_d: f32, weights: &mut Vec<f32>) {
        let count = self.powers.len();
        let [lx, ly, lz] = self.positions.each_ref().map(|axis| &axis[..count]);
        let [nx, ny, nz] = self.normals.each_ref().map(|axis| &axis[..count]);
        let (point, normal) = (receiver.point.position, receiver.normal);
        weights.clear();
        weights.extend((0..count).map(|number| {
            let (x, y, z) = (
                lx[number] - point.x,
                ly[number] - point.y,
                lz[number] - point.z,
            );
            // Cosines, times the distance.
            let at_point = normal.x * x + normal.y * y + normal.z * z;
            let at_light = -(nx[number] * x + ny[number] * y + nz[number] * z);
            let squared = x * x + y * y + z * z;
            let cosines = at_point.max(0.0) * at_light.max(0.0);
            let geometry = cosines / (squared * squared) * bound(min_d, squared.sqrt());
            let weight = self.powers[number] * geometry;
            // Neither NaN nor infinite, where both are one point.
            if weight > 0.0 && weight < f32::MAX {
                weight
            } else {
                0.0
            }
        }));
    }

    /// Tells the place of each light that a point picks, and what of its intensity arrives: `count` of them, or all that bring
    /// anything where there are no more. `offset` in [0, 1) is where the steps begin.
    pub(super) fn pick(
        &self,
        receiver: &Receiver<'_>,
        [min_d, offset]: [f32; 2],
        count: u32,
        weights: &mut Vec<f32>,
        mut each: impl FnMut(usize, f32),
    ) {
        self.weigh(receiver, min_d, weights);
        if weights.len() <= count as usize {
            let brought = weights.iter().zip(&self.powers).enumerate();
            brought
                .filter(|(_, (weight, _))| **weight > 0.0)
                .for_each(|(place, (weight, power))| each(place, weight / power));
            return;
        }
        even_steps(weights, count, offset, |place, brought| {
            each(place, brought / self.powers[place]);
        });
    }
}

/// Picks at `count` even steps along a sum of weights: tells the place of each that is picked, and what of the sum it stands for.
pub(super) fn even_steps(
    weights: &[f32],
    count: u32,
    offset: f32,
    mut each: impl FnMut(usize, f32),
) {
    let all: f64 = weights.iter().map(|&weight| f64::from(weight)).sum();
    let step = all / f64::from(count);
    if !(step > 0.0 && step.recip().is_finite()) {
        return;
    }
    let (mut sum, mut picked) = (0.0, 0.0);
    for (place, &weight) in weights.iter().enumerate() {
        sum += f64::from(weight);
        // Step k ends at k + offset.
        let ended = (sum / step - f64::from(offset)).ceil();
        if ended > picked {
            each(place, ((ended - picked) * step) as f32);
            picked = ended;
        }
    }
}

/// Sorts lights along a curve through space (Morton 1966), so that neighbours in the row are neighbours in the room.
pub(super) fn along_curve(vpls: &mut [Vpl], bounds: &Aabb) {
    vpls.sort_by_cached_key(|vpl| code(vpl.point.position, bounds));
}

/// Cells of the curve on each axis.
const CELLS: f32 = 1000.0;
/// Walls lie at even parts of a scene, where rounding would say to which cell they belong.
const SHIFT: f32 = 0.37;

/// Where a place comes along the curve, 30 bits.
fn code(position: Vec3, bounds: &Aabb) -> u32 {
    let place = ((position - bounds.min) / extent_of(bounds)).clamp(Vec3::ZERO, Vec3::ONE);
    let spread = |part: f32| {
        let cell = (part * CELLS + SHIFT) as u32;
        (0..10).fold(0, |code, bit| code | (cell >> bit & 1) << (3 * bit))
    };
    spread(place.x) | spread(place.y) << 1 | spread(place.z) << 2
}

/// The extent of a scene's bounds, metres; above 0.
pub(crate) fn extent_of(bounds: &Aabb) -> Vec3 {
    (bounds.max - bounds.min).max(Vec3::splat(1e-6))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over all offsets every weight counts as itself.
    #[test]
    fn steps_are_even() {
        let weights = [0.0, 1.0, 0.25, 0.0, 3.0, 0.75, 0.0];
        let mut sums = [0.0_f32; 7];
        let offsets = 1000;
        for number in 0..offsets {
            let offset = (number as f32 + 0.5) / offsets as f32;
            let mut all = 0.0;
            even_steps(&weights, 3, offset, |place, brought| {
                sums[place] += brought / offsets as f32;
                all += brought;
            });
            assert!((all - 5.0).abs() < 1e-4, "{offset}: {all}");
        }
        for (sum, weight) in sums.iter().zip(weights) {
            assert!((sum - weight).abs() < 0.01, "{sums:?}");
        }
        even_steps(&[0.0; 4], 3, 0.5, |_, _| panic!("there is nothing to pick"));
    }

    #[test]
    fn the_curve_goes_through_the_corners_of_its_bounds() {
        let bounds = Aabb {
            min: Vec3::splat(-1.0),
            max: Vec3::splat(3.0),
        };
        assert_eq!(code(Vec3::splat(-1.0), &bounds), 0);
        // 1000 is 1111101000 in base 2.
        assert_eq!(
            code(Vec3::splat(9.0), &bounds),
            0b111_111_111_111_111_000_111_000_000_000
        );
        assert!(
            code(Vec3::new(3.0, -1.0, -1.0), &bounds) < code(Vec3::new(-1.0, -1.0, 3.0), &bounds)
        );
    }
}
