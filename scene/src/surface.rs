//! What is found at a hit: position, normals, and the material with its textures looked up.

use glam::{Vec2, Vec3, Vec4};

use crate::{Aabb, Alpha, Hit, Material, Mesh, Scene, SurfaceId, TextureRef, unit_normal};

/// A point on a surface, in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The triangle it lies on.
    pub surface: SurfaceId,
    /// Metres.
    pub position: Vec3,
    /// How far `position` may be off the triangle's plane by rounding, metres: rays that start here are lifted by it.
    pub error: f32,
    /// Unit normal of the triangle; its counter-clockwise side is the front.
    pub geometric_normal: Vec3,
    /// Unit interpolated normal of the vertices.
    pub shading_normal: Vec3,
    /// Texture coordinates of both sets.
    pub uvs: [Vec2; 2],
    /// Linear RGBA factor from the vertices.
    pub color: Vec4,
    /// Index in [`Scene::materials`].
    pub material: u32,
}

/// A material's values at a point, every texture looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceMaterial {
    /// Linear RGB.
    pub base_color: Vec3,
    /// 0..=1.
    pub metallic: f32,
    /// 0..=1.
    pub roughness: f32,
    /// Emitted radiance, linear RGB.
    pub emissive: Vec3,
    /// 0..=1.
    pub transmission: f32,
    /// At least 1.
    pub ior: f32,
    /// See [`Material::unlit`].
    pub unlit: bool,
}

impl SurfacePoint {
    /// Where a ray in a direction starts: lifted to the direction's side of the triangle by the rounding error and
    /// what else the tracer asks for, so that it does not hit the triangle it starts on.
    #[inline]
    pub fn lifted(&self, direction: Vec3, tolerance: f32) -> Vec3 {
        let side = 1_f32.copysign(self.geometric_normal.dot(direction));
        self.position + side * (self.error + tolerance) * self.geometric_normal
    }
}

/// A normal, turned to the side of a direction.
#[inline]
pub fn facing(normal: Vec3, direction: Vec3) -> Vec3 {
    if normal.dot(direction) < 0.0 {
        -normal
    } else {
        normal
    }
}

impl Scene {
    /// The point a hit stands for. The hit must be of a tracer of this scene that answers
    /// [`Surface`](crate::Answers::Surface).
    pub fn surface_point(&self, hit: &Hit) -> SurfacePoint {
        self.point_on(hit.surface, hit.uv)
    }

    /// A point of a triangle by barycentric coordinates, as in [`Hit::uv`].
    pub fn point_on(&self, surface: SurfaceId, uv: Vec2) -> SurfacePoint {
        let instance = &self.instances[surface.instance as usize];
        let mesh = &*self.meshes[instance.mesh as usize];
        let corners = mesh
            .corners(surface.primitive as usize)
            .map(|corner| instance.transform.transform_point3(corner));
        let [a, b, c] = corners;
        let indices = mesh.triangles[surface.primitive as usize];
        let weights = [1.0 - uv.x - uv.y, uv.x, uv.y];
        let mut geometric_normal = unit_normal(a, b, c);
        // A mirroring transform turns the winding over, but the front stays the front.
        let matrix = instance.transform.matrix3;
        if matrix.determinant() < 0.0 {
            geometric_normal = -geometric_normal;
        }
        let normal = blend(&mesh.normals, indices, weights);
        // The cofactor matrix is the inverse transpose up to a positive or negative factor, defined at any scale.
        let (x, y, z) = (matrix.x_axis, matrix.y_axis, matrix.z_axis);
        let cofactor = glam::Mat3A::from_cols(y.cross(z), z.cross(x), x.cross(y));
        let turned = Vec3::from(cofactor * glam::Vec3A::from(normal));
        let turned = if matrix.determinant() < 0.0 {
            -turned
        } else {
            turned
        };
        // Rounding is relative to the largest coordinate that took part: the corners' and the translation's.
        let largest = Aabb::around(corners)
            .grown(instance.transform.translation.into())
            .largest_coordinate();
        SurfacePoint {
            surface,
            position: weights[0] * a + weights[1] * b + weights[2] * c,
            error: 16.0 * f32::EPSILON * largest,
            geometric_normal,
            shading_normal: turned.try_normalize().unwrap_or(geometric_normal),
            uvs: [0, 1].map(|set| texture_coordinates(mesh, set, indices, weights)),
            color: if mesh.colors.is_empty() {
                Vec4::ONE
            } else {
                blend(&mesh.colors, indices, weights)
            },
            material: mesh.triangle_materials[surface.primitive as usize],
        }
    }

