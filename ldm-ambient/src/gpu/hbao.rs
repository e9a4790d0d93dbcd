//! Horizon-based ambient occlusion on a GPU. Twin of [`cpu::hbao`](crate::cpu::hbao).

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};
use isophote_scene::{
    Camera, Pass, Projection,
    gpu::{ComputePass, Context, Dispatch, GpuScene, Timer, reference::World},
    reference::{Normals, Progress},
};
use wgpu::BufferUsages;

use super::{
    CameraPoints, Look, Points, Targets, finish, linker,
    occlusion::{Resolve, SUMS},
};
use crate::{
    Result,
    cpu::{
        hbao::{Eye, HbaoParams, turn},
        occlusion::Sky,
        points::place_of_sample,
    },
};

/// Bytes of a depth.
const DEPTH: u64 = 8;

/// `Hbao` of hbao/eye.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Asking {
    position: Vec3,
    scale: f32,
    right: Vec3,
    finer: f32,
    up: Vec3,
    margin: f32,
    forward: Vec3,
    is_parallel: u32,
    picture: [u32; 2],
    size: [u32; 2],
    part: [u32; 2],
    d_max: f32,
    turn: f32,
    directions: u32,
    steps: u32,
    padding: [u32; 2],
}

fn pixels([width, height]: [u32; 2]) -> u64 {
    u64::from(width) * u64::from(height)
}

/// Collects the occlusion of what a camera sees by what it sees.
///
/// 1. [`begin`](Self::begin), where a new picture begins.
/// 2. [`see`](Self::see) for each part of the depths: points of the picture of [`wider`](Self::wider), one at each of the
///    [`places`](Self::places) of a pixel. With [`HbaoParams::finer`] 1 and [`HbaoParams::margin`] 0 they are those of any G-buffer.
/// 3. [`add`](Self::add) for the points of the picture, or for several samples of them.
/// 4. [`resolve`](Self::resolve).
#[derive(Debug)]
pub struct Hbao {
    params: HbaoParams,
    picture: [u32; 2],
    origin: Vec3,
    store: ComputePass,
    march: ComputePass,
    resolve: Resolve,
    depths: wgpu::Buffer,
    sums: wgpu::Buffer,
    samples: u32,
}

impl Hbao {
    /// For pictures of a scene, of a size in pixels.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) for parameters out of their range, [`Error::Scene`](crate::Error::Scene)
    /// when the depths or the picture are too large for the device.
    pub fn new(
        context: &Context,
        gpu_scene: &GpuScene,
        params: &HbaoParams,
        picture: [u32; 2],
    ) -> Result<Self> {
        params.check()?;
        let bounds = gpu_scene.bounds();
        let origin = match bounds.is_empty() {
            true => Vec3::ZERO,
            false => bounds.center(),
        };
        let depths = pixels(params.depths_of(picture));
        let store = linker().link("ldm_ambient::hbao::depths")?;
        let march = linker().link("ldm_ambient::hbao::march")?;
        Ok(Self {
            params: *params,
            picture,
            origin,
            store: store.compute_pass(context, "store", &[], &[])?,
            march: march.compute_pass(context, "march", &[], &[])?,
            resolve: Resolve::new(context)?,
            depths: context.storage("depths", DEPTH * depths)?,
            sums: context.storage("sums of points", SUMS * pixels(picture))?,
            samples: 0,
        })
    }

    /// What positions of points are relative to, metres.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Bytes that it holds on the device.
    pub fn bytes(&self) -> u64 {
        self.depths.size() + self.sums.size()
    }

    /// The camera and the size in pixels of the pictures whose points are the depths.
    pub fn wider(&self, camera: &Camera) -> (Camera, [u32; 2]) {
        let margin = self.params.margin_of(self.picture);
        let size = self.picture.map(|side| side + 2 * margin);
        let more = size[1] as f32 / self.picture[1] as f32;
        let projection = match camera.projection {
            Projection::Perspective { yfov } => Projection::Perspective {
                yfov: 2.0 * (more * (0.5 * yfov).tan()).atan(),
            },
            Projection::Orthographic { half_height } => Projection::Orthographic {
                half_height: more * half_height,
            },
        };
        let camera = Camera {
            projection,
            ..camera.clone()
        };
        (camera, size)
    }

    /// Where in a pixel of that picture its depths are, part by part.
    pub fn places(&self) -> impl Iterator<Item = Vec2> + use<> {
        let finer = self.params.finer;
        (0..finer * finer).map(move |part| {
            let corner = Vec2::new((part % finer) as f32, (part / finer) as f32);
            (corner + 0.5) / finer as f32
        })
    }

    /// Records that a new picture begins.
    pub fn begin(&mut self, encoder: &mut wgpu::CommandEncoder) {
        self.samples = 0;
        encoder.clear_buffer(&self.sums, 0, None);
        encoder.clear_buffer(&self.depths, 0, None);
    }

