//! From MTL to metallic-roughness materials.

use std::{collections::HashMap, sync::Arc};

use glam::{Affine2, Vec2, Vec3};

use super::mtl::{Entry, Library, Map};
use crate::{
    Alpha, ColorSpace, Material, Result, Texture, TextureRef, Wrap,
    load::{context::Context, texture::Pixels},
};

/// Reflectance where a file says none; the MTL default of most programs.
const GREY: Vec3 = Vec3::splat(0.8);

/// The materials that the scene uses, translated when first asked for.
pub(super) struct Materials<'a> {
    context: &'a Context<'a>,
    library: &'a Library,
    index_of: HashMap<String, u32>,
    materials: Vec<Material>,
    /// By the texture's file, the mask's file, the kind of colour and the wrap mode.
    texture_of: HashMap<TextureKey, Option<u32>>,
    textures: Vec<Arc<Texture>>,
}

type TextureKey = (Option<String>, Option<String>, ColorSpace, bool);

impl<'a> Materials<'a> {
    pub(super) fn new(context: &'a Context<'a>, library: &'a Library) -> Self {
        Self {
            context,
            library,
            index_of: HashMap::new(),
            materials: Vec::new(),
            texture_of: HashMap::new(),
            textures: Vec::new(),
        }
    }

    /// The place in the scene of the material of that name; the empty name is that of faces without one.
    pub(super) fn get(&mut self, name: &str) -> Result<u32> {
        if let Some(&index) = self.index_of.get(name) {
            return Ok(index);
        }
        let mut material = match self.library.get(name) {
            Some(entry) => self.convert(entry)?,
            None => {
                if !name.is_empty() {
                    self.context.warn(format!(
                        "the material '{name}' is in no library; it is grey"
                    ));
                }
                Material {
                    base_color: GREY.extend(1.0),
                    metallic: 0.0,
                    ..Material::default()
                }
            }
        };
        material.name = name.to_owned();
        let index = self.materials.len() as u32;
        self.materials.push(material);
        self.index_of.insert(name.to_owned(), index);
        Ok(index)
    }

    pub(super) fn finish(self) -> (Vec<Material>, Vec<Arc<Texture>>) {
        (self.materials, self.textures)
    }

    fn convert(&mut self, entry: &Entry) -> Result<Material> {
        let has_map = entry.diffuse_map.is_some();
        let unset = if has_map { Vec3::ONE } else { GREY };
        let diffuse = match entry.diffuse {
            // Many exporters write a black colour beside a texture, and mean the texture.
            Some(Vec3::ZERO) if has_map => Vec3::ONE,
            diffuse => diffuse.unwrap_or(unset),
        };
        let specular = entry.specular.unwrap_or_default();
        // What reflects but scatters nothing is a metal.
        let is_metal = diffuse == Vec3::ZERO && specular != Vec3::ZERO;
        let metallic = entry.metallic.unwrap_or(if is_metal { 1.0 } else { 0.0 });
        let base_color = if is_metal { specular } else { diffuse };
        let has_glow_map = entry.emissive_map.is_some();
        let emissive = match entry.emissive {
            None if has_glow_map => Vec3::ONE,
            emissive => emissive.unwrap_or_default(),
        };
        let alpha_map = entry.alpha_map.as_ref();
        let base_color_texture = self.texture(
            entry,
            entry.diffuse_map.as_ref(),
            alpha_map,
            ColorSpace::Srgb,
        )?;
        let is_masked = alpha_map.is_some() && base_color_texture.is_some();
        Ok(Material {
            base_color: base_color.min(Vec3::ONE).extend(1.0),
            base_color_texture,
            metallic: metallic.clamp(0.0, 1.0),
            roughness: entry
                .roughness
                .unwrap_or_else(|| entry.shininess.map_or(1.0, roughness))
                .clamp(0.0, 1.0),
            emissive,
            emissive_texture: self.texture(
                entry,
                entry.emissive_map.as_ref(),
                None,
                ColorSpace::Srgb,
            )?,
            alpha: if is_masked {
                Alpha::Mask { cutoff: 0.5 }
            } else {
                Alpha::Opaque
            },
            ior: entry.ior.unwrap_or(1.5).max(1.0),
            ..Material::default()
        })
    }

