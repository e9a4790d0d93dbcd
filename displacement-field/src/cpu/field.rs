//! The displacement field of a mesh: its sphere, and what every ray into it meets.

use std::{
    collections::HashMap,
    hash::Hasher,
    sync::{Arc, LazyLock, Mutex, PoisonError, Weak},
};

use isophote_scene::Mesh;
use siphasher::sip128::{Hasher128, SipHasher13};

use super::{build::bounding_sphere, samples::Samples};
use crate::{FieldParams, Positions, Sphere, Storage};

/// How far rays that enter the bounding sphere of a mesh travel before they meet it: one field for all instances and all
/// levels of detail of the mesh.
#[derive(Clone, Debug)]
pub struct Field {
    pub(crate) params: FieldParams,
    pub(crate) sphere: Sphere,
    pub(crate) mesh_key: [u64; 2],
    /// The positions on the unit sphere; the fourth number fills a register.
    pub(crate) points: Arc<[[f32; 4]]>,
    pub(crate) samples: Samples,
}

impl Field {
    pub(crate) fn new(
        params: FieldParams,
        sphere: Sphere,
        mesh_key: [u64; 2],
        samples: Samples,
    ) -> Self {
        Self {
            params,
            sphere,
            mesh_key,
            points: points(params.positions),
            samples,
        }
    }

    /// How it was sampled.
    pub const fn params(&self) -> &FieldParams {
        &self.params
    }

    /// The sphere around the mesh, in its own space.
    pub const fn sphere(&self) -> Sphere {
        self.sphere
    }

    /// Whether it was built of this mesh, vertex by vertex. Levels of detail of a mesh have other keys and may use its
    /// field all the same: see [`fits`](Self::fits).
    pub fn is_of(&self, mesh: &Mesh) -> bool {
        self.mesh_key == mesh_key(mesh)
    }

    /// Whether a mesh has about the same bounding sphere, to a tenth of its radius: as other levels of detail of the mesh
    /// that it was built of have. What lies outside the field's sphere does not exist for it.
    pub fn fits(&self, mesh: &Mesh) -> bool {
        let near = 0.1 * self.sphere.radius;
        bounding_sphere(mesh).is_ok_and(|Sphere { center, radius }| {
            center.distance(self.sphere.center) <= near
                && (radius - self.sphere.radius).abs() <= near
        })
    }

    /// Whether it is sampled and kept as another one.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        let max_bytes = other.params.max_bytes;
        FieldParams {
            max_bytes,
            ..self.params
        } == other.params
    }

    /// Bytes of its samples; the positions are shared by all fields that have the same.
    pub fn bytes(&self) -> usize {
        self.samples.bytes()
    }

    /// How far answers may be off where a ray's surroundings are smooth, in metres of the mesh's space: half the way to
    /// the next position, or to what the next direction of a map sees in the middle of the sphere. No bound: of rays all over a
    /// torus some 70 % are answered as exactly as that, and those that graze edges may be off by the sphere's size.
    pub fn tolerance(&self) -> f32 {
        let directions = crate::directions::reach(self.params.directions, self.params.resolution);
        self.sphere.radius * self.params.positions.reach().max(0.5 * directions)
    }

    /// The same field with a bit for each direction, for distant instances (§4): no ray is traced for it.
    #[must_use]
    pub fn with_bits(&self) -> Self {
        if self.params.storage == Storage::Bit {
            return self.clone();
        }
        let params = FieldParams {
            storage: Storage::Bit,
            ..self.params
        };
        let (cells, cosines) = (params.cells(), params.cosines());
        let mut samples = Samples::with_room(&params);
        let mut map = vec![0.0; cells];
        for position in 0..self.points.len() {
            for (cell, distance) in map.iter_mut().enumerate() {
                *distance = self.samples.distance(position, cell, cells, cosines[cell]);
            }
            samples.extend(&map, &cosines);
        }
        Self {
            params,
            sphere: self.sphere,
            mesh_key: self.mesh_key,
            points: self.points.clone(),
            samples,
        }
    }
}

impl FieldParams {
    /// The cosine to the normal of each cell of a map; 0 where the mapping has no direction.
    pub(crate) fn cosines(&self) -> Vec<f32> {
        let direction = |cell| self.directions.of_cell(cell, self.resolution);
        (0..self.cells())
            .map(|cell| direction(cell).map_or(0.0, |direction| direction.z))
            .collect()
    }
}

/// The hash of a mesh's corners.
pub(crate) fn mesh_key(mesh: &Mesh) -> [u64; 2] {
    let mut hasher = SipHasher13::new();
    for triangle in 0..mesh.triangles.len() {
        hasher.write(bytemuck::cast_slice(&mesh.corners(triangle)));
    }
    let hash = hasher.finish128();
    [hash.h1, hash.h2]
}

/// The points of an arrangement, once for all fields that live.
fn points(positions: Positions) -> Arc<[[f32; 4]]> {
    type Tables = HashMap<Positions, Weak<[[f32; 4]]>>;
    static TABLES: LazyLock<Mutex<Tables>> = LazyLock::new(Mutex::default);
    let mut tables = TABLES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(points) = tables.get(&positions).and_then(Weak::upgrade) {
        return points;
    }
    let points: Arc<[[f32; 4]]> = (0..positions.count())
        .map(|index| positions.point(index).extend(0.0).to_array())
        .collect();
    tables.retain(|_, points| points.strong_count() > 0);
    tables.insert(positions, Arc::downgrade(&points));
    points
}
