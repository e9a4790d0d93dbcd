//! Lights without geometry, and the light that comes from far away. Emissive triangles are materials.

use glam::{Affine3A, Vec3};

use crate::environment::EnvironmentMap;

/// A point, spot or directional light (`KHR_lights_punctual`, read as radiometric numbers).
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// The name in the file; may be empty.
    pub name: String,
    /// What kind of light it is.
    pub kind: LightKind,
    /// Radiant intensity in W/sr; for a directional light the irradiance in W/m² on a surface that faces it.
    pub intensity: Vec3,
    /// Where it stands (the origin) and shines (−Z); scaling is ignored.
    pub transform: Affine3A,
    /// The node that moves it, if any.
    pub node: Option<u32>,
}

/// The kinds of [`Light`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// Shines equally in all directions.
    Point {
        /// 0, or the radius in metres of a sphere that emits the same intensity. The sphere casts no shadow
        /// and is not seen.
        radius: f32,
    },
    /// Shines within a cone around −Z, with the falloff of `KHR_lights_punctual`.
    Spot {
        /// Half angle in radians within which the intensity is whole.
        inner: f32,
        /// Half angle in radians from which there is no light.
        outer: f32,
    },
    /// Shines along −Z everywhere.
    Directional,
}

impl Light {
    /// A point light.
    pub fn point(name: impl Into<String>, position: Vec3, intensity: Vec3) -> Self {
        Self {
            name: name.into(),
            kind: LightKind::Point { radius: 0.0 },
            intensity,
            transform: Affine3A::from_translation(position),
            node: None,
        }
    }

    /// Where the light stands, metres.
    pub fn position(&self) -> Vec3 {
        self.transform.translation.into()
    }

    /// The unit direction it shines in.
    pub fn direction(&self) -> Vec3 {
        Vec3::from(-self.transform.matrix3.z_axis).normalize_or(Vec3::NEG_Z)
    }

    /// Radiant intensity (W/sr) towards a unit direction that leaves the light; for a directional light its irradiance.
    pub fn intensity_towards(&self, direction: Vec3) -> Vec3 {
        match self.kind {
            LightKind::Point { .. } | LightKind::Directional => self.intensity,
            LightKind::Spot { inner, outer } => {
                // KHR_lights_punctual, "Inner and Outer Cone Angles".
                let scale = 1.0 / (inner.cos() - outer.cos()).max(0.001);
                let falloff = (self.direction().dot(direction) - outer.cos()) * scale;
                self.intensity * falloff.clamp(0.0, 1.0).powi(2)
            }
        }
    }
}

/// The light that comes from outside the scene.
#[derive(Clone, Debug, Default)]
pub enum Environment {
    /// None: the background is black.
    #[default]
    Black,
    /// The same radiance from every direction.
    Constant(Vec3),
    /// A panorama.
    Map(EnvironmentMap),
}

impl Environment {
    /// Whether no light comes from it.
    pub fn is_black(&self) -> bool {
        match self {
            Self::Black => true,
            Self::Constant(radiance) => *radiance == Vec3::ZERO,
            Self::Map(map) => map.is_black(),
        }
    }

    /// Radiance that arrives from a unit direction.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        match self {
            Self::Black => Vec3::ZERO,
            Self::Constant(radiance) => *radiance,
            Self::Map(map) => map.radiance(direction),
        }
    }
}
