//! What is to be seen of a lightmap's seams: edges between triangles that lie in different places of the atlas.

use std::collections::HashMap;

use glam::{Vec2, Vec3};
use isophote_scene::{Mesh, Scene, unit_normal};

use super::{
    layout::Layout,
    report::{Collected, SMOOTH},
    texels::Lightmap,
};

/// Most points of an edge that are looked at.
const MOST_POINTS: f32 = 64.0;

/// A corner's coordinates, bit by bit.
type Corner = [u32; 3];

/// One side of an edge: its ends in the order of the key, in texels, and the normal of its triangle.
#[derive(Clone, Copy)]
struct Side {
    ends: [Vec2; 2],
    normal: Vec3,
}

/// The differences between the two sides of all seams of smooth surfaces, one for about every texel along them.
pub(super) fn seams(scene: &Scene, layout: &Layout, map: &Lightmap) -> Collected {
    let mut collected = Collected::default();
    for (instance, corners) in layout.corners.iter().enumerate() {
        let mesh = scene.mesh(&scene.instances[instance]);
        for [a, b] in pairs(mesh, corners) {
            let length = |side: &Side| side.ends[0].distance(side.ends[1]);
            let points = length(&a).max(length(&b)).ceil().clamp(1.0, MOST_POINTS);
            for point in 0..points as u32 {
                let part = (point as f32 + 0.5) / points;
                let [a, b] = [a, b].map(|side| map.sample(side.ends[0].lerp(side.ends[1], part)));
                collected.add(a, b);
            }
        }
    }
    collected
}

/// Edges whose two sides lie apart, though the surface is smooth.
fn pairs(mesh: &Mesh, corners: &[[Vec2; 3]]) -> Vec<[Side; 2]> {
    let mut open: HashMap<[Corner; 2], Side> = HashMap::new();
    let mut pairs = Vec::new();
    for (triangle, uvs) in corners.iter().enumerate() {
        let places = mesh.corners(triangle);
        let [a, b, c] = places;
        let normal = unit_normal(a, b, c);
        for edge in 0..3 {
            let [from, to] = [edge, (edge + 1) % 3];
            let [p, q] = [from, to].map(|i| places[i].to_array().map(f32::to_bits));
            let (key, ends) = if p < q {
                ([p, q], [uvs[from], uvs[to]])
            } else {
                ([q, p], [uvs[to], uvs[from]])
            };
            let side = Side { ends, normal };
            let Some(other) = open.remove(&key) else {
                open.insert(key, side);
                continue;
            };
            if other.ends != side.ends && other.normal.dot(side.normal) > SMOOTH {
                pairs.push([other, side]);
            }
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles of one square, far apart in the atlas: a seam of one edge. Side by side: none.
    #[test]
    fn seams_are_edges_that_lie_apart() {
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        let at = |uvs: [[f32; 2]; 3]| uvs.map(Vec2::from);
        let first = at([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]]);
        let beside = at([[0.0, 0.0], [4.0, 4.0], [0.0, 4.0]]);
        let apart = beside.map(|uv| uv + 8.0);
        assert_eq!(pairs(&mesh, &[first, beside]).len(), 0);
        assert_eq!(pairs(&mesh, &[first, apart]).len(), 1);
    }
}
