#![doc = include_str!("../README.md")]

mod a_trous;
mod camera;
mod discontinuity;
mod error;
mod gaussian;
#[cfg(feature = "gpu")]
pub mod gpu;
mod guides;
mod image;
mod joint_bilateral;
mod lanes;
mod single_pass;
mod stencil;
mod temporal;
mod upsample;

pub use self::{
    a_trous::ATrous,
    camera::Pinhole,
    discontinuity::{DiscontinuityBuffer, Thresholds},
    error::{Error, Result},
    gaussian::Gaussian,
    guides::{EdgeStop, Guides, NormalWeight},
    image::{ImageView, MAX_SIDE},
    joint_bilateral::{JointBilateral, Neighborhood},
    single_pass::SinglePass,
    temporal::{History, Temporal, TemporalParams, camera_motion},
    upsample::SampleGrid,
};
