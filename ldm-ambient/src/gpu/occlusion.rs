//! Stages 5 and 6, occlusion on a GPU: points ask the maps of each batch, and what they see is summed up. Twin of
//! [`cpu::occlusion`](crate::cpu::occlusion).

use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec4};
use isophote_scene::{
    Camera, Pass, Scene, Selection,
    gpu::{ComputePass, Context, Dispatch, GpuScene, Timer, UniformArray, reference::World},
    reference::{Normals, Progress},
};
use wgpu::BufferUsages;

use super::{
    BuildMethod, CameraPoints, Filler, Look, Points, broken, finish, fit, grid, linker,
    maps::{Asked, Batch, Builder, Kept, Series},
    reach::Near,
    target,
    triangles::{Chunk, Triangles},
};
use crate::{
    Directions, OcclusionParams, Result,
    cpu::{
        occlusion::Sky,
        points::place_of_sample,
        view::{View, longest_axis},
    },
};

/// Bytes of what is summed up for a point.
pub(super) const SUMS: u64 = 32;

/// Textures that [`Occlusion::resolve`] fills: `Rgba32Float` with the usage `STORAGE_BINDING`, of the size of the picture.
#[derive(Clone, Debug)]
pub struct Targets {
    /// Ambient occlusion, obscurance, 0 and 1; 1 and 1 where there is no point.
    pub occlusion: wgpu::Texture,
    /// Unit, or zero where all is occluded or there is no point; then 1.
    pub bent_normals: wgpu::Texture,
}

/// Collects the occlusion of the points of a picture. Twin of [`cpu::occlusion::Occlusion`](crate::cpu::occlusion::Occlusion).
///
/// 1. [`begin`](Self::begin), where the instances have moved or a new picture begins.
/// 2. [`add`](Self::add) for the points, or for each part of them.
/// 3. [`resolve`](Self::resolve).
/// 4. When the commands were submitted, [`has_room`](Self::has_room): where it says no, the same is to be recorded again.
#[derive(Debug)]
pub struct Occlusion {
    params: OcclusionParams,
    size: [u32; 2],
    directions: Vec<Vec3>,
    triangles: Triangles,
    builder: Builder,
    look_up: ComputePass,
    resolve: Resolve,
    sums: wgpu::Buffer,
    /// Most layers that were needed, and whether any was lost.
    status: wgpu::Buffer,
    filler: Filler,
    /// Of a point that is in every part added so far.
    weight: f32,
}

/// `Resolving` of resolve.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Resolving {
    size: [u32; 2],
    weight: f32,
    padding: u32,
}

/// Writes sums to textures.
#[derive(Debug)]
pub(super) struct Resolve {
    pass: ComputePass,
}

impl Resolve {
    pub(super) fn new(context: &Context) -> Result<Self> {
        let shader = linker().link("ldm_ambient::resolve")?;
        let pass = shader.compute_pass(context, "resolve", &[], &[])?;
        Ok(Self { pass })
    }

    /// Of points in a picture of a size, and with what a point weighs that is in every part.
    pub(super) fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        (size, weight): ([u32; 2], f32),
        sums: &wgpu::Buffer,
        targets: &Targets,
    ) -> Result<()> {
        let resolving = Resolving {
            size,
            weight,
            padding: 0,
        };
        let resolving = context.buffer("resolving", &[resolving], BufferUsages::UNIFORM)?;
        let view = |texture: &wgpu::Texture| texture.create_view(&Default::default());
        let (occlusion, bent) = (view(&targets.occlusion), view(&targets.bent_normals));
        let resources = [
            (0, resolving.as_entire_binding()),
            (1, sums.as_entire_binding()),
            (2, wgpu::BindingResource::TextureView(&occlusion)),
            (3, wgpu::BindingResource::TextureView(&bent)),
        ];
        let group = self.pass.bind(context, &resources)?;
        let dispatch = [Dispatch::over_pixels(size)];
        self.pass
            .record(encoder, "resolve", None, &[&group], &dispatch);
        Ok(())
    }
}

impl Targets {
    /// Textures of a size in pixels, which can also be read by shaders and copied.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device has no textures that large.
    pub fn new(context: &Context, size: [u32; 2]) -> Result<Self> {
        Ok(Self {
            occlusion: target(context, "occlusion", size)?,
            bent_normals: target(context, "bent normals", size)?,
        })
    }

    /// Reads back what was submitted, row by row from the top.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device fails, or has not filled them.
    pub fn read(&self, context: &Context) -> Result<Vec<Sky>> {
        let occlusion: Vec<Vec4> = context.read_texture("occlusion", &self.occlusion)?;
        let bent: Vec<Vec4> = context.read_texture("bent normals", &self.bent_normals)?;
        let sky = |(open, bent): (Vec4, Vec4)| {
            if open.w != 1.0 || bent.w != 1.0 || !open.is_finite() || !bent.is_finite() {
                return Err(broken("the device did not finish, or its driver is broken"));
            }
            Ok(Sky {
                ao: open.x,
                obscurance: open.y,
                bent_normal: bent.truncate(),
            })
        };
        occlusion.into_iter().zip(bent).map(sky).collect()
    }
}

