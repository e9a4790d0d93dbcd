//! The maps in words of four, as `shaders/maps.wesl` reads them.

use crate::{
    Coverage, LdiParams,
    cpu::maps::{Block, BlockSurfaces, Frame, LANES, Layers, Maps, PADDING, Packing},
};

pub(super) type Words = [u32; 4];

/// `WIDE_LAYERS` and `TRIANGLES_THAT_TOUCH` of the shader.
const WIDE_LAYERS: u32 = 1;
const TRIANGLES_THAT_TOUCH: u32 = 2;
/// Words before the frames.
const HEADER: usize = 2;

/// What the shader knows of all maps.
pub(super) struct Head<'a> {
    pub(super) params: &'a LdiParams,
    pub(super) resolution: u32,
    pub(super) frames: &'a [Frame],
    pub(super) packing: Packing,
}

/// Whether layers take two words of 32 bits: one of both depths, in 16 bits each, and before it one of the target.
/// Else near depth, far depth and target share one, from the highest bit down.
pub(super) fn is_wide(packing: Packing) -> bool {
    packing.bytes() > 4
}

impl Head<'_> {
    pub(super) fn frame_words(&self) -> Vec<Words> {
        bytemuck::cast_slice::<Frame, [u32; 4]>(self.frames).to_vec()
    }

    /// Header and frames; so many pixels follow, and then the layers.
    pub(super) fn words(&self, pixels: u64) -> Vec<Words> {
        let pixels_at = HEADER + 2 * self.frames.len();
        let layers_at = pixels_at + (pixels + 1).div_ceil(2) as usize;
        let mut flags = 0;
        if is_wide(self.packing) {
            flags |= WIDE_LAYERS;
        }
        if self.params.coverage == Coverage::Touched {
            flags |= TRIANGLES_THAT_TOUCH;
        }
        let mut words = vec![
            [
                self.params.cells,
                self.resolution,
                pixels_at as u32,
                layers_at as u32,
            ],
            [
                self.packing.depth_steps(),
                flags,
                self.params.epsilon.to_bits(),
                self.packing.depth_bits(),
            ],
        ];
        words.extend(self.frame_words());
        words
    }
}

/// Header, frames, pixels and layers.
pub(super) fn words(params: &LdiParams, maps: &Maps) -> Vec<Words> {
    let head = Head {
        params,
        resolution: maps.resolution,
        frames: &maps.frames,
        packing: maps.layers.packing(),
    };
    let mut words = head.words(maps.pixels.len() as u64 - 1);
    words.extend(packed(bytemuck::cast_slice(&maps.pixels)));
    words.extend(packed(&layer_words(&maps.layers)));
    words
}

/// Layers as the shader reads them, and unused ones behind.
fn layer_words(layers: &Layers) -> Vec<u32> {
    let packing = layers.packing();
    let bits = packing.depth_bits();
    let mut words = Vec::with_capacity(2 * (layers.count() + PADDING));
    for layer in layers.iter() {
        if is_wide(packing) {
            words.extend([layer.target, layer.near << 16 | layer.far]);
        } else {
            words.push(layer.near << (32 - bits) | layer.far << (32 - 2 * bits) | layer.target);
        }
    }
    words.resize(words.len() + PADDING, 0);
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
pub(super) fn faces(
    blocks: &[Block],
    surfaces: &[BlockSurfaces],
    planes: &[[f32; 4]],
) -> Vec<Words> {
    let mut words = Vec::with_capacity(3 * LANES * blocks.len() + planes.len());
    let mut planes = planes.iter();
    for (block, surfaces) in blocks.iter().zip(surfaces) {
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
