//! The method on a GPU, stage by stage as [`crate::cpu`]:
//!
//! | stage | CPU | GPU |
//! |---|---|---|
//! | 1. virtual point lights | `cpu/emission.rs` | `shaders/emission.wesl` |
//! | 2. what the camera sees | `isophote_scene::GBuffer` | `shaders/gbuffer.wesl`, or `foreign.wesl` |
//! | 3. shadow maps | `cpu/maps.rs` | `shaders/maps.wesl` |
//! | 4. direct light | `cpu/specular.rs` | `shaders/direct.wesl` |
//! | 4. mirrors and glass | `cpu/specular.rs` | `shaders/specular.wesl` |
//! | 5. indirect light | `cpu/{samples,indirect}.rs` | `shaders/indirect.wesl` |
//! | 1. lights that are kept | `cpu/keep.rs` | `shaders/keep.wesl` |
//! | 1., 5. by some of the lights | `cpu/select.rs` | `shaders/{curve,select}.wesl` |
//! | 5. the filter `fill` | `cpu/fill.rs` | `shaders/fill.wesl` |
//! | 6. samples become a picture | `cpu/filter.rs` | `gpu/filter.rs`, over `isophote-filters` |
//! | 6. sequences of pictures | `cpu/history.rs` | `gpu/history.rs`, over `isophote-filters` |
//! | 6. pixels unlike the samples | `cpu/refine.rs` | `shaders/refine.wesl` |
//!
//! [`InstantGi::over`] takes the G-buffer of another renderer instead of asking its own camera rays.
//!
//! Paths, samples and rays are chosen as on the CPU, so that the pictures differ by rounding alone. Everything is made anew
//! for each picture, on the device: nothing is read back in between.
//!
//! The shaders of stages 4 and 5 ask two tracers at once. Of the 8 storage buffers of a stage the scene takes 3, each tracer
//! 2, and this one; what stages leave to each other lies in textures.

mod filter;
mod history;
mod passes;
mod read;

use std::time::{Duration, Instant};

use bytemuck::{Pod, Zeroable};
use isophote_scene::{
    Answers, Camera, Scene,
    gpu::{
        Context, Dispatch, GBuffer, Rasters, ShaderPackage, Timer, UniformArray, View,
        reference::World,
    },
    reference::{Materials, Progress},
    sample::hash_seed,
    shader_package,
};

pub use self::history::History;
use self::{
    filter::Filter,
    passes::{Bound, Passes, Shared, Targets},
};
use crate::{
    GiParams, Lookup, Pattern, Result, Sequence, Stages,
    cpu::{
        check_size,
        filter::Upsample,
        indirect::COMPENSATION,
        keep::KEPT,
        select::{SELECTION, extent_of},
    },
};

/// The WESL modules of this crate.
pub const SHADERS: ShaderPackage = shader_package!(
    "instant_gi",
    [
        "compose", "curve", "direct", "emission", "fill", "foreign", "gbuffer", "indirect", "keep",
        "maps", "params", "refine", "select", "specular", "vpls",
    ]
);

/// Rays of a dispatch, about: a fast device takes a tenth of a second for so many, and no driver gives up on a slow one.
const RAYS: u64 = 1 << 26;
/// Points of a dispatch: enough to keep a device busy, and no more workgroups than a dimension holds.
const POINTS: std::ops::RangeInclusive<u64> = 1 << 10..=1 << 21;
const WORKGROUP: u32 = 64;

/// `Params` of params.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct GpuParams {
    view: View,
    eye: [f32; 3],
    seed: u32,
    forward: [f32; 3],
    compensation_seed: u32,
    least: [f32; 3],
    selection: u32,
    extent: [f32; 3],
    selection_seed: u32,
    size: [u32; 2],
    grid: [u32; 2],
    offset: [u32; 2],
    tile: [u32; 2],
    downsampling: u32,
    irregular: u32,
    paths: u32,
    bounces: u32,
    min_d: f32,
    compensation: u32,
    depth: u32,
    light_rays: u32,
    glossy_rays: u32,
    pbr: u32,
    rotated: u32,
    lattice: u32,
    map_side: u32,
    map_columns: u32,
    map_bias: f32,
    map_smooth: u32,
    kept: u32,
    keep_seed: u32,
    refinement: u32,
    padding: u32,
}

/// `Piece` of params.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Piece {
    first: u32,
    count: u32,
}