impl Occlusion {
    /// For the selected part of a scene, and points in pictures of a size in pixels.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) for parameters out of their range, [`Error::Scene`](crate::Error::Scene)
    /// when nothing is selected, or something is too large for the device.
    pub fn new(
        context: &Context,
        (scene, gpu_scene): (&Scene, &GpuScene),
        selection: &Selection,
        params: &OcclusionParams,
        method: BuildMethod,
        size: [u32; 2],
    ) -> Result<Self> {
        params.check()?;
        let directions = Directions::new(params.maps.maps);
        let turned = |frame| directions.turned(params.seed, frame).vectors().to_vec();
        let (builder, look_up) = maps_of(context, gpu_scene, params, method)?;
        let filler = Filler::new(context)?;
        let count = u64::from(size[0]) * u64::from(size[1]);
        Ok(Self {
            params: *params,
            size,
            directions: (0..params.frames).flat_map(turned).collect(),
            triangles: Triangles::new(context, scene, gpu_scene, selection, &filler)?,
            builder,
            look_up,
            resolve: Resolve::new(context)?,
            sums: context.storage("sums of points", SUMS * count)?,
            status: context.storage("status", 8)?,
            filler,
            weight: 0.0,
        })
    }

    /// What positions of points are relative to, metres.
    pub(crate) fn origin(&self) -> Vec3 {
        self.triangles.origin
    }

    /// Bytes that it holds on the device for maps and sums; this does not grow with the number of maps.
    pub fn bytes(&self) -> u64 {
        let corners = self.triangles.chunks.iter();
        let corners: u64 = corners.map(Chunk::bytes).sum();
        self.builder.bytes() + self.sums.size() + corners
    }

    /// Records that a new picture begins, of instances where `gpu_scene` has them.
    pub fn begin(&mut self, encoder: &mut wgpu::CommandEncoder, gpu_scene: &GpuScene) {
        self.weight = 0.0;
        encoder.clear_buffer(&self.sums, 0, None);
        encoder.clear_buffer(&self.status, 0, None);
        self.triangles.record(encoder, gpu_scene, &self.filler);
    }

    /// Records that points are added as one part of so many; of two parts, one is asked along every other direction.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when the points are of a picture of another size,
    /// [`Error::Scene`](crate::Error::Scene) when recording fails.
    pub fn add(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        gpu_scene: &GpuScene,
        points: &Points,
        [part, parts]: [u32; 2],
        mut timer: Option<&mut Timer>,
    ) -> Result<()> {
        points.require(self.size)?;
        let directions = self.directions.iter().skip(part as usize);
        let directions: Vec<Vec3> = directions.step_by(parts.max(1) as usize).copied().collect();
        // The mean cosine over a hemisphere is a half.
        self.weight += 0.5 * directions.len() as f32;
        let views = self.views(context, &directions, points);
        let asked = Asked {
            points: self.size[0] * self.size[1],
            tolerance: self.params.maps.tolerance,
            d_max: self.params.d_max,
        };
        let series = self
            .builder
            .series(context, &self.triangles, &views, asked)?;
        let [pixels, layers] = self.builder.tables();
        let resources = [
            (0, series.batches.binding()),
            pixels,
            layers,
            (3, points.buffer.as_entire_binding()),
            (4, self.sums.as_entire_binding()),
            (5, self.status.as_entire_binding()),
        ];
        let group = self.look_up.bind(context, &resources)?;
        let near = self.near(context, points, &series)?;
        if let Some(near) = &near {
            near.mark(encoder, timer.as_deref_mut());
        }
        for batch in 0..series.len() {
            let drawn = (&self.triangles, gpu_scene);
            let timer_of_maps = timer.as_deref_mut();
            series.record_near(encoder, batch, near.as_ref(), drawn, timer_of_maps);
            let dispatch = Dispatch {
                offset: Some(UniformArray::<Batch>::offset(batch as u32)),
                workgroups: grid(u64::from(asked.points).div_ceil(64)),
            };
            let timer = timer.as_deref_mut();
            self.look_up
                .record(encoder, "look-up", timer, &[&group], &[dispatch]);
        }
        Ok(())
    }

