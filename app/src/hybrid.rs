//! The technique `ldi`: the hybrid renderer of `isophote-ldi` with a tracer from the command line.

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail};
use glam::Vec3;
use isophote_ldi::{Hybrid, HybridParams, Stages};
use isophote_scene::{
    Scene,
    reference::{Estimate, Layers, Progress, Quantity, Render},
};

use crate::reference::{Ground, Made, Order};

/// Renders a scene, which must be that of the tracer.
pub(crate) fn render(
    scene: &Scene,
    ground: &Ground,
    order: Order<'_>,
    progress: &dyn Progress,
) -> Result<Made> {
    let tracers = ground
        .on_cpu()
        .context("the technique ldi runs on the CPU: leave out --device gpu and --adapter")?;
    let params = HybridParams {
        materials: order.settings.materials,
        seed: order.settings.seed,
        ..HybridParams::default()
    };
    for &quantity in order.quantities {
        if ![Quantity::Direct, Quantity::Indirect].contains(&quantity) {
            bail!(
                "the technique ldi knows direct and indirect, but not {quantity}: give --quantity direct,indirect"
            );
        }
    }
    let hybrid = Hybrid::new(scene, tracers, &params)?;
    let stages = hybrid.render(order.camera, order.size, progress)?;
    let estimate = |&quantity| Estimate {
        quantity,
        values: values(&stages, quantity),
        // There are no two halves.
        noise: f32::NAN,
    };
    let normals = order.settings.normals;
    let render = Render {
        size: order.size,
        estimates: order.quantities.iter().map(estimate).collect(),
        layers: Layers::of(scene, tracers.exact, order.camera, order.size, normals),
        rays: stages.rays(),
    };
    Ok(Made {
        render,
        gpu_seconds: BTreeMap::new(),
    })
}

fn values(stages: &Stages, quantity: Quantity) -> Vec<Vec3> {
    let bounced = stages.diffuse.iter().zip(&stages.glossy);
    match quantity {
        Quantity::Direct => stages.direct.clone(),
        _ => bounced
            .map(|(&diffuse, &glossy)| diffuse + glossy)
            .collect(),
    }
}
