//! Panoramas as light sources.

use glam::Vec3;

/// An equirectangular panorama.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    width: u32,
    height: u32,
    texels: Vec<Vec3>,
}

impl EnvironmentMap {
    /// Whether no light comes from it.
    pub fn is_black(&self) -> bool {
        self.texels.iter().all(|texel| *texel == Vec3::ZERO)
    }

    /// Radiance from a unit direction.
    pub fn radiance(&self, _direction: Vec3) -> Vec3 {
        self.texels[(self.width * self.height / 2) as usize]
    }
}
