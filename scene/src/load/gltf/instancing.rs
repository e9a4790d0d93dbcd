//! Many instances at one node (`EXT_mesh_gpu_instancing`).

use glam::{Affine3A, Quat, Vec3};
use gltf_json::{Value, accessor::ComponentType, scene::Node, validation::Checked};

use super::{accessor::Floats, document::Document, nodes::unit_quaternion};
use crate::{Instance, Result, load::budget::bytes_of};

/// The one attribute that may be of integers.
const ROTATION: &str = "ROTATION";

impl Document<'_> {
    /// The transforms of a node's instances relative to it, or `None` if it is the only one.
    pub(super) fn instancing(&self, node: &Node) -> Result<Option<Vec<Affine3A>>> {
        let extensions = node.extensions.as_ref();
        let extension = extensions.and_then(|all| all.others.get("EXT_mesh_gpu_instancing"));
        let Some(attributes) = extension.and_then(|all| all.get("attributes")) else {
            return Ok(None);
        };
        let translations = self.instance_attribute::<3>(attributes, "TRANSLATION")?;
        let rotations = self.instance_attribute::<4>(attributes, ROTATION)?;
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
            let counts = counts.map(|count| count.map_or("no".to_owned(), |n| n.to_string()));
            let [translations, rotations, scales] = counts;
            return Err(self.malformed(format!(
                "the instances of node '{}' have {translations} translations, {rotations} rotations and {scales} scales; as many of \
                 each belong there, or none",
                node.name.as_deref().unwrap_or_default()
            )));
        }
        let name = node.name.as_ref().map_or(0, String::len);
        let size = 2 * (size_of::<Affine3A>() + size_of::<Instance>() + name);
        self.budget.claim("instances", bytes_of(count, size))?;
        let rotation = |i: usize| {
            let Some(rotations) = &rotations else {
                return Quat::IDENTITY;
            };
            unit_quaternion(rotations.get(i)).unwrap_or_else(|| {
                self.warn("instances of nodes have no valid rotation; it is ignored");
                Quat::IDENTITY
            })
        };
        let transform = |i: usize| {
            Affine3A::from_scale_rotation_translation(
                scales.as_ref().map_or(Vec3::ONE, |all| all.get(i).into()),
                rotation(i),
                translations
                    .as_ref()
                    .map_or(Vec3::ZERO, |all| all.get(i).into()),
            )
        };
        Ok(Some((0..count).map(transform).collect()))
    }

    /// The values of one of the attributes, where there is one.
    fn instance_attribute<const N: usize>(
        &self,
        attributes: &Value,
        name: &str,
    ) -> Result<Option<Floats<'_, N>>> {
        let Some(value) = attributes.get(name) else {
            return Ok(None);
        };
        let index = value.as_u64().and_then(|index| usize::try_from(index).ok());
        let Some(index) = index else {
            return Err(self.malformed(format!(
                "the attribute {name} of instances is {value}, which is no index of an accessor"
            )));
        };
        let accessor = self.item(&self.root.accessors, "accessor", index)?;
        let is_known = match accessor.component_type {
            Checked::Valid(component) => match component.0 {
                ComponentType::F32 => true,
                ComponentType::I8 | ComponentType::I16 => name == ROTATION && accessor.normalized,
                _ => false,
            },
            Checked::Invalid => false,
        };
        if !is_known {
            let expected = match name {
                ROTATION => "floats, or of signed bytes or shorts that are normalised",
                _ => "floats",
            };
            return Err(self.malformed(format!(
                "the attribute {name} of instances is accessor {index}, which is not of {expected}"
            )));
        }
        self.floats(index).map(Some)
    }
}
