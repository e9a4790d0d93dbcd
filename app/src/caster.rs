//! A tracer that answers many rays at once, wherever it runs.

use anyhow::Result;
#[cfg(not(feature = "gpu"))]
use anyhow::bail;
use isophote_scene::{Hit, Ray, Tracer};
use rayon::prelude::*;

#[cfg(feature = "gpu")]
use crate::gpu_rays::GpuRays;
use crate::{
    maps::MapsInfo,
    output::{device, timed},
    tracers::{BuiltTracer, Choice, Plan},
};

/// A tracer that is ready.
pub(crate) enum Caster {
    Cpu(BuiltTracer),
    #[cfg(feature = "gpu")]
    Gpu(Box<GpuRays>),
}

/// Answers, one a ray, and how long they took.
pub(crate) struct Answered<T> {
    pub(crate) hits: Vec<T>,
    /// With the way to a GPU and back.
    pub(crate) seconds: f64,
    /// By the GPU's own clock, where it has one.
    pub(crate) kernel_seconds: Option<f64>,
}

impl Caster {
    /// Builds the tracer; `adapter` is a part of a GPU's name.
    pub(crate) fn build(choice: Choice, adapter: Option<&str>, plan: &Plan<'_>) -> Result<Self> {
        let (caster, seconds) = timed(|| Self::new(choice, adapter, plan));
        let caster = caster?;
        choice.log_built(caster.bytes(), seconds);
        Ok(caster)
    }

    fn new(choice: Choice, adapter: Option<&str>, plan: &Plan<'_>) -> Result<Self> {
        match choice {
            Choice::Cpu(choice) => choice.build(plan).map(Self::Cpu),
            #[cfg(feature = "gpu")]
            Choice::Gpu(choice) => {
                let rays = GpuRays::build(choice, adapter, plan)?;
                Ok(Self::Gpu(Box::new(rays)))
            }
            #[cfg(not(feature = "gpu"))]
            Choice::Gpu(_) => {
                bail!("no GPU {adapter:?}: this program was built without its feature `gpu`")
            }
        }
    }

    /// What each ray hits first.
    pub(crate) fn closest(&mut self, rays: &[Ray]) -> Result<Answered<Option<Hit>>> {
        match self {
            Self::Cpu(built) => Ok(in_batches(rays, None, |rays, hits| {
                built.tracer.closest_hits(rays, hits);
            })),
            #[cfg(feature = "gpu")]
            Self::Gpu(gpu) => gpu.closest(rays),
        }
    }

    /// Whether each ray hits anything.
    pub(crate) fn any(&mut self, rays: &[Ray]) -> Result<Answered<bool>> {
        match self {
            Self::Cpu(built) => Ok(in_batches(rays, false, |rays, hits| {
                built.tracer.any_hits(rays, hits);
            })),
            #[cfg(feature = "gpu")]
            Self::Gpu(gpu) => gpu.any(rays),
        }
    }

    pub(crate) fn on_cpu(&self) -> Option<&dyn Tracer> {
        match self {
            Self::Cpu(built) => Some(&*built.tracer),
            #[cfg(feature = "gpu")]
            Self::Gpu(_) => None,
        }
    }

    /// Held by the tracer's own structures.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Cpu(built) => built.bytes,
            #[cfg(feature = "gpu")]
            Self::Gpu(rays) => rays.gpu.bytes,
        }
    }

    /// Its maps, where it has any on the CPU.
    pub(crate) fn maps(&self) -> Option<Box<MapsInfo>> {
        match self {
            Self::Cpu(built) => built.maps.clone(),
            #[cfg(feature = "gpu")]
            Self::Gpu(_) => None,
        }
    }

    /// What computes.
    pub(crate) fn device(&self) -> String {
        match self {
            Self::Cpu(_) => device(),
            #[cfg(feature = "gpu")]
            Self::Gpu(rays) => rays.gpu.device(),
        }
    }
}

/// Batches are as large as they can be, for tracers that sort rays, and small enough to share out.
pub(crate) fn in_batches<T: Clone + Send>(
    rays: &[Ray],
    miss: T,
    trace: impl Fn(&[Ray], &mut [T]) + Sync,
) -> Answered<T> {
    let mut hits = vec![miss; rays.len()];
    let batch = rays
        .len()
        .div_ceil(4 * rayon::current_num_threads())
        .max(8192);
    let work = || {
        rays.par_chunks(batch)
            .zip(hits.par_chunks_mut(batch))
            .for_each(|(rays, hits)| trace(rays, hits));
    };
    let ((), seconds) = timed(work);
    Answered {
        hits,
        seconds,
        kernel_seconds: None,
    }
}
