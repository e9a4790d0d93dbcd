//! Puts meshes, materials and lights together into a scene.

use std::sync::Arc;

use glam::{Affine3A, Vec3};

use super::shapes::Shape;
use crate::{Camera, Instance, Light, LightKind, Material, Scene, Texture, TextureRef, clean};

/// A scene under construction.
#[derive(Default)]
pub(super) struct Stage {
    scene: Scene,
}

impl Stage {
    /// Adds a material and returns its index.
    pub(super) fn material(&mut self, material: Material) -> u32 {
        self.scene.materials.push(material);
        self.scene.materials.len() as u32 - 1
    }

    /// A matt material of an albedo in linear RGB.
    pub(super) fn matt(&mut self, name: &str, albedo: [f32; 3]) -> u32 {
        self.material(Material::diffuse(name, albedo.into()))
    }

    /// A metal by its reflectance in linear RGB.
    pub(super) fn metal(&mut self, name: &str, reflectance: [f32; 3], roughness: f32) -> u32 {
        self.material(Material {
            metallic: 1.0,
            roughness,
            ..Material::diffuse(name, reflectance.into())
        })
    }

    /// A matt material with a texture that repeats every `metres`, times an albedo.
    pub(super) fn textured(&mut self, texture: Texture, metres: f32, albedo: [f32; 3]) -> u32 {
        let mut material = Material::diffuse(texture.name.clone(), albedo.into());
        let mut reference = TextureRef::new(self.scene.textures.len() as u32);
        reference.transform = glam::Affine2::from_scale(glam::Vec2::splat(1.0 / metres));
        material.base_color_texture = Some(reference);
        self.scene.textures.push(Arc::new(texture));
        self.material(material)
    }

    /// Adds a mesh and returns its index.
    pub(super) fn mesh(&mut self, shape: Shape) -> u32 {
        let mut mesh = shape.finish();
        let dropped = clean(&mut mesh);
        let total = &mut self.scene.report.dropped;
        total.out_of_range += dropped.out_of_range;
        total.non_finite += dropped.non_finite;
        total.zero_area += dropped.zero_area;
        self.scene.meshes.push(Arc::new(mesh));
        self.scene.meshes.len() as u32 - 1
    }

    /// Places a mesh; the instance is named after it and numbered.
    pub(super) fn put(&mut self, mesh: u32, place: Affine3A) {
        let count = self
            .scene
            .instances
            .iter()
            .filter(|instance| instance.mesh == mesh)
            .count();
        let mut instance = Instance::new(mesh, place);
        instance.name = format!("{}.{:03}", self.scene.meshes[mesh as usize].name, count + 1);
        self.scene.instances.push(instance);
    }

    /// Places a mesh, turned about +y by an angle in radians.
    pub(super) fn put_at(&mut self, mesh: u32, position: impl Into<Vec3>, angle: f32) {
        let turn = glam::Quat::from_rotation_y(angle);
        self.put(
            mesh,
            Affine3A::from_rotation_translation(turn, position.into()),
        );
    }

    /// Adds a mesh that stands once, where it was made.
    pub(super) fn single(&mut self, shape: Shape) {
        let mesh = self.mesh(shape);
        self.put(mesh, Affine3A::IDENTITY);
    }

    /// A point light: radiant intensity in W/sr.
    pub(super) fn point_light(&mut self, name: &str, position: [f32; 3], intensity: [f32; 3]) {
        let light = Light::point(name, position.into(), intensity.into());
        self.scene.lights.push(light);
    }

    /// A light that shines from one point towards another.
    pub(super) fn aimed_light(
        &mut self,
        name: &str,
        kind: LightKind,
        intensity: [f32; 3],
        from: [f32; 3],
        to: [f32; 3],
    ) {
        let transform = Camera::look_at("", from.into(), to.into(), 1.0).transform;
        self.scene.lights.push(Light {
            name: name.to_owned(),
            kind,
            intensity: intensity.into(),
            transform,
            node: None,
        });
    }

    /// A camera; the vertical opening angle in degrees.
    pub(super) fn camera(&mut self, name: &str, eye: [f32; 3], target: [f32; 3], yfov: f32) {
        let camera = Camera::look_at(name, eye.into(), target.into(), yfov.to_radians());
        self.scene.cameras.push(camera);
    }

    pub(super) fn finish(self) -> Scene {
        self.scene
    }
}
