//! How lights without geometry look at the scene: every pixel of a view is a photon (§4.2). A point has six square faces, a
//! spot its cone, a sun a parallel view of everything.
//!
//! A plane before a wide cone would give most of its pixels to the rim. A spot's view is the cone's own square, which a
//! concentric map lays on it with equal solid angles (Shirley and Chiu 1997).

use std::f32::consts::PI;

use glam::{Affine3A, Quat, Vec2, Vec3};
use isophote_scene::{
    Aabb, Environment, Light, LightKind, Ray, Scene, SurfaceId,
    sample::{Frame, concentric_disk},
};

use super::differential::Differential;
use crate::{
    Directions,
    cpu::{
        environment::radiances,
        view::{View, longest_axis},
    },
};

/// Along how many lines, both ways, the environment sends photons, and by how much their rasters are coarser than a point light's:
/// together four times as many. With a quarter of the lines what comes through a gap is 20 % wrong, and with rasters of half the
/// side the Cornell box 5 % too bright.
const LINES: u32 = 192;
const COARSER: u32 = 4;

/// A photon that leaves a light.
pub(crate) struct Leaving {
    pub(crate) ray: Ray,
    pub(crate) start: SurfaceId,
    /// Watts.
    pub(crate) flux: Vec3,
    pub(crate) differential: Differential,
}

/// A view of a light.
pub(super) struct Face {
    light: Light,
    /// Its columns and rows.
    size: [u32; 2],
    /// Where rays start; for a parallel view those of its middle.
    origin: Vec3,
    frame: Frame,
    shape: Shape,
}

/// How pixels become rays.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    /// Through a plane at distance 1, from −1 to 1.
    Square,
    /// Within a cone whose half angle has this cosine.
    Cone(f32),
    /// Parallel, through pixels of so many metres.
    Parallel(f32),
}

/// The views of a scene's lights, each with about `raster` pixels along each side.
pub(super) fn faces(scene: &Scene, raster: u32, environment: bool) -> Vec<Face> {
    let lights = scene.lights.iter().filter(|light| has_view(light));
    let mut faces: Vec<Face> = lights
        .flat_map(|light| faces_of(scene, light, raster))
        .collect();
    if environment {
        let coarse = (raster / COARSER).max(1);
        let suns = suns(&scene.environment);
        faces.extend(suns.iter().flat_map(|sun| faces_of(scene, sun, coarse)));
    }
    faces
}

/// The environment as parallel light along fixed directions, each with what comes from its region of the sphere. They are turned
/// somehow: rings of them around the vertical would pass or miss what is level all at once, so that what lights a floor through a gap
/// is twice of what it is, or nothing.
fn suns(environment: &Environment) -> Vec<Light> {
    if environment.is_black() {
        return Vec::new();
    }
    let directions = Directions::new(LINES).turned(0, 1);
    let radiances = radiances(environment, LINES, Directions::rotation(0, 1));
    let pairs = directions.vectors().iter().zip(radiances);
    let both = pairs.flat_map(|(&there, [ahead, behind])| [(there, ahead), (-there, behind)]);
    let sun = |(from, radiance): (Vec3, Vec3)| {
        let solid_angle = 4.0 * PI / (2 * LINES) as f32;
        Light {
            kind: LightKind::Directional,
            transform: Affine3A::from_quat(Quat::from_rotation_arc(Vec3::Z, from)),
            ..Light::point("", Vec3::ZERO, solid_angle * radiance)
        }
    };
    both.map(sun)
        .filter(|sun| sun.intensity != Vec3::ZERO)
        .collect()
}

/// Whether a light has views; a sphere shines from all over its surface.
pub(super) fn has_view(light: &Light) -> bool {
    !matches!(light.kind, LightKind::Point { radius } if radius > 0.0)
}

