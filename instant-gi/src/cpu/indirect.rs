//! Stage 5, the light of the virtual point lights (Eq. (1)).
//!
//! E(x) = Σ Lₖ V(x, yₖ) G(x, yₖ) is irradiance; the surface's albedo/π is multiplied on when the picture is put
//! together, so that filters do not blur textures. Rays of many points are traced together, those towards one light beside each
//! other, so that they are alike.

use std::f32::consts::PI;

use glam::Vec3;
use isophote_scene::{
    Bsdf, DirectLight, Ray, Scene, Seen, SurfacePoint, Tracer,
    reference::bound,
    sample::{Frame, Sampler, cosine_hemisphere},
};

use super::{
    emission::Vpl,
    maps::Maps,
    select::{Lights, Pick, SELECTION},
};
use crate::GiParams;

/// Who gathers.
pub(super) struct Gather<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> {
    pub(super) scene: &'a Scene,
    /// Answers the rays between points and virtual lights: V.
    pub(super) tracer: &'a S,
    /// Light at what compensating rays hit.
    pub(super) direct: &'a DirectLight<'a, E>,
    pub(super) vpls: &'a [Vpl],
    pub(super) sight: Sight<'a>,
    pub(super) params: &'a GiParams,
    /// How far off the tracer may be at each light, metres.
    tolerances: Vec<f32>,
}

/// How points see the lights.
#[derive(Clone, Copy)]
pub(super) enum Sight<'a> {
    Rays,
    Maps(&'a Maps),
}

impl<'a> From<Option<&'a Maps>> for Sight<'a> {
    fn from(maps: Option<&'a Maps>) -> Self {
        maps.map_or(Self::Rays, Self::Maps)
    }
}

/// A point that receives light.
#[derive(Clone, Copy)]
pub(super) struct Receiver<'a> {
    pub(super) point: &'a SurfacePoint,
    /// The shading normal on the viewer's side.
    pub(super) normal: Vec3,
    /// Which parts of the lights light it, a bit for each.
    pub(super) parts: u64,
    /// What its random numbers belong to.
    pub(super) stream: u32,
}

/// How light is shared out among points.
pub(super) struct Share {
    /// Parts of the lights, at most 64.
    pub(super) parts: u32,
    /// What the light of a part counts.
    pub(super) scale: f32,
    /// Whether what the bound leaves out is to be found again.
    pub(super) compensate: bool,
}

impl Share {
    /// All light at every point.
    pub(super) const ALL: Self = Self {
        parts: 1,
        scale: 1.0,
        compensate: true,
    };
}

/// Rays that are traced together, so that memory does not grow with the number of lights; few enough for a cache.
const BATCH: usize = 1 << 12;

/// The points that a part of the lights lights, coordinate by coordinate: what each light brings them is calculated for
/// several at once.
#[derive(Clone, Default)]
pub(super) struct Points {
    /// Their numbers among the receivers.
    numbers: Vec<usize>,
    positions: [Vec<f32>; 3],
    /// Shading normals.
    normals: [Vec<f32>; 3],
}

