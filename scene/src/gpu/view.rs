//! How space is projected onto a picture: by a camera, or by a light for its shadow map.

use bytemuck::{Pod, Zeroable};
use glam::{Mat3, Vec2, Vec3};

use crate::{Aabb, Camera, Projection};

/// A camera in a picture, as `scene::view::View` of shaders: a part of a technique's uniforms.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct View {
    pub(super) right: Vec3,
    pub(super) half_width: f32,
    pub(super) up: Vec3,
    pub(super) half_height: f32,
    pub(super) forward: Vec3,
    pub(super) range: f32,
    pub(super) origin: Vec3,
    pub(super) perspective: u32,
    pub(super) size: Vec2,
    pub(super) padding: Vec2,
}

/// The nearest that is seen, as a part of the scene's diagonal: small enough that nothing is missed. Clip depth is this
/// over the depth, whose relative precision does not depend on it.
const NEAR: f32 = 1e-5;

impl View {
    /// What a camera sees of a scene in a picture of some size in pixels.
    pub fn of_camera(camera: &Camera, [width, height]: [u32; 2], scene: &Aabb) -> Self {
        let matrix = camera.transform.matrix3;
        let axes = Mat3::from_cols(
            Vec3::from(matrix.x_axis).normalize_or(Vec3::X),
            Vec3::from(matrix.y_axis).normalize_or(Vec3::Y),
            -Vec3::from(matrix.z_axis).normalize_or(Vec3::Z),
        );
        let size = Vec2::new(width as f32, height as f32);
        let (half, perspective) = match camera.projection {
            Projection::Perspective { yfov } => ((0.5 * yfov).tan(), true),
            Projection::Orthographic { half_height } => (half_height, false),
        };
        let half = Vec2::new(half * size.x / size.y, half);
        Self::new(axes, camera.position(), half, size, perspective, scene)
    }

    /// `axes` are right, up and forward.
    pub(super) fn new(
        axes: Mat3,
        origin: Vec3,
        half: Vec2,
        size: Vec2,
        perspective: bool,
        scene: &Aabb,
    ) -> Self {
        let range = if perspective {
            NEAR * scene.diagonal()
        } else {
            // A little more, so that the farthest is also seen.
            let depths = scene
                .corners()
                .map(|corner| 1.01 * axes.z_axis.dot(corner - origin));
            depths.into_iter().fold(0.0, f32::max)
        };
        Self {
            right: axes.x_axis,
            half_width: half.x,
            up: axes.y_axis,
            half_height: half.y,
            forward: axes.z_axis,
            range: range.max(f32::MIN_POSITIVE),
            origin,
            perspective: u32::from(perspective),
            size,
            padding: Vec2::ZERO,
        }
    }
}
