//! Triangle meshes and the boxes around them.

use glam::{Vec2, Vec3, Vec4};

/// An indexed triangle mesh in its own space, metres.
///
/// The vertex arrays `normals` and `positions` have one entry per vertex; `uvs` and `colors` have one per
/// vertex or are empty. Every index is in range, every position finite and every triangle has a positive
/// area: [`clean`](crate::clean()) sees to that at load.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// The name in the file; may be empty.
    pub name: String,
    /// Vertex positions, metres.
    pub positions: Vec<Vec3>,
    /// Unit shading normals, one per vertex.
    pub normals: Vec<Vec3>,
    /// Texture coordinates of the sets 0 and 1, (0, 0) at the image's top left; each set may be empty.
    pub uvs: [Vec<Vec2>; 2],
    /// Linear RGBA factors of the base colour, each in 0..=1; may be empty, which means white.
    pub colors: Vec<Vec4>,
    /// Vertex indices; counter-clockwise as seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// For every triangle the index of its material in [`Scene::materials`](crate::Scene::materials).
    pub triangle_materials: Vec<u32>,
}

impl Mesh {
    /// The three corners of a triangle.
    #[inline]
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|i| self.positions[i as usize])
    }

    /// The box around all triangles (not around unused vertices).
    pub fn bounds(&self) -> Aabb {
        let mut bounds = Aabb::EMPTY;
        for triangle in 0..self.triangles.len() {
            for corner in self.corners(triangle) {
                bounds.grow(corner);
            }
        }
        bounds
    }

    /// Bytes held by the vertex and index arrays.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.positions[..])
            + size_of_val(&self.normals[..])
            + self
                .uvs
                .iter()
                .map(|set| size_of_val(&set[..]))
                .sum::<usize>()
            + size_of_val(&self.colors[..])
            + size_of_val(&self.triangles[..])
            + size_of_val(&self.triangle_materials[..])
    }
}

/// An axis-aligned box, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// The corner with the smallest coordinates.
    pub min: Vec3,
    /// The corner with the largest coordinates.
    pub max: Vec3,
}

impl Aabb {
    /// The box that contains nothing.
    pub const EMPTY: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
    };

    /// The smallest box around some points.
    pub fn around(points: impl IntoIterator<Item = Vec3>) -> Self {
        let mut bounds = Self::EMPTY;
        for point in points {
            bounds.grow(point);
        }
        bounds
    }

    /// Whether the box contains nothing.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// Makes the box contain a point.
    pub fn grow(&mut self, point: Vec3) {
        self.min = self.min.min(point);
        self.max = self.max.max(point);
    }

    /// The box, made to contain a point.
    #[must_use]
    pub fn grown(mut self, point: Vec3) -> Self {
        self.grow(point);
        self
    }

    /// The largest absolute value of any coordinate, which rounding errors are relative to; 0 when empty.
    pub fn largest_coordinate(&self) -> f32 {
        if self.is_empty() {
            0.0
        } else {
            self.min.abs().max(self.max.abs()).max_element()
        }
    }

    /// The smallest box around two.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }

    /// Whether two boxes share at least a point.
    pub fn overlaps(&self, other: &Self) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }

    /// The middle.
    pub fn center(&self) -> Vec3 {
        0.5 * (self.min + self.max)
    }

    /// Length of the space diagonal; 0 for an empty box.
    pub fn diagonal(&self) -> f32 {
        if self.is_empty() {
            0.0
        } else {
            (self.max - self.min).length()
        }
    }

    /// The eight corners.
    pub fn corners(&self) -> [Vec3; 8] {
        std::array::from_fn(|i| {
            Vec3::new(
                if i & 1 == 0 { self.min.x } else { self.max.x },
                if i & 2 == 0 { self.min.y } else { self.max.y },
                if i & 4 == 0 { self.min.z } else { self.max.z },
            )
        })
    }
}