    /// What is within reach of points, where that is of interest.
    fn near(
        &self,
        context: &Context,
        points: &Points,
        series: &Series<'_>,
    ) -> Result<Option<Near<'_>>> {
        let Some(reach) = self.builder.reach() else {
            return Ok(None);
        };
        let all = (&points.buffer, self.size[0] * self.size[1]);
        let distances = [self.params.d_max, self.triangles.bounds.diagonal()];
        let bounds = points.bounds().unwrap_or(self.triangles.bounds);
        let near = reach.of(context, &series.batches, all, &bounds, distances)?;
        Ok(Some(near))
    }

    /// The views along directions, fitted around points.
    fn views(&self, context: &Context, directions: &[Vec3], points: &Points) -> Vec<View> {
        // A picture without a point is looked at as if it held everything.
        let all = [self.triangles.bounds];
        let (boxes, bounds) = match points.bounds() {
            None => (&all[..], all[0]),
            Some(bounds) => (&points.boxes[..], bounds),
        };
        let longest = longest_axis(&bounds);
        fit(
            context,
            directions,
            (self.triangles.origin, boxes),
            longest,
            self.params.maps.resolution,
        )
    }

    /// Records that what was added is written to textures.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the textures are not as [`Targets`] says.
    pub fn resolve(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        targets: &Targets,
    ) -> Result<()> {
        let weighed = (self.size, self.weight);
        self.resolve
            .record(context, encoder, weighed, &self.sums, targets)
    }

    /// Whether there was room for all layers of what was submitted since the last [`begin`](Self::begin). Where there was
    /// not, there will be, and the picture is to be recorded again. Lists that grew too long become sums
    /// ([`BuildMethod::LinkedLists`]).
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device fails, or binds no buffers that are large enough.
    pub fn has_room(&mut self, context: &Context, gpu_scene: &GpuScene) -> Result<bool> {
        let status: Vec<u32> = context.read("status", &self.status, 2)?;
        let lost = status[1] != 0;
        if lost {
            let method = BuildMethod::Linearised;
            let of_sums = maps_of(context, gpu_scene, &self.params, method)?;
            (self.builder, self.look_up) = of_sums;
        }
        Ok(!self.builder.make_room(context, status[0])? && !lost)
    }

    /// Finds the occlusion of what a camera sees, at several places of each pixel, which share the maps; reads it back, and
    /// tells what it took. Submits in pieces that no driver's watchdog minds.
    ///
    /// # Errors
    /// As [`CameraPoints::new`], [`add`](Self::add) and [`Targets::read`].
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
        let mut points = Points::new(context, self.size)?;
        let targets = Targets::new(context, self.size)?;
        let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
        let encoder = || context.device().create_command_encoder(&Default::default());
        let mut passes = Vec::new();
        let samples = samples.max(1);
        loop {
            let mut first = encoder();
            self.begin(&mut first, world.gpu_scene);
            context.submit("occlusion", first)?;
            let mut done = 0;
            for sample in 0..samples {
                let look = Look {
                    camera,
                    place: place_of_sample(sample),
                    sample: 0,
                    normals,
                };
                Pass::timed(&mut passes, "camera", || {
                    let mut encoder = encoder();
                    let asked = (world.gpu_scene, world.exact);
                    let points = &mut points;
                    let seen = finder.record(context, &mut encoder, self, asked, &look, points);
                    (seen.and_then(|()| finish(context, encoder)), [pixels, 0])
                })?;
                let before = self.weight;
                Pass::timed(&mut passes, "occlusion", || {
                    let mut encoder = encoder();
                    let scene = world.gpu_scene;
                    let part = [sample, samples];
                    let added = self.add(context, &mut encoder, scene, &points, part, None);
                    let maps = 2.0 * (self.weight - before);
                    done += maps as u64;
                    let rays = [maps as u64 * pixels, 0];
                    (added.and_then(|()| finish(context, encoder)), rays)
                })?;
                progress.advance(done, self.directions.len() as u64);
                if !self.has_room(context, world.gpu_scene)? {
                    passes.clear();
                    break;
                }
            }
            if passes.is_empty() {
                continue;
            }
            let mut last = encoder();
            self.resolve(context, &mut last, &targets)?;
            context.submit("occlusion", last)?;
            return Ok((targets.read(context)?, passes));
        }
    }
}

/// What builds the maps that points ask, and what asks them.
fn maps_of(
    context: &Context,
    gpu_scene: &GpuScene,
    params: &OcclusionParams,
    method: BuildMethod,
) -> Result<(Builder, ComputePass)> {
    let resolution = params.maps.resolution;
    let is_bounded = params.d_max.is_finite();
    let builder = match is_bounded {
        true => Builder::near(context, gpu_scene, method, resolution)?,
        false => Builder::new(context, gpu_scene, Kept::Extents, resolution)?,
    };
    let look_up = linker()
        .feature("extents", !is_bounded)
        .feature("lists", is_bounded && method == BuildMethod::LinkedLists)
        .link("ldm_ambient::look_up")?;
    let look_up = look_up.compute_pass(context, "look_up", &[], &[0])?;
    Ok((builder, look_up))
}
