//! Maps built on the device beside the CPU's, pixel by pixel.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};
use isophote_scene::{Aabb, Scene, Selection, builtin, gpu::Context};

use super::{BuildMethod, MapBuilder, Pipelines};
use crate::{
    Coverage, Directions, LdiParams,
    cpu::{
        build::{Plan, build},
        maps::{Block, LANES, Maps, Packing, Pixel, pixel_index, slabs},
    },
    gpu::upload::is_wide,
};

/// Near and far depth of each layer of a pixel, by what it is of.
type Depths = BTreeMap<u32, [u32; 2]>;

/// The pixels and layers of a table as the walk reads it.
struct Table {
    pixels: Vec<Pixel>,
    layers: Vec<[u32; 3]>,
    steps: u32,
}

impl Table {
    fn of_cpu(maps: &Maps) -> Self {
        let layers = maps.layers.iter();
        Self {
            pixels: maps.pixels.clone(),
            layers: layers
                .map(|layer| [layer.near, layer.far, layer.target])
                .collect(),
            steps: maps.layers.packing().depth_steps(),
        }
    }

    fn of_gpu(context: &Context, table: &wgpu::Buffer, packing: Packing, pixels: usize) -> Self {
        let words: Vec<u32> = context
            .read("maps", table, table.size() as usize / 4)
            .unwrap();
        let [pixels_at, layers_at] = [words[2], words[3]].map(|word| 4 * word as usize);
        let layers = &words[layers_at..];
        let (bits, steps) = (packing.depth_bits(), packing.depth_steps());
        Self {
            pixels: bytemuck::cast_slice(&words[pixels_at..pixels_at + 2 * (pixels + 1)]).to_vec(),
            layers: if is_wide(packing) {
                let pairs = layers.chunks_exact(2);
                pairs
                    .map(|word| [word[1] >> 16, word[1] & 0xffff, word[0]])
                    .collect()
            } else {
                let rest = 32 - 2 * bits;
                let unpack = |word: &u32| {
                    let target = word & ((1 << rest) - 1);
                    [word >> (32 - bits), word >> rest & (steps - 1), target]
                };
                layers.iter().map(unpack).collect()
            },
            steps: words[4],
        }
    }

    /// The layers of a pixel, which must be sorted and in its slabs.
    fn depths(&self, pixel: usize) -> Depths {
        let [own, next] = [self.pixels[pixel], self.pixels[pixel + 1]];
        let layers = &self.layers[own.first as usize..next.first as usize];
        assert!(layers.is_sorted(), "pixel {pixel}: {layers:?}");
        let occupied = layers.iter().fold(0, |bits, layer| {
            bits | slabs(layer[0], layer[1], self.steps)
        });
        assert_eq!(own.slabs, occupied, "pixel {pixel}");
        let depths: Depths = layers
            .iter()
            .map(|layer| (layer[2], [layer[0], layer[1]]))
            .collect();
        assert_eq!(depths.len(), layers.len(), "pixel {pixel} has layers twice");
        depths
    }
}

/// How far a pixel's centre is from the nearest edge of a triangle, pixels.
fn to_edge(corners: [DVec3; 3], center: DVec2) -> f64 {
    let distance = |index: usize| {
        let [p, q] = [corners[index], corners[(index + 1) % 3]].map(|corner| corner.truncate());
        let along = ((center - p).dot(q - p) / (q - p).length_squared()).clamp(0.0, 1.0);
        (p + along * (q - p) - center).length()
    };
    (0..3).map(distance).fold(f64::INFINITY, f64::min)
}

struct Case<'a> {
    context: &'a Context,
    scene: &'a Scene,
    selection: Selection,
    params: LdiParams,
}

