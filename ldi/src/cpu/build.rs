//! Stage 2, building the maps (§3.1): triangles are grouped, projected along every direction, and the layers of each
//! pixel packed.
//!
//! For every map: all fragments are found, counted by pixel, the counts summed up (the prefix sum), the fragments
//! scattered to their pixels and sorted there. The maps are independent of each other and the result does not depend
//! on the number of threads.

mod groups;
mod raster;

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{Affine3A, DVec3};
use isophote_scene::{Aabb, Scene, Selection, WorldTriangle, world_triangles};
use rayon::prelude::*;

use self::raster::{Fragment, Raster};
use super::maps::{
    Block, BlockSurfaces, Frame, LANES, Layer, Layers, Maps, PADDING, Packing, Pixel, TILE, margin,
    slabs,
};
use crate::{Coverage, Directions, Error, LdiParams, Result};

/// Bytes of a layer while maps are built, and at most after.
const LAYER_BYTES: u64 = 16;

/// Builds the maps of the selected part of a scene.
///
/// They reach as far as the selection's bounds, or as the geometry where that is smaller; a triangle that reaches out of
/// them may be met there or not.
///
/// # Errors
/// [`Error::Parameter`] for parameters out of their range, [`Error::TooLarge`] when the maps would take too much
/// memory, [`Error::Scene`] when nothing is selected.
pub fn build(
    scene: &Scene,
    transforms: &[Affine3A],
    selection: &Selection,
    params: &LdiParams,
) -> Result<Maps> {
    Plan::new(scene, transforms, selection, params)?.draw_all()
}

/// How many pairs of a triangle and a pixel the maps of a scene have: the layers that there would be if every triangle had
/// its own. For [`Coverage::Center`] these are the layers there are.
///
/// # Errors
/// As [`build`], but for the memory it would take.
pub fn pairs(
    scene: &Scene,
    transforms: &[Affine3A],
    selection: &Selection,
    params: &LdiParams,
) -> Result<u64> {
    let plan = Plan::new(scene, transforms, selection, params)?;
    let raster = plan.raster();
    let frames = plan.frames();
    let of_map = |(map, frame): (usize, &Frame)| {
        let mut count = 0;
        for index in 0..plan.blocks.len() {
            let depth = plan.directions.axis(map);
            plan.draw_block(&raster, frame, depth, index, &mut |_| count += 1);
        }
        count
    };
    Ok(frames.par_iter().enumerate().map(of_map).sum())
}

/// The box that the maps cover.
fn fit(triangles: &[WorldTriangle], selection: &Selection) -> Result<Aabb> {
    let corners = triangles.iter().flat_map(|triangle| triangle.corners);
    let geometry = Aabb::around(corners);
    let bounds = selection.bounds.map_or(geometry, |bounds| Aabb {
        min: bounds.min.max(geometry.min),
        max: bounds.max.min(geometry.max),
    });
    if geometry.is_empty() || bounds.is_empty() {
        return Err(isophote_scene::Error::NoGeometry {
            reason: "no triangle is selected".into(),
        }
        .into());
    }
    // Flat scenes get some depth.
    let least = 1e-5 * (bounds.diagonal() + bounds.largest_coordinate()).max(f32::MIN_POSITIVE);
    Ok(Aabb {
        min: bounds.min - least,
        max: bounds.max + least,
    })
}

/// Fits a map around a box, with a little room at all sides.
fn frame(directions: Directions, map: usize, bounds: &Aabb, cells: DVec3) -> Frame {
    let depth = directions.axis(map);
    let slope = directions.slope(map).to_array();
    let unscaled = Frame {
        slope,
        low: [0.0; 3],
        scale: [1.0; 3],
    };
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for corner in bounds.corners() {
        let place = unscaled.place(depth, corner);
        low = low.min(place);
        high = high.max(place);
    }
    let room = 1e-3 * (high - low);
    let size = high - low + 2.0 * room;
    Frame {
        slope,
        low: (low - room).as_vec3().to_array(),
        scale: (cells / size).as_vec3().to_array(),
    }
}

/// Lays the triangles of groups side by side.
fn pack(
    scene: &Scene,
    triangles: &[WorldTriangle],
    starts: &[usize],
) -> (Vec<Block>, Vec<BlockSurfaces>) {
    let groups = starts.windows(2).map(|ends| &triangles[ends[0]..ends[1]]);
    groups
        .map(|group| {
            let mut block = Block {
                corners: [[[f32::NAN; LANES]; 3]; 3],
            };
            let mut surfaces = BlockSurfaces {
                instances: [u32::MAX; LANES],
                primitives: [u32::MAX; LANES],
                masked: 0,
            };
            for (lane, triangle) in group.iter().enumerate() {
                for (corner, position) in triangle.corners.into_iter().enumerate() {
                    for axis in 0..3 {
                        block.corners[corner][axis][lane] = position[axis];
                    }
                }
                surfaces.instances[lane] = triangle.surface.instance;
                surfaces.primitives[lane] = triangle.surface.primitive;
                surfaces.masked |= u32::from(scene.is_masked(triangle.surface)) << lane;
            }
            (block, surfaces)
        })
        .unzip()
}

