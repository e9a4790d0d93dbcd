//! What fields are not for is refused, and what is at the edge of it has answers.

mod support;

use std::sync::Arc;

use glam::{Affine3A, Mat3A, Vec3};
use isophote_displacement_field::{
    Error, Field, FieldParams, FieldTracer, LookUp, Object, Positions,
};
use isophote_scene::{
    Aabb, Answers, BvhTracer, Hit, Instance, Mesh, Ray, Scene, Selection, Tracer,
};
use support::{coarse, errors, exact, field, mesh, placed, rays, scene, torus};

#[test]
fn what_cannot_be_placed_is_refused() {
    let torus = torus("torus", 8, 8, 0.4);
    let field = field(&torus, &coarse());
    let refused = |transform: Affine3A, part: &str| {
        let scene = scene(&torus, &[transform]);
        let objects = vec![Object::new(field.clone())];
        let error = FieldTracer::new(&scene, &Selection::default(), objects, LookUp::Aimed)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(part) && error.contains("instance 0"),
            "{error}"
        );
    };
    refused(
        Affine3A::from_scale(Vec3::new(1.0, 1.1, 1.0)),
        "different amounts",
    );
    refused(
        Affine3A::from_mat3(Mat3A::from_cols_array(&[1., 0., 0., 0.05, 1., 0., 0., 0., 1.]).into()),
        "sheared",
    );
    refused(Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0)), "flattened");
    refused(Affine3A::from_scale(Vec3::splat(1e-16)), "so small");
    refused(Affine3A::from_scale(Vec3::splat(1e16)), "so large");
    let none = FieldTracer::new(
        &scene(&torus, &[Affine3A::IDENTITY]),
        &Selection::default(),
        Vec::new(),
        LookUp::Aimed,
    );
    assert!(matches!(none, Err(Error::Parameter { .. })));
}

/// Bounds that leave a mesh out, of which an instance moves into them.
#[test]
fn what_moves_into_the_bounds_without_a_field_is_refused() {
    let torus = torus("torus", 8, 8, 0.4);
    let mut two = Scene::clone(&scene(&torus, &[Affine3A::IDENTITY]));
    two.meshes.push(torus.clone());
    let away = Affine3A::from_translation(Vec3::X * 50.0);
    two.instances.push(Instance::new(1, away));
    let two = Arc::new(two);
    let selection = Selection {
        bounds: Some(Aabb::around([Vec3::splat(-2.0), Vec3::splat(2.0)])),
        ..Selection::default()
    };
    let object = Object::new(field(&torus, &coarse()));
    for objects in [vec![object.clone()], vec![object, Object::default()]] {
        let mut tracer = FieldTracer::new(&two, &selection, objects, LookUp::Aimed).unwrap();
        let refused = tracer.update(&[Affine3A::IDENTITY; 2]).unwrap_err();
        assert!(matches!(refused, Error::Parameter { .. }), "{refused}");
        // All is where it was.
        assert_eq!(tracer.spheres().count(), 1);
        tracer.update(&two.transforms()).unwrap();
    }
}

/// A tracer that tells too little.
struct Blind(BvhTracer);

impl Tracer for Blind {
    fn answers(&self) -> Answers {
        Answers::Occlusion
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.0.closest_hit(ray)
    }
}

#[test]
fn what_cannot_be_built_is_refused() {
    let torus = torus("torus", 8, 8, 0.4);
    let here = scene(&torus, &[Affine3A::IDENTITY]);
    let tracer = exact(&here);
    let build = |mesh: &Mesh, params| Field::build(mesh, &tracer, &params, &|_, _| {});
    let blind = Field::build(&torus, &Blind(exact(&here)), &coarse(), &|_, _| {});
    assert!(blind.unwrap_err().to_string().contains("Distance"));
    assert!(matches!(
        build(&Mesh::default(), coarse()),
        Err(Error::Empty { .. })
    ));
    let far = mesh(&[[Vec3::X, Vec3::Y, Vec3::Z].map(|corner| corner + 1e7)]);
    assert!(matches!(build(&far, coarse()), Err(Error::Far { .. })));
    let huge = mesh(&[[Vec3::X, Vec3::Y, Vec3::Z].map(|corner| corner * 1e20)]);
    assert!(matches!(build(&huge, coarse()), Err(Error::Size { .. })));
    for params in [
        FieldParams {
            resolution: 0,
            ..coarse()
        },
        FieldParams {
            positions: Positions::Slater { rings: 0 },
            ..coarse()
        },
        FieldParams {
            positions: Positions::Octahedral { side: 4000 },
            ..coarse()
        },
        FieldParams {
            positions: Positions::Spherical {
                rows: 1,
                columns: 9,
            },
            ..coarse()
        },
    ] {
        assert!(matches!(
            build(&torus, params),
            Err(Error::Parameter { .. })
        ));
    }
    let many = FieldParams {
        resolution: 1024,
        ..coarse()
    };
    assert!(matches!(build(&torus, many), Err(Error::TooLarge { .. })));
}

/// Flat meshes, single triangles, rays along a tangent and from the centre: all have answers near the truth.
#[test]
fn degenerate_objects_and_rays() {
    let corners = [
        Vec3::ZERO,
        Vec3::new(1.0, 0.0, 0.0),
        Vec3::new(0.0, 0.0, 1.0),
    ];
    let flat = [
        corners,
        [Vec3::ONE * Vec3::new(1.0, 0.0, 1.0), corners[2], corners[1]],
    ];
    for (triangles, scale) in [
        (&flat[..1], 1.0),
        (&flat[..], 1.0),
        (&flat[..], 1e-12),
        (&flat[..], 1e12),
    ] {
        let triangles: Vec<_> = triangles
            .iter()
            .map(|t| t.map(|corner| corner * scale))
            .collect();
        let mesh = mesh(&triangles);
        let scene = scene(&mesh, &[Affine3A::IDENTITY]);
        let field = field(&mesh, &coarse());
        let sphere = field.sphere();
        assert!((sphere.radius / scale - 0.5_f32.sqrt()).abs() < 1e-3);
        let truth = exact(&scene);
        for look_up in LookUp::ALL {
            let tracer = placed(&scene, field.clone(), look_up);
            let [wrong, off] = errors(&tracer, &truth, &rays(sphere.center, sphere.radius, 1000));
            assert!(
                wrong < 0.06 && off < 0.2 * f64::from(scale),
                "{scale} {wrong} {off}"
            );
            // From the centre, which lies in the plane, any answer may be right, but it must be one.
            for direction in [Vec3::Y, Vec3::X, Vec3::new(1.0, 1.0, 0.0)] {
                let hit = tracer.closest_hit(&Ray::new(sphere.center, direction));
                assert!(hit.is_none_or(|hit| hit.t > 0.0 && hit.t <= sphere.radius));
            }
            // A tangent, and what is just beside it.
            for beside in [0.999, 1.0, 1.001] {
                let origin = sphere.center + sphere.radius * Vec3::new(beside, 0.0, -3.0);
                assert!(tracer.closest_hit(&Ray::new(origin, Vec3::Z)).is_none());
            }
        }
    }
}
