//! An object on the floor of a tessellated corner, as in Fig. 5 and 6.

use std::{sync::Arc, time::Instant};

use glam::{Affine3A, Vec2, Vec3};
use isophote_displacement_field::{
    Directions, Field, FieldParams, FieldTracer, LookUp, Object, ObjectParams, Positions, Storage,
    alone,
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Instance, Mesh, Ray, Scene, Selection, Tracer,
    sample::Frame,
};
use serde_json::{Value, json};

use crate::Case;

/// Vertices on a side of a plane.
const SIDE: usize = 33;
/// Rays of a vertex, on each side of their square.
const RAYS: usize = 16;
const REPEATS: usize = 3;
/// How long a plane's sides are, in diameters of the object's sphere.
pub(crate) const DIAMETERS: f32 = 2.0;

/// A mesh of its own, and where it stands.
pub(crate) struct Corner {
    name: String,
    mesh: Arc<Mesh>,
    scene: Arc<Scene>,
    exact: BvhTracer,
    alone: BvhTracer,
    radius: f32,
    side: f32,
}

/// Rays, and what each counts.
pub(crate) struct Rays {
    pub(crate) rays: Vec<Ray>,
    weights: Vec<f32>,
}

/// All instances of a scene as one mesh, without the floor that objects stand on in their files.
pub(crate) fn joined(scene: &Scene) -> Mesh {
    /// Of a floor, at most.
    const FEW: usize = 20;
    let mut mesh = Mesh::default();
    for instance in &scene.instances {
        let part = scene.mesh(instance);
        if part.triangles.len() <= FEW {
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
    mesh
}

/// A scene of one mesh, placed.
pub(crate) fn scene_of(mesh: &Arc<Mesh>, places: Vec<Affine3A>) -> Arc<Scene> {
    Arc::new(Scene {
        meshes: vec![mesh.clone()],
        materials: vec![isophote_scene::Material::diffuse("", Vec3::ONE)],
        instances: places
            .into_iter()
            .map(|place| Instance::new(0, place))
            .collect(),
        ..Scene::default()
    })
}

pub(crate) fn exact(scene: &Arc<Scene>) -> BvhTracer {
    BvhTracer::build(scene, &Selection::default(), &BvhOptions::default()).expect("a tracer")
}

/// The vertices of three planes that meet in the origin, and their normals.
pub(crate) fn vertices(side: f32) -> Vec<(Vec3, Vec3)> {
    let step = side / (SIDE - 1) as f32;
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    let mut vertices = Vec::new();
    for normal in [1, 0, 2] {
        let (u, v) = (axes[(normal + 1) % 3], axes[(normal + 2) % 3]);
        for index in 0..SIDE * SIDE {
            let (i, j) = ((index % SIDE) as f32, (index / SIDE) as f32);
            vertices.push((step * (i * u + j * v), axes[normal]));
        }
    }
    vertices
}

impl Corner {
    pub(crate) fn new(name: &str, scene: Arc<Scene>) -> Self {
        Self::of(name, Arc::new(joined(&scene)))
    }

    pub(crate) fn of(name: &str, mesh: Arc<Mesh>) -> Self {
        let bounds = mesh.bounds();
        let coarse = FieldParams {
            positions: Positions::Slater { rings: 1 },
            resolution: 1,
            ..FieldParams::default()
        };
        let itself = scene_of(&mesh, vec![Affine3A::IDENTITY]);
        let alone_tracer = exact(&Arc::new(alone(&itself, &mesh)));
        let sphere = Field::build(&mesh, &alone_tracer, &coarse, &|_, _| {})
            .expect("a field")
            .sphere();
        let side = 2.0 * DIAMETERS * sphere.radius;
        let place = Vec3::new(0.5 * side, 0.0, 0.5 * side)
            - Vec3::new(sphere.center.x, bounds.min.y, sphere.center.z);
        let scene = scene_of(&mesh, vec![Affine3A::from_translation(place)]);
        Self {
            name: name.rsplit('/').next().unwrap_or(name).to_owned(),
            exact: exact(&scene),
            alone: alone_tracer,
            mesh,
            scene,
            radius: sphere.radius,
            side,
        }
    }

    fn vertices(&self) -> Vec<(Vec3, Vec3)> {
        vertices(self.side)
    }

    /// The rays of all vertices by a mapping of the square.
    pub(crate) fn rays(&self, directions: Directions) -> Rays {
        let places = (0..RAYS * RAYS)
            .map(|index| Vec2::new((index % RAYS) as f32, (index / RAYS) as f32) + 0.5);
        let locals: Vec<Vec3> = places
            .filter_map(|place| directions.direction(place / RAYS as f32))
            .collect();
        let mut all = Rays {
            rays: Vec::new(),
            weights: Vec::new(),
        };
        for (point, normal) in self.vertices() {
            let frame = Frame::new(normal);
            for local in &locals {
                all.rays.push(Ray::new(point, frame.to_world(*local)));
                let density = directions.density(*local) * std::f32::consts::PI;
                all.weights.push(local.z / density / locals.len() as f32);
            }
        }
        all
    }

    pub(crate) fn field(&self, params: &FieldParams) -> (Field, f64) {
        let start = Instant::now();
        let field = Field::build(&self.mesh, &self.alone, params, &|_, _| {}).expect("a field");
        (field, start.elapsed().as_secs_f64())
    }

    pub(crate) fn tracer(&self, object: Object, look_up: LookUp) -> FieldTracer {
        FieldTracer::new(&self.scene, &Selection::default(), vec![object], look_up)
            .expect("a tracer")
    }

    /// Each case; those of 32 bits first, with which the others are compared.
    pub(crate) fn measure_all(&self, cases: &[Case], speed: bool, memory: bool) {
        let is_float = |case: &&Case| case.params.storage == Storage::Float;
        let (floats, others): (Vec<_>, Vec<_>) = cases.iter().partition(is_float);
        let mut whole: Vec<(Case, Vec<f64>)> = Vec::new();
        for case in floats.into_iter().chain(others) {
            let ao = self.measure(case, speed, memory, &whole);
            if case.params.storage == Storage::Float {
                whole.push((*case, ao));
            }
        }
    }

    /// One case; returns its ambient occlusion, with which those that store less are compared.
    fn measure(
        &self,
        case: &Case,
        speed: bool,
        memory: bool,
        whole: &[(Case, Vec<f64>)],
    ) -> Vec<f64> {
        let (field, build_seconds) = self.field(&case.params);
        let bytes = field.bytes();
        let coded = memory.then(|| field.coded_bytes());
        let tracer = self.tracer(Object::new(field), case.look_up);
        let (mut report, ao) = self.report(&tracer, case.params.directions);
        if let Some((_, of_floats)) = whole.iter().find(|known| known.0.is_but_stored_as(case)) {
            report["ao_rms_of_floats"] = json!(difference(&ao, of_floats)[0]);
        }
        report["positions"] = json!(case.params.positions.count());
        report["resolution"] = json!(case.params.resolution);
        report["directions"] = json!(format!("{:?}", case.params.directions).to_lowercase());
        report["storage"] = json!(format!("{:?}", case.params.storage).to_lowercase());
        report["look_up"] = json!(format!("{:?}", case.look_up).to_lowercase());
        report["build_seconds"] = json!(build_seconds);
        report["bytes"] = json!(bytes);
        if let Some(coded) = coded {
            report["coded_bytes"] = json!(coded);
        }
        if speed {
            self.add_rates(&tracer, &mut report);
            self.add_shadows(&tracer, &mut report);
        }
        println!("{report}");
        ao
    }

    /// Several spheres, at about the memory of one.
    pub(crate) fn measure_parts(&self, parts: u32) {
        let rings = (32.0 / f64::from(parts).sqrt()).round() as u32;
        let params = ObjectParams {
            field: FieldParams {
                positions: Positions::Slater { rings },
                storage: Storage::Byte,
                ..FieldParams::default()
            },
            parts,
            distant: false,
        };
        let start = Instant::now();
        let tracer = |scene: &Arc<Scene>| {
            BvhTracer::build(scene, &Selection::default(), &BvhOptions::default())
        };
        let object = Object::build(&self.scene, &self.mesh, &params, &tracer, &|_, _| {});
        let object = object.expect("an object");
        let build_seconds = start.elapsed().as_secs_f64();
        let (bytes, held) = (object.bytes(), object.parts.len());
        for look_up in LookUp::ALL {
            let tracer = self.tracer(object.clone(), look_up);
            let (mut report, _) = self.report(&tracer, Directions::Concentric);
            report["parts"] = json!(held);
            report["positions"] = json!(params.field.positions.count());
            report["look_up"] = json!(format!("{look_up:?}").to_lowercase());
            report["build_seconds"] = json!(build_seconds);
            report["bytes"] = json!(bytes);
            self.add_rates(&tracer, &mut report);
            println!("{report}");
        }
    }

    /// Rays to a square light over the object, one radius wide: what its soft shadow is made of.
    fn shadow_rays(&self) -> Rays {
        let over = Vec3::new(0.5 * self.side, 3.5 * self.radius, 0.5 * self.side);
        let mut all = Rays {
            rays: Vec::new(),
            weights: Vec::new(),
        };
        for (point, _) in self.vertices() {
            for index in 0..RAYS * RAYS {
                let place = Vec2::new((index % RAYS) as f32, (index / RAYS) as f32) + 0.5;
                let place = self.radius * (place / RAYS as f32 - 0.5);
                let way = over + Vec3::new(place.x, 0.0, place.y) - point;
                let (direction, distance) = way.normalize_and_length();
                all.rays.push(Ray::new(point, direction).until(distance));
                all.weights.push(1.0 / (RAYS * RAYS) as f32);
            }
        }
        all
    }

    /// How much of the light is seen: errors and rates.
    fn add_shadows(&self, tracer: &FieldTracer, report: &mut Value) {
        let rays = self.shadow_rays();
        let seen = |tracer: &dyn Tracer| self.mean(&rays, &open(&any(tracer, &rays.rays)));
        let [rms, bias, constant] = difference(&seen(tracer), &seen(&self.exact));
        report["shadow_rms"] = json!(rms);
        report["shadow_bias"] = json!(bias);
        report["shadow_constant_rms"] = json!(constant);
        let (field, exact) = (rate(tracer, &rays.rays), rate(&self.exact, &rays.rays));
        report["shadow_times"] = json!(field / exact);
    }

    /// Errors of ambient occlusion and obscurance; and the ambient occlusion.
    fn report(&self, tracer: &FieldTracer, directions: Directions) -> (Value, Vec<f64>) {
        let rays = self.rays(directions);
        let start = Instant::now();
        let found = any(tracer, &rays.rays);
        let run_seconds = start.elapsed().as_secs_f64();
        let values = self.mean(&rays, &open(&found));
        let [ao, obscurance, confusion] = self.errors(tracer, &rays, &found);
        let report = json!({
            "run_seconds": run_seconds,
            "scene": self.name,
            "triangles": self.mesh.triangles.len(),
            "ao_rms": ao[0],
            "ao_bias": ao[1],
            "constant_rms": ao[2],
            "obscurance_rms": obscurance[0],
            "obscurance_bias": obscurance[1],
            "false_hits": confusion[0],
            "false_misses": confusion[1],
            "hits": confusion[2],
        });
        (report, values)
    }

    fn errors(&self, tracer: &FieldTracer, rays: &Rays, found: &[bool]) -> [[f64; 3]; 3] {
        let truth = any(&self.exact, &rays.rays);
        let ao = difference(
            &self.mean(rays, &open(found)),
            &self.mean(rays, &open(&truth)),
        );
        let short: Vec<Ray> = rays.rays.iter().map(|ray| ray.until(self.radius)).collect();
        let values = |tracer: &dyn Tracer| self.mean(rays, &falloff(tracer, &short, self.radius));
        let obscurance = difference(&values(tracer), &values(&self.exact));
        let share = |hit: bool, exact: bool| {
            let wrong = found
                .iter()
                .zip(&truth)
                .filter(|pair| *pair == (&hit, &exact))
                .count();
            wrong as f64 / truth.len() as f64
        };
        let hits = truth.iter().filter(|hit| **hit).count() as f64 / truth.len() as f64;
        [
            ao,
            obscurance,
            [share(true, false), share(false, true), hits],
        ]
    }

    /// A value for every vertex.
    fn mean(&self, rays: &Rays, values: &[f32]) -> Vec<f64> {
        let count = rays.rays.len() / (3 * SIDE * SIDE);
        let weighted: Vec<f64> = values
            .iter()
            .zip(&rays.weights)
            .map(|(value, weight)| f64::from(value * weight))
            .collect();
        weighted
            .chunks_exact(count)
            .map(|values| values.iter().sum())
            .collect()
    }

    /// Million rays per second of one thread, beside the exact tracer's: all rays, and those that meet the sphere.
    fn add_rates(&self, tracer: &FieldTracer, report: &mut Value) {
        let rays = self.rays(Directions::Concentric).rays;
        let sphere = tracer.spheres().next().expect("a sphere");
        let (center, radius) = match tracer.spheres().count() {
            1 => (sphere.center, sphere.radius),
            _ => {
                let bounds = self.scene.bounds();
                (bounds.center(), 0.5 * bounds.diagonal())
            }
        };
        let meets = |ray: &&Ray| {
            let along = (center - ray.origin).dot(ray.direction).max(0.0);
            ray.at(along).distance(center) < radius
        };
        let some: Vec<Ray> = rays.iter().filter(meets).copied().collect();
        report["meeting"] = json!(some.len() as f64 / rays.len() as f64);
        for (name, rays) in [("all", &rays), ("meeting", &some)] {
            let (field, exact) = (rate(tracer, rays), rate(&self.exact, rays));
            report[format!("{name}_mrays")] = json!(field);
            report[format!("{name}_exact_mrays")] = json!(exact);
            report[format!("{name}_times")] = json!(field / exact);
        }
    }
}

pub(crate) fn any(tracer: &dyn Tracer, rays: &[Ray]) -> Vec<bool> {
    let mut hits = vec![false; rays.len()];
    tracer.any_hits(rays, &mut hits);
    hits
}

pub(crate) fn open(hits: &[bool]) -> Vec<f32> {
    hits.iter()
        .map(|hit| if *hit { 0.0 } else { 1.0 })
        .collect()
}

fn falloff(tracer: &dyn Tracer, rays: &[Ray], d_max: f32) -> Vec<f32> {
    let mut hits = vec![None; rays.len()];
    tracer.closest_hits(rays, &mut hits);
    hits.iter()
        .map(|hit| hit.map_or(1.0, |hit| (hit.t / d_max).min(1.0)))
        .collect()
}

/// RMS and bias in grey levels, and the RMS of the truth's mean.
pub(crate) fn difference(values: &[f64], truth: &[f64]) -> [f64; 3] {
    let count = truth.len() as f64;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / count;
    let rms = |pairs: &mut dyn Iterator<Item = f64>| {
        255.0 * (pairs.map(|d| d * d).sum::<f64>() / count).sqrt()
    };
    let average = mean(truth);
    [
        rms(&mut values.iter().zip(truth).map(|(a, b)| a - b)),
        255.0 * (mean(values) - average),
        rms(&mut truth.iter().map(|value| value - average)),
    ]
}

/// Million rays per second of one thread, any hit, the best of a few.
pub(crate) fn rate(tracer: &dyn Tracer, rays: &[Ray]) -> f64 {
    let mut hits = vec![false; rays.len()];
    let mut best = f64::INFINITY;
    for _ in 0..REPEATS {
        let start = Instant::now();
        tracer.any_hits(rays, &mut hits);
        best = best.min(start.elapsed().as_secs_f64());
    }
    rays.len() as f64 / best / 1e6
}

impl Corner {
    pub(crate) fn exact(&self) -> &BvhTracer {
        &self.exact
    }

    pub(crate) fn triangles(&self) -> usize {
        self.mesh.triangles.len()
    }
}
