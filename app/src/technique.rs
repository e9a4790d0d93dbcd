//! The techniques that can be chosen on the command line: each says what it knows, and makes pictures.

mod field;
mod igi;
mod ldi;
mod ldm;
mod reference;

use std::collections::BTreeMap;

use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use glam::Vec3;
use isophote_scene::{
    Answers, Pass, Scene,
    reference::{Estimate, Layers, Progress, Quantity, Render},
};

use crate::{
    applies::{Idle, ids},
    reference::{Ground, Made, Order},
    tracers::{AnyTracer, Choice},
};

/// How light is calculated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TechniqueChoice {
    /// Path tracing: the right answer, given enough samples
    Reference,
    /// Layered depth images: direct light and one bounce of few diffuse and glossy rays a pixel, filtered; by the tracer
    /// ldi unless another is given
    Ldi,
    /// Instant global illumination: the light that bounced as that of virtual point lights, one shadow ray each
    Igi,
    /// Layered depth maps along fixed directions: ambient occlusion, obscurance, and light by photons that bounce as often as
    /// --ldm-bounces says
    Ldm,
    /// Displacement fields around objects: ambient occlusion, obscurance and shadows; the reference's rays, by the tracer field
    Field,
}

/// What can be chosen of the techniques.
#[derive(Args, Clone, Debug)]
pub(crate) struct TechniqueArgs {
    #[command(flatten)]
    ldi: ldi::LdiTechnique,
    #[command(flatten)]
    igi: igi::IgiTechnique,
    #[command(flatten)]
    ldm: ldm::LdmTechnique,
}

/// A way to make pictures.
pub(crate) trait Technique {
    /// The quantities it knows; all where there are none.
    fn quantities(&self) -> &'static [Quantity] {
        &[]
    }

    /// Flags that it does not know or that change nothing of these quantities, and why.
    fn idle(&self, quantities: &[Quantity]) -> Vec<Idle>;

    /// Its tracer unless another is given.
    fn tracer(&self) -> Option<AnyTracer> {
        None
    }

    /// Whether a tracer is only asked what the camera sees.
    fn has_own_tracer(&self) -> bool {
        false
    }

    /// The least a tracer of its secondary rays must answer.
    fn needs(&self, quantity: Quantity) -> Answers {
        quantity.needs()
    }

    /// Why it cannot use a tracer for a quantity although that answers enough.
    fn refuses(&self, tracer: Choice, quantity: Quantity) -> Option<&'static str> {
        let _ = (tracer, quantity);
        None
    }

    /// How many surfaces its light paths meet, where a flag does not say it.
    fn path_bounces(&self) -> Option<u32> {
        None
    }

    /// Settings that stand in headers as they are here, whatever the command line says.
    fn header(&self, order: &Order<'_>) -> Vec<(&'static str, String)> {
        let _ = order;
        Vec::new()
    }

    /// Layers of a picture beside the quantities, and bytes for each pixel while it is made.
    fn costs(&self) -> [u64; 2] {
        [0, 0]
    }

    /// Renders a scene, which must be that of the tracer.
    fn render(
        &self,
        scene: &Scene,
        ground: &Ground,
        order: Order<'_>,
        progress: &dyn Progress,
    ) -> Result<Made>;
}

/// What a technique made of which there are no two halves, so that it does not know its noise.
fn made(
    order: &Order<'_>,
    layers: Layers,
    rays: u64,
    passes: &[Pass],
    mut values: impl FnMut(Quantity) -> Vec<Vec3>,
) -> Made {
    let estimate = |&quantity: &Quantity| Estimate {
        quantity,
        values: values(quantity),
        noise: f32::NAN,
    };
    Made {
        render: Render {
            size: order.size,
            estimates: order.quantities.iter().map(estimate).collect(),
            layers,
            rays,
        },
        stages: Vec::new(),
        passes: passes.to_vec(),
        gpu_seconds: BTreeMap::new(),
    }
}

impl TechniqueArgs {
    /// The technique of a choice.
    pub(crate) fn chosen(&self, choice: TechniqueChoice) -> &dyn Technique {
        match choice {
            TechniqueChoice::Reference => &reference::Reference,
            TechniqueChoice::Ldi => &self.ldi,
            TechniqueChoice::Igi => &self.igi,
            TechniqueChoice::Ldm => &self.ldm,
            TechniqueChoice::Field => &field::Field,
        }
    }

    /// Flags without effect with a technique: those of the others, and those it does not know.
    pub(crate) fn idle(&self, choice: TechniqueChoice, quantities: &[Quantity]) -> Vec<Idle> {
        let mut idle = self.chosen(choice).idle(quantities);
        let groups = [
            (TechniqueChoice::Ldi, ids::<ldi::LdiTechnique>()),
            (TechniqueChoice::Igi, ids::<igi::IgiTechnique>()),
            (TechniqueChoice::Ldm, ids::<ldm::LdmTechnique>()),
        ];
        for (of, flags) in groups {
            if of != choice {
                let why = format!("it is for --technique {}", of.name());
                idle.extend(Idle::all(flags, &why));
            }
        }
        idle
    }
}

impl TechniqueChoice {
    pub(crate) fn name(self) -> String {
        self.to_possible_value()
            .map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// Refuses quantities that a technique does not know.
    pub(crate) fn check(self, technique: &dyn Technique, quantities: &[Quantity]) -> Result<()> {
        let known = technique.quantities();
        for quantity in quantities {
            if !known.is_empty() && !known.contains(quantity) {
                let known: Vec<&str> = known.iter().map(|known| known.name()).collect();
                bail!(
                    "the technique {} knows {}, but not {quantity}: leave out --quantity, or --technique",
                    self.name(),
                    known.join(", ")
                );
            }
        }
        Ok(())
    }
}
