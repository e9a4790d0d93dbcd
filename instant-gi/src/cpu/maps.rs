//! Stage 3, visibility of the virtual point lights by paraboloid shadow maps, which the paper proposes (§6).
//!
//! A virtual point light shines into the hemisphere around its normal, and a paraboloid maps that hemisphere to a disk
//! (Brabec, Annen, Seidel 2002): the unit direction (x, y, z), z along the normal, falls on (x, y)/(1 + z). A map is the
//! square around the disk; each of its texels keeps how far the first surface is, which one ray of the tracer tells. So
//! there is a ray for each texel of each light instead of one for each point and light.
//!
//! A texel speaks for all directions that fall on it, but was asked along its centre's. A point is compared with its texel
//! where the point's tangent plane meets the texel's direction, or at its own distance where that is nearer: so a plane never
//! shadows itself, however aslant it is seen, and what lies behind the point does not count. For edges and curved surfaces
//! [`ShadowMaps::bias`] texels' widths are left.

use glam::{BVec4A, Vec2, Vec3, Vec4};
use isophote_scene::{Hit, Ray, Tracer, sample::Frame};
use rayon::prelude::*;

use super::emission::Vpl;
use crate::{Error, Result, ShadowMaps, params::Lookup};

/// Distances below this count as this, metres: one over them must be finite.
const NEAREST: f32 = 1e-30;
/// Bytes that the maps of all lights may take.
const MOST_BYTES: u64 = 4 << 30;

/// The maps of all virtual point lights.
#[derive(Clone, Debug)]
pub struct Maps {
    params: ShadowMaps,
    views: Vec<View>,
    /// Map after map, row by row: (1 + r²)/distance, r that of the texel on the disk, the distance to the first surface in
    /// metres; 0 where there is none.
    texels: Vec<f32>,
}

/// Where a map is seen from.
#[derive(Clone, Copy, Debug)]
struct View {
    origin: Vec3,
    frame: Frame,
    /// How far distances may be off here, metres.
    tolerance: f32,
}

impl Maps {
    /// Asks a tracer, which must answer [`Distance`](isophote_scene::Answers::Distance), for the maps of all lights. Returns
    /// the number of rays too.
    ///
    /// # Errors
    /// [`Error::TooLarge`] when the maps would take more than 4 GiB.
    pub fn new<T: Tracer + ?Sized>(
        tracer: &T,
        vpls: &[Vpl],
        params: &ShadowMaps,
    ) -> Result<(Self, u64)> {
        let area = params.resolution as usize * params.resolution as usize;
        let bytes = 4 * area as u64 * vpls.len() as u64;
        if bytes > MOST_BYTES {
            return Err(Error::TooLarge {
                what: format!("the shadow maps of {} virtual point lights", vpls.len()),
                bytes,
                limit: MOST_BYTES,
                remedy: "take fewer light paths or smaller maps",
            });
        }
        let view = |vpl: &Vpl| {
            let tolerance = tracer.tolerance(vpl.point.position);
            View {
                origin: vpl.point.lifted(vpl.normal, tolerance),
                frame: Frame::new(vpl.normal),
                tolerance,
            }
        };
        let views: Vec<View> = vpls.iter().map(view).collect();
        let mut texels = vec![0.0; area * views.len()];
        let maps = texels.par_chunks_mut(area).zip(&views);
        let rays = maps
            .map(|(texels, view)| fill(tracer, view, params.resolution, texels))
            .sum();
        let maps = Self {
            params: *params,
            views,
            texels,
        };
        Ok((maps, rays))
    }

    /// V of Eq. (1): which part of a light's map around a point lets it see the light, 0 to 1. The point must lie on the lit
    /// side of the light; `normal` is its triangle's, `tolerance` the tracer's there.
    #[inline]
    pub fn visibility(&self, light: usize, point: Vec3, normal: Vec3, tolerance: f32) -> f32 {
        let view = &self.views[light];
        let side = self.params.resolution as f32;
        let offset = view.frame.to_local(point - view.origin);
        let inverse = offset.length().recip();
        let direction = offset * inverse;
        let normal = view.frame.to_local(normal);
        // The map is seen from a little above the light, so that the point may lie a little below its horizon.
        let above = 1.0 + direction.z.max(0.0);
        let width = 2.0 * above / side;
        let compared = Compared {
            plane: normal / offset.dot(normal),
            inverse,
            left: 1.0 - self.params.bias * width,
            tolerance: view.tolerance + tolerance,
        };
        let place = (direction.truncate() / above + 1.0) * (0.5 * side);
        let last = self.params.resolution as i32 - 1;
        // Truncated, which is faster than rounded down.
        let texel = |at: f32| (at as i32).clamp(0, last) as f32;
        let area = self.params.resolution as usize * self.params.resolution as usize;
        let map = &self.texels[light * area..][..area];
        match self.params.lookup {
            Lookup::Nearest => {
                let [x, y] = place.to_array().map(|at| Vec4::splat(texel(at)));
                let lit = compared.lit(map, side, x, y);
                f32::from(lit.test(0))
            }
            Lookup::Smooth => {
                let next = place + 0.5;
                let share = next - Vec2::from(next.to_array().map(|at| at as i32 as f32));
                let [(left, right), (top, bottom)] =
                    next.to_array().map(|at| (texel(at - 1.0), texel(at)));
                let x = Vec4::new(left, right, left, right);
                let y = Vec4::new(top, top, bottom, bottom);
                let rest = 1.0 - share;
                let weights = Vec4::new(
                    rest.x * rest.y,
                    share.x * rest.y,
                    rest.x * share.y,
                    share.x * share.y,
                );
                let lit = compared.lit(map, side, x, y);
                Vec4::select(lit, weights, Vec4::ZERO).element_sum()
            }
        }
    }
}

