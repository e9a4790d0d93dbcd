//! Many instances at one node (`EXT_mesh_gpu_instancing`).

use glam::{Affine3A, Quat, Vec3};
use gltf_json::{Value, scene::Node};

use super::{accessor::Floats, document::Document, nodes::unit_quaternion};
use crate::{Instance, Result, load::budget::bytes_of};

impl Document<'_> {
    /// The transforms of a node's instances relative to it, or `None` if it is the only one.
    pub(super) fn instancing(&self, node: &Node) -> Result<Option<Vec<Affine3A>>> {
        let extensions = node.extensions.as_ref();
        let extension = extensions.and_then(|all| all.others.get("EXT_mesh_gpu_instancing"));
        let Some(attributes) = extension.and_then(|all| all.get("attributes")) else {
            return Ok(None);
        };
        let translations = self.instance_attribute::<3>(attributes, "TRANSLATION")?;
        let rotations = self.instance_attribute::<4>(attributes, "ROTATION")?;
        let scales = self.instance_attribute::<3>(attributes, "SCALE")?;
        let counts = [
            translations.as_ref().map(|all| all.count),
            rotations.as_ref().map(|all| all.count),
            scales.as_ref().map(|all| all.count),
        ];
        let Some(count) = counts.into_iter().flatten().min() else {
            return Ok(None);
        };
        if counts.into_iter().flatten().any(|other| other != count) {
            return Err(self.malformed(format!("instances of a node have {counts:?} transforms")));
        }
        let name = node.name.as_ref().map_or(0, String::len);
        let size = 2 * (size_of::<Affine3A>() + size_of::<Instance>() + name);
        self.budget.claim("instances", bytes_of(count, size))?;
        let transform = |i: usize| {
            let rotation = rotations.as_ref().map(|all| all.get(i));
            Affine3A::from_scale_rotation_translation(
                scales.as_ref().map_or(Vec3::ONE, |all| all.get(i).into()),
                rotation.and_then(unit_quaternion).unwrap_or(Quat::IDENTITY),
                translations
                    .as_ref()
                    .map_or(Vec3::ZERO, |all| all.get(i).into()),
            )
        };
        Ok(Some((0..count).map(transform).collect()))
    }

    fn instance_attribute<const N: usize>(
        &self,
        attributes: &Value,
        name: &str,
    ) -> Result<Option<Floats<'_, N>>> {
        let index = attributes.get(name).and_then(Value::as_u64);
        let index = index.and_then(|index| usize::try_from(index).ok());
        index.map(|index| self.floats(index)).transpose()
    }
}
