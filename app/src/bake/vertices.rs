//! Values for vertices: what they are computed for, and the attribute they become.

use std::collections::HashMap;

use anyhow::{Context, Result, bail, ensure};
use glam::{Vec3, Vec4};
use isophote_scene::{GltfElements, GltfSource, Receiver, Receivers, Scene, sample::hash};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::{
    Existing,
    document::Document,
    meshes::{Baked, attributes, own_meshes},
};

/// The receivers of all instances that came from a file.
pub(super) struct Vertices {
    pub(super) receivers: Vec<Receiver>,
    /// Where each instance's receivers begin, and the end.
    firsts: Vec<usize>,
}

/// What an attribute is called and holds.
#[derive(Clone, Copy)]
pub(super) struct Attribute<'a> {
    pub(super) name: &'a str,
    /// One number rather than three.
    pub(super) is_occlusion: bool,
    /// What vertices without triangles get.
    pub(super) default: Vec3,
    pub(super) existing: Existing,
}

/// The name of the attribute that multiplies base colours.
pub(super) const COLOR: &str = "COLOR_0";

impl Vertices {
    /// The vertices of the first `count` instances.
    pub(super) fn of(scene: &Scene, count: usize) -> Self {
        let of_instance = |instance| {
            let mut receivers = Receivers::from_vertices(scene, instance).points;
            move_inwards(scene, instance, &mut receivers);
            receivers
        };
        let parts: Vec<Vec<Receiver>> =
            (0..count as u32).into_par_iter().map(of_instance).collect();
        let mut firsts = vec![0];
        let mut receivers = Vec::new();
        for part in parts {
            receivers.extend(part);
            firsts.push(receivers.len());
        }
        Self { receivers, firsts }
    }

    /// How many instances they are of: the first ones.
    pub(super) fn instances(&self) -> usize {
        self.firsts.len() - 1
    }

    /// The receivers of an instance by number.
    pub(super) fn of_instance(&self, instance: u32) -> std::ops::Range<usize> {
        self.firsts[instance as usize]..self.firsts[instance as usize + 1]
    }
}

/// How far vertices at the rim of a surface are moved inwards, of the way to the middle of their triangles.
const INWARDS: f32 = 0.01;

/// Moves the receivers at the rim of a surface, where another one usually begins, off that other one: exactly at its foot they
/// would be in front of it and behind it. Those that triangles surround stay where they are.
fn move_inwards(scene: &Scene, instance: u32, receivers: &mut [Receiver]) {
    let placed = &scene.instances[instance as usize];
    let mesh = scene.mesh(placed);
    // Around a vertex in the midst of a surface every neighbour is the next corner of one triangle and the last of another.
    let mut balance = vec![0_u64; mesh.positions.len()];
    let mut middles = vec![(Vec3::ZERO, 0.0); mesh.positions.len()];
    for (primitive, triangle) in mesh.triangles.iter().enumerate() {
        let corners = mesh.corners(primitive);
        let middle = placed
            .transform
            .transform_point3(corners.iter().sum::<Vec3>() / 3.0);
        for corner in 0..3 {
            let [vertex, next, last] = [0, 1, 2].map(|step| triangle[(corner + step) % 3] as usize);
            let name =
                |vertex: usize| u64::from(hash(vertex as u32)) << 16 | vertex as u64 & 0xFFFF;
            balance[vertex] = balance[vertex]
                .wrapping_add(name(next))
                .wrapping_sub(name(last));
            let sum = &mut middles[vertex];
            *sum = (sum.0 + middle, sum.1 + 1.0);
        }
    }
    for receiver in receivers {
        let vertex = receiver.index as usize;
        if balance[vertex] != 0 {
            let point = &mut receiver.point;
            let (sum, count) = middles[vertex];
            let way = sum / count - point.position;
            let along = way - point.geometric_normal * way.dot(point.geometric_normal);
            point.position += INWARDS * along;
        }
    }
}

/// Refuses an attribute that a primitive already has, unless it is to be changed.
pub(super) fn check(
    document: &Document,
    source: &GltfSource,
    attribute: &Attribute<'_>,
) -> Result<()> {
    let name = attribute.name;
    for mesh in &source.meshes {
        for primitive in &mesh.primitives {
            let json = &document.json["meshes"][mesh.mesh]["primitives"][primitive.primitive];
            let is_there = json["attributes"].get(name).is_some();
            let is_allowed = match attribute.existing {
                Existing::Refuse => false,
                Existing::Multiply => name == COLOR,
                Existing::Replace => true,
            };
            ensure!(
                !is_there || is_allowed,
                "mesh {} has {name} already: give --existing replace{}, or --attribute _NAME for another",
                mesh.mesh,
                if name == COLOR {
                    " or --existing multiply"
                } else {
                    ""
                }
            );
        }
    }
    Ok(())
}

/// Adds the attribute to all meshes: one value for each receiver.
pub(super) fn write(
    document: &mut Document,
    source: &GltfSource,
    vertices: &Vertices,
    values: &[Vec3],
    attribute: &Attribute<'_>,
) -> Result<()> {
    for baked in own_meshes(document, source)? {
        let range = vertices.of_instance(baked.instance);
        let (receivers, values) = (&vertices.receivers[range.clone()], &values[range]);
        for group in groups(document, &baked)? {
            let means = group.means(&baked, receivers, values, attribute.default);
            let old = match attribute.existing {
                Existing::Multiply => group.old,
                Existing::Refuse | Existing::Replace => None,
            };
            let old = old.map(|old| {
                let elements = source.accessors.get(&old);
                elements.with_context(|| format!("accessor {old} cannot be read"))
            });
            let accessor = add(document, &means, attribute, old.transpose()?)?;
            for &number in &group.primitives {
                let primitive = baked.primitives[number].primitive;
                let attributes = attributes(document, baked.mesh, primitive)?;
                attributes.insert(attribute.name.into(), accessor.into());
            }
        }
    }
    Ok(())
}