impl Case<'_> {
    fn run(&self, method: BuildMethod) {
        let Self { context, scene, .. } = self;
        let transforms = scene.transforms();
        let maps = build(scene, &transforms, &self.selection, &self.params).unwrap();
        let plan = Plan::new(scene, &transforms, &self.selection, &self.params).unwrap();
        let [table, _] = MapBuilder::new(method).build(context, &plan).unwrap();
        let expected = Table::of_cpu(&maps);
        let found = Table::of_gpu(context, &table, plan.packing, maps.pixels.len() - 1);
        assert_eq!(found.steps, expected.steps);
        let (mut layers, mut others, mut off) = (0, 0, [0; 2]);
        for map in 0..maps.frames.len() {
            let first = map * maps.pixels_per_map();
            for y in 0..maps.resolution {
                for x in 0..maps.resolution {
                    let pixel = first + pixel_index(maps.resolution, x, y);
                    let [a, b] = [&expected, &found].map(|table| table.depths(pixel));
                    layers += a.len();
                    for target in a.keys().chain(b.keys().filter(|key| !a.contains_key(key))) {
                        match (a.get(target), b.get(target)) {
                            (Some(a), Some(b)) => {
                                for (off, differs) in off.iter_mut().zip(depths_differ(*a, *b)) {
                                    *off += usize::from(differs);
                                }
                            }
                            _ => {
                                let center = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                                self.check_edge(&maps, map, *target, center);
                                others += 1;
                            }
                        }
                    }
                }
            }
        }
        let end = found.pixels[maps.pixels.len() - 1].first as usize;
        println!(
            "{method:?} {:?} of {} triangles: {layers} layers, {end} on the GPU, {others} others, {off:?} of other depths",
            self.params,
            scene.triangle_count(),
        );
        assert!(layers > maps.frames.len() * maps.pixels_per_map() / 4);
        let [lost, wider] = off;
        let most = match self.params.coverage {
            // Small triangles have many edges, each of which is looked at.
            Coverage::Center => [layers / 20, layers / 1000],
            Coverage::Touched => [layers / 500, 0],
        };
        assert!(
            others <= most[0] && lost <= most[1] && wider <= layers / 500,
            "{others} others, {lost} with depths lost and {wider} wider of {layers} layers"
        );
    }

    /// A triangle may be in a pixel on one side alone where its edge passes the centre within the rasteriser's rounding, a
    /// 256th of a pixel along each axis; a group that touches, where it reaches just to the pixel's margin.
    fn check_edge(&self, maps: &Maps, map: usize, target: u32, center: DVec2) {
        if self.params.coverage == Coverage::Touched {
            return;
        }
        let depth = Directions::new(self.params.cells).axis(map);
        let (block, lane) = (target as usize / LANES, target as usize % LANES);
        let block: &Block = &maps.blocks[block];
        let places = block
            .corners(lane)
            .map(|corner| maps.frames[map].place(depth, corner));
        let distance = to_edge(places, center);
        assert!(
            distance < 1.0 / 128.0,
            "map {map}, {target} at {center}: its edge is {distance} pixels away"
        );
    }
}

/// Whether depths are lost, and whether there are more by more than a step or, where the triangle is steep, a part of the
/// range. Where a triangle is seen nearly edge-on 32 bits do not tell its plane, and all of its depths are taken.
fn depths_differ([near, far]: [u32; 2], found: [u32; 2]) -> [bool; 2] {
    let room = 1 + (far - near) / 32;
    let lost = found[0] > near || found[1] < far;
    let wider = found[0] + room < near || found[1] > far + room;
    [lost, wider]
}

#[test]
fn maps_are_the_cpus() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    let cornell = builtin::build("builtin:cornell").unwrap();
    let office = builtin::build("builtin:office").unwrap();
    // Of so many that layers are wide.
    let corner = builtin::build("builtin:corner:110").unwrap();
    let bounds = office.bounds();
    let part = Selection {
        bounds: Some(Aabb {
            min: bounds.min,
            max: bounds.center(),
        }),
        ..Selection::default()
    };
    for coverage in [Coverage::Center, Coverage::Touched] {
        // Peeling takes its time over many layers.
        for (scene, cells, resolution, selection, peeled) in [
            (&cornell, 2, 64, Selection::default(), true),
            (&office, 2, 50, Selection::default(), false),
            (&office, 1, 32, part, true),
            (
                &corner,
                1,
                64,
                Selection::default(),
                coverage == Coverage::Center,
            ),
        ] {
            let case = Case {
                context: &context,
                scene,
                selection,
                params: LdiParams {
                    cells,
                    resolution,
                    coverage,
                    ..LdiParams::default()
                },
            };
            case.run(BuildMethod::SinglePass);
            if peeled {
                case.run(BuildMethod::DepthPeeling);
            }
        }
    }
}

#[test]
fn all_pipelines_build() {
    let context = Context::noop();
    for method in [BuildMethod::SinglePass, BuildMethod::DepthPeeling] {
        for (wide, touched) in [(false, false), (false, true), (true, false), (true, true)] {
            Pipelines::new(&context, method, wide, touched).unwrap();
        }
    }
}
