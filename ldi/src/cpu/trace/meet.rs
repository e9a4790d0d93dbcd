//! What happens at a layer that a ray may meet: its triangles are tested, or its plane is.

use glam::{Vec2, Vec3};
use isophote_scene::{Hit, Ray, Scene, Shear, SurfaceId};

use super::{kernel::Kernel, path::Path};
use crate::cpu::maps::{LANES, Maps};

/// The closest hit so far, or where the ray ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    pub(crate) t: f32,
    uv: Vec2,
    surface: Option<SurfaceId>,
    /// How far the hit lies beside its triangle, in pixels; 0 where it is exact.
    pub(crate) beside: f32,
    /// 1 where a layer was passed that a ray might have met, as far as the map can tell.
    pub(crate) passed: f32,
}

impl Found {
    /// Nothing yet.
    #[inline]
    pub(crate) fn nothing(t_max: f32) -> Self {
        Self {
            t: t_max,
            uv: Vec2::ZERO,
            surface: None,
            beside: 0.0,
            passed: 0.0,
        }
    }

    #[inline]
    pub(crate) fn hit(&self) -> Option<Hit> {
        self.surface.map(|surface| Hit {
            t: self.t,
            uv: self.uv,
            surface,
        })
    }

    /// Of hits at the same distance the first in scene order counts, as for every exact tracer.
    #[inline(always)]
    fn is_worse_than(&self, t: f32, surface: SurfaceId) -> bool {
        t < self.t || (t == self.t && self.surface.is_some_and(|found| surface < found))
    }
}

/// What is the same for all layers of a query.
#[derive(Clone, Copy)]
pub(crate) struct Question<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) maps: &'a Maps,
    pub(crate) ray: &'a Ray,
    /// A triangle that is not hit.
    pub(crate) start: SurfaceId,
}

impl Question<'_> {
    /// Takes a hit if it is better than what was found.
    #[inline(always)]
    fn offer(&self, block: usize, lane: usize, t: f32, uv: Vec2, found: &mut Found) -> bool {
        if !(t > self.ray.t_min && t <= found.t) {
            return false;
        }
        let surfaces = &self.maps.surfaces[block];
        let surface = surfaces.surface(lane);
        if surface == self.start
            || !found.is_worse_than(t, surface)
            || (surfaces.masked >> lane & 1 != 0 && !self.scene.alpha_passes(surface, uv))
        {
            return false;
        }
        *found = Found {
            t,
            uv,
            surface: Some(surface),
            beside: 0.0,
            ..*found
        };
        true
    }
}

/// Answers for a layer.
pub(crate) trait Meet {
    /// Puts the closest hit with a layer's triangles into `found`, if it is better; τ of the pixel's ends are given.
    fn layer(&mut self, target: u32, ends: [f32; 2], found: &mut Found) -> bool;
}

/// The triangles of a block, exactly.
pub(crate) struct Triangles<'a, K: Kernel> {
    kernel: K,
    question: &'a Question<'a>,
    shear: Shear,
    wide: K::Triangles,
    last: u32,
}

impl<'a, K: Kernel> Triangles<'a, K> {
    #[inline(always)]
    pub(crate) fn new(kernel: K, question: &'a Question<'a>) -> Self {
        let shear = Shear::new(question.ray);
        Self {
            kernel,
            question,
            wide: kernel.triangles(&shear),
            shear,
            last: u32::MAX,
        }
    }
}

impl<K: Kernel> Meet for Triangles<'_, K> {
    #[inline(always)]
    fn layer(&mut self, target: u32, _: [f32; 2], found: &mut Found) -> bool {
        // A block spans pixels, and it is tested as a whole.
        if target == self.last {
            return false;
        }
        self.last = target;
        let index = target as usize;
        let block = &self.question.maps.blocks[index];
        let mut candidates = self.kernel.candidates(&self.wide, block);
        let mut better = false;
        while candidates != 0 {
            let lane = candidates.trailing_zeros() as usize & (LANES - 1);
            candidates &= candidates - 1;
            if let Some((t, uv)) = self.shear.intersect_candidate(block.triangle(lane)) {
                better |= self.question.offer(index, lane, t, uv, found);
            }
        }
        better
    }
}