fn faces_of(scene: &Scene, light: &Light, raster: u32) -> Vec<Face> {
    let face = |axis: Vec3, shape| Face {
        light: light.clone(),
        size: [raster; 2],
        origin: light.position(),
        frame: Frame::new(axis),
        shape,
    };
    match light.kind {
        LightKind::Point { .. } => [Vec3::X, Vec3::Y, Vec3::Z]
            .into_iter()
            .flat_map(|axis| [axis, -axis])
            .map(|axis| face(axis, Shape::Square))
            .collect(),
        LightKind::Spot { outer, .. } => vec![face(light.direction(), Shape::Cone(outer.cos()))],
        LightKind::Directional => {
            let bounds = scene.bounds();
            let (center, half) = (bounds.center(), 0.5 * bounds.diagonal());
            let around = Aabb {
                min: bounds.min - center,
                max: bounds.max - center,
            };
            let longest = longest_axis(&around);
            let view = View::around(light.direction(), &[around], longest, raster);
            vec![Face {
                light: light.clone(),
                size: [view.columns as u32, view.rows as u32],
                origin: center - half * view.forward,
                frame: Frame {
                    x: view.right,
                    y: view.up,
                    z: view.forward,
                },
                shape: Shape::Parallel(view.pixel),
            }]
        }
    }
}

impl Face {
    /// The middles of its pixels, row by row.
    pub(super) fn pixels(&self) -> impl Iterator<Item = Vec2> + use<> {
        let [columns, rows] = self.size;
        let row = move |row| (0..columns).map(move |column| (column, row));
        (0..rows)
            .flat_map(row)
            .map(|(column, row)| Vec2::new(column as f32, row as f32) + 0.5)
    }

    /// The photon of a square around a place, both in pixels.
    pub(super) fn leave(&self, at: Vec2, side: f32) -> Leaving {
        let (direction, solid_angle, differential) = match self.shape {
            Shape::Square => self.through_plane(at, side),
            Shape::Cone(cos_outer) => self.within_cone(at, side, cos_outer),
            Shape::Parallel(pixel) => return self.parallel(at, side, pixel),
        };
        Leaving {
            ray: Ray::new(self.origin, direction),
            start: SurfaceId::UNKNOWN,
            flux: self.light.intensity_towards(direction) * solid_angle,
            differential,
        }
    }

    fn through_plane(&self, at: Vec2, side: f32) -> (Vec3, f32, Differential) {
        let scale = 2.0 / self.size[0] as f32;
        let corner = |sign: f32| (at + sign * 0.5 * side) * scale - 1.0;
        let (low, high) = (corner(-1.0).as_dvec2(), corner(1.0).as_dvec2());
        let solid_angle =
            quadrant(high.x, high.y) - quadrant(low.x, high.y) - quadrant(high.x, low.y)
                + quadrant(low.x, low.y);
        let through = self.frame.to_world((at * scale - 1.0).extend(1.0));
        let steps = [self.frame.x, self.frame.y].map(|axis| axis * side * scale);
        (
            through.normalize(),
            solid_angle as f32,
            Differential::through(through, steps),
        )
    }

    fn within_cone(&self, at: Vec2, side: f32, cos_outer: f32) -> (Vec3, f32, Differential) {
        let direction = |at: Vec2| {
            let disk = concentric_disk(at / self.size[0] as f32);
            let height = disk.length_squared() * (1.0 - cos_outer);
            // sin²θ = 1 − cos²θ without cancellation.
            let scale = ((2.0 - height).max(0.0) * (1.0 - cos_outer)).sqrt();
            let local = (scale * disk).extend(1.0 - height);
            self.frame.to_world(local).normalize()
        };
        let across = |axis: Vec2| {
            let half = 0.5 * side * axis;
            direction(at + half) - direction(at - half)
        };
        let share = side / self.size[0] as f32;
        let differential = Differential {
            position: [Vec3::ZERO; 2],
            direction: [across(Vec2::X), across(Vec2::Y)],
        };
        (
            direction(at),
            2.0 * PI * (1.0 - cos_outer) * share * share,
            differential,
        )
    }

    fn parallel(&self, at: Vec2, side: f32, pixel: f32) -> Leaving {
        let size = Vec2::new(self.size[0] as f32, self.size[1] as f32);
        let Frame { x, y, z } = self.frame;
        let [u, v] = ((at - 0.5 * size) * pixel).to_array();
        let side = side * pixel;
        Leaving {
            ray: Ray::new(self.origin + u * x + v * y, z),
            start: SurfaceId::UNKNOWN,
            flux: self.light.intensity * side * side,
            differential: Differential {
                position: [x * side, y * side],
                direction: [Vec3::ZERO; 2],
            },
        }
    }
}