/// The stages' results: textures of `Rgba32Float`, linear RGB, as [`Stages`].
#[derive(Debug)]
pub struct StageTextures {
    /// Radiance by light straight from the lights; behind it 1 and the rays it took.
    pub direct: wgpu::Texture,
    /// Radiance by mirrors, glass and highlights; behind it 1 and the rays it took. Zeros where the scene has none.
    pub specular: wgpu::Texture,
    /// Irradiance by the virtual point lights.
    pub irradiance: wgpu::Texture,
    /// Radiance by that irradiance.
    pub indirect: wgpu::Texture,
    /// The sum of direct, specular and indirect.
    pub picture: wgpu::Texture,
}

/// Renders pictures of one size as the paper does. Twin of [`crate::InstantGi`].
#[derive(Debug)]
pub struct InstantGi {
    params: GiParams,
    size: [u32; 2],
    grid: [u32; 2],
    settings: wgpu::Buffer,
    pieces: Pieces,
    passes: Passes,
    /// Another renderer's G-buffer; `None` where the exact tracer answers for the camera.
    rasters: Option<Rasters>,
    filter: Filter,
    targets: Targets,
    stages: StageTextures,
}

/// The dispatches of the stages that take many rays.
#[derive(Debug)]
struct Pieces {
    array: UniformArray<Piece>,
    sort: Vec<Dispatch>,
    weigh: Vec<Dispatch>,
    maps: Vec<Dispatch>,
    direct: Vec<Dispatch>,
    specular: Vec<Dispatch>,
    indirect: Vec<Dispatch>,
    refine: Vec<Dispatch>,
}

impl Pieces {
    fn new(
        context: &Context,
        scene: &Scene,
        params: &GiParams,
        [texels, pixels, samples]: [u32; 3],
    ) -> Result<Self> {
        let shot = u64::from(params.paths) * u64::from(params.bounces);
        let lights = u64::from(params.most_lights());
        let parts: u32 = params.interleaving.iter().product();
        let compensation = u64::from(params.compensation);
        let shorter = if params.bounces > 1 { lights } else { 1 };
        let of_direct = u64::from(params.light_rays) * (scene.lights.len() as u64 + 2);
        let of_surface = lights + compensation * shorter;
        let of_tree = u64::from(params.glossy_rays + params.depth) * (of_surface + of_direct);
        let mut all = Vec::new();
        let mut split = |points: u32, rays: u64| -> Vec<Dispatch> {
            let most = (RAYS / rays.max(1)).clamp(*POINTS.start(), *POINTS.end()) as u32;
            let firsts = (0..points).step_by(most as usize);
            let dispatch = |first| {
                let count = most.min(points - first);
                all.push(Piece { first, count });
                Dispatch {
                    offset: Some(UniformArray::<Piece>::offset(all.len() as u32 - 1)),
                    workgroups: [count.div_ceil(WORKGROUP), 1, 1],
                }
            };
            firsts.map(dispatch).collect()
        };
        // A place takes a step for each other light, of which dozens take as long as a ray.
        let sort = split(shot as u32, shot.div_ceil(64));
        let weigh = split(shot as u32, 64);
        let maps = split(texels, 1);
        let direct = split(pixels, of_direct);
        let specular = split(pixels, of_tree);
        let indirect = split(
            samples,
            lights.div_ceil(u64::from(parts)) + compensation * shorter,
        );
        let refine = split(pixels, of_surface);
        Ok(Self {
            array: UniformArray::new(context, "pieces", &all)?,
            sort,
            weigh,
            maps,
            direct,
            specular,
            indirect,
            refine,
        })
    }
}

/// A stage, or what of it is recorded at once.
struct Work<'a> {
    name: &'static str,
    pass: &'a Bound,
    dispatches: &'a [Dispatch],
}

impl InstantGi {
    /// A renderer for pictures of a size in pixels.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) and [`Error::Filter`](crate::Error::Filter) for parameters out of their
    /// range and a size of zero or of more than 2²⁵ pixels; [`Error::Scene`](crate::Error::Scene) when the exact tracer does
    /// not answer [`Answers::Surface`], or the secondary one, which must when the bound is compensated, and
    /// [`Answers::Distance`] when it fills shadow maps, when a tracer's module does not link, or the device allows no such textures and buffers.
    pub fn new(
        context: &Context,
        world: World<'_>,
        params: &GiParams,
        size: [u32; 2],
    ) -> Result<Self> {
        Self::with(context, world, params, size, None)
    }