/// A hit that lies beside its triangle counts only this many times as far from the ray's start.
const OWN: f32 = 16.0;

/// The plane of a triangle, within a pixel (§3.2): what the ray meets there is moved onto the triangle.
pub(crate) struct Planes<'a> {
    question: &'a Question<'a>,
    path: &'a Path,
    /// How far beside its triangle a hit may lie, metres.
    epsilon: f32,
    footprint: f32,
}

impl<'a> Planes<'a> {
    #[inline(always)]
    pub(crate) fn new(
        question: &'a Question<'a>,
        path: &'a Path,
        epsilon: f32,
        footprint: f32,
    ) -> Self {
        Self {
            question,
            path,
            epsilon: epsilon * footprint,
            footprint,
        }
    }
}

impl Meet for Planes<'_> {
    #[inline(always)]
    fn layer(&mut self, target: u32, ends: [f32; 2], found: &mut Found) -> bool {
        let ray = self.question.ray;
        let [x, y, z, offset] = self.question.maps.planes[target as usize];
        let normal = Vec3::new(x, y, z);
        let t = (offset - normal.dot(ray.origin)) / normal.dot(ray.direction);
        let tau = self.path.tau(t);
        // Also false for NaN, where the ray lies in the plane.
        if !(t > ray.t_min && t < found.t && tau >= ends[0] && tau <= ends[1]) {
            return false;
        }
        let (block, lane) = (target as usize / LANES, target as usize % LANES);
        let [a, b, c] = self.question.maps.blocks[block].corners(lane);
        let (e1, e2) = (b - a, c - a);
        // Of a size at which no square vanishes or overflows.
        let scale = 1.0 / e1.abs().max(e2.abs()).max_element();
        let (s1, s2, point) = (scale * e1, scale * e2, scale * (ray.at(t) - a));
        let normal = s1.cross(s2);
        let squared = normal.length_squared();
        let v = point.cross(s2).dot(normal) / squared;
        let w = s1.cross(point).dot(normal) / squared;
        let uv = clamp(Vec2::new(v, w), s1, s2);
        let moved = (e1 * (uv.x - v) + e2 * (uv.y - w)).length();
        // So that NaN is no hit.
        let is_near = moved <= self.epsilon;
        // The planes of a ray's own surroundings reach beyond their triangles, and over its start.
        let is_ahead = OWN * moved <= t * ray.direction.length();
        if !(is_near && is_ahead) {
            // One of both may have been wrong.
            if is_near || is_ahead {
                found.passed = 1.0;
            }
            return false;
        }
        if !self.question.offer(block, lane, t, uv, found) {
            return false;
        }
        found.beside = moved / self.footprint;
        true
    }
}

/// The barycentric coordinates of the triangle's point that is nearest to a point of its plane.
#[inline(always)]
fn clamp(uv: Vec2, e1: Vec3, e2: Vec3) -> Vec2 {
    if uv.min_element() >= 0.0 && uv.element_sum() <= 1.0 {
        return uv;
    }
    let point = e1 * uv.x + e2 * uv.y;
    let on_edge = |origin: Vec3, edge: Vec3| {
        let share = ((point - origin).dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        (share, (point - origin - share * edge).length_squared())
    };
    let edges = [
        (on_edge(Vec3::ZERO, e1), Vec2::ZERO, Vec2::X),
        (on_edge(Vec3::ZERO, e2), Vec2::ZERO, Vec2::Y),
        (on_edge(e1, e2 - e1), Vec2::X, Vec2::Y - Vec2::X),
    ];
    let mut best = (f32::INFINITY, Vec2::ZERO);
    for ((share, distance), origin, edge) in edges {
        if distance < best.0 {
            best = (distance, origin + share * edge);
        }
    }
    best.1
}
