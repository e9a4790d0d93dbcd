//! The texels of a lightmap: which point of which triangle each stands for, and what is between the charts.

use glam::{DVec3, Vec2, Vec3};
use isophote_scene::{Receiver, Scene, SurfaceId, area};
use rayon::prelude::*;

use super::layout::Layout;

/// How far a texel's centre may be from a triangle that it is still of [texels]: its corner at 45° away, and some more.
const REACH: f32 = 0.75;
/// How near to the rim of its triangle a point is moved inwards, and by how much [texels]: at the rim itself it would lie in the
/// surface that begins there.
const RIM: f32 = 0.125;
const INWARDS: f32 = 0.25;
/// How deep a centre must be within two triangles to count as overlapped [texels]: less is an edge that they share.
const DEEP: f32 = 0.01;

/// What a texel stands for.
#[derive(Clone, Copy)]
struct Owner {
    surface: SurfaceId,
    /// Barycentric coordinates.
    uv: Vec2,
    /// How far its centre is outside of the triangle [texels]; negative inside.
    distance: f32,
}

/// The texels that some triangle reaches.
pub(super) struct Texels {
    owners: Vec<Option<Owner>>,
    /// Texels whose centres are within two triangles.
    pub(super) overlapping: usize,
    /// Texels whose centres are within a triangle.
    pub(super) covered: usize,
    /// Texels at the rims of charts, whose centres are outside.
    pub(super) rim: usize,
    /// Triangles that have no texel.
    pub(super) without: usize,
}

impl Texels {
    /// Draws all triangles of a layout. A texel belongs to the first triangle that its centre is in, or else to the nearest.
    pub(super) fn draw(layout: &Layout) -> Self {
        let size = layout.size as usize;
        let mut texels = Self {
            owners: vec![None; size * size],
            overlapping: 0,
            covered: 0,
            rim: 0,
            without: 0,
        };
        let mut is_overlapped = vec![false; size * size];
        for (instance, triangles) in layout.corners.iter().enumerate() {
            for (primitive, corners) in triangles.iter().enumerate() {
                let surface = SurfaceId {
                    instance: instance as u32,
                    primitive: primitive as u32,
                };
                texels.draw_triangle(size, surface, corners, &mut is_overlapped);
            }
        }
        texels.overlapping = is_overlapped.iter().filter(|is| **is).count();
        let owners = || texels.owners.iter().flatten();
        (texels.covered, texels.rim) = (
            owners().filter(|owner| owner.distance <= 0.0).count(),
            owners().filter(|owner| owner.distance > 0.0).count(),
        );
        let mut has_some: Vec<Vec<bool>> = layout
            .corners
            .iter()
            .map(|triangles| vec![false; triangles.len()])
            .collect();
        for Owner { surface, .. } in owners() {
            has_some[surface.instance as usize][surface.primitive as usize] = true;
        }
        texels.without = has_some.iter().flatten().filter(|has| !**has).count();
        texels
    }

    fn draw_triangle(
        &mut self,
        size: usize,
        surface: SurfaceId,
        corners: &[Vec2; 3],
        is_overlapped: &mut [bool],
    ) {
        let [a, b, c] = *corners;
        let low = (a.min(b).min(c) - REACH - 0.5).ceil().max(Vec2::ZERO);
        let high = (a.max(b).max(c) + REACH - 0.5).floor();
        let high = high.min(Vec2::splat(size as f32 - 1.0));
        if !(low.is_finite() && high.cmpge(low).all()) {
            return;
        }
        let (low, high) = (low.as_uvec2(), high.as_uvec2());
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                let at = Vec2::new(x as f32, y as f32) + 0.5;
                let Some((distance, uv)) = place(corners, at).filter(|(d, _)| *d <= REACH) else {
                    continue;
                };
                let index = y as usize * size + x as usize;
                let owner = &mut self.owners[index];
                let before = owner.as_ref().map_or(f32::INFINITY, |owner| owner.distance);
                is_overlapped[index] |= before < -DEEP && distance < -DEEP;
                if before > 0.0 && distance < before {
                    *owner = Some(Owner {
                        surface,
                        uv,
                        distance,
                    });
                }
            }
        }
    }

    /// The receivers, by increasing number of their texel.
    pub(super) fn receivers(&self, scene: &Scene, layout: &Layout) -> Vec<Receiver> {
        let receiver = |(index, owner): (usize, &Option<Owner>)| {
            let Owner { surface, uv, .. } = (*owner)?;
            let instance = &scene.instances[surface.instance as usize];
            let corners = scene.mesh(instance).corners(surface.primitive as usize);
            let [p, q, r] = corners.map(|corner| instance.transform.transform_point3(corner));
            let [a, b, c] = layout.corners[surface.instance as usize][surface.primitive as usize];
            let texels = 0.5 * f64::from((b - a).perp_dot(c - a).abs());
            Some(Receiver {
                point: scene.point_on(surface, uv),
                area: (area(p, q, r) / texels.max(1e-6)) as f32,
                index: index as u32,
            })
        };
        let owners = self.owners.par_iter().enumerate();
        owners.filter_map(receiver).collect()
    }
}

