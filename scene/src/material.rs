//! What surfaces are made of: glTF's metallic-roughness model.

use glam::{Affine2, Vec2, Vec3, Vec4};

/// A metallic-roughness material (glTF 2.0 §3.9), with the extensions that Isophote reads.
///
/// Every factor is multiplied by its texture where one is given.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The name in the file; may be empty.
    pub name: String,
    /// Linear RGB albedo and alpha, each in 0..=1.
    pub base_color: Vec4,
    /// sRGB texture of `base_color`.
    pub base_color_texture: Option<TextureRef>,
    /// 0 is diffuse, 1 a GGX reflector with reflectance `base_color`; 0..=1.
    pub metallic: f32,
    /// GGX α is roughness²; below 0.05 a perfect mirror; 0..=1.
    pub roughness: f32,
    /// Linear texture with roughness in G and metallic in B.
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Emitted radiance, linear RGB (`emissiveFactor` × `KHR_materials_emissive_strength`).
    pub emissive: Vec3,
    /// sRGB texture of `emissive`.
    pub emissive_texture: Option<TextureRef>,
    /// What alpha means.
    pub alpha: Alpha,
    /// Share of the non-metallic light that is refracted instead of scattered
    /// (`KHR_materials_transmission`); 0..=1.
    pub transmission: f32,
    /// Linear texture with the transmission in R.
    pub transmission_texture: Option<TextureRef>,
    /// Index of refraction (`KHR_materials_ior`); at least 1.
    pub ior: f32,
    /// Shown to the camera as `base_color`, whatever the light (`KHR_materials_unlit`); it neither
    /// reflects light to other surfaces nor emits any.
    pub unlit: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec4::ONE,
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            alpha: Alpha::Opaque,
            transmission: 0.0,
            transmission_texture: None,
            ior: 1.5,
            unlit: false,
        }
    }
}

impl Material {
    /// A diffuse material of an albedo in linear RGB.
    pub fn diffuse(name: impl Into<String>, albedo: Vec3) -> Self {
        Self {
            name: name.into(),
            base_color: albedo.extend(1.0),
            metallic: 0.0,
            ..Self::default()
        }
    }

    /// Whether the surface gives off light.
    pub fn is_emissive(&self) -> bool {
        self.emissive.max_element() > 0.0
    }
}

/// What a material's alpha does.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Alpha {
    /// Nothing: rays always stop. `BLEND` is read as this, with a warning.
    #[default]
    Opaque,
    /// Rays pass where alpha is below the cutoff (glTF's `MASK`).
    Mask {
        /// The cutoff, usually 0.5.
        cutoff: f32,
    },
}

/// How a material looks up one of the scene's textures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index in [`Scene::textures`](crate::Scene::textures).
    pub texture: u32,
    /// Which of [`Mesh::uvs`](crate::Mesh::uvs): 0 or 1.
    pub uv_set: u8,
    /// Applied to the mesh's coordinates (`KHR_texture_transform`).
    pub transform: Affine2,
}

impl TextureRef {
    /// The texture, looked up with the mesh's first texture coordinates as they are.
    pub fn new(texture: u32) -> Self {
        Self {
            texture,
            uv_set: 0,
            transform: Affine2::IDENTITY,
        }
    }

    /// The coordinates to sample the texture at.
    #[inline]
    pub fn coordinates(&self, uvs: &[Vec2; 2]) -> Vec2 {
        self.transform
            .transform_point2(uvs[usize::from(self.uv_set)])
    }
}

impl Material {
    /// Every texture look-up of the material.
    pub fn textures_mut(&mut self) -> impl Iterator<Item = &mut TextureRef> {
        [
            &mut self.base_color_texture,
            &mut self.metallic_roughness_texture,
            &mut self.emissive_texture,
            &mut self.transmission_texture,
        ]
        .into_iter()
        .flatten()
    }
}
