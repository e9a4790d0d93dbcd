//! Fields, and the tree over those that are placed, in words of four: as `shaders/maps.wesl` and `shaders/trace.wesl` read them.

use std::sync::Arc;

use glam::Vec3;
use isophote_scene::WorldTriangle;

use crate::{
    Error, FieldParams, FieldTracer, Positions, Result, Sphere,
    cpu::{
        field::Field,
        samples::Samples,
        top::{Top, WIDTH},
    },
};

pub(super) type Words = [u32; 4];

/// The kind of a triangle's record.
const NO_FIELD: u32 = u32::MAX;
/// Words of the tree before its nodes.
const HEADER: usize = 8;

/// The fields that were uploaded, by their number.
#[derive(Debug)]
pub(super) struct Fields(Vec<Arc<Field>>);

impl Fields {
    /// All fields of a tracer's objects; and the words.
    pub(super) fn new(tracer: &FieldTracer) -> Result<(Self, Vec<Words>)> {
        let fields = tracer.distinct();
        let mut words = vec![[0; 4]; 2 * fields.len()];
        let mut points: Vec<(Positions, usize)> = Vec::new();
        for (number, field) in fields.iter().enumerate() {
            let params = field.params();
            let Positions::Slater { rings } = params.positions else {
                return Err(Error::Parameter {
                    name: "the positions of a field on a GPU",
                    value: format!("{:?}", params.positions),
                    expected: "shaders know Slater's alone",
                });
            };
            let known = points.iter().find(|known| known.0 == params.positions);
            let points_at = known.map_or(words.len(), |known| known.1);
            if points_at == words.len() {
                points.push((params.positions, points_at));
                words.extend(field.points.iter().map(|point| point.map(f32::to_bits)));
            }
            let samples_at = words.len();
            let map = extend(&mut words, &field.samples, params.cells());
            let depths_at = words.len();
            if let Samples::Bit(bits) = &field.samples {
                pack(&mut words, bytemuck::cast_slice(&bits.depths));
            }
            words[2 * number] = head(params, rings);
            words[2 * number + 1] = [points_at, samples_at, depths_at, map].map(|at| at as u32);
        }
        Ok((Self(fields), words))
    }

    fn number(&self, field: &Arc<Field>) -> u32 {
        let known = self.0.iter().position(|known| Arc::ptr_eq(known, field));
        known.map_or(NO_FIELD, |number| number as u32)
    }
}

fn head(params: &FieldParams, rings: u32) -> Words {
    [
        rings,
        params.directions as u32,
        params.resolution,
        params.storage.bits(),
    ]
}

/// The samples, each map from a new word on; how many words a map takes.
fn extend(words: &mut Vec<Words>, samples: &Samples, cells: usize) -> usize {
    let before = words.len();
    let mut maps = 0;
    let mut add = |map: &[u8]| {
        pack(words, map);
        maps += 1;
    };
    match samples {
        Samples::Float(samples) => maps_of(samples, cells, &mut add),
        Samples::Word(samples) => maps_of(samples, cells, &mut add),
        Samples::Byte(samples) => maps_of(samples, cells, &mut add),
        Samples::Bit(bits) => maps_of(&bits.words, cells.div_ceil(64), &mut add),
    }
    (words.len() - before) / maps.max(1)
}

fn maps_of<T: bytemuck::Pod>(samples: &[T], cells: usize, add: &mut impl FnMut(&[u8])) {
    for map in samples.chunks_exact(cells) {
        add(bytemuck::cast_slice(map));
    }
}

/// Bytes, the last word filled up with zeros.
fn pack(words: &mut Vec<Words>, bytes: &[u8]) {
    let (whole, rest) = bytes.as_chunks::<16>();
    words.extend(
        whole
            .iter()
            .map(|bytes| bytemuck::cast::<[u8; 16], Words>(*bytes)),
    );
    if !rest.is_empty() {
        let mut last = [0; 16];
        last[..rest.len()].copy_from_slice(rest);
        words.push(bytemuck::cast(last));
    }
}

/// Header, nodes, spheres and records of everything that is placed, and of triangles; with whether these are masked.
pub(super) fn tree_words(
    tracer: &FieldTracer,
    fields: &Fields,
    triangles: &[(WorldTriangle, bool)],
) -> Vec<Words> {
    let placed = tracer.placed();
    let mut spheres: Vec<Sphere> = placed.iter().map(|placed| placed.sphere).collect();
    spheres.extend(
        triangles
            .iter()
            .map(|(triangle, _)| sphere_around(triangle)),
    );
    let top = Top::new(&spheres);
    let mut words = vec![[0; 4]; HEADER];
    let mut levels = vec![
        [0, top.order().len()],
        [0, top.order().len().div_ceil(WIDTH)],
    ];
    for level in top.boxes() {
        levels.push([words.len(), level.len()]);
        for bounds in level.iter().flatten() {
            words.push(point(bounds.min, 0));
            words.push(point(bounds.max, 0));
        }
    }
    let spheres_at = words.len();
    words.extend(top.order().iter().map(|&item| {
        let Sphere { center, radius } = spheres[item as usize];
        point(center, radius.to_bits())
    }));
    let records_at = words.len();
    for &item in top.order() {
        let item = item as usize;
        match placed.get(item) {
            Some(placed) => {
                words.extend(placed.to_unit.map(|row| row.map(f32::to_bits)));
                let number = fields.number(&placed.field);
                words.push([
                    number,
                    placed.lift().to_bits(),
                    placed.slack.to_bits(),
                    placed.instance,
                ]);
            }
            None => {
                let (triangle, masked) = &triangles[item - placed.len()];
                let surface = triangle.surface;
                let extras = [surface.instance, surface.primitive, u32::from(*masked)];
                let corners = triangle.corners.into_iter().zip(extras);
                words.extend(corners.map(|(corner, extra)| point(corner, extra)));
                words.push([NO_FIELD, 0, 0, 0]);
            }
        }
    }
    words[0] = [
        spheres.len() as u32,
        levels.len() as u32 - 1,
        tracer.look_up() as u32,
        0,
    ];
    words[1] = [spheres_at as u32, records_at as u32, 0, 0];
    for (level, [at, count]) in levels.into_iter().enumerate() {
        let half = 2 * (level % 2);
        words[2 + level / 2][half] = at as u32;
        words[2 + level / 2][half + 1] = count as u32;
    }
    words
}

fn point(point: Vec3, extra: u32) -> Words {
    let [x, y, z] = point.to_array().map(f32::to_bits);
    [x, y, z, extra]
}

/// A sphere that holds a triangle, rounded up.
fn sphere_around(triangle: &WorldTriangle) -> Sphere {
    let bounds = isophote_scene::Aabb::around(triangle.corners);
    let center = bounds.center();
    let distances = triangle.corners.map(|corner| corner.distance(center));
    let radius = distances.into_iter().fold(0.0, f32::max);
    Sphere {
        center,
        radius: radius * 1.000_01 + 4.0 * f32::EPSILON * center.abs().max_element(),
    }
}
