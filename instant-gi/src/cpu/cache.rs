//! Light on what mirrors and glass show, interpolated over the scene: instant caching, as §6 proposes (Debattista et al. 2009).
//!
//! No grid of pixels lies over what mirrors show, so neither downsampling nor interleaving reduces its rays. But it lies on the
//! same few surfaces: space is divided into cubes, and the first surface point that is shown in a cube, for each of six ways to face,
//! becomes a record, where light is gathered. All others take the mean of the records around them that lie in their
//! plane, nearer ones for more.

use std::collections::HashMap;

use glam::{IVec3, Vec3};
use isophote_scene::Tracer;
use rayon::prelude::*;

use super::{
    indirect::{Gather, Receiver, Share},
    specular::Mirrored,
};

/// Records that are lit together.
const CHUNK: usize = 256;
/// Largest angle between the normals of one surface, as a cosine: 25°.
const COSINE: f32 = 0.906;
/// Largest distance from a tangent plane, of a cube's side.
const DISTANCE: f32 = 0.25;
/// Weight of a point's own record, however far it is.
const OWN: f32 = 1e-3;

/// A cube, and the axis and side to which a surface faces.
type Cell = (IVec3, u8);

/// Light at some points of a scene.
pub(super) struct Cache {
    /// The side of the cubes, metres.
    side: f32,
    records: HashMap<Cell, Record>,
}

#[derive(Clone, Copy)]
struct Record {
    position: Vec3,
    normal: Vec3,
    irradiance: Vec3,
}

impl Cache {
    pub(super) fn new(side: f32) -> Self {
        let records = HashMap::new();
        Self { side, records }
    }

    /// Irradiance at what is shown, and the number of rays. Records stay for later calls.
    pub(super) fn irradiance<E: Tracer + ?Sized, S: Tracer + ?Sized>(
        &mut self,
        gather: &Gather<'_, E, S>,
        shown: &[Mirrored],
    ) -> (Vec<Vec3>, u64) {
        let mut new: Vec<(Cell, &Mirrored)> = Vec::new();
        for one in shown {
            let cell = self.cell(one.point.position, one.normal);
            self.records.entry(cell).or_insert_with(|| {
                new.push((cell, one));
                Record {
                    position: one.point.position,
                    normal: one.normal,
                    irradiance: Vec3::ZERO,
                }
            });
        }
        let lit = new.par_chunks(CHUNK).map(|new| light(gather, new));
        let mut rays = 0;
        for (number, (irradiance, traced)) in lit.collect::<Vec<_>>().into_iter().enumerate() {
            rays += traced;
            for ((cell, _), irradiance) in new[number * CHUNK..].iter().zip(irradiance) {
                if let Some(record) = self.records.get_mut(cell) {
                    record.irradiance = irradiance;
                }
            }
        }
        let between = |one: &Mirrored| self.interpolated(one.point.position, one.normal);
        (shown.par_iter().map(between).collect(), rays)
    }

    /// Far beyond any scene cells are one.
    fn cell(&self, position: Vec3, normal: Vec3) -> Cell {
        let size = normal.abs();
        let axis = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let way = 2 * axis + u8::from(normal[usize::from(axis)] < 0.0);
        let reach = Vec3::splat(1e9);
        let cube = (position / self.side).floor().clamp(-reach, reach);
        (cube.as_ivec3(), way)
    }

    fn interpolated(&self, position: Vec3, normal: Vec3) -> Vec3 {
        let (cube, way) = self.cell(position, normal);
        let (mut light, mut sum) = (Vec3::ZERO, 0.0);
        for place in 0..27 {
            let offset = IVec3::new(place % 3, place / 3 % 3, place / 9) - 1;
            let Some(record) = self.records.get(&(cube + offset, way)) else {
                continue;
            };
            let to = record.position - position;
            let near = 1.0 - to.length() / self.side;
            let lies_on =
                normal.dot(record.normal) >= COSINE && normal.dot(to).abs() <= DISTANCE * self.side;
            let own = if offset == IVec3::ZERO { OWN } else { 0.0 };
            let weight = if lies_on && near > 0.0 {
                near * near
            } else {
                0.0
            } + own;
            light += weight * record.irradiance;
            sum += weight;
        }
        light / f32::max(sum, f32::MIN_POSITIVE)
    }
}

fn light<E: Tracer + ?Sized, S: Tracer + ?Sized>(
    gather: &Gather<'_, E, S>,
    new: &[(Cell, &Mirrored)],
) -> (Vec<Vec3>, u64) {
    let receivers: Vec<Receiver<'_>> = new.iter().map(|(_, one)| one.receiver()).collect();
    let mut irradiance = vec![Vec3::ZERO; receivers.len()];
    let rays = gather.irradiance(&receivers, &Share::ALL, &mut irradiance);
    (irradiance, rays)
}
