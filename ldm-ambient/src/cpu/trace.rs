//! Stage 5, rays through maps (§3.1): find the map, find the pixel, find the depth among its layers; the next layer is the
//! first surface along the map's direction, the one before it the first along the opposite. No ray is marched.
//!
//! [`StreamedMaps`] draws a map when it is asked for and drops it; [`LdmTracer`] keeps all of them, packed.

use std::{
    f32::consts::FRAC_1_SQRT_2,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use glam::{Affine3A, Vec2, Vec3};
use isophote_scene::{
    Aabb, Answers, BuildTracer, Hit, ParallelTracer, Ray, Scene, Selection, SurfaceId, Tracer,
    check_transforms,
};
use rayon::prelude::*;

use super::{
    maps::{Map, Scratch},
    packed::PackedMap,
    triangles::Triangles,
    view::{View, longest_axis},
};
use crate::{Directions, Error, MapParams, Result};

/// Points whose box a streamed map is fitted around together.
const CLUSTER: usize = 64;

/// Answers for many points along one direction by a map that is drawn for them: only one map is in memory for each call that
/// runs.
///
/// Distances are those of parallel lines through the centres of the map's pixels, up to half a pixel's diagonal beside the
/// points; layers nearer than [`MapParams::tolerance`] are taken for the surface that a point lies on.
pub struct StreamedMaps<'a> {
    triangles: &'a Triangles<'a>,
    directions: Vec<Vec3>,
    params: MapParams,
}

impl<'a> StreamedMaps<'a> {
    /// Maps along the directions of so many.
    ///
    /// # Errors
    /// [`Error::Parameter`] for parameters out of their range.
    pub fn new(triangles: &'a Triangles<'a>, params: &MapParams) -> Result<Self> {
        params.check()?;
        Ok(Self {
            triangles,
            directions: Directions::new(params.maps).vectors().to_vec(),
            params: *params,
        })
    }
}

impl ParallelTracer for StreamedMaps<'_> {
    fn directions(&self) -> &[Vec3] {
        &self.directions
    }

    fn trace(&self, direction: usize, points: &[Vec3], distances: &mut [(f32, f32)]) {
        assert_eq!(points.len(), distances.len(), "one answer per point");
        let origin = self.triangles.origin;
        let around = |points: &[Vec3]| Aabb::around(points.iter().map(|point| *point - origin));
        let boxes: Vec<Aabb> = points.chunks(CLUSTER).map(around).collect();
        if boxes.is_empty() {
            return;
        }
        let longest = longest_axis(&self.triangles.bounds);
        let view = View::fit(
            self.directions[direction],
            origin,
            &boxes,
            longest,
            self.params.resolution,
        );
        let map = Map::build(self.triangles, view, &mut Scratch::default());
        let near = self.params.tolerance * view.pixel;
        for (&point, distances) in points.iter().zip(distances) {
            let (at, depth) = view.place(point - origin);
            let layers = view.index(at).map_or(&[][..], |pixel| map.layers(pixel));
            *distances = around_depth(layers.iter().copied(), depth, [near, near]);
        }
    }
}

/// The distances to the first layer beyond a depth and to the last before it, each at least so far.
fn around_depth(
    layers: impl DoubleEndedIterator<Item = f32> + Clone,
    depth: f32,
    [near, back]: [f32; 2],
) -> (f32, f32) {
    let ahead = layers.clone().find(|layer| *layer > depth + near);
    let behind = layers.rev().find(|layer| *layer < depth - back);
    (
        ahead.map_or(f32::INFINITY, |layer| layer - depth),
        behind.map_or(f32::INFINITY, |layer| depth - layer),
    )
}

/// A tracer of stored maps: rays are answered by the map whose direction is nearest to their own.
///
/// Along a map's direction, a ray is answered by a parallel one at most half a pixel's diagonal beside it, and its distance
/// is rounded to a 65536th of the map's depth. Any other ray is answered as if it went along the nearest direction: where it
/// ends is off by up to its length times the tangent of [`Directions::largest_angle`], so light that must be sharp is not
/// for this tracer. It knows distances but no triangles.
#[derive(Clone)]
pub struct LdmTracer {
    scene: Arc<Scene>,
    selection: Selection,
    params: MapParams,
    directions: Directions,
    maps: Vec<PackedMap>,
    origin: Vec3,
    largest_pixel: f32,
    largest_quantum: f32,
}

