//! Occlusion and light by maps that a GPU builds.

use std::sync::Arc;

use anyhow::Result;
use isophote_ldm_ambient::{
    cpu::{self, Triangles, occlusion::Sky},
    gpu::{
        BuildMethod, Occlusion,
        gather::{Gather, Picture},
        hbao::Hbao,
        photons::{self, Photons, SplatMethod},
    },
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Pass, Scene,
    gpu::{
        GpuTracer,
        reference::{Integrator, World},
    },
    reference::{Progress, Quantity},
};

use super::{
    DepositChoice, Found, GlossyChoice, LdmTechnique, OcclusionChoice, SplatChoice,
    light::{Light, Lit, is_direct, is_irradiance},
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
    let (skies, passes) = match technique.ldm_occlusion {
        OcclusionChoice::Maps => by_maps(technique, gpu, world, order, progress)?,
        OcclusionChoice::Hbao => by_hbao(technique, gpu, world, order, progress)?,
    };
    found.skies(&skies);
    found.passes.extend(passes);
    Ok(())
}

fn by_hbao(
    technique: &LdmTechnique,
    gpu: &Gpu,
    world: World<'_>,
    order: &Order<'_>,
    progress: &dyn Progress,
) -> Result<(Vec<Sky>, Vec<Pass>)> {
    let (params, normals) = (technique.hbao(order)?, order.settings.normals);
    let (context, samples) = (&gpu.context, technique.ldm_samples);
    let mut hbao = Hbao::new(context, world.gpu_scene, &params, order.size)?;
    Ok(hbao.render(context, world, order.camera, samples, normals, progress)?)
}

fn by_maps(
    technique: &LdmTechnique,
    gpu: &Gpu,
    world: World<'_>,
    order: &Order<'_>,
    progress: &dyn Progress,
) -> Result<(Vec<Sky>, Vec<Pass>)> {
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
    Ok(occlusion.render(
        &gpu.context,
        world,
        order.camera,
        samples,
        normals,
        progress,
    )?)
}

fn find_light(
    technique: &LdmTechnique,
    gpu: &Gpu,
    world: World<'_>,
    order: &Order<'_>,
    progress: &dyn Progress,
    found: &mut Found,
) -> Result<()> {
    let splatted = technique.uses(order.quantities).splatted;
    let mut lit = match splatted && !order.wants(is_direct) {
        true => Lit::default(),
        false => gather(technique, gpu, world, order, progress, found)?,
    };
    if splatted {
        let params = technique.photons(order, DepositChoice::Splatted);
        let (context, on) = (&gpu.context, (world.scene, world.gpu_scene));
        let (exact, size) = (world.exact, order.size);
        let method = match technique.ldm_splat {
            Some(SplatChoice::Quads) => SplatMethod::Quads,
            Some(SplatChoice::Tiled) | None => SplatMethod::Tiled,
        };
        let selection = order.selection;
        let mut photons = Photons::new(context, on, selection, &params, exact, method, size)?;
        let (light, passes) = photons.render(context, world, order.camera, progress)?;
        lit.indirect = light.into();
        found.passes.extend(passes);
    }
    found.light(lit, order);
    Ok(())
}

/// All that is asked for; what is splatted is left out.
fn gather(
    technique: &LdmTechnique,
    gpu: &Gpu,
    world: World<'_>,
    order: &Order<'_>,
    progress: &dyn Progress,
    found: &mut Found,
) -> Result<Lit> {
    let (scene, selection, context) = (world.scene, order.selection, &gpu.context);
    let params = technique.gathered(order, technique.ldm_deposit == DepositChoice::Gathered);
    let picture = Picture {
        size: order.size,
        lights: order.wants(is_direct),
        irradiance: order.wants(is_irradiance),
        mirrored: technique.ldm_glossy == GlossyChoice::Nearest,
    };
    let (triangles, tree);
    let sent = match params.bounces > 0 || params.direct {
        false => None,
        true => {
            triangles = Triangles::new(scene, &scene.transforms(), selection)?;
            let scene = Arc::new(scene.clone());
            tree = BvhTracer::build(&scene, selection, &BvhOptions::default())?;
            Some(cpu::photons::Photons::emit(&triangles, &tree, &params)?)
        }
    };
    found
        .passes
        .extend(sent.iter().flat_map(|sent| sent.passes()));
    let on = (scene, world.gpu_scene);
    let sent = sent.as_ref();
    let mut gather = Gather::new(context, on, selection, &params, world.exact, picture, sent)?;
    let samples = technique.ldm_samples;
    let (light, passes) = gather.render(context, world, order.camera, samples, progress)?;
    found.passes.extend(passes);
    Ok(Lit {
        direct: light.direct.into(),
        indirect: light.indirect.into(),
    })
}

impl From<photons::Light> for Light {
    fn from(light: photons::Light) -> Self {
        Self {
            radiance: light.radiance,
            irradiance: light.irradiance,
        }
    }
}
