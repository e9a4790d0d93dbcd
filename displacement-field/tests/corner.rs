//! Ambient occlusion and soft shadows at the vertices of a corner in which an object stands, as in Fig. 5, 6 and 8, against
//! exact answers to the same rays: what the README states of it.
#![expect(clippy::unwrap_used, reason = "tests")]

mod support;

use std::{path::Path, sync::Arc};

use glam::{Affine3A, Vec2, Vec3};
use isophote_displacement_field::{
    Directions, Field, FieldParams, FieldTracer, LookUp, Storage, alone,
};
use isophote_scene::{BvhTracer, Mesh, Ray, Scene, Tracer, load, sample::Frame};
use rayon::prelude::*;
use support::{exact, placed, scene};

/// Vertices on a side of a plane.
const SIDE: usize = 33;
/// Rays of a vertex, on each side of their square.
const RAYS: usize = 16;

struct Corner {
    mesh: Arc<Mesh>,
    alone: BvhTracer,
    scene: Arc<Scene>,
    exact: BvhTracer,
    radius: f32,
    /// How long a plane's sides are, and the distance of the light's middle from two of them, metres.
    side: f32,
}

impl Corner {
    fn new(mesh: Arc<Mesh>) -> Self {
        let itself = scene(&mesh, &[Affine3A::IDENTITY]);
        let alone = exact(&Arc::new(alone(&itself, &mesh)));
        let few = FieldParams {
            resolution: 1,
            ..support::coarse()
        };
        let sphere = Field::build(&mesh, &alone, &few, &|_, _| {})
            .unwrap()
            .sphere();
        let side = 4.0 * sphere.radius;
        let foot = Vec3::new(sphere.center.x, mesh.bounds().min.y, sphere.center.z);
        let place = Affine3A::from_translation(Vec3::new(0.5 * side, 0.0, 0.5 * side) - foot);
        let scene = scene(&mesh, &[place]);
        Self {
            exact: exact(&scene),
            mesh,
            alone,
            scene,
            radius: sphere.radius,
            side,
        }
    }

    fn field(&self, params: &FieldParams) -> Field {
        Field::build(&self.mesh, &self.alone, params, &|_, _| {}).unwrap()
    }

    fn tracer(&self, field: &Field, look_up: LookUp) -> FieldTracer {
        placed(&self.scene, field.clone(), look_up)
    }

    /// The share of each vertex's rays that hit nothing.
    fn open(&self, tracer: &dyn Tracer, ray: impl Fn(Vec3, Vec3, Vec2) -> Ray + Sync) -> Vec<f64> {
        let step = self.side / (SIDE - 1) as f32;
        let axes = [Vec3::X, Vec3::Y, Vec3::Z];
        let vertex = |index: usize| {
            let (plane, place) = (index / (SIDE * SIDE), index % (SIDE * SIDE));
            let (i, j) = ((place % SIDE) as f32, (place / SIDE) as f32);
            let (u, v) = (axes[(plane + 1) % 3], axes[(plane + 2) % 3]);
            let rays: Vec<Ray> = (0..RAYS * RAYS)
                .map(|index| {
                    let place = Vec2::new((index % RAYS) as f32, (index / RAYS) as f32) + 0.5;
                    ray(step * (i * u + j * v), axes[plane], place / RAYS as f32)
                })
                .collect();
            let mut hits = vec![false; rays.len()];
            tracer.any_hits(&rays, &mut hits);
            hits.iter().filter(|hit| !**hit).count() as f64 / rays.len() as f64
        };
        (0..3 * SIDE * SIDE).into_par_iter().map(vertex).collect()
    }

    fn ao(&self, tracer: &dyn Tracer) -> Vec<f64> {
        self.open(tracer, |point, normal, place| {
            let local = Directions::Concentric.direction(place).unwrap();
            Ray::new(point, Frame::new(normal).to_world(local))
        })
    }

    /// How much is seen of a square light over the object, one radius wide.
    fn shadows(&self, tracer: &dyn Tracer) -> Vec<f64> {
        let over = Vec3::new(0.5 * self.side, 3.5 * self.radius, 0.5 * self.side);
        self.open(tracer, |point, _, place| {
            let place = self.radius * (place - 0.5);
            let way = over + Vec3::new(place.x, 0.0, place.y) - point;
            let (direction, distance) = way.normalize_and_length();
            Ray::new(point, direction).until(distance)
        })
    }
}