    /// A renderer over a G-buffer that another renderer fills before each picture; no camera rays are asked. It must tell depths,
    /// shading normals, base colours, instances and primitives, of one sample a pixel. Of the scene's materials at a pixel
    /// only metal, glass and roughness are looked up. [`record`](Self::record) takes the camera that it was filled for.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) when it lacks a layer or has several samples; and as [`new`](Self::new).
    pub fn over(
        context: &Context,
        world: World<'_>,
        params: &GiParams,
        gbuffer: &GBuffer,
    ) -> Result<Self> {
        check_layers(gbuffer)?;
        let rasters = Rasters::new(context, Some(gbuffer), None)?;
        Self::with(context, world, params, gbuffer.size(), Some(rasters))
    }

    fn with(
        context: &Context,
        world: World<'_>,
        params: &GiParams,
        size: [u32; 2],
        rasters: Option<Rasters>,
    ) -> Result<Self> {
        params.check()?;
        check_size(size)?;
        if params.caching > 0.0 {
            return Err(crate::Error::Parameter {
                name: "the distance of cached light",
                value: params.caching.to_string(),
                expected: "it must be 0 on GPUs",
            });
        }
        let exact = world.exact.answers();
        exact.require(Answers::Surface, "igi", "the exact tracer")?;
        let secondary = world.secondary.answers();
        secondary.require(params.needs(), "igi", "the secondary tracer")?;
        let upsample = Upsample::new(size, params)?;
        let grid = upsample.grid.size().map(|side| side as u32);
        let (targets, stages) = Targets::new(context, params, &upsample, size, rasters.is_some())?;
        let texels = targets.atlas.map_or(0, |atlas| atlas.texels());
        let points = [texels, size[0] * size[1], grid[0] * grid[1]];
        let pieces = Pieces::new(context, world.scene, params, points)?;
        let settings = context.buffer::<GpuParams>("settings", &[], wgpu::BufferUsages::UNIFORM)?;
        let reflects =
            params.depth > 0 && params.materials == Materials::Pbr && has_specular(world.scene);
        let shared = Shared {
            targets: &targets,
            stages: &stages,
            settings: &settings,
            pieces: &pieces.array,
            rasters: rasters.as_ref(),
        };
        let passes = Passes::new(context, &world, params, reflects, &shared)?;
        Ok(Self {
            params: *params,
            size,
            grid,
            filter: Filter::new(context, &upsample, size)?,
            settings,
            pieces,
            passes,
            rasters,
            targets,
            stages,
        })
    }

    /// The textures that [`record`](Self::record) fills.
    pub fn stages(&self) -> &StageTextures {
        &self.stages
    }

