//! Stage 6, after the filters: pixels on whose surface too few of the samples around them lie.
//!
//! Upsampling goes by the one that does, finds another farther away, or takes the least unlike one: thin things and the rims of surfaces then
//! have their neighbours' light, which shows as steps along silhouettes. Here they are lit themselves, by all lights.

use glam::Vec3;
use isophote_filters::SampleGrid;
use isophote_scene::{GBuffer, Pinhole, Tracer};
use rayon::prelude::*;

use super::{
    fill::is_continued,
    indirect::{Gather, Receiver, Share},
};

/// Pixels that are lit together.
const CHUNK: usize = 256;

/// Replaces the irradiance of such pixels; returns the number of rays.
pub(super) fn refine<E: Tracer + ?Sized, S: Tracer + ?Sized>(
    gather: &Gather<'_, E, S>,
    seen: &GBuffer,
    grid: SampleGrid,
    eye: &Pinhole,
    irradiance: &mut [Vec3],
) -> u64 {
    let wanted = gather.params.refinement as usize;
    let pixels = (0..irradiance.len()).into_par_iter();
    let unlike: Vec<usize> = pixels
        .filter(|&pixel| alike(seen, grid, eye, pixel) < wanted)
        .collect();
    let lit = unlike.par_chunks(CHUNK).map(|pixels| {
        let receivers: Vec<Receiver<'_>> = pixels
            .iter()
            .filter_map(|&pixel| {
                let seen = seen.pixels[pixel].as_ref()?;
                Some(Receiver {
                    point: &seen.point,
                    normal: seen.normal(),
                    parts: 1,
                    stream: pixel as u32,
                })
            })
            .collect();
        let mut light = vec![Vec3::ZERO; receivers.len()];
        let rays = gather.irradiance(&receivers, &Share::ALL, &mut light);
        (light, rays)
    });
    let (light, rays): (Vec<Vec<Vec3>>, Vec<u64>) = lit.unzip();
    for (&pixel, light) in unlike.iter().zip(light.into_iter().flatten()) {
        irradiance[pixel] = light;
    }
    rays.into_iter().sum()
}

/// How many of the four samples around a pixel lie on the surface that it shows; all where it shows none. At the picture's rim and
/// at the samples some are one.
fn alike(seen: &GBuffer, grid: SampleGrid, eye: &Pinhole, pixel: usize) -> usize {
    let Some(here) = &seen.pixels[pixel] else {
        return 4;
    };
    let width = seen.size[0] as usize;
    let [first_x, first_y] = grid.pixel([0, 0]);
    let step = grid.pixel([1, 0])[0] - first_x;
    // The samples on both sides, on one axis.
    let around = |at: usize, first: usize, count: usize| {
        let last = count - 1;
        let before = at.saturating_sub(first) / step;
        let after = before + usize::from(at > first && !(at - first).is_multiple_of(step));
        [before.min(last), after.min(last)]
    };
    let [columns, rows] = grid.size();
    let across = around(pixel % width, first_x, columns);
    let samples = around(pixel / width, first_y, rows)
        .into_iter()
        .flat_map(|j| across.map(|i| grid.pixel([i, j])));
    let alike = samples.filter(|[x, y]| {
        let there = seen.pixels[y * width + x].as_ref();
        there.is_some_and(|there| is_continued(here, there, eye))
    });
    alike.count()
}
