//! Materials (glTF 2.0 §3.9) and the extensions of theirs that are supported.

use std::{collections::HashMap, sync::Arc};

use glam::{Affine2, Vec2, Vec3, Vec4};
use gltf_json::{
    material::{AlphaMode, Material as JsonMaterial},
    texture::Info,
    validation::Checked,
};

use super::{document::Document, textures::Textures};
use crate::{Alpha, ColorSpace, Material, Result, Texture, TextureRef};

/// The materials that the scene uses, converted when first asked for.
pub(super) struct Materials<'a> {
    document: &'a Document<'a>,
    textures: Textures<'a>,
    /// By the index in the file; `None` is the default material.
    index_of: HashMap<Option<usize>, u32>,
    materials: Vec<Material>,
}

impl<'a> Materials<'a> {
    pub(super) fn new(document: &'a Document<'a>) -> Self {
        Self {
            document,
            textures: Textures::new(document),
            index_of: HashMap::new(),
            materials: Vec::new(),
        }
    }

    /// The place in the scene of a material of the file.
    pub(super) fn get(&mut self, index: Option<usize>) -> Result<u32> {
        if let Some(&place) = self.index_of.get(&index) {
            return Ok(place);
        }
        let material = match index {
            None => Material::default(),
            Some(index) => {
                let materials = &self.document.root.materials;
                let material = self.document.item(materials, "material", index)?;
                self.convert(material)?
            }
        };
        let place = self.materials.len() as u32;
        self.materials.push(material);
        self.index_of.insert(index, place);
        Ok(place)
    }

    pub(super) fn finish(self) -> (Vec<Material>, Vec<Arc<Texture>>) {
        (self.materials, self.textures.finish())
    }

    fn convert(&mut self, json: &JsonMaterial) -> Result<Material> {
        let pbr = &json.pbr_metallic_roughness;
        let extensions = json.extensions.as_ref();
        let strength = extensions.and_then(|all| all.emissive_strength.as_ref());
        let strength = strength.map_or(1.0, |strength| strength.emissive_strength.0);
        let transmission = extensions.and_then(|all| all.transmission.as_ref());
        let ior = extensions.and_then(|all| all.ior.as_ref());
        if json.normal_texture.is_some() {
            self.document.warn("normal maps are ignored");
        }
        if json.occlusion_texture.is_some() {
            self.document
                .warn("occlusion maps are ignored: occlusion is computed");
        }
        Ok(Material {
            name: json.name.clone().unwrap_or_default(),
            base_color: Vec4::from(pbr.base_color_factor.0.map(|factor| unit(factor, 1.0))),
            base_color_texture: self.texture(pbr.base_color_texture.as_ref(), ColorSpace::Srgb)?,
            metallic: unit(pbr.metallic_factor.0, 1.0),
            roughness: unit(pbr.roughness_factor.0, 1.0),
            metallic_roughness_texture: self
                .texture(pbr.metallic_roughness_texture.as_ref(), ColorSpace::Linear)?,
            emissive: Vec3::from(json.emissive_factor.0)
                .to_array()
                .map(|factor| positive(factor * strength))
                .into(),
            emissive_texture: self.texture(json.emissive_texture.as_ref(), ColorSpace::Srgb)?,
            alpha: self.alpha(json),
            transmission: transmission.map_or(0.0, |t| unit(t.transmission_factor.0, 0.0)),
            transmission_texture: self.texture(
                transmission.and_then(|t| t.transmission_texture.as_ref()),
                ColorSpace::Linear,
            )?,
            ior: ior.map_or(1.5, |ior| positive(ior.ior.0).max(1.0)),
            unlit: extensions.is_some_and(|all| all.unlit.is_some()),
        })
    }

    fn alpha(&self, json: &JsonMaterial) -> Alpha {
        match json.alpha_mode {
            Checked::Valid(AlphaMode::Opaque) => Alpha::Opaque,
            Checked::Valid(AlphaMode::Mask) => Alpha::Mask {
                cutoff: positive(json.alpha_cutoff.unwrap_or_default().0),
            },
            Checked::Valid(AlphaMode::Blend) => {
                self.document
                    .warn("blended materials are taken as opaque (alphaMode BLEND)");
                Alpha::Opaque
            }
            Checked::Invalid => {
                self.document
                    .warn("a material has an unknown alphaMode and is taken as opaque");
                Alpha::Opaque
            }
        }
    }

    fn texture(
        &mut self,
        info: Option<&Info>,
        color_space: ColorSpace,
    ) -> Result<Option<TextureRef>> {
        let Some(info) = info else {
            return Ok(None);
        };
        let transform = info
            .extensions
            .as_ref()
            .and_then(|all| all.texture_transform.as_ref());
        let set = transform
            .and_then(|transform| transform.tex_coord)
            .unwrap_or(info.tex_coord);
        let Some(uv_set) = u8::try_from(set).ok().filter(|set| *set < 2) else {
            self.document.warn(format!(
                "a texture uses the coordinates TEXCOORD_{set}; only TEXCOORD_0 and TEXCOORD_1 are read, so it is ignored"
            ));
            return Ok(None);
        };
        let Some(texture) = self.textures.get(info.index.value(), color_space)? else {
            return Ok(None);
        };
        // v points down, so the extension's counter-clockwise rotation is a negative angle.
        let transform = transform.map_or(Affine2::IDENTITY, |transform| {
            Affine2::from_scale_angle_translation(
                Vec2::from(transform.scale.0),
                -transform.rotation.0,
                Vec2::from(transform.offset.0),
            )
        });
        Ok(Some(TextureRef {
            texture,
            uv_set,
            transform: if transform.is_finite() {
                transform
            } else {
                Affine2::IDENTITY
            },
        }))
    }
}

/// A factor in 0..=1.
fn unit(factor: f32, default: f32) -> f32 {
    if factor.is_finite() {
        factor.clamp(0.0, 1.0)
    } else {
        default
    }
}

/// A finite factor that is at least 0.
fn positive(factor: f32) -> f32 {
    if factor.is_finite() {
        factor.max(0.0)
    } else {
        0.0
    }
}
