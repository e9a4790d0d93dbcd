//! Stage 4, a layered depth map: every surface along each pixel's line, sorted (§3).
//!
//! Fragments are drawn and counted by pixel, the counts are summed up (the prefix sum), the fragments filled into their
//! pixels, and those sorted. Where it is enough to know the first and the last layer, [`Extents`] keeps nothing else.

use super::{
    lanes::vectorised,
    raster::{Span, Target, draw},
    triangles::Triangles,
    view::View,
};

/// The layers of one direction.
pub(crate) struct Map {
    pub(crate) view: View,
    /// Where each pixel's layers begin, and their end.
    pub(crate) firsts: Vec<u32>,
    /// Depths, metres, ascending within a pixel.
    pub(crate) depths: Vec<f32>,
}

/// Memory that is used again for every map.
#[derive(Default)]
pub(crate) struct Scratch {
    fragments: Fragments,
}

/// What has been drawn so far, in the order of drawing.
#[derive(Default)]
struct Fragments {
    pixels: Vec<u32>,
    depths: Vec<f32>,
    counts: Vec<u32>,
}

impl Target for Fragments {
    #[inline(always)]
    fn cover(&mut self, span: &Span) {
        for pixel in 0..span.count {
            let index = span.first + pixel;
            self.pixels.push(index as u32);
            self.depths.push(span.at(pixel));
            self.counts[index] += 1;
        }
    }
}

impl Map {
    /// Draws, counts, sums up, fills and sorts.
    pub(crate) fn build(triangles: &Triangles<'_>, view: View, scratch: &mut Scratch) -> Self {
        let fragments = &mut scratch.fragments;
        fragments.pixels.clear();
        fragments.depths.clear();
        fragments.counts.clear();
        fragments.counts.resize(view.pixels(), 0);
        vectorised(|| draw(triangles, &view, fragments));
        let mut map = Self::filled(view, fragments);
        map.sort();
        map
    }

    /// The prefix sum, and the fragments in their pixels.
    fn filled(view: View, fragments: &mut Fragments) -> Self {
        let mut firsts = Vec::with_capacity(view.pixels() + 1);
        let mut sum = 0;
        for count in &mut fragments.counts {
            firsts.push(sum);
            // From here on where the pixel's next fragment goes.
            sum += std::mem::replace(count, sum);
        }
        firsts.push(sum);
        let mut depths = vec![0.0; fragments.depths.len()];
        for (&pixel, &depth) in fragments.pixels.iter().zip(&fragments.depths) {
            let next = &mut fragments.counts[pixel as usize];
            depths[*next as usize] = depth;
            *next += 1;
        }
        Self {
            view,
            firsts,
            depths,
        }
    }

    fn sort(&mut self) {
        for ends in self.firsts.windows(2) {
            let layers = &mut self.depths[ends[0] as usize..ends[1] as usize];
            if layers.len() > 24 {
                layers.sort_unstable_by(f32::total_cmp);
                continue;
            }
            for end in 1..layers.len() {
                let depth = layers[end];
                let mut at = end;
                while at > 0 && layers[at - 1] > depth {
                    layers[at] = layers[at - 1];
                    at -= 1;
                }
                layers[at] = depth;
            }
        }
    }

    /// The layers of a pixel.
    #[inline(always)]
    pub(crate) fn layers(&self, pixel: usize) -> &[f32] {
        &self.depths[self.firsts[pixel] as usize..self.firsts[pixel + 1] as usize]
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.firsts[..]) + size_of_val(&self.depths[..])
    }
}

/// The first and the last layer of each pixel.
pub(crate) struct Extents {
    pub(crate) view: View,
    /// Depths, metres; infinite where there is no layer.
    pub(crate) lows: Vec<f32>,
    /// −infinite where there is no layer.
    pub(crate) highs: Vec<f32>,
}

impl Target for Extents {
    #[inline(always)]
    fn cover(&mut self, span: &Span) {
        let pixels = span.first..span.first + span.count;
        let both = self.lows[pixels.clone()]
            .iter_mut()
            .zip(&mut self.highs[pixels]);
        for (pixel, (low, high)) in both.enumerate() {
            let depth = span.at(pixel);
            *low = low.min(depth);
            *high = high.max(depth);
        }
    }
}

