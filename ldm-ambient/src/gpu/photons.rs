//! Stages 7 to 9, the light of photons on a GPU: they leave the lights, land, are split along the maps of each batch and
//! splatted. Twin of [`cpu::photons::light`](crate::cpu::photons::light) with [`Deposit::Splatted`].
//!
//! The rays that leave the lights are found once, on the CPU: there are few, and they are the same in each frame. Where they land is
//! found by any tracer. Splats are made, listed and added batch by batch, so that memory does not grow with the number of
//! maps; nothing is added by atomics, so two frames of the same scene are equal bit by bit. [`SplatMethod`]: by tiles, or as quads.

mod emission;
mod splats;
mod targets;

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};
use isophote_scene::{
    Answers, Camera, Pass, Projection, Scene, Selection,
    gpu::{
        ComputePass, Context, Dispatch, GpuScene, GpuTracer, Timer, View as CameraView,
        reference::World,
    },
    reference::{Materials, Progress},
};
use wgpu::BufferUsages;

use self::{emission::Landed, splats::Splats};
pub use self::{
    splats::SplatMethod,
    targets::{Light, Targets},
};
use super::{
    BuildMethod, CameraPoints, Filler, Look, Points, finish, linker,
    maps::{Asked, Builder, Kept},
    triangles::Triangles,
};
use crate::{Deposit, Error, PhotonParams, Result};

/// Photons on a device, and what it takes to splat them.
///
/// 1. [`emit`](Self::emit), where lights or instances have moved: it waits for where photons land.
/// 2. [`splat`](Self::splat) for what a camera sees, then [`resolve`](Self::resolve).
/// 3. When the commands were submitted, [`has_room`](Self::has_room): where it says no, the same is to be recorded again.
#[derive(Debug)]
pub struct Photons {
    params: PhotonParams,
    size: [u32; 2],
    triangles: Triangles,
    filler: Filler,
    builder: Builder,
    landed: Landed,
    splats: Splats,
    resolve: ComputePass,
}

/// `Resolving` of photons/resolve.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Resolving {
    view: CameraView,
    size: [u32; 2],
    pbr: u32,
    padding: u32,
}

impl Photons {
    /// For the selected part of a scene, a tracer that tells where photons land, and pictures of a size in pixels.
    ///
    /// # Errors
    /// [`Error::Parameter`] for parameters out of their range and for those that are not [`Deposit::Splatted`] or
    /// light directly, or for [`SplatMethod::Quads`] where the device does not blend 32-bit floats, [`Error::Scene`] when
    /// nothing is selected, the tracer does not answer [`Answers::Surface`], or something is too large for the device.
    pub fn new(
        context: &Context,
        (scene, gpu_scene): (&Scene, &GpuScene),
        selection: &Selection,
        params: &PhotonParams,
        exact: &dyn GpuTracer,
        method: SplatMethod,
        size: [u32; 2],
    ) -> Result<Self> {
        params.check()?;
        if params.deposit != Deposit::Splatted || params.direct {
            return Err(Error::Parameter {
                name: "the photons",
                value: format!("{:?}, direct: {}", params.deposit, params.direct),
                expected: "here they are splatted, and light that bounced alone: `gpu::gather` has the others",
            });
        }
        let answers = exact.answers();
        answers.require(Answers::Surface, "ldm", "the tracer of photons")?;
        let filler = Filler::new(context)?;
        let kept = Kept::Layers(BuildMethod::default());
        let resolve = linker()
            .scene(gpu_scene)
            .tracer(exact)
            .feature("quads", method == SplatMethod::Quads)
            .link("ldm_ambient::photons::resolve")?;
        let groups = [exact.bind_group_layout(), gpu_scene.bind_group_layout()];
        let builder = Builder::new(context, gpu_scene, kept, params.maps.resolution)?;
        Ok(Self {
            params: *params,
            size,
            triangles: Triangles::new(context, scene, gpu_scene, selection, &filler)?,
            filler,
            landed: Landed::new(context, (gpu_scene, exact), params)?,
            resolve: resolve.compute_pass(context, "resolve", &groups, &[])?,
            splats: Splats::new(context, method, size, builder.maps_at_once())?,
            builder,
        })
    }

