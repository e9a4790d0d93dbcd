//! What a photon lights: an ellipse on the surface it landed on (Eq. (4), (6), (7)).

use std::f32::consts::PI;

use glam::Vec3;

use super::PhotonParams;

/// A photon's light around its place.
#[derive(Clone, Copy)]
pub(crate) struct Footprint {
    /// Metres.
    pub(crate) position: Vec3,
    /// The rows of the matrix of Eq. (7).
    pub(crate) filter: [Vec3; 3],
    /// 3 times the flux over the ellipse's area, π K(0) of Eq. (6): irradiance in its middle, W/m².
    pub(crate) peak: Vec3,
    /// Unit.
    pub(crate) normal: Vec3,
    /// The sides of the parallelogram around the ellipse, metres.
    pub(crate) sides: [Vec3; 2],
    /// How far it reaches out of its plane, metres.
    pub(crate) thickness: f32,
}

impl Footprint {
    /// Of a flux in watts and positional differentials; none where those span no area.
    pub(crate) fn new(
        position: Vec3,
        normal: Vec3,
        flux: Vec3,
        differentials: [Vec3; 2],
        params: &PhotonParams,
    ) -> Option<Self> {
        let [u, v] = differentials.map(|side| params.splat_size * side);
        let volume = u.dot(v.cross(normal));
        let parallelogram = volume.abs();
        if !(parallelogram > 1e-12 && parallelogram.is_finite()) {
            return None;
        }
        let thickness = 0.5 * params.flatness * parallelogram.sqrt();
        let scale = 2.0 / volume;
        Some(Self {
            position,
            filter: [
                scale * v.cross(normal),
                scale * normal.cross(u),
                normal / thickness,
            ],
            peak: 3.0 * flux / (0.25 * PI * parallelogram),
            normal,
            sides: [u, v],
            thickness,
        })
    }

    /// Silverman's kernel at a point, 1 in the middle.
    #[inline]
    pub(crate) fn weight(&self, point: Vec3) -> f32 {
        let offset = point - self.position;
        let squared = |row: Vec3| row.dot(offset).powi(2);
        let [u, v, out] = self.filter.map(squared);
        (1.0 - (u + v + out)).max(0.0).powi(2)
    }

    /// Half the sides of the box around it.
    pub(crate) fn reach(&self) -> Vec3 {
        let [u, v] = self.sides;
        let ellipse = 0.25 * (u * u + v * v);
        (ellipse + (self.thickness * self.normal).powf(2.0)).powf(0.5)
    }
}
