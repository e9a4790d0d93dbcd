//! Vertices and triangles of all meshes, packed.

use glam::{Vec2, Vec3, Vec4};

use crate::{Mesh, Scene};

/// Words of four of a vertex: position and normal; first texture coordinates and colour.
const VERTEX: usize = 2;

/// All meshes in two arrays.
pub(super) struct Geometry {
    pub(super) vertices: Vec<[u32; 4]>,
    /// Three vertices, counted within the mesh, and a material.
    pub(super) triangles: Vec<[u32; 4]>,
    pub(super) places: Vec<MeshPlace>,
}

/// Where a mesh lies in the arrays.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeshPlace {
    pub(super) first_vertex: u32,
    pub(super) first_triangle: u32,
    /// In words of four; `u32::MAX` where the mesh has no second texture coordinates.
    pub(super) second_uv: u32,
    pub(super) triangle_count: u32,
}

impl Geometry {
    /// How many bytes vertices and triangles will take.
    pub(super) fn bytes(scene: &Scene) -> [u64; 2] {
        let mut words = [0_u64; 2];
        for mesh in &scene.meshes {
            words[0] += (VERTEX * mesh.positions.len() + mesh.uvs[1].len().div_ceil(2)) as u64;
            words[1] += mesh.triangles.len() as u64;
        }
        words.map(|words| 16 * words)
    }

    /// Packs a scene's meshes; [`bytes`](Self::bytes) has been found to fit, so that counts fit 32 bits.
    pub(super) fn new(scene: &Scene) -> Self {
        let [vertex_bytes, triangle_bytes] = Self::bytes(scene);
        let mut geometry = Self {
            vertices: Vec::with_capacity(vertex_bytes as usize / 16),
            triangles: Vec::with_capacity(triangle_bytes as usize / 16),
            places: Vec::with_capacity(scene.meshes.len()),
        };
        // First the vertices of all meshes, so that a vertex's place is a multiple of its size.
        for mesh in &scene.meshes {
            geometry.push(mesh);
        }
        for (index, mesh) in scene.meshes.iter().enumerate() {
            if !mesh.uvs[1].is_empty() {
                geometry.places[index].second_uv = geometry.vertices.len() as u32;
                geometry.vertices.extend(mesh.uvs[1].chunks(2).map(|pair| {
                    let second = pair.get(1).copied().unwrap_or_default();
                    [pair[0].x, pair[0].y, second.x, second.y].map(f32::to_bits)
                }));
            }
        }
        geometry
    }

    fn push(&mut self, mesh: &Mesh) {
        self.places.push(MeshPlace {
            first_vertex: (self.vertices.len() / VERTEX) as u32,
            first_triangle: self.triangles.len() as u32,
            second_uv: u32::MAX,
            triangle_count: mesh.triangles.len() as u32,
        });
        for (vertex, position) in mesh.positions.iter().enumerate() {
            let [x, y, z] = position.to_array().map(f32::to_bits);
            let uv = mesh.uvs[0].get(vertex).copied().unwrap_or(Vec2::ZERO);
            let color = mesh.colors.get(vertex).copied().unwrap_or(Vec4::ONE);
            self.vertices
                .push([x, y, z, octahedral(mesh.normals[vertex])]);
            self.vertices.push([
                uv.x.to_bits(),
                uv.y.to_bits(),
                unorm16x2(color.x, color.y),
                unorm16x2(color.z, color.w),
            ]);
        }
        let materials = &mesh.triangle_materials;
        self.triangles.extend(
            mesh.triangles
                .iter()
                .zip(materials)
                .map(|(&[a, b, c], &m)| [a, b, c, m]),
        );
    }
}

/// A unit vector as two signed 16-bit numbers (Meyer et al., "On Floating-Point Normal Vectors", EGSR 2010), off by
/// less than 0.004 degrees.
fn octahedral(normal: Vec3) -> u32 {
    let normal = normal / normal.abs().element_sum().max(f32::MIN_POSITIVE);
    let folded = if normal.z < 0.0 {
        let sign = |x: f32| if x >= 0.0 { 1.0 } else { -1.0 };
        Vec2::new(
            (1.0 - normal.y.abs()) * sign(normal.x),
            (1.0 - normal.x.abs()) * sign(normal.y),
        )
    } else {
        normal.truncate()
    };
    let snorm = |x: f32| u32::from((x.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
    snorm(folded.x) | snorm(folded.y) << 16
}

fn unorm16x2(x: f32, y: f32) -> u32 {
    let unorm = |x: f32| (x.clamp(0.0, 1.0) * 65535.0).round() as u32;
    unorm(x) | unorm(y) << 16
}
