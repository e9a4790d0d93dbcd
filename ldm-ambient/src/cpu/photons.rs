//! Indirect light by photon differentials (§3.4, §4.2).
//!
//! 7. Photons leave the lights and land on the first surface. `emission`
//! 8. There each is split: one goes along every map, the way that is above the surface, with the share cosθ / Σ cosθ of what
//!    is reflected. The map tells where it lands (§3.1), its differential how large its footprint is. Maps are streamed.
//! 9. What lands where the camera sees it is splatted. `splat`
//!
//! A photon lands in a pixel's plane: the distance that the map tells, known up to a pixel of the map, chooses the surface and
//! is then made exact. Where the middle of a footprint is hidden or outside of the picture but the surface around it is not,
//! it counts nevertheless, so that silhouettes and borders do not darken.

mod differential;
mod emission;
mod screen;
mod splat;

use std::time::Instant;

use glam::{Vec2, Vec3};
use isophote_scene::{
    Answers, Camera, GBuffer, Pass, Projection, Tracer,
    reference::{Materials, Normals, Progress},
};
use rayon::prelude::*;

pub(crate) use self::screen::Screen;
use self::{
    emission::{Photon, emit},
    screen::TILE,
    splat::{Splat, reach, splat},
};
use super::{
    aim::Aim,
    lanes::{LANES, Lanes, vectorised},
    maps::{Map, Scratch},
    occlusion::MAPS,
    points::PointBlock,
    triangles::Triangles,
    view::{View, longest_axis},
};
use crate::{Directions, Error, MapParams, Result};

/// Blocks of photons that are split together.
const CHUNK: usize = 32;
/// The smallest cosine at which a photon may land.
const GRAZING: f32 = 0.01;

/// How the parts of a photon and of its neighbours spread after it is split.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Spread {
    /// Not at all: parts of neighbours run along the same map. Footprints tile what they meet.
    #[default]
    Parallel,
    /// As the photon did, with its directional differential turned by α (§3.4). Since its positional differential is not
    /// turned, the two may cancel: some footprints shrink to bright points.
    Turned,
}

/// Photons and their splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonParams {
    /// The maps.
    pub maps: MapParams,
    /// Photons along each side of a light's view, of each of its faces. 1 to 4096.
    pub raster: u32,
    /// What splitting does to differentials.
    pub spread: Spread,
    /// By how much splats are wider than the differentials say; less is sharper and noisier. Positive.
    pub splat_size: f32,
    /// How far a splat reaches out of its plane, in its own mean radii: what a of Eq. (7) is for. Positive.
    pub flatness: f32,
    /// Whether light that comes straight from the lights is splatted too.
    pub direct: bool,
    /// Whether the environment sends photons.
    pub environment: bool,
    /// Which part of the materials counts.
    pub materials: Materials,
    /// Which normals photons are reflected with.
    pub normals: Normals,
    /// Chooses the photons of lights without a raster.
    pub seed: u64,
}

impl Default for PhotonParams {
    fn default() -> Self {
        Self {
            maps: MapParams::default(),
            raster: 64,
            spread: Spread::default(),
            splat_size: 2.0,
            flatness: 3.0,
            direct: false,
            environment: true,
            materials: Materials::Pbr,
            normals: Normals::Smooth,
            seed: 0,
        }
    }
}

impl PhotonParams {
    /// Refuses what is out of its range.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn check(&self) -> Result<()> {
        self.maps.check()?;
        if !(1..=1 << 12).contains(&self.raster) {
            return Err(Error::parameter(
                "the raster of photons",
                self.raster,
                "it must be 1 to 4096",
            ));
        }
        for (name, value) in [
            ("the size of splats", self.splat_size),
            ("the flatness of splats", self.flatness),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::parameter(name, value, "it must be positive"));
            }
        }
        Ok(())
    }
}

/// What photons light.
#[derive(Clone, Debug, Default)]
pub struct Lit {
    /// Irradiance by light that bounced once, W/m², row by row from the top.
    pub indirect: Vec<Vec3>,
    /// The same straight from the lights; empty unless [`PhotonParams::direct`].
    pub direct: Vec<Vec3>,
    /// Watts that left the lights.
    pub power: Vec3,
    /// Photons that met a surface, and those of their parts that were splatted.
    pub photons: [u64; 2],
    /// What the stages took: `emission`, `maps`, `split`, `splat`.
    pub passes: Vec<Pass>,
}

