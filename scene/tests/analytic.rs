//! The reference integrators against scenes whose light can be calculated by hand.

use std::{f32::consts::PI, sync::Arc};

use glam::{Affine3A, Quat, Vec2, Vec3};
use isophote_scene::{
    Alpha, BruteForceTracer, BuildTracer, Camera, Environment, EnvironmentMap, Instance, Light,
    LightKind, Material, Mesh, Receivers, Scene, Selection,
    reference::{Materials, Quantity, Settings, Tracers, bake, render},
    unit_normal,
};

/// A scene of quads; the normal is on the counter-clockwise side of the corners.
#[derive(Default)]
struct Quads {
    scene: Scene,
}

impl Quads {
    fn add(&mut self, corners: [Vec3; 4], material: Material) {
        let [a, b, c, _] = corners;
        let index = self.scene.materials.len() as u32;
        self.scene.materials.push(material);
        let mesh = Mesh {
            positions: corners.to_vec(),
            normals: vec![unit_normal(a, b, c); 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            triangle_materials: vec![index; 2],
            ..Mesh::default()
        };
        self.scene.instances.push(Instance::new(
            self.scene.meshes.len() as u32,
            Affine3A::IDENTITY,
        ));
        self.scene.meshes.push(Arc::new(mesh));
    }

    /// A square of side 2·`half` at a height, facing up or down.
    fn square(&mut self, half: f32, height: f32, up: bool, material: Material) {
        let mut corners = square().map(|(x, z)| Vec3::new(x * half, height, z * half));
        if !up {
            corners.reverse();
        }
        self.add(corners, material);
    }

    /// A cube of side 2 around the origin, its fronts inside.
    fn closed_box(&mut self, material: &Material) {
        for turn in [
            Quat::IDENTITY,
            Quat::from_rotation_x(PI / 2.0),
            Quat::from_rotation_z(PI / 2.0),
        ] {
            for side in [-1.0, 1.0] {
                self.add(
                    square().map(|(x, z)| turn * Vec3::new(-x * side, side, z)),
                    material.clone(),
                );
            }
        }
    }
}

fn square() -> [(f32, f32); 4] {
    [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
}

fn gray(albedo: f32) -> Material {
    Material::diffuse("gray", Vec3::splat(albedo))
}

fn glowing(albedo: f32, radiance: f32) -> Material {
    Material {
        emissive: Vec3::splat(radiance),
        ..gray(albedo)
    }
}

fn settings(samples: u32) -> Settings {
    Settings {
        samples,
        materials: Materials::Lambert,
        ..Settings::default()
    }
}

/// The values at a point of triangle 0 of instance 0, given by its barycentric coordinates.
fn at(scene: &Arc<Scene>, uv: Vec2, quantities: &[Quantity], settings: &Settings) -> Vec<f32> {
    let tracer = BruteForceTracer::build(scene, &Selection::default(), &()).expect("has triangles");
    let mut receivers = Receivers::from_vertices(scene, 0);
    receivers.points.truncate(1);
    let surface = receivers.points[0].point.surface;
    receivers.points[0].point = scene.point_on(surface, uv);
    let tracers = Tracers {
        exact: &tracer,
        secondary: &tracer,
    };
    let (estimates, _) =
        bake(scene, tracers, &receivers, quantities, settings, &|_, _| {}).expect("valid");
    estimates
        .iter()
        .map(|estimate| estimate.values[0].x)
        .collect()
}

fn assert_close(name: &str, value: f32, expected: f32, relative: f32) {
    assert!(
        (value - expected).abs() <= relative * expected.abs(),
        "{name}: {value}, expected {expected}"
    );
}

#[test]
fn white_furnace() {
    // Closed and glowing: light that met k surfaces has radiance ρᵏ·L everywhere.
    for (albedo, radiance) in [(0.5, 2.0), (0.9, 1.0)] {
        let mut quads = Quads::default();
        quads.closed_box(&glowing(albedo, radiance));
        let scene = Arc::new(quads.scene);
        let quantities = [
            Quantity::Direct,
            Quantity::Indirect,
            Quantity::Path,
            Quantity::IrradianceDirect,
            Quantity::Ao,
        ];
        let values = at(&scene, Vec2::new(0.3, 0.2), &quantities, &settings(1 << 17));
        assert_close("direct", values[0], albedo * radiance, 0.005);
        assert_close("indirect", values[1], albedo * albedo * radiance, 0.005);
        let path: f32 = (1..=8).map(|k| albedo.powi(k) * radiance).sum();
        assert_close("path", values[2], path, 0.005);
        assert_close("irradiance", values[3], PI * radiance, 0.005);
        assert_eq!(values[4], 0.0, "nothing escapes from a closed box");
    }
}

#[test]
fn furnace_of_an_environment() {
    // A lone square under a uniform sky reflects what arrives; the same sky as a panorama gives the same.
    let map = EnvironmentMap::new(16, 8, vec![Vec3::splat(0.7); 128]).expect("valid");
    for environment in [
        Environment::Constant(Vec3::splat(0.7)),
        Environment::Map(map),
    ] {
        let mut quads = Quads::default();
        quads.square(1.0, 0.0, true, gray(0.8));
        quads.scene.environment = environment;
        let scene = Arc::new(quads.scene);
        let values = at(
            &scene,
            Vec2::splat(0.3),
            &[Quantity::Direct, Quantity::Path],
            &settings(4096),
        );
        assert_close("direct", values[0], 0.8 * 0.7, 0.005);
        assert_close("path", values[1], 0.8 * 0.7, 0.005);
    }
}

#[test]
fn parallel_squares() {
    // Point to parallel rectangle, one corner above the point, sides a and b at distance 1.
    let quadrant = |a: f32, b: f32| {
        let (p, q) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
        (a / p * (b / p).atan() + b / q * (a / q).atan()) / (2.0 * PI)
    };
    let mut quads = Quads::default();
    quads.square(1.0, 0.0, true, gray(0.5));
    quads.square(1.0, 1.0, false, glowing(0.0, 3.0));
    let scene = Arc::new(quads.scene);
    // The middle of the diagonal of triangle 0 is the middle of the square.
    let middle = at(
        &scene,
        Vec2::new(0.0, 0.5),
        &[Quantity::IrradianceDirect, Quantity::Ao],
        &settings(4096),
    );
    let form_factor = 4.0 * quadrant(1.0, 1.0);
    assert_close(
        "irradiance in the middle",
        middle[0],
        PI * 3.0 * form_factor,
        0.01,
    );
    assert_close("ao in the middle", middle[1], 1.0 - form_factor, 0.01);
    let corner = at(
        &scene,
        Vec2::ZERO,
        &[Quantity::IrradianceDirect],
        &settings(4096),
    );
    assert_close(
        "irradiance in the corner",
        corner[0],
        PI * 3.0 * quadrant(2.0, 2.0),
        0.01,
    );
}

#[test]
fn lamps_shine_only_where_their_mask_leaves_them() {
    let irradiance = |alpha: f32| {
        let mut lamp = glowing(0.0, 3.0);
        lamp.base_color.w = alpha;
        lamp.alpha = Alpha::Mask { cutoff: 0.5 };
        let mut quads = Quads::default();
        quads.square(1.0, 0.0, true, gray(0.5));
        quads.square(1.0, 1.0, false, lamp);
        let middle = Vec2::new(0.0, 0.5);
        at(
            &Arc::new(quads.scene),
            middle,
            &[Quantity::IrradianceDirect],
            &settings(64),
        )[0]
    };
    assert!(irradiance(0.75) > 1.0);
    assert_eq!(irradiance(0.25), 0.0);
}

/// Irradiance in the middle of a square on the ground.
fn lit_by(kind: LightKind, transform: Affine3A) -> f32 {
    let mut quads = Quads::default();
    quads.square(1.0, 0.0, true, gray(1.0));
    let light = Light {
        kind,
        transform,
        ..Light::point("light", Vec3::ZERO, Vec3::splat(5.0))
    };
    quads.scene.lights.push(light);
    at(
        &Arc::new(quads.scene),
        Vec2::new(0.0, 0.5),
        &[Quantity::IrradianceDirect],
        &settings(256),
    )[0]
}

#[test]
fn point_and_sphere_lights() {
    let above = Affine3A::from_translation(Vec3::new(3.0, 4.0, 0.0));
    let point = lit_by(LightKind::Point { radius: 0.0 }, above);
    assert_close("point", point, 5.0 * 0.8 / 25.0, 1e-4);
    // A sphere wholly above the horizon shines as a point in its centre does.
    assert_close(
        "sphere",
        lit_by(LightKind::Point { radius: 1.5 }, above),
        point,
        0.005,
    );
    // Half sunk below the horizon it still shines, but less than half as bright as from straight above.
    let beside = Affine3A::from_translation(Vec3::new(3.0, 0.0, 0.0));
    let sunk = lit_by(LightKind::Point { radius: 1.5 }, beside);
    assert!(sunk > 0.0 && sunk < 0.5 * 5.0 / 9.0, "{sunk}");
}

#[test]
fn directional_and_spot_lights() {
    let down = Affine3A::from_rotation_x(-PI / 2.0);
    assert_close("sun", lit_by(LightKind::Directional, down), 5.0, 1e-4);
    let low = Affine3A::from_rotation_x(-PI / 6.0);
    assert_close("low sun", lit_by(LightKind::Directional, low), 2.5, 1e-4);
    let spot = LightKind::Spot {
        inner: 0.2,
        outer: 0.5,
    };
    let height = Affine3A::from_translation(2.0 * Vec3::Y);
    assert_close("spot, middle", lit_by(spot, height * down), 5.0 / 4.0, 1e-4);
    let aside = height * Affine3A::from_rotation_x(-PI / 2.0 + 0.35);
    let falloff = ((0.35_f32.cos() - 0.5_f32.cos()) / (0.2_f32.cos() - 0.5_f32.cos())).powi(2);
    assert_close("spot, edge", lit_by(spot, aside), 5.0 / 4.0 * falloff, 1e-3);
    assert_eq!(
        lit_by(spot, height * Affine3A::from_rotation_x(PI / 2.0)),
        0.0,
        "shines away"
    );
}

#[test]
fn sphere_over_a_plane() {
    // A sphere of radius r whose centre is h above a plane hides r²h/D³ of a point at distance D.
    let (radius, height) = (0.5, 0.8);
    let mut quads = Quads::default();
    quads.square(50.0, 0.0, true, gray(0.5));
    quads.scene.instances.push(Instance::new(
        1,
        Affine3A::from_translation(Vec3::new(0.0, height, 0.0)),
    ));
    quads.scene.meshes.push(Arc::new(sphere(radius)));
    let scene = Arc::new(quads.scene);
    for x in [0.0, 0.4, 1.0] {
        // Triangle 0 has its corners at (−50, 50), (50, 50) and (50, −50) in x and z.
        let uv = Vec2::new(x / 100.0, 0.5);
        let distance = Vec2::new(x, height).length();
        let expected = 1.0 - radius * radius * height / distance.powi(3);
        let value = at(&scene, uv, &[Quantity::Ao], &settings(4096))[0];
        assert!(
            (value - expected).abs() < 0.01,
            "at {x}: {value}, expected {expected}"
        );
    }
    let near = Settings {
        d_max: 0.25,
        ..settings(1024)
    };
    assert_eq!(
        at(&scene, Vec2::new(0.0, 0.5), &[Quantity::Ao], &near),
        [1.0],
        "beyond d_max"
    );
    let far = Settings {
        d_max: 2.0,
        ..settings(1024)
    };
    let values = at(
        &scene,
        Vec2::new(0.0, 0.5),
        &[Quantity::Ao, Quantity::Obscurance],
        &far,
    );
    assert!(values[0] < values[1] && values[1] < 1.0, "{values:?}");
}

#[test]
fn bounded_geometry_term() {
    // Two squares 1 m apart: with min_d far below nothing changes, far above nothing is left.
    let mut quads = Quads::default();
    quads.square(1.0, 0.0, true, gray(0.5));
    quads.square(1.0, 1.0, false, gray(0.5));
    quads
        .scene
        .lights
        .push(Light::point("light", Vec3::new(0.0, 0.1, 0.0), Vec3::ONE));
    let scene = Arc::new(quads.scene);
    let with = |min_d| {
        let settings = Settings {
            min_d,
            ..settings(2048)
        };
        at(
            &scene,
            Vec2::new(0.1, 0.5),
            &[Quantity::Indirect],
            &settings,
        )[0]
    };
    let whole = with(0.0);
    assert!(whole > 0.0);
    assert_close("small bound", with(0.5), whole, 1e-5);
    assert_eq!(with(10.0), 0.0);
    let part = with(1.0);
    assert!(
        0.2 * whole < part && part < 0.95 * whole,
        "{part} of {whole}"
    );
}

#[test]
fn pictures_do_not_depend_on_threads() {
    let mut quads = Quads::default();
    quads.square(1.0, 0.0, true, gray(0.5));
    quads.square(0.3, 0.5, false, glowing(0.2, 3.0));
    let scene = Arc::new(quads.scene);
    let tracer =
        BruteForceTracer::build(&scene, &Selection::default(), &()).expect("has triangles");
    let camera = Camera::look_at("", Vec3::new(0.0, 1.0, 2.0), Vec3::ZERO, 1.0);
    let picture = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        let tracers = Tracers {
            exact: &tracer,
            secondary: &tracer,
        };
        let quantities = [Quantity::Path, Quantity::Ao];
        let work = || {
            render(
                &scene,
                tracers,
                &camera,
                [37, 23],
                &quantities,
                &settings(5),
                &|_, _| {},
            )
        };
        pool.install(work).expect("valid")
    };
    let (one, three) = (picture(1), picture(3));
    assert_eq!(one.estimates, three.estimates);
    assert_eq!(one.rays, three.rays);
    // The middle sees the floor under the lamp, the upper corner nothing.
    let path = &one.estimates[0].values;
    assert!(path[23 / 2 * 37 + 18].x > 0.01 && path[0] == Vec3::ZERO);
    assert_eq!(one.estimates[1].values[0], Vec3::ONE);
    assert!(one.estimates[0].noise > 0.0);
}

fn sphere(radius: f32) -> Mesh {
    let (rings, sectors) = (24_u32, 48_u32);
    let mut mesh = Mesh::default();
    for ring in 0..=rings {
        for sector in 0..=sectors {
            let (theta, phi) = (
                PI * ring as f32 / rings as f32,
                2.0 * PI * sector as f32 / sectors as f32,
            );
            let normal = Vec3::new(
                theta.sin() * phi.cos(),
                theta.cos(),
                theta.sin() * phi.sin(),
            );
            mesh.positions.push(radius * normal);
            mesh.normals.push(normal);
        }
    }
    for ring in 0..rings {
        for sector in 0..sectors {
            let a = ring * (sectors + 1) + sector;
            let b = a + sectors + 1;
            mesh.triangles.extend([[a, a + 1, b], [a + 1, b + 1, b]]);
        }
    }
    mesh.triangle_materials = vec![0; mesh.triangles.len()];
    isophote_scene::clean(&mut mesh);
    mesh
}
