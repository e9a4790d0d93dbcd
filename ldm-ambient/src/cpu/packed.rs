//! A map that is kept: two bytes a layer, and two and a quarter a pixel.

use super::{maps::Map, view::View};

/// Pixels that share a base from which their layers are counted.
const GROUP: usize = 16;

/// As [`Map`], with depths in 65536ths of the map's own range.
#[derive(Clone)]
pub(crate) struct PackedMap {
    pub(crate) view: View,
    low: f32,
    quantum: f32,
    /// Where the layers of each group of pixels begin, and their end.
    bases: Vec<u32>,
    /// Where the layers of each pixel begin, from its group's on.
    offsets: Vec<u16>,
    depths: Vec<u16>,
}

impl PackedMap {
    /// Packs a map; `None` where a group has more layers than can be counted.
    pub(crate) fn new(map: &Map) -> Option<Self> {
        let (low, high) = map
            .depths
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &depth| {
                (low.min(depth), high.max(depth))
            });
        let quantum = ((high - low) / f32::from(u16::MAX)).max(f32::MIN_POSITIVE);
        let pixels = map.view.pixels();
        let bases: Vec<u32> = (0..pixels)
            .step_by(GROUP)
            .chain([pixels])
            .map(|pixel| map.firsts[pixel])
            .collect();
        let offset = |pixel: usize| u16::try_from(map.firsts[pixel] - bases[pixel / GROUP]).ok();
        Some(Self {
            view: map.view,
            low,
            quantum,
            offsets: (0..pixels).map(offset).collect::<Option<_>>()?,
            bases,
            depths: map
                .depths
                .iter()
                .map(|depth| ((depth - low) / quantum).round() as u16)
                .collect(),
        })
    }

    /// The depths of a pixel's layers, ascending, metres.
    pub(crate) fn layers(&self, pixel: usize) -> impl DoubleEndedIterator<Item = f32> + Clone {
        let first =
            |pixel: usize| self.bases[pixel / GROUP] as usize + usize::from(self.offsets[pixel]);
        let next = pixel + 1;
        let end = if next.is_multiple_of(GROUP) || next == self.offsets.len() {
            self.bases[next.div_ceil(GROUP)] as usize
        } else {
            first(next)
        };
        let (low, quantum) = (self.low, self.quantum);
        self.depths[first(pixel)..end]
            .iter()
            .map(move |&depth| low + f32::from(depth) * quantum)
    }

    pub(crate) fn layer_count(&self) -> usize {
        self.depths.len()
    }

    /// The step between two depths, metres.
    pub(crate) fn quantum(&self) -> f32 {
        self.quantum
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.bases[..])
            + size_of_val(&self.offsets[..])
            + size_of_val(&self.depths[..])
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use isophote_scene::{Selection, builtin};

    use super::*;
    use crate::cpu::{maps::Scratch, triangles::Triangles};

    #[test]
    fn packed_layers_are_those_of_the_map() {
        let scene = builtin::build("office").expect("a scene");
        let triangles =
            Triangles::new(&scene, &scene.transforms(), &Selection::default()).expect("triangles");
        for resolution in [1, 33, 101] {
            let view = View::fit(
                Vec3::new(0.6, 0.0, 0.8),
                triangles.origin,
                &[triangles.bounds],
                Vec3::X,
                resolution,
            );
            let map = Map::build(&triangles, view, &mut Scratch::default());
            let packed = PackedMap::new(&map).expect("few layers");
            assert_eq!(packed.layer_count(), map.depths.len());
            for pixel in 0..view.pixels() {
                let layers: Vec<f32> = packed.layers(pixel).collect();
                assert_eq!(layers.len(), map.layers(pixel).len());
                for (packed_depth, depth) in layers.iter().zip(map.layers(pixel)) {
                    assert!((packed_depth - depth).abs() <= 0.51 * packed.quantum());
                }
            }
        }
    }
}
