use glam::{Affine3A, Vec3};
use proptest::prelude::*;

use super::*;
use crate::{BruteForceTracer, Instance, Material, Mesh};

/// A scene of one mesh with every triangle's own corners.
fn soup(corners: &[[Vec3; 3]]) -> Arc<Scene> {
    let count = corners.len() as u32;
    let mesh = Mesh {
        positions: corners.iter().flatten().copied().collect(),
        normals: vec![Vec3::Y; corners.len() * 3],
        triangles: (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        triangle_materials: vec![0; corners.len()],
        ..Mesh::default()
    };
    Arc::new(Scene {
        meshes: vec![Arc::new(mesh)],
        materials: vec![Material::default()],
        instances: vec![Instance::new(0, Affine3A::IDENTITY)],
        ..Scene::default()
    })
}

fn point() -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(-1.0_f32..1.0).prop_map(Vec3::from_array)
}

/// Of any scale and any place, with many vertices in common and many planes parallel to the axes.
fn triangles() -> impl Strategy<Value = Vec<[Vec3; 3]>> {
    let corner = prop_oneof![
        point(),
        prop::array::uniform3(-2_i8..3).prop_map(|p| Vec3::from_array(p.map(f32::from)))
    ];
    let place = prop_oneof![Just(Vec3::ZERO), point().prop_map(|p| p * 1000.0)];
    let scale = prop_oneof![Just(1e-3_f32), Just(1.0), Just(1e3)];
    let corners = prop::collection::vec(prop::array::uniform3(corner), 1..60);
    (corners, place, scale).prop_map(|(corners, place, scale)| {
        corners
            .into_iter()
            .map(|triangle| triangle.map(|corner| (corner + place) * scale))
            .collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn answers_are_those_of_brute_force(
        corners in triangles(),
        rays in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>(), point(), point(), 0_u8..4), 100),
    ) {
        let scene = soup(&corners);
        let exact = BruteForceTracer::build(&scene, &Selection::default(), &()).unwrap();
        let tracer = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap();
        let points = &scene.meshes[0].positions;
        let size = scene.bounds().diagonal();
        for (from, to, offset, other, kind) in rays {
            // Aimed at vertices, at edges, along edges, or anywhere.
            let (from, to) = (from.index(points.len()), to.index(points.len()));
            let start = points[from];
            let target = match kind {
                0 => points[to],
                1 => points[to].lerp(points[to / 3 * 3 + (to + 1) % 3], other.x.abs()),
                2 => start + (points[to] - points[to / 3 * 3]),
                _ => start + size * other,
            };
            let origin = if kind == 2 { start } else { start + offset * size };
            for direction in [target - origin, offset.round(), -offset.signum() * other.round()] {
                let ray = Ray::new(origin, direction);
                prop_assert_eq!(exact.closest_hit(&ray), tracer.closest_hit(&ray), "{:?}", ray);
                prop_assert_eq!(exact.any_hit(&ray), tracer.any_hit(&ray), "{:?}", ray);
            }
        }
    }
}