/// The plane of each lane of each block.
fn planes(blocks: &[Block]) -> Vec<[f32; 4]> {
    let plane = |block: &Block, lane| {
        let [a, b, c] = block.corners(lane);
        let normal = isophote_scene::unit_normal(a, b, c);
        normal.extend(normal.dot(a)).to_array()
    };
    let lanes = |block| (0..LANES).map(move |lane| plane(block, lane));
    blocks.iter().flat_map(lanes).collect()
}

pub(crate) fn too_large(limit: u64) -> Error {
    Error::TooLarge {
        limit,
        remedy: "take fewer directions or a lower resolution, or fit the maps to bounds",
    }
}

/// Counts the layers of all maps against the memory that is allowed.
struct Budget {
    layers: AtomicU64,
    most: u64,
    limit: u64,
}

impl Budget {
    fn new(plan: &Plan<'_>) -> Self {
        Self {
            layers: AtomicU64::new(0),
            most: plan.most_layers(),
            limit: plan.params.max_bytes,
        }
    }

    fn take(&self, layers: usize) -> Result<()> {
        let before = self.layers.fetch_add(layers as u64, Ordering::Relaxed);
        if before + layers as u64 <= self.most {
            return Ok(());
        }
        Err(too_large(self.limit))
    }
}

/// What all maps are built from.
pub(crate) struct Plan<'a> {
    pub(crate) params: &'a LdiParams,
    directions: Directions,
    pub(crate) resolution: u32,
    bounds: Aabb,
    pub(crate) blocks: Vec<Block>,
    pub(crate) surfaces: Vec<BlockSurfaces>,
    pub(crate) packing: Packing,
}

/// The layers of one map.
struct Map {
    /// Counted from the map's first layer.
    pixels: Vec<Pixel>,
    /// Packed.
    layers: Vec<u8>,
}

impl<'a> Plan<'a> {
    pub(crate) fn new(
        scene: &Scene,
        transforms: &[Affine3A],
        selection: &Selection,
        params: &'a LdiParams,
    ) -> Result<Self> {
        params.check()?;
        isophote_scene::check_transforms(scene, transforms)?;
        let mut triangles = world_triangles(scene, transforms, selection);
        let bounds = fit(&triangles, selection)?;
        let starts = groups::group(&mut triangles);
        let (blocks, surfaces) = pack(scene, &triangles, &starts);
        let targets = match params.coverage {
            Coverage::Center => blocks.len() * LANES,
            Coverage::Touched => blocks.len(),
        };
        let mut plan = Self {
            params,
            directions: Directions::new(params.cells),
            resolution: params.resolution.next_multiple_of(TILE),
            bounds,
            blocks,
            surfaces,
            packing: Packing::new(*Packing::DEPTH_BITS.start(), targets),
        };
        plan.packing = Packing::new(plan.depth_bits(), targets);
        Ok(plan)
    }

    /// How many bits depths need so that their error stays within the bound, as far as there are so many.
    fn depth_bits(&self) -> u32 {
        let frames = self.frames();
        let steps = |frame: &Frame| {
            let depth = f64::from(self.packing.depth_steps()) / f64::from(frame.scale[2]);
            let reach = 1.0 + margin(self.resolution);
            reach * depth / (f64::from(self.params.depth_error) * f64::from(frame.footprint()))
        };
        let steps = frames.iter().map(steps).fold(1.0, f64::max);
        let [least, most] =
            [Packing::DEPTH_BITS.start(), Packing::DEPTH_BITS.end()].map(|bits| *bits);
        (steps.log2().ceil() as u32).clamp(least, most)
    }

    fn raster(&self) -> Raster {
        let steps = self.packing.depth_steps();
        Raster::new(self.resolution, steps, self.params.coverage)
    }

    /// How many layers fit into the memory that is allowed.
    pub(crate) fn most_layers(&self) -> u64 {
        let pixels = size_of::<Pixel>() as u64 * self.params.pixels();
        let planes = match self.params.coverage {
            Coverage::Center => LANES * size_of::<[f32; 4]>() * self.blocks.len(),
            Coverage::Touched => 0,
        };
        let triangles = size_of_val(&self.blocks[..]) + size_of_val(&self.surfaces[..]) + planes;
        let fixed = pixels + triangles as u64;
        let rest = self.params.max_bytes.saturating_sub(fixed);
        // Offsets have 32 bits.
        (rest / LAYER_BYTES).min(u64::from(u32::MAX))
    }

    /// One for each map.
    pub(crate) fn frames(&self) -> Vec<Frame> {
        let side = f64::from(self.resolution);
        let cells = DVec3::new(side, side, f64::from(self.packing.depth_steps()));
        (0..self.directions.maps())
            .map(|map| frame(self.directions, map, &self.bounds, cells))
            .collect()
    }

