//! The G-buffer: what a camera sees, layer by layer.
//!
//! 1. A [`GBuffer`] is the layers, of 1 or 4 samples per pixel: textures of its own, or those of another renderer.
//! 2. A [`GBufferPass`] fills it by rasterisation, in one render pass.
//! 3. Shaders read it with `scene::gbuffer::read`, bound by [`Rasters`](super::Rasters) as group 3.
//!
//! | layer | format | holds |
//! |---|---|---|
//! | depth | `R32Float` | metres along the viewing direction; 0 where nothing is seen |
//! | normal | `Rgba16Float` | unit shading normal, turned to the viewer |
//! | albedo | `Rgba16Float` | linear base colour |
//! | material | `Rg16Uint` | index of the material; where in the pixel it was looked, 8 bits an axis |
//! | ids | `Rgba16Uint` | instance + 1 and primitive + 1, each in two halves, the lower first; 0 where unknown |
//!
//! A position is depth along the pixel's ray. These formats can be multi-sampled on every device, and together stay
//! within the 32 bytes a sample that WebGPU promises.
//!
//! With 4 samples, all layers are multi-sampled, and the fragment shader still runs once for every triangle and pixel
//! (Nießner et al. 2010, §4): its samples tell how much of the pixel the triangle takes. It looks at the
//! triangle's point nearest to the pixel's centre; `samples_alike` of `scene::gbuffer::read` lets a
//! technique shade each such triangle once, too.

use super::{
    Context, GpuScene, Timer,
    raster::{DEPTH_FORMAT, RasterPass, RasterPipelines, depth_attachment, uniform_entry},
    upload::entries,
    view::View,
};
use crate::{Aabb, Camera, Error, InstanceMask, Result};

/// Depth, normal, albedo, material, ids.
const FORMATS: [wgpu::TextureFormat; 5] = [
    wgpu::TextureFormat::R32Float,
    wgpu::TextureFormat::Rgba16Float,
    wgpu::TextureFormat::Rgba16Float,
    wgpu::TextureFormat::Rg16Uint,
    wgpu::TextureFormat::Rgba16Uint,
];
/// Materials are counted in 16 bits.
const MOST_MATERIALS: usize = 1 << 16;

/// The layers, as listed below; each a texture of the same size and number of samples.
#[derive(Clone, Debug)]
pub struct GBufferViews {
    /// Metres along the viewing direction; any format that is read as floating-point numbers.
    pub depth: wgpu::TextureView,
    /// Unit, towards the viewer; any format that is read as floating-point numbers.
    pub normal: wgpu::TextureView,
    /// Linear; any format that is read as floating-point numbers.
    pub albedo: wgpu::TextureView,
    /// `Rg16Uint`. Where there are several samples, the second channel is 0x8080 for the pixel's centre.
    pub material: wgpu::TextureView,
    /// `Rgba16Uint`.
    pub ids: wgpu::TextureView,
}

impl GBufferViews {
    fn all(&self) -> [&wgpu::TextureView; 5] {
        [
            &self.depth,
            &self.normal,
            &self.albedo,
            &self.material,
            &self.ids,
        ]
    }
}

/// What a camera sees, in textures.
#[derive(Debug)]
pub struct GBuffer {
    size: [u32; 2],
    samples: u32,
    views: GBufferViews,
    /// For the depth test; the layers of another renderer have had theirs.
    depth_test: Option<wgpu::TextureView>,
    camera: wgpu::Buffer,
}

impl GBuffer {
    /// Textures of a size in pixels with 1 or 4 samples per pixel.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a size of zero or another number of samples, [`Error::GpuLimit`] when the size is more than
    /// the device's textures can have, [`Error::Gpu`] when memory is out.
    pub fn new(context: &Context, size: [u32; 2], samples: u32) -> Result<Self> {
        check(context, size, samples)?;
        let texture = |device: &wgpu::Device, format, usage| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some("G-buffer"),
                size: extent(size),
                mip_level_count: 1,
                sample_count: samples,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        // Textures with several samples cannot be copied from.
        let usage = match samples {
            1 => wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC,
            _ => wgpu::TextureUsages::TEXTURE_BINDING,
        };
        let (views, depth_test) = context.check("G-buffer", |device| {
            let [depth, normal, albedo, material, ids] =
                FORMATS.map(|format| texture(device, format, usage));
            let views = GBufferViews {
                depth,
                normal,
                albedo,
                material,
                ids,
            };
            let none = wgpu::TextureUsages::empty();
            (views, texture(device, DEPTH_FORMAT, none))
        })?;
        Self::with(context, size, samples, views, Some(depth_test))
    }

