//! The node hierarchy and its rigid animation, sampled at a time (glTF 2.0 §3.11 and appendix C).

use glam::{Affine3A, Quat, Vec3};

/// The nodes of a scene and the tracks that move them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Animation {
    /// The nodes, every parent before its children.
    pub nodes: Vec<Node>,
    /// What moves.
    pub channels: Vec<Channel>,
}

/// A place in the hierarchy.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// The name in the file; may be empty.
    pub name: String,
    /// Index of the parent, smaller than the node's own; `None` at the root.
    pub parent: Option<u32>,
    /// Relative to the parent.
    pub local: Local,
}

/// A node's transform relative to its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Local {
    /// Given whole.
    Matrix(Affine3A),
    /// Given in parts: scaled, then rotated, then moved. Only these can be animated.
    Parts {
        /// Metres.
        translation: Vec3,
        /// Unit quaternion.
        rotation: Quat,
        /// Factors.
        scale: Vec3,
    },
}

impl Local {
    /// No transform.
    pub const IDENTITY: Self = Self::Parts {
        translation: Vec3::ZERO,
        rotation: Quat::IDENTITY,
        scale: Vec3::ONE,
    };

    fn affine(self) -> Affine3A {
        match self {
            Self::Matrix(matrix) => matrix,
            Self::Parts {
                translation,
                rotation,
                scale,
            } => Affine3A::from_scale_rotation_translation(scale, rotation, translation),
        }
    }
}

/// One property of one node over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Index in [`Animation::nodes`].
    pub node: u32,
    /// What changes, and how.
    pub track: Track,
}

/// The values of a property at its key times.
#[derive(Clone, Debug, PartialEq)]
pub enum Track {
    /// Metres.
    Translation(Keys<Vec3>),
    /// Unit quaternions.
    Rotation(Keys<Quat>),
    /// Factors.
    Scale(Keys<Vec3>),
}

/// Key times and values. For cubic splines every key has three values: in-tangent, value, out-tangent.
#[derive(Clone, Debug, PartialEq)]
pub struct Keys<T> {
    /// How to get from key to key.
    pub interpolation: Interpolation,
    /// Seconds, increasing, at least one.
    pub times: Vec<f32>,
    /// One per time, or three for [`Interpolation::CubicSpline`].
    pub values: Vec<T>,
}

/// How values between two keys come about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// The earlier key's value.
    Step,
    /// Linear; spherical linear for rotations.
    Linear,
    /// Cubic Hermite spline.
    CubicSpline,
}

impl Animation {
    /// Where all nodes are in the world at a time in seconds; before the first and after the last key they rest.
    /// Scales may be 0, which hides what is there.
    pub fn world_transforms(&self, seconds: f32) -> Vec<Affine3A> {
        let mut locals: Vec<Local> = self.nodes.iter().map(|node| node.local).collect();
        for channel in &self.channels {
            // A node with a matrix cannot be animated (glTF 2.0 §3.11).
            if let Some(Local::Parts {
                translation,
                rotation,
                scale,
            }) = locals.get_mut(channel.node as usize)
            {
                match &channel.track {
                    Track::Translation(keys) => *translation = keys.sample(seconds, Vec3::lerp),
                    Track::Scale(keys) => *scale = keys.sample(seconds, Vec3::lerp),
                    Track::Rotation(keys) => {
                        let sampled = keys.sample(seconds, slerp);
                        // A spline may pass through 0, which is no rotation.
                        let length = sampled.length();
                        if length.is_normal() {
                            *rotation = sampled / length;
                        }
                    }
                }
            }
        }
        let mut world: Vec<Affine3A> = Vec::with_capacity(locals.len());
        for (node, local) in self.nodes.iter().zip(locals) {
            let parent = node
                .parent
                .map_or(Affine3A::IDENTITY, |parent| world[parent as usize]);
            world.push(parent * local.affine());
        }
        world
    }

    /// Which nodes move: those with a channel and all below them.
    pub fn moving(&self) -> Vec<bool> {
        let mut moving = vec![false; self.nodes.len()];
        for channel in &self.channels {
            if let Some(flag) = moving.get_mut(channel.node as usize) {
                *flag = true;
            }
        }
        for (index, node) in self.nodes.iter().enumerate() {
            moving[index] |= node.parent.is_some_and(|parent| moving[parent as usize]);
        }
        moving
    }

