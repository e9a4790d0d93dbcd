//! The cost of a ray against the number of triangles of the same shape.

use std::sync::Arc;

use glam::Vec3;
use isophote_displacement_field::{Directions, FieldParams, LookUp, Object};
use isophote_scene::Mesh;
use serde_json::json;

use crate::corner::{Corner, rate};

/// Rows of the coarsest ball, of 960 triangles.
const ROWS: usize = 16;

/// A ball with bumps of about this many triangles. Those of the coarsest ball are divided and stay where they are: the shape is
/// the same to the last bit of its bounds, and so are the rays that meet it.
fn bumps(triangles: usize) -> Mesh {
    let coarse = coarse_bumps();
    let parts = (triangles as f64 / coarse.triangles.len() as f64).sqrt();
    let parts = (parts.round() as usize).max(1);
    let mut mesh = Mesh {
        name: format!("bumps of {triangles}"),
        ..Mesh::default()
    };
    for corners in &coarse.triangles {
        let [a, b, c] = corners.map(|corner| coarse.positions[corner as usize]);
        let normal = (b - a).cross(c - a).normalize();
        let first = mesh.positions.len();
        // Row r of the triangle begins after 1 + 2 + … + r vertices.
        let vertex = |row: usize, column: usize| (first + row * (row + 1) / 2 + column) as u32;
        for row in 0..=parts {
            for column in 0..=row {
                let [down, along] = [row, column].map(|part| part as f32 / parts as f32);
                mesh.positions.push(a + (b - a) * down + (c - b) * along);
                mesh.normals.push(normal);
            }
        }
        for row in 0..parts {
            for column in 0..=row {
                let below = vertex(row + 1, column);
                let right = vertex(row + 1, column + 1);
                mesh.triangles.push([vertex(row, column), below, right]);
                if column < row {
                    let next = vertex(row, column + 1);
                    mesh.triangles.push([vertex(row, column), right, next]);
                }
            }
        }
    }
    mesh.triangle_materials = vec![0; mesh.triangles.len()];
    mesh
}

fn coarse_bumps() -> Mesh {
    let columns = 2 * ROWS;
    let mut mesh = Mesh::default();
    for row in 0..=ROWS {
        for column in 0..columns {
            let polar = std::f32::consts::PI * row as f32 / ROWS as f32;
            let around = std::f32::consts::TAU * column as f32 / columns as f32;
            let radius = 1.0 + 0.2 * (5.0 * around).sin() * (4.0 * polar).sin() * polar.sin();
            mesh.positions.push(
                radius
                    * Vec3::new(
                        polar.sin() * around.cos(),
                        polar.cos(),
                        polar.sin() * around.sin(),
                    ),
            );
        }
    }
    for row in 0..ROWS {
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
            if row + 1 < ROWS {
                mesh.triangles.push([a, c, d]);
            }
        }
    }
    mesh
}

/// Times each is measured, in turns: what slows the machine for a moment then slows no one alone. Each time the field lies
/// elsewhere: which pages of memory it gets changes its rate too.
const ROUNDS: usize = 16;

pub(crate) fn measure(counts: &[usize]) {
    let corners: Vec<Corner> = counts
        .iter()
        .map(|&count| Corner::of("bumps", Arc::new(bumps(count))))
        .collect();
    let measured = corners.iter().map(|corner| {
        let (field, build_seconds) = corner.field(&FieldParams::default());
        let rays = corner.rays(Directions::Concentric).rays;
        (corner, field, rays, build_seconds)
    });
    let measured: Vec<_> = measured.collect();
    let mut rates = vec![[0.0_f64; 2]; counts.len()];
    // Kept to the end, so that none gets the pages of one before.
    let mut tracers = Vec::new();
    for _ in 0..ROUNDS {
        for ((corner, field, rays, _), best) in measured.iter().zip(&mut rates) {
            let tracer = corner.tracer(Object::new(field.clone()), LookUp::Aimed);
            best[0] = best[0].max(rate(&tracer, rays));
            best[1] = best[1].max(rate(corner.exact(), rays));
            tracers.push(tracer);
        }
    }
    for ((corner, field, _, build_seconds), [mrays, exact]) in measured.iter().zip(rates) {
        let report = json!({
            "scene": "bumps",
            "triangles": corner.triangles(),
            "build_seconds": build_seconds,
            "bytes": field.bytes(),
            "mrays": mrays,
            "exact_mrays": exact,
            "times": mrays / exact,
        });
        println!("{report}");
    }
}