impl Points {
    /// Those of each part.
    pub(super) fn by_part(receivers: &[Receiver<'_>], parts: u32) -> Vec<Self> {
        let mut by_part = vec![Self::default(); parts as usize];
        for (number, receiver) in receivers.iter().enumerate() {
            let mut left = receiver.parts;
            while left != 0 {
                let points = &mut by_part[left.trailing_zeros() as usize];
                points.numbers.push(number);
                for axis in 0..3 {
                    points.positions[axis].push(receiver.point.position[axis]);
                    points.normals[axis].push(receiver.normal[axis]);
                }
                left &= left - 1;
            }
        }
        by_part
    }

    /// G of Eq. (1) between each point and a light; of some neither above 0 nor finite, where no light arrives.
    pub(super) fn geometry(&self, vpl: &Vpl, min_d: f32, terms: &mut Vec<f32>) {
        let count = self.numbers.len();
        let [px, py, pz] = self.positions.each_ref().map(|axis| &axis[..count]);
        let [nx, ny, nz] = self.normals.each_ref().map(|axis| &axis[..count]);
        let (light, normal) = (vpl.point.position, vpl.normal);
        terms.clear();
        terms.extend((0..count).map(|number| {
            let (x, y, z) = (
                light.x - px[number],
                light.y - py[number],
                light.z - pz[number],
            );
            // Cosines, times the distance.
            let at_point = nx[number] * x + ny[number] * y + nz[number] * z;
            let at_light = -(normal.x * x + normal.y * y + normal.z * z);
            let squared = x * x + y * y + z * z;
            let cosines = at_point.max(0.0) * at_light.max(0.0);
            cosines / (squared * squared) * bound(min_d, squared.sqrt())
        }));
    }
}

impl<'a, E: Tracer + ?Sized, S: Tracer + ?Sized> Gather<'a, E, S> {
    pub(super) fn new(
        scene: &'a Scene,
        tracer: &'a S,
        direct: &'a DirectLight<'a, E>,
        vpls: &'a [Vpl],
        sight: Sight<'a>,
        params: &'a GiParams,
    ) -> Self {
        let tolerance = |vpl: &Vpl| tracer.tolerance(vpl.point.position);
        Self {
            scene,
            tracer,
            direct,
            vpls,
            sight,
            params,
            tolerances: vpls.iter().map(tolerance).collect(),
        }
    }

