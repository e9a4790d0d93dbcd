//! The scene: meshes placed in the world, what they are made of, and what lights them.

use std::sync::Arc;

use glam::{Affine3A, Vec3};

use crate::{Aabb, Animation, Camera, Environment, Light, Material, Mesh, Texture};

/// Everything there is to render. Metres, right-handed, +Y up.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Triangle meshes; an instance places one in the world.
    pub meshes: Vec<Arc<Mesh>>,
    /// What [`Mesh::triangle_materials`] points at.
    pub materials: Vec<Material>,
    /// What [`TextureRef::texture`](crate::TextureRef::texture) points at.
    pub textures: Vec<Arc<Texture>>,
    /// Meshes placed in the world.
    pub instances: Vec<Instance>,
    /// Lights without geometry.
    pub lights: Vec<Light>,
    /// The light that comes from outside.
    pub environment: Environment,
    /// Viewpoints; the first is the default.
    pub cameras: Vec<Camera>,
    /// The node hierarchy and how it moves.
    pub animation: Animation,
    /// What the loader dropped, replaced or did not understand.
    pub report: LoadReport,
}

/// A mesh placed in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// The name of its node; may be empty.
    pub name: String,
    /// Index in [`Scene::meshes`].
    pub mesh: u32,
    /// From the mesh's space to the world's, also mirroring. Triangles that it leaves without area are not hit.
    pub transform: Affine3A,
    /// The roles it plays.
    pub mask: InstanceMask,
    /// The node that moves it, if any.
    pub node: Option<u32>,
}

impl Instance {
    /// A mesh placed in the world, with every role.
    pub fn new(mesh: u32, transform: Affine3A) -> Self {
        Self {
            name: String::new(),
            mesh,
            transform,
            mask: InstanceMask::ALL,
            node: None,
        }
    }
}

/// The roles an instance plays; a set of bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct InstanceMask(u8);

impl InstanceMask {
    /// No role.
    pub const NONE: Self = Self(0);
    /// It never moves, so precomputed structures may hold it.
    pub const STATIC: Self = Self(1);
    /// It blocks and bounces light. Light is computed for every instance, whether it casts or not.
    pub const CASTER: Self = Self(2);
    /// Every role.
    pub const ALL: Self = Self(3);

    /// Whether every role of `other` is played.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The set as bits: 1 static, 2 caster.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// The roles of both.
    #[must_use]
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// These roles without those of `other`.
    #[must_use]
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }
}

/// What happened at load that the user should know.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadReport {
    /// One line each: ignored optional extensions, missing files, replaced values.
    pub warnings: Vec<String>,
    /// Geometry that was dropped.
    pub dropped: Dropped,
}

/// Numbers of triangles that were dropped at load, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Dropped {
    /// With an index beyond the vertices.
    pub out_of_range: u64,
    /// With a NaN or infinite position.
    pub non_finite: u64,
    /// With no area.
    pub zero_area: u64,
}

impl Dropped {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.out_of_range + self.non_finite + self.zero_area
    }
}

impl std::ops::AddAssign for Dropped {
    fn add_assign(&mut self, other: Self) {
        self.out_of_range += other.out_of_range;
        self.non_finite += other.non_finite;
        self.zero_area += other.zero_area;
    }
}

impl Scene {
    /// Number of triangles over all instances.
    pub fn triangle_count(&self) -> usize {
        self.instances
            .iter()
            .map(|instance| self.mesh(instance).triangles.len())
            .sum()
    }

    /// The mesh of an instance.
    #[inline]
    pub fn mesh(&self, instance: &Instance) -> &Arc<Mesh> {
        &self.meshes[instance.mesh as usize]
    }

    /// The box around all instances; empty without geometry.
    pub fn bounds(&self) -> Aabb {
        self.instances.iter().fold(Aabb::EMPTY, |bounds, instance| {
            let mesh = self.mesh(instance).bounds();
            if mesh.is_empty() {
                return bounds;
            }
            let corners = mesh
                .corners()
                .map(|corner| instance.transform.transform_point3(corner));
            bounds.union(&Aabb::around(corners))
        })
    }

    /// The camera of that name.
    pub fn camera(&self, name: &str) -> Option<&Camera> {
        self.cameras.iter().find(|camera| camera.name == name)
    }

    /// Whether anything gives light: a light, an emissive triangle or the environment.
    pub fn has_light(&self) -> bool {
        let shines = |light: &Light| light.intensity.max_element() > 0.0;
        let emits = |instance: &Instance| {
            self.mesh(instance)
                .triangle_materials
                .iter()
                .any(|&material| self.materials[material as usize].is_emissive())
        };
        self.lights.iter().any(shines)
            || !self.environment.is_black()
            || (self.materials.iter().any(Material::is_emissive)
                && self.instances.iter().any(emits))
    }

    /// Moves everything that is animated to where it is at a time in seconds. What would be beyond all numbers stays where
    /// it was.
    pub fn set_time(&mut self, seconds: f32) {
        let world = self.animation.world_transforms(seconds);
        let at = |node: Option<u32>| {
            let place = *world.get(node? as usize)?;
            place.is_finite().then_some(place)
        };
        for instance in &mut self.instances {
            instance.transform = at(instance.node).unwrap_or(instance.transform);
        }
        for light in &mut self.lights {
            light.transform = at(light.node).unwrap_or(light.transform);
        }
        for camera in &mut self.cameras {
            camera.transform = at(camera.node).unwrap_or(camera.transform);
        }
    }

    /// The transforms of all instances, as [`BuildTracer::update`](crate::BuildTracer::update) takes them.
    pub fn transforms(&self) -> Vec<Affine3A> {
        self.instances
            .iter()
            .map(|instance| instance.transform)
            .collect()
    }

    /// Puts another scene's meshes into this one, placed by `transform`; its lights and cameras are left out.
    /// Returns the range of the new instances.
    pub fn add(&mut self, other: &Self, transform: Affine3A) -> std::ops::Range<usize> {
        let (meshes, materials) = (self.meshes.len() as u32, self.materials.len() as u32);
        let textures = self.textures.len() as u32;
        self.textures.extend(other.textures.iter().cloned());
        self.materials
            .extend(other.materials.iter().cloned().map(|mut material| {
                for texture in material.textures_mut() {
                    texture.texture += textures;
                }
                material
            }));
        self.meshes.extend(other.meshes.iter().map(|mesh| {
            let mut mesh = Mesh::clone(mesh);
            mesh.triangle_materials
                .iter_mut()
                .for_each(|material| *material += materials);
            Arc::new(mesh)
        }));
        let first = self.instances.len();
        self.instances
            .extend(other.instances.iter().map(|instance| Instance {
                mesh: instance.mesh + meshes,
                transform: transform * instance.transform,
                node: None,
                ..instance.clone()
            }));
        self.report
            .warnings
            .extend(other.report.warnings.iter().cloned());
        first..self.instances.len()
    }

    /// Bytes held by meshes and textures.
    pub fn bytes(&self) -> usize {
        self.meshes.iter().map(|mesh| mesh.bytes()).sum::<usize>()
            + self
                .textures
                .iter()
                .map(|texture| texture.bytes())
                .sum::<usize>()
    }
}

/// The unit geometric normal of a triangle, counter-clockwise front; in 64 bits, so that no scale underflows.
pub fn unit_normal(a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    (b - a).cross(c - a).normalize_or_zero().as_vec3()
}

/// A triangle's area in square metres, calculated in 64 bits.
pub fn area(a: Vec3, b: Vec3, c: Vec3) -> f64 {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    0.5 * (b - a).cross(c - a).length()
}
