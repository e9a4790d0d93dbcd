//! The maps in words of four, as `shaders/maps.wesl` reads them.

use crate::{
    Coverage, LdiParams,
    cpu::maps::{Block, BlockSurfaces, Frame, LANES, Layer, Layers, Maps},
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
    /// Whether layers take two words.
    pub(super) wide: bool,
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
        if self.wide {
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
                if self.wide { u64::STEPS } else { u32::STEPS },
                flags,
                self.params.epsilon.to_bits(),
                // Unused.
                0,
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
        wide: matches!(maps.layers, Layers::Wide(_)),
    };
    let mut words = head.words(maps.pixels.len() as u64 - 1);
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
