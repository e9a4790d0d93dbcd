//! Footprints in a grid, so that the light of any place is found.

use glam::{UVec3, Vec3};
use isophote_scene::{Aabb, Ray, SurfaceId, Tracer};
use rayon::prelude::*;

use super::{
    PhotonParams,
    cut::{LEAST_COVERED, place_in_kernel},
    emission::Photon,
    footprint::Footprint,
};

/// Cells in all, at most.
const CELLS: f32 = 4e6;
/// Entries of all cells, at most: cells grow until it is so.
const ENTRIES: u64 = 1 << 26;
/// Points of a footprint at which is asked whether there is a surface.
const PROBES: u32 = 16;

/// Light that leaves surfaces diffusely, everywhere; or that arrives there.
#[derive(Default)]
pub(crate) struct Field {
    footprints: Vec<Footprint>,
    low: Vec3,
    /// Metres.
    cell: f32,
    cells: UVec3,
    /// Where each cell's footprints begin, and their end.
    firsts: Vec<u32>,
    listed: Vec<u32>,
}

/// A field as shaders read it.
#[cfg(feature = "gpu")]
pub(crate) struct PackedField {
    /// Four of each, see gather/field.wesl.
    pub(crate) footprints: Vec<[glam::Vec4; 4]>,
    /// Where each cell's footprints begin in it, their end, and their numbers.
    pub(crate) listed: Vec<u32>,
    pub(crate) low: Vec3,
    pub(crate) cell: f32,
    pub(crate) cells: UVec3,
}

impl Field {
    /// Relative to an origin; none where there is no light.
    #[cfg(feature = "gpu")]
    pub(crate) fn packed(&self, origin: Vec3) -> Option<PackedField> {
        if self.is_empty() {
            return None;
        }
        let pack = |footprint: &Footprint| {
            let [u, v, out] = footprint.filter;
            let peak = footprint.peak;
            [
                (footprint.position - origin).extend(peak.x),
                u.extend(peak.y),
                v.extend(peak.z),
                out.extend(0.0),
            ]
        };
        let head = self.firsts.len() as u32;
        let firsts = self.firsts.iter().map(|first| head + first);
        Some(PackedField {
            footprints: self.footprints.iter().map(pack).collect(),
            listed: firsts.chain(self.listed.iter().copied()).collect(),
            low: self.low - origin,
            cell: self.cell,
            cells: self.cells,
        })
    }

    /// Of what photons bring so much: what they light is what their surfaces send on where that is their albedo. A footprint
    /// that reaches beyond its surface has all of its light on what there is: an edge or a wall does not take it away.
    pub(crate) fn new<T: Tracer + ?Sized>(
        exact: &T,
        photons: &[Photon],
        share: impl Fn(&Photon) -> Vec3 + Sync,
        params: &PhotonParams,
    ) -> Self {
        let footprint = |photon: &Photon| {
            let mut footprint = Footprint::new(
                photon.point.position,
                photon.point.geometric_normal,
                share(photon) * photon.flux,
                photon.differential.position,
                params,
            )?;
            let part = photon.covered.unwrap_or_else(|| covered(exact, &footprint));
            footprint.peak /= part.max(LEAST_COVERED);
            Some(footprint)
        };
        let lit = photons
            .par_iter()
            .filter(|photon| share(photon) != Vec3::ZERO);
        Self::of_footprints(lit.filter_map(footprint).collect())
    }

    /// Whether there is no light.
    #[inline]
    pub(crate) fn is_empty(&self) -> bool {
        self.footprints.is_empty()
    }

    fn of_footprints(footprints: Vec<Footprint>) -> Self {
        let boxes = footprints.iter().flat_map(|footprint| {
            let reach = footprint.reach();
            [footprint.position - reach, footprint.position + reach]
        });
        let bounds = Aabb::around(boxes);
        let mut field = Self {
            low: bounds.min,
            cell: 1.0,
            cells: UVec3::ZERO,
            firsts: vec![0],
            listed: Vec::new(),
            footprints,
        };
        if field.footprints.is_empty() {
            return field;
        }
        let size = (bounds.max - bounds.min).max(Vec3::splat(f32::MIN_POSITIVE));
        let reaches = field
            .footprints
            .iter()
            .map(|footprint| footprint.reach().max_element());
        let mean = reaches.sum::<f32>() / field.footprints.len() as f32;
        field.cell = mean.max(size.max_element() / 1000.0);
        loop {
            let cells = (size / field.cell).ceil().max(Vec3::ONE);
            if cells.element_product() <= CELLS {
                field.cells = cells.as_uvec3();
                if field.list() {
                    return field;
                }
            }
            field.cell *= 1.26;
        }
    }