/// The solid angle of the rectangle between the axis and a corner of the plane at distance 1.
fn quadrant(x: f64, y: f64) -> f64 {
    (x * y).atan2((x * x + y * y + 1.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The views of a light send what it emits, and differentials have the solid angles of their photons.
    #[test]
    fn flux_is_that_of_the_lights() {
        let scene = Scene::default();
        let mut light = Light::point("", Vec3::ONE, Vec3::new(1.0, 2.0, 3.0));
        light.transform = Affine3A::from_rotation_y(0.3);
        let spot = |angle| LightKind::Spot {
            inner: angle,
            outer: angle,
        };
        let point = light.kind;
        for (kind, solid_angle) in [
            (point, 4.0 * PI),
            (spot(0.4), 2.0 * PI * (1.0 - 0.4_f32.cos())),
            (spot(1.5), 2.0 * PI * (1.0 - 1.5_f32.cos())),
        ] {
            light.kind = kind;
            for raster in [1, 7, 64] {
                let faces = faces_of(&scene, &light, raster);
                let photons = faces
                    .iter()
                    .flat_map(|face| face.pixels().map(|at| face.leave(at, 1.0)));
                let photons: Vec<Leaving> = photons.collect();
                assert_eq!(photons.len(), faces.len() * (raster * raster) as usize);
                let flux: Vec3 = photons.iter().map(|photon| photon.flux).sum();
                let ratio = flux / (solid_angle * light.intensity);
                assert!(
                    (ratio - 1.0).abs().max_element() < 1e-4,
                    "{kind:?}: {ratio}"
                );
                if raster < 32 {
                    continue;
                }
                let ratio = |photon: &Leaving| {
                    let [u, v] = photon.differential.direction;
                    u.cross(v).length() * light.intensity.x / photon.flux.x
                };
                // On the diagonals of a cone's square the map of the disk has a bend.
                assert!(
                    photons
                        .iter()
                        .all(|photon| (ratio(photon) - 1.0).abs() < 0.1)
                );
                let mean = photons.iter().map(ratio).sum::<f32>() / photons.len() as f32;
                assert!((mean - 1.0).abs() < 2e-3, "{kind:?}: {mean}");
            }
        }
    }

    /// A white sky lights a square from above as much as from its side, with π W/m².
    #[test]
    fn suns_are_the_sky() {
        let suns = suns(&Environment::Constant(Vec3::ONE));
        for normal in [Vec3::X, Vec3::Y, Vec3::NEG_Z, Vec3::ONE.normalize()] {
            let cosine = |sun: &Light| sun.direction().dot(-normal).max(0.0) * sun.intensity.x;
            let irradiance: f32 = suns.iter().map(cosine).sum();
            assert!(
                (irradiance / PI - 1.0).abs() < 0.02,
                "{normal}: {irradiance}"
            );
        }
    }

    /// Four photons of the quarters of a pixel carry what the photon of the whole one does.
    #[test]
    fn quarters_make_a_whole() {
        let bounds = isophote_scene::builtin::build("cornell").expect("a scene");
        let mut light = Light::point("", Vec3::ONE, Vec3::ONE);
        for kind in [
            light.kind,
            LightKind::Spot {
                inner: 0.7,
                outer: 0.7,
            },
            LightKind::Directional,
        ] {
            light.kind = kind;
            for face in faces_of(&bounds, &light, 8) {
                for at in face.pixels() {
                    let whole = face.leave(at, 1.0).flux.x;
                    let quarters = [(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)];
                    let sum: f32 = quarters
                        .map(|(x, y)| face.leave(at + Vec2::new(x, y), 0.5).flux.x)
                        .iter()
                        .sum();
                    assert!((sum / whole - 1.0).abs() < 1e-4, "{kind:?}: {sum} {whole}");
                }
            }
        }
    }
}
