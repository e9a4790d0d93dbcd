//! Light that comes straight to what a camera sees, on a GPU: from the lights by shadow rays of any tracer, from the environment
//! through the maps (Fig. 11), each direction of which stands for its region of the sphere.
//!
//! | | CPU | GPU |
//! |---|---|---|
//! | what a camera sees | [`cpu::Points::with_seen`](crate::cpu::Points::with_seen) | `shaders/direct/lights.wesl` |
//! | from lights | [`DirectLight::without_environment`](isophote_scene::DirectLight::without_environment) | the same |
//! | from the environment | [`cpu::photons::Photons::light`](crate::cpu::photons::Photons::light) | `direct/sky.rs`, `shaders/direct/sky.wesl` |
//!
//! Only the first and the last layer of the maps matter, so that no picture needs more room than there is. Nothing is added by
//! atomics: two frames of the same scene are equal bit by bit.

mod sky;

use bytemuck::{Pod, Zeroable};
use glam::Vec4;
use isophote_scene::{
    Answers, Camera, Pass, Scene, Selection,
    gpu::{ComputePass, Context, Dispatch, GpuScene, GpuTracer, Timer, reference::World},
    reference::{Materials, Progress},
    sample::hash_seed,
};
use wgpu::BufferUsages;

use self::sky::Sky;
use super::{
    Look, Points, broken, finish, linker,
    photons::{Light, Targets},
    place,
};
use crate::{Error, PhotonParams, Result};

/// Bytes of what is summed up for a pixel, of either kind of light.
const SUMS: u64 = 32;
const ALBEDO: u64 = 16;

/// Collects the light that comes straight to what a camera sees, at some places of each pixel, which share the maps.
///
/// 1. [`begin`](Self::begin), where the instances have moved or a new picture begins.
/// 2. [`see`](Self::see) one place of each pixel, and [`add`](Self::add) the environment's light there; the same for the others.
/// 3. [`resolve`](Self::resolve).
#[derive(Debug)]
pub struct Direct {
    params: PhotonParams,
    size: [u32; 2],
    irradiance: bool,
    lights: ComputePass,
    resolve: ComputePass,
    sky: Option<Sky>,
    albedos: wgpu::Buffer,
    lit: wgpu::Buffer,
    skies: wgpu::Buffer,
    /// That were seen so far.
    samples: u32,
    /// The sum of the mean cosines along the maps that they asked.
    weight: f32,
}

/// `Lighting` of direct/lights.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Lighting {
    seed: u32,
    sample: u32,
    pbr: u32,
    kinds: u32,
}

/// `Resolving` of direct/resolve.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Resolving {
    size: [u32; 2],
    samples: f32,
    weight: f32,
}

impl Direct {
    /// For the selected part of a scene as what stops the environment's light, a tracer of camera and shadow rays, and pictures of a
    /// size in pixels. Of the parameters those of maps, materials, normals, frames and seed count, and whether there is an
    /// [environment](PhotonParams::environment). `irradiance` says whether it is wanted beside radiance: of lights it takes as many
    /// shadow rays again.
    ///
    /// # Errors
    /// [`Error::Parameter`] for parameters out of their range, [`Error::Scene`] when nothing is selected, the tracer does not answer
    /// [`Answers::Surface`], or something is too large for the device.
    pub fn new(
        context: &Context,
        (scene, gpu_scene): (&Scene, &GpuScene),
        selection: &Selection,
        params: &PhotonParams,
        exact: &dyn GpuTracer,
        (size, irradiance): ([u32; 2], bool),
    ) -> Result<Self> {
        params.check()?;
        let answers = exact.answers();
        answers.require(Answers::Surface, "ldm", "the tracer of direct light")?;
        let lights = linker().scene(gpu_scene).tracer(exact);
        let lights = lights.link("ldm_ambient::direct::lights")?;
        let groups = [exact.bind_group_layout(), gpu_scene.bind_group_layout()];
        let resolve = linker().link("ldm_ambient::direct::resolve")?;
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        Ok(Self {
            params: *params,
            size,
            irradiance,
            lights: lights.compute_pass(context, "lights", &groups, &[])?,
            resolve: resolve.compute_pass(context, "resolve", &[], &[])?,
            sky: Sky::new(context, (scene, gpu_scene), selection, params)?,
            albedos: context.storage("albedos", ALBEDO * pixels)?,
            lit: context.storage("light of lights", SUMS * pixels)?,
            skies: context.storage("light of the environment", SUMS * pixels)?,
            samples: 0,
            weight: 0.0,
        })
    }

