//! Stage 3, tracing (§3.2): a ray walks the pixels of the map whose direction is nearest to its own, and stops at the
//! first layer it meets.
//!
//! 1. `path`: the ray's way through the map, pixel by pixel, with its depths at both ends of each.
//! 2. `kernel`: the layers of the pixel whose depths overlap those of the ray, 8 at once where the processor can.
//! 3. `meet`: where the ray meets the layer: its triangles exactly ([`Coverage::Touched`]) or its plane within the
//!    pixel ([`Coverage::Center`]).
//!
//! With [`Coverage::Touched`] no hit is lost: each triangle is in every pixel it touches, with margins wider than the
//! rounding of the walk, and the triangle test is that of the exact tracers. So the answers are theirs, bit by bit.

mod kernel;
mod meet;
mod order;
mod path;

use std::{marker::PhantomData, sync::Arc};

use glam::{Affine3A, Vec3};
use isophote_scene::{
    Answers, BuildTracer, Confident, Hit, Ray, Result, Scene, Selection, SurfaceId, Tracer,
};

use self::{
    kernel::{Kernel, Narrow, Portable, Scan, Wide},
    meet::{Found, Meet, Planes, Question, Triangles},
    order::Sorted,
    path::{Entrance, Path},
};
use super::{
    build::build,
    file::scene_key,
    maps::{Layers, Maps, Pixel, slabs},
};
use crate::{Coverage, Directions, LdiParams};

/// How much more a pixel's width beside a triangle counts than the tangent of the angle to the map.
const BESIDE: f32 = 4.0;
/// Rays between the one that is traced and the one whose answer's place is fetched.
const AHEAD: usize = 8;
/// Rays that are sorted together in a batch.
const BATCH: usize = 1 << 20;

/// Answers rays from layered depth images.
#[derive(Clone, Debug)]
pub struct LdiTracer {
    scene: Arc<Scene>,
    selection: Selection,
    /// Where the instances were when the maps were built.
    transforms: Vec<Affine3A>,
    params: LdiParams,
    directions: Directions,
    maps: Maps,
    depth_steps: u32,
    #[cfg(target_arch = "x86_64")]
    avx2: Option<kernel::Avx2>,
}

impl LdiTracer {
    pub(crate) fn from_maps(
        scene: &Arc<Scene>,
        selection: &Selection,
        params: &LdiParams,
        maps: Maps,
    ) -> Self {
        Self {
            scene: scene.clone(),
            selection: *selection,
            transforms: scene.transforms(),
            params: *params,
            directions: Directions::new(params.cells),
            depth_steps: maps.layers.packing().depth_steps(),
            maps,
            #[cfg(target_arch = "x86_64")]
            avx2: kernel::Avx2::detect(),
        }
    }

    /// The maps.
    pub fn maps(&self) -> &Maps {
        &self.maps
    }

    /// The hash of what they were built of.
    pub(crate) fn scene_key(&self) -> [u64; 2] {
        scene_key(&self.scene, &self.transforms, &self.selection)
    }

    fn confidence(&self, ray: &Ray, found: &Found) -> f32 {
        if self.params.coverage == Coverage::Touched {
            return 1.0;
        }
        // What was passed by a hair's breadth may have been hit.
        let doubt = if found.hit().is_some() {
            0.0
        } else {
            found.passed
        };
        if !ray.is_valid() {
            return 1.0;
        }
        let map = self.directions.nearest(ray.direction);
        let footprint = self.maps.frames[map].footprint();
        let cosine =
            (self.directions.direction(map).dot(ray.direction) / ray.direction.length()).abs();
        let tangent = (1.0 - cosine * cosine).max(0.0).sqrt() / cosine;
        let distance = match found.hit() {
            Some(hit) => hit.t * ray.direction.length(),
            None => footprint,
        };
        let off = footprint * (tangent + BESIDE * (found.beside + found.passed) + doubt);
        distance / (distance + off)
    }

    /// What they were built with.
    pub fn params(&self) -> &LdiParams {
        &self.params
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn selection(&self) -> &Selection {
        &self.selection
    }

    #[inline(always)]
    fn trace_with<const ANY: bool, K: Kernel>(
        &self,
        kernel: K,
        ray: &Ray,
        start: SurfaceId,
        way: &Way,
    ) -> Found {
        if self.maps.layers.packing().bytes() <= 4 {
            self.walk::<ANY, _, Narrow>(kernel, ray, start, way)
        } else {
            self.walk::<ANY, _, Wide>(kernel, ray, start, way)
        }
    }

    /// The map for a ray and its way through it.
    #[inline(always)]
    fn way(&self, ray: &Ray) -> Option<Way> {
        let map = self.directions.nearest(ray.direction);
        let path = Path::new(&self.entrance(map), ray)?;
        Some(Way { map, path })
    }

    #[inline(always)]
    fn entrance(&self, map: usize) -> Entrance<'_> {
        Entrance {
            frame: &self.maps.frames[map],
            axis: self.directions.axis(map),
            sides: [self.maps.resolution, self.depth_steps],
        }
    }

