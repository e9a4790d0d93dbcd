//! Stage 7, photons leave the lights and land, and maps are fitted around where they do. Twin of `cpu/photons/emission.rs`.

use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec4};
use isophote_scene::{
    Aabb, Scene,
    gpu::{ComputePass, Context, Dispatch, GpuScene, GpuTracer},
    reference::{Materials, Normals},
};
use wgpu::{Buffer, BufferUsages};

use crate::{
    PhotonParams, Result,
    cpu::{
        photons::leave,
        view::{View, longest_axis},
    },
    gpu::{finish, fit, grid, linker, triangles::Triangles},
};

/// Bytes of a photon as a point, and of what it brings.
const RECORD: u64 = 48;
/// Photons around which maps are fitted together.
const BOX: usize = 64;

/// `Emission` of photons/emission.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Emission {
    origin: Vec3,
    count: u32,
    flat_normals: u32,
    pbr: u32,
    padding: [u32; 2],
}

/// Photons where they landed, and what sends them.
#[derive(Debug)]
pub(super) struct Landed {
    emission: ComputePass,
    weigh: ComputePass,
    directions: Vec<Vec3>,
    /// Along the directions, around where photons landed.
    pub(super) views: Vec<View>,
    /// Photons as points that maps are asked for, and what they bring.
    pub(super) points: Buffer,
    pub(super) photons: Buffer,
    /// Photons that left the lights.
    pub(super) count: u32,
}

impl Landed {
    /// None yet.
    pub(super) fn new(
        context: &Context,
        (gpu_scene, exact): (&GpuScene, &dyn GpuTracer),
        params: &PhotonParams,
    ) -> Result<Self> {
        let emission = linker()
            .scene(gpu_scene)
            .tracer(exact)
            .link("ldm_ambient::photons::emission")?;
        let groups = [exact.bind_group_layout(), gpu_scene.bind_group_layout()];
        let weigh = linker().link("ldm_ambient::photons::weigh")?;
        Ok(Self {
            emission: emission.compute_pass(context, "emit", &groups, &[])?,
            weigh: weigh.compute_pass(context, "weigh", &[], &[])?,
            directions: params.directions(),
            views: Vec::new(),
            points: context.storage("photons as points", RECORD)?,
            photons: context.storage("photons", RECORD)?,
            count: 0,
        })
    }

    /// Sends photons through a scene whose instances are where `gpu_scene` has them, and fits maps around where they land.
    pub(super) fn emit(
        &mut self,
        context: &Context,
        (scene, triangles): (&Scene, &Triangles),
        (gpu_scene, exact): (&GpuScene, &dyn GpuTracer),
        params: &PhotonParams,
    ) -> Result<()> {
        let leaving = leave(scene, params);
        self.count = leaving.len() as u32;
        let count = u64::from(self.count);
        let words: Vec<[Vec4; 7]> = leaving
            .iter()
            .map(|photon| {
                let [x, y] = photon.differential.position;
                let [dx, dy] = photon.differential.direction;
                let ray = &photon.ray;
                [ray.origin, ray.direction, photon.flux, x, y, dx, dy].map(|v| v.extend(0.0))
            })
            .collect();
        context.check_storage_size("photons", size_of_val(&words[..]) as u64)?;
        let leaving = context.buffer("photons that leave", &words, BufferUsages::STORAGE)?;
        self.points = context.storage("photons as points", RECORD * count)?;
        self.photons = context.storage("photons", RECORD * count)?;
        let emission = Emission {
            origin: triangles.origin,
            count: self.count,
            flat_normals: u32::from(params.normals == Normals::Flat),
            pbr: u32::from(params.materials == Materials::Pbr),
            padding: [0; 2],
        };
        let emission = context.buffer("emission", &[emission], BufferUsages::UNIFORM)?;
        let directions: Vec<Vec4> = self.directions.iter().map(|d| d.extend(0.0)).collect();
        let directions = context.buffer("directions", &directions, BufferUsages::STORAGE)?;
        let (points, photons) = (&self.points, &self.photons);
        let emitted = [
            (0, emission.as_entire_binding()),
            (1, leaving.as_entire_binding()),
            (2, points.as_entire_binding()),
            (3, photons.as_entire_binding()),
        ];
        let weighed = [
            (0, directions.as_entire_binding()),
            (1, points.as_entire_binding()),
            (2, photons.as_entire_binding()),
        ];
        let emitted = self.emission.bind(context, &emitted)?;
        let weighed = self.weigh.bind(context, &weighed)?;
        let mut encoder = context.device().create_command_encoder(&Default::default());
        let dispatch = [Dispatch {
            offset: None,
            workgroups: grid(count.div_ceil(64)),
        }];
        let groups = [&emitted, exact.bind_group(), gpu_scene.bind_group()];
        self.emission
            .record(&mut encoder, "emission", None, &groups, &dispatch);
        self.weigh
            .record(&mut encoder, "weights", None, &[&weighed], &dispatch);
        finish(context, encoder)?;
        self.fit(context, triangles, params.maps.resolution)
    }

    /// Fits maps around photons that landed.
    fn fit(&mut self, context: &Context, triangles: &Triangles, resolution: u32) -> Result<()> {
        let records: Vec<[Vec4; 3]> =
            context.read("photons as points", &self.points, self.count as usize)?;
        let landed = records.iter().filter(|record| record[0].w != 0.0);
        let landed: Vec<Vec3> = landed.map(|record| record[0].truncate()).collect();
        let boxes = landed
            .chunks(BOX)
            .map(|some| Aabb::around(some.iter().copied()));
        let boxes: Vec<Aabb> = boxes.collect();
        let longest = longest_axis(&triangles.bounds);
        self.views = match boxes.is_empty() {
            true => Vec::new(),
            false => fit(
                context,
                &self.directions,
                (triangles.origin, &boxes),
                longest,
                resolution,
            ),
        };
        Ok(())
    }
}
