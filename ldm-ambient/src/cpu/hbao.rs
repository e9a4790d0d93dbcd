//! Horizon-based ambient occlusion (Bavoil, Sainz, Dimitrov 2008): what the paper compares with. It knows of the scene only what
//! the camera sees.
//!
//! Around the direction to the eye, in planes of equal angles, it marches over the depths up to `d_max` and follows the horizon:
//! how near to that direction surfaces stand. Every sample that raises the horizon adds the part of the hemisphere that it
//! hides. Bavoil's parts are uniform; here they have the cosine of Eq. (1), and his attenuation is that of obscurance, so that
//! both converge to the same.
//!
//! Bavoil turns the planes from pixel to pixel and blurs the picture. Here they are turned from one point of a pixel to the next,
//! and the mean of its points is what maps are compared with, which have as many.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Vec2, Vec3};
use isophote_scene::{Camera, Pinhole, sample::radical_inverse};
use rayon::prelude::*;

use super::{Point, Points, occlusion::Sky, points::place_of};
use crate::{Error, Result};

/// Surfaces that stand less over a point's plane than this, as a sine, are that plane.
const FLAT: f32 = 1e-2;

/// What can be chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HbaoParams {
    /// How far occluders may be, metres; positive and finite.
    pub d_max: f32,
    /// Directions in the picture, 1 to 1024.
    pub directions: u32,
    /// Samples along each at most, 1 to 1024: no two are nearer to each other than a pixel.
    pub steps: u32,
}

impl Default for HbaoParams {
    fn default() -> Self {
        Self {
            d_max: 1.0,
            directions: 16,
            steps: 32,
        }
    }
}

/// The occlusion of every pixel by what a camera sees at one place of each, row by row; there are no bent normals. The points are
/// those of [`Points::from_camera`] for the same camera, size in pixels and sample.
///
/// # Errors
/// [`Error::Parameter`] for parameters out of their range.
pub fn hbao(
    points: &Points,
    camera: &Camera,
    size: [u32; 2],
    sample: u32,
    params: &HbaoParams,
) -> Result<Vec<Sky>> {
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
    let screen = Screen::new(points, camera, size, sample);
    let turn = radical_inverse(2, sample);
    let found: Vec<Sky> = points
        .points
        .par_iter()
        .zip(&points.indices)
        .map(|(point, &index)| horizon(&screen, point, screen.center(index), turn, params))
        .collect();
    let mut skies = vec![Sky::OPEN; screen.points.len()];
    for (sky, &index) in found.into_iter().zip(&points.indices) {
        skies[index as usize] = sky;
    }
    Ok(skies)
}

/// What a camera sees, as its depths tell.
struct Screen {
    size: [u32; 2],
    /// Row by row.
    points: Vec<Option<Vec3>>,
    eye: Pinhole,
    /// Half the picture's height in pixels over the tangent of half the opening.
    scale: f32,
    /// Where in its pixel each point is.
    place: Vec2,
}

impl Screen {
    fn new(points: &Points, camera: &Camera, size: [u32; 2], sample: u32) -> Self {
        let mut seen = vec![None; size[0] as usize * size[1] as usize];
        for (point, &index) in points.points.iter().zip(&points.indices) {
            seen[index as usize] = Some(point.position);
        }
        let eye = camera.pinhole();
        Self {
            size,
            points: seen,
            eye,
            scale: 0.5 * size[1] as f32 / (0.5 * eye.yfov).tan(),
            place: place_of(sample),
        }
    }

    /// Where a pixel's point is in the picture, pixels.
    fn center(&self, index: u32) -> Vec2 {
        Vec2::new((index % self.size[0]) as f32, (index / self.size[0]) as f32) + self.place
    }

    /// Where a point is in the picture; none where it is behind the viewer.
    fn project(&self, point: Vec3) -> Option<Vec2> {
        let offset = point - self.eye.eye;
        let depth = offset.dot(self.eye.forward);
        if depth <= 1e-4 {
            return None;
        }
        let at =
            Vec2::new(offset.dot(self.eye.right), -offset.dot(self.eye.up)) * (self.scale / depth);
        Some(at + 0.5 * Vec2::new(self.size[0] as f32, self.size[1] as f32))
    }

    /// The pixel whose point is nearest to a place.
    fn pixel(&self, at: Vec2) -> Option<usize> {
        let pixel = (at - self.place + 0.5).floor();
        let inside = pixel.cmpge(Vec2::ZERO).all()
            && pixel.x < self.size[0] as f32
            && pixel.y < self.size[1] as f32;
        inside.then(|| (pixel.y as u32 * self.size[0] + pixel.x as u32) as usize)
    }

    /// How far from a position what is as near as `d_max` may be in the picture, pixels: a sphere is seen under an angle whose sine is
    /// its radius over its distance, and all around from inside.
    fn reach(&self, position: Vec3, d_max: f32) -> f32 {
        let diagonal = (self.size[0] as f32).hypot(self.size[1] as f32);
        let sine = d_max / self.eye.depth(position).max(1e-4);
        let tangent = sine / (1.0 - sine * sine).max(1e-6).sqrt();
        (self.scale * tangent).min(diagonal)
    }
}

