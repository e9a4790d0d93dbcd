//! The light of what a camera sees, on a GPU: straight from the lights, by shadow rays of any tracer or by the photons that landed;
//! from the environment, through the maps (Fig. 11); and of photons on the surfaces that points see along the maps.
//!
//! | | CPU | GPU |
//! |---|---|---|
//! | what a camera sees | [`cpu::Points::with_seen`](crate::cpu::Points::with_seen) | `shaders/gather/lights.wesl` |
//! | lights, by rays | [`DirectLight::without_environment`](isophote_scene::DirectLight::without_environment) | the same |
//! | lights, by photons | [`photons::Photons::direct`] | `shaders/gather/landed.wesl` |
//! | the room of points | `cpu/room.rs` | `gather/rooms.rs`, `shaders/room.wesl`, `shaders/gather/rooms.wesl` |
//! | along the maps | [`photons::Photons::light`] | `gather/looks.rs`, `shaders/gather/{look,shade}.wesl` |
//! | metals | [`photons::Photons::mirrored`] | `gather/mirror.rs`, `shaders/gather/{reflect,mirror,reflected}.wesl` |
//! | footprints in a grid | `cpu/photons/field.rs` | `gather/field.rs`, `shaders/gather/field.wesl` |
//!
//! Photons are sent on the CPU, which cuts them at edges and shadows: there are few, and they are the same in each frame until lights or
//! instances move; then they are to be sent again, and a new [`Gather`] is made. Nothing is
//! added by atomics: two frames of the same scene are equal bit by bit.

mod field;
mod looks;
mod mirror;
mod render;
mod rooms;
mod targets;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use isophote_scene::{
    Answers, Camera, Scene, Selection,
    gpu::{ComputePass, Context, Dispatch, GpuScene, GpuTracer, Timer},
    reference::Materials,
    sample::hash_seed,
};
use wgpu::BufferUsages;

pub use self::targets::{Lit, LitTargets};
use self::{looks::Shining, mirror::Mirror};
use super::{Look, Points, grid, linker};
use crate::{
    Error, PhotonParams, Result,
    cpu::{photons, points::place_of_sample},
};

/// Bytes of what is noted of a point, or summed up for a pixel.
const ALBEDO: u64 = 16;
const LIT: u64 = 32;
const ARRIVING: u64 = 48;
const SUMS: u64 = 64;
const SHOWN: u64 = 16;

/// What is wanted of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Whether light is wanted that comes straight from the lights; that of the environment is found where it shines.
    pub lights: bool,
    /// Whether irradiance by those is wanted beside radiance, for which as many shadow rays are traced again.
    pub irradiance: bool,
    /// Whether metals show what the nearest direction of the maps meets; otherwise only the lights.
    pub mirrored: bool,
}

/// Collects the light of what a camera sees, at some places of each pixel, which share the maps.
///
/// 1. [`begin`](Self::begin), where the instances have moved or a new picture begins.
/// 2. [`see`](Self::see) one place of each pixel, and [`add`](Self::add) what lights it along the maps; the same for the others.
/// 3. [`resolve`](Self::resolve).
/// 4. When the commands were submitted, [`has_room`](Self::has_room): where it says no, the same is to be recorded again.
#[derive(Debug)]
pub struct Gather {
    params: PhotonParams,
    picture: Picture,
    lights: ComputePass,
    landed: ComputePass,
    shade: ComputePass,
    resolve: ComputePass,
    /// None where only lights shine, straight.
    shining: Option<Shining>,
    albedos: wgpu::Buffer,
    lit: wgpu::Buffer,
    arriving: wgpu::Buffer,
    sums: wgpu::Buffer,
    mirror: Option<Mirror>,
    shown: wgpu::Buffer,
    /// That were seen so far.
    samples: u32,
    /// The sum of the mean cosines along the maps that they asked.
    weight: f32,
}

/// `Lighting` of gather/lights.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Lighting {
    seed: u32,
    sample: u32,
    pbr: u32,
    kinds: u32,
    unlit: u32,
    padding: [u32; 3],
}

/// `Resolving` of gather/resolve.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Resolving {
    size: [u32; 2],
    samples: f32,
    weight: f32,
}

