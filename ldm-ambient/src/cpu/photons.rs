//! Indirect light by photon differentials (§3.4, §4.2).
//!
//! 7. Photons leave the lights (`views`) and land on the first surface (`emission`), smaller ones at edges and shadows (`cut`).
//! 8. There each is split: one goes along every map, the way that is above the surface, with the share cosθ / Σ cosθ of what
//!    is reflected. The map tells where it lands (§3.1), its differential how large its footprint is. Maps are streamed.
//! 9. What lands where the camera sees it is splatted (`split`, `splat`), or, the other way around and to the same sums,
//!    every point looks along the maps for the photons that it gets its light from (`field`, `gather`): [`Deposit`]. Where it
//!    finds nothing it gets the environment's.

mod cut;
mod differential;
mod emission;
mod field;
mod footprint;
mod gather;
mod glossy;
mod params;
mod screen;
mod splat;
mod split;
mod views;

use glam::Vec3;
use isophote_scene::{
    Answers, Camera, Environment, GBuffer, Pass, Projection, Scene, Seen, Tracer,
    reference::Progress,
};
use rayon::prelude::*;

pub(crate) use self::screen::Screen;
#[cfg(feature = "gpu")]
pub(crate) use self::{emission::leave, field::PackedField, views::Leaving};
use self::{
    emission::{Photon, bounce, emit},
    field::Field,
    footprint::Footprint,
    gather::Shining,
    glossy::Mirror,
    splat::{Splat, splat},
    split::Split,
};
pub use self::{
    gather::Gathered,
    glossy::Mirrored,
    params::{Deposit, PhotonParams, Spread},
};
use super::{Point, Points, environment::of_frames, triangles::Triangles};
use crate::{Error, Result};

/// What photons light.
#[derive(Clone, Debug, Default)]
pub struct Lit {
    /// Irradiance by light that bounced, W/m²: row by row from the top, or in the order of the points.
    pub indirect: Vec<Vec3>,
    /// The same straight from the lights; empty unless [`PhotonParams::direct`].
    pub direct: Vec<Vec3>,
    /// The same straight from the environment; empty where photons are splatted.
    pub sky: Vec<Vec3>,
    /// Watts that left the lights.
    pub power: Vec3,
    /// Photons that met a surface, of all bounces, and their parts that were splatted.
    pub photons: [u64; 2],
    /// What the stages took: `emission`, `maps`, and `gather` or `split` and `splat`.
    pub passes: Vec<Pass>,
}

/// The irradiance of what a camera sees.
///
/// # Errors
/// [`Error::Parameter`] for parameters out of their range and, where anything is splatted, for a parallel camera,
/// [`Error::Scene`] when the exact tracer does not answer [`Answers::Surface`].
pub fn light(
    triangles: &Triangles<'_>,
    exact: &dyn Tracer,
    camera: &Camera,
    seen: &GBuffer,
    params: &PhotonParams,
    progress: &dyn Progress,
) -> Result<Lit> {
    let splatted = params.direct || params.deposit == Deposit::Splatted;
    if splatted && !matches!(camera.projection, Projection::Perspective { .. }) {
        return Err(Error::parameter(
            "the camera",
            "parallel",
            "photons are splatted for perspective ones",
        ));
    }
    params.check()?;
    let params = &params.without_gaps();
    let (mut lit, photons) = emitted(triangles, exact, params)?;
    let screen = splatted.then(|| Screen::new(seen, camera));
    if let Some(screen) = screen.as_ref().filter(|_| params.direct) {
        let landed: Vec<Splat> = of_lights(triangles.scene(), exact, &photons, params)
            .par_iter()
            .filter_map(|photon| primary(screen, photon, params))
            .collect();
        let mut light = screen.dark();
        splat(screen, &landed, &mut light);
        lit.direct = screen.rows(&light);
    }
    match (params.deposit, &screen) {
        (Deposit::Splatted, Some(screen)) => {
            let reflecting = photons.into_iter().flatten();
            let reflecting: Vec<Photon> = reflecting
                .filter(|photon| photon.albedo != Vec3::ZERO)
                .collect();
            let split = Split::new(triangles, &reflecting, screen, params);
            let mut light = screen.dark();
            lit.photons[1] = split.along_all_maps(&mut light, &mut lit.passes, progress);
            lit.indirect = screen.rows(&light);
        }
        _ => {
            let point = |(index, seen): (usize, &Option<Seen>)| {
                let seen = seen.as_ref()?;
                Some((
                    Point::new(&seen.point, seen.view, params.normals),
                    index as u32,
                ))
            };
            let found = seen.pixels.iter().enumerate().filter_map(point);
            let (points, indices) = found.unzip();
            let points = Points { points, indices };
            let emitted = Photons::of(triangles, exact, lit, photons, params);
            let (light, passes) = emitted.light(&points, [0, 1], progress);
            lit = emitted.lit;
            lit.passes.extend(passes);
            lit.indirect = vec![Vec3::ZERO; seen.pixels.len()];
            lit.sky = lit.indirect.clone();
            for (&index, light) in points.indices.iter().zip(light) {
                lit.indirect[index as usize] = light.irradiance();
                lit.sky[index as usize] = light.sky_irradiance();
            }
        }
    }
    Ok(lit)
}