    /// Counts, sums up and fills in; false where that would be too many.
    fn list(&mut self) -> bool {
        let mut counts = vec![0_u32; self.cells.element_product() as usize + 1];
        let mut entries = 0_u64;
        for footprint in &self.footprints {
            self.reached(footprint, |cell| {
                counts[cell + 1] += 1;
                entries += 1;
            });
            if entries > ENTRIES {
                return false;
            }
        }
        for cell in 1..counts.len() {
            counts[cell] += counts[cell - 1];
        }
        self.firsts.clone_from(&counts);
        let mut listed = vec![0; entries as usize];
        for (index, footprint) in self.footprints.iter().enumerate() {
            self.reached(footprint, |cell| {
                listed[counts[cell] as usize] = index as u32;
                counts[cell] += 1;
            });
        }
        self.listed = listed;
        true
    }

    /// The cells that a footprint may reach.
    fn reached(&self, footprint: &Footprint, mut visit: impl FnMut(usize)) {
        let reach = footprint.reach();
        let [from, to] = [footprint.position - reach, footprint.position + reach].map(|corner| {
            let cell = ((corner - self.low) / self.cell).floor().max(Vec3::ZERO);
            cell.as_uvec3().min(self.cells - 1)
        });
        // How far a cell's corner is from its middle, along each row of the filter.
        let rooms = footprint
            .filter
            .map(|row| 1.0 + 0.5 * self.cell * row.abs().element_sum());
        for z in from.z..=to.z {
            for y in from.y..=to.y {
                for x in from.x..=to.x {
                    let cell = UVec3::new(x, y, z);
                    let middle = self.low + (cell.as_vec3() + 0.5) * self.cell;
                    let offset = middle - footprint.position;
                    let mut rows = footprint.filter.iter().zip(rooms);
                    if rows.all(|(row, room)| row.dot(offset).abs() <= room) {
                        visit(self.number(cell));
                    }
                }
            }
        }
    }

    fn number(&self, cell: UVec3) -> usize {
        ((cell.z * self.cells.y + cell.y) * self.cells.x + cell.x) as usize
    }

    /// The radiosity of the surface at a place on the side of a direction, W/m².
    #[inline]
    pub(crate) fn radiosity(&self, place: Vec3, towards: Vec3) -> Vec3 {
        let cell = ((place - self.low) / self.cell).floor();
        let inside = cell.cmpge(Vec3::ZERO).all() && cell.cmplt(self.cells.as_vec3()).all();
        if !inside {
            return Vec3::ZERO;
        }
        let number = self.number(cell.as_uvec3());
        let listed = &self.listed[self.firsts[number] as usize..self.firsts[number + 1] as usize];
        let mut light = Vec3::ZERO;
        for &index in listed {
            let footprint = &self.footprints[index as usize];
            if footprint.normal.dot(towards) > 0.0 {
                light += footprint.weight(place) * footprint.peak;
            }
        }
        light
    }
}

/// The part of a footprint, by its kernel, where there is a surface that the middle of it sees from a little above.
fn covered<T: Tracer + ?Sized>(exact: &T, footprint: &Footprint) -> f32 {
    let height = footprint
        .thickness
        .min(0.5 * footprint.sides[0].length().min(footprint.sides[1].length()));
    let above = height * footprint.normal;
    let from = footprint.position + above;
    let is_covered = |probe: u32| {
        let at = 0.5 * place_in_kernel(probe, PROBES);
        let [u, v] = footprint.sides;
        let across = at.x * u + at.y * v;
        let way = Ray::new(from, across).until(1.0);
        let down = Ray::new(from + across, -above).until(2.0);
        let unknown = SurfaceId::UNKNOWN;
        !exact.any_hit_from(&way, unknown) && exact.any_hit_from(&down, unknown)
    };
    (0..PROBES).filter(|&probe| is_covered(probe)).count() as f32 / PROBES as f32
}
