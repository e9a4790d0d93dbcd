//! The file's meshes: every instance gets one of its own, since light differs from place to place.

use std::collections::{HashMap, HashSet};

use anyhow::{Context, Result, ensure};
use isophote_scene::{GltfInstance, GltfPrimitive, GltfSource};
use serde_json::{Map, Value};

use super::document::{Document, object};

/// An instance of the scene that a file's node stands for, and the mesh that only it has.
pub(super) struct Baked<'a> {
    /// Index of the instance in the scene.
    pub(super) instance: u32,
    /// Index of its mesh in the file that is written.
    pub(super) mesh: usize,
    /// Where its vertices came from.
    pub(super) primitives: &'a [GltfPrimitive],
}

/// Gives every instance that came from the file a mesh of its own: copies for all but the first of those that share one, and
/// for that too where something that is not baked shares it.
pub(super) fn own_meshes<'a>(
    document: &mut Document,
    source: &'a GltfSource,
) -> Result<Vec<Baked<'a>>> {
    let mut users: HashMap<usize, usize> = HashMap::new();
    for node in document.list("nodes")? {
        if let Some(mesh) = index(node, "mesh") {
            *users.entry(mesh).or_default() += 1;
        }
    }
    let file_mesh = |mesh: u32| source.meshes[mesh as usize].mesh;
    let mut baked_users: HashMap<usize, usize> = HashMap::new();
    for instance in &source.instances {
        ensure!(
            !instance.is_multiplied,
            "node {} stands in many places by EXT_mesh_gpu_instancing, whose copies cannot have light of their own: make \
             nodes of them first",
            instance.node
        );
        *baked_users.entry(file_mesh(instance.mesh)).or_default() += 1;
    }
    let mut taken = HashSet::new();
    let own = |(number, instance): (usize, &GltfInstance)| {
        let old = file_mesh(instance.mesh);
        let shared_with_others = users.get(&old) != baked_users.get(&old);
        let was_taken = !taken.insert(old);
        let mesh = if shared_with_others || was_taken {
            let copy = document.list("meshes")?[old].clone();
            document.add("meshes", copy)?
        } else {
            old
        };
        document.list("nodes")?[instance.node]["mesh"] = mesh.into();
        Ok(Baked {
            instance: number as u32,
            mesh,
            primitives: &source.meshes[instance.mesh as usize].primitives,
        })
    };
    source.instances.iter().enumerate().map(own).collect()
}

/// Refuses what cannot be kept when vertices get new attributes.
pub(super) fn check(document: &Document, source: &GltfSource) -> Result<()> {
    for mesh in &source.meshes {
        for primitive in &mesh.primitives {
            let json = &document.json["meshes"][mesh.mesh]["primitives"][primitive.primitive];
            ensure!(
                json["extensions"]
                    .get("KHR_draco_mesh_compression")
                    .is_none(),
                "mesh {} is compressed by KHR_draco_mesh_compression, which numbers vertices anew: write the file without it first",
                mesh.mesh
            );
        }
    }
    Ok(())
}

/// A primitive of a mesh of the file that is written.
pub(super) fn primitive(
    document: &mut Document,
    mesh: usize,
    primitive: usize,
) -> Result<&mut Map<String, Value>> {
    let primitive = document
        .list("meshes")?
        .get_mut(mesh)
        .and_then(|mesh| mesh.get_mut("primitives")?.get_mut(primitive))
        .with_context(|| format!("mesh {mesh} has no primitive {primitive}"))?;
    object(primitive, "a primitive")
}

/// The attributes of a primitive.
pub(super) fn attributes(
    document: &mut Document,
    mesh: usize,
    number: usize,
) -> Result<&mut Map<String, Value>> {
    let primitive = primitive(document, mesh, number)?;
    let attributes = primitive.get_mut("attributes").context("no attributes")?;
    object(attributes, "a primitive's list of attributes")
}

/// An index that an object refers to something by.
pub(super) fn index(value: &Value, key: &str) -> Option<usize> {
    usize::try_from(value.get(key)?.as_u64()?).ok()
}