    /// Records all stages for what a camera sees. `world` is that of [`new`](Self::new), where it is now. The camera is
    /// passed by the queue, so that there can be one picture per submission. Passes are timed by the names of
    /// [`Stages::passes`].
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) and [`Error::Filter`](crate::Error::Filter) when recording fails.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        world: World<'_>,
        camera: &Camera,
        mut timer: Option<&mut Timer>,
    ) -> Result<()> {
        self.set_camera(context, &world, camera, self.params.seed)?;
        for work in self.work() {
            work.record(encoder, &world, timer.as_deref_mut(), work.dispatches);
        }
        self.record_filter(context, encoder, timer.as_deref_mut())?;
        for work in self.work_after() {
            work.record(encoder, &world, timer.as_deref_mut(), work.dispatches);
        }
        Ok(())
    }

    /// Records the next picture of a sequence, as [`record`](Self::record): with other light paths than those before it, and
    /// with the irradiance that the history has of what is seen again. Of what [`read`](Self::read) then tells, the rays of the
    /// pass `refine` are means over the sequence.
    ///
    /// # Errors
    /// As [`record`](Self::record), and [`Error::Filter`](crate::Error::Filter) when the history is of pictures of another size.
    pub fn record_next(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        world: World<'_>,
        camera: &Camera,
        history: &mut History,
        mut timer: Option<&mut Timer>,
    ) -> Result<()> {
        let seed = self.params.seed.wrapping_add(history.pictures());
        self.set_camera(context, &world, camera, seed)?;
        for work in self.work() {
            work.record(encoder, &world, timer.as_deref_mut(), work.dispatches);
        }
        self.record_filter(context, encoder, timer.as_deref_mut())?;
        if let Some(refine) = self.refine() {
            refine.record(encoder, &world, timer.as_deref_mut(), refine.dispatches);
        }
        let mut add = |encoder: &mut wgpu::CommandEncoder| {
            let irradiance = &self.stages.irradiance;
            let eye = camera.pinhole();
            history.record(context, encoder, &self.targets, irradiance, &eye)
        };
        match timer.as_deref_mut() {
            Some(timer) => timer.around("history", encoder, add)?,
            None => add(encoder)?,
        }
        let compose = self.compose();
        compose.record(encoder, &world, timer, compose.dispatches);
        Ok(())
    }

    /// Renders what a camera sees and reads it back, in submissions that no driver's watchdog minds; `progress` is told how
    /// far it is. What a stage took is by the device's clock, or where it has none by the host's.
    ///
    /// # Errors
    /// As [`record`](Self::record) and [`read`](Self::read).
    pub fn render(
        &self,
        context: &Context,
        world: World<'_>,
        camera: &Camera,
        progress: &dyn Progress,
    ) -> Result<Stages> {
        self.set_camera(context, &world, camera, self.params.seed)?;
        let (work, after) = (self.work(), self.work_after());
        let all = work.iter().chain(&after);
        let total = all.map(|one| one.dispatches.len() as u64).sum::<u64>() + 1;
        let mut done = 0;
        let mut times: Vec<(&'static str, Duration)> = Vec::new();
        let mut timer = Timer::new(context, 1);
        let mut submit =
            |name: &'static str,
             record: &mut dyn FnMut(&mut wgpu::CommandEncoder, &mut Timer) -> Result<()>|
             -> Result<()> {
                let mut encoder = context.device().create_command_encoder(&Default::default());
                record(&mut encoder, &mut timer)?;
                timer.resolve(&mut encoder);
                let start = Instant::now();
                context.submit(name, encoder)?;
                context.wait(name)?;
                let took = start.elapsed();
                let measured = timer.read(context)?.first().map_or(took, |pass| pass.time);
                match times.iter_mut().find(|(other, _)| *other == name) {
                    Some((_, time)) => *time += measured,
                    None => times.push((name, measured)),
                }
                done += 1;
                progress.advance(done, total);
                Ok(())
            };
        for (number, work) in [work, after].iter().enumerate() {
            if number == 1 {
                submit("filter", &mut |encoder, timer| {
                    self.record_filter(context, encoder, Some(timer))
                })?;
            }
            for one in work {
                for dispatch in one.dispatches {
                    submit(one.name, &mut |encoder, timer| {
                        one.record(encoder, &world, Some(timer), std::slice::from_ref(dispatch));
                        Ok(())
                    })?;
                }
            }
        }
        let mut stages = self.read(context)?;
        for pass in &mut stages.passes {
            let time = times.iter().find(|(name, _)| *name == pass.name);
            pass.seconds = time.map_or(0.0, |(_, time)| time.as_secs_f64());
        }
        Ok(stages)
    }

    fn record_filter(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        timer: Option<&mut Timer>,
    ) -> Result<()> {
        let record = |encoder: &mut wgpu::CommandEncoder| {
            self.filter
                .record(context, encoder, &self.targets, &self.stages)
        };
        match timer {
            Some(timer) => timer.around("filter", encoder, record),
            None => record(encoder),
        }
    }

    /// Stages 1 to 5.
    fn work(&self) -> Vec<Work<'_>> {
        let passes = &self.passes;
        let mut all = vec![
            Work {
                name: "vpls",
                pass: &passes.shoot,
                dispatches: &self.targets.paths,
            },
            Work {
                name: "vpls",
                pass: &passes.compact,
                dispatches: &ONE,
            },
        ];
        all.extend(passes.sort.as_ref().map(|pass| Work {
            name: "vpls",
            pass,
            dispatches: &self.pieces.sort,
        }));
        all.push(Work {
            name: "camera",
            pass: &passes.camera,
            dispatches: &self.targets.pixels,
        });
        if let Some([look, weigh, keep]) = &passes.keep {
            let steps = [(look, &LOOK[..]), (weigh, &self.pieces.weigh), (keep, &ONE)];
            all.extend(steps.map(|(pass, dispatches)| Work {
                name: "keep",
                pass,
                dispatches,
            }));
        }
        all.extend(passes.maps.as_ref().map(|pass| Work {
            name: "maps",
            pass,
            dispatches: &self.pieces.maps,
        }));
        all.push(Work {
            name: "direct",
            pass: &passes.direct,
            dispatches: &self.pieces.direct,
        });
        for (name, pass) in ["direct", "mirrored"]
            .into_iter()
            .zip(passes.specular.iter().flatten())
        {
            all.push(Work {
                name,
                pass,
                dispatches: &self.pieces.specular,
            });
        }
        for pass in [Some(&passes.indirect), passes.fill.as_ref()] {
            all.extend(pass.map(|pass| Work {
                name: "indirect",
                pass,
                dispatches: &self.pieces.indirect,
            }));
        }
        all
    }

    /// What comes after the filters.
    fn work_after(&self) -> Vec<Work<'_>> {
        self.refine().into_iter().chain([self.compose()]).collect()
    }

    fn refine(&self) -> Option<Work<'_>> {
        self.passes.refine.as_ref().map(|pass| Work {
            name: "refine",
            pass,
            dispatches: &self.pieces.refine,
        })
    }

    fn compose(&self) -> Work<'_> {
        Work {
            name: "compose",
            pass: &self.passes.compose,
            dispatches: &self.targets.pixels,
        }
    }

    fn set_camera(
        &self,
        context: &Context,
        world: &World<'_>,
        camera: &Camera,
        seed: u64,
    ) -> Result<()> {
        let eye = camera.pinhole();
        self.filter.set_camera(context, &eye)?;
        let params = &self.params;
        let downsampling = params.downsampling;
        let maps = params.shadow_maps().copied().unwrap_or_default();
        let bounds = world.gpu_scene.bounds();
        let settings = GpuParams {
            view: View::of_camera(camera, self.size, &bounds),
            eye: eye.eye.to_array(),
            seed: hash_seed(seed),
            forward: eye.forward.to_array(),
            compensation_seed: hash_seed(seed ^ COMPENSATION),
            least: bounds.min.to_array(),
            selection: params.selection,
            extent: extent_of(&bounds).to_array(),
            selection_seed: hash_seed(seed ^ SELECTION),
            size: self.size,
            grid: self.grid,
            offset: self.size.map(|side| (downsampling / 2).min(side - 1)),
            tile: params.interleaving,
            downsampling,
            irregular: u32::from(params.pattern == Pattern::Irregular),
            paths: params.paths,
            bounces: params.bounces,
            min_d: params.min_d,
            compensation: params.compensation,
            depth: params.depth,
            light_rays: params.light_rays,
            glossy_rays: params.glossy_rays,
            pbr: u32::from(params.materials == Materials::Pbr),
            rotated: u32::from(seed != 0),
            lattice: u32::from(params.sequence == Sequence::Lattice),
            map_side: maps.resolution,
            map_columns: self.targets.atlas.map_or(1, |atlas| atlas.columns),
            map_bias: maps.bias,
            map_smooth: u32::from(maps.lookup == Lookup::Smooth),
            kept: params.kept,
            keep_seed: hash_seed(seed ^ KEPT),
            refinement: params.refinement,
            padding: 0,
        };
        context.check("settings", |_| {
            let bytes = bytemuck::bytes_of(&settings);
            context.queue().write_buffer(&self.settings, 0, bytes);
        })?;
        Ok(())
    }
}