impl Gather {
    /// For the selected part of a scene as what light meets on its way, a tracer of camera and shadow rays, and what is wanted. Of the
    /// parameters those of maps, materials, normals, frames and seed count, whether there is an
    /// [environment](PhotonParams::environment), and whether light comes straight from the lights
    /// [by photons](PhotonParams::direct). Those must be `photons` with the same parameters; without them nothing bounces.
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
        picture: Picture,
        photons: Option<&photons::Photons<'_>>,
    ) -> Result<Self> {
        params.check()?;
        let answers = exact.answers();
        answers.require(Answers::Surface, "ldm", "the tracer of direct light")?;
        let lights = linker().scene(gpu_scene).tracer(exact);
        let lights = lights.link("ldm_ambient::gather::lights")?;
        let groups = [exact.bind_group_layout(), gpu_scene.bind_group_layout()];
        let pass = |module, entry_point| -> Result<ComputePass> {
            let shader = linker().link(module)?;
            Ok(shader.compute_pass(context, entry_point, &[], &[])?)
        };
        let shines = params.environment && !scene.environment.is_black();
        let shining = match shines || photons.is_some() {
            true => {
                let on = (scene, gpu_scene);
                Some(Shining::new(
                    context, on, selection, params, photons, exact,
                )?)
            }
            false => None,
        };
        let mirror = match shining.as_ref().filter(|_| picture.mirrored) {
            Some(shining) => {
                let on = (scene, gpu_scene);
                Mirror::new(context, on, params, exact, shining, picture.size)?
            }
            None => None,
        };
        let pixels = u64::from(picture.size[0]) * u64::from(picture.size[1]);
        Ok(Self {
            params: *params,
            picture,
            lights: lights.compute_pass(context, "lights", &groups, &[])?,
            landed: pass("ldm_ambient::gather::landed", "landed")?,
            shade: pass("ldm_ambient::gather::shade", "shade")?,
            resolve: pass("ldm_ambient::gather::resolve", "resolve")?,
            shining,
            albedos: context.storage("albedos", ALBEDO * pixels)?,
            lit: context.storage("light of lights", LIT * pixels)?,
            arriving: context.storage("light along the maps", ARRIVING * pixels)?,
            sums: context.storage("light of pixels", SUMS * pixels)?,
            mirror,
            shown: context.storage("light that metals show", SHOWN * pixels)?,
            samples: 0,
            weight: 0.0,
        })
    }

    /// Records that a new picture begins, of instances where `gpu_scene` has them.
    pub fn begin(&mut self, encoder: &mut wgpu::CommandEncoder, gpu_scene: &GpuScene) {
        (self.samples, self.weight) = (0, 0.0);
        encoder.clear_buffer(&self.lit, 0, None);
        encoder.clear_buffer(&self.sums, 0, None);
        encoder.clear_buffer(&self.shown, 0, None);
        if let Some(mirror) = &mut self.mirror {
            mirror.begin();
        }
        if let Some(shining) = &self.shining {
            shining.begin(encoder, gpu_scene);
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
            place: place_of_sample(sample),
            sample: 0,
            normals: self.params.normals,
        };
        let asking = points.look(self.origin(), gpu_scene, &look);
        let asking = context.buffer("points", &[asking], BufferUsages::UNIFORM)?;
        let lighting = self.lighting(sample);
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
        let dispatch = [Dispatch::over_pixels(self.picture.size)];
        self.lights
            .record(encoder, "direct", timer, &groups, &dispatch);
        self.samples += 1;
        if let Some(mirror) = &mut self.mirror {
            let (on, size) = ((gpu_scene, exact), self.picture.size);
            mirror.reflect(context, encoder, on, (&asking, sample), size)?;
        }
        self.add_landed(context, encoder, points)
    }

    fn lighting(&self, sample: u32) -> Lighting {
        Lighting {
            seed: hash_seed(self.params.seed),
            sample,
            pbr: u32::from(self.params.materials == Materials::Pbr),
            kinds: match self.picture.lights && !self.params.direct {
                true => 1 + u32::from(self.picture.irradiance),
                false => 0,
            },
            unlit: u32::from(self.picture.lights),
            padding: [0; 3],
        }
    }

    /// Records that the light of photons is added where they landed first.
    fn add_landed(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        points: &Points,
    ) -> Result<()> {
        let landed = self.shining.as_ref().and_then(|one| one.landed.as_ref());
        let Some(landed) = landed.filter(|_| self.picture.lights) else {
            return Ok(());
        };
        let mut resources = vec![
            (0, points.buffer.as_entire_binding()),
            (1, self.albedos.as_entire_binding()),
            (2, self.lit.as_entire_binding()),
        ];
        resources.extend(landed.resources());
        let group = self.landed.bind(context, &resources)?;
        self.landed
            .record(encoder, "landed", None, &[&group], &[self.over_points()]);
        Ok(())
    }

    /// Records that the points that were seen last get the light of one part of the maps of so many; of two, one is every other map.
    /// With the last part, if not before, the rays that metals reflected look along all of them;
    /// [`render`](Self::render) fits maps around these rays alone, which is sharper.
    ///
    /// # Errors
    /// As [`see`](Self::see).
    pub fn add(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        (gpu_scene, exact): (&GpuScene, &dyn GpuTracer),
        points: &Points,
        part: [u32; 2],
        mut timer: Option<&mut Timer>,
    ) -> Result<()> {
        self.check(points)?;
        let Some(shining) = self.shining.as_ref().filter(|one| !one.is_dark()) else {
            return Ok(());
        };
        let ways = shining.ways(context, points, part);
        encoder.clear_buffer(&self.arriving, 0, None);
        shining.measure(
            context,
            encoder,
            (gpu_scene, exact),
            (&ways, points),
            &self.arriving,
        )?;
        let looks = shining.gather(context, &ways, points, &self.arriving)?;
        for batch in 0..looks.len() {
            looks.record(encoder, batch, gpu_scene, timer.as_deref_mut());
        }
        self.shade(context, encoder)?;
        self.weight += ways.weight();
        if let Some(mirror) = self.mirror.as_mut().filter(|one| one.is_due(part)) {
            let ways = shining.ways(context, points, [0, 1]);
            let looks = mirror.looks(context, shining, &ways)?;
            for batch in 0..looks.len() {
                looks.record(encoder, batch, gpu_scene, timer.as_deref_mut());
            }
            drop(looks);
            mirror.add(context, encoder, [&self.lit, &self.shown])?;
        }
        Ok(())
    }

    /// Records that what arrived at points is added to their pixels.
    fn shade(&self, context: &Context, encoder: &mut wgpu::CommandEncoder) -> Result<()> {
        let resources = [
            (0, self.albedos.as_entire_binding()),
            (1, self.arriving.as_entire_binding()),
            (2, self.sums.as_entire_binding()),
        ];
        let group = self.shade.bind(context, &resources)?;
        self.shade
            .record(encoder, "shade", None, &[&group], &[self.over_points()]);
        Ok(())
    }

    fn over_points(&self) -> Dispatch {
        let pixels = u64::from(self.picture.size[0]) * u64::from(self.picture.size[1]);
        Dispatch {
            offset: None,
            workgroups: grid(pixels.div_ceil(64)),
        }
    }

    fn origin(&self) -> Vec3 {
        self.shining
            .as_ref()
            .map(Shining::origin)
            .unwrap_or_default()
    }

    fn check(&self, points: &Points) -> Result<()> {
        if points.size() == self.picture.size {
            return Ok(());
        }
        let [width, height] = points.size();
        Err(Error::Parameter {
            name: "the picture of the points",
            value: format!("{width}x{height} pixels"),
            expected: "it must be of the size for which the light was made",
        })
    }

    /// Records that the light is written to textures. Irradiance straight from lights is in it only if it is wanted.
    ///
    /// # Errors
    /// [`Error::Scene`] when the textures are not as [`LitTargets`] says.
    pub fn resolve(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        targets: &LitTargets,
    ) -> Result<()> {
        let resolving = Resolving {
            size: self.picture.size,
            samples: self.samples.max(1) as f32,
            weight: self.weight,
        };
        let resolving = context.buffer("resolving", &[resolving], BufferUsages::UNIFORM)?;
        let (direct, indirect) = (&targets.direct, &targets.indirect);
        let textures = [
            &direct.irradiance,
            &direct.radiance,
            &indirect.irradiance,
            &indirect.radiance,
        ];
        let views = textures.map(|texture| texture.create_view(&Default::default()));
        let mut resources = vec![
            (0, resolving.as_entire_binding()),
            (1, self.lit.as_entire_binding()),
            (2, self.sums.as_entire_binding()),
            (7, self.shown.as_entire_binding()),
        ];
        let views = views.iter().map(wgpu::BindingResource::TextureView);
        resources.extend((3..).zip(views));
        let group = self.resolve.bind(context, &resources)?;
        let dispatch = [Dispatch::over_pixels(self.picture.size)];
        self.resolve
            .record(encoder, "resolve", None, &[&group], &dispatch);
        Ok(())
    }

    /// Whether there was room for all layers of what was submitted since the last [`begin`](Self::begin). Where there was
    /// not, there will be, and the picture is to be recorded again.
    ///
    /// # Errors
    /// [`Error::Scene`] when the device fails, or binds no buffers that are large enough.
    pub fn has_room(&mut self, context: &Context) -> Result<bool> {
        match &mut self.shining {
            Some(shining) => shining.has_room(context),
            None => Ok(true),
        }
    }
}