/// Primitives of a mesh whose vertices are the same, and so have the same values.
struct Group {
    /// Numbers of theirs in the list of the baked mesh.
    primitives: Vec<usize>,
    /// The accessor of the attribute that is there already.
    old: Option<usize>,
    count: usize,
}

fn groups(document: &mut Document, baked: &Baked<'_>) -> Result<Vec<Group>> {
    let mut groups: Vec<Group> = Vec::new();
    let mut index_of: HashMap<String, usize> = HashMap::new();
    for (number, primitive) in baked.primitives.iter().enumerate() {
        let attributes = attributes(document, baked.mesh, primitive.primitive)?;
        let key = serde_json::to_string(attributes)?;
        let old = attributes.get(COLOR).and_then(Value::as_u64);
        let group = *index_of.entry(key).or_insert_with(|| {
            groups.push(Group {
                primitives: Vec::new(),
                old: old.map(|old| old as usize),
                count: primitive.count,
            });
            groups.len() - 1
        });
        groups[group].primitives.push(number);
    }
    Ok(groups)
}

impl Group {
    /// For every vertex of the file the mean of the values of what it became, by area.
    fn means(
        &self,
        baked: &Baked<'_>,
        receivers: &[Receiver],
        values: &[Vec3],
        default: Vec3,
    ) -> Vec<Vec3> {
        let mut sums = vec![(Vec3::ZERO, 0.0_f32); self.count];
        for &number in &self.primitives {
            let primitive = &baked.primitives[number];
            let range = &primitive.vertices;
            let first = receivers.partition_point(|receiver| receiver.index < range.start);
            let end = receivers.partition_point(|receiver| receiver.index < range.end);
            for (receiver, value) in receivers[first..end].iter().zip(&values[first..end]) {
                let vertex = primitive.sources[(receiver.index - range.start) as usize];
                // The smallest triangles' areas vanish.
                let weight = receiver.area.max(f32::MIN_POSITIVE);
                let sum = &mut sums[vertex as usize];
                *sum = (sum.0 + weight * *value, sum.1 + weight);
            }
        }
        let mean = |(sum, weight): (Vec3, f32)| {
            let mean = sum / weight;
            if mean.is_finite() { mean } else { default }
        };
        sums.into_iter().map(mean).collect()
    }
}

/// Adds an accessor of these values.
fn add(
    document: &mut Document,
    values: &[Vec3],
    attribute: &Attribute<'_>,
    old: Option<&GltfElements>,
) -> Result<usize> {
    if attribute.name == COLOR {
        let colors: Vec<Vec4> = match old {
            None => values.iter().map(|value| value.extend(1.0)).collect(),
            Some(old) => {
                ensure!(
                    old.count >= values.len(),
                    "a {COLOR} has fewer values than its mesh vertices"
                );
                let product = |(i, value): (usize, &Vec3)| Ok(value.extend(1.0) * color(old, i)?);
                values
                    .iter()
                    .enumerate()
                    .map(product)
                    .collect::<Result<_>>()?
            }
        };
        let word = |value: f32| ((value.clamp(0.0, 1.0) * 65535.0).round() as u16).to_le_bytes();
        let words = colors.iter().flat_map(|color| color.to_array().map(word));
        let bytes: Vec<u8> = words.flatten().collect();
        let accessor = json!({ "componentType": 5123, "normalized": true, "type": "VEC4" });
        return document.add_vertices(accessor, &bytes, 8);
    }
    let (kind, components) = if attribute.is_occlusion {
        ("SCALAR", 1)
    } else {
        ("VEC3", 3)
    };
    let floats = values
        .iter()
        .flat_map(|value| value.to_array().into_iter().take(components));
    let bytes: Vec<u8> = floats.flat_map(f32::to_le_bytes).collect();
    let accessor = json!({ "componentType": 5126, "type": kind });
    document.add_vertices(accessor, &bytes, 4 * components)
}

/// A colour as glTF stores them: RGB or RGBA in floats or normalised integers.
fn color(elements: &GltfElements, index: usize) -> Result<Vec4> {
    let bytes = &elements.bytes[index * elements.size..][..elements.size];
    let mut color = Vec4::ONE;
    for component in 0..elements.components.min(4) {
        color[component] = match elements.component_type {
            5121 => f32::from(bytes[component]) / 255.0,
            5123 => {
                f32::from(u16::from_le_bytes([
                    bytes[2 * component],
                    bytes[2 * component + 1],
                ])) / 65535.0
            }
            5126 => {
                let bytes = &bytes[4 * component..][..4];
                f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
            }
            other => bail!("a {COLOR} has components of type {other}, which no colour has"),
        };
    }
    Ok(color)
}

/// Whether a name can be an attribute's: `COLOR_0`, or one of the user's own.
pub(super) fn name(text: &str) -> Result<String, String> {
    let is_own = text.strip_prefix('_').is_some_and(|rest| {
        let known = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
        !rest.is_empty() && rest.chars().all(known)
    });
    if text == COLOR || is_own {
        Ok(text.to_owned())
    } else {
        Err("expected COLOR_0, or an underscore and capitals such as _AO".into())
    }
}