    /// The texture of a map, its alpha taken from a second map if there is one.
    fn texture(
        &mut self,
        entry: &Entry,
        color: Option<&Map>,
        mask: Option<&Map>,
        color_space: ColorSpace,
    ) -> Result<Option<TextureRef>> {
        let Some(map) = color.or(mask) else {
            return Ok(None);
        };
        let name = |map: Option<&Map>| map.map(|map| map.name.clone());
        let key = (name(color), name(mask), color_space, map.clamp);
        let texture = match self.texture_of.get(&key) {
            Some(texture) => *texture,
            None => {
                let texture = self.load(entry, color, mask)?.map(|pixels| {
                    let mut texture = pixels.into_texture(&map.name, color_space);
                    if map.clamp {
                        texture.wrap = [Wrap::Clamp; 2];
                    }
                    self.textures.push(Arc::new(texture));
                    self.textures.len() as u32 - 1
                });
                self.texture_of.insert(key, texture);
                texture
            }
        };
        // The options are for a v that points up: 1 − (s·(1 − v) + o) = s·v + 1 − s − o.
        let offset = Vec2::new(map.offset.x, 1.0 - map.scale.y - map.offset.y);
        Ok(texture.map(|texture| TextureRef {
            transform: Affine2::from_scale_angle_translation(map.scale, 0.0, offset),
            ..TextureRef::new(texture)
        }))
    }

    fn load(
        &self,
        entry: &Entry,
        color: Option<&Map>,
        mask: Option<&Map>,
    ) -> Result<Option<Pixels<'a>>> {
        let color = match color {
            Some(map) => self.pixels(entry, map)?,
            None => None,
        };
        let Some(mask) = mask else {
            return Ok(color);
        };
        let Some(mut mask) = self.pixels(entry, mask)? else {
            return Ok(color);
        };
        let alphas = alphas(&mask);
        let Some(mut color) = color else {
            for (texel, alpha) in mask.texels.iter_mut().zip(alphas) {
                *texel = [255, 255, 255, alpha];
            }
            return Ok(Some(mask));
        };
        for y in 0..color.height {
            for x in 0..color.width {
                let column = u64::from(x) * u64::from(mask.width) / u64::from(color.width);
                let row = u64::from(y) * u64::from(mask.height) / u64::from(color.height);
                let from = row as usize * mask.width as usize + column as usize;
                color.texels[y as usize * color.width as usize + x as usize][3] = alphas[from];
            }
        }
        Ok(Some(color))
    }

    /// The pixels of a map's file, searched beside the library and beside the scene; if missing, a warning.
    fn pixels(&self, entry: &Entry, map: &Map) -> Result<Option<Pixels<'a>>> {
        let context = self.context;
        let beside = [entry.file.as_path(), context.path];
        let found = beside
            .into_iter()
            .find_map(|file| context.find(file, &map.name));
        let Some(found) = found else {
            let name = &map.name;
            context.warn(format!(
                "the texture '{name}' is missing; white takes its place"
            ));
            return Ok(None);
        };
        match context.optional(context.read(&found))? {
            Some((bytes, _held)) => context.pixels(&bytes, &map.name),
            None => Ok(None),
        }
    }
}

/// A mask's opacity: its alpha, or its brightness if it has no alpha.
fn alphas(mask: &Pixels<'_>) -> Vec<u8> {
    let has_alpha = mask.texels.iter().any(|texel| texel[3] < 255);
    let brightness = |[r, g, b, a]: [u8; 4]| {
        if has_alpha {
            a
        } else {
            ((u16::from(r) + u16::from(g) + u16::from(b)) / 3) as u8
        }
    };
    mask.texels.iter().copied().map(brightness).collect()
}

/// The roughness whose GGX lobe is as wide as a Blinn-Phong lobe: α² = 2 / (Ns + 2) (Walter et al. 2007,
/// "Microfacet Models for Refraction through Rough Surfaces", §5.2), and α is roughness².
fn roughness(shininess: f32) -> f32 {
    (2.0 / (shininess.max(0.0) + 2.0)).sqrt().sqrt()
}