/// The irradiance of what a camera sees.
///
/// # Errors
/// [`Error::Parameter`] for parameters out of their range and for a parallel camera, [`Error::Scene`] when the exact tracer
/// does not answer [`Answers::Surface`].
pub fn light<T: Tracer + ?Sized>(
    triangles: &Triangles<'_>,
    exact: &T,
    camera: &Camera,
    seen: &GBuffer,
    params: &PhotonParams,
    progress: &dyn Progress,
) -> Result<Lit> {
    params.check()?;
    exact
        .answers()
        .require(Answers::Surface, "ldm", "the exact tracer")?;
    if !matches!(camera.projection, Projection::Perspective { .. }) {
        return Err(Error::parameter(
            "the camera",
            "parallel",
            "photons are splatted for perspective ones",
        ));
    }
    let mut passes = Vec::new();
    let (photons, power) = Pass::timed(&mut passes, "emission", || {
        let (photons, power) = emit(triangles.scene(), exact, params);
        let rays = photons.len() as u64;
        ((photons, power), [rays, 0])
    });
    let screen = Screen::new(seen, camera);
    let mut lit = Lit {
        power,
        photons: [photons.len() as u64, 0],
        ..Lit::default()
    };
    if params.direct {
        let landed: Vec<Splat> = photons
            .par_iter()
            .filter_map(|photon| primary(&screen, photon, params))
            .collect();
        let mut light = screen.dark();
        splat(&screen, &landed, &mut light);
        lit.direct = screen.rows(&light);
    }
    let reflecting: Vec<Photon> = photons
        .into_iter()
        .filter(|photon| photon.albedo != Vec3::ZERO)
        .collect();
    let split = Split::new(triangles, &reflecting, &screen, params);
    let mut light = screen.dark();
    lit.photons[1] = split.along_all_maps(&mut light, &mut passes, progress);
    lit.indirect = screen.rows(&light);
    lit.passes = passes;
    Ok(lit)
}

/// A photon's own splat on the first surface.
fn primary(screen: &Screen, photon: &Photon, params: &PhotonParams) -> Option<Splat> {
    let normal = photon.point.geometric_normal;
    let landing = Landing {
        position: photon.point.position,
        normal,
        flux: photon.flux,
        direction: photon.direction,
    };
    landing.splat(screen, photon.differential.position, params)
}

/// Photons that are split.
struct Split<'a> {
    triangles: &'a Triangles<'a>,
    photons: &'a [Photon],
    blocks: Vec<PointBlock>,
    /// Σ cosθ over the directions of each photon.
    weights: Vec<f32>,
    views: Vec<View>,
    screen: &'a Screen,
    params: &'a PhotonParams,
}

impl<'a> Split<'a> {
    fn new(
        triangles: &'a Triangles<'a>,
        photons: &'a [Photon],
        screen: &'a Screen,
        params: &'a PhotonParams,
    ) -> Self {
        let points: Vec<_> = photons.iter().map(|photon| photon.point).collect();
        let blocks = PointBlock::pack(&points, triangles.origin);
        let directions = Directions::new(params.maps.maps);
        let weight = |photon: &Photon| {
            let cosines = directions
                .vectors()
                .iter()
                .map(|vector| vector.dot(photon.point.shading_normal).abs());
            cosines.sum()
        };
        let boxes: Vec<_> = blocks.chunks(LANES).map(PointBlock::bounds).collect();
        let fit = |&direction: &Vec3| {
            View::fit(
                direction,
                &boxes,
                longest_axis(&triangles.bounds),
                params.maps.resolution,
            )
        };
        Self {
            triangles,
            photons,
            weights: photons.par_iter().map(weight).collect(),
            views: match boxes.is_empty() {
                true => Vec::new(),
                false => directions.vectors().iter().map(fit).collect(),
            },
            blocks,
            screen,
            params,
        }
    }

    /// Sends a part of every photon along every map; returns how many parts were splatted.
    fn along_all_maps(
        &self,
        light: &mut [[Lanes; 3]],
        passes: &mut Vec<Pass>,
        progress: &dyn Progress,
    ) -> u64 {
        let mut seconds = [0.0; 3];
        let (mut splatted, mut done) = (0, 0);
        let at_once = rayon::current_num_threads().clamp(MAPS[0], MAPS[1]);
        for views in self.views.chunks(at_once) {
            let start = Instant::now();
            let build =
                |scratch: &mut Scratch, view: &View| Map::build(self.triangles, *view, scratch);
            let maps: Vec<Map> = views.par_iter().map_init(Scratch::default, build).collect();
            let built = Instant::now();
            let chunks = self.blocks.len().div_ceil(CHUNK);
            let parts = maps
                .iter()
                .flat_map(|map| (0..chunks).map(move |chunk| (map, chunk)));
            let splats: Vec<Vec<Splat>> = parts
                .collect::<Vec<_>>()
                .into_par_iter()
                .map(|(map, chunk)| self.along(map, chunk * CHUNK))
                .collect();
            let split = Instant::now();
            let splats = splats.concat();
            splat(self.screen, &splats, light);
            splatted += splats.len() as u64;
            seconds[0] += (built - start).as_secs_f64();
            seconds[1] += (split - built).as_secs_f64();
            seconds[2] += split.elapsed().as_secs_f64();
            done += views.len() as u64;
            progress.advance(done, self.views.len() as u64);
        }
        let lookups = (self.photons.len() * self.views.len()) as u64;
        let rays = [0, lookups, 0];
        for ((name, seconds), rays) in ["maps", "split", "splat"]
            .into_iter()
            .zip(seconds)
            .zip(rays)
        {
            passes.push(Pass {
                name,
                rays,
                seconds,
                ..Pass::default()
            });
        }
        splatted
    }

