//! Horizon-based ambient occlusion (Bavoil, Sainz, Dimitrov 2008): what the paper compares with. It knows of the scene only what
//! the camera sees.
//!
//! Around the direction to the eye, in planes of equal angles, it marches over the depths up to `d_max` and follows the horizon:
//! how near to that direction surfaces stand. Every sample that raises the horizon adds the part of the hemisphere that it
//! hides. Bavoil's parts are uniform; here they have the cosine of Eq. (1), so that both converge to the same.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Vec2, Vec3};
use isophote_scene::{Camera, GBuffer};
use rayon::prelude::*;

use super::{occlusion::Sky, photons::Screen};
use crate::{Error, Result};

/// What can be chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HbaoParams {
    /// How far occluders may be, metres; positive and finite.
    pub d_max: f32,
    /// Directions in the picture, 1 to 1024.
    pub directions: u32,
    /// Samples along each, 1 to 1024.
    pub steps: u32,
}

impl Default for HbaoParams {
    fn default() -> Self {
        Self {
            d_max: 1.0,
            directions: 16,
            steps: 24,
        }
    }
}

/// The occlusion of every pixel of what a camera sees, row by row; there are no bent normals.
///
/// # Errors
/// [`Error::Parameter`] for parameters out of their range.
pub fn hbao(seen: &GBuffer, camera: &Camera, params: &HbaoParams) -> Result<Vec<Sky>> {
    if !(params.d_max > 0.0 && params.d_max.is_finite()) {
        return Err(Error::parameter(
            "d_max",
            params.d_max,
            "it must be positive and finite in screen space",
        ));
    }
    for (name, value) in [
        ("the number of directions", params.directions),
        ("the number of steps", params.steps),
    ] {
        if !(1..=1024).contains(&value) {
            return Err(Error::parameter(name, value, "it must be 1 to 1024"));
        }
    }
    let screen = Screen::new(seen, camera);
    let width = seen.size[0] as usize;
    let sky = |(index, seen): (usize, &Option<isophote_scene::Seen>)| {
        let Some(seen) = seen else { return Sky::OPEN };
        let at = Vec2::new((index % width) as f32, (index / width) as f32) + 0.5;
        horizon(&screen, seen.point.position, seen.normal(), at, params)
    };
    Ok(seen.pixels.par_iter().enumerate().map(sky).collect())
}

/// The hemisphere of a pixel's point.
fn horizon(screen: &Screen, point: Vec3, normal: Vec3, at: Vec2, params: &HbaoParams) -> Sky {
    let reach = params.d_max * screen.pixels_per_metre(point);
    let [width, height] = screen.size.map(|side| side as f32);
    let view = (screen.eye() - point).normalize();
    let (tangent, bitangent) = view.any_orthonormal_pair();
    let (mut hidden, mut attenuated) = (0.0, 0.0);
    for direction in 0..params.directions {
        let turn = Vec2::from_angle(TAU * direction as f32 / params.directions as f32);
        let side = turn.x * tangent + turn.y * bitangent;
        let Some(along) = screen.project(point + 1e-2 * params.d_max * side) else {
            continue;
        };
        let along = (along - at).normalize_or_zero();
        let slice = Slice::new(normal.dot(view), normal.dot(side));
        // From the direction to the eye.
        let mut lowest = slice.tangent;
        let mut open = slice.openness(lowest);
        for step in 1..=params.steps {
            // Closer steps near the point, where there is more to hide.
            let share = (step as f32 / params.steps as f32).powi(2);
            let place = at + along * (share * reach).max(step as f32);
            if place.x < 0.0 || place.y < 0.0 || place.x >= width || place.y >= height {
                break;
            }
            let Some((other, _)) = screen.surface(place) else {
                continue;
            };
            let offset = other - point;
            let distance = offset.length();
            // A pixel's centre is beside the slice: what does not stand over the tangent plane hides nothing.
            if distance >= params.d_max || offset.dot(normal) <= 1e-3 * distance {
                continue;
            }
            let angle = (offset.dot(view) / distance).clamp(-1.0, 1.0).acos();
            if angle < lowest {
                let rest = slice.openness(angle);
                hidden += open - rest;
                attenuated += (open - rest) * (1.0 - distance / params.d_max);
                (lowest, open) = (angle, rest);
            }
        }
    }
    let share = 2.0 / params.directions as f32;
    Sky {
        ao: (1.0 - share * hidden).max(0.0),
        obscurance: (1.0 - share * attenuated).max(0.0),
        bent_normal: Vec3::ZERO,
    }
}

/// Half a plane through the direction to the eye: angles are from there, radians.
struct Slice {
    /// Of the normal in the plane: its length, and its angle.
    length: f32,
    angle: f32,
    /// Of the tangent plane.
    tangent: f32,
}

impl Slice {
    /// Of the normal's parts towards the eye and across.
    fn new(towards: f32, across: f32) -> Self {
        let angle = across.atan2(towards);
        Self {
            length: towards.hypot(across),
            angle,
            tangent: angle + FRAC_PI_2,
        }
    }

    /// How much of the hemisphere lies between the direction to the eye and an angle, by the cosine to the normal, for a unit
    /// of the turn around that direction: ∫ cos(θ − γ) sin θ dθ. All slices together have π.
    fn openness(&self, to: f32) -> f32 {
        let (sine, cosine) = self.angle.sin_cos();
        0.25 * self.length * (cosine - (2.0 * to - self.angle).cos() + 2.0 * to * sine)
    }
}
