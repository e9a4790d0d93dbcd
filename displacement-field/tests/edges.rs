//! What fields are not for is refused, and what is at the edge of it has answers.

mod support;

use glam::{Affine3A, Mat3A, Vec3};
use isophote_displacement_field::{
    Error, Field, FieldParams, FieldTracer, LookUp, Object, Positions,
};
use isophote_scene::{Answers, BvhTracer, Hit, Mesh, Ray, Selection, Tracer};
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
    let none = FieldTracer::new(
        &scene(&torus, &[Affine3A::IDENTITY]),
        &Selection::default(),
        Vec::new(),
        LookUp::Aimed,
    );
    assert!(matches!(none, Err(Error::Parameter { .. })));
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
