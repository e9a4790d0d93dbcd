//! A lightmap as part of a file: texture coordinates, the picture, and the materials that show it.
//!
//! Occlusion becomes `occlusionTexture`, irradiance the vendor extension `MOZ_lightmap`, whose texture times `intensity` is
//! irradiance in W/m². Materials stay shared, but for those that something uses that is not baked: it has no such texture
//! coordinates.

use std::collections::{BTreeMap, BTreeSet, btree_map::Entry};

use anyhow::{Context, Result, ensure};
use glam::Vec3;
use isophote_scene::{GltfElements, GltfSource, linear_to_srgb};
use serde_json::{Map, Value, json};

use super::{
    Existing,
    document::{Document, INDICES, object},
    layout::{Layout, Unwrapped},
    meshes::{attributes, index, own_meshes, primitive},
    texels::Lightmap,
};

const EXTENSION: &str = "MOZ_lightmap";
const VARIANTS: &str = "KHR_materials_variants";

/// Refuses materials that show occlusion or a lightmap already, unless that is to be replaced.
pub(super) fn check(
    document: &Document,
    source: &GltfSource,
    is_occlusion: bool,
    existing: Existing,
) -> Result<()> {
    for mesh in &source.meshes {
        for own in &mesh.primitives {
            let json = &document.json["meshes"][mesh.mesh]["primitives"][own.primitive];
            for material in materials_of(json) {
                let json = &document.json["materials"][material];
                let (found, name) = if is_occlusion {
                    (json.get("occlusionTexture"), "an occlusionTexture")
                } else {
                    (json["extensions"].get(EXTENSION), EXTENSION)
                };
                ensure!(
                    found.is_none() || existing == Existing::Replace,
                    "material {material} has {name} already: give --existing replace"
                );
            }
        }
    }
    Ok(())
}

