//! The tracers that can be chosen on the command line.

use std::sync::Arc;

use anyhow::Result;
use clap::ValueEnum;
use isophote_scene::{BruteForceTracer, BuildTracer, BvhTracer, Scene, Selection, Tracer};

/// Who answers rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TracerChoice {
    /// Exact, by a bounding volume hierarchy
    Bvh,
    /// Exact, by testing every triangle: slow, for checking
    BruteForce,
}

/// A tracer, and the bytes its own structures hold.
pub(crate) struct BuiltTracer {
    pub(crate) tracer: Box<dyn Tracer>,
    pub(crate) bytes: usize,
}

impl TracerChoice {
    /// Builds the tracer with its default options.
    pub(crate) fn build(self, scene: &Arc<Scene>, selection: &Selection) -> Result<BuiltTracer> {
        match self {
            Self::Bvh => build::<BvhTracer>(scene, selection),
            Self::BruteForce => build::<BruteForceTracer>(scene, selection),
        }
    }
}

fn build<T: BuildTracer + 'static>(
    scene: &Arc<Scene>,
    selection: &Selection,
) -> Result<BuiltTracer> {
    let tracer = T::build(scene, selection, &T::Options::default())?;
    Ok(BuiltTracer {
        bytes: tracer.bytes(),
        tracer: Box::new(tracer),
    })
}