    /// The material at a point, at the textures' full resolution.
    pub fn surface_material(&self, point: &SurfacePoint) -> SurfaceMaterial {
        self.surface_material_at(point, 0.0)
    }

    /// The material at a point, textures read at mip level `lod` (0 is the full resolution).
    pub fn surface_material_at(&self, point: &SurfacePoint, lod: f32) -> SurfaceMaterial {
        let material = &self.materials[point.material as usize];
        let read = |texture: &Option<TextureRef>| {
            texture.as_ref().map_or(Vec4::ONE, |texture| {
                let uv = texture.coordinates(&point.uvs);
                self.textures[texture.texture as usize].sample(uv, lod)
            })
        };
        let metallic_roughness = read(&material.metallic_roughness_texture);
        SurfaceMaterial {
            base_color: (material.base_color * point.color * read(&material.base_color_texture))
                .truncate(),
            metallic: (material.metallic * metallic_roughness.z).clamp(0.0, 1.0),
            roughness: (material.roughness * metallic_roughness.y).clamp(0.0, 1.0),
            emissive: material.emissive * read(&material.emissive_texture).truncate(),
            transmission: (material.transmission * read(&material.transmission_texture).x)
                .clamp(0.0, 1.0),
            ior: material.ior,
            unlit: material.unlit,
        }
    }

    /// Whether a ray stops at a triangle's point: always, unless its material is masked and transparent there.
    #[inline]
    pub fn alpha_passes(&self, surface: SurfaceId, uv: Vec2) -> bool {
        let mesh = self.mesh(&self.instances[surface.instance as usize]);
        let material =
            &self.materials[mesh.triangle_materials[surface.primitive as usize] as usize];
        match material.alpha {
            Alpha::Opaque => true,
            Alpha::Mask { cutoff } => alpha(self, mesh, material, surface.primitive, uv) >= cutoff,
        }
    }

    /// Whether a triangle's material may let rays pass, so that [`alpha_passes`](Self::alpha_passes) must be asked.
    pub fn is_masked(&self, surface: SurfaceId) -> bool {
        let mesh = self.mesh(&self.instances[surface.instance as usize]);
        let material = mesh.triangle_materials[surface.primitive as usize];
        matches!(self.materials[material as usize].alpha, Alpha::Mask { .. })
    }
}

/// Alpha of a triangle's point: factor × vertex colour × texture.
fn alpha(scene: &Scene, mesh: &Mesh, material: &Material, primitive: u32, uv: Vec2) -> f32 {
    let indices = mesh.triangles[primitive as usize];
    let weights = [1.0 - uv.x - uv.y, uv.x, uv.y];
    let mut alpha = material.base_color.w;
    if !mesh.colors.is_empty() {
        alpha *= blend(&mesh.colors, indices, weights).w;
    }
    if let Some(texture) = &material.base_color_texture {
        let uvs = [0, 1].map(|set| texture_coordinates(mesh, set, indices, weights));
        alpha *= scene.textures[texture.texture as usize]
            .sample(texture.coordinates(&uvs), 0.0)
            .w;
    }
    alpha
}

fn texture_coordinates(mesh: &Mesh, set: usize, indices: [u32; 3], weights: [f32; 3]) -> Vec2 {
    if mesh.uvs[set].is_empty() {
        Vec2::ZERO
    } else {
        blend(&mesh.uvs[set], indices, weights)
    }
}

#[inline]
fn blend<T>(values: &[T], indices: [u32; 3], weights: [f32; 3]) -> T
where
    T: Copy + std::ops::Add<Output = T> + std::ops::Mul<f32, Output = T>,
{
    let [a, b, c] = indices.map(|i| values[i as usize]);
    a * weights[0] + b * weights[1] + c * weights[2]
}