/// How far a point is outside of a triangle (negative inside), and the barycentric coordinates of the triangle's point that is
/// nearest to it. None for triangles without area.
fn place(corners: &[Vec2; 3], at: Vec2) -> Option<(f32, Vec2)> {
    let [a, b, c] = *corners;
    let doubled = (b - a).perp_dot(c - a);
    if doubled == 0.0 || !doubled.is_finite() {
        return None;
    }
    let uv = |at: Vec2| {
        let (v, w) = ((at - a).perp_dot(c - a), (b - a).perp_dot(at - a));
        Vec2::new(v, w) / doubled
    };
    let inside = uv(at);
    let edges = [(a, b), (b, c), (c, a)];
    let nearest = edges.map(|(from, to)| {
        let along = to - from;
        let t = ((at - from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
        from + t * along
    });
    let distances = nearest.map(|point| point.distance(at));
    let least = (0..3).min_by(|&i, &j| distances[i].total_cmp(&distances[j]))?;
    let is_inside = inside.x >= 0.0 && inside.y >= 0.0 && inside.x + inside.y <= 1.0;
    if is_inside && distances[least] > RIM {
        return Some((-distances[least], inside));
    }
    let middle = (a + b + c) / 3.0;
    let way = middle - nearest[least];
    let moved = nearest[least] + way * (INWARDS / way.length()).min(0.5);
    let signed = if is_inside { -1.0 } else { 1.0 } * distances[least];
    Some((signed, uv(moved)))
}

/// A square picture of light.
pub(super) struct Lightmap {
    pub(super) size: u32,
    /// Row by row from the top.
    pub(super) texels: Vec<Vec3>,
}

impl Lightmap {
    /// The values of receivers, spread by so many texels into what is empty; what is left gets their mean.
    pub(super) fn new(size: u32, receivers: &[Receiver], values: &[Vec3], padding: u32) -> Self {
        let count = size as usize * size as usize;
        let mut texels = vec![Vec3::ZERO; count];
        let mut is_full = vec![false; count];
        for (receiver, value) in receivers.iter().zip(values) {
            texels[receiver.index as usize] = *value;
            is_full[receiver.index as usize] = true;
        }
        let mut map = Self { size, texels };
        for _ in 0..padding {
            map.spread(&mut is_full);
        }
        let sum: DVec3 = values.iter().map(|value| value.as_dvec3()).sum();
        let mean = (sum / values.len().max(1) as f64).as_vec3();
        for (texel, _) in map
            .texels
            .iter_mut()
            .zip(&is_full)
            .filter(|(_, full)| !**full)
        {
            *texel = mean;
        }
        map
    }

    /// Empty texels beside full ones become full with their mean.
    fn spread(&mut self, is_full: &mut [bool]) {
        let size = self.size as usize;
        let (texels, full) = (&self.texels, &*is_full);
        let grown = |index: usize| {
            if full[index] {
                return None;
            }
            let (x, y) = (index % size, index / size);
            let (mut sum, mut count) = (Vec3::ZERO, 0.0);
            for y in y.saturating_sub(1)..size.min(y + 2) {
                for x in x.saturating_sub(1)..size.min(x + 2) {
                    if full[y * size + x] {
                        sum += texels[y * size + x];
                        count += 1.0;
                    }
                }
            }
            (count > 0.0).then(|| (index, sum / count))
        };
        let new: Vec<(usize, Vec3)> = (0..size * size).into_par_iter().filter_map(grown).collect();
        for (index, value) in new {
            self.texels[index] = value;
            is_full[index] = true;
        }
    }

    /// The value between texels' centres, as textures are filtered.
    pub(super) fn sample(&self, at: Vec2) -> Vec3 {
        let last = self.size as f32 - 1.0;
        let at = (at - 0.5).clamp(Vec2::ZERO, Vec2::splat(last));
        let low = at.floor();
        let part = at - low;
        let texel = |x: f32, y: f32| {
            let (x, y) = (x.min(last) as usize, y.min(last) as usize);
            self.texels[y * self.size as usize + x]
        };
        let row = |y: f32| texel(low.x, y).lerp(texel(low.x + 1.0, y), part.x);
        row(low.y).lerp(row(low.y + 1.0), part.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_inside_or_at_the_rim() {
        let corners = [Vec2::ZERO, Vec2::new(4.0, 0.0), Vec2::new(0.0, 4.0)];
        let (distance, uv) = place(&corners, Vec2::ONE).unwrap();
        assert_eq!((distance, uv), (-1.0, Vec2::splat(0.25)));
        let (distance, uv) = place(&corners, Vec2::new(4.0 / 3.0, -0.5)).unwrap();
        assert!(distance == 0.5 && (uv - Vec2::new(1.0 / 3.0, INWARDS / 4.0)).length() < 1e-6);
        let (distance, uv) = place(&corners, Vec2::new(3.0, 3.0)).unwrap();
        assert!((distance - 2.0_f32.sqrt()).abs() < 1e-6);
        assert!(uv.x == uv.y && uv.x < 0.5 && uv.x > 0.4, "{uv}");
        let (distance, uv) = place(&corners, Vec2::new(4.0 / 3.0, 0.0)).unwrap();
        assert!(distance == 0.0 && uv.y > 0.0);
        assert!(place(&[Vec2::ZERO; 3], Vec2::ONE).is_none());
    }

    #[test]
    fn empty_texels_take_from_their_neighbours() {
        let mut map = Lightmap {
            size: 4,
            texels: vec![Vec3::ZERO; 16],
        };
        map.texels[5] = Vec3::ONE;
        let mut is_full = vec![false; 16];
        is_full[5] = true;
        map.spread(&mut is_full);
        assert_eq!(is_full.iter().filter(|full| **full).count(), 9);
        assert_eq!(map.texels[0], Vec3::ONE);
        assert_eq!(map.texels[15], Vec3::ZERO);
        assert_eq!(map.sample(Vec2::new(0.1, 0.1)), Vec3::ONE);
        assert_eq!(map.sample(Vec2::new(3.0, 1.5)), Vec3::splat(0.5));
    }
}
