//! The filters as compute passes on wgpu textures of any renderer: twins of those for slices, of the same names.
//!
//! 1. [`Guides`] prepares normals and depths, once per picture.
//! 2. A filter is made of its twin, so that its parameters have been checked, for pictures of one size.
//! 3. `record` adds its passes to the caller's [`CommandEncoder`](wgpu::CommandEncoder); nothing is submitted or read
//!    back.
//!
//! ```no_run
//! use isophote_filters::{EdgeStop, JointBilateral, Neighborhood, Pinhole, Result, gpu};
//! use isophote_scene::gpu::Context;
//! use wgpu::TextureView;
//!
//! /// Light at every fourth pixel of a picture of 1920×1080, upsampled.
//! fn upsample(context: &Context, samples: &TextureView, normals: &TextureView, depths: &TextureView) -> Result<wgpu::Texture> {
//!     let size = [1920, 1080];
//!     let filter = JointBilateral::new(4, Neighborhood::default(), EdgeStop::default())?;
//!     let twin = gpu::JointBilateral::new(context, &filter, gpu::Format::Half)?;
//!     let guides = gpu::Guides::new(context, size, &Pinhole::at_origin(1.0)?)?;
//!     let light = gpu::texture(context, "light", size, gpu::Format::Half.texture())?;
//!     let mut encoder = context.device().create_command_encoder(&Default::default());
//!     guides.record(context, &mut encoder, normals, depths)?;
//!     twin.record(context, &mut encoder, samples, &guides, &light.create_view(&Default::default()))?;
//!     context.submit("upsampling", encoder)?;
//!     Ok(light)
//! }
//! ```
//!
//! Inputs may be of any format that `textureLoad` reads as floats (`Rgba16Float`, `Rgba32Float`, `R32Float`, …) and
//! need the usage `TEXTURE_BINDING`. Outputs are of one of two formats, see [`Format`], and need `STORAGE_BINDING`;
//! [`texture`] makes one. Pictures have four channels here. The devices need nothing beyond WebGPU's defaults.
//!
//! Results agree with those of the twins within 10⁻⁴ of the values' range, in `Rgba32Float`.
//!
//! Formulas and arithmetic are the twins'. What costs time here are the texels that are read; per pixel:
//!
//! | pass | texels read |
//! |---|---|
//! | [`Guides`], [`CameraMotion`] | 2; 1 |
//! | [`Gaussian`] of width n | 2n; guided 4n + 4 |
//! | [`JointBilateral`] of radius r | 12r² + 2; where nothing near is alike 12 · reach² + 4r² + 2 |
//! | [`SinglePass`] over m×n tiles | m·n times as many |
//! | [`DiscontinuityBuffer`] over m×n tiles | 2mn + 2 |
//! | [`ATrous`] | 53 a level |
//! | [`Temporal`] | 20, with a clamp 30 |

mod a_trous;
mod discontinuity;
mod gaussian;
mod guides;
mod pass;
mod temporal;
mod upsample;

use isophote_scene::{gpu::ShaderPackage, shader_package};

pub use self::{
    a_trous::ATrous,
    discontinuity::DiscontinuityBuffer,
    gaussian::Gaussian,
    guides::Guides,
    pass::{Format, texture},
    temporal::{CameraMotion, Temporal},
    upsample::{JointBilateral, SinglePass},
};

/// The WESL modules of this crate.
pub const SHADERS: ShaderPackage = shader_package!(
    "filters",
    [
        "a_trous",
        "camera_motion",
        "discontinuity",
        "edges",
        "gaussian",
        "guides",
        "output",
        "prepare_guides",
        "temporal",
        "upsample",
    ]
);