/// A point as it is compared with texels, in the light's frame.
struct Compared {
    /// Its tangent plane: the product with a unit direction is one over the plane's distance along it. Not finite where the
    /// light lies in the plane.
    plane: Vec3,
    /// One over its own distance.
    inverse: f32,
    /// What the bias leaves of a distance.
    left: f32,
    /// How far off the tracer's distances may be, metres.
    tolerance: f32,
}

impl Compared {
    /// Which of four texels of a map let the point see the light.
    #[inline]
    fn lit(&self, map: &[f32], side: f32, x: Vec4, y: Vec4) -> BVec4A {
        let numbers = (y * side + x).to_array();
        let stored = Vec4::from(numbers.map(|number| map[number as usize]));
        let (x, y, squared) = on_disk(x, y, side);
        // Both are 1 + r² times one over a distance, so that nothing is divided.
        let scale = 1.0 + squared;
        let plane = 2.0 * (self.plane.x * x + self.plane.y * y) + self.plane.z * (1.0 - squared);
        // The second where the first is NaN; finite, so that no tolerance times it is a number.
        let own = plane.max(scale * self.inverse).min(Vec4::MAX);
        (stored * (self.left * scale - self.tolerance * own)).cmple(own * scale)
    }
}

/// Where the centres of four texels lie on the disk, and their squared distances from its middle. Those outside, which points
/// near its edge are compared with, lie half a texel inside it, so that rays do not run along the light's own surface.
#[inline]
fn on_disk(x: Vec4, y: Vec4, side: f32) -> (Vec4, Vec4, Vec4) {
    let width = 2.0 / side;
    let edge = Vec4::splat(1.0 - 0.5 * width);
    let [x, y] = [x, y].map(|at| (at + 0.5) * width - 1.0);
    let squared = x * x + y * y;
    let is_outside = squared.cmpgt(edge * edge);
    if !is_outside.any() {
        return (x, y, squared);
    }
    let length = squared.to_array().map(f32::sqrt);
    let scale = Vec4::select(is_outside, edge / Vec4::from(length), Vec4::ONE);
    (x * scale, y * scale, squared.min(edge * edge))
}

/// The unit direction of a texel's centre in the light's frame, and 1 + r².
fn texel_direction([x, y]: [u32; 2], resolution: u32) -> (Vec3, f32) {
    let (x, y, squared) = on_disk(
        Vec4::splat(x as f32),
        Vec4::splat(y as f32),
        resolution as f32,
    );
    let scale = 1.0 + squared.x;
    let direction = Vec3::new(2.0 * x.x, 2.0 * y.x, 1.0 - squared.x) / scale;
    (direction, scale)
}

/// Whether any point is compared with a texel.
fn is_used([x, y]: [u32; 2], resolution: u32) -> bool {
    let center = (Vec2::new(x as f32, y as f32) + 0.5) * 2.0 - resolution as f32;
    // Its own corner, or one of its neighbours in a smooth look-up.
    center.length() <= resolution as f32 + 2.0 * std::f32::consts::SQRT_2
}

/// Rays that a map takes.
#[cfg(feature = "gpu")]
pub(crate) fn rays_of_map(resolution: u32) -> u64 {
    let row = |y| (0..resolution).filter(move |&x| is_used([x, y], resolution));
    (0..resolution).flat_map(row).count() as u64
}

/// Fills a light's map, and returns the number of rays.
fn fill<T: Tracer + ?Sized>(tracer: &T, view: &View, resolution: u32, texels: &mut [f32]) -> u64 {
    let (mut rays, mut places) = (Vec::new(), Vec::new());
    let mut hits: Vec<Option<Hit>> = Vec::new();
    let mut count = 0;
    for (y, row) in (0..resolution).zip(texels.chunks_exact_mut(resolution as usize)) {
        rays.clear();
        places.clear();
        for x in (0..resolution).filter(|&x| is_used([x, y], resolution)) {
            let (direction, scale) = texel_direction([x, y], resolution);
            rays.push(Ray::new(view.origin, view.frame.to_world(direction)));
            places.push((x, scale));
        }
        hits.clear();
        hits.resize(rays.len(), None);
        tracer.closest_hits(&rays, &mut hits);
        count += rays.len() as u64;
        for (&(x, scale), hit) in places.iter().zip(&hits) {
            row[x as usize] = hit.map_or(0.0, |hit| scale / hit.t.max(NEAREST));
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_look_where_their_centres_fall() {
        for resolution in [8, 64] {
            for (x, y) in (0..resolution).flat_map(|y| (0..resolution).map(move |x| (x, y))) {
                let (direction, scale) = texel_direction([x, y], resolution);
                assert!((direction.length() - 1.0).abs() < 1e-5 && direction.z > 0.0);
                let back = direction.truncate() / (1.0 + direction.z);
                assert!((scale - 1.0 - back.length_squared()).abs() < 1e-5);
                let center =
                    (Vec2::new(x as f32, y as f32) + 0.5) * (2.0 / resolution as f32) - 1.0;
                let is_inside = center.length() < 1.0 - 1.0 / resolution as f32;
                assert!(!is_inside || (back - center).length() < 1e-5, "{x} {y}");
                assert!(!is_inside || is_used([x, y], resolution));
            }
        }
        assert!(!is_used([0, 0], 64));
    }
}