    /// Answers rays in the order of their ways, so that what they share is in the cache.
    #[inline(always)]
    fn trace_batch<const ANY: bool, K: Kernel, T>(
        &self,
        kernel: K,
        rays: &[Ray],
        answers: &mut [T],
        answer: fn(&Found) -> T,
    ) {
        let sorted = Sorted::by_map(kernel, rays, self.directions);
        for (map, range) in sorted.maps() {
            let entrance = self.entrance(map);
            for first in range.clone().step_by(4) {
                let four = &sorted.rays[first..range.end.min(first + 4)];
                let paths = match four {
                    [a, b, c, d] => kernel.paths(&entrance, [&a.ray, &b.ray, &c.ray, &d.ray]),
                    few => [0, 1, 2, 3]
                        .map(|lane| few.get(lane).and_then(|one| Path::new(&entrance, &one.ray))),
                };
                for ((lane, one), path) in four.iter().enumerate().zip(paths) {
                    // Answers lie far apart; a few rays ahead there is time to fetch their place.
                    if let Some(later) = sorted.rays.get(first + lane + AHEAD) {
                        kernel.fetch(&raw const answers[later.number as usize]);
                    }
                    let found = match path {
                        Some(path) => {
                            let way = Way { map, path };
                            self.trace_with::<ANY, K>(kernel, &one.ray, SurfaceId::UNKNOWN, &way)
                        }
                        None => Found::nothing(0.0),
                    };
                    answers[one.number as usize] = answer(&found);
                }
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
    fn trace_batch_avx2<const ANY: bool, T>(
        &self,
        avx2: kernel::Avx2,
        rays: &[Ray],
        answers: &mut [T],
        answer: fn(&Found) -> T,
    ) {
        self.trace_batch::<ANY, _, T>(avx2, rays, answers, answer);
    }

    #[inline(always)]
    fn walk<const ANY: bool, K: Kernel, L: Scan>(
        &self,
        kernel: K,
        ray: &Ray,
        start: SurfaceId,
        way: &Way,
    ) -> Found {
        let mut found = Found::nothing(ray.t_max);
        let Way { map, path } = way;
        let question = Question {
            scene: &self.scene,
            maps: &self.maps,
            ray,
            start,
        };
        let pixels = self.maps.pixels_per_map();
        let walk: Walk<'_, K, L> = Walk {
            kernel,
            how: kernel.layers(self.maps.layers.packing()),
            scan: PhantomData,
            layers: &self.maps.layers,
            depth_steps: self.depth_steps,
            pixels: &self.maps.pixels[map * pixels..=(map + 1) * pixels],
            path,
        };
        match self.params.coverage {
            Coverage::Touched => {
                walk.run::<ANY, _>(Triangles::new(kernel, &question), &mut found);
            }
            Coverage::Center => {
                let epsilon = self.params.epsilon;
                let footprint = self.maps.frames[*map].footprint();
                let planes = Planes::new(&question, path, epsilon, footprint);
                walk.run::<ANY, _>(planes, &mut found);
            }
        }
        found
    }

    #[inline]
    fn trace<const ANY: bool>(&self, ray: &Ray, start: SurfaceId) -> Found {
        let Some(way) = self.way(ray) else {
            return Found::nothing(ray.t_max);
        };
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            #[expect(unsafe_code, reason = "SIMD instructions")]
            // SAFETY: the token proves that the instructions exist.
            return unsafe { self.trace_avx2::<ANY>(avx2, ray, start, &way) };
        }
        self.trace_with::<ANY, _>(Portable, ray, start, &way)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt")]
    fn trace_avx2<const ANY: bool>(
        &self,
        avx2: kernel::Avx2,
        ray: &Ray,
        start: SurfaceId,
        way: &Way,
    ) -> Found {
        self.trace_with::<ANY, _>(avx2, ray, start, way)
    }

    fn trace_all<const ANY: bool, T>(
        &self,
        rays: &[Ray],
        answers: &mut [T],
        answer: fn(&Found) -> T,
    ) {
        assert_eq!(rays.len(), answers.len(), "one answer per ray");
        for (rays, answers) in rays.chunks(BATCH).zip(answers.chunks_mut(BATCH)) {
            #[cfg(target_arch = "x86_64")]
            if let Some(avx2) = self.avx2 {
                #[expect(unsafe_code, reason = "SIMD instructions")]
                // SAFETY: the token proves that the instructions exist.
                unsafe {
                    self.trace_batch_avx2::<ANY, T>(avx2, rays, answers, answer);
                }
                continue;
            }
            self.trace_batch::<ANY, _, T>(Portable, rays, answers, answer);
        }
    }
}

/// The map for a ray and its way through it.
#[derive(Clone, Copy, Debug)]
struct Way {
    map: usize,
    path: Path,
}

/// A ray on its way through a map.
struct Walk<'a, K: Kernel, L: Scan> {
    kernel: K,
    how: K::Layers,
    scan: PhantomData<L>,
    layers: &'a Layers,
    depth_steps: u32,
    /// Those of the map, and the next.
    pixels: &'a [Pixel],
    path: &'a Path,
}

impl<K: Kernel, L: Scan> Walk<'_, K, L> {
    #[inline(always)]
    fn run<const ANY: bool, M: Meet>(&self, mut meet: M, found: &mut Found) {
        let forward = self.path.sign > 0.0;
        let mut limit = f32::INFINITY;
        let mut depth = self.path.depth(0.0);
        let mut crossings = self.path.crossings();
        loop {
            let crossing = crossings.current();
            let before = std::mem::replace(&mut depth, self.path.depth(crossing.exit));
            let (mut low, mut high) = (before.min(depth), before.max(depth));
            let pixel = &self.pixels[crossing.pixel..crossing.pixel + 2];
            if pixel[0].slabs & slabs(low, high, self.depth_steps) == 0 {
                if crossings.step(limit) {
                    continue;
                }
                return;
            }
            let ends = [crossing.enter, crossing.exit];
            let (first, end) = (pixel[0].first as usize, pixel[1].first as usize);
            for start in (first..end).step_by(L::WIDTH) {
                let mut met = L::overlaps(self.kernel, &self.how, self.layers, start, low, high);
                if end - start < L::WIDTH {
                    met &= (1 << (end - start)) - 1;
                }
                while met != 0 {
                    let bit = if forward {
                        met.trailing_zeros()
                    } else {
                        31 - met.leading_zeros()
                    };
                    met ^= 1 << bit;
                    let layer = self.layers.get(start + bit as usize);
                    if forward && layer.near > high || !forward && layer.far < low {
                        continue;
                    }
                    if meet.layer(layer.target, ends, found) {
                        if ANY {
                            return;
                        }
                        limit = self.path.tau(found.t);
                        // A step of room for rounding.
                        let reached = self.path.depth(limit);
                        if forward {
                            high = high.min(reached + 1);
                        } else {
                            low = low.max(reached.saturating_sub(1));
                        }
                    }
                }
            }
            if !crossings.step(limit) {
                return;
            }
        }
    }
}

