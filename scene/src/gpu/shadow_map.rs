//! Shadow maps: what the lights see.
//!
//! Each light has one layer of a depth texture, or the six sides of a cube: a spot light one that its cone fills, a
//! directional light one that the scene's bounds fill, a point light and a spot of more than 120 degrees a cube. Sides of
//! a cube reach a few texels over their edges, so that filtering needs no neighbour.
//!
//! Shaders ask `scene::shadow::read` for `shadow(light, position, normal)`, with bilinear comparison by the hardware.
//! Instead of a depth bias the position is raised along its geometric normal, by the least with which no plane can
//! shade itself; the derivation stands there. What is thinner than about 1.5 texels can be missed, as by any shadow map;
//! walls are not, however thin, because what faces away from a light is dark before any map is asked.
//!
//! Light spheres are taken as points.

use bytemuck::{Pod, Zeroable};
use glam::{Mat3, Vec2, Vec3};

use super::{
    Context, GpuScene, Timer,
    raster::{DEPTH_FORMAT, RasterPass, RasterPipelines, depth_attachment, uniform_entry},
    upload::entries,
    view::View,
};
use crate::{Aabb, Error, InstanceMask, Light, LightKind, Result};

/// `MOST_LAYERS` in the shader; WebGPU's default for array textures.
const MOST_LAYERS: u32 = 256;
/// Uniform buffers are bound at multiples of this on every device.
const STRIDE: u64 = 256;
/// How far a cube's side reaches over its edge, texels: 1.5 by which positions are raised, 1 for filtering.
const BORDER: f32 = 4.0;
/// Half of the widest cone that one map is used for, radians: wider ones waste most of it.
const WIDEST: f32 = 60.0 * std::f32::consts::PI / 180.0;

/// What shadow maps can be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShadowOptions {
    /// Texels on a side of a map; 1024 by default, at least 16.
    pub resolution: u32,
    /// Instances that do not play all of these roles cast no shadow.
    pub casters: InstanceMask,
}

impl Default for ShadowOptions {
    fn default() -> Self {
        Self {
            resolution: 1024,
            casters: InstanceMask::CASTER,
        }
    }
}

/// The uniform `shadow_info`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct ShadowInfo {
    lights: [[u32; 2]; MOST_LAYERS as usize],
    views: [View; MOST_LAYERS as usize],
}

/// Shadow maps of all lights of a scene.
#[derive(Debug)]
pub struct ShadowMaps {
    options: ShadowOptions,
    /// First layer and number of layers of every light.
    places: Vec<[u32; 2]>,
    layers: Vec<wgpu::TextureView>,
    all_layers: wgpu::TextureView,
    sampler: wgpu::Sampler,
    info: wgpu::Buffer,
    views: wgpu::Buffer,
    view: wgpu::BindGroup,
    pipelines: RasterPipelines,
}