const ONE: [Dispatch; 1] = [Dispatch {
    offset: None,
    workgroups: [1; 3],
}];

/// Over the points that lights are weighed for.
const LOOK: [Dispatch; 1] = [Dispatch {
    offset: None,
    workgroups: [passes::POINTS as u32 / WORKGROUP, 1, 1],
}];

impl Work<'_> {
    fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        world: &World<'_>,
        timer: Option<&mut Timer>,
        dispatches: &[Dispatch],
    ) {
        let exact = world.exact.bind_group();
        let scene = world.gpu_scene.bind_group();
        let third = self.pass.rasters.as_ref();
        let third = third.unwrap_or(world.secondary.bind_group());
        let all = [&self.pass.group, exact, scene, third];
        let groups = &all[..1 + self.pass.others];
        self.pass
            .compute
            .record(encoder, self.name, timer, groups, dispatches);
    }
}

/// Refuses a G-buffer that lacks a layer, or has more than one sample a pixel.
fn check_layers(gbuffer: &GBuffer) -> Result<()> {
    let views = gbuffer.views();
    let size = gbuffer.size();
    let layers = [
        ("normals", &views.normal),
        ("base colours", &views.albedo),
        ("instances and primitives", &views.ids),
    ];
    for (name, view) in layers {
        let found = [view.texture().width(), view.texture().height()];
        if found != size {
            return Err(crate::Error::Parameter {
                name: "the G-buffer",
                value: format!(
                    "{}x{} pixels with {}x{} {name}",
                    size[0], size[1], found[0], found[1]
                ),
                expected: "it must tell depths, normals, base colours, instances and primitives of every pixel",
            });
        }
    }
    if gbuffer.samples() != 1 {
        return Err(crate::Error::Parameter {
            name: "the G-buffer",
            value: format!("one of {} samples a pixel", gbuffer.samples()),
            expected: "it must have one sample a pixel",
        });
    }
    Ok(())
}

/// Whether anything in a scene mirrors or refracts.
fn has_specular(scene: &Scene) -> bool {
    let mut materials = scene.materials.iter();
    materials.any(|one| one.metallic > 0.0 || one.transmission > 0.0)
}