    /// As [`Maps::planes`].
    pub(crate) fn planes(&self) -> Vec<[f32; 4]> {
        match self.params.coverage {
            Coverage::Center => planes(&self.blocks),
            Coverage::Touched => Vec::new(),
        }
    }

    /// Draws the maps.
    pub(crate) fn draw_all(self) -> Result<Maps> {
        let frames = self.frames();
        let budget = Budget::new(&self);
        let maps = frames
            .par_iter()
            .enumerate()
            .map(|(map, frame)| self.draw(frame, self.directions.axis(map), &budget))
            .collect::<Result<Vec<Map>>>()?;
        let size = self.packing.bytes() as usize;
        let bytes = maps.iter().map(|map| map.layers.len()).sum::<usize>();
        let mut pixels = Vec::with_capacity(self.params.pixels() as usize + 1);
        let mut layers = Vec::with_capacity(bytes + PADDING);
        for map in maps {
            // The budget has seen to it that they can be counted so.
            let before = (layers.len() / size) as u32;
            pixels.extend(map.pixels.into_iter().map(|pixel| Pixel {
                first: before + pixel.first,
                ..pixel
            }));
            layers.extend(map.layers);
        }
        pixels.push(Pixel {
            first: (bytes / size) as u32,
            slabs: 0,
        });
        layers.resize(bytes + PADDING, 0);
        Ok(Maps {
            resolution: self.resolution,
            frames,
            pixels,
            layers: Layers::from_bytes(self.packing, layers),
            planes: self.planes(),
            blocks: self.blocks,
            surfaces: self.surfaces,
        })
    }

    /// All layers of a map, by pixel and depth.
    fn draw(&self, frame: &Frame, depth: usize, budget: &Budget) -> Result<Map> {
        let raster = self.raster();
        let mut fragments = Vec::new();
        let mut taken = 0;
        for index in 0..self.blocks.len() {
            self.draw_block(&raster, frame, depth, index, &mut |fragment| {
                fragments.push(fragment);
            });
            // A triangle adds at most one fragment per pixel, so this is in time.
            budget.take(fragments.len() - taken)?;
            taken = fragments.len();
        }
        Ok(compact(&fragments, self.resolution, self.packing))
    }

    /// The fragments of a block's triangles in a map.
    fn draw_block(
        &self,
        raster: &Raster,
        frame: &Frame,
        depth: usize,
        index: usize,
        emit: &mut impl FnMut(Fragment),
    ) {
        let block = &self.blocks[index];
        for lane in 0..LANES {
            let corners = block.corners(lane);
            if corners[0].x.is_nan() {
                break;
            }
            let target = match self.params.coverage {
                Coverage::Center => index * LANES + lane,
                Coverage::Touched => index,
            };
            let places = corners.map(|corner| frame.place(depth, corner));
            raster.draw(places, target as u32, emit);
        }
    }
}

/// Count, prefix sum, scatter, then for each pixel: parts of the same target become one layer, and layers are sorted
/// by depth.
fn compact(fragments: &[Fragment], resolution: u32, packing: Packing) -> Map {
    let pixels = resolution as usize * resolution as usize;
    let mut ends = vec![0_u32; pixels + 1];
    for fragment in fragments {
        ends[fragment.pixel as usize + 1] += 1;
    }
    for pixel in 0..pixels {
        ends[pixel + 1] += ends[pixel];
    }
    let mut sorted = vec![0_u64; fragments.len()];
    let mut next = ends.clone();
    for fragment in fragments {
        let slot = &mut next[fragment.pixel as usize];
        sorted[*slot as usize] = packing.pack(Layer {
            near: fragment.near.into(),
            far: fragment.far.into(),
            target: fragment.target,
        });
        *slot += 1;
    }
    let mut kept = 0;
    let mut packed = Vec::with_capacity(pixels);
    for pixel in 0..pixels {
        let first = kept;
        let mut occupied = 0;
        let mut last: Option<Layer> = None;
        for index in ends[pixel] as usize..ends[pixel + 1] as usize {
            let mut layer = packing.unpack(sorted[index]);
            // Targets come in order, so parts of one are neighbours.
            if let Some(part) = last.filter(|last| last.target == layer.target) {
                kept -= 1;
                layer.near = layer.near.min(part.near);
                layer.far = layer.far.max(part.far);
            }
            occupied |= slabs(layer.near, layer.far, packing.depth_steps());
            sorted[kept] = packing.pack(layer);
            kept += 1;
            last = Some(layer);
        }
        // The word's order is that of near, far and target.
        sorted[first..kept].sort_unstable();
        packed.push(Pixel {
            first: first as u32,
            slabs: occupied,
        });
    }
    Map {
        pixels: packed,
        layers: Layers::pack(packing, sorted[..kept].iter().copied()),
    }
}