/// Adds a lightmap to the file.
pub(super) fn write(
    document: &mut Document,
    source: &GltfSource,
    layout: &Layout,
    map: &Lightmap,
    is_occlusion: bool,
) -> Result<()> {
    let mut meshes = Vec::new();
    for (number, baked) in own_meshes(document, source)?.iter().enumerate() {
        for (i, own) in baked.primitives.iter().enumerate() {
            let place = (baked.mesh, own.primitive);
            if let Some(made) = &layout.made {
                unwrap(document, source, place, &made[number][i], layout.set)?;
            }
            meshes.push(place);
        }
    }
    let (bytes, intensity) = picture(map, is_occlusion)?;
    let view = document.add_view(&bytes, None)?;
    let image = document.add(
        "images",
        json!({ "bufferView": view, "mimeType": "image/png" }),
    )?;
    // Linear filters and no repetition; mip levels would mix charts.
    let filters = json!({ "magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071 });
    let sampler = document.add("samplers", filters)?;
    let texture = document.add("textures", json!({ "sampler": sampler, "source": image }))?;
    let shown = json!({ "index": texture, "texCoord": layout.set });
    if is_occlusion {
        return show(document, &meshes, |material| {
            material.insert("occlusionTexture".into(), shown.clone());
            Ok(())
        });
    }
    document.use_extension(EXTENSION)?;
    show(document, &meshes, |material| {
        let mut shown = shown.clone();
        shown["intensity"] = json!(intensity);
        let extensions = material.entry("extensions").or_insert_with(|| json!({}));
        object(extensions, "a material's extensions")?.insert(EXTENSION.into(), shown);
        Ok(())
    })
}

/// The picture as a PNG, and what its values are to be multiplied with.
fn picture(map: &Lightmap, is_occlusion: bool) -> Result<(Vec<u8>, f32)> {
    let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, map.size, map.size);
    encoder.set_depth(png::BitDepth::Eight);
    let mut scale = 1.0;
    let pixels: Vec<u8> = if is_occlusion {
        encoder.set_color(png::ColorType::Grayscale);
        map.texels.iter().map(|value| byte(value.x)).collect()
    } else {
        encoder.set_color(png::ColorType::Rgb);
        let brightest = map.texels.iter().copied().fold(Vec3::ZERO, Vec3::max);
        let brightest = brightest.max_element();
        scale = if brightest > 0.0 { brightest } else { 1.0 };
        let srgb = |value: f32| byte(linear_to_srgb(value / scale));
        let texels = map.texels.iter();
        texels
            .flat_map(|value| value.to_array().map(srgb))
            .collect()
    };
    encoder.write_header()?.write_image_data(&pixels)?;
    Ok((bytes, scale))
}

/// Gives a primitive new vertices: every attribute of it, and of its morph targets, is gathered anew.
fn unwrap(
    document: &mut Document,
    source: &GltfSource,
    (mesh, number): (usize, usize),
    made: &Unwrapped,
    set: usize,
) -> Result<()> {
    let json = Value::Object(primitive(document, mesh, number)?.clone());
    let mut gathered = BTreeMap::new();
    let targets = json["targets"].as_array().into_iter().flatten();
    let lists = targets.chain([&json["attributes"]]);
    for (name, old) in lists.filter_map(Value::as_object).flatten() {
        let old = old.as_u64().context("an attribute without an accessor")? as usize;
        if let Entry::Vacant(place) = gathered.entry(old) {
            let elements = source.accessors.get(&old);
            let elements = elements.with_context(|| format!("accessor {old} cannot be read"))?;
            place.insert(gather(document, old, elements, made, name)?);
        }
    }
    let uvs = made.uvs.iter().flat_map(|uv| uv.to_array());
    let uvs: Vec<u8> = uvs.flat_map(f32::to_le_bytes).collect();
    let coordinates =
        document.add_vertices(json!({ "componentType": 5126, "type": "VEC2" }), &uvs, 8)?;
    let indices = add_indices(document, made)?;
    let primitive = primitive(document, mesh, number)?;
    primitive.insert("indices".into(), indices.into());
    if primitive.contains_key("mode") {
        // What was a strip or a fan are single triangles now.
        primitive.insert("mode".into(), 4.into());
    }
    let targets = primitive.get_mut("targets").and_then(Value::as_array_mut);
    for target in targets.into_iter().flatten() {
        replace(target, &gathered);
    }
    replace(&mut primitive["attributes"], &gathered);
    let attributes = attributes(document, mesh, number)?;
    // Sets are numbered without gaps: those before are the same where there are none.
    for set in 0..=set {
        let name = format!("TEXCOORD_{set}");
        attributes.entry(name).or_insert_with(|| coordinates.into());
    }
    Ok(())
}

/// The elements of an accessor for new vertices.
fn gather(
    document: &mut Document,
    old: usize,
    elements: &GltfElements,
    made: &Unwrapped,
    name: &str,
) -> Result<usize> {
    let mut bytes = Vec::with_capacity(made.sources.len() * elements.size);
    for &vertex in &made.sources {
        let start = vertex as usize * elements.size;
        let element = elements.bytes.get(start..start + elements.size);
        let element = element.with_context(|| format!("accessor {old} has too few elements"))?;
        bytes.extend_from_slice(element);
    }
    let mut accessor = document.list("accessors")?[old].clone();
    let json = object(&mut accessor, "an accessor")?;
    let had_bounds = json.contains_key("min") || json.contains_key("max");
    for key in ["bufferView", "byteOffset", "sparse", "min", "max"] {
        json.shift_remove(key);
    }
    if had_bounds || name == "POSITION" {
        let [min, max] = bounds(elements, &bytes);
        json.insert("min".into(), min);
        json.insert("max".into(), max);
    }
    document.add_vertices(accessor, &bytes, elements.size)
}

/// The smallest and largest value of each component, as they are stored.
fn bounds(elements: &GltfElements, bytes: &[u8]) -> [Value; 2] {
    let width = elements.size / elements.components;
    let component = |bytes: &[u8]| match (elements.component_type, bytes) {
        (5120, &[a]) => f64::from(a as i8),
        (5121, &[a]) => f64::from(a),
        (5122, &[a, b]) => f64::from(i16::from_le_bytes([a, b])),
        (5123, &[a, b]) => f64::from(u16::from_le_bytes([a, b])),
        (5125, &[a, b, c, d]) => f64::from(u32::from_le_bytes([a, b, c, d])),
        (_, &[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
        _ => f64::NAN,
    };
    let mut bounds = [
        vec![f64::INFINITY; elements.components],
        vec![f64::NEG_INFINITY; elements.components],
    ];
    for element in bytes.chunks_exact(elements.size) {
        for (i, bytes) in element.chunks_exact(width).enumerate() {
            let value = component(bytes);
            bounds[0][i] = bounds[0][i].min(value);
            bounds[1][i] = bounds[1][i].max(value);
        }
    }
    bounds.map(|values| {
        let number = |value: f64| match elements.component_type {
            5126 => json!(value),
            // Whole numbers are written as such.
            _ => json!(value as i64),
        };
        values.into_iter().map(number).collect()
    })
}

fn add_indices(document: &mut Document, made: &Unwrapped) -> Result<usize> {
    // The largest number of a type stands for a restart.
    let is_short = made.sources.len() <= usize::from(u16::MAX);
    let indices = made.indices.iter();
    let (bytes, kind): (Vec<u8>, u32) = if is_short {
        let words = indices.flat_map(|&index| (index as u16).to_le_bytes());
        (words.collect(), 5123)
    } else {
        (
            indices.flat_map(|index| index.to_le_bytes()).collect(),
            5125,
        )
    };
    let view = document.add_view(&bytes, Some(INDICES))?;
    document.add(
        "accessors",
        json!({
            "bufferView": view,
            "componentType": kind,
            "count": made.indices.len(),
            "type": "SCALAR",
        }),
    )
}

/// Makes a list of attributes refer to the gathered accessors.
fn replace(attributes: &mut Value, gathered: &BTreeMap<usize, usize>) {
    for (_, accessor) in attributes.as_object_mut().into_iter().flatten() {
        let old = accessor.as_u64().map(|old| old as usize);
        if let Some(new) = old.and_then(|old| gathered.get(&old)) {
            *accessor = (*new).into();
        }
    }
}

/// The materials of a primitive: its own, and those of its variants.
fn materials_of(primitive: &Value) -> BTreeSet<usize> {
    let variants = primitive["extensions"][VARIANTS]["mappings"].as_array();
    let variants = variants.into_iter().flatten();
    let all = variants.chain([primitive]);
    all.filter_map(|holder| index(holder, "material")).collect()
}

/// Changes the materials of baked primitives; those that others use too are copied before.
fn show(
    document: &mut Document,
    baked: &[(usize, usize)],
    change: impl Fn(&mut Map<String, Value>) -> Result<()>,
) -> Result<()> {
    let baked: BTreeSet<(usize, usize)> = baked.iter().copied().collect();
    let (mut wanted, mut foreign) = (BTreeSet::new(), BTreeSet::new());
    for (mesh, json) in document.list("meshes")?.iter().enumerate() {
        let primitives = json["primitives"].as_array().into_iter().flatten();
        for (number, primitive) in primitives.enumerate() {
            let is_baked = baked.contains(&(mesh, number));
            let list = if is_baked { &mut wanted } else { &mut foreign };
            list.extend(materials_of(primitive));
        }
    }
    let mut places = BTreeMap::new();
    for old in wanted {
        let place = if foreign.contains(&old) {
            let copy = document.list("materials")?[old].clone();
            document.add("materials", copy)?
        } else {
            old
        };
        let material = &mut document.list("materials")?[place];
        change(object(material, "a material")?)?;
        places.insert(old, place);
    }
    let mut default = None;
    for (mesh, number) in baked {
        let has_material = primitive(document, mesh, number)?.contains_key("material");
        if !has_material && default.is_none() {
            let mut material = Map::new();
            change(&mut material)?;
            default = Some(document.add("materials", Value::Object(material))?);
        }
        let primitive = primitive(document, mesh, number)?;
        if let (false, Some(default)) = (has_material, default) {
            primitive.insert("material".into(), default.into());
            continue;
        }
        let renumber = |holder: &mut Map<String, Value>| {
            let old = holder.get("material").and_then(Value::as_u64);
            if let Some(&place) = old.and_then(|old| places.get(&(old as usize))) {
                holder.insert("material".into(), place.into());
            }
        };
        renumber(primitive);
        let variants = primitive
            .get_mut("extensions")
            .and_then(|all| all.get_mut(VARIANTS)?.get_mut("mappings")?.as_array_mut());
        let mappings = variants.into_iter().flatten();
        mappings.filter_map(Value::as_object_mut).for_each(renumber);
    }
    Ok(())
}
