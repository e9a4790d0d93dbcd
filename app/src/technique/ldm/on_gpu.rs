//! Occlusion by maps that a GPU builds.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use glam::Vec3;
use isophote_ldm_ambient::{
    cpu::occlusion::Sky,
    gpu::{BuildMethod, Occlusion},
};
use isophote_scene::{
    Scene,
    gpu::{
        GpuTracer,
        reference::{Integrator, World},
    },
    reference::{Estimate, Progress, Quantity, Render},
};

use super::{LdmTechnique, OcclusionChoice, merged};
use crate::{
    gpu::Gpu,
    reference::{Made, Order},
};

pub(super) fn render(
    technique: &LdmTechnique,
    scene: &Scene,
    gpu: &Gpu,
    exact: &dyn GpuTracer,
    order: &Order<'_>,
    progress: &dyn Progress,
) -> Result<Made> {
    ensure!(
        technique.ldm_occlusion == OcclusionChoice::Maps,
        "--ldm-occlusion hbao runs on the CPU: leave out --device gpu and --adapter, and choose a tracer there"
    );
    let context = &gpu.context;
    let world = World {
        scene,
        gpu_scene: &gpu.scene,
        exact,
        secondary: exact,
    };
    let (params, normals) = (technique.occlusion(order), order.settings.normals);
    let mut occlusion = Occlusion::new(
        context,
        (scene, &gpu.scene),
        order.selection,
        &params,
        BuildMethod::default(),
        order.size,
    )?;
    let samples = technique.ldm_samples;
    let (skies, passes) =
        occlusion.render(context, world, order.camera, samples, normals, progress)?;
    let estimate = |&quantity: &Quantity| {
        let value = |sky: &Sky| match quantity {
            Quantity::Obscurance => sky.obscurance,
            _ => sky.ao,
        };
        Estimate {
            quantity,
            values: skies.iter().map(|sky| Vec3::splat(value(sky))).collect(),
            // There are no two halves.
            noise: f32::NAN,
        }
    };
    let passes = merged(&passes);
    let seconds = passes
        .iter()
        .map(|pass| (pass.name.to_owned(), pass.seconds));
    let bent = skies.iter().map(|sky| sky.bent_normal).collect();
    Ok(Made {
        render: Render {
            size: order.size,
            estimates: order.quantities.iter().map(estimate).collect(),
            layers: Integrator::new(context).layers(world, order.camera, order.size, normals)?,
            rays: passes.iter().map(|pass| pass.rays).sum(),
        },
        stages: vec![("bent-normal", bent)],
        gpu_seconds: seconds.collect::<BTreeMap<_, _>>(),
        passes,
    })
}
