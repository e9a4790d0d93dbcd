//! Occlusion and light by maps that a GPU builds.

use anyhow::{Result, ensure};
use isophote_ldm_ambient::gpu::{
    BuildMethod, Occlusion,
    direct::Direct,
    photons::{self, Photons},
};
use isophote_scene::{
    Pass, Scene,
    gpu::{
        GpuTracer,
        reference::{Integrator, World},
    },
    reference::{Progress, Quantity},
};

use super::{
    DepositChoice, DirectChoice, Found, GlossyChoice, LdmTechnique, OcclusionChoice,
    light::{Light, Lit, is_bounced, is_direct, is_irradiance},
};
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
    let is_glossy = technique.ldm_glossy == Some(GlossyChoice::Nearest);
    for (is_chosen, flag) in [
        (
            technique.ldm_deposit == Some(DepositChoice::Gathered),
            "--ldm-deposit gathered",
        ),
        (is_glossy, "--ldm-glossy nearest"),
        (
            technique.ldm_direct == DirectChoice::Photons,
            "--ldm-direct photons",
        ),
    ] {
        ensure!(
            !is_chosen,
            "{flag} runs on the CPU: leave out --device gpu and --adapter, and choose a tracer there"
        );
    }
    let params = technique.photons(order, DepositChoice::Splatted);
    let on = (world.scene, world.gpu_scene);
    let mut lit = Lit::default();
    if order.wants(is_direct) {
        let picture = (order.size, order.wants(is_irradiance));
        let (context, selection) = (&gpu.context, order.selection);
        let mut direct = Direct::new(context, on, selection, &params, world.exact, picture)?;
        let samples = technique.ldm_samples;
        let (light, passes) = direct.render(context, world, order.camera, samples, progress)?;
        lit.direct = light.into();
        found.passes.extend(passes);
    }
    if order.wants(is_bounced) {
        let (context, selection) = (&gpu.context, order.selection);
        let mut photons = Photons::new(context, on, selection, &params, world.exact, order.size)?;
        let (light, passes) = photons.render(context, world, order.camera, progress)?;
        lit.indirect = light.into();
        found.passes.extend(passes);
    }
    found.light(lit, order);
    Ok(())
}

impl From<photons::Light> for Light {
    fn from(light: photons::Light) -> Self {
        Self {
            radiance: light.radiance,
            irradiance: light.irradiance,
        }
    }
}
