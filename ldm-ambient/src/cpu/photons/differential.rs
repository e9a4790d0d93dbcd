//! What a photon's neighbours do: its positional and directional differentials (§3.4; Igehy 1999).

use glam::{Quat, Vec3};

/// By how much position and direction change from a photon to the next of its raster, along both of the raster's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Differential {
    /// `D_u x` and `D_v x`, metres.
    pub(crate) position: [Vec3; 2],
    /// `D_u d` and `D_v d`.
    pub(crate) direction: [Vec3; 2],
}

impl Differential {
    /// Of the unit vector along `through` that moves by `steps`: D d = ((p·p) D p − (p·D p) p) / |p|³.
    pub(crate) fn through(through: Vec3, steps: [Vec3; 2]) -> Self {
        let squared = through.length_squared();
        let turn = |step: Vec3| (squared * step - through.dot(step) * through) / squared.powf(1.5);
        Self {
            position: [Vec3::ZERO; 2],
            direction: steps.map(turn),
        }
    }

    /// After `t` metres along a direction, on a surface with a normal: D x' = D x + t D d + (D t) d, with D t such that it
    /// stays in the surface.
    pub(crate) fn transfer(&self, direction: Vec3, t: f32, normal: Vec3) -> Self {
        let facing = direction.dot(normal);
        let moved = |axis: usize| {
            let offset = self.position[axis] + t * self.direction[axis];
            offset - offset.dot(normal) / facing * direction
        };
        Self {
            position: [moved(0), moved(1)],
            direction: self.direction,
        }
    }

    /// After diffuse reflection: directions turn as ωᵢ turns to ωₒ, positions stay.
    pub(crate) fn reflect(&self, incoming: Vec3, outgoing: Vec3) -> Self {
        let turn = Quat::from_rotation_arc(incoming, outgoing);
        Self {
            position: self.position,
            direction: self.direction.map(|direction| turn * direction),
        }
    }

    /// After splitting along a map, where all neighbours go on in the same direction.
    pub(crate) fn parallel(&self) -> Self {
        Self {
            position: self.position,
            direction: [Vec3::ZERO; 2],
        }
    }

    /// `|D_u x × D_v x|`, m²: the footprint's ellipse has π/4 of it.
    pub(crate) fn parallelogram(&self) -> f32 {
        self.position[0].cross(self.position[1]).length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The differentials of a ray onto a slanted plane are the differences of two rays.
    #[test]
    fn transfer_follows_neighbouring_rays() {
        let (through, step) = (Vec3::new(0.3, -0.2, 1.0), 1e-3);
        let normal = Vec3::new(0.2, 0.5, -1.0).normalize();
        let plane = Vec3::new(0.0, 0.0, 4.0);
        let hit = |p: Vec3| p * (plane.dot(normal) / p.dot(normal));
        let here = hit(through);
        let found = Differential::through(through, [Vec3::X, Vec3::Y].map(|axis| step * axis))
            .transfer(through.normalize(), here.length(), normal);
        for (axis, found) in [Vec3::X, Vec3::Y].into_iter().zip(found.position) {
            let expected = hit(through + step * axis) - here;
            assert!(
                (found - expected).length() < 2e-2 * expected.length(),
                "{found} {expected}"
            );
        }
    }
}