    /// Textures that another renderer fills, seen by `camera`. [`GBufferPass`] does not draw into them.
    ///
    /// Layers that nobody asks for may be textures of one pixel, but depth gives the size.
    ///
    /// # Errors
    /// [`Error::Parameter`] when a format, a size or a number of samples is not as [`GBufferViews`] says.
    pub fn from_views(context: &Context, views: GBufferViews, camera: &Camera) -> Result<Self> {
        let depth = views.depth.texture();
        let (size, samples) = ([depth.width(), depth.height()], depth.sample_count());
        check(context, size, samples)?;
        for (view, own) in views.all().into_iter().zip(FORMATS) {
            let texture = view.texture();
            let kind = |format: wgpu::TextureFormat| format.sample_type(None, None);
            let floats = |kind| matches!(kind, Some(wgpu::TextureSampleType::Float { .. }));
            let fits = match kind(own) {
                Some(wgpu::TextureSampleType::Uint) => texture.format() == own,
                _ => floats(kind(texture.format())),
            };
            let one = texture.width() == 1 && texture.height() == 1;
            let sized = [texture.width(), texture.height()] == size || one;
            if !(fits && sized && texture.sample_count() == samples) {
                return Err(Error::Parameter {
                    name: "a layer of the G-buffer",
                    value: format!(
                        "{:?}, {}x{}, {} samples",
                        texture.format(),
                        texture.width(),
                        texture.height(),
                        texture.sample_count()
                    ),
                    expected: "it must have the format that GBufferViews says, and size and samples of the depth",
                });
            }
        }
        let gbuffer = Self::with(context, size, samples, views, None)?;
        // Without a scene only the clip depth is unknown, which no reader asks for.
        let view = View::of_camera(camera, size, &Aabb::EMPTY);
        gbuffer.set_view(context, &view)?;
        Ok(gbuffer)
    }

    fn with(
        context: &Context,
        size: [u32; 2],
        samples: u32,
        views: GBufferViews,
        depth_test: Option<wgpu::TextureView>,
    ) -> Result<Self> {
        let camera = context.buffer::<View>("G-buffer camera", &[], wgpu::BufferUsages::UNIFORM)?;
        Ok(Self {
            size,
            samples,
            views,
            depth_test,
            camera,
        })
    }

    fn set_view(&self, context: &Context, view: &View) -> Result<()> {
        context.check("G-buffer camera", |_| {
            context
                .queue()
                .write_buffer(&self.camera, 0, bytemuck::bytes_of(view));
        })
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Samples per pixel: 1 or 4.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// The layers.
    pub fn views(&self) -> &GBufferViews {
        &self.views
    }

    /// Bindings 0 to 5 of group 3.
    pub(super) fn layout_entries(&self) -> Vec<wgpu::BindGroupLayoutEntry> {
        let texture = |(binding, format): (u32, wgpu::TextureFormat)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::all(),
            ty: wgpu::BindingType::Texture {
                sample_type: match format.sample_type(None, None) {
                    Some(wgpu::TextureSampleType::Uint) => wgpu::TextureSampleType::Uint,
                    _ => wgpu::TextureSampleType::Float { filterable: false },
                },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: self.samples > 1,
            },
            count: None,
        };
        std::iter::once(uniform_entry(0, false))
            .chain((1..).zip(FORMATS).map(texture))
            .collect()
    }

    /// What [`layout_entries`](Self::layout_entries) describe.
    pub(super) fn bind_entries(&self) -> Vec<wgpu::BindGroupEntry<'_>> {
        let [depth, normal, albedo, material, ids] =
            self.views.all().map(wgpu::BindingResource::TextureView);
        let camera = self.camera.as_entire_binding();
        entries([camera, depth, normal, albedo, material, ids]).into()
    }
}

/// Fills G-buffers.
#[derive(Debug)]
pub struct GBufferPass {
    samples: u32,
    layout: wgpu::BindGroupLayout,
    pipelines: RasterPipelines,
}

