//! The passes as pipelines, and what they bind.

use std::{collections::HashMap, sync::Arc};

use super::World;
use crate::{
    Result,
    gpu::{ComputePass, Context, GpuScene, GpuTracer, Linker},
    reference::Wanted,
};

/// A pass, and the bind group of the tracer that answers its rays.
pub(super) struct Pass {
    pub(super) name: &'static str,
    pub(super) compute: Arc<ComputePass>,
    pub(super) tracer: wgpu::BindGroup,
}

/// What a pipeline is linked of.
#[derive(Debug, PartialEq, Eq, Hash)]
pub(super) struct Link {
    pass: &'static str,
    tracer: &'static str,
    flags: Vec<&'static str>,
    scene_in_textures: bool,
}

impl Link {
    pub(super) fn new(pass: &'static str, scene: &GpuScene, tracer: &dyn GpuTracer) -> Self {
        Self {
            pass,
            tracer: tracer.module(),
            flags: tracer.shader_flags().to_vec(),
            scene_in_textures: scene.is_in_textures(),
        }
    }
}

/// The passes that have been needed so far, by how they were linked.
#[derive(Debug, Default)]
pub(super) struct Passes(HashMap<Link, Arc<ComputePass>>);

/// The binding of the piece.
const PIECE: u32 = 1;

impl Passes {
    /// The passes that some quantities need, in their order.
    pub(super) fn choose(
        &mut self,
        context: &Context,
        world: World<'_>,
        camera: bool,
        wanted: &Wanted,
    ) -> Result<Vec<Pass>> {
        let kinds = [wanted.radiance, wanted.irradiance];
        let direct = kinds.iter().any(|kind| kind.last > 0 && kind.first <= 1);
        let path = kinds
            .iter()
            .any(|kind| kind.last > 1 || (kind.last > 0 && world.gpu_scene.light_can_be_hit()));
        let passes = [
            ("camera", camera, world.exact),
            ("occlusion", wanted.occlusion, world.secondary),
            ("direct", direct, world.exact),
            ("path", path, world.secondary),
        ];
        passes
            .into_iter()
            .filter(|(_, wanted, _)| *wanted)
            .map(|(name, _, tracer)| {
                Ok(Pass {
                    name,
                    compute: self.pass(context, world.gpu_scene, name, tracer)?,
                    tracer: tracer.bind_group().clone(),
                })
            })
            .collect()
    }

    fn pass(
        &mut self,
        context: &Context,
        scene: &GpuScene,
        name: &'static str,
        tracer: &dyn GpuTracer,
    ) -> Result<Arc<ComputePass>> {
        let link = Link::new(name, scene, tracer);
        if let Some(pass) = self.0.get(&link) {
            return Ok(pass.clone());
        }
        let shader = Linker::default()
            .scene(scene)
            .tracer(tracer)
            .link(&format!("scene::reference::{name}"))?;
        let groups = [tracer.bind_group_layout(), scene.bind_group_layout()];
        let pass = Arc::new(shader.compute_pass(context, name, &groups, &[PIECE])?);
        self.0.insert(link, pass.clone());
        Ok(pass)
    }
}
