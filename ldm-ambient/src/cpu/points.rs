//! The points that maps are asked for, eight side by side: a picture's pixels, a mesh's vertices or a lightmap's texels.

use glam::{UVec2, Vec2, Vec3};
use isophote_scene::{
    Aabb, Camera, Hit, Receiver, Receivers, Scene, Seen, SurfacePoint, Tracer, facing,
    reference::{Materials, Normals},
    sample::radical_inverse,
};
use rayon::prelude::*;

use super::lanes::{LANES, Vectors};

/// A point and its normals, on the side that light is computed for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Metres.
    pub position: Vec3,
    /// Light comes from the hemisphere around it, unit.
    pub shading_normal: Vec3,
    /// That of the plane the point lies in, unit; nothing comes from below it.
    pub geometric_normal: Vec3,
}

/// Points, and which pixel, vertex or texel each is for.
#[derive(Clone, Debug, Default)]
pub struct Points {
    pub(crate) points: Vec<Point>,
    pub(crate) indices: Vec<u32>,
}

/// Eight points relative to an origin; the last point again where there are fewer.
#[derive(Clone, Copy)]
pub(crate) struct PointBlock {
    pub(crate) positions: Vectors,
    pub(crate) shading: Vectors,
    pub(crate) geometric: Vectors,
}

impl Point {
    /// A surface's point on the side of a direction.
    pub fn new(point: &SurfacePoint, view: Vec3, normals: Normals) -> Self {
        let geometric_normal = facing(point.geometric_normal, view);
        Self {
            position: point.position,
            shading_normal: match normals {
                Normals::Smooth => facing(point.shading_normal, view),
                Normals::Flat => geometric_normal,
            },
            geometric_normal,
        }
    }
}

/// Ten bits, two places apart.
fn spread(bits: u32) -> u32 {
    let bits = (bits | bits << 16) & 0x0300_00ff;
    let bits = (bits | bits << 8) & 0x0300_f00f;
    let bits = (bits | bits << 4) & 0x030c_30c3;
    (bits | bits << 2) & 0x0924_9249
}

/// Where a sample is in its pixel: the first in the middle, the next ones spread over it.
pub(crate) fn place_of_sample(sample: u32) -> Vec2 {
    Vec2::from_array([2, 3].map(|base| (radical_inverse(base, sample) + 0.5).fract()))
}

impl Points {
    /// Any receivers, on the side of their shading normals, with their own indices.
    pub fn of_receivers(receivers: &Receivers, normals: Normals) -> Self {
        let point = |receiver: &Receiver| {
            Point::new(&receiver.point, receiver.point.shading_normal, normals)
        };
        Self {
            points: receivers.points.iter().map(point).collect(),
            indices: receivers
                .points
                .iter()
                .map(|receiver| receiver.index)
                .collect(),
        }
    }

    /// What a camera sees at one place of each pixel: sample 0 is its centre, the next ones are spread over it. The index is
    /// the pixel's number, row by row from the top.
    pub fn from_camera<T: Tracer + ?Sized>(
        scene: &Scene,
        tracer: &T,
        camera: &Camera,
        size: [u32; 2],
        sample: u32,
        normals: Normals,
    ) -> Self {
        let place_of = |scene: &Scene, hit: &Hit, view| {
            (Point::new(&scene.surface_point(hit), view, normals), ())
        };
        Self::look(scene, tracer, camera, size, sample, place_of).0
    }

    /// The same, and what is seen there.
    pub fn with_seen<T: Tracer + ?Sized>(
        scene: &Scene,
        tracer: &T,
        camera: &Camera,
        size: [u32; 2],
        sample: u32,
        (normals, materials): (Normals, Materials),
    ) -> (Self, Vec<Seen>) {
        let place_of = |scene: &Scene, hit: &Hit, view| {
            let mut point = scene.surface_point(hit);
            if normals == Normals::Flat {
                point.shading_normal = point.geometric_normal;
            }
            let seen = Seen::new(scene, point, view, materials);
            (Point::new(&seen.point, seen.view, normals), seen)
        };
        Self::look(scene, tracer, camera, size, sample, place_of)
    }

