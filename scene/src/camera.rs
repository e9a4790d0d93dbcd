//! Cameras and the rays through their pixels.

use glam::{Affine3A, Vec2, Vec3};

use crate::{Aabb, Ray};

/// A pinhole or parallel camera that looks along −Z of its transform with +Y up.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// The name of its node in the file.
    pub name: String,
    /// How it projects.
    pub projection: Projection,
    /// Where it stands and looks; scaling is ignored.
    pub transform: Affine3A,
    /// The node that moves it, if any.
    pub node: Option<u32>,
}

/// How a camera projects. The aspect ratio is always that of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// All rays start in one point.
    Perspective {
        /// Vertical opening angle in radians, within 0..π.
        yfov: f32,
    },
    /// All rays are parallel.
    Orthographic {
        /// Half the height of what is seen, metres.
        half_height: f32,
    },
}

/// Where a camera stands, its unit axes, and how far it opens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Metres.
    pub eye: Vec3,
    /// To the right of the picture.
    pub right: Vec3,
    /// To its top.
    pub up: Vec3,
    /// Where it looks.
    pub forward: Vec3,
    /// Vertical opening angle, radians.
    pub yfov: f32,
}

impl Pinhole {
    /// The distance of a point along the viewing direction, metres.
    pub fn depth(&self, point: Vec3) -> f32 {
        (point - self.eye).dot(self.forward)
    }
}

/// The opening of a pinhole that stands in for a parallel camera, radians.
const NEARLY_PARALLEL: f32 = 0.1;

impl Camera {
    /// A perspective camera at `eye` that looks at `target`; `yfov` in radians.
    pub fn look_at(name: impl Into<String>, eye: Vec3, target: Vec3, yfov: f32) -> Self {
        let forward = (target - eye).normalize_or(Vec3::NEG_Z);
        let up = if forward.y.abs() > 0.999 {
            Vec3::NEG_Z
        } else {
            Vec3::Y
        };
        let right = forward.cross(up).normalize();
        let transform = Affine3A::from_cols(
            right.into(),
            right.cross(forward).into(),
            (-forward).into(),
            eye.into(),
        );
        Self {
            name: name.into(),
            projection: Projection::Perspective { yfov },
            transform,
            node: None,
        }
    }

    /// A camera that sees all of a box, from its front, a little above and to the right.
    pub fn framing(bounds: &Aabb) -> Self {
        let radius = (0.5 * bounds.diagonal()).max(f32::MIN_POSITIVE);
        let yfov = 50_f32.to_radians();
        let eye =
            bounds.center() + Vec3::new(0.5, 0.35, 1.0).normalize() * radius / (0.5 * yfov).sin();
        Self::look_at("auto", eye, bounds.center(), yfov)
    }

    /// Where the camera stands, metres.
    pub fn position(&self) -> Vec3 {
        self.transform.translation.into()
    }

    /// The camera as a pinhole: one that is parallel stands far behind itself with a small opening, for those who compare
    /// depths in pictures.
    pub fn pinhole(&self) -> Pinhole {
        let axis = |axis: glam::Vec3A, other| Vec3::from(axis).normalize_or(other);
        let axes = self.transform.matrix3;
        let forward = -axis(axes.z_axis, Vec3::Z);
        let (eye, yfov) = match self.projection {
            Projection::Perspective { yfov } => (self.position(), yfov.clamp(0.001, 3.1)),
            Projection::Orthographic { half_height } => {
                let behind = half_height.abs() / (0.5 * NEARLY_PARALLEL).tan();
                (self.position() - behind * forward, NEARLY_PARALLEL)
            }
        };
        Pinhole {
            eye,
            right: axis(axes.x_axis, Vec3::X),
            up: axis(axes.y_axis, Vec3::Y),
            forward,
            yfov,
        }
    }

    /// The ray through a point of the image in pixels, (0, 0) being the top left corner of the top left pixel.
    pub fn ray(&self, at: Vec2, width: u32, height: u32) -> Ray {
        let size = Vec2::new(width as f32, height as f32);
        let ndc = (2.0 * at - size) / size.y * Vec2::new(1.0, -1.0);
        let matrix = glam::Mat3::from_cols(
            Vec3::from(self.transform.matrix3.x_axis).normalize_or(Vec3::X),
            Vec3::from(self.transform.matrix3.y_axis).normalize_or(Vec3::Y),
            Vec3::from(self.transform.matrix3.z_axis).normalize_or(Vec3::Z),
        );
        match self.projection {
            Projection::Perspective { yfov } => {
                let half = (0.5 * yfov).tan();
                let direction = matrix * (ndc * half).extend(-1.0);
                Ray::new(self.position(), direction.normalize())
            }
            Projection::Orthographic { half_height } => {
                let origin = self.position() + matrix * (ndc * half_height).extend(0.0);
                Ray::new(origin, -matrix.z_axis)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixel_zero_is_top_left() {
        let camera = Camera::look_at("", Vec3::ZERO, Vec3::NEG_Z, std::f32::consts::FRAC_PI_2);
        let corner = camera.ray(Vec2::ZERO, 200, 100).direction;
        let expected = Vec3::new(-2.0, 1.0, -1.0).normalize();
        assert!((corner - expected).length() < 1e-6, "{corner}");
        let center = camera.ray(Vec2::new(100.0, 50.0), 200, 100).direction;
        assert!((center - Vec3::NEG_Z).length() < 1e-6);
    }

    #[test]
    fn framing_sees_every_corner() {
        let bounds = Aabb {
            min: Vec3::new(-3.0, 1.0, 2.0),
            max: Vec3::new(5.0, 2.0, 40.0),
        };
        let camera = Camera::framing(&bounds);
        let inverse = camera.transform.inverse();
        for corner in bounds.corners() {
            let local = inverse.transform_point3(corner);
            assert!(local.z < 0.0 && (local.y / -local.z).abs() < 25_f32.to_radians().tan());
        }
    }
}
