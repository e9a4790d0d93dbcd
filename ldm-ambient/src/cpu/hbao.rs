//! Horizon-based ambient occlusion (Bavoil, Sainz, Dimitrov 2008): what the paper compares with. It knows of the scene only what
//! the camera sees.
//!
//! In some directions of the picture it marches over the depths up to `d_max` and follows the horizon: how high surfaces stand
//! above the point's tangent plane. Every sample that raises the horizon adds the part of the hemisphere that it hides.
//! Bavoil's parts are uniform over the elevation; here they have the cosine of Eq. (1), so that both converge to the same.

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
    let (mut hidden, mut attenuated) = (0.0, 0.0);
    for direction in 0..params.directions {
        let turn = std::f32::consts::TAU * direction as f32 / params.directions as f32;
        let along = Vec2::from_angle(turn);
        // The sine of the horizon's elevation.
        let mut highest = 0.0_f32;
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
            let sine = offset.dot(normal) / distance;
            if distance < params.d_max && sine > highest {
                let part = sine * sine - highest * highest;
                hidden += part;
                attenuated += part * (1.0 - distance / params.d_max);
                highest = sine;
            }
        }
    }
    let share = 1.0 / params.directions as f32;
    Sky {
        ao: 1.0 - share * hidden,
        obscurance: 1.0 - share * attenuated,
        bent_normal: Vec3::ZERO,
    }
}
