//! The maps in words of four, as `shaders/maps.wesl` reads them.

use crate::{
    Coverage, LdiParams,
    cpu::maps::{LANES, Layers, Maps},
};

pub(super) type Words = [u32; 4];

/// `WIDE_LAYERS` and `TRIANGLES_THAT_TOUCH` of the shader.
const WIDE_LAYERS: u32 = 1;
const TRIANGLES_THAT_TOUCH: u32 = 2;
/// Words before the frames.
const HEADER: usize = 2;

/// Header, frames, pixels and layers.
pub(super) fn words(params: &LdiParams, maps: &Maps) -> Vec<Words> {
    let pixels_at = HEADER + 2 * maps.frames.len();
    let layers_at = pixels_at + maps.pixels.len().div_ceil(2);
    let mut flags = 0;
    if matches!(maps.layers, Layers::Wide(_)) {
        flags |= WIDE_LAYERS;
    }
    if params.coverage == Coverage::Touched {
        flags |= TRIANGLES_THAT_TOUCH;
    }
    let mut words = vec![
        [
            params.cells,
            maps.resolution,
            pixels_at as u32,
            layers_at as u32,
        ],
        [
            maps.layers.depth_steps(),
            flags,
            params.epsilon.to_bits(),
            maps.footprint().to_bits(),
        ],
    ];
    for frame in &maps.frames {
        words.extend_from_slice(bytemuck::cast_slice::<_, Words>(&[bytemuck::cast::<
            _,
            [u32; 8],
        >(*frame)]));
    }
    words.extend(packed(bytemuck::cast_slice(&maps.pixels)));
    words.extend(match &maps.layers {
        Layers::Narrow(layers) => packed(bytemuck::cast_slice(layers)),
        Layers::Wide(layers) => packed(bytemuck::cast_slice(layers)),
    });
    words
}

/// Four to a word, the last filled up with zeros.
fn packed(values: &[u32]) -> Vec<Words> {
    let (whole, rest) = values.as_chunks::<4>();
    let mut words = whole.to_vec();
    if !rest.is_empty() {
        let mut last = [0; 4];
        last[..rest.len()].copy_from_slice(rest);
        words.push(last);
    }
    words
}

/// Three words for each lane of each block: corners, and instance, primitive and whether it is masked. A fourth is the
/// plane where the maps have them.
pub(super) fn faces(maps: &Maps) -> Vec<Words> {
    let mut planes = maps.planes.iter();
    let mut words = Vec::with_capacity(3 * LANES * maps.blocks.len() + maps.planes.len());
    for (block, surfaces) in maps.blocks.iter().zip(&maps.surfaces) {
        for lane in 0..LANES {
            let surface = surfaces.surface(lane);
            let extras = [
                surface.instance,
                surface.primitive,
                surfaces.masked >> lane & 1,
            ];
            for (corner, extra) in block.corners(lane).into_iter().zip(extras) {
                let [x, y, z] = corner.to_array().map(f32::to_bits);
                words.push([x, y, z, extra]);
            }
            words.extend(planes.next().map(|plane| plane.map(f32::to_bits)));
        }
    }
    words
}
