//! Occlusion and light by maps that a GPU builds.

use anyhow::{Result, ensure};
use isophote_ldm_ambient::gpu::{BuildMethod, Occlusion, photons::Photons};
use isophote_scene::{
    Pass, Scene,
    gpu::{
        GpuTracer,
        reference::{Integrator, World},
    },
    reference::{Progress, Quantity},
};

use super::{DepositChoice, Found, GlossyChoice, LdmTechnique, Light, Lit, OcclusionChoice};
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
    let world = World {
        scene,
        gpu_scene: &gpu.scene,
        exact,
        secondary: exact,
    };
    let mut found = Found::default();
    if order.wants(Quantity::is_occlusion) {
        find_occlusion(technique, gpu, world, order, progress, &mut found)?;
    }
    if order.wants(|quantity| !quantity.is_occlusion()) {
        find_light(technique, gpu, world, order, progress, &mut found)?;
    }
    let normals = order.settings.normals;
    let layers = Integrator::new(&gpu.context).layers(world, order.camera, order.size, normals)?;
    let made = found.made(order, layers);
    let seconds = |pass: &Pass| (pass.name.to_owned(), pass.seconds);
    Ok(Made {
        gpu_seconds: made.passes.iter().map(seconds).collect(),
        ..made
    })
}

fn find_occlusion(
    technique: &LdmTechnique,
    gpu: &Gpu,
    world: World<'_>,
    order: &Order<'_>,
    progress: &dyn Progress,
    found: &mut Found,
) -> Result<()> {
    ensure!(
        technique.ldm_occlusion == OcclusionChoice::Maps,
        "--ldm-occlusion hbao runs on the CPU: leave out --device gpu and --adapter, and choose a tracer there"
    );
    let (params, normals) = (technique.occlusion(order), order.settings.normals);
    let mut occlusion = Occlusion::new(
        &gpu.context,
        (world.scene, world.gpu_scene),
        order.selection,
        &params,
        BuildMethod::default(),
        order.size,
    )?;
    let samples = technique.ldm_samples;
    let (skies, passes) = occlusion.render(
        &gpu.context,
        world,
        order.camera,
        samples,
        normals,
        progress,
    )?;
    found.skies(&skies);
    found.passes.extend(passes);
    Ok(())
}

fn find_light(
    technique: &LdmTechnique,
    gpu: &Gpu,
    world: World<'_>,
    order: &Order<'_>,
    progress: &dyn Progress,
    found: &mut Found,
) -> Result<()> {
    ensure!(
        technique.ldm_deposit != Some(DepositChoice::Gathered),
        "--ldm-deposit gathered runs on the CPU: leave out --device gpu and --adapter, and choose a tracer there"
    );
    ensure!(
        technique.ldm_glossy != Some(GlossyChoice::Nearest),
        "--ldm-glossy nearest runs on the CPU: leave out --device gpu and --adapter, and choose a tracer there"
    );
    let params = technique.photons(order, DepositChoice::Splatted);
    let mut photons = Photons::new(
        &gpu.context,
        (world.scene, world.gpu_scene),
        order.selection,
        &params,
        world.exact,
        order.size,
    )?;
    let (light, passes) = photons.render(&gpu.context, world, order.camera, progress)?;
    let lit = Lit {
        indirect: Light {
            radiance: light.radiance,
            irradiance: light.irradiance,
        },
        ..Lit::default()
    };
    found.light(lit, order);
    found.passes.extend(passes);
    Ok(())
}
