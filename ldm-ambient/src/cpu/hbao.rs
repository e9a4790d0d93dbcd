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
//!
//! Three things make it a fair baseline where `d_max` is only a few pixels. In Sponza and Sibenik, with 0.25 m and 320x240 pixels,
//! it is off by 8.9 and 11.5 grey levels without them. With depths beyond the picture ([`HbaoParams::margin`]) it is by 8.7 and 11.4,
//! with twice as many along each side of a pixel ([`HbaoParams::finer`]) by 6.7 and 8.0, and by 5.1 and 6.7 with surfaces that leave
//! the reach between two samples and hide what is below that place. Other distances between samples, more of them, places
//! in the planes of what is seen and occluders that are not infinitely thick change that by 0.2 at most.

mod depths;

use std::f32::consts::{FRAC_PI_2, SQRT_2, TAU};

use glam::Vec3;
use isophote_scene::sample::radical_inverse;
use rayon::prelude::*;

pub use self::depths::Depths;
#[cfg(feature = "gpu")]
pub(crate) use self::depths::Eye;
use super::{Point, Points, occlusion::Sky};
use crate::{Error, Result};

/// Surfaces that stand less over a point's plane than this, as a sine, are that plane.
const FLAT: f32 = 1e-2;

/// What planes are turned by at the first point, as a part of the angle between two: the root of 2, far from all simple fractions.
const FIRST_TURN: f32 = SQRT_2 - 1.0;

/// Two samples are of one surface where the first is at most so many widths of a depth from the plane of the second.
const JOINED: f32 = 2.0;

/// What can be chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HbaoParams {
    /// How far occluders may be, metres; positive and finite.
    pub d_max: f32,
    /// Directions in the picture, 1 to 1024.
    pub directions: u32,
    /// Samples along each at most, 1 to 1024: no two are nearer to each other than depths are.
    pub steps: u32,
    /// Depths along each side of a pixel, 1 to 8.
    pub finer: u32,
    /// How far beyond each side of the picture depths are known, as a part of its height, 0 to 1.
    pub margin: f32,
}

impl Default for HbaoParams {
    fn default() -> Self {
        Self {
            d_max: 1.0,
            directions: 16,
            steps: 32,
            finer: 2,
            margin: 0.1,
        }
    }
}

impl HbaoParams {
    pub(crate) fn check(&self) -> Result<()> {
        if !(self.d_max > 0.0 && self.d_max.is_finite()) {
            let expected = "it must be positive and finite in screen space";
            return Err(Error::parameter("d_max", self.d_max, expected));
        }
        for (name, value) in [
            ("the number of directions", self.directions),
            ("the number of steps", self.steps),
        ] {
            if !(1..=1024).contains(&value) {
                return Err(Error::parameter(name, value, "it must be 1 to 1024"));
            }
        }
        if !(1..=8).contains(&self.finer) {
            let name = "how much finer than pixels depths are";
            return Err(Error::parameter(name, self.finer, "it must be 1 to 8"));
        }
        if !(0.0..=1.0).contains(&self.margin) {
            let name = "the part of the picture that is known beyond it";
            return Err(Error::parameter(name, self.margin, "it must be 0 to 1"));
        }
        Ok(())
    }

    /// Pixels beyond each side of a picture.
    pub(crate) fn margin_of(&self, picture: [u32; 2]) -> u32 {
        (self.margin * picture[1] as f32).ceil() as u32
    }

    /// How many depths a picture needs, each way.
    pub(crate) fn depths_of(&self, picture: [u32; 2]) -> [u32; 2] {
        let margin = self.margin_of(picture);
        picture.map(|side| self.finer * (side + 2 * margin))
    }
}