    /// Sends photons through a scene whose instances are where `gpu_scene` has them, and fits maps around where they land.
    ///
    /// # Errors
    /// [`Error::Scene`] when the device fails, or there are more photons than it binds.
    pub fn emit(
        &mut self,
        context: &Context,
        scene: &Scene,
        (gpu_scene, exact): (&GpuScene, &dyn GpuTracer),
    ) -> Result<()> {
        let scene = (scene, &self.triangles);
        self.landed
            .emit(context, scene, (gpu_scene, exact), &self.params)?;
        self.splats.reserve(context, self.landed.count)
    }

    /// What positions of the points that are lit are relative to, metres.
    fn origin(&self) -> Vec3 {
        self.triangles.origin
    }

    /// Records that the light of all photons is splatted onto what a camera sees, which are the `screen`'s points.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a parallel camera or a picture of another size, [`Error::Scene`] when recording fails.
    pub fn splat(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        gpu_scene: &GpuScene,
        (camera, screen): (&Camera, &Points),
        timer: Option<&mut Timer>,
    ) -> Result<()> {
        self.begin(encoder, gpu_scene);
        let batches = 0..self.batches();
        self.splat_batches(
            context,
            encoder,
            gpu_scene,
            (camera, screen),
            batches,
            timer,
        )
    }

    fn begin(&self, encoder: &mut wgpu::CommandEncoder, gpu_scene: &GpuScene) {
        self.splats.begin(encoder);
        self.triangles.record(encoder, gpu_scene, &self.filler);
    }

    fn batches(&self) -> usize {
        self.landed
            .views
            .len()
            .div_ceil(self.builder.maps_at_once())
    }

    fn splat_batches(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        gpu_scene: &GpuScene,
        (camera, screen): (&Camera, &Points),
        batches: std::ops::Range<usize>,
        mut timer: Option<&mut Timer>,
    ) -> Result<()> {
        if screen.size() != self.size {
            let [width, height] = screen.size();
            return Err(Error::Parameter {
                name: "the picture of the points",
                value: format!("{width}x{height} pixels"),
                expected: "it must be of the size for which the photons were made",
            });
        }
        if !matches!(camera.projection, Projection::Perspective { .. }) {
            return Err(Error::Parameter {
                name: "the camera",
                value: "parallel".into(),
                expected: "photons are splatted for perspective ones",
            });
        }
        let asked = Asked {
            points: self.landed.count,
            tolerance: self.params.maps.tolerance,
            d_max: 0.0,
        };
        let series = self
            .builder
            .series(context, &self.triangles, &self.landed.views, asked)?;
        let resources = splats::Resources {
            batches: series.batches.binding(),
            tables: self.builder.tables(),
            points: &self.landed.points,
            photons: &self.landed.photons,
            screen: &screen.buffer,
        };
        let eye = camera.pinhole();
        let origin = self.origin();
        let groups = self
            .splats
            .bind(context, &self.params, (eye, origin), resources)?;
        for batch in batches {
            let triangles = &self.triangles;
            series.record(encoder, batch, triangles, gpu_scene, timer.as_deref_mut());
            let maps = series.maps(batch);
            self.splats
                .record(encoder, &groups, batch, maps, timer.as_deref_mut());
        }
        Ok(())
    }

    /// Records that the light is written to textures.
    ///
    /// # Errors
    /// [`Error::Scene`] when the textures are not as [`Targets`] says.
    pub fn resolve(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        (gpu_scene, exact): (&GpuScene, &dyn GpuTracer),
        camera: &Camera,
        targets: &Targets,
    ) -> Result<()> {
        let resolving = Resolving {
            view: CameraView::of_camera(camera, self.size, &gpu_scene.bounds()),
            size: self.size,
            pbr: u32::from(self.params.materials == Materials::Pbr),
            padding: 0,
        };
        let resolving = context.buffer("resolving", &[resolving], BufferUsages::UNIFORM)?;
        let view = |texture: &wgpu::Texture| texture.create_view(&Default::default());
        let (irradiance, radiance) = (view(&targets.irradiance), view(&targets.radiance));
        let resources = [
            (0, resolving.as_entire_binding()),
            (1, self.splats.light()),
            (2, wgpu::BindingResource::TextureView(&irradiance)),
            (3, wgpu::BindingResource::TextureView(&radiance)),
        ];
        let group = self.resolve.bind(context, &resources)?;
        let groups = [&group, exact.bind_group(), gpu_scene.bind_group()];
        let dispatch = [Dispatch::over_pixels(self.size)];
        self.resolve
            .record(encoder, "resolve", None, &groups, &dispatch);
        Ok(())
    }

