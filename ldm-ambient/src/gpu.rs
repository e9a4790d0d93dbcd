//! Occlusion and light on a GPU, stage by stage as [`crate::cpu`]:
//!
//! | stage | CPU | GPU |
//! |---|---|---|
//! | 1. triangles | `cpu/triangles.rs` | `gpu/triangles.rs`, `shaders/place.wesl` |
//! | 2. views | `cpu/view.rs` | the same |
//! | 3. which pixels, how deep | `cpu/raster.rs` | `shaders/{cull,draw}.wesl`, by the device's rasteriser |
//! | 4. maps | `cpu/{maps,reach}.rs` | `gpu/{maps,reach}.rs`, `shaders/{scan,sort,reach}.wesl` |
//! | points | `cpu/points.rs` | `gpu/points.rs`, `shaders/points/*.wesl` |
//! | 5., 6. tracing, occlusion | `cpu/{aim,occlusion}.rs` | `gpu/occlusion.rs`, `shaders/{aim,look_up,layers,resolve}.wesl` |
//! | HBAO | `cpu/hbao.rs` | `gpu/hbao.rs`, `shaders/hbao/*.wesl` |
//! | 9. light that points gather | `cpu/photons/{gather,field}.rs` | `gpu/gather.rs`, `shaders/gather/*.wesl` |
//! | 7. to 9. photons that are splatted | `cpu/photons.rs` | `gpu/photons.rs`, `shaders/photons/*.wesl` |
//!
//! Maps are built anew for each picture, from where the scene's data on the device say that instances are: several at a
//! time, asked for all points, and overwritten by the next ones, so that memory does not grow with their number. Nothing is
//! read back in between, and all of it can be recorded into a renderer's own commands.
//!
//! A shader here binds at most 8 storage buffers, those of the scene and the tracer among them.

pub mod gather;
pub mod hbao;
mod maps;
mod occlusion;
pub mod photons;
mod points;
mod reach;
mod triangles;

use glam::Vec3;
use isophote_scene::{
    Aabb,
    gpu::{Context, Linker, ShaderPackage},
    shader_package,
};
use wgpu::{TextureFormat, TextureUsages};

pub use self::{
    maps::BuildMethod,
    occlusion::{Occlusion, Targets},
    points::{CameraPoints, GBufferPoints, Look, Points},
};
use crate::{Result, cpu::view::View};

/// The WESL modules of this crate.
pub const SHADERS: ShaderPackage = shader_package!(
    "ldm_ambient",
    [
        "aim",
        "batch",
        "cull",
        "draw",
        "gather/field",
        "gather/landed",
        "gather/lights",
        "gather/look",
        "gather/mirror",
        "gather/reflect",
        "gather/reflected",
        "gather/resolve",
        "gather/rooms",
        "gather/shade",
        "gather/surface",
        "hbao/depths",
        "hbao/eye",
        "hbao/march",
        "layers",
        "look_up",
        "near",
        "order",
        "photons/bin",
        "photons/bounce",
        "photons/emission",
        "photons/footprint",
        "photons/photon",
        "photons/quads",
        "photons/resolve",
        "photons/splat",
        "photons/splats",
        "photons/split",
        "photons/weigh",
        "place",
        "project",
        "points/camera",
        "points/gbuffer",
        "points/store",
        "reach",
        "resolve",
        "room",
        "scan",
        "sort",
    ]
);

/// What is bound in the place of groups that a pass has not.
#[derive(Debug)]
struct Filler {
    layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
}

/// The views along directions around boxes, which are relative to an origin, no larger than the device can draw.
fn fit(
    context: &Context,
    directions: &[Vec3],
    (origin, boxes): (Vec3, &[Aabb]),
    longest: Vec3,
    resolution: u32,
) -> Vec<View> {
    let side = context.device().limits().max_texture_dimension_2d as usize;
    let view = |&direction: &Vec3| {
        let mut resolution = resolution;
        loop {
            let view = View::fit(direction, origin, boxes, longest, resolution);
            // What is nearly a line has coarser pixels, so that the device can draw it.
            if view.columns.max(view.rows) <= side || resolution == 1 {
                return view;
            }
            resolution = resolution.div_ceil(2);
        }
    };
    directions.iter().map(view).collect()
}

/// A texture that a shader fills with four numbers a pixel.
fn target(context: &Context, label: &str, [width, height]: [u32; 2]) -> Result<wgpu::Texture> {
    let texture = context.check(label, |device| {
        device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: TextureFormat::Rgba32Float,
            usage: TextureUsages::STORAGE_BINDING
                | TextureUsages::TEXTURE_BINDING
                | TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    })?;
    Ok(texture)
}

fn finish(context: &Context, encoder: wgpu::CommandEncoder) -> Result<()> {
    context.submit("occlusion", encoder)?;
    Ok(context.wait("occlusion")?)
}

impl Filler {
    fn new(context: &Context) -> Result<Self> {
        Ok(context.check("nothing", |device| {
            let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("nothing"),
                entries: &[],
            });
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("nothing"),
                layout: &layout,
                entries: &[],
            });
            Self { layout, group }
        })?)
    }
}

/// A linker of this crate's modules.
fn linker() -> Linker {
    Linker::default().package(SHADERS)
}

/// So many workgroups in two dimensions, of which each holds at most 65,535.
fn grid(groups: u64) -> [u32; 3] {
    const MOST: u64 = 65_535;
    let columns = groups.clamp(1, MOST);
    [columns as u32, groups.div_ceil(columns).max(1) as u32, 1]
}

fn broken(reason: &str) -> crate::Error {
    isophote_scene::Error::Gpu {
        what: "occlusion by layered depth maps".into(),
        reason: reason.into(),
    }
    .into()
}
