//! Stage 4, a layered depth map: every surface along each pixel's line, sorted (§3).
//!
//! Rows of pixels are drawn and their layers counted, the counts are summed up (the prefix sum), the layers filled into their
//! pixels, and those sorted ([`Map`]) or in groups ([`Quads`]). Where it is enough to know the first and the last layer, [`Extents`]
//! keeps nothing else.

use super::{
    lanes::with_registers,
    raster::{Draw, Span, Target},
    reach::{Reach, Within},
    triangles::Triangles,
    view::View,
};

/// Draws into a target.
fn draw(triangles: &Triangles<'_>, view: &View, target: &mut impl Target) {
    with_registers(Draw {
        triangles,
        view,
        target,
    });
}

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
    /// What has been drawn so far, in the order of drawing.
    spans: Vec<Span>,
    /// How many layers each pixel has; then where its next one goes.
    counts: Vec<u32>,
}

impl Target for Scratch {
    #[inline(always)]
    fn cover(&mut self, span: &Span) {
        let first = span.first as usize;
        for count in &mut self.counts[first..first + span.count as usize] {
            *count += 1;
        }
        self.spans.push(*span);
    }
}

impl Scratch {
    /// Draws and counts.
    fn draw(&mut self, triangles: &Triangles<'_>, view: &View, reach: Option<&Reach>) {
        self.spans.clear();
        self.counts.clear();
        self.counts.resize(view.pixels(), 0);
        match reach {
            Some(reach) => {
                let target = self;
                draw(triangles, view, &mut Within { reach, target });
            }
            None => draw(triangles, view, self),
        }
    }

    /// The prefix sum, in groups of so many layers, the first of which begins there: where the layers of each pixel begin, and the
    /// end, which it returns.
    fn sum_up(&mut self, group: u32, begin: u32, firsts: &mut Vec<u32>) -> usize {
        firsts.clear();
        firsts.reserve_exact(self.counts.len() + 1);
        let mut sum = begin;
        for count in &mut self.counts {
            firsts.push(sum);
            // From here on where the pixel's next layer goes.
            sum += std::mem::replace(count, sum).next_multiple_of(group);
        }
        firsts.push(sum);
        sum as usize
    }

    /// The layers in their pixels.
    fn fill(&mut self, depths: &mut [f32]) {
        for span in &self.spans {
            let first = span.first as usize;
            let nexts = &mut self.counts[first..first + span.count as usize];
            for (pixel, next) in nexts.iter_mut().enumerate() {
                depths[*next as usize] = span.at(pixel);
                *next += 1;
            }
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        self.spans.capacity() * size_of::<Span>() + self.counts.capacity() * size_of::<u32>()
    }
}

/// A map that is drawn again and again in the same memory.
pub(crate) trait Redrawn: Default + Send + Sync {
    /// Draws what is within reach of the points that will ask.
    fn redraw(
        &mut self,
        triangles: &Triangles<'_>,
        view: View,
        reach: Option<&Reach>,
        scratch: &mut Scratch,
    );

    fn bytes(&self) -> usize;
}

impl Map {
    /// Draws, counts, sums up, fills and sorts.
    pub(crate) fn build(triangles: &Triangles<'_>, view: View, scratch: &mut Scratch) -> Self {
        scratch.draw(triangles, &view, None);
        let mut firsts = Vec::with_capacity(view.pixels() + 1);
        let layers = scratch.sum_up(1, 0, &mut firsts);
        let mut depths = vec![0.0; layers];
        scratch.fill(&mut depths);
        let mut map = Self {
            view,
            firsts,
            depths,
        };
        map.sort();
        map
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
}

/// Layers in no order, in groups of four: who looks through all of them is faster without the sorting.
#[derive(Default)]
pub(crate) struct Quads {
    pub(crate) view: View,
    /// Where each pixel's layers begin, and their end.
    pub(crate) firsts: Vec<u32>,
    /// Depths, metres; infinite to the end of a group. In the first group there is nothing.
    pub(crate) depths: Vec<f32>,
}

impl Redrawn for Quads {
    fn redraw(
        &mut self,
        triangles: &Triangles<'_>,
        view: View,
        reach: Option<&Reach>,
        scratch: &mut Scratch,
    ) {
        self.view = view;
        scratch.draw(triangles, &view, reach);
        let end = scratch.sum_up(4, 4, &mut self.firsts);
        self.depths.clear();
        self.depths.reserve_exact(end);
        self.depths.resize(end, f32::INFINITY);
        scratch.fill(&mut self.depths);
    }

    fn bytes(&self) -> usize {
        (self.firsts.capacity() + self.depths.capacity()) * size_of::<f32>()
    }
}

/// The first and the last layer of each pixel.
#[derive(Default)]
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
        let first = span.first as usize;
        let pixels = first..first + span.count as usize;
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

impl Redrawn for Extents {
    /// The first and the last layer may be anywhere, so all are drawn.
    fn redraw(
        &mut self,
        triangles: &Triangles<'_>,
        view: View,
        _: Option<&Reach>,
        _: &mut Scratch,
    ) {
        self.view = view;
        for (values, none) in [
            (&mut self.lows, f32::INFINITY),
            (&mut self.highs, f32::NEG_INFINITY),
        ] {
            values.clear();
            values.resize(view.pixels(), none);
        }
        draw(triangles, &view, self);
    }

    fn bytes(&self) -> usize {
        (self.lows.capacity() + self.highs.capacity()) * size_of::<f32>()
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
                triangles.origin,
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
            let view = View::fit(
                direction,
                triangles.origin,
                &[triangles.bounds],
                Vec3::X,
                300,
            );
            let map = Map::build(&triangles, view, &mut Scratch::default());
            let mut extents = Extents::default();
            extents.redraw(&triangles, view, None, &mut Scratch::default());
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