/// In grey levels.
fn rms(values: &[f64], truth: &[f64]) -> f64 {
    let squares = values.iter().zip(truth).map(|(a, b)| (a - b).powi(2));
    255.0 * (squares.sum::<f64>() / truth.len() as f64).sqrt()
}

fn constant(truth: &[f64]) -> f64 {
    let mean = truth.iter().sum::<f64>() / truth.len() as f64;
    rms(&vec![mean; truth.len()], truth)
}

#[test]
fn storage_at_the_vertices_of_a_corner() {
    let corner = Corner::new(support::torus("torus", 64, 32, 0.4));
    let truth = corner.ao(&corner.exact);
    let error = |params: FieldParams, look_ups: &[LookUp]| -> Vec<f64> {
        let field = corner.field(&params);
        let errors = look_ups.iter().map(|&look_up| {
            let error = rms(&corner.ao(&corner.tracer(&field, look_up)), &truth);
            eprintln!(
                "{:?} {}² {:?} {look_up:?}: RMS {error:.3}",
                params.directions, params.resolution, params.storage
            );
            error
        });
        errors.collect()
    };
    eprintln!("RMS of a constant {:.3}", constant(&truth));
    let bytes = error(FieldParams::default(), &LookUp::ALL);
    let floats = FieldParams {
        storage: Storage::Float,
        ..FieldParams::default()
    };
    let floats = error(floats, &LookUp::ALL);
    assert!(
        bytes[0] < 1.9 && bytes[1] < 1.6 && bytes[2] < 1.3,
        "{bytes:?}"
    );
    for (byte, float) in bytes.iter().zip(&floats) {
        assert!((byte - float).abs() < 0.6, "{bytes:?} {floats:?}");
    }
    let bits = FieldParams {
        resolution: 64,
        storage: Storage::Bit,
        ..FieldParams::default()
    };
    let bits = error(bits, &[LookUp::Nearest]);
    assert!(bits[0] < 3.2, "{bits:?}");
}

#[test]
fn soft_shadows_at_the_vertices_of_a_corner() {
    let corner = Corner::new(support::torus("torus", 64, 32, 0.4));
    let truth = corner.shadows(&corner.exact);
    let field = corner.field(&FieldParams::default());
    let of_constant = constant(&truth);
    for look_up in LookUp::ALL {
        let error = rms(&corner.shadows(&corner.tracer(&field, look_up)), &truth);
        eprintln!("{look_up:?}: RMS {error:.3}, of a constant {of_constant:.3}");
        assert!(
            error < 5.0 && 10.0 * error < of_constant,
            "{look_up:?}: {error}"
        );
    }
}

/// The meshes of a file as one, without the floor that they stand on.
fn joined(scene: &Scene) -> Arc<Mesh> {
    let mut mesh = Mesh::default();
    for instance in &scene.instances {
        let part = scene.mesh(instance);
        if part.triangles.len() <= 20 {
            continue;
        }
        let first = mesh.positions.len() as u32;
        let place = |point: &Vec3| instance.transform.transform_point3(*point);
        mesh.positions.extend(part.positions.iter().map(place));
        mesh.normals.extend(&part.normals);
        mesh.triangles
            .extend(part.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    mesh.triangle_materials = vec![0; mesh.triangles.len()];
    Arc::new(mesh)
}

#[test]
fn a_bunny_in_a_corner() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes/bunny.glb");
    if !file.exists() {
        eprintln!("skipped: there is no {}", file.display());
        return;
    }
    let corner = Corner::new(joined(&load(&file).unwrap()));
    let field = corner.field(&FieldParams::default());
    let truth = corner.ao(&corner.exact);
    for (look_up, most) in [
        (LookUp::Nearest, 2.2),
        (LookUp::Aimed, 2.2),
        (LookUp::Interpolated, 2.0),
    ] {
        let error = rms(&corner.ao(&corner.tracer(&field, look_up)), &truth);
        eprintln!(
            "{look_up:?}: RMS {error:.3}, of a constant {:.3}",
            constant(&truth)
        );
        assert!(error < most, "{look_up:?}: {error}");
    }
}