impl LdmTracer {
    fn draw(
        scene: &Arc<Scene>,
        transforms: &[Affine3A],
        selection: &Selection,
        params: &MapParams,
    ) -> Result<Self> {
        params.check()?;
        let triangles = Triangles::new(scene, transforms, selection)?;
        let bounds = selection.bounds.map_or(triangles.bounds, |bounds| Aabb {
            min: (bounds.min - triangles.origin).max(triangles.bounds.min),
            max: (bounds.max - triangles.origin).min(triangles.bounds.max),
        });
        let directions = Directions::new(params.maps);
        let longest = longest_axis(&bounds);
        let held = AtomicU64::new(0);
        let draw = |scratch: &mut Scratch, &direction: &Vec3| {
            let view = View::fit(
                direction,
                triangles.origin,
                &[bounds],
                longest,
                params.resolution,
            );
            let map = PackedMap::new(&Map::build(&triangles, view, scratch));
            let map = map.ok_or_else(|| {
                let expected = "pixels next to each other have more than 65535 layers: take more pixels, or stream the maps";
                Error::parameter("the resolution of the maps", params.resolution, expected)
            })?;
            let bytes = map.bytes() as u64;
            if held.fetch_add(bytes, Ordering::Relaxed) + bytes > params.max_bytes {
                let limit = params.max_bytes;
                return Err(Error::TooLarge { limit });
            }
            Ok(map)
        };
        let maps = directions
            .vectors()
            .par_iter()
            .map_init(Scratch::default, draw)
            .collect::<Result<Vec<_>>>()?;
        let largest = |of: fn(&PackedMap) -> f32| maps.iter().map(of).fold(0.0, f32::max);
        let (largest_pixel, largest_quantum) =
            (largest(|map| map.view.pixel), largest(PackedMap::quantum));
        Ok(Self {
            scene: scene.clone(),
            selection: *selection,
            params: *params,
            directions,
            origin: triangles.origin,
            maps,
            largest_pixel,
            largest_quantum,
        })
    }

    /// How many layers all maps have.
    pub fn layers(&self) -> usize {
        self.maps.iter().map(PackedMap::layer_count).sum()
    }

    /// The layers of a map as points of the world, metres (Fig. 3).
    pub fn point_cloud(&self, map: usize) -> Vec<Vec3> {
        let map = &self.maps[map];
        let (view, mut points) = (&map.view, Vec::with_capacity(map.layer_count()));
        for pixel in 0..view.pixels() {
            let place = Vec2::new((pixel % view.columns) as f32, (pixel / view.columns) as f32);
            let at = view.low + (place + 0.5) * view.pixel;
            let line = at.x * view.right + at.y * view.up + self.origin;
            points.extend(map.layers(pixel).map(|depth| line + depth * view.forward));
        }
        points
    }

    fn look_up(&self, map: &PackedMap, point: Vec3, at_least: f32) -> (f32, f32) {
        let (at, depth) = map.view.place(point - self.origin);
        let near = at_least.max(self.params.tolerance * map.view.pixel + map.quantum());
        match map.view.index(at) {
            Some(pixel) => around_depth(map.layers(pixel), depth, [near, near]),
            None => (f32::INFINITY, f32::INFINITY),
        }
    }
}

impl Tracer for LdmTracer {
    fn answers(&self) -> Answers {
        Answers::Distance
    }

    /// For rays along a map's direction; of others only what the type's documentation says is known.
    fn tolerance(&self, _: Vec3) -> f32 {
        (FRAC_1_SQRT_2 + self.params.tolerance) * self.largest_pixel + self.largest_quantum
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        if !ray.is_valid() {
            return None;
        }
        let length = ray.direction.length();
        let index = self.directions.nearest(ray.direction);
        let map = &self.maps[index];
        let (ahead, behind) = self.look_up(map, ray.origin, ray.t_min * length);
        let along = map.view.forward.dot(ray.direction) > 0.0;
        let t = if along { ahead } else { behind } / length;
        (t > ray.t_min && t < ray.t_max).then_some(Hit {
            t,
            uv: Vec2::ZERO,
            surface: SurfaceId::UNKNOWN,
        })
    }
}

impl ParallelTracer for LdmTracer {
    fn directions(&self) -> &[Vec3] {
        self.directions.vectors()
    }

    fn trace(&self, direction: usize, points: &[Vec3], distances: &mut [(f32, f32)]) {
        assert_eq!(points.len(), distances.len(), "one answer per point");
        for (&point, distances) in points.iter().zip(distances) {
            *distances = self.look_up(&self.maps[direction], point, 0.0);
        }
    }
}

impl BuildTracer for LdmTracer {
    type Options = MapParams;

    fn build(
        scene: &Arc<Scene>,
        selection: &Selection,
        options: &MapParams,
    ) -> isophote_scene::Result<Self> {
        Self::draw(scene, &scene.transforms(), selection, options).map_err(into_scene)
    }

    fn update(&mut self, transforms: &[Affine3A]) -> isophote_scene::Result<()> {
        check_transforms(&self.scene, transforms)?;
        *self = Self::draw(&self.scene, transforms, &self.selection, &self.params)
            .map_err(into_scene)?;
        Ok(())
    }

    fn bytes(&self) -> usize {
        self.maps.iter().map(PackedMap::bytes).sum()
    }
}

/// What a tracer's contract can say of an error.
fn into_scene(error: Error) -> isophote_scene::Error {
    match error {
        Error::Scene(error) => error,
        Error::Parameter {
            name,
            value,
            expected,
        } => isophote_scene::Error::Parameter {
            name,
            value,
            expected,
        },
        Error::TooLarge { limit } => isophote_scene::Error::Parameter {
            name: "the memory limit of the maps",
            value: format!("{limit} bytes"),
            expected: "they take more: take fewer maps or a lower resolution, or stream them",
        },
    }
}