impl ShadowMaps {
    /// Empty maps for a scene's lights.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the resolution is too small or the lights need more layers than a texture has,
    /// [`Error::GpuLimit`] when the resolution is too large, [`Error::Gpu`] when memory is out.
    pub fn new(context: &Context, lights: &[Light], options: &ShadowOptions) -> Result<Self> {
        let places = places(lights);
        let count = places.last().map_or(0, |[first, count]| first + count);
        check(context, count, options.resolution)?;
        let info = context.buffer::<ShadowInfo>("shadow info", &[], wgpu::BufferUsages::UNIFORM)?;
        let texture = context.check("shadow maps", |device| texture(device, count, options))?;
        let layer = |layer| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                label: Some("shadow map"),
                dimension: Some(wgpu::TextureViewDimension::D2),
                base_array_layer: layer,
                array_layer_count: Some(1),
                ..Default::default()
            })
        };
        let all_layers = texture.create_view(&wgpu::TextureViewDescriptor {
            label: Some("shadow maps"),
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        let sampler = context.device().create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow comparison"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::GreaterEqual),
            ..Default::default()
        });
        let blank = vec![0_u8; (STRIDE * u64::from(count.max(1))) as usize];
        let views = context.buffer("shadow views", &blank, wgpu::BufferUsages::UNIFORM)?;
        let (layout, view) = context.check("shadow maps", |device| {
            let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("shadow map"),
                entries: &[uniform_entry(0, true)],
            });
            let binding = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &views,
                offset: 0,
                size: wgpu::BufferSize::new(size_of::<View>() as u64),
            });
            let view = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("shadow map"),
                layout: &layout,
                entries: &entries([binding]),
            });
            (layout, view)
        })?;
        let pass = RasterPass {
            module: "scene::shadow::raster",
            fragment: "holes",
            opaque_fragments: false,
            targets: Vec::new(),
            samples: 1,
        };
        Ok(Self {
            options: *options,
            layers: (0..count).map(layer).collect(),
            all_layers,
            places,
            sampler,
            info,
            views,
            view,
            pipelines: RasterPipelines::new(context, layout, pass)?,
        })
    }

    /// Records the filling of all maps, `lights` being those the maps were made for, where they are now. The lights are
    /// passed by the queue, so that maps can be filled once per submission.
    ///
    /// # Errors
    /// [`Error::Parameter`] when the lights need other maps, [`Error::Gpu`] when recording fails.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        lights: &[Light],
        mut timer: Option<&mut Timer>,
    ) -> Result<()> {
        if places(lights) != self.places {
            return Err(Error::Parameter {
                name: "the lights",
                value: format!("{} others", lights.len()),
                expected: "they must be as many and of the same kinds as those the shadow maps were made for",
            });
        }
        let views: Vec<View> = lights
            .iter()
            .flat_map(|light| self.views_of(light, &scene.bounds()))
            .collect();
        self.upload(context, &views)?;
        let draws = scene.draws(self.options.casters);
        let pipelines = self.pipelines.of(context, scene)?;
        context.check("shadow maps", |_| {
            for (offset, layer) in (0..).step_by(STRIDE as usize).zip(&self.layers) {
                let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("shadow map"),
                    depth_stencil_attachment: Some(depth_attachment(layer, wgpu::StoreOp::Store)),
                    timestamp_writes: timer
                        .as_deref_mut()
                        .and_then(|timer| timer.render("shadow map")),
                    ..Default::default()
                });
                pass.set_bind_group(0, &self.view, &[offset]);
                pipelines.draw(&mut pass, scene, &draws);
            }
        })
    }

    fn upload(&self, context: &Context, views: &[View]) -> Result<()> {
        let mut info = ShadowInfo::zeroed();
        info.lights[..self.places.len()].copy_from_slice(&self.places);
        info.views[..views.len()].copy_from_slice(views);
        let mut strided = vec![0_u8; (STRIDE as usize * views.len()).max(1)];
        for (place, view) in strided.chunks_mut(STRIDE as usize).zip(views) {
            place[..size_of::<View>()].copy_from_slice(bytemuck::bytes_of(view));
        }
        context.check("shadow maps", |_| {
            let queue = context.queue();
            queue.write_buffer(&self.info, 0, bytemuck::bytes_of(&info));
            if !views.is_empty() {
                queue.write_buffer(&self.views, 0, &strided);
            }
        })
    }

    /// One view, or six.
    fn views_of(&self, light: &Light, scene: &Aabb) -> Vec<View> {
        let resolution = self.options.resolution as f32;
        let size = Vec2::splat(resolution);
        // The middle of a texel more than what is needed, on both sides.
        let over = 1.0 / (1.0 - 2.0 * BORDER / resolution);
        let forward = light.direction();
        let (right, up) = forward.any_orthonormal_pair();
        let axes = Mat3::from_cols(right, up, forward);
        match light.kind {
            LightKind::Directional => {
                let center = scene.center();
                let offsets = scene
                    .corners()
                    .map(|corner| axes.transpose() * (corner - center));
                let half = offsets
                    .into_iter()
                    .fold(Vec3::ZERO, |most, offset| most.max(offset.abs()));
                let half = (over * half).max(Vec3::splat(f32::MIN_POSITIVE));
                let origin = center - half.z * forward;
                vec![View::new(axes, origin, half.truncate(), size, false, scene)]
            }
            LightKind::Spot { outer, .. } if outer <= WIDEST => {
                let half = Vec2::splat(over * outer.tan());
                vec![View::new(axes, light.position(), half, size, true, scene)]
            }
            _ => (0..6)
                .map(|side| {
                    let axis = side / 2;
                    let sign = if side % 2 == 0 { 1.0 } else { -1.0 };
                    let unit = |axis: usize| Vec3::AXES[axis % 3];
                    let axes = Mat3::from_cols(unit(axis + 1), unit(axis + 2), sign * unit(axis));
                    View::new(axes, light.position(), Vec2::splat(over), size, true, scene)
                })
                .collect(),
        }
    }

    /// Bindings 6 to 8 of group 3.
    pub(super) fn layout_entries() -> [wgpu::BindGroupLayoutEntry; 3] {
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::all(),
            ty,
            count: None,
        };
        let layers = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Depth,
            view_dimension: wgpu::TextureViewDimension::D2Array,
            multisampled: false,
        };
        let comparison = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison);
        [
            uniform_entry(6, false),
            entry(7, layers),
            entry(8, comparison),
        ]
    }

    /// What [`layout_entries`](Self::layout_entries) describe.
    pub(super) fn bind_entries(&self) -> [wgpu::BindGroupEntry<'_>; 3] {
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        [
            entry(6, self.info.as_entire_binding()),
            entry(7, wgpu::BindingResource::TextureView(&self.all_layers)),
            entry(8, wgpu::BindingResource::Sampler(&self.sampler)),
        ]
    }
}

/// First layer and number of layers of every light.
fn places(lights: &[Light]) -> Vec<[u32; 2]> {
    let mut first = 0;
    let place = |light: &Light| {
        let count = match light.kind {
            LightKind::Directional => 1,
            LightKind::Spot { outer, .. } if outer <= WIDEST => 1,
            _ => 6,
        };
        first += count;
        [first - count, count]
    };
    lights.iter().map(place).collect()
}

fn texture(device: &wgpu::Device, layers: u32, options: &ShadowOptions) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("shadow maps"),
        size: wgpu::Extent3d {
            width: options.resolution,
            height: options.resolution,
            depth_or_array_layers: layers.max(1),
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: DEPTH_FORMAT,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    })
}

fn check(context: &Context, layers: u32, resolution: u32) -> Result<()> {
    let limits = context.device().limits();
    if layers > limits.max_texture_array_layers.min(MOST_LAYERS) {
        return Err(Error::Parameter {
            name: "the number of shadow maps",
            value: layers.to_string(),
            expected: "256 fit, or what the device's array textures hold; a point light takes 6, others 1",
        });
    }
    if resolution < 16 {
        return Err(Error::Parameter {
            name: "the resolution of the shadow maps",
            value: resolution.to_string(),
            expected: "it must be at least 16",
        });
    }
    let bytes = |side: u32| 4 * u64::from(side) * u64::from(side) * u64::from(layers.max(1));
    if resolution > limits.max_texture_dimension_2d {
        return Err(Error::GpuLimit {
            what: format!("shadow maps of {resolution}x{resolution} texels"),
            needs: bytes(resolution),
            limit: bytes(limits.max_texture_dimension_2d),
            adapter: context.device().adapter_info().name,
        });
    }
    Ok(())
}
