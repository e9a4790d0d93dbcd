//! The technique `field`: occlusion and shadows by displacement fields alone, as their paper has them. It is the reference's
//! integrator over the tracer `field`, under the name it is looked for by.

use anyhow::Result;
use isophote_scene::{
    Scene,
    reference::{Progress, Quantity},
};

use super::Technique;
use crate::{
    applies::Idle,
    reference::{Ground, Made, Order},
    tracers::{AnyTracer, Choice},
};

/// Has no flags of its own: those of the tracer are its.
pub(super) struct Field;

impl Technique for Field {
    fn quantities(&self) -> &'static [Quantity] {
        &[
            Quantity::Ao,
            Quantity::Obscurance,
            Quantity::Direct,
            Quantity::IrradianceDirect,
        ]
    }

    fn idle(&self, _: &[Quantity]) -> Vec<Idle> {
        Vec::new()
    }

    fn tracer(&self) -> Option<AnyTracer> {
        Some(AnyTracer::Field)
    }

    fn refuses(&self, tracer: Choice, _: Quantity) -> Option<&'static str> {
        let is_other = tracer.name() != AnyTracer::Field.name();
        is_other.then_some(
            "it is the tracer field; leave out --tracer, or choose the technique reference",
        )
    }

    fn render(
        &self,
        scene: &Scene,
        ground: &Ground,
        order: Order<'_>,
        progress: &dyn Progress,
    ) -> Result<Made> {
        ground.render(scene, order, progress)
    }
}