    /// The time of the last key in seconds; 0 without animation.
    pub fn duration(&self) -> f32 {
        let last = |channel: &Channel| {
            let times = match &channel.track {
                Track::Translation(keys) | Track::Scale(keys) => &keys.times,
                Track::Rotation(keys) => &keys.times,
            };
            times.last().copied().unwrap_or(0.0)
        };
        self.channels.iter().map(last).fold(0.0, f32::max)
    }
}

fn slerp(a: Quat, b: Quat, weight: f32) -> Quat {
    a.slerp(b, weight)
}

impl<T: Copy + std::ops::Add<Output = T> + std::ops::Mul<f32, Output = T>> Keys<T> {
    fn sample(&self, seconds: f32, lerp: impl Fn(T, T, f32) -> T) -> T {
        let cubic = self.interpolation == Interpolation::CubicSpline;
        let value = |key: usize| self.values[if cubic { 3 * key + 1 } else { key }];
        let next = self.times.partition_point(|&time| time <= seconds);
        if next == 0 {
            return value(0);
        }
        if next == self.times.len() {
            return value(next - 1);
        }
        let (key, span) = (next - 1, self.times[next] - self.times[next - 1]);
        let s = (seconds - self.times[key]) / span;
        match self.interpolation {
            Interpolation::Step => value(key),
            Interpolation::Linear => lerp(value(key), value(next), s),
            Interpolation::CubicSpline => {
                let (s2, s3) = (s * s, s * s * s);
                let (out_tangent, in_tangent) = (self.values[3 * key + 2], self.values[3 * next]);
                value(key) * (2.0 * s3 - 3.0 * s2 + 1.0)
                    + out_tangent * (span * (s3 - 2.0 * s2 + s))
                    + value(next) * (3.0 * s2 - 2.0 * s3)
                    + in_tangent * (span * (s3 - s2))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_follow_their_parents() {
        let keys = Keys {
            interpolation: Interpolation::Linear,
            times: vec![1.0, 3.0],
            values: vec![Vec3::ZERO, Vec3::X * 4.0],
        };
        let child = Local::Matrix(Affine3A::from_translation(Vec3::Y));
        let animation = Animation {
            nodes: vec![
                Node {
                    name: "a".into(),
                    parent: None,
                    local: Local::IDENTITY,
                },
                Node {
                    name: "b".into(),
                    parent: Some(0),
                    local: child,
                },
                Node {
                    name: "c".into(),
                    parent: None,
                    local: child,
                },
            ],
            channels: vec![Channel {
                node: 0,
                track: Track::Translation(keys),
            }],
        };
        let at = |seconds| Vec3::from(animation.world_transforms(seconds)[1].translation);
        assert_eq!(at(0.0), Vec3::Y);
        assert_eq!(at(2.0), Vec3::new(2.0, 1.0, 0.0));
        assert_eq!(at(9.0), Vec3::new(4.0, 1.0, 0.0));
        assert_eq!(animation.moving(), [true, true, false]);
        assert_eq!(animation.duration(), 3.0);
    }

    #[test]
    fn every_time_gives_a_transform() {
        let spline = |zero: Quat| Keys {
            interpolation: Interpolation::CubicSpline,
            times: vec![0.0, 1.0],
            values: vec![zero, Quat::IDENTITY, zero, zero, -Quat::IDENTITY, zero],
        };
        let shrinking = Keys {
            interpolation: Interpolation::Linear,
            times: vec![0.0, 1.0],
            values: vec![Vec3::ONE, Vec3::NEG_ONE],
        };
        let node = Node {
            name: String::new(),
            parent: None,
            local: Local::IDENTITY,
        };
        let channel = |track| Channel { node: 0, track };
        let animation = Animation {
            nodes: vec![node],
            channels: vec![
                channel(Track::Rotation(spline(Quat::from_array([0.0; 4])))),
                channel(Track::Scale(shrinking)),
            ],
        };
        // Halfway the rotation is no quaternion and the scale is 0.
        for seconds in [0.0, 0.5, 1.0] {
            let transform = animation.world_transforms(seconds)[0];
            assert!(transform.is_finite(), "{seconds}: {transform:?}");
            assert_eq!(transform.matrix3.x_axis.x, 1.0 - 2.0 * seconds);
        }
    }
}
