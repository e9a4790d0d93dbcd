//! The hybrid renderer (§4, §5) as wgpu passes, stage by stage as [`crate::cpu`]:
//!
//! 1. The G-buffer, rasterised; `fragments` reads it, one shading per primitive and pixel.
//! 2. `light`: direct light, with shadows by exact rays or by the maps; or, as in the paper, by shadow maps.
//! 3. `gather`: diffuse secondary rays, a few a pixel, single bounce.
//! 4. `filter`, and between its two shaders the two-pass Gaussian of `isophote-filters`.
//! 5. `gather`: glossy and mirror rays.
//! 6. `combine`; each intermediate of the paper's Fig. 5 is a texture.
//!
//! Samples, rays and lights are chosen as on the CPU. What differs: positions are depths along the pixels' rays, and with
//! several samples a pixel a triangle is looked at nearest to the pixel's centre, not at its first sample.
//!
//! Stages 3 and 5 take one ray of each sample at a time, which the secondary tracer answers and the exact one lights, since a
//! shader knows one tracer. With shadow maps the same shader does both, and all lights count at once, as points. Of the 8 storage buffers of a stage the scene takes 3, the tracer 2 and this 2.

mod passes;
mod read;
mod work;

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use isophote_filters::{
    Pinhole,
    gpu::{Format, Gaussian, Guides},
};
use isophote_scene::{
    Answers, Camera, Material, Scene,
    gpu::{
        Context, GBuffer, GBufferPass, GpuTracer, Rasters, ShadowMaps, ShadowOptions, Timer,
        reference::World,
    },
    reference::Materials,
    sample::hash_seed,
};

use self::{
    passes::{Passes, Target, Unbound, textures},
    work::{DIFFUSE, DIRECT, GLOSSY, MOST_SAMPLES, Piece, Pieces},
};
use crate::{
    Error, HybridParams, Result, Shadows,
    cpu::{check_size, filter::pinhole},
};

/// `Params` of fragments.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct GpuParams {
    seed: u32,
    bounced_seed: u32,
    samples: u32,
    light_rays: u32,
    diffuse_rays: u32,
    glossy_rays: u32,
    texture_level: f32,
    blurs_light: u32,
    eye: [f32; 3],
    pbr: u32,
    forward: [f32; 3],
    padding: u32,
}

/// The stages' results: textures of `Rgba32Float`, linear RGB and 1, as [`Stages`](crate::Stages).
#[derive(Debug)]
pub struct StageTextures {
    /// Radiance by light straight from the lights.
    pub direct: wgpu::Texture,
    /// Irradiance by one diffuse bounce, as the few rays of each pixel found it. Its fourth channel is how much of the pixel
    /// scatters diffusely.
    pub irradiance: wgpu::Texture,
    /// The same after the Gaussian.
    pub filtered: wgpu::Texture,
    /// Radiance by the filtered irradiance.
    pub diffuse: wgpu::Texture,
    /// Radiance by glossy and mirror rays, and by those through glass.
    pub glossy: wgpu::Texture,
    /// The sum of direct, diffuse and glossy.
    pub picture: wgpu::Texture,
}

/// Renders pictures of one size as the paper does.
#[derive(Debug)]
pub struct Hybrid {
    params: HybridParams,
    size: [u32; 2],
    gbuffer: GBuffer,
    /// `None` where another renderer fills the G-buffer.
    raster: Option<GBufferPass>,
    /// `None` where shadows are asked of tracers.
    shadow_maps: Option<ShadowMaps>,
    rasters: Rasters,
    settings: wgpu::Buffer,
    pieces: Pieces,
    passes: Passes,
    guides: Option<Guides>,
    gaussian: Gaussian,
    /// `None` where it would do nothing.
    light_gaussian: Option<Gaussian>,
    target: Target,
    stages: StageTextures,
}

impl Hybrid {
    /// A renderer for pictures of a size in pixels. With `shadow_maps` no ray goes towards a light: neither from what the
    /// camera sees nor from what secondary rays hit.
    ///
    /// # Errors
    /// [`Error::Parameter`] and [`Error::Filter`] for parameters out of their
    /// range and a size of zero or of more than 2²⁵ samples; [`Error::Scene`] when a tracer does not
    /// answer [`Answers::Surface`], its module does not link, the device allows no such textures, buffers and numbers of
    /// rays, or there are shadow maps and light that they do not know: of emissive triangles or an environment.
    pub fn new(
        context: &Context,
        world: World<'_>,
        params: &HybridParams,
        size: [u32; 2],
        shadow_maps: Option<&ShadowOptions>,
    ) -> Result<Self> {
        params.check()?;
        check_size(size, params.samples)?;
        let gbuffer = GBuffer::new(context, size, params.samples)?;
        let raster = GBufferPass::new(context, params.samples)?;
        Self::with(context, world, params, gbuffer, Some(raster), shadow_maps)
    }