impl GBufferPass {
    /// A pass for G-buffers of 1 or 4 samples per pixel.
    ///
    /// # Errors
    /// [`Error::Parameter`] for another number of samples, [`Error::Gpu`] when the device lacks something.
    pub fn new(context: &Context, samples: u32) -> Result<Self> {
        check(context, [1, 1], samples)?;
        let layout = context.check("G-buffer", |device| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("G-buffer pass"),
                entries: &[uniform_entry(0, false)],
            })
        })?;
        let pass = RasterPass {
            module: "scene::gbuffer::raster",
            fragment: "layers",
            opaque_fragments: true,
            targets: FORMATS.map(|format| Some(format.into())).into(),
            samples,
        };
        let pipelines = RasterPipelines::new(context, layout.clone(), pass)?;
        Ok(Self {
            samples,
            layout,
            pipelines,
        })
    }

    /// Records the filling of a G-buffer with what a camera sees of all instances.
    ///
    /// The camera is passed by the queue, so that one G-buffer can be filled once per submission.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the G-buffer has another number of samples, is another renderer's,
    /// or the scene has more than 65,536 materials, [`Error::Gpu`] when recording fails.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        camera: &Camera,
        gbuffer: &GBuffer,
        timer: Option<&mut Timer>,
    ) -> Result<()> {
        let wrong = |value: String| Error::Parameter {
            name: "the G-buffer",
            value,
            expected: "it must be made by GBuffer::new with the pass's number of samples",
        };
        if gbuffer.samples != self.samples {
            return Err(wrong(format!("one of {} samples", gbuffer.samples)));
        }
        let depth_test = gbuffer.depth_test.as_ref();
        let depth_test = depth_test.ok_or_else(|| wrong("another renderer's".into()))?;
        if scene.material_count() > MOST_MATERIALS {
            return Err(Error::Parameter {
                name: "the number of materials",
                value: scene.material_count().to_string(),
                expected: "a G-buffer tells at most 65,536 apart",
            });
        }
        gbuffer.set_view(
            context,
            &View::of_camera(camera, gbuffer.size, &scene.bounds()),
        )?;
        let pipelines = self.pipelines.of(context, scene)?;
        context.check("G-buffer", |device| {
            let camera = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("G-buffer camera"),
                layout: &self.layout,
                entries: &entries([gbuffer.camera.as_entire_binding()]),
            });
            let attachments = gbuffer.views.all().map(|view| {
                Some(wgpu::RenderPassColorAttachment {
                    view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })
            });
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("G-buffer"),
                color_attachments: &attachments,
                depth_stencil_attachment: Some(depth_attachment(
                    depth_test,
                    wgpu::StoreOp::Discard,
                )),
                timestamp_writes: timer.and_then(|timer| timer.render("G-buffer")),
                ..Default::default()
            });
            pass.set_bind_group(0, &camera, &[]);
            pipelines.draw(&mut pass, scene, &scene.draws(InstanceMask::NONE));
        })
    }
}

fn extent([width, height]: [u32; 2]) -> wgpu::Extent3d {
    wgpu::Extent3d {
        width,
        height,
        depth_or_array_layers: 1,
    }
}

fn check(context: &Context, size: [u32; 2], samples: u32) -> Result<()> {
    let [width, height] = size;
    if width == 0 || height == 0 {
        return Err(Error::Parameter {
            name: "the size of the G-buffer",
            value: format!("{width}x{height}"),
            expected: "there must be at least one pixel",
        });
    }
    if samples != 1 && samples != 4 {
        return Err(Error::Parameter {
            name: "the number of samples per pixel",
            value: samples.to_string(),
            expected: "it must be 1 or 4",
        });
    }
    let side = u64::from(context.device().limits().max_texture_dimension_2d);
    // 36 bytes a sample: the layers and the depth test.
    let bytes = |width: u64, height: u64| 36 * u64::from(samples) * width * height;
    if u64::from(width.max(height)) > side {
        return Err(Error::GpuLimit {
            what: format!("a G-buffer of {width}x{height} pixels"),
            needs: bytes(width.into(), height.into()),
            limit: bytes(side, side),
            adapter: context.device().adapter_info().name,
        });
    }
    Ok(())
}
