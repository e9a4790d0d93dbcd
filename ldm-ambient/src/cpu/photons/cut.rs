//! Where a photon's footprint meets an edge or a shadow, the photon is cut into four, and those again: so light ends where its
//! surface does, and does not reach through what is thin or under what lies there.
//!
//! Points that gather the light ask as many footprints as before: those at edges are smaller. What remains of a smallest
//! footprint beyond its surface has its light on what there is.

use glam::Vec2;
use isophote_scene::{Scene, Tracer};

use super::{
    PhotonParams,
    emission::{Photon, land},
    footprint::Footprint,
    views::Face,
};

/// Places of a footprint that are looked at.
const PROBES: u32 = 12;
/// Of its thickness, how far out of its plane a surface is still the same.
const SAME: f32 = 0.5;
/// The smallest part of a footprint that is taken for all of it: at a straight edge it is a half, and what has less is smaller
/// than the footprint itself, which then says little: with a quarter a furnished room is 5 % too bright.
pub(super) const LEAST_COVERED: f32 = 0.5;

/// Lands the photons of the pixels of lights.
pub(super) struct Cutter<'a, T: Tracer + ?Sized> {
    pub(super) scene: &'a Scene,
    pub(super) exact: &'a T,
    pub(super) params: &'a PhotonParams,
}

impl<T: Tracer + ?Sized> Cutter<'_, T> {
    /// The photons of a square of a light's view, which may be halved so many times.
    pub(super) fn land(
        &self,
        face: &Face,
        at: Vec2,
        side: f32,
        halvings: u32,
        photons: &mut Vec<Photon>,
    ) {
        let leaving = face.leave(at, side);
        let landed = land(self.scene, self.exact, &leaving, self.params);
        let footprint = landed.as_ref().and_then(|photon| {
            let point = &photon.point;
            let sides = photon.differential.position;
            let normal = point.geometric_normal;
            Footprint::new(point.position, normal, photon.flux, sides, self.params)
        });
        let (met, same) = self.probe(face, at, side, footprint.as_ref());
        let is_whole = match footprint {
            Some(_) => same == PROBES,
            None => met == 0,
        };
        if is_whole || halvings == 0 {
            photons.extend(landed.map(|photon| Photon {
                covered: Some(same as f32 / PROBES as f32),
                ..photon
            }));
            return;
        }
        for quarter in 0..4 {
            let sign = |bit: u32| if quarter >> bit & 1 == 0 { -0.25 } else { 0.25 };
            let aside = Vec2::new(sign(0), sign(1)) * side;
            self.land(face, at + aside, 0.5 * side, halvings - 1, photons);
        }
    }

    /// How many of the places around a photon meet a surface, and how many that of its footprint.
    fn probe(&self, face: &Face, at: Vec2, side: f32, footprint: Option<&Footprint>) -> (u32, u32) {
        let reach = 0.5 * self.params.splat_size * side;
        let (mut met, mut same) = (0, 0);
        for probe in 0..PROBES {
            let leaving = face.leave(at + reach * place_in_kernel(probe, PROBES), side);
            let Some(hit) = self.exact.closest_hit_from(&leaving.ray, leaving.start) else {
                continue;
            };
            met += 1;
            let place = leaving.ray.origin + hit.t * leaving.ray.direction;
            same += u32::from(footprint.is_some_and(|footprint| {
                let off = (place - footprint.position).dot(footprint.normal);
                off.abs() < SAME * footprint.thickness
            }));
        }
        (met, same)
    }
}

/// Places in the unit circle that stand for equal shares of the kernel, whose mass within r is 1 − (1 − r²)³, by the golden angle.
pub(super) fn place_in_kernel(number: u32, of: u32) -> Vec2 {
    let share = (number as f32 + 0.5) / of as f32;
    let radius = (1.0 - (1.0 - share).cbrt()).sqrt();
    radius * Vec2::from_angle(2.399_963_2 * number as f32)
}