    /// A renderer over a G-buffer that another renderer fills. It must tell instances and primitives; its number of samples
    /// stands for that of `params`.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn over(
        context: &Context,
        world: World<'_>,
        params: &HybridParams,
        gbuffer: GBuffer,
        shadow_maps: Option<&ShadowOptions>,
    ) -> Result<Self> {
        let params = HybridParams {
            samples: gbuffer.samples(),
            ..*params
        };
        params.check()?;
        check_size(gbuffer.size(), params.samples)?;
        Self::with(context, world, &params, gbuffer, None, shadow_maps)
    }

    fn with(
        context: &Context,
        world: World<'_>,
        params: &HybridParams,
        gbuffer: GBuffer,
        raster: Option<GBufferPass>,
        shadow_maps: Option<&ShadowOptions>,
    ) -> Result<Self> {
        for (tracer, role) in [
            (world.exact, "the exact tracer"),
            (world.secondary, "the secondary tracer"),
        ] {
            tracer.answers().require(Answers::Surface, "ldi", role)?;
        }
        let size = gbuffer.size();
        let samples = size[0] * size[1] * params.samples;
        let shadow_maps = match shadow_maps {
            None => None,
            Some(options) => {
                check_lights(world.scene)?;
                Some(ShadowMaps::new(context, &world.scene.lights, options)?)
            }
        };
        let rasters = Rasters::new(context, Some(&gbuffer), shadow_maps.as_ref())?;
        let gaussian = |width: u32| {
            let twin = isophote_filters::Gaussian::new(width as usize, params.filter_sigma)?;
            Gaussian::new(context, &twin, params.edges, size, Format::Single)
        };
        let settings = context.buffer::<GpuParams>("hybrid", &[], wgpu::BufferUsages::UNIFORM)?;
        let pieces = Pieces::new(context, &world, params, samples, shadow_maps.is_some())?;
        let (target, stages) = textures(context, size, samples.min(MOST_SAMPLES), samples)?;
        let passes = Unbound::new(context, &world, params, &rasters, shadow_maps.is_some())?;
        let passes = passes.bound(context, &settings, &pieces.buffer, &target, &stages)?;
        Ok(Self {
            params: *params,
            size,
            raster,
            shadow_maps,
            rasters,
            settings,
            pieces,
            passes,
            guides: match params.edges {
                None => None,
                // The camera comes with each picture.
                Some(_) => Some(Guides::new(context, size, &Pinhole::at_origin(1.0)?)?),
            },
            gaussian: gaussian(params.filter_width)?,
            light_gaussian: match params.light_filter_width {
                1 => None,
                width => Some(gaussian(width)?),
            },
            gbuffer,
            target,
            stages,
        })
    }

    /// The textures that [`record`](Self::record) fills.
    pub fn stages(&self) -> &StageTextures {
        &self.stages
    }

    /// Records all stages for what a camera sees. `world` is that of [`new`](Self::new), where it is now. The camera is
    /// passed by the queue, so that there can be one picture per submission. Passes that the renderer itself records are
    /// timed: `G-buffer`, `direct`, `diffuse`, `glossy`, `filter`, `combine`.
    ///
    /// All in one submission, which a driver may give up where it takes seconds: for many rays there is
    /// [`render`](Self::render).
    ///
    /// # Errors
    /// [`Error::Scene`] when recording fails.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        world: World<'_>,
        camera: &Camera,
        mut timer: Option<&mut Timer>,
    ) -> Result<()> {
        self.record_start(context, encoder, world, camera, timer.as_deref_mut())?;
        let all = 0..self.pieces.count();
        self.record_pieces(encoder, &world, all, timer.as_deref_mut());
        self.record_end(context, encoder, &world, timer)
    }

    /// Records what the camera sees, and the shadow maps.
    fn record_start(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        world: World<'_>,
        camera: &Camera,
        timer: Option<&mut Timer>,
    ) -> Result<()> {
        self.set_camera(context, camera)?;
        if let Some(raster) = &self.raster {
            raster.record(
                context,
                encoder,
                world.gpu_scene,
                camera,
                &self.gbuffer,
                timer,
            )?;
        }
        if let Some(maps) = &self.shadow_maps {
            maps.record(context, encoder, world.gpu_scene, &world.scene.lights, None)?;
        }
        Ok(())
    }

    /// Records dispatches of the stages that take rays: so many, from number `first` on.
    fn record_pieces(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        world: &World<'_>,
        pieces: Range<usize>,
        mut timer: Option<&mut Timer>,
    ) {
        let direct = match self.params.shadows {
            Shadows::Exact => world.exact,
            Shadows::Secondary => world.secondary,
        };
        let stages = [
            (DIRECT, "direct", vec![(&self.passes.direct, direct)]),
            (DIFFUSE, "diffuse", self.gather(world)),
            (GLOSSY, "glossy", self.gather(world)),
        ];
        for (stage, name, pipelines) in stages {
            let mut dispatches = self.pieces.of(stage, &pieces).peekable();
            if dispatches.peek().is_none() {
                continue;
            }
            let timer = timer.as_deref_mut();
            let timestamp_writes = timer.and_then(|timer| timer.compute(name, encoder));
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(name),
                timestamp_writes,
            });
            pass.set_bind_group(2, world.gpu_scene.bind_group(), &[]);
            pass.set_bind_group(3, self.rasters.bind_group(), &[]);
            for (offset, samples) in dispatches {
                for (pipeline, tracer) in &pipelines {
                    pass.set_pipeline(pipeline);
                    pass.set_bind_group(0, self.passes.rays(), &[offset]);
                    pass.set_bind_group(1, tracer.bind_group(), &[]);
                    pass.dispatch_workgroups(samples.div_ceil(64), 1, 1);
                }
            }
        }
    }

    /// Records what is made of the rays' light.
    fn record_end(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        world: &World<'_>,
        mut timer: Option<&mut Timer>,
    ) -> Result<()> {
        self.over_pixels(encoder, world, &self.passes.resolve, timer.as_deref_mut());
        self.filter(context, encoder, world)?;
        self.over_pixels(encoder, world, &self.passes.combine, timer);
        Ok(())
    }

    fn gather<'a>(
        &'a self,
        world: &World<'a>,
    ) -> Vec<(&'a wgpu::ComputePipeline, &'a dyn GpuTracer)> {
        let trace = (&self.passes.trace, world.secondary);
        match &self.passes.shade {
            None => vec![trace],
            Some(shade) => vec![trace, (shade, world.exact)],
        }
    }

    /// Hybrid stage 4.
    fn filter(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        world: &World<'_>,
    ) -> Result<()> {
        let Target {
            irradiance,
            light_irradiance,
            normals,
            depths,
            blurred,
            blurred_light,
            ..
        } = &self.target;
        if let Some(guides) = &self.guides {
            guides.record(context, encoder, normals, depths)?;
        }
        let guides = self.guides.as_ref();
        self.gaussian
            .record(context, encoder, irradiance, guides, blurred)?;
        self.over_pixels(encoder, world, &self.passes.mean, None);
        if let Some(gaussian) = &self.light_gaussian {
            gaussian.record(context, encoder, light_irradiance, guides, blurred_light)?;
            self.over_pixels(encoder, world, &self.passes.light_mean, None);
        }
        Ok(())
    }

    /// Records a pass over all pixels.
    fn over_pixels(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        world: &World<'_>,
        (name, pipeline, group): &(&'static str, wgpu::ComputePipeline, wgpu::BindGroup),
        timer: Option<&mut Timer>,
    ) {
        let timestamp_writes = timer.and_then(|timer| timer.compute(name, encoder));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(name),
            timestamp_writes,
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.set_bind_group(1, world.exact.bind_group(), &[]);
        pass.set_bind_group(2, world.gpu_scene.bind_group(), &[]);
        pass.set_bind_group(3, self.rasters.bind_group(), &[]);
        let [columns, rows] = self.size.map(|side| side.div_ceil(8));
        pass.dispatch_workgroups(columns, rows, 1);
    }

    fn set_camera(&self, context: &Context, camera: &Camera) -> Result<()> {
        let (pinhole, eye, forward) = pinhole(camera)?;
        if let Some(guides) = &self.guides {
            guides.set_camera(context, &pinhole);
        }
        let params = &self.params;
        let settings = GpuParams {
            seed: hash_seed(params.seed),
            bounced_seed: hash_seed(params.seed ^ 1),
            samples: params.samples,
            // With shadow maps no light is chosen.
            light_rays: if self.shadow_maps.is_some() {
                1
            } else {
                params.light_rays
            },
            diffuse_rays: params.diffuse_rays,
            glossy_rays: params.glossy_rays,
            texture_level: params.texture_level,
            blurs_light: u32::from(self.light_gaussian.is_some()),
            eye: eye.to_array(),
            pbr: u32::from(params.materials == Materials::Pbr),
            forward: forward.to_array(),
            ..GpuParams::zeroed()
        };
        context.check("hybrid", |_| {
            let bytes = bytemuck::bytes_of(&settings);
            context.queue().write_buffer(&self.settings, 0, bytes);
        })?;
        Ok(())
    }
}

/// Shadow maps are of lights without geometry.
fn check_lights(scene: &Scene) -> Result<()> {
    let emits = scene.materials.iter().any(Material::is_emissive);
    if !emits && scene.environment.is_black() {
        return Ok(());
    }
    Err(Error::Parameter {
        name: "the scene's light",
        value: if emits {
            "emissive triangles"
        } else {
            "an environment"
        }
        .into(),
        expected: "shadow maps only know lights without geometry: use shadow rays",
    })
}
