//! The technique `reference`: the integrators that define the right answer.

use anyhow::Result;
use isophote_scene::{
    Scene,
    reference::{Progress, Quantity},
};

use super::Technique;
use crate::{
    applies::Idle,
    reference::{Ground, Made, Order},
};

/// Has no flags of its own.
pub(super) struct Reference;

impl Technique for Reference {
    fn idle(&self, _: &[Quantity]) -> Vec<Idle> {
        Vec::new()
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
