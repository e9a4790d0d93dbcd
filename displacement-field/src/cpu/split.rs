//! A mesh in parts, each with a sphere of its own: the sphere tree of the paper's future work (§5).
//!
//! Long objects leave their sphere empty: its positions lie far from the object, and few directions of each map meet it.
//! Parts have tighter spheres and, with fewer positions each, the same memory.

use std::sync::Arc;

use glam::Vec3;
use isophote_scene::{Aabb, Mesh};

use crate::{Error, Result};

/// Divides a mesh into parts of about equally long sides: over and over the part with the longest box is cut in its middle,
/// across. Parts have no fewer than one triangle, so there may be less than asked for.
///
/// # Errors
/// [`Error::Parameter`] unless `parts` is within 1..=64.
pub fn split(mesh: &Arc<Mesh>, parts: u32) -> Result<Vec<Arc<Mesh>>> {
    if !(1..=64).contains(&parts) {
        return Err(Error::Parameter {
            name: "the number of parts",
            value: parts.to_string(),
            expected: "it must be within 1..=64",
        });
    }
    if parts == 1 {
        return Ok(vec![mesh.clone()]);
    }
    let center = |triangle: &usize| mesh.corners(*triangle).iter().sum::<Vec3>() / 3.0;
    let sides = |part: &[usize]| {
        let bounds = Aabb::around(part.iter().map(center));
        bounds.max - bounds.min
    };
    let mut divided: Vec<Vec<usize>> = vec![(0..mesh.triangles.len()).collect()];
    while divided.len() < parts as usize {
        let longest = (0..divided.len())
            .filter(|&index| divided[index].len() > 1)
            .max_by(|&a, &b| {
                let length = |index: usize| sides(&divided[index]).max_element();
                length(a).total_cmp(&length(b))
            });
        let Some(longest) = longest else { break };
        let part = divided.swap_remove(longest);
        let axis = sides(&part).max_position();
        let bounds = Aabb::around(part.iter().map(center));
        let middle = bounds.center()[axis];
        let (mut below, mut above): (Vec<_>, Vec<_>) = part
            .into_iter()
            .partition(|triangle| center(triangle)[axis] < middle);
        // All centres at one place: any cut is as good.
        if below.is_empty() || above.is_empty() {
            below.append(&mut above);
            above = below.split_off(below.len() / 2);
        }
        divided.extend([below, above]);
    }
    Ok(divided
        .iter()
        .map(|part| Arc::new(take(mesh, part)))
        .collect())
}

/// The triangles of a part, with all vertices they need.
fn take(mesh: &Mesh, part: &[usize]) -> Mesh {
    let mut new = vec![u32::MAX; mesh.positions.len()];
    let mut old = Vec::new();
    let triangles: Vec<[u32; 3]> = part
        .iter()
        .map(|&triangle| {
            mesh.triangles[triangle].map(|vertex| {
                let slot = &mut new[vertex as usize];
                if *slot == u32::MAX {
                    *slot = old.len() as u32;
                    old.push(vertex as usize);
                }
                *slot
            })
        })
        .collect();
    fn pick<T: Copy>(values: &[T], old: &[usize]) -> Vec<T> {
        let kept = old.iter().filter_map(|&vertex| values.get(vertex).copied());
        kept.collect()
    }
    Mesh {
        name: mesh.name.clone(),
        positions: pick(&mesh.positions, &old),
        normals: pick(&mesh.normals, &old),
        uvs: [0, 1].map(|set| pick(&mesh.uvs[set], &old)),
        colors: pick(&mesh.colors, &old),
        triangle_materials: part
            .iter()
            .map(|&triangle| mesh.triangle_materials[triangle])
            .collect(),
        triangles,
    }
}
