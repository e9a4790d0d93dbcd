//! Instances, materials, textures and lights as records of words of four; `shaders/scene_data.wesl` reads them,
//! `shaders/reference/light_sampling.wesl` and `shaders/emission.wesl` those by which lights are chosen.

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, Vec4};

use super::{atlas::Atlas, vertices::MeshPlace};
use crate::{
    Aabb, Alpha, Emission, Environment, Filter, Light, LightKind, Material, Scene, TextureRef,
    Wrap, emission::Kind, reference::light_sampling::emitters,
};

type Word = [u32; 4];

const NONE: u32 = u32::MAX;

/// All tables behind each other.
#[derive(Debug)]
pub(super) struct Tables {
    pub(super) words: Vec<Word>,
    pub(super) info: SceneInfo,
}

/// The uniform `scene_info`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct SceneInfo {
    instances: u32,
    materials: u32,
    texture_refs: u32,
    textures: u32,
    levels: u32,
    lights: u32,
    instance_count: u32,
    light_count: u32,
    bounds_min: [f32; 3],
    material_count: u32,
    bounds_max: [f32; 3],
    emitters: u32,
    emitter_count: u32,
    sources: u32,
    source_count: u32,
    environment_rows: u32,
}

impl SceneInfo {
    /// Whether a ray can find light: on an emissive triangle or outside the scene.
    pub(super) fn can_be_hit(&self) -> bool {
        self.emitter_count > 0 || self.environment_rows != NONE
    }
}

/// Bytes of the tables at least, before they are made.
pub(super) fn least_bytes(scene: &Scene) -> u64 {
    let Environment::Map(map) = &scene.environment else {
        return 0;
    };
    let [width, height] = map.size().map(u64::from);
    16 * height + 4 * width * height
}

impl Tables {
    pub(super) fn new(scene: &Scene, places: &[MeshPlace], atlas: &Atlas) -> Self {
        let Moving {
            mut words,
            mut info,
        } = Moving::new(scene, &scene.bounds(), places);
        let mut refs = Vec::new();
        info.materials = words.len() as u32;
        words.extend(
            scene
                .materials
                .iter()
                .flat_map(|one| material_record(one, &mut refs)),
        );
        info.texture_refs = words.len() as u32;
        words.extend(refs.iter().flat_map(texture_ref_record));
        info.textures = words.len() as u32;
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
        info.levels = words.len() as u32;
        words.extend(atlas.places.iter().map(|place| {
            [
                place.x,
                place.y,
                place.layer,
                place.width | place.height << 16,
            ]
        }));
        info.environment_rows = if scene.environment.is_black() {
            NONE
        } else {
            words.len() as u32
        };
        if let Environment::Map(map) = &scene.environment {
            words.extend(map.row_chances().map(|row| row.map(f32::to_bits)));
            words.extend(map.texel_chances().chunks(4).map(|chunk| {
                std::array::from_fn(|i| chunk.get(i).copied().unwrap_or_default().to_bits())
            }));
        }
        if words.is_empty() {
            words.push([0; 4]);
        }
        Self { words, info }
    }

    /// Moves the scene: the first words of all, and what is known of them, are others then. The rest stays where it is.
    pub(super) fn moved(
        info: &SceneInfo,
        scene: &Scene,
        bounds: &Aabb,
        places: &[MeshPlace],
    ) -> Moving {
        let mut moving = Moving::new(scene, bounds, places);
        let SceneInfo {
            materials,
            texture_refs,
            textures,
            levels,
            environment_rows,
            ..
        } = *info;
        moving.info = SceneInfo {
            materials,
            texture_refs,
            textures,
            levels,
            environment_rows,
            ..moving.info
        };
        moving
    }
}

/// What moves: the beginning of the tables, and what is known of it. However a scene moves they are as many.
#[derive(Debug)]
pub(super) struct Moving {
    pub(super) words: Vec<Word>,
    pub(super) info: SceneInfo,
}

impl Moving {
    fn new(scene: &Scene, bounds: &Aabb, places: &[MeshPlace]) -> Self {
        let mut words = Vec::new();
        let transforms = scene.transforms();
        words.extend(instance_records(scene, places, &transforms).flatten());
        let lights = words.len() as u32;
        words.extend(scene.lights.iter().flat_map(light_record));
        let first_emitter = words.len() as u32;
        words.extend(emitters(scene).iter().map(|emitter| {
            let [sum, density] = [emitter.cumulative, emitter.density()].map(f32::to_bits);
            [
                emitter.surface.instance,
                emitter.surface.primitive,
                sum,
                density,
            ]
        }));
        let sources = words.len() as u32;
        let emission = Emission::within(scene, bounds);
        words.extend(emission.sources().iter().map(|source| {
            let probability = source.probability;
            let (a, b, scale) = match source.kind {
                Kind::Light(index) => (LIGHT, index, 1.0 / probability),
                Kind::Triangle(surface, area) => {
                    (surface.instance, surface.primitive, area / probability)
                }
                Kind::Environment => (NONE, 0, 1.0 / probability),
            };
            [a, b, source.cumulative.to_bits(), scale.to_bits()]
        }));
        let source_count = words.len() as u32 - sources;
        let emitter_count = sources - first_emitter;
        // Room for all that may shine: lights, triangles and the environment.
        let most = scene.lights.len() + emitter_count as usize + 1;
        words.resize(sources as usize + most, [0; 4]);
        let info = SceneInfo {
            lights,
            instance_count: scene.instances.len() as u32,
            light_count: scene.lights.len() as u32,
            bounds_min: bounds.min.to_array(),
            material_count: scene.materials.len() as u32,
            bounds_max: bounds.max.to_array(),
            emitters: first_emitter,
            emitter_count,
            sources,
            source_count,
            ..SceneInfo::default()
        };
        Self { words, info }
    }
}

/// In the place of an instance: a source without geometry.
const LIGHT: u32 = NONE - 1;

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