    /// Records that a new picture begins, of instances where `gpu_scene` has them.
    pub fn begin(&mut self, encoder: &mut wgpu::CommandEncoder, gpu_scene: &GpuScene) {
        (self.samples, self.weight) = (0, 0.0);
        encoder.clear_buffer(&self.lit, 0, None);
        encoder.clear_buffer(&self.skies, 0, None);
        if let Some(sky) = &self.sky {
            sky.begin(encoder, gpu_scene);
        }
    }

    /// Records that a camera looks through another place of each pixel, sample 0 in the middle, and that the light of lights is added
    /// there. What is seen becomes the `points`.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the points are of a picture of another size, [`Error::Scene`] when recording fails.
    pub fn see(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        (gpu_scene, exact): (&GpuScene, &dyn GpuTracer),
        (camera, sample): (&Camera, u32),
        points: &mut Points,
        timer: Option<&mut Timer>,
    ) -> Result<()> {
        self.check(points)?;
        let look = Look {
            camera,
            place: place(sample),
            sample: 0,
            normals: self.params.normals,
        };
        let origin = self.sky.as_ref().map(Sky::origin).unwrap_or_default();
        let asking = points.look(origin, gpu_scene, &look);
        let lighting = Lighting {
            seed: hash_seed(self.params.seed),
            sample,
            pbr: u32::from(self.params.materials == Materials::Pbr),
            kinds: 1 + u32::from(self.irradiance),
        };
        let asking = context.buffer("points", &[asking], BufferUsages::UNIFORM)?;
        let lighting = context.buffer("lighting", &[lighting], BufferUsages::UNIFORM)?;
        let resources = [
            (0, asking.as_entire_binding()),
            (1, points.buffer.as_entire_binding()),
            (2, lighting.as_entire_binding()),
            (3, self.albedos.as_entire_binding()),
            (4, self.lit.as_entire_binding()),
        ];
        let group = self.lights.bind(context, &resources)?;
        let groups = [&group, exact.bind_group(), gpu_scene.bind_group()];
        let dispatch = [Dispatch::over_pixels(self.size)];
        self.lights
            .record(encoder, "direct", timer, &groups, &dispatch);
        self.samples += 1;
        Ok(())
    }

    /// Records that the points that were seen last get the environment's light through one part of the maps of so many; of two, one
    /// is every other map.
    ///
    /// # Errors
    /// As [`see`](Self::see).
    pub fn add(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        gpu_scene: &GpuScene,
        points: &Points,
        part: [u32; 2],
        mut timer: Option<&mut Timer>,
    ) -> Result<()> {
        self.check(points)?;
        let Some(sky) = &self.sky else {
            return Ok(());
        };
        let ways = sky.ways(context, points, part);
        let sums = [&self.skies, &self.albedos];
        let looks = sky.looks(context, &ways, points, sums)?;
        for batch in 0..looks.len() {
            looks.record(encoder, batch, gpu_scene, timer.as_deref_mut());
        }
        self.weight += ways.weight();
        Ok(())
    }

    fn check(&self, points: &Points) -> Result<()> {
        if points.size() == self.size {
            return Ok(());
        }
        let [width, height] = points.size();
        Err(Error::Parameter {
            name: "the picture of the points",
            value: format!("{width}x{height} pixels"),
            expected: "it must be of the size for which the light was made",
        })
    }

