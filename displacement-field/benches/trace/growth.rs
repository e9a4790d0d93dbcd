//! The cost of a ray against the number of triangles of the same shape.

use std::sync::Arc;

use glam::Vec3;
use isophote_displacement_field::{Directions, FieldParams, LookUp, Object};
use isophote_scene::Mesh;
use serde_json::json;

use crate::corner::{Corner, rate};

/// A ball with bumps, tessellated into about this many triangles.
fn bumps(triangles: usize) -> Mesh {
    let rows = ((triangles as f64 / 4.0).sqrt().round() as usize).max(3);
    let columns = 2 * rows;
    let mut mesh = Mesh {
        name: format!("bumps of {triangles}"),
        ..Mesh::default()
    };
    for row in 0..=rows {
        for column in 0..columns {
            let polar = std::f32::consts::PI * row as f32 / rows as f32;
            let around = std::f32::consts::TAU * column as f32 / columns as f32;
            let radius = 1.0 + 0.2 * (5.0 * around).sin() * (4.0 * polar).sin() * polar.sin();
            let direction = Vec3::new(
                polar.sin() * around.cos(),
                polar.cos(),
                polar.sin() * around.sin(),
            );
            mesh.positions.push(radius * direction);
            mesh.normals.push(direction);
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let next = (column + 1) % columns;
            let [a, b, c, d] = [
                (row, column),
                (row, next),
                (row + 1, next),
                (row + 1, column),
            ]
            .map(|(row, column)| (row * columns + column) as u32);
            if row > 0 {
                mesh.triangles.push([a, b, c]);
            }
            if row + 1 < rows {
                mesh.triangles.push([a, c, d]);
            }
        }
    }
    mesh.triangle_materials = vec![0; mesh.triangles.len()];
    mesh
}

/// Times each is measured, in turns: what slows the machine for a moment then slows no one alone.
const ROUNDS: usize = 8;

pub(crate) fn measure(counts: &[usize]) {
    let corners: Vec<Corner> = counts
        .iter()
        .map(|&count| Corner::of("bumps", Arc::new(bumps(count))))
        .collect();
    let measured = corners.iter().map(|corner| {
        let (field, build_seconds) = corner.field(&FieldParams::default());
        let bytes = field.bytes();
        let tracer = corner.tracer(Object::new(field), LookUp::Aimed);
        let rays = corner.rays(Directions::Concentric).rays;
        (corner, tracer, rays, build_seconds, bytes)
    });
    let measured: Vec<_> = measured.collect();
    let mut rates = vec![[0.0_f64; 2]; counts.len()];
    for _ in 0..ROUNDS {
        for ((corner, tracer, rays, ..), best) in measured.iter().zip(&mut rates) {
            best[0] = best[0].max(rate(tracer, rays));
            best[1] = best[1].max(rate(corner.exact(), rays));
        }
    }
    for ((corner, _, _, build_seconds, bytes), [field, exact]) in measured.iter().zip(rates) {
        let report = json!({
            "scene": "bumps",
            "triangles": corner.triangles(),
            "build_seconds": build_seconds,
            "bytes": bytes,
            "mrays": field,
            "exact_mrays": exact,
            "times": field / exact,
        });
        println!("{report}");
    }
}