/// The hemisphere of a pixel's point, in planes that are turned by a part of the angle between two.
fn horizon(screen: &Screen, point: &Point, at: Vec2, turn: f32, params: &HbaoParams) -> Sky {
    let position = point.position;
    let (normal, plane) = (point.shading_normal, point.geometric_normal);
    let reach = screen.reach(position, params.d_max);
    let steps = params.steps.min(reach.ceil() as u32).max(1);
    let view = (screen.eye.eye - position).normalize();
    let (tangent, bitangent) = view.any_orthonormal_pair();
    let (mut hidden, mut attenuated) = (0.0, 0.0);
    for direction in 0..params.directions {
        let angle = TAU * (direction as f32 + turn) / params.directions as f32;
        let side = angle.cos() * tangent + angle.sin() * bitangent;
        let Some(along) = screen.project(position + 1e-2 * params.d_max * side) else {
            continue;
        };
        let along = (along - at).normalize_or_zero();
        let slice = Slice::new(normal.dot(view), normal.dot(side));
        // From the direction to the eye. Nothing comes from below the plane the point lies in either.
        let mut lowest = slice.tangent();
        let below = Slice::new(plane.dot(view), plane.dot(side)).tangent();
        let mut open = slice.openness(lowest);
        if below < lowest {
            let rest = slice.openness(below);
            hidden += open - rest;
            attenuated += open - rest;
            (lowest, open) = (below, rest);
        }
        for step in 1..=steps {
            // Closer steps near the point, where there is more to hide.
            let share = (step as f32 / steps as f32).powi(2);
            let Some(pixel) = screen.pixel(at + along * (share * reach).max(step as f32)) else {
                break;
            };
            let Some(other) = screen.points[pixel] else {
                continue;
            };
            let offset = other - position;
            let distance = offset.length();
            // A pixel's point is beside the slice: what does not stand over the point's plane hides nothing.
            if distance >= params.d_max || offset.dot(plane) <= FLAT * distance {
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
        ao: (1.0 - share * hidden).clamp(0.0, 1.0),
        obscurance: (1.0 - share * attenuated).clamp(0.0, 1.0),
        bent_normal: Vec3::ZERO,
    }
}

/// Half a plane through the direction to the eye: angles are from there, radians.
struct Slice {
    /// Of the normal in the plane: its length, and its angle.
    length: f32,
    angle: f32,
}

impl Slice {
    /// Of the normal's parts towards the eye and across.
    fn new(towards: f32, across: f32) -> Self {
        Self {
            length: towards.hypot(across),
            angle: across.atan2(towards),
        }
    }

    /// The angle of the tangent plane.
    fn tangent(&self) -> f32 {
        self.angle + FRAC_PI_2
    }

    /// How much of the hemisphere lies between the direction to the eye and an angle, by the cosine to the normal, for a unit
    /// of the turn around that direction: ∫ cos(θ − γ) sin θ dθ. All slices together have π.
    fn openness(&self, to: f32) -> f32 {
        let (sine, cosine) = self.angle.sin_cos();
        0.25 * self.length * (cosine - (2.0 * to - self.angle).cos() + 2.0 * to * sine)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use isophote_scene::{
        BuildTracer, BvhOptions, BvhTracer, Selection, builtin,
        reference::Normals,
        sample::{Frame, Sampler, cosine_hemisphere},
    };

    use super::*;

    const SIZE: [u32; 2] = [96, 72];

    /// Whether a ray passes behind nothing that the camera sees until it is as far as `d_max` or leaves the picture; marched.
    fn is_open(screen: &Screen, point: &Point, direction: Vec3, d_max: f32) -> bool {
        const STEPS: u32 = 400;
        for step in 1..=STEPS {
            let at = point.position + d_max * (step as f32 / STEPS as f32).powi(2) * direction;
            let Some(pixel) = screen.project(at).and_then(|at| screen.pixel(at)) else {
                return true;
            };
            let Some(seen) = screen.points[pixel] else {
                continue;
            };
            let over = (seen - point.position).dot(point.geometric_normal);
            let is_before = screen.eye.depth(seen) < screen.eye.depth(at);
            if is_before && over > FLAT * seen.distance(point.position) {
                return false;
            }
        }
        true
    }

    /// Horizons say what rays say that are marched over the same depths, where everything is within reach: how far both are from
    /// the truth is for what a camera does not see. 256 rays alone are off by some 5 grey levels.
    #[test]
    fn horizons_are_what_rays_pass_behind() {
        for (name, d_max) in [("cornell", 2.0), ("office", 20.0)] {
            let scene = Arc::new(builtin::build(name).expect("a scene"));
            let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default());
            let exact = exact.expect("a tracer");
            let camera = &scene.cameras[0];
            let points = Points::from_camera(&scene, &exact, camera, SIZE, 0, Normals::Smooth);
            let screen = Screen::new(&points, camera, SIZE, 0);
            let params = HbaoParams {
                d_max,
                directions: 64,
                steps: 512,
            };
            let skies = hbao(&points, camera, SIZE, 0, &params).expect("occlusion");
            let (mut squares, mut sum, mut all) = (0.0, 0.0, 0.0);
            for (point, &index) in points.points.iter().zip(&points.indices).step_by(5) {
                let frame = Frame::new(point.shading_normal);
                let ray = |number: u32| {
                    let random = Sampler::new(7, index, number).get_2d(0);
                    frame.to_world(cosine_hemisphere(random))
                };
                let open = (0..256).map(ray).filter(|&direction| {
                    direction.dot(point.geometric_normal) > 0.0
                        && is_open(&screen, point, direction, d_max)
                });
                let open = open.count() as f32 / 256.0;
                let off = skies[index as usize].ao - open;
                (squares, sum, all) = (squares + off * off, sum + off, all + open);
            }
            let count = points.len().div_ceil(5) as f32;
            let grey = |value: f32| 255.0 * value;
            let [rms, bias, mean] = [(squares / count).sqrt(), sum / count, all / count].map(grey);
            println!("{name}: {rms} grey levels, bias {bias}, mean {mean}");
            assert!(rms < 7.5 && bias.abs() < 4.0, "{name}: {rms}, bias {bias}");
        }
    }
}