    /// Surfaces that are seen from somewhere, on the sides from which they are; each is its own index.
    pub fn of_seen(seen: &[Seen], normals: Normals) -> Self {
        let point = |seen: &Seen| Point::new(&seen.point, seen.view, normals);
        Self {
            points: seen.iter().map(point).collect(),
            indices: (0..seen.len() as u32).collect(),
        }
    }

    fn look<T: Tracer + ?Sized, R: Send>(
        scene: &Scene,
        tracer: &T,
        camera: &Camera,
        size: [u32; 2],
        sample: u32,
        point: impl Fn(&Scene, &Hit, Vec3) -> (Point, R) + Sync,
    ) -> (Self, Vec<R>) {
        let [width, height] = size;
        let place = place_of_sample(sample);
        let see = |pixel: u32| {
            let corner = UVec2::new(pixel % width, pixel / width).as_vec2();
            let ray = camera.ray(corner + place, width, height);
            let hit = tracer.closest_hit(&ray)?;
            Some((point(scene, &hit, -ray.direction), pixel))
        };
        let found: Vec<((Point, R), u32)> = (0..width * height)
            .into_par_iter()
            .filter_map(see)
            .collect();
        let (seen, indices): (Vec<_>, _) = found.into_iter().unzip();
        let (points, more) = seen.into_iter().unzip();
        (Self { points, indices }, more)
    }

    /// The numbers of the points in an order in which those near to each other follow each other: that of Morton's curve.
    pub(crate) fn along_curve(&self) -> Vec<u32> {
        let bounds = Aabb::around(self.points.iter().map(|point| point.position));
        let side = (bounds.max - bounds.min)
            .max_element()
            .max(f32::MIN_POSITIVE);
        let code = |(number, point): (usize, &Point)| {
            let cell = ((point.position - bounds.min) * (1023.0 / side)).as_uvec3();
            let code = spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2;
            u64::from(code) << 32 | number as u64
        };
        let mut codes: Vec<u64> = self.points.par_iter().enumerate().map(code).collect();
        codes.par_sort_unstable();
        codes.into_iter().map(|code| code as u32).collect()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Which pixel, vertex or texel each is for.
    pub fn indices(&self) -> &[u32] {
        &self.indices
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

impl PointBlock {
    /// Blocks of points relative to an origin.
    pub(crate) fn pack(points: &[Point], origin: Vec3) -> Vec<Self> {
        points
            .chunks(LANES)
            .map(|points| Self::of(points, origin))
            .collect()
    }

    /// The same in another order.
    pub(crate) fn pack_in(order: &[u32], points: &[Point], origin: Vec3) -> Vec<Self> {
        let pack = |some: &[u32]| {
            let point = |lane: usize| points[some[lane.min(some.len() - 1)] as usize];
            Self::of(&std::array::from_fn::<_, LANES, _>(point), origin)
        };
        order.par_chunks(LANES).map(pack).collect()
    }

    fn of(points: &[Point], origin: Vec3) -> Self {
        let point = |lane: usize| &points[lane.min(points.len() - 1)];
        let lanes = |of: &dyn Fn(&Point) -> Vec3| {
            let vectors: [Vec3; LANES] = std::array::from_fn(|lane| of(point(lane)));
            [0, 1, 2].map(|axis| vectors.map(|vector| vector[axis]))
        };
        Self {
            positions: lanes(&|point| point.position - origin),
            shading: lanes(&|point| point.shading_normal),
            geometric: lanes(&|point| point.geometric_normal),
        }
    }

    /// The box around some blocks.
    pub(crate) fn bounds(blocks: &[Self]) -> Aabb {
        let point = |block: &Self, lane| Vec3::from_array(block.positions.map(|axis| axis[lane]));
        let points = blocks
            .iter()
            .flat_map(|block| (0..LANES).map(move |lane| point(block, lane)));
        Aabb::around(points)
    }
}