/// Photons where they landed, ready to light any points: pixels, vertices or texels alike.
pub struct Photons<'a> {
    triangles: &'a Triangles<'a>,
    exact: &'a dyn Tracer,
    /// What surfaces send on.
    field: Field,
    /// What arrives at them straight from the lights.
    direct: Field,
    sky: Vec<[Vec3; 2]>,
    params: PhotonParams,
    lit: Lit,
}

impl<'a> Photons<'a> {
    /// Sends them.
    ///
    /// # Errors
    /// [`Error::Parameter`] for parameters out of their range, [`Error::Scene`] when the exact tracer does not answer
    /// [`Answers::Surface`].
    pub fn emit(
        triangles: &'a Triangles<'a>,
        exact: &'a dyn Tracer,
        params: &PhotonParams,
    ) -> Result<Self> {
        params.check()?;
        let params = &params.without_gaps();
        let (mut lit, photons) = emitted(triangles, exact, params)?;
        let direct = match params.direct {
            true => Pass::timed(&mut lit.passes, "field", || {
                let arriving = of_lights(triangles.scene(), exact, &photons, params);
                (Field::new(exact, &arriving, |_| Vec3::ONE, params), [0, 0])
            }),
            false => Field::default(),
        };
        Ok(Self {
            direct,
            ..Self::of(triangles, exact, lit, photons, params)
        })
    }

    fn of(
        triangles: &'a Triangles<'a>,
        exact: &'a dyn Tracer,
        mut lit: Lit,
        photons: Vec<Vec<Photon>>,
        params: &PhotonParams,
    ) -> Self {
        let field = Pass::timed(&mut lit.passes, "field", || {
            let sent = |photon: &Photon| photon.albedo;
            (Field::new(exact, &photons.concat(), sent, params), [0, 0])
        });
        let (maps, environment) = (params.maps.maps, &triangles.scene().environment);
        let sky = match params.environment {
            true => of_frames(environment, maps, params.seed, params.frames),
            false => Vec::new(),
        };
        Self {
            triangles,
            exact,
            field,
            direct: Field::default(),
            sky,
            params: *params,
            lit,
        }
    }

    /// The light of points, in their order, by a part of the maps: of so many parts, one takes every so manyth. Points of one
    /// pixel can share the maps so; sums of light and of weights over the parts are those by all.
    /// What it took stands beside.
    pub fn light(
        &self,
        points: &Points,
        part: [u32; 2],
        progress: &dyn Progress,
    ) -> (Vec<Gathered>, [Pass; 3]) {
        let shining = Shining {
            field: &self.field,
            sky: &self.sky,
        };
        gather::gather(
            (self.triangles, self.exact),
            shining,
            points,
            part,
            &self.params,
            progress,
        )
    }

