//! Makes a mesh fit to be computed with, and counts what had to go.

use glam::{Vec2, Vec3, Vec4};

use crate::{Dropped, Mesh, area, unit_normal};

/// The largest coordinate, in metres, that is traced: beyond it squares of distances overflow.
pub(crate) const LARGEST_COORDINATE: f32 = 1e18;

/// Drops the triangles that nothing can be computed with and counts them: indices out of range, positions that are not
/// finite or beyond 10¹⁸ m, areas that are zero.
///
/// What is left is made whole: normals that are not unit vectors are normalised, or replaced by the triangle's own;
/// texture coordinates that are not finite become 0, colours that are not finite white, and all others are held
/// within 0..=1; vertices that no triangle uses are made finite too. Vertex arrays of the wrong length are dropped.
///
/// Every loader and every built-in scene goes through this, so that nothing after it needs to check again.
pub fn clean(mesh: &mut Mesh) -> Dropped {
    mesh.triangle_materials.resize(mesh.triangles.len(), 0);
    let dropped = drop_triangles(mesh);
    for position in &mut mesh.positions {
        if !is_usable(*position) {
            *position = Vec3::ZERO;
        }
    }
    clean_normals(mesh);
    for uvs in &mut mesh.uvs {
        if uvs.len() != mesh.positions.len() {
            uvs.clear();
        }
        for uv in uvs {
            if !uv.is_finite() {
                *uv = Vec2::ZERO;
            }
        }
    }
    if mesh.colors.len() != mesh.positions.len() {
        mesh.colors.clear();
    }
    for color in &mut mesh.colors {
        *color = if color.is_finite() {
            color.clamp(Vec4::ZERO, Vec4::ONE)
        } else {
            Vec4::ONE
        };
    }
    dropped
}

fn drop_triangles(mesh: &mut Mesh) -> Dropped {
    let mut dropped = Dropped::default();
    let positions = &mesh.positions;
    let keep = |triangle: &[u32; 3]| match triangle.map(|i| positions.get(i as usize).copied()) {
        [Some(a), Some(b), Some(c)] => {
            if ![a, b, c].into_iter().all(is_usable) {
                dropped.non_finite += 1;
                return false;
            }
            let has_area = area(a, b, c) > 0.0;
            dropped.zero_area += u64::from(!has_area);
            has_area
        }
        _ => {
            dropped.out_of_range += 1;
            false
        }
    };
    let keep: Vec<bool> = mesh.triangles.iter().map(keep).collect();
    if dropped.total() > 0 {
        retain(&mut mesh.triangles, &keep);
        retain(&mut mesh.triangle_materials, &keep);
    }
    dropped
}

fn clean_normals(mesh: &mut Mesh) {
    mesh.normals.resize(mesh.positions.len(), Vec3::ZERO);
    for normal in &mut mesh.normals {
        // Unit vectors that were rounded stay as they are, so that a saved mesh loads unchanged.
        if (normal.length_squared() - 1.0).abs() <= 1e-4 {
            continue;
        }
        // In 64 bits no finite length overflows or vanishes.
        let unit = normal.as_dvec3().try_normalize();
        *normal = unit.map_or(Vec3::ZERO, |unit| unit.as_vec3());
    }
    for triangle in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(triangle);
        for vertex in mesh.triangles[triangle] {
            let normal = &mut mesh.normals[vertex as usize];
            if *normal == Vec3::ZERO {
                *normal = unit_normal(a, b, c);
            }
        }
    }
    // What is left belongs to no triangle.
    for normal in &mut mesh.normals {
        if *normal == Vec3::ZERO {
            *normal = Vec3::Y;
        }
    }
}

fn is_usable(position: Vec3) -> bool {
    // Also false for NaN.
    position.abs().cmple(Vec3::splat(LARGEST_COORDINATE)).all()
}

fn retain<T>(values: &mut Vec<T>, keep: &[bool]) {
    let mut flags = keep.iter();
    values.retain(|_| flags.next().copied().unwrap_or(false));
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
        Mesh {
            normals: vec![Vec3::Z; positions.len()],
            triangle_materials: (0..triangles.len() as u32).collect(),
            positions,
            triangles,
            ..Mesh::default()
        }
    }

    #[test]
    fn drops_and_counts() {
        let nan = Vec3::new(f32::NAN, 0.0, 0.0);
        let far = Vec3::new(0.0, 2e18, 0.0);
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, nan, far, Vec3::X * 2.0];
        let triangles = vec![
            [0, 1, 6],
            [0, 1, 3],
            [0, 1, 2],
            [0, 4, 2],
            [0, 1, 5],
            [1, 1, 2],
            [2, 1, 0],
        ];
        let mut mesh = mesh(positions, triangles);
        let dropped = clean(&mut mesh);
        let expected = Dropped {
            out_of_range: 1,
            non_finite: 2,
            zero_area: 2,
        };
        assert_eq!(dropped, expected);
        assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 0]]);
        assert_eq!(mesh.triangle_materials, [2, 6]);
    }

    #[test]
    fn keeps_triangles_of_every_size() {
        for size in [1e-30, 1e-12, 1.0, 1e12, 1e17] {
            let positions = vec![Vec3::ZERO, Vec3::X * size, Vec3::Y * size];
            let mut mesh = mesh(positions, vec![[0, 1, 2]]);
            mesh.normals = vec![Vec3::ZERO; 3];
            assert_eq!(clean(&mut mesh).total(), 0, "{size}");
            assert_eq!(mesh.normals, [Vec3::Z; 3], "{size}");
        }
    }

    fn any_float() -> impl Strategy<Value = f32> {
        prop_oneof![any::<f32>(), -2.0_f32..2.0]
    }

    proptest! {
        #[test]
        fn what_is_left_is_whole(
            numbers in prop::collection::vec([any_float(), any_float(), any_float()], 9),
            triangles in prop::collection::vec([0..5_u32, 0..5_u32, 0..5_u32], 0..8),
            normals in 0..6_usize,
        ) {
            let vector = |numbers: &[f32; 3]| Vec3::from(*numbers);
            let mut mesh = mesh(numbers[..4].iter().map(vector).collect(), triangles);
            mesh.normals = numbers[3..3 + normals].iter().map(vector).collect();
            mesh.uvs[0] = numbers[..4].iter().map(|n| Vec2::new(n[1], n[2])).collect();
            mesh.colors = numbers[4..8].iter().map(|n| vector(n).extend(n[0])).collect();
            let before = mesh.triangles.len() as u64;
            let dropped = clean(&mut mesh);
            prop_assert_eq!(dropped.total() + mesh.triangles.len() as u64, before);
            prop_assert_eq!(mesh.triangles.len(), mesh.triangle_materials.len());
            prop_assert!(mesh.positions.iter().all(|p| p.is_finite()));
            prop_assert_eq!(mesh.normals.len(), 4);
            prop_assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3));
            prop_assert!(mesh.uvs[0].iter().all(|uv| uv.is_finite()));
            prop_assert!(mesh.colors.iter().all(|c| c.cmpge(Vec4::ZERO).all() && c.cmple(Vec4::ONE).all()));
            for triangle in 0..mesh.triangles.len() {
                let [a, b, c] = mesh.corners(triangle);
                prop_assert!(area(a, b, c) > 0.0);
            }
            prop_assert_eq!(clean(&mut mesh).total(), 0);
        }
    }
}
