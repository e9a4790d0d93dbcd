//! Moving nodes (glTF 2.0 §3.11).

use std::collections::{HashMap, HashSet};

use glam::{Quat, Vec3};
use gltf_json::{
    animation::{Channel as JsonChannel, Interpolation as JsonInterpolation, Property, Sampler},
    validation::Checked,
};

use super::{document::Document, nodes::unit_quaternion};
use crate::{
    Channel, Interpolation, Keys, Local, Node, Result, Track, clean::LARGEST_COORDINATE,
    load::budget::bytes_of,
};

/// The channels of all animations that move a node of the scene; where two move the same, the first holds.
pub(super) fn load(
    document: &Document<'_>,
    nodes: &[Node],
    index_of: &HashMap<usize, u32>,
) -> Result<Vec<Channel>> {
    let mut channels = Vec::new();
    let mut taken = HashSet::new();
    for animation in &document.root.animations {
        for channel in &animation.channels {
            let Checked::Valid(property) = channel.target.path else {
                document.warn("an animation moves an unknown property; it is ignored");
                continue;
            };
            if property == Property::MorphTargetWeights {
                document.warn("animated morph targets are ignored");
                continue;
            }
            let target = channel.target.node.value();
            document.item(&document.root.nodes, "node", target)?;
            let Some(&node) = index_of.get(&target) else {
                continue;
            };
            if matches!(nodes[node as usize].local, Local::Matrix(_)) {
                document.warn(format!("node {target} has a matrix and cannot be animated"));
                continue;
            }
            if !taken.insert((node, property as u8)) {
                document.warn("several animations move the same node; the first one holds");
                continue;
            }
            if let Some(track) = document.track(channel, &animation.samplers, property)? {
                channels.push(Channel { node, track });
            }
        }
    }
    Ok(channels)
}

impl Document<'_> {
    fn track(
        &self,
        channel: &JsonChannel,
        samplers: &[Sampler],
        property: Property,
    ) -> Result<Option<Track>> {
        let sampler = self.item(samplers, "animation sampler", channel.sampler.value())?;
        let vector = |value: [f32; 3]| {
            let largest = Vec3::splat(LARGEST_COORDINATE);
            Some(Vec3::from(value)).filter(|value| value.abs().cmple(largest).all())
        };
        let quaternion = |value: [f32; 4]| Some(Quat::from_array(value)).filter(|q| q.is_finite());
        let track = match property {
            Property::Translation => self.keys(sampler, vector)?.map(Track::Translation),
            Property::Scale => self.keys(sampler, vector)?.map(Track::Scale),
            Property::Rotation => self
                .keys(sampler, quaternion)?
                .and_then(unit_keys)
                .map(Track::Rotation),
            Property::MorphTargetWeights => return Ok(None),
        };
        if track.is_none() {
            self.warn(format!(
                "the animation of node {} has no valid keys; it is ignored",
                channel.target.node.value()
            ));
        }
        Ok(track)
    }

    /// The keys of a sampler, or `None` where they are not finite or not as many as the times.
    fn keys<const N: usize, T>(
        &self,
        sampler: &Sampler,
        convert: impl Fn([f32; N]) -> Option<T>,
    ) -> Result<Option<Keys<T>>> {
        let interpolation = match sampler.interpolation {
            Checked::Valid(JsonInterpolation::Step) => Interpolation::Step,
            Checked::Valid(JsonInterpolation::Linear) => Interpolation::Linear,
            Checked::Valid(JsonInterpolation::CubicSpline) => Interpolation::CubicSpline,
            Checked::Invalid => return Ok(None),
        };
        let per_key = match interpolation {
            Interpolation::CubicSpline => 3,
            _ => 1,
        };
        let times = self.floats::<1>(sampler.input.value())?;
        let values = self.floats::<N>(sampler.output.value())?;
        if times.count == 0 || Some(values.count) != times.count.checked_mul(per_key) {
            return Ok(None);
        }
        self.budget.claim(
            "an animation",
            bytes_of(times.count, 4).saturating_add(bytes_of(values.count, 16)),
        )?;
        let values: Option<Vec<T>> = values.iter().map(convert).collect();
        let mut keys = Keys {
            interpolation,
            times: times.iter().map(|[time]| time).collect(),
            values: match values {
                Some(values) => values,
                None => return Ok(None),
            },
        };
        let finite = keys.times.iter().all(|time| time.is_finite());
        if !finite || !keys.times.is_sorted_by(|a, b| a < b) {
            self.warn("keys of an animation that are not later than those before are ignored");
            keep_increasing(&mut keys, per_key);
        }
        Ok((!keys.times.is_empty()).then_some(keys))
    }
}

/// Drops the keys that do not lie after all earlier ones; also NaN, which lies after nothing.
fn keep_increasing<T>(keys: &mut Keys<T>, per_key: usize) {
    let mut last = f32::NEG_INFINITY;
    let keep: Vec<bool> = keys
        .times
        .iter()
        .map(|&time| {
            let later = time > last && time.is_finite();
            if later {
                last = time;
            }
            later
        })
        .collect();
    let mut flags = keep.iter().copied();
    keys.times.retain(|_| flags.next().unwrap_or(false));
    let mut flags = keep
        .iter()
        .flat_map(|&flag| std::iter::repeat_n(flag, per_key));
    keys.values.retain(|_| flags.next().unwrap_or(false));
}

/// Makes the values unit quaternions; tangents stay as they are.
fn unit_keys(mut keys: Keys<Quat>) -> Option<Keys<Quat>> {
    let is_tangent = |i: usize| keys.interpolation == Interpolation::CubicSpline && i % 3 != 1;
    let values = keys.values.iter().enumerate().map(|(i, &value)| {
        if is_tangent(i) {
            Some(value)
        } else {
            unit_quaternion(value.to_array())
        }
    });
    keys.values = values.collect::<Option<_>>()?;
    Some(keys)
}
