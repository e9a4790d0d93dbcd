//! The exact tracer.

use std::sync::Arc;

use glam::Affine3A;

use super::{Answers, BruteForceTracer, BuildTracer, Hit, Ray, Selection, Tracer};
use crate::{Result, Scene};

/// Options.
#[derive(Clone, Debug, Default)]
pub struct BvhOptions {}

/// Exact.
#[derive(Clone, Debug)]
pub struct BvhTracer(BruteForceTracer);

impl Tracer for BvhTracer {
    fn answers(&self) -> Answers {
        Answers::Surface
    }
    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.0.closest_hit(ray)
    }
}

impl BuildTracer for BvhTracer {
    type Options = BvhOptions;
    fn build(scene: &Arc<Scene>, selection: &Selection, _: &BvhOptions) -> Result<Self> {
        BruteForceTracer::build(scene, selection, &()).map(Self)
    }
    fn update(&mut self, transforms: &[Affine3A]) -> Result<()> {
        self.0.update(transforms)
    }
    fn bytes(&self) -> usize {
        self.0.bytes()
    }
}