    /// Whether [`light`](Self::light) finds anything.
    pub fn is_dark(&self) -> bool {
        self.field.is_empty() && self.sky.is_empty()
    }

    /// Irradiance of points straight from the lights by the photons around them, W/m²; none unless [`PhotonParams::direct`].
    /// What is seen through the maps of the environment is not in it.
    pub fn direct(&self, points: &Points) -> Vec<Vec3> {
        let arriving = |point: &Point| {
            self.direct
                .radiosity(point.position, point.geometric_normal)
        };
        points.points.par_iter().map(arriving).collect()
    }

    /// What arrives at points from unit directions above them, such as those that mirrors reflect, in their order: what the nearest
    /// direction of the maps meets (§6). What it took stands beside.
    pub fn mirrored(
        &self,
        points: &Points,
        towards: &[Vec3],
        progress: &dyn Progress,
    ) -> (Vec<Mirrored>, [Pass; 2]) {
        let environment = match self.params.environment {
            true => &self.triangles.scene().environment,
            false => &Environment::Black,
        };
        let mirror = Mirror {
            triangles: self.triangles,
            field: &self.field,
            environment,
            params: &self.params,
        };
        mirror.look(points, towards, progress)
    }

    /// What surfaces send on and what arrives at them straight from the lights, relative to an origin; none where that is nothing.
    #[cfg(feature = "gpu")]
    pub(crate) fn packed(&self, origin: Vec3) -> [Option<PackedField>; 2] {
        [&self.field, &self.direct].map(|field| field.packed(origin))
    }

    /// Watts that left the lights.
    pub fn power(&self) -> Vec3 {
        self.lit.power
    }

    /// What sending them took.
    pub fn passes(&self) -> &[Pass] {
        &self.lit.passes
    }
}

/// The photons of each bounce.
fn emitted<T: Tracer + ?Sized>(
    triangles: &Triangles<'_>,
    exact: &T,
    params: &PhotonParams,
) -> Result<(Lit, Vec<Vec<Photon>>)> {
    exact
        .answers()
        .require(Answers::Surface, "ldm", "the exact tracer")?;
    let scene = triangles.scene();
    let mut lit = Lit::default();
    let mut photons = Vec::new();
    if params.bounces == 0 {
        return Ok((lit, photons));
    }
    Pass::timed(&mut lit.passes, "emission", || {
        let (first, power) = emit(scene, exact, params);
        lit.power = power;
        photons.push(first);
        for directions in params.branches_of_bounces() {
            let next = bounce(
                scene,
                exact,
                &photons[photons.len() - 1],
                &directions,
                params,
            );
            photons.push(next);
        }
        lit.photons[0] = photons.iter().map(|photons| photons.len() as u64).sum();
        ((), [lit.photons[0], 0])
    });
    Ok((lit, photons))
}

/// The photons of lights alone where they landed first.
fn of_lights<T: Tracer + ?Sized>(
    scene: &Scene,
    exact: &T,
    photons: &[Vec<Photon>],
    params: &PhotonParams,
) -> Vec<Photon> {
    let shines = params.environment && !scene.environment.is_black();
    match photons.first() {
        Some(first) if !shines => first.clone(),
        _ => {
            let lamps = PhotonParams {
                environment: false,
                ..*params
            };
            emit(scene, exact, &lamps).0
        }
    }
}

/// A photon's own splat on the first surface.
fn primary(screen: &Screen, photon: &Photon, params: &PhotonParams) -> Option<Splat> {
    let (position, normal) = (photon.point.position, photon.point.geometric_normal);
    let sides = photon.differential.position;
    let footprint = Footprint::new(position, normal, photon.flux, sides, params)?;
    Splat::new(screen, footprint, -photon.direction)
}