    /// Whether there was room for all layers and splats of what was submitted since the last [`splat`](Self::splat). Where
    /// there was not, there will be, and the picture is to be recorded again. Lists that grew too long become sums
    /// ([`BuildMethod::LinkedLists`]).
    ///
    /// # Errors
    /// [`Error::Scene`] when the device fails, or binds no buffers that are large enough.
    pub fn has_room(&mut self, context: &Context, gpu_scene: &GpuScene) -> Result<bool> {
        let [layers, lost, entries] = self.splats.status(context)?;
        let lost = lost != 0;
        if lost {
            let method = BuildMethod::Linearised;
            let resolution = self.params.maps.resolution;
            self.builder = Builder::new(context, gpu_scene, Kept::Layers(method), resolution)?;
            self.splats.ask(context, method)?;
        }
        let layers = self.builder.make_room(context, layers)?;
        let entries = self.splats.make_room(context, entries)?;
        Ok(!(lost || layers || entries))
    }

    /// Lights what a camera sees, reads it back, and tells what it took. Submits in pieces that no driver's watchdog minds.
    ///
    /// # Errors
    /// As [`emit`](Self::emit), [`splat`](Self::splat) and [`Targets::read`].
    pub fn render(
        &mut self,
        context: &Context,
        world: World<'_>,
        camera: &Camera,
        progress: &dyn Progress,
    ) -> Result<(Light, Vec<Pass>)> {
        let finder = CameraPoints::new(context, world.gpu_scene, world.exact)?;
        let mut screen = Points::new(context, self.size)?;
        let targets = Targets::new(context, self.size)?;
        let on = (world.gpu_scene, world.exact);
        let encoder = || context.device().create_command_encoder(&Default::default());
        let mut passes = Vec::new();
        let count = |emitted: &Result<()>, photons: &Self| match emitted {
            Ok(()) => u64::from(photons.landed.landed),
            Err(_) => 0,
        };
        Pass::timed(&mut passes, "emission", || {
            let emitted = self.emit(context, world.scene, on);
            let rays = count(&emitted, self);
            (emitted, [rays, 0])
        })?;
        let look = Look {
            camera,
            place: Vec2::splat(0.5),
            sample: 0,
            normals: self.params.normals,
        };
        let mut first = encoder();
        let origin = self.origin();
        finder.record_about(context, &mut first, origin, on, &look, &mut screen)?;
        finish(context, first)?;
        loop {
            let mut begun = encoder();
            self.begin(&mut begun, world.gpu_scene);
            context.submit("photons", begun)?;
            let before = passes.len();
            for batch in 0..self.batches() {
                // Stages are measured as a whole or not at all.
                let stages = 32 + self.splats.passes();
                let mut timer = Timer::new(context, if stages > Timer::MOST { 0 } else { stages });
                let mut encoder = encoder();
                let seen = (camera, &screen);
                let scene = world.gpu_scene;
                let timed = Some(&mut timer);
                self.splat_batches(context, &mut encoder, scene, seen, batch..batch + 1, timed)?;
                timer.resolve(&mut encoder);
                Pass::timed(&mut passes, "photons", || {
                    (finish(context, encoder), [0, 0])
                })?;
                passes.extend(timer.read(context)?.iter().filter_map(stage));
                progress.advance(batch as u64 + 1, self.batches() as u64);
            }
            if self.has_room(context, world.gpu_scene)? {
                break;
            }
            passes.truncate(before);
        }
        let mut last = encoder();
        self.resolve(context, &mut last, on, camera, &targets)?;
        context.submit("photons", last)?;
        Ok((targets.read(context)?, passes))
    }
}

/// A stage as the CPU names it.
fn stage(time: &isophote_scene::gpu::PassTime) -> Option<Pass> {
    let name = match time.name.as_str() {
        "split" => "split",
        "bins" => "bins",
        "splat" => "splat",
        _ => "maps",
    };
    Some(Pass {
        name,
        seconds: time.time.as_secs_f64(),
        ..Pass::default()
    })
}
