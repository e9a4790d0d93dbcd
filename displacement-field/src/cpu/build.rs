//! Stage 2: rays from every position into the sphere (Algorithm 1).

use std::{
    ops::RangeInclusive,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use glam::{Affine3A, Vec3};
use isophote_scene::{
    Answers, Instance, Mesh, Ray, Scene, Tracer, reference::Progress, sample::Frame,
};
use rayon::prelude::*;

use super::{
    field::{Field, mesh_key},
    samples::Samples,
};
use crate::{Error, FieldParams, Result, Sphere, sphere::smallest};

/// The sphere is this much larger than the smallest one, so that no surface lies on it.
const MARGIN: f64 = 1e-4;
/// Rays whose distances are held in 32 bits until they are stored in fewer: 16 MiB.
const BATCH: usize = 1 << 22;
/// What the radius of a sphere may be, metres: squares of what is smaller or larger leave the range of 32 bits.
pub(crate) const SIZES: RangeInclusive<f64> = 1e-15..=1e15;

/// A scene of one mesh of another, where it was made: what a field's tracer is to be built of.
pub fn alone(scene: &Scene, mesh: &Arc<Mesh>) -> Scene {
    Scene {
        meshes: vec![mesh.clone()],
        materials: scene.materials.clone(),
        textures: scene.textures.clone(),
        instances: vec![Instance::new(0, Affine3A::IDENTITY)],
        ..Scene::default()
    }
}

impl Field {
    /// Builds the field of a mesh by a tracer of that mesh alone, in the mesh's own space: see [`alone`]. The result
    /// does not depend on the number of threads. `progress` counts positions.
    ///
    /// # Errors
    /// [`Error::Empty`] without triangles, [`Error::Size`] and [`Error::Far`] for its place and size, [`Error::Parameter`] and [`Error::TooLarge`] for parameters,
    /// and [`Error::Scene`] when the tracer knows no distances.
    pub fn build<T: Tracer + ?Sized>(
        mesh: &Mesh,
        tracer: &T,
        params: &FieldParams,
        progress: &dyn Progress,
    ) -> Result<Self> {
        Self::build_by(mesh, tracer, params, progress, BATCH)
    }

    /// [`build`](Self::build), about so many rays at once.
    fn build_by<T: Tracer + ?Sized>(
        mesh: &Mesh,
        tracer: &T,
        params: &FieldParams,
        progress: &dyn Progress,
        batch: usize,
    ) -> Result<Self> {
        params.check()?;
        tracer.answers().require(
            Answers::Distance,
            "a displacement field",
            "the tracer it is built by",
        )?;
        let sphere = bounding_sphere(mesh)?;
        let (count, cells) = (params.positions.count(), params.cells());
        let directions: Vec<Option<Vec3>> = (0..cells)
            .map(|cell| params.directions.of_cell(cell, params.resolution))
            .collect();
        let (done, cosines) = (AtomicU64::new(0), params.cosines());
        let mut samples = Samples::with_room(params);
        let maps = (batch / cells).clamp(1, count);
        let mut distances = vec![f32::INFINITY; maps * cells];
        for first in (0..count).step_by(maps) {
            let distances = &mut distances[..maps.min(count - first) * cells];
            distances
                .par_chunks_exact_mut(cells)
                .enumerate()
                .for_each(|(index, map)| {
                    let point = params.positions.point(first + index);
                    trace_map(tracer, &sphere, point, &directions, map);
                    let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                    progress.advance(done, count as u64);
                });
            samples.extend(distances, &cosines);
        }
        Ok(Self::new(*params, sphere, mesh_key(mesh), samples))
    }
}

/// The sphere around a mesh's triangles.
pub(crate) fn bounding_sphere(mesh: &Mesh) -> Result<Sphere> {
    let mut used = vec![false; mesh.positions.len()];
    for triangle in &mesh.triangles {
        triangle
            .iter()
            .for_each(|&vertex| used[vertex as usize] = true);
    }
    let corners: Vec<Vec3> = mesh
        .positions
        .iter()
        .zip(used)
        .filter_map(|(position, used)| used.then_some(*position))
        .collect();
    let (center, radius) = smallest(&corners).ok_or_else(|| Error::Empty {
        mesh: mesh.name.clone(),
    })?;
    if !SIZES.contains(&radius) {
        return Err(Error::Size {
            mesh: mesh.name.clone(),
            radius,
        });
    }
    // Far from the origin the centre is rounded.
    let rounding = f64::from(f32::EPSILON) * center.abs().max_element();
    if rounding > 0.01 * radius {
        return Err(Error::Far {
            mesh: mesh.name.clone(),
            distance: center.length(),
            radius,
        });
    }
    Ok(Sphere {
        center: center.as_vec3(),
        radius: (radius * (1.0 + MARGIN) + 2.0 * rounding) as f32,
    })
}

/// The distances in radii of all directions from one position.
fn trace_map<T: Tracer + ?Sized>(
    tracer: &T,
    sphere: &Sphere,
    point: Vec3,
    directions: &[Option<Vec3>],
    map: &mut [f32],
) {
    let frame = Frame::new(-point);
    let origin = sphere.center + sphere.radius * point;
    let ray = |direction: &Option<Vec3>| {
        // A place without a direction gets a ray that misses.
        let local = direction.unwrap_or(Vec3::ZERO);
        Ray::new(origin, frame.to_world(local).normalize_or_zero())
    };
    let rays: Vec<Ray> = directions.iter().map(ray).collect();
    let mut hits = vec![None; rays.len()];
    tracer.closest_hits(&rays, &mut hits);
    for (distance, hit) in map.iter_mut().zip(hits) {
        *distance = hit.map_or(f32::INFINITY, |hit| (hit.t / sphere.radius).clamp(0.0, 2.0));
    }
}

#[cfg(test)]
mod tests {
    use isophote_scene::{BuildTracer, BvhOptions, BvhTracer, Selection, builtin};

    use super::*;
    use crate::{Positions, Storage};

    #[test]
    fn fields_do_not_depend_on_batches() {
        let scene = builtin::build("builtin:corner").expect("a scene");
        let of_ball = |mesh: &&Arc<Mesh>| mesh.triangles.len() > 500;
        let mesh = scene.meshes.iter().find(of_ball).expect("a ball");
        let alone = Arc::new(alone(&scene, mesh));
        let tracer = BvhTracer::build(&alone, &Selection::default(), &BvhOptions::default());
        let tracer = tracer.expect("a tracer");
        for storage in Storage::ALL {
            let params = FieldParams {
                positions: Positions::Slater { rings: 4 },
                resolution: 9,
                storage,
                ..FieldParams::default()
            };
            let [one, some, all] = [1, 1000, 1 << 22].map(|batch| {
                Field::build_by(mesh, &tracer, &params, &|_, _| {}, batch).expect("a field")
            });
            assert!(one.samples == all.samples && some.samples == all.samples);
            assert_eq!(all.samples.bytes() as u64, params.bytes());
            let bits = Field::build_by(
                mesh,
                &tracer,
                &FieldParams {
                    storage: Storage::Bit,
                    ..params
                },
                &|_, _| {},
                1000,
            );
            if storage == Storage::Float {
                assert!(one.with_bits().samples == bits.expect("a field").samples);
            }
        }
    }
}
