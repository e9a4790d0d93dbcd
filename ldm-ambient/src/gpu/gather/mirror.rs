//! What metals show (§6): of the directions that the maps look along, the one that is nearest to the ray that a surface reflects is
//! asked instead of it. Rays of several samples are answered together, since every map is drawn for them again.

use std::collections::BTreeMap;

use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec4};
use isophote_scene::{
    Aabb, Scene,
    gpu::{ComputePass, Context, Dispatch, GpuScene, GpuTracer},
    reference::Materials,
    sample::hash_seed,
};
use wgpu::{Buffer, BufferUsages};

use super::{
    super::{grid, linker},
    looks::{Looks, Shining, Ways},
};
use crate::{PhotonParams, Result};

/// Rays that are answered together at most, unless they are of one sample.
const RAYS: u64 = 1 << 20;
/// Samples that are answered together at most.
const SAMPLES: u64 = 64;
/// Bytes of a ray as a point that maps are asked for, and of what it brings.
const RAY: u64 = 48;
const MIRRORED: u64 = 32;
/// Rays around which a map is fitted together.
const BOX: usize = 64;
/// As the CPU chooses them.
const SEED: u64 = 0x6c64_6d67;

/// Rays that metals reflect.
#[derive(Debug)]
pub(super) struct Mirror {
    reflect: ComputePass,
    mirror: ComputePass,
    add: ComputePass,
    seed: u32,
    environment: bool,
    directions: Buffer,
    rays: Buffer,
    mirrored: Buffer,
    pixels: u32,
    /// Samples that are answered together.
    most: u32,
    waiting: u32,
}

/// `Reflecting` of gather/reflect.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Reflecting {
    seed: u32,
    sample: u32,
    first: u32,
    environment: u32,
}