impl Extents {
    pub(crate) fn build(triangles: &Triangles<'_>, view: View) -> Self {
        let mut extents = Self {
            view,
            lows: vec![f32::INFINITY; view.pixels()],
            highs: vec![f32::NEG_INFINITY; view.pixels()],
        };
        vectorised(|| draw(triangles, &view, &mut extents));
        extents
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.lows[..]) + size_of_val(&self.highs[..])
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{Affine3A, Quat, Vec3};
    use isophote_scene::{Instance, Material, Mesh, Scene, Selection, builtin};

    use super::*;
    use crate::{Directions, cpu::view::longest_axis};

    /// A closed surface is entered as often as it is left: no centre falls through an edge, none is counted twice.
    #[test]
    fn closed_surfaces_have_even_layers() {
        let corners: Vec<Vec3> = (0..8)
            .map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32))
            .collect();
        let quads = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let mesh = Mesh {
            normals: vec![Vec3::Y; 8],
            positions: corners,
            triangles: quads
                .iter()
                .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
                .collect(),
            triangle_materials: vec![0; 12],
            ..Mesh::default()
        };
        let cube = |index: u32| {
            let turn = Quat::from_euler(
                glam::EulerRot::XYZ,
                index as f32,
                2.0 * index as f32,
                0.3 * index as f32,
            );
            let place = Vec3::new((index % 5) as f32, (index / 5) as f32, 0.37 * index as f32);
            Instance::new(
                0,
                Affine3A::from_scale_rotation_translation(Vec3::splat(0.7), turn, place),
            )
        };
        let scene = Scene {
            meshes: vec![Arc::new(mesh)],
            materials: vec![Material::default()],
            instances: (0..40).map(cube).collect(),
            ..Scene::default()
        };
        let triangles =
            Triangles::new(&scene, &scene.transforms(), &Selection::default()).expect("triangles");
        let mut layers = 0;
        for &direction in Directions::new(40).vectors() {
            let view = View::fit(
                direction,
                &[triangles.bounds],
                longest_axis(&triangles.bounds),
                90,
            );
            let map = Map::build(&triangles, view, &mut Scratch::default());
            for pixel in 0..view.pixels() {
                assert_eq!(map.layers(pixel).len() % 2, 0, "{direction} {pixel}");
            }
            layers += map.depths.len();
        }
        assert!(layers > 40 * 1000, "{layers}");
    }

    /// Layers are sorted, the extents are their ends, and their number is what the projected area says.
    #[test]
    fn maps_hold_all_surfaces() {
        let scene = builtin::build("office").expect("a scene");
        let triangles =
            Triangles::new(&scene, &scene.transforms(), &Selection::default()).expect("triangles");
        for &direction in Directions::new(5).vectors() {
            let view = View::fit(direction, &[triangles.bounds], Vec3::X, 300);
            let map = Map::build(&triangles, view, &mut Scratch::default());
            let extents = Extents::build(&triangles, view);
            for pixel in 0..view.pixels() {
                let layers = map.layers(pixel);
                assert!(layers.is_sorted());
                let ends = [
                    layers.first().copied().unwrap_or(f32::INFINITY),
                    layers.last().copied().unwrap_or(f32::NEG_INFINITY),
                ];
                assert_eq!(ends, [extents.lows[pixel], extents.highs[pixel]]);
            }
            let mut area = 0.0;
            for instance in &scene.instances {
                let mesh = scene.mesh(instance);
                for primitive in 0..mesh.triangles.len() {
                    let [a, b, c] = mesh
                        .corners(primitive)
                        .map(|p| instance.transform.transform_point3(p));
                    area += 0.5 * (b - a).cross(c - a).dot(direction).abs();
                }
            }
            let found = map.depths.len() as f32 * view.pixel * view.pixel;
            assert!(
                (found / area - 1.0).abs() < 0.02,
                "{direction}: {found} of {area} m²"
            );
        }
    }
}