    /// Records that points of the [`wider`](Self::wider) picture are a part of the depths; the camera is that of the picture.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when the points are of a picture of another size,
    /// [`Error::Scene`](crate::Error::Scene) when recording fails.
    pub fn see(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        camera: &Camera,
        points: &Points,
        part: u32,
        timer: Option<&mut Timer>,
    ) -> Result<()> {
        let (_, size) = self.wider(camera);
        points.require(size)?;
        let finer = self.params.finer;
        let asking = Asking {
            part: [part % finer, part / finer % finer],
            ..self.asking(camera)
        };
        let asking = context.buffer("hbao", &[asking], BufferUsages::UNIFORM)?;
        let resources = [
            (0, asking.as_entire_binding()),
            (1, points.buffer.as_entire_binding()),
            (2, self.depths.as_entire_binding()),
        ];
        let group = self.store.bind(context, &resources)?;
        let dispatch = [Dispatch::over_pixels(size)];
        self.store
            .record(encoder, "depths", timer, &[&group], &dispatch);
        Ok(())
    }

    /// Records that the points of a sample of the picture are added. Those of each sample look along other directions.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when the points are of a picture of another size,
    /// [`Error::Scene`](crate::Error::Scene) when recording fails.
    pub fn add(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        camera: &Camera,
        points: &Points,
        sample: u32,
        timer: Option<&mut Timer>,
    ) -> Result<()> {
        points.require(self.picture)?;
        let asking = Asking {
            turn: turn(sample),
            ..self.asking(camera)
        };
        let asking = context.buffer("hbao", &[asking], BufferUsages::UNIFORM)?;
        let resources = [
            (0, asking.as_entire_binding()),
            (1, points.buffer.as_entire_binding()),
            (2, self.depths.as_entire_binding()),
            (3, self.sums.as_entire_binding()),
        ];
        let group = self.march.bind(context, &resources)?;
        let dispatch = [Dispatch::over_pixels(self.picture)];
        self.march
            .record(encoder, "hbao", timer, &[&group], &dispatch);
        self.samples += 1;
        Ok(())
    }

    /// Records that the mean of what was added is written to textures; there are no bent normals.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the textures are not as [`Targets`] says.
    pub fn resolve(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        targets: &Targets,
    ) -> Result<()> {
        let weight = self.samples as f32;
        self.resolve.record(
            context,
            encoder,
            (self.picture, weight),
            &self.sums,
            targets,
        )
    }

    fn asking(&self, camera: &Camera) -> Asking {
        let eye = Eye::new(camera, self.picture);
        Asking {
            position: eye.position - self.origin,
            scale: eye.scale,
            right: eye.right,
            finer: self.params.finer as f32,
            up: eye.up,
            margin: self.params.margin_of(self.picture) as f32,
            forward: eye.forward,
            is_parallel: u32::from(eye.is_parallel),
            picture: self.picture,
            size: self.params.depths_of(self.picture),
            part: [0; 2],
            d_max: self.params.d_max,
            turn: 0.0,
            directions: self.params.directions,
            steps: self.params.steps,
            padding: [0; 2],
        }
    }

    /// Finds the occlusion of what a camera sees by what it sees, at several places of each pixel; reads it back, and tells what it
    /// took. Submits in pieces that no driver's watchdog minds.
    ///
    /// # Errors
    /// As [`CameraPoints::new`], [`see`](Self::see), [`add`](Self::add) and [`Targets::read`].
    pub fn render(
        &mut self,
        context: &Context,
        world: World<'_>,
        camera: &Camera,
        samples: u32,
        normals: Normals,
        progress: &dyn Progress,
    ) -> Result<(Vec<Sky>, Vec<Pass>)> {
        let finder = CameraPoints::new(context, world.gpu_scene, world.exact)?;
        let encoder = || context.device().create_command_encoder(&Default::default());
        let (asked, origin) = ((world.gpu_scene, world.exact), self.origin);
        let mut passes = Vec::new();
        let mut first = encoder();
        self.begin(&mut first);
        context.submit("hbao", first)?;
        let find = |encoder: &mut _, camera: &Camera, place, points: &mut Points| {
            let look = Look {
                camera,
                place,
                sample: 0,
                normals,
            };
            finder.record_about(context, encoder, origin, asked, &look, points)
        };
        let (wide, size) = self.wider(camera);
        let mut points = Points::new(context, size)?;
        for (part, place) in (0..).zip(self.places()) {
            Pass::timed(&mut passes, "depths", || {
                let mut encoder = encoder();
                let seen = find(&mut encoder, &wide, place, &mut points)
                    .and_then(|()| self.see(context, &mut encoder, camera, &points, part, None));
                (
                    seen.and_then(|()| finish(context, encoder)),
                    [pixels(size), 0],
                )
            })?;
        }
        let mut points = Points::new(context, self.picture)?;
        let samples = samples.max(1);
        for sample in 0..samples {
            Pass::timed(&mut passes, "camera", || {
                let mut encoder = encoder();
                let seen = find(&mut encoder, camera, place_of_sample(sample), &mut points);
                let rays = [pixels(self.picture), 0];
                (seen.and_then(|()| finish(context, encoder)), rays)
            })?;
            Pass::timed(&mut passes, "occlusion", || {
                let mut encoder = encoder();
                let added = self.add(context, &mut encoder, camera, &points, sample, None);
                (added.and_then(|()| finish(context, encoder)), [0, 0])
            })?;
            progress.advance(u64::from(sample) + 1, u64::from(samples));
        }
        let targets = Targets::new(context, self.picture)?;
        let mut last = encoder();
        self.resolve(context, &mut last, &targets)?;
        context.submit("hbao", last)?;
        Ok((targets.read(context)?, passes))
    }
}