impl Mirror {
    /// None where there is no metal, or nothing that it could show.
    pub(super) fn new(
        context: &Context,
        (scene, gpu_scene): (&Scene, &GpuScene),
        params: &PhotonParams,
        exact: &dyn GpuTracer,
        shining: &Shining,
        [width, height]: [u32; 2],
    ) -> Result<Option<Self>> {
        let is_metal = scene.materials.iter().any(|one| one.metallic > 0.0);
        if params.materials == Materials::Lambert || !is_metal || shining.is_dark() {
            return Ok(None);
        }
        let reflect = linker().scene(gpu_scene).tracer(exact);
        let reflect = reflect.link("ldm_ambient::gather::reflect")?;
        let groups = [exact.bind_group_layout(), gpu_scene.bind_group_layout()];
        let add = linker().link("ldm_ambient::gather::reflected")?;
        let pixels = u64::from(width) * u64::from(height);
        let limits = context.device().limits();
        let bound = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size);
        let most = (RAYS.min(bound / RAY) / pixels.max(1)).clamp(1, SAMPLES);
        let directions = params.directions().into_iter();
        let directions: Vec<Vec4> = directions.map(|direction| direction.extend(0.0)).collect();
        Ok(Some(Self {
            reflect: reflect.compute_pass(context, "reflect_rays", &groups, &[])?,
            mirror: shining.pass(context, "ldm_ambient::gather::mirror", "mirror")?,
            add: add.compute_pass(context, "add_reflected", &[], &[])?,
            seed: hash_seed(params.seed ^ SEED),
            environment: params.environment,
            directions: context.buffer("directions", &directions, BufferUsages::STORAGE)?,
            rays: context.storage("rays of metals", RAY * pixels * most)?,
            mirrored: context.storage("what metals show", MIRRORED * pixels * most)?,
            pixels: pixels as u32,
            most: most as u32,
            waiting: 0,
        }))
    }

    /// A new picture begins.
    pub(super) fn begin(&mut self) {
        self.waiting = 0;
    }

    /// Whether the rays that wait are to be answered after a part of so many.
    pub(super) fn is_due(&self, [part, parts]: [u32; 2]) -> bool {
        self.waiting > 0 && (self.waiting == self.most || part + 1 >= parts)
    }

    /// Records that metals reflect rays of what is seen at one place of each pixel, of which `asking` tells.
    pub(super) fn reflect(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        (gpu_scene, exact): (&GpuScene, &dyn GpuTracer),
        (asking, sample): (&Buffer, u32),
        size: [u32; 2],
    ) -> Result<()> {
        let reflecting = Reflecting {
            seed: self.seed,
            sample,
            first: self.waiting * self.pixels,
            environment: u32::from(self.environment),
        };
        let reflecting = context.buffer("reflecting", &[reflecting], BufferUsages::UNIFORM)?;
        let resources = [
            (0, asking.as_entire_binding()),
            (2, reflecting.as_entire_binding()),
            (3, self.mirrored.as_entire_binding()),
            (4, self.directions.as_entire_binding()),
            (5, self.rays.as_entire_binding()),
        ];
        let group = self.reflect.bind(context, &resources)?;
        let groups = [&group, exact.bind_group(), gpu_scene.bind_group()];
        let dispatch = [Dispatch::over_pixels(size)];
        self.reflect
            .record(encoder, "nearest", None, &groups, &dispatch);
        self.waiting += 1;
        Ok(())
    }

    /// The maps that the rays that wait ask for, once they were submitted: each is fitted around its own rays as on the CPU, and
    /// finer than those that all share. Waits for the device; none where there is no ray.
    pub(super) fn ways(&self, context: &Context, shining: &Shining) -> Result<Option<Ways>> {
        let count = (self.waiting * self.pixels) as usize;
        let mut rays: Vec<[Vec4; 3]> = context.read("rays of metals", &self.rays, count)?;
        let mut groups: BTreeMap<u32, Vec<Vec3>> = BTreeMap::new();
        for [position, shading, _] in rays.iter().filter(|ray| ray[0].w != 0.0) {
            let group = groups.entry(shading.w as u32).or_default();
            group.push(position.truncate());
        }
        let numbers: Vec<u32> = groups.keys().copied().collect();
        for ray in rays.iter_mut().filter(|ray| ray[0].w != 0.0) {
            let place = numbers.partition_point(|&number| number < ray[1].w as u32);
            ray[1].w = place as f32;
        }
        let bytes = bytemuck::cast_slice(&rays);
        context.queue().write_buffer(&self.rays, 0, bytes);
        let boxes = |(number, positions): (u32, Vec<Vec3>)| {
            let boxes = positions.chunks(BOX);
            let boxes = boxes.map(|some| Aabb::around(some.iter().copied()));
            (number, boxes.collect())
        };
        let groups: Vec<(u32, Vec<Aabb>)> = groups.into_iter().map(boxes).collect();
        Ok((!groups.is_empty()).then(|| shining.ways_around(context, &groups)))
    }

    /// The rays that wait, ready to look along maps.
    pub(super) fn looks<'a>(
        &'a self,
        context: &Context,
        shining: &'a Shining,
        ways: &'a Ways,
    ) -> Result<Looks<'a>> {
        let asking = (&self.rays, self.waiting * self.pixels);
        shining.looks(
            context,
            ("mirror", &self.mirror),
            ways,
            asking,
            &self.mirrored,
        )
    }

    /// Records that what rays met is added to their pixels; then none waits.
    pub(super) fn add(
        &mut self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        [lit, shown]: [&Buffer; 2],
    ) -> Result<()> {
        let reflected = [self.pixels, self.waiting, 0, 0];
        let reflected = context.buffer("reflected", &reflected, BufferUsages::UNIFORM)?;
        let resources = [
            (0, reflected.as_entire_binding()),
            (1, self.mirrored.as_entire_binding()),
            (2, lit.as_entire_binding()),
            (3, shown.as_entire_binding()),
        ];
        let group = self.add.bind(context, &resources)?;
        let dispatch = Dispatch {
            offset: None,
            workgroups: grid(u64::from(self.pixels).div_ceil(64)),
        };
        self.add
            .record(encoder, "shade", None, &[&group], &[dispatch]);
        self.waiting = 0;
        Ok(())
    }
}