impl Tracer for LdiTracer {
    fn answers(&self) -> Answers {
        Answers::Surface
    }

    /// 0: a hit lies on its triangle's plane, with [`Coverage::Center`] too. What is wrong there is which triangle it is, and
    /// then t may be off by any distance; no lifting of rays helps against that, [`Confident`] does.
    fn tolerance(&self, _: Vec3) -> f32 {
        0.0
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.trace::<false>(ray, SurfaceId::UNKNOWN).hit()
    }

    fn any_hit(&self, ray: &Ray) -> bool {
        self.trace::<true>(ray, SurfaceId::UNKNOWN).hit().is_some()
    }

    fn closest_hit_from(&self, ray: &Ray, start: SurfaceId) -> Option<Hit> {
        self.trace::<false>(ray, start).hit()
    }

    fn any_hit_from(&self, ray: &Ray, start: SurfaceId) -> bool {
        self.trace::<true>(ray, start).hit().is_some()
    }

    fn closest_hits(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        self.trace_all::<false, _>(rays, hits, Found::hit);
    }

    fn any_hits(&self, rays: &[Ray], hits: &mut [bool]) {
        self.trace_all::<true, _>(rays, hits, |found| found.hit().is_some());
    }
}

impl Confident for LdiTracer {
    /// t / (t + u), u being how far the map may be off there: the footprint of a pixel times the tangent of the angle
    /// between the ray and the map's direction, and more where the hit lies beside the triangle it is taken for. 1 where
    /// layers are exact.
    fn closest_with_confidence(&self, ray: &Ray, start: SurfaceId) -> (Option<Hit>, f32) {
        let found = self.trace::<false>(ray, start);
        (found.hit(), self.confidence(ray, &found))
    }

    fn closest_all_with_confidence(&self, rays: &[Ray], answers: &mut [(Option<Hit>, f32)]) {
        assert_eq!(rays.len(), answers.len(), "one answer per ray");
        let mut all = vec![Found::nothing(0.0); rays.len()];
        self.trace_all::<false, _>(rays, &mut all, |found| *found);
        for ((ray, found), answer) in rays.iter().zip(&all).zip(answers) {
            *answer = (found.hit(), self.confidence(ray, found));
        }
    }
}

impl BuildTracer for LdiTracer {
    type Options = LdiParams;

    fn build(scene: &Arc<Scene>, selection: &Selection, params: &LdiParams) -> Result<Self> {
        let maps = build(scene, &scene.transforms(), selection, params)?;
        Ok(Self::from_maps(scene, selection, params, maps))
    }

    /// Builds the maps anew: they are for what does not move.
    fn update(&mut self, transforms: &[Affine3A]) -> Result<()> {
        self.maps = build(&self.scene, transforms, &self.selection, &self.params)?;
        self.transforms = transforms.to_vec();
        self.depth_steps = self.maps.layers.packing().depth_steps();
        Ok(())
    }

    fn bytes(&self) -> usize {
        self.maps.bytes()
    }
}
