//! Stage 1, once it is known what is seen (past the paper: many-light importance): of many virtual lights those are kept that the
//! picture's error would come from.
//!
//! A light near what is seen brings a few pixels much, and where it lies by chance shows; one far away brings all a little. So a
//! light is kept in proportion to the root of the mean square of what it would bring to points of the picture, if nothing
//! were in the way, and counts as many times more as it was unlikely to be kept. For a given number of lights that is the choice
//! of least variance; the mean in place of the root mean square is worse than no choice at all, since what stands out is the
//! square. A part is kept by power alone, so that none of the lights that points between those bring much is lost.
//!
//! Lights are kept at even steps along a curve through space, so that they stay spread.

use glam::Vec3;
use isophote_scene::{GBuffer, Seen, sample::Sampler};
use rayon::prelude::*;

use super::{
    emission::Vpl,
    indirect::{Points, Receiver},
    select::even_steps,
};
use crate::GiParams;

/// Points of the picture that are asked.
const POINTS: u32 = 4096;
/// Which part of the choice is by power alone.
const BY_POWER: f32 = 0.2;
/// The number that says where the steps begin is a random number of its own.
pub(crate) const KEPT: u64 = 0x6b65_6570;

/// Of lights in the order of the curve those that are kept, in the same order.
pub(super) fn keep(vpls: Vec<Vpl>, seen: &GBuffer, params: &GiParams) -> Vec<Vpl> {
    if vpls.len() <= params.kept as usize {
        return vpls;
    }
    let brought = brought(&vpls, seen, params);
    let powers: Vec<f32> = vpls.iter().map(|vpl| vpl.intensity.element_sum()).collect();
    let [all_brought, power] =
        [&brought, &powers].map(|all| all.iter().map(|&one| f64::from(one)).sum::<f64>());
    let shares = [
        (1.0 - BY_POWER) / all_brought.max(1e-30) as f32,
        BY_POWER / power as f32,
    ];
    let weights = brought.iter().zip(&powers);
    let weights: Vec<f32> = weights
        .map(|(brought, power)| shares[0] * brought + shares[1] * power)
        .collect();
    let offset = Sampler::new(params.seed ^ KEPT, 0, 0).get_1d(0);
    let mut kept = Vec::with_capacity(params.kept as usize);
    even_steps(&weights, params.kept, offset, |number, stands_for| {
        let vpl = vpls[number];
        kept.push(Vpl {
            intensity: vpl.intensity * (stands_for / weights[number]),
            ..vpl
        });
    });
    kept
}

/// The root of the sum of the squares of what each light brings to points of the picture, all colours together.
fn brought(vpls: &[Vpl], seen: &GBuffer, params: &GiParams) -> Vec<f32> {
    let seen: Vec<&Seen> = (0..POINTS)
        .filter_map(|number| seen.pixels[pixel(number, seen.size)].as_ref())
        .collect();
    let receivers: Vec<Receiver<'_>> = seen
        .iter()
        .map(|seen| Receiver {
            point: &seen.point,
            normal: seen.normal(),
            parts: 1,
            stream: 0,
        })
        .collect();
    let albedos: Vec<Vec3> = seen.iter().map(|seen| seen.albedo()).collect();
    let [red, green, blue] = [0, 1, 2]
        .map(|channel| -> Vec<f32> { albedos.iter().map(|albedo| albedo[channel]).collect() });
    let points = &Points::by_part(&receivers, 1)[0];
    let root = |terms: &mut Vec<f32>, vpl: &Vpl| {
        points.geometry(vpl, params.min_d, terms);
        let [r, g, b] = vpl.intensity.to_array();
        let colors = red.iter().zip(&green).zip(&blue);
        for (term, ((red, green), blue)) in terms.iter_mut().zip(colors) {
            let light = *term * (r * red + g * green + b * blue);
            // Also 0 for NaN, where both are one point.
            let square = if light > 0.0 { light * light } else { 0.0 };
            *term = if square < f32::MAX { square } else { 0.0 };
        }
        terms.iter().sum::<f32>().sqrt()
    };
    vpls.par_iter().map_init(Vec::new, root).collect()
}

/// The pixel of a point: evenly spread over the picture (Roberts 2018, R2).
fn pixel(number: u32, [width, height]: [u32; 2]) -> usize {
    // Multiples of the inverse and of the inverse square of the plastic number, as 32-bit fractions.
    let place = |ratio: u32, side: u32| ((number.wrapping_mul(ratio) >> 16) * side) >> 16;
    let [x, y] = [place(0xc13f_a9a9, width), place(0x91e1_0da5, height)];
    (y * width + x) as usize
}
