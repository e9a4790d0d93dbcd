//! What a camera sees, as its depths tell: finer than the picture that is asked for, and wider.

use glam::{Vec2, Vec3};
use isophote_scene::{Camera, Projection, Scene, Tracer, facing};
use rayon::prelude::*;

use super::HbaoParams;
use crate::Result;

/// How a camera projects onto a picture, both ways; a place is counted in pixels from the top left corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eye {
    pub(crate) position: Vec3,
    pub(crate) right: Vec3,
    pub(crate) up: Vec3,
    pub(crate) forward: Vec3,
    pub(crate) is_parallel: bool,
    /// Pixels of a metre, one metre before the viewer if it is not parallel.
    pub(crate) scale: f32,
    /// The middle of the picture.
    pub(crate) middle: Vec2,
}

impl Eye {
    pub(crate) fn new(camera: &Camera, size: [u32; 2]) -> Self {
        let axes = camera.transform.matrix3;
        let axis = |axis: glam::Vec3A, other| Vec3::from(axis).normalize_or(other);
        let (half, is_parallel) = match camera.projection {
            Projection::Perspective { yfov } => ((0.5 * yfov).tan(), false),
            Projection::Orthographic { half_height } => (half_height, true),
        };
        Self {
            position: camera.position(),
            right: axis(axes.x_axis, Vec3::X),
            up: axis(axes.y_axis, Vec3::Y),
            forward: -axis(axes.z_axis, Vec3::Z),
            is_parallel,
            scale: 0.5 * size[1] as f32 / half,
            middle: 0.5 * Vec2::new(size[0] as f32, size[1] as f32),
        }
    }

    #[inline]
    pub(super) fn depth(&self, point: Vec3) -> f32 {
        (point - self.position).dot(self.forward)
    }

    /// How many metres a picture one metre wide has become at a depth.
    #[inline]
    fn spread(&self, depth: f32) -> f32 {
        if self.is_parallel { 1.0 } else { depth }
    }

    /// From a point to the viewer, unit.
    pub(super) fn direction_from(&self, point: Vec3) -> Vec3 {
        match self.is_parallel {
            true => -self.forward,
            false => (self.position - point).normalize(),
        }
    }

    /// Where a point is in the picture; none where it is behind the viewer.
    pub(super) fn project(&self, point: Vec3) -> Option<Vec2> {
        let offset = point - self.position;
        let spread = self.spread(offset.dot(self.forward));
        if spread <= 1e-4 {
            return None;
        }
        let across = Vec2::new(offset.dot(self.right), -offset.dot(self.up));
        Some(self.middle + self.scale / spread * across)
    }

    /// The point at a depth that is at a place of the picture.
    #[inline]
    fn point(&self, at: Vec2, depth: f32) -> Vec3 {
        let across = self.spread(depth) / self.scale * (at - self.middle);
        self.position + depth * self.forward + across.x * self.right - across.y * self.up
    }

    /// How far from a point what is as near as `d_max` may be in the picture, pixels: a sphere is seen under an angle whose sine is
    /// its radius over its distance, and all around from inside.
    pub(super) fn reach(&self, point: Vec3, d_max: f32) -> f32 {
        let diagonal = 2.0 * self.middle.length();
        let sine = d_max / self.spread(self.depth(point)).max(1e-4);
        let tangent = match self.is_parallel {
            true => sine,
            false => sine / (1.0 - sine * sine).max(1e-6).sqrt(),
        };
        (self.scale * tangent).min(diagonal)
    }
}

/// What is seen at a place.
#[derive(Clone, Copy, Debug)]
struct Depth {
    /// Along the viewing direction, metres.
    depth: f32,
    /// Of the triangle, towards the viewer.
    normal: Vec3,
}

/// What a camera sees, as its depths tell.
#[derive(Clone, Debug)]
pub struct Depths {
    pub(super) eye: Eye,
    /// Of the picture that is asked for, pixels.
    pub(super) picture: [u32; 2],
    /// So many depths along each side of a pixel.
    pub(super) finer: f32,
    /// Pixels that are seen beyond each side of the picture.
    margin: f32,
    /// How many depths there are.
    size: [u32; 2],
    /// Row by row.
    depths: Vec<Option<Depth>>,
}

impl Depths {
    /// What a camera sees in a picture of a size in pixels, and beyond it.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) for parameters out of their range.
    pub fn see<T: Tracer + ?Sized>(
        scene: &Scene,
        tracer: &T,
        camera: &Camera,
        picture: [u32; 2],
        params: &HbaoParams,
    ) -> Result<Self> {
        params.check()?;
        let (eye, finer) = (Eye::new(camera, picture), params.finer as f32);
        let margin = params.margin_of(picture);
        let size = params.depths_of(picture);
        let see = |index: u32| {
            let corner = Vec2::new((index % size[0]) as f32, (index / size[0]) as f32);
            let at = (corner + 0.5) / finer - margin as f32;
            let ray = camera.ray(at, picture[0], picture[1]);
            let point = scene.surface_point(&tracer.closest_hit(&ray)?);
            Some(Depth {
                depth: eye.depth(point.position),
                normal: facing(point.geometric_normal, -ray.direction),
            })
        };
        Ok(Self {
            eye,
            picture,
            finer,
            margin: margin as f32,
            size,
            depths: (0..size[0] * size[1]).into_par_iter().map(see).collect(),
        })
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.depths.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.depths.is_empty()
    }

    /// What is seen nearest to a place: the point and its normal, or none; nothing beyond what is known.
    #[inline]
    pub(super) fn seen(&self, at: Vec2) -> Option<Option<(Vec3, Vec3)>> {
        let pixel = (self.finer * (at + self.margin)).floor();
        let [width, height] = self.size;
        let inside =
            pixel.cmpge(Vec2::ZERO).all() && pixel.x < width as f32 && pixel.y < height as f32;
        if !inside {
            return None;
        }
        let seen = self.depths[pixel.y as usize * width as usize + pixel.x as usize];
        let at = (pixel + 0.5) / self.finer - self.margin;
        Some(seen.map(|seen| (self.eye.point(at, seen.depth), seen.normal)))
    }

    /// How far two depths beside each other are apart at a point, metres.
    #[inline]
    pub(super) fn width(&self, point: Vec3) -> f32 {
        self.eye.spread(self.eye.depth(point)) / (self.eye.scale * self.finer)
    }
}