    /// Irradiance at points by their parts of the lights, added to `light`; and the number of rays.
    pub(super) fn irradiance(
        &self,
        receivers: &[Receiver<'_>],
        share: &Share,
        light: &mut [Vec3],
    ) -> u64 {
        let tolerance = |receiver: &Receiver<'_>| self.tracer.tolerance(receiver.point.position);
        let tolerances: Vec<f32> = receivers.iter().map(tolerance).collect();
        let mut count = if self.params.selection > 0 {
            self.of_some(receivers, &tolerances, share, light)
        } else {
            self.of_all(receivers, &tolerances, share, light)
        };
        if share.compensate && self.params.compensates() {
            for (receiver, light) in receivers.iter().zip(light) {
                let (left_out, rays) = self.left_out(receiver);
                *light += left_out;
                count += rays;
            }
        }
        count
    }

    /// Adds what all lights of a part bring to the points of that part, and returns the number of rays.
    fn of_all(
        &self,
        receivers: &[Receiver<'_>],
        tolerances: &[f32],
        share: &Share,
        light: &mut [Vec3],
    ) -> u64 {
        let by_part = Points::by_part(receivers, share.parts);
        match self.sight {
            Sight::Rays => self.by_rays(receivers, tolerances, &by_part, share.scale, light),
            Sight::Maps(maps) => {
                self.by_maps(maps, receivers, tolerances, &by_part, share.scale, light);
                0
            }
        }
    }

    /// Adds what the lights bring that points pick, and returns the number of rays.
    fn of_some(
        &self,
        receivers: &[Receiver<'_>],
        tolerances: &[f32],
        share: &Share,
        light: &mut [Vec3],
    ) -> u64 {
        let mut picks = self.picks(receivers, share);
        // Rays towards one light beside each other, so that they are alike.
        picks.sort_unstable_by_key(|pick| (pick.light, pick.receiver));
        let (mut rays, mut arrivals, mut hidden) = (Vec::new(), Vec::new(), Vec::new());
        let mut count = 0;
        for picks in picks.chunks(BATCH) {
            for pick in picks {
                let (number, index) = (pick.light as usize, pick.receiver as usize);
                let (vpl, point) = (&self.vpls[number], receivers[index].point);
                let arriving = vpl.intensity * (pick.share * share.scale);
                match self.sight {
                    Sight::Rays => {
                        let both = [tolerances[index], self.tolerances[number]];
                        if let Some(ray) = ray_between(point, vpl, both) {
                            rays.push(ray);
                            arrivals.push((index, arriving));
                        }
                    }
                    Sight::Maps(maps) => {
                        let (position, normal) = (point.position, point.geometric_normal);
                        light[index] +=
                            arriving * maps.visibility(number, position, normal, tolerances[index]);
                    }
                }
            }
            count += rays.len() as u64;
            self.ask(&mut rays, &mut arrivals, &mut hidden, light);
        }
        count
    }

    /// The lights that points pick of each of their parts.
    fn picks(&self, receivers: &[Receiver<'_>], share: &Share) -> Vec<Pick> {
        let (mut picks, mut weights) = (Vec::new(), Vec::new());
        for part in 0..share.parts {
            let mut lights = None;
            for (index, receiver) in receivers.iter().enumerate() {
                if receiver.parts >> part & 1 == 0 {
                    continue;
                }
                let lights = lights.get_or_insert_with(|| Lights::of_part(self.vpls, part, share));
                let sampler = Sampler::new(self.params.seed ^ SELECTION, receiver.stream, part);
                let from = [self.params.min_d, sampler.get_1d(0)];
                lights.pick(
                    receiver,
                    from,
                    self.params.selection,
                    &mut weights,
                    |place, arrives| {
                        picks.push(Pick {
                            light: part + place as u32 * share.parts,
                            receiver: index as u32,
                            share: arrives,
                        });
                    },
                );
            }
        }
        picks
    }

    /// Adds what arrives along rays that nothing is in the way of.
    fn ask(
        &self,
        rays: &mut Vec<Ray>,
        arrivals: &mut Vec<(usize, Vec3)>,
        hidden: &mut Vec<bool>,
        light: &mut [Vec3],
    ) {
        hidden.clear();
        hidden.resize(rays.len(), false);
        self.tracer.any_hits(rays, hidden);
        rays.clear();
        for ((index, arriving), hidden) in arrivals.drain(..).zip(hidden) {
            if !*hidden {
                light[index] += arriving;
            }
        }
    }

    /// Adds what each light of a part brings to the points of that part, and returns the number of rays.
    fn by_rays(
        &self,
        receivers: &[Receiver<'_>],
        tolerances: &[f32],
        by_part: &[Points],
        scale: f32,
        light: &mut [Vec3],
    ) -> u64 {
        let (mut rays, mut arrivals, mut hidden) = (Vec::new(), Vec::new(), Vec::new());
        let mut count = 0;
        for (number, vpl) in self.vpls.iter().enumerate() {
            self.arriving(vpl, &by_part[number % by_part.len()], |index, arriving| {
                let both = [tolerances[index], self.tolerances[number]];
                if let Some(ray) = ray_between(receivers[index].point, vpl, both) {
                    rays.push(ray);
                    arrivals.push((index, arriving * scale));
                }
            });
            if rays.len() >= BATCH {
                count += rays.len() as u64;
                self.ask(&mut rays, &mut arrivals, &mut hidden, light);
            }
        }
        count += rays.len() as u64;
        self.ask(&mut rays, &mut arrivals, &mut hidden, light);
        count
    }

    /// The same by shadow maps (§6).
    fn by_maps(
        &self,
        maps: &Maps,
        receivers: &[Receiver<'_>],
        tolerances: &[f32],
        by_part: &[Points],
        scale: f32,
        light: &mut [Vec3],
    ) {
        // Beside each other in memory, since every light asks for them.
        let point = |receiver: &Receiver<'_>| {
            let point = receiver.point;
            (point.position, point.geometric_normal)
        };
        let points: Vec<_> = receivers.iter().map(point).collect();
        for (number, vpl) in self.vpls.iter().enumerate() {
            self.arriving(vpl, &by_part[number % by_part.len()], |index, arriving| {
                let (position, normal) = points[index];
                let seen = maps.visibility(number, position, normal, tolerances[index]);
                light[index] += arriving * (scale * seen);
            });
        }
    }

    /// `L_e` G of Eq. (1) between a light and each point that it could light.
    fn arriving(&self, vpl: &Vpl, points: &Points, mut each: impl FnMut(usize, Vec3)) {
        let mut terms = Vec::new();
        points.geometry(vpl, self.params.min_d, &mut terms);
        for (&number, &term) in points.numbers.iter().zip(&terms) {
            let arriving = vpl.intensity * term;
            // Also false for NaN, where both are one point.
            if term > 0.0 && arriving.is_finite() && arriving != Vec3::ZERO {
                each(number, arriving);
            }
        }
    }

    /// What the bound leaves out, by rays that go where light is near (Kollig and Keller 2004): they take the radiance of
    /// what they hit where 1 − f is left.
    fn left_out(&self, receiver: &Receiver<'_>) -> (Vec3, u64) {
        let count = self.params.compensation;
        let frame = Frame::new(receiver.normal);
        let tolerance = self.tracer.tolerance(receiver.point.position);
        let mut rays = 0;
        let mut sum = Vec3::ZERO;
        for number in 0..count {
            let sampler = Sampler::new(self.params.seed ^ COMPENSATION, receiver.stream, number);
            let direction = frame
                .to_world(cosine_hemisphere(sampler.get_2d(4)))
                .normalize();
            let origin = receiver.point.lifted(direction, tolerance);
            let ray = Ray::new(origin, direction).until(1.2 * self.params.min_d);
            rays += 1;
            let Some(hit) = self.tracer.closest_hit_from(&ray, receiver.point.surface) else {
                continue;
            };
            let view = -direction;
            let point = self.scene.surface_point(&hit);
            let seen = Seen::new(self.scene, point, view, self.params.materials);
            let (normal, albedo) = (seen.normal(), seen.albedo());
            if albedo == Vec3::ZERO {
                continue;
            }
            let bsdf = Bsdf::diffuse(normal, albedo);
            let (mut radiance, traced) = self.direct.scattered(&point, view, &bsdf, &sampler);
            rays += traced;
            if self.params.bounces > 1 {
                let (indirect, traced) = self.shorter(&point, normal);
                radiance += albedo / PI * indirect;
                rays += traced;
            }
            sum += (1.0 - bound(self.params.min_d, hit.t)) * radiance;
        }
        (sum * (PI / count as f32), rays)
    }

    /// Light at a point of lights that have met one surface less, bounded.
    fn shorter(&self, point: &SurfacePoint, normal: Vec3) -> (Vec3, u64) {
        let receiver = Receiver {
            point,
            normal,
            parts: 1,
            stream: 0,
        };
        let points = &Points::by_part(&[receiver], 1)[0];
        let here = self.tracer.tolerance(point.position);
        let mut rays = 0;
        let mut sum = Vec3::ZERO;
        let lights = self.vpls.iter().enumerate();
        for (number, vpl) in lights.filter(|(_, vpl)| vpl.bounce < self.params.bounces) {
            self.arriving(vpl, points, |_, arriving| match self.sight {
                Sight::Rays => {
                    let both = [here, self.tolerances[number]];
                    if let Some(ray) = ray_between(point, vpl, both) {
                        rays += 1;
                        if !self.tracer.any_hit(&ray) {
                            sum += arriving;
                        }
                    }
                }
                Sight::Maps(maps) => {
                    let normal = point.geometric_normal;
                    sum += arriving * maps.visibility(number, point.position, normal, here);
                }
            });
        }
        (sum, rays)
    }
}

/// The ray that asks for V of Eq. (1) between a point and a light, which tracers may be off by; `None` where they are too near.
fn ray_between(point: &SurfacePoint, vpl: &Vpl, [here, there]: [f32; 2]) -> Option<Ray> {
    let direction = vpl.point.position - point.position;
    let start = point.lifted(direction, here);
    let end = vpl.point.lifted(-direction, there);
    let way = end - start;
    let length = way.length();
    // Tracers that are off may not count the surface of the light.
    let until = length - here.max(there);
    (until > 0.0).then(|| Ray::new(start, way / length).until(until))
}

/// Compensating rays have random numbers of their own.
pub(crate) const COMPENSATION: u64 = 0x6b6b;
