//! The camera in the user's hands: it flies, and it orbits what it looks at.

use glam::{Mat3, Vec3};
use isophote_scene::{Camera, Projection};

/// A camera that keeps the horizon level.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Viewpoint {
    eye: Vec3,
    /// What is orbited, straight ahead.
    target: Vec3,
    projection: Projection,
}

/// How near the camera may come to looking straight up or down, as the cosine of the angle to the vertical.
const STEEPEST: f32 = 0.998;

impl Viewpoint {
    /// A camera of the scene that looks at something so many metres ahead.
    pub(super) fn of(camera: &Camera, distance: f32) -> Self {
        let pinhole = camera.pinhole();
        let eye = camera.position();
        Self {
            eye,
            target: eye + distance.max(1e-3) * pinhole.forward,
            projection: camera.projection,
        }
    }

    /// As `--camera` takes it.
    pub(super) fn text(&self) -> String {
        let opening = match self.projection {
            Projection::Perspective { yfov } => yfov.to_degrees().to_string(),
            Projection::Orthographic { half_height } => format!("{}m", 2.0 * half_height),
        };
        let ([x, y, z], [u, v, w]) = (self.eye.to_array(), self.target.to_array());
        format!("{x},{y},{z},{u},{v},{w},{opening}")
    }

    fn distance(&self) -> f32 {
        self.eye.distance(self.target)
    }

    fn forward(&self) -> Vec3 {
        (self.target - self.eye).normalize_or(Vec3::NEG_Z)
    }

    fn right(&self) -> Vec3 {
        self.forward().cross(Vec3::Y).normalize_or(Vec3::X)
    }

    /// Turns a direction about +Y and then up, but not over the top; radians.
    fn turned(&self, direction: Vec3, yaw: f32, pitch: f32) -> Vec3 {
        let level = Mat3::from_rotation_y(yaw) * direction;
        let right = Mat3::from_rotation_y(yaw) * self.right();
        let tipped = Mat3::from_axis_angle(right, pitch) * level;
        if tipped.normalize_or_zero().y.abs() > STEEPEST {
            level
        } else {
            tipped
        }
    }

    /// Goes around what is looked at, which stays where it is; radians.
    pub(super) fn orbit(&mut self, yaw: f32, pitch: f32) {
        let forward = self.turned(self.target - self.eye, yaw, pitch);
        self.eye = self.target - forward;
    }

    /// Looks around; radians.
    pub(super) fn look(&mut self, yaw: f32, pitch: f32) {
        let forward = self.turned(self.target - self.eye, yaw, pitch);
        self.target = self.eye + forward;
    }

    /// Moves with the picture's plane, by shares of the picture's height.
    pub(super) fn pan(&mut self, right: f32, up: f32) {
        let height = match self.projection {
            Projection::Perspective { yfov } => 2.0 * self.distance() * (0.5 * yfov).tan(),
            Projection::Orthographic { half_height } => 2.0 * half_height,
        };
        let above = self.right().cross(self.forward());
        self.shift(height * (right * self.right() + up * above));
    }

    /// Comes nearer to what is looked at, or where rays are parallel shows less of it.
    pub(super) fn approach(&mut self, factor: f32) {
        match &mut self.projection {
            Projection::Perspective { .. } => {
                self.eye = self.target + factor * (self.eye - self.target);
            }
            Projection::Orthographic { half_height } => *half_height *= factor,
        }
    }

    /// Flies, by metres to the right, up and ahead.
    pub(super) fn fly(&mut self, metres: Vec3) {
        let [right, up, ahead] = metres.to_array();
        self.shift(right * self.right() + up * Vec3::Y + ahead * self.forward());
    }

    /// Looks straight at something that is to be orbited from now on, or only takes its distance.
    pub(super) fn set_distance(&mut self, metres: f32) {
        if metres.is_finite() && metres > 0.0 {
            self.target = self.eye + metres * self.forward();
        }
    }

    fn shift(&mut self, by: Vec3) {
        self.eye += by;
        self.target += by;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::values;

    fn start() -> Viewpoint {
        let camera = Camera::look_at("", Vec3::new(0.0, 1.0, 4.0), Vec3::Y, 0.8);
        Viewpoint::of(&camera, 4.0)
    }

    #[test]
    fn orbiting_keeps_the_target_and_the_distance() {
        let mut moved = start();
        for _ in 0..100 {
            moved.orbit(0.3, 0.1);
        }
        assert!((moved.target - Vec3::Y).length() < 1e-4);
        assert!((moved.distance() - 4.0).abs() < 1e-3);
        assert!(moved.forward().y.abs() <= STEEPEST + 1e-4);
        assert_ne!(moved.eye, start().eye);
    }

    #[test]
    fn looking_keeps_the_eye() {
        let mut moved = start();
        moved.look(0.5, -0.2);
        assert_eq!(moved.eye, start().eye);
        assert!((moved.distance() - 4.0).abs() < 1e-4);
        // To the left is a turn about +Y.
        assert!(moved.forward().x < 0.0 && moved.forward().y < 0.0);
    }

    #[test]
    fn flying_and_panning_go_where_they_say() {
        let mut moved = start();
        moved.fly(Vec3::new(1.0, 2.0, 3.0));
        assert!((moved.eye - Vec3::new(1.0, 3.0, 1.0)).length() < 1e-5);
        moved.pan(0.0, 0.5);
        let up = 4.0 * 0.4_f32.tan();
        assert!((moved.eye.y - 3.0 - up).abs() < 1e-5);
        moved.approach(0.5);
        assert!((moved.distance() - 2.0).abs() < 1e-5);
    }

    #[test]
    fn the_command_line_takes_what_was_flown_to() {
        let mut moved = start();
        moved.orbit(0.7, 0.2);
        let camera = values::viewpoint(&moved.text()).unwrap();
        assert!((camera.position() - moved.eye).length() < 1e-5);
        assert!((camera.pinhole().forward - moved.forward()).length() < 1e-5);
        let parallel = Viewpoint {
            projection: Projection::Orthographic { half_height: 1.5 },
            ..moved
        };
        let camera = values::viewpoint(&parallel.text()).unwrap();
        assert_eq!(camera.projection, parallel.projection);
    }
}
