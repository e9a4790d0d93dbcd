//! The passes as pipelines, and what they bind.

use std::collections::HashMap;

use super::World;
use crate::{
    Result,
    gpu::{Context, GpuScene, GpuTracer, Linker},
    reference::Wanted,
};

/// A pass, and the bind group of the tracer that answers its rays.
pub(super) struct Pass {
    pub(super) name: &'static str,
    pub(super) pipeline: wgpu::ComputePipeline,
    pub(super) tracer: wgpu::BindGroup,
}

/// What a pipeline is linked of.
#[derive(Debug, PartialEq, Eq, Hash)]
struct Link {
    pass: &'static str,
    tracer: &'static str,
    flags: Vec<&'static str>,
    scene_in_textures: bool,
}

/// The pipelines that have been needed so far.
#[derive(Debug)]
pub(super) struct Passes {
    /// By how they were linked.
    pipelines: HashMap<Link, wgpu::ComputePipeline>,
    /// Of group 0: settings, piece, starts, sums.
    pub(super) layout: wgpu::BindGroupLayout,
}

impl Passes {
    pub(super) fn new(context: &Context) -> Result<Self> {
        Ok(Self {
            pipelines: HashMap::new(),
            layout: layout(context)?,
        })
    }

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
                    pipeline: self.pipeline(context, world.gpu_scene, name, tracer)?,
                    tracer: tracer.bind_group().clone(),
                })
            })
            .collect()
    }

    fn pipeline(
        &mut self,
        context: &Context,
        scene: &GpuScene,
        name: &'static str,
        tracer: &dyn GpuTracer,
    ) -> Result<wgpu::ComputePipeline> {
        let link = Link {
            pass: name,
            tracer: tracer.module(),
            flags: tracer.shader_flags().to_vec(),
            scene_in_textures: scene.is_in_textures(),
        };
        if let Some(pipeline) = self.pipelines.get(&link) {
            return Ok(pipeline.clone());
        }
        let shader = Linker::default()
            .scene(scene)
            .tracer(tracer)
            .link(&format!("scene::reference::{name}"))?;
        let layouts = [
            &self.layout,
            tracer.bind_group_layout(),
            scene.bind_group_layout(),
        ];
        let pipeline = shader.compute_pipeline(context, name, &layouts)?;
        self.pipelines.insert(link, pipeline.clone());
        Ok(pipeline)
    }
}

fn layout(context: &Context) -> Result<wgpu::BindGroupLayout> {
    let entry = |(binding, ty, has_dynamic_offset)| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset,
            min_binding_size: None,
        },
        count: None,
    };
    let written = wgpu::BufferBindingType::Storage { read_only: false };
    let entries = [
        (0, wgpu::BufferBindingType::Uniform, false),
        (1, wgpu::BufferBindingType::Uniform, true),
        (2, written, false),
        (3, written, false),
    ]
    .map(entry);
    context.check("reference", |device| {
        device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("reference"),
            entries: &entries,
        })
    })
}
