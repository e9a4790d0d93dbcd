//! Instances, materials, textures and lights as records of words of four; `shaders/scene_data.wesl` reads them.

use std::mem::offset_of;

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, Vec4};

use super::{atlas::Atlas, vertices::MeshPlace};
use crate::{Aabb, Alpha, Filter, Light, LightKind, Material, Scene, TextureRef, Wrap};

type Word = [u32; 4];

const NONE: u32 = u32::MAX;

/// All tables behind each other.
#[derive(Debug)]
pub(super) struct Tables {
    pub(super) words: Vec<Word>,
    starts: Starts,
}

#[derive(Clone, Copy, Debug, Default)]
struct Starts {
    materials: u32,
    texture_refs: u32,
    textures: u32,
    levels: u32,
    lights: u32,
}

/// The uniform `scene_info`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct SceneInfo {
    starts: [u32; 6],
    instance_count: u32,
    light_count: u32,
    bounds_min: [f32; 3],
    material_count: u32,
    bounds_max: [f32; 3],
    padding: u32,
}

/// What moves of the uniform `scene_info`.
pub(super) fn bounds_records(bounds: &Aabb) -> [(u64, [f32; 3]); 2] {
    [
        (
            offset_of!(SceneInfo, bounds_min) as u64,
            bounds.min.to_array(),
        ),
        (
            offset_of!(SceneInfo, bounds_max) as u64,
            bounds.max.to_array(),
        ),
    ]
}

impl Tables {
    pub(super) fn new(scene: &Scene, places: &[MeshPlace], atlas: &Atlas) -> Self {
        let mut words = Vec::new();
        // Instances and lights first: they are what moves.
        let transforms = scene.transforms();
        words.extend(instance_records(scene, places, &transforms).flatten());
        let lights = words.len() as u32;
        words.extend(scene.lights.iter().flat_map(light_record));
        let mut refs = Vec::new();
        let materials = words.len() as u32;
        words.extend(
            scene
                .materials
                .iter()
                .flat_map(|one| material_record(one, &mut refs)),
        );
        let texture_refs = words.len() as u32;
        words.extend(refs.iter().flat_map(texture_ref_record));
        let textures = words.len() as u32;
        let mut first_level = 0;
        for texture in &scene.textures {
            let wrap = |wrap| match wrap {
                Wrap::Repeat => 0,
                Wrap::Mirror => 1,
                Wrap::Clamp => 2,
            };
            let nearest = u32::from(texture.filter == Filter::Nearest);
            let srgb = u32::from(texture.color_space == crate::ColorSpace::Srgb);
            let flags =
                wrap(texture.wrap[0]) | wrap(texture.wrap[1]) << 2 | nearest << 4 | srgb << 5;
            words.push([first_level, texture.level_count() as u32, flags, 0]);
            first_level += texture.level_count() as u32;
        }
        let levels = words.len() as u32;
        words.extend(atlas.places.iter().map(|place| {
            [
                place.x,
                place.y,
                place.layer,
                place.width | place.height << 16,
            ]
        }));
        if words.is_empty() {
            words.push([0; 4]);
        }
        let starts = Starts {
            materials,
            texture_refs,
            textures,
            levels,
            lights,
        };
        Self { words, starts }
    }

    pub(super) fn info(&self, scene: &Scene) -> SceneInfo {
        let bounds = scene.bounds();
        let Starts {
            materials,
            texture_refs,
            textures,
            levels,
            lights,
        } = self.starts;
        SceneInfo {
            starts: [0, materials, texture_refs, textures, levels, lights],
            instance_count: scene.instances.len() as u32,
            light_count: scene.lights.len() as u32,
            bounds_min: bounds.min.to_array(),
            material_count: scene.materials.len() as u32,
            bounds_max: bounds.max.to_array(),
            padding: 0,
        }
    }
}

/// What moves: the beginning of the tables, as it is for these instances and lights.
pub(super) fn moving_records(scene: &Scene, places: &[MeshPlace]) -> Vec<Word> {
    instance_records(scene, places, &scene.transforms())
        .flatten()
        .chain(scene.lights.iter().flat_map(light_record))
        .collect()
}

fn instance_records<'a>(
    scene: &'a Scene,
    places: &'a [MeshPlace],
    transforms: &'a [Affine3A],
) -> impl Iterator<Item = [Word; 5]> + 'a {
    scene
        .instances
        .iter()
        .zip(transforms)
        .map(|(instance, transform)| {
            let place = &places[instance.mesh as usize];
            let (m, t) = (transform.matrix3, transform.translation);
            let row = |axis: usize| {
                [m.x_axis[axis], m.y_axis[axis], m.z_axis[axis], t[axis]].map(f32::to_bits)
            };
            let handedness = if m.determinant() < 0.0 { -1_f32 } else { 1.0 };
            [
                row(0),
                row(1),
                row(2),
                [
                    place.first_vertex,
                    place.first_triangle,
                    place.second_uv,
                    place.triangle_count,
                ],
                [u32::from(instance.mask.bits()), handedness.to_bits(), 0, 0],
            ]
        })
}

fn material_record(material: &Material, refs: &mut Vec<TextureRef>) -> [Word; 5] {
    let mut place = |texture: &Option<TextureRef>| {
        texture.map_or(NONE, |texture| {
            refs.push(texture);
            refs.len() as u32 - 1
        })
    };
    let (masked, cutoff) = match material.alpha {
        Alpha::Opaque => (0, 0.0),
        Alpha::Mask { cutoff } => (2, cutoff),
    };
    [
        bits(material.base_color),
        bits(material.emissive.extend(cutoff)),
        bits(Vec4::new(
            material.metallic,
            material.roughness,
            material.transmission,
            material.ior,
        )),
        [
            u32::from(material.unlit) | masked,
            place(&material.base_color_texture),
            place(&material.metallic_roughness_texture),
            place(&material.emissive_texture),
        ],
        [place(&material.transmission_texture), 0, 0, 0],
    ]
}

fn texture_ref_record(texture: &TextureRef) -> [Word; 2] {
    let matrix = texture.transform.matrix2.to_cols_array().map(f32::to_bits);
    let moved = texture.transform.translation.to_array().map(f32::to_bits);
    [
        matrix,
        [
            moved[0],
            moved[1],
            texture.texture,
            u32::from(texture.uv_set),
        ],
    ]
}

fn light_record(light: &Light) -> [Word; 4] {
    let [x, y, z] = light.position().to_array().map(f32::to_bits);
    let (kind, radius, spot) = match light.kind {
        LightKind::Point { radius } => (0, radius, [0.0; 2]),
        LightKind::Spot { inner, outer } => {
            let falloff = 1.0 / (inner.cos() - outer.cos()).max(0.001);
            (1, 0.0, [outer.cos(), falloff])
        }
        LightKind::Directional => (2, 0.0, [0.0; 2]),
    };
    [
        [x, y, z, kind],
        bits(light.direction().extend(radius)),
        bits(light.intensity.extend(spot[0])),
        [spot[1].to_bits(), 0, 0, 0],
    ]
}

fn bits(value: Vec4) -> Word {
    value.to_array().map(f32::to_bits)
}