    /// The splats of some photons along a map.
    fn along(&self, map: &Map, first: usize) -> Vec<Splat> {
        let mut splats = Vec::new();
        let tolerance = self.params.maps.tolerance * map.view.pixel;
        let blocks = self.blocks[first..].iter().take(CHUNK).enumerate();
        vectorised(|| {
            for (offset, block) in blocks {
                let aim = Aim::at(map, block, tolerance);
                let photons = &self.photons[(first + offset) * LANES..];
                let weights = &self.weights[(first + offset) * LANES..];
                for (lane, (photon, weight)) in photons.iter().zip(weights).take(LANES).enumerate()
                {
                    if aim.above[lane] == 0.0 {
                        continue;
                    }
                    // From the point itself, not from where it was moved to.
                    let moved = aim.signs[lane] * (aim.nearest_depths[lane] - aim.depths[lane]);
                    let t = map.ahead(&aim, lane, tolerance) + moved;
                    if t.is_finite() {
                        let direction = aim.signs[lane] * map.view.forward;
                        let share = aim.cosines[lane] / weight;
                        splats.extend(self.land(photon, direction, t, share, map.view.pixel));
                    }
                }
            }
        });
        splats
    }

    /// Where a part of a photon lands, if it can be seen there.
    fn land(
        &self,
        photon: &Photon,
        direction: Vec3,
        t: f32,
        share: f32,
        pixel: f32,
    ) -> Option<Splat> {
        let start = photon.point.position;
        let differential = match self.params.spread {
            Spread::Parallel => photon.differential.parallel(),
            Spread::Turned => photon.differential.reflect(photon.direction, direction),
        };
        let at = self.screen.project(start + t * direction)?;
        let across = differential
            .transfer(direction, t, -direction)
            .parallelogram();
        let radius = 0.5 * self.params.splat_size * across.sqrt();
        let pixels = radius * self.screen.pixels_per_metre(start + t * direction);
        let beyond = at.abs().max_element() - pixels
            > 2.0 * self.screen.size[0].max(self.screen.size[1]) as f32;
        if beyond || !pixels.is_finite() {
            return None;
        }
        let [x, y] = [Vec2::X, Vec2::Y].map(|axis| axis * pixels);
        let (position, normal, t) = [Vec2::ZERO, x, -x, y, -y].into_iter().find_map(|aside| {
            let (point, normal) = self.screen.surface(at + aside)?;
            let cosine = -direction.dot(normal);
            let off = (start + t * direction - point).dot(normal);
            let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
            let fits = cosine > GRAZING && off.abs() < pixel * (1.5 * sine + 0.5);
            let exact = t + off / cosine;
            let position = start + exact * direction;
            (fits && exact > 0.0).then_some((position, normal, exact))
        })?;
        let landing = Landing {
            position,
            normal,
            flux: share * photon.albedo * photon.flux,
            direction,
        };
        landing.splat(
            self.screen,
            differential.transfer(direction, t, normal).position,
            self.params,
        )
    }
}

/// A photon on a surface that is seen.
struct Landing {
    position: Vec3,
    normal: Vec3,
    flux: Vec3,
    /// As it came.
    direction: Vec3,
}

impl Landing {
    /// Eq. (4), (5) and (7) for a footprint.
    fn splat(&self, screen: &Screen, footprint: [Vec3; 2], params: &PhotonParams) -> Option<Splat> {
        let [u, v] = footprint.map(|side| params.splat_size * side);
        let normal = self.normal;
        let volume = u.dot(v.cross(normal));
        let parallelogram = volume.abs();
        if !(parallelogram > 1e-12 && parallelogram.is_finite()) {
            return None;
        }
        let thickness = 0.5 * params.flatness * parallelogram.sqrt();
        let [low, high] = reach(screen, self.position, [u, v], 2.0 * thickness * normal)?;
        let scale = 2.0 / volume;
        Some(Splat {
            position: self.position,
            filter: [
                scale * v.cross(normal),
                scale * normal.cross(u),
                normal / thickness,
            ],
            peak: 3.0 * self.flux / (0.25 * std::f32::consts::PI * parallelogram),
            towards: -self.direction,
            normal,
            low,
            high,
        })
    }
}

impl Screen {
    /// No light, laid out as splats are added.
    fn dark(&self) -> Vec<[Lanes; 3]> {
        vec![[[0.0; LANES]; 3]; self.pixels.len()]
    }

    /// Light row by row.
    fn rows(&self, light: &[[Lanes; 3]]) -> Vec<Vec3> {
        debug_assert_eq!(light.len() % (TILE * TILE / LANES), 0);
        let [width, height] = self.size.map(|side| side as usize);
        let pixel = |index: usize| {
            let (block, lane) = self.place(index % width, index / width);
            Vec3::from_array(light[block].map(|channel| channel[lane]))
        };
        (0..width * height).map(pixel).collect()
    }
}