    /// Records that the light is written to textures; behind the radiance stand 1 and the shadow rays it took. Irradiance is the
    /// environment's alone unless it is wanted.
    ///
    /// # Errors
    /// [`Error::Scene`] when the textures are not as [`Targets`] says.
    pub fn resolve(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        targets: &Targets,
    ) -> Result<()> {
        let resolving = Resolving {
            size: self.size,
            samples: self.samples.max(1) as f32,
            weight: self.weight,
        };
        let resolving = context.buffer("resolving", &[resolving], BufferUsages::UNIFORM)?;
        let view = |texture: &wgpu::Texture| texture.create_view(&Default::default());
        let (irradiance, radiance) = (view(&targets.irradiance), view(&targets.radiance));
        let resources = [
            (0, resolving.as_entire_binding()),
            (1, self.lit.as_entire_binding()),
            (2, self.skies.as_entire_binding()),
            (3, wgpu::BindingResource::TextureView(&irradiance)),
            (4, wgpu::BindingResource::TextureView(&radiance)),
        ];
        let group = self.resolve.bind(context, &resources)?;
        let dispatch = [Dispatch::over_pixels(self.size)];
        self.resolve
            .record(encoder, "resolve", None, &[&group], &dispatch);
        Ok(())
    }

    /// Lights what a camera sees, reads it back, and tells what it took; irradiance is empty unless it is wanted. Submits in pieces
    /// that no driver's watchdog minds.
    ///
    /// # Errors
    /// As [`see`](Self::see); [`Error::Scene`] when the device fails.
    pub fn render(
        &mut self,
        context: &Context,
        world: World<'_>,
        camera: &Camera,
        samples: u32,
        progress: &dyn Progress,
    ) -> Result<(Light, Vec<Pass>)> {
        let mut points = Points::new(context, self.size)?;
        let targets = Targets::new(context, self.size)?;
        let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
        let encoder = || context.device().create_command_encoder(&Default::default());
        let mut passes = Vec::new();
        let mut first = encoder();
        self.begin(&mut first, world.gpu_scene);
        context.submit("direct light", first)?;
        // More of them would ask no map.
        let samples = samples.clamp(1, self.params.maps.maps * self.params.frames);
        for sample in 0..samples {
            Pass::timed(&mut passes, "direct", || {
                let mut encoder = encoder();
                let on = (world.gpu_scene, world.exact);
                let look = (camera, sample);
                let seen = self.see(context, &mut encoder, on, look, &mut points, None);
                (seen.and_then(|()| finish(context, encoder)), [pixels, 0])
            })?;
            if let Some(sky) = &self.sky {
                let ways = sky.ways(context, &points, [sample, samples]);
                let sums = [&self.skies, &self.albedos];
                let looks = sky.looks(context, &ways, &points, sums)?;
                for batch in 0..looks.len() {
                    Pass::timed(&mut passes, "sky", || {
                        let mut encoder = encoder();
                        looks.record(&mut encoder, batch, world.gpu_scene, None);
                        let rays = looks.maps(batch) as u64 * pixels;
                        (finish(context, encoder), [rays, 0])
                    })?;
                }
                self.weight += ways.weight();
            }
            progress.advance(u64::from(sample) + 1, u64::from(samples));
        }
        let mut last = encoder();
        self.resolve(context, &mut last, &targets)?;
        context.submit("direct light", last)?;
        let (mut light, rays) = read(context, &targets)?;
        passes[0].rays += rays;
        if !self.irradiance {
            light.irradiance.clear();
        }
        Ok((light, passes))
    }
}

/// What was resolved, and how many shadow rays it took.
fn read(context: &Context, targets: &Targets) -> Result<(Light, u64)> {
    let irradiance: Vec<Vec4> = context.read_texture("irradiance", &targets.irradiance)?;
    let radiance: Vec<Vec4> = context.read_texture("radiance", &targets.radiance)?;
    let is_broken = |value: &Vec4| value.w < 1.0 || !value.is_finite();
    if irradiance.iter().chain(&radiance).any(is_broken) {
        return Err(broken("the device did not finish, or its driver is broken"));
    }
    let rays = radiance.iter().map(|value| value.w as u64 - 1).sum();
    let light = Light {
        irradiance: irradiance.into_iter().map(Vec4::truncate).collect(),
        radiance: radiance.into_iter().map(Vec4::truncate).collect(),
    };
    Ok((light, rays))
}
