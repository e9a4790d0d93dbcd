//! Which triangles take part, and in what order.
//!
//! Some drivers (Mesa's llvmpipe) build their tree over the triangles in the order in which they come, so
//! neighbours are kept together: triangles are sorted along a Morton curve.

use glam::{Affine3A, Vec3};

use crate::{Aabb, Alpha, Error, Mesh, Result, Scene, Selection};

/// Triangles of a mesh that are one acceleration structure: opaque ones and masked ones apart, because only masked ones
/// need the shader's word.
pub(super) struct Part {
    /// Primitives by geometry; none is empty, there are at most two.
    pub(super) geometries: Vec<PartGeometry>,
}

pub(super) struct PartGeometry {
    pub(super) opaque: bool,
    pub(super) primitives: Vec<u32>,
    /// Three corners for each primitive, in the mesh's space.
    pub(super) corners: Vec<[Vec3; 3]>,
}

/// What takes part.
pub(super) struct Geometry {
    pub(super) parts: Vec<Part>,
    /// Instance of the scene and its part.
    pub(super) placed: Vec<(u32, usize)>,
    instance_count: usize,
}

impl Geometry {
    /// The selected triangles; instances of a mesh that are wholly selected share a part.
    pub(super) fn new(
        scene: &Scene,
        selection: &Selection,
        transforms: &[Affine3A],
    ) -> Result<Self> {
        let mut geometry = Self {
            parts: Vec::new(),
            placed: Vec::new(),
            instance_count: scene.instances.len(),
        };
        let mut whole = vec![None; scene.meshes.len()];
        for (index, (instance, transform)) in scene.instances.iter().zip(transforms).enumerate() {
            if !instance.mask.contains(selection.mask) {
                continue;
            }
            let mesh = scene.mesh(instance);
            let selected = |primitive: &u32| {
                selection.bounds.is_none_or(|bounds| {
                    let corners = mesh.corners(*primitive as usize);
                    let corners = corners.map(|corner| transform.transform_point3(corner));
                    bounds.overlaps(&Aabb::around(corners))
                })
            };
            let all = 0..mesh.triangles.len() as u32;
            let primitives: Vec<u32> = all.clone().filter(selected).collect();
            if primitives.is_empty() {
                continue;
            }
            let shared =
                (primitives.len() == all.len()).then_some(&mut whole[instance.mesh as usize]);
            let part = match shared {
                Some(Some(part)) => *part,
                shared => {
                    geometry.parts.push(Part::new(scene, mesh, primitives));
                    let part = geometry.parts.len() - 1;
                    if let Some(shared) = shared {
                        *shared = Some(part);
                    }
                    part
                }
            };
            geometry.placed.push((index as u32, part));
        }
        if geometry.placed.is_empty() {
            return Err(Error::NoGeometry {
                reason: "no triangle is selected".into(),
            });
        }
        Ok(geometry)
    }

    /// Where the primitives of each instance's two geometries begin in the table, then all primitives; filled up to a
    /// multiple of four.
    pub(super) fn primitive_table(&self) -> Vec<u32> {
        let mut table = vec![0; 2 * self.instance_count];
        let mut first = Vec::with_capacity(self.parts.len());
        for part in &self.parts {
            let mut begins = [0; 2];
            for (begin, geometry) in begins.iter_mut().zip(&part.geometries) {
                *begin = table.len() as u32;
                table.extend(&geometry.primitives);
            }
            first.push(begins);
        }
        for &(instance, part) in &self.placed {
            table[2 * instance as usize..][..2].copy_from_slice(&first[part]);
        }
        table.resize(table.len().next_multiple_of(4), 0);
        table
    }
}

impl Part {
    fn new(scene: &Scene, mesh: &Mesh, mut primitives: Vec<u32>) -> Self {
        let codes = MortonCodes::new(&primitives, mesh);
        primitives.sort_by_cached_key(|&primitive| {
            (codes.of(mesh.corners(primitive as usize)), primitive)
        });
        let is_opaque = |primitive: &u32| {
            let material = mesh.triangle_materials[*primitive as usize];
            scene.materials[material as usize].alpha == Alpha::Opaque
        };
        let (opaque, masked): (Vec<u32>, Vec<u32>) = primitives.into_iter().partition(is_opaque);
        let geometries = [(true, opaque), (false, masked)]
            .into_iter()
            .filter(|(_, primitives)| !primitives.is_empty())
            .map(|(opaque, primitives)| PartGeometry {
                opaque,
                corners: primitives
                    .iter()
                    .map(|&primitive| mesh.corners(primitive as usize))
                    .collect(),
                primitives,
            })
            .collect();
        Self { geometries }
    }
}

/// Places along a Morton curve through a box.
pub(super) struct MortonCodes {
    low: Vec3,
    scale: Vec3,
}

impl MortonCodes {
    fn new(primitives: &[u32], mesh: &Mesh) -> Self {
        let corners = primitives
            .iter()
            .flat_map(|&primitive| mesh.corners(primitive as usize));
        Self::within(&Aabb::around(corners))
    }

    pub(super) fn within(bounds: &Aabb) -> Self {
        let extent = (bounds.max - bounds.min).max(Vec3::splat(f32::MIN_POSITIVE));
        Self {
            low: bounds.min,
            scale: 1024.0 / extent,
        }
    }

    /// 30 bits for the middle of a triangle.
    pub(super) fn of(&self, corners: [Vec3; 3]) -> u32 {
        let middle =
            (corners[0] / 3.0 + corners[1] / 3.0 + corners[2] / 3.0 - self.low) * self.scale;
        // A conversion saturates, so a middle that is rounded out of the box stays in range.
        let [x, y, z] = middle.to_array().map(|x| spread((x as u32).min(1023)));
        x | y << 1 | z << 2
    }
}

/// Ten bits with two zeros after each.
fn spread(mut x: u32) -> u32 {
    x = (x | x << 16) & 0x0300_00ff;
    x = (x | x << 8) & 0x0300_f00f;
    x = (x | x << 4) & 0x030c_30c3;
    (x | x << 2) & 0x0924_9249
}