/// The occlusion of every pixel by what a camera sees at one place of each, row by row; there are no bent normals. The points are
/// those of [`Points::from_camera`] for the depths' camera and size in pixels and this sample.
///
/// # Errors
/// [`Error::Parameter`] for parameters out of their range.
pub fn hbao(
    points: &Points,
    depths: &Depths,
    sample: u32,
    params: &HbaoParams,
) -> Result<Vec<Sky>> {
    params.check()?;
    let turn = turn(sample);
    let found: Vec<Sky> = points
        .points
        .par_iter()
        .map(|point| horizon(depths, point, turn, params))
        .collect();
    let [width, height] = depths.picture.map(|side| side as usize);
    let mut skies = vec![Sky::OPEN; width * height];
    for (sky, &index) in found.into_iter().zip(&points.indices) {
        if let Some(pixel) = skies.get_mut(index as usize) {
            *pixel = sky;
        }
    }
    Ok(skies)
}

/// By which part of the angle between two planes they are turned. Never along rows, where depths are on the edge between two.
pub(crate) fn turn(sample: u32) -> f32 {
    (radical_inverse(2, sample) + FIRST_TURN).fract()
}

/// The hemisphere of a pixel's point, in planes that are turned by a part of the angle between two.
fn horizon(depths: &Depths, point: &Point, turn: f32, params: &HbaoParams) -> Sky {
    let position = point.position;
    let (normal, plane) = (point.shading_normal, point.geometric_normal);
    let Some(at) = depths.eye.project(position) else {
        return Sky::OPEN;
    };
    let reach = depths.eye.reach(position, params.d_max);
    let steps = (reach * depths.finer)
        .ceil()
        .min(params.steps as f32)
        .max(1.0);
    let view = depths.eye.direction_from(position);
    // From the picture's axis, so that planes turn alike at all points of a pixel.
    let tangent = depths.eye.right.reject_from_normalized(view).normalize();
    let bitangent = view.cross(tangent);
    let (mut hidden, mut attenuated) = (0.0, 0.0);
    for direction in 0..params.directions {
        let angle = TAU * (direction as f32 + turn) / params.directions as f32;
        let side = angle.cos() * tangent + angle.sin() * bitangent;
        let Some(along) = depths.eye.project(position + 1e-2 * params.d_max * side) else {
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
        let mut reached = Reached::default();
        for step in 1..=steps as u32 {
            // Closer steps near the point, where there is more to hide.
            let share = (step as f32 / steps).powi(2);
            let far = (share * reach).max(step as f32 / depths.finer);
            let Some(seen) = depths.seen(at + far * along) else {
                break;
            };
            let Some(offset) = reached.next(depths, position, seen, params.d_max) else {
                continue;
            };
            let distance = offset.length();
            // What is seen may be beside the slice: what does not stand over the point's plane hides nothing.
            if offset.dot(plane) <= FLAT * distance {
                continue;
            }
            let angle = (offset.dot(view) / distance).clamp(-1.0, 1.0).acos();
            if angle < lowest {
                let rest = slice.openness(angle);
                hidden += open - rest;
                attenuated += (open - rest) * (1.0 - distance / params.d_max).max(0.0);
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

/// Follows the surfaces along a slice, as far as `d_max` reaches.
#[derive(Default)]
struct Reached {
    /// The last sample if it was within reach, from the point.
    last: Option<Vec3>,
}

impl Reached {
    /// What of the next sample is within reach, from the point: itself, or where the surface that it shares with the last one leaves.
    fn next(
        &mut self,
        depths: &Depths,
        position: Vec3,
        seen: Option<(Vec3, Vec3)>,
        d_max: f32,
    ) -> Option<Vec3> {
        let last = self.last.take();
        let (other, facing) = seen?;
        let offset = other - position;
        if offset.length_squared() < d_max * d_max {
            self.last = Some(offset);
            return self.last;
        }
        let last = last?;
        let between = offset - last;
        if between.dot(facing).abs() > JOINED * depths.width(other) {
            return None;
        }
        let (all, half) = (between.length_squared(), last.dot(between));
        let inside = d_max * d_max - last.length_squared();
        let share = ((half * half + all * inside).sqrt() - half) / all;
        Some(last + share.clamp(0.0, 1.0) * between)
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

    use glam::Affine3A;
    use isophote_scene::{
        BuildTracer, BvhOptions, BvhTracer, Selection, builtin,
        reference::Normals,
        sample::{Frame, Sampler, cosine_hemisphere},
    };

    use super::*;

    const SIZE: [u32; 2] = [96, 72];

    /// Whether a ray passes behind nothing that the camera sees until it is as far as `d_max` or leaves the picture; marched.
    fn is_open(depths: &Depths, point: &Point, direction: Vec3, d_max: f32) -> bool {
        const STEPS: u32 = 400;
        for step in 1..=STEPS {
            let at = point.position + d_max * (step as f32 / STEPS as f32).powi(2) * direction;
            let Some(seen) = depths.eye.project(at).and_then(|at| depths.seen(at)) else {
                return true;
            };
            let Some((seen, _)) = seen else {
                continue;
            };
            let over = (seen - point.position).dot(point.geometric_normal);
            let is_before = depths.eye.depth(seen) < depths.eye.depth(at);
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
            let params = HbaoParams {
                d_max,
                directions: 64,
                steps: 512,
                // A point is in the middle of a depth, so that none of those around it is far beside a slice.
                finer: 3,
                ..HbaoParams::default()
            };
            let depths = Depths::see(&scene, &exact, camera, SIZE, &params).expect("depths");
            let skies = hbao(&points, &depths, 0, &params).expect("occlusion");
            let (mut squares, mut sum, mut all) = (0.0, 0.0, 0.0);
            for (point, &index) in points.points.iter().zip(&points.indices).step_by(5) {
                let frame = Frame::new(point.shading_normal);
                let ray = |number: u32| {
                    let random = Sampler::new(7, index, number).get_2d(0);
                    frame.to_world(cosine_hemisphere(random))
                };
                let open = (0..256).map(ray).filter(|&direction| {
                    direction.dot(point.geometric_normal) > 0.0
                        && is_open(&depths, point, direction, d_max)
                });
                let open = open.count() as f32 / 256.0;
                let off = skies[index as usize].ao - open;
                (squares, sum, all) = (squares + off * off, sum + off, all + open);
            }
            let count = points.len().div_ceil(5) as f32;
            let grey = |value: f32| 255.0 * value;
            let [rms, bias, mean] = [(squares / count).sqrt(), sum / count, all / count].map(grey);
            println!("{name}: {rms} grey levels, bias {bias}, mean {mean}");
            assert!(rms < 4.5 && bias.abs() < 1.0, "{name}: {rms}, bias {bias}");
        }
    }

    /// No axis of the world is special, in a sample either: where one is, it shows as a line in the picture.
    #[test]
    fn turning_the_world_changes_nothing() {
        let params = HbaoParams {
            directions: 4,
            ..HbaoParams::default()
        };
        let pictures = [0.0, 0.3, 1.6].map(|angle| {
            let turn = Affine3A::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), angle);
            let mut scene = builtin::build("cornell").expect("a scene");
            for instance in &mut scene.instances {
                instance.transform = turn * instance.transform;
            }
            scene.cameras[0].transform = turn * scene.cameras[0].transform;
            let scene = Arc::new(scene);
            let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default());
            let exact = exact.expect("a tracer");
            let camera = &scene.cameras[0];
            let points = Points::from_camera(&scene, &exact, camera, SIZE, 0, Normals::Smooth);
            let depths = Depths::see(&scene, &exact, camera, SIZE, &params).expect("depths");
            hbao(&points, &depths, 0, &params).expect("occlusion")
        });
        for turned in &pictures[1..] {
            let pairs = turned.iter().zip(&pictures[0]);
            let squares: f32 = pairs.map(|(a, b)| (a.ao - b.ao).powi(2)).sum();
            let rms = 255.0 * (squares / turned.len() as f32).sqrt();
            println!("{rms} grey levels");
            assert!(rms < 0.2, "{rms} grey levels");
        }
    }
}
