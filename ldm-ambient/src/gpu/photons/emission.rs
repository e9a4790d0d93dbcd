//! Stage 7, photons leave the lights and land, leave where they did as often as light bounces, and maps are fitted around where
//! all of them landed. Twin of `cpu/photons/emission.rs`.

use bytemuck::{Pod, Zeroable};
use glam::{Vec3, Vec4};
use isophote_scene::{
    Aabb, Scene,
    gpu::{ComputePass, Context, Dispatch, GpuScene, GpuTracer},
    reference::{Materials, Normals},
};
use wgpu::{Buffer, BufferUsages};

use crate::{
    PhotonParams, Result, Spread,
    cpu::{
        photons::{Leaving, leave},
        view::{View, longest_axis},
    },
    gpu::{finish, fit, grid, linker, triangles::Triangles},
};

/// Bytes of a photon as a point, of what it brings (shaders/photons/photon.wesl), and of one that leaves.
const POINT: u64 = 48;
const PHOTON: u64 = 96;
const LEAVING: u64 = 112;
/// Photons around which maps are fitted together.
const BOX: usize = 64;

/// `Emission` of photons/emission.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Emission {
    origin: Vec3,
    count: u32,
    first: u32,
    flat_normals: u32,
    pbr: u32,
    turned: u32,
}

/// Places of the photons of one bounce among all. `Bouncing` of photons/bounce.wesl, filled up to 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Bounce {
    first: u32,
    count: u32,
    padding: [u32; 2],
}

/// Photons where they landed, and what sends them.
#[derive(Debug)]
pub(super) struct Landed {
    emission: ComputePass,
    bounce: ComputePass,
    weigh: ComputePass,
    directions: Vec<Vec3>,
    /// Of them those in which photons leave again, after each bounce.
    branches: Vec<Vec<Vec3>>,
    /// Along the directions, around where photons landed.
    pub(super) views: Vec<View>,
    /// Photons as points that maps are asked for, and what they bring.
    pub(super) points: Buffer,
    pub(super) photons: Buffer,
    /// Photons of all bounces, those that met nothing among them.
    pub(super) count: u32,
    /// Those that landed.
    pub(super) landed: u32,
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
        let bounce = linker().link("ldm_ambient::photons::bounce")?;
        let weigh = linker().link("ldm_ambient::photons::weigh")?;
        Ok(Self {
            emission: emission.compute_pass(context, "emit", &groups, &[])?,
            bounce: bounce.compute_pass(context, "bounce", &[], &[])?,
            weigh: weigh.compute_pass(context, "weigh", &[], &[])?,
            directions: params.directions(),
            branches: params.branches_of_bounces(),
            views: Vec::new(),
            points: context.storage("photons as points", POINT)?,
            photons: context.storage("photons", PHOTON)?,
            count: 0,
            landed: 0,
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
        let sent = match params.bounces {
            0 => Vec::new(),
            _ => leave(scene, params),
        };
        let bounces = self.make_room(context, sent.len(), params.bounces)?;
        let mut leaving = upload(context, &sent)?;
        let encoder = || context.device().create_command_encoder(&Default::default());
        for (number, bounce) in bounces.iter().enumerate() {
            let mut encoder = encoder();
            let emission = Emission {
                origin: triangles.origin,
                count: bounce.count,
                first: bounce.first,
                flat_normals: u32::from(params.normals == Normals::Flat),
                pbr: u32::from(params.materials == Materials::Pbr),
                turned: u32::from(params.spread == Spread::Turned),
            };
            self.land(
                context,
                &mut encoder,
                (gpu_scene, exact),
                &leaving,
                emission,
            )?;
            if let Some(next) = bounces.get(number + 1) {
                let directions = &self.branches[number];
                leaving = context.storage("photons that leave", LEAVING * u64::from(next.count))?;
                self.leave_again(context, &mut encoder, (directions, &leaving), *bounce)?;
            }
            finish(context, encoder)?;
        }
        let mut encoder = encoder();
        self.weigh(context, &mut encoder)?;
        finish(context, encoder)?;
        self.fit(context, triangles, params.maps.resolution)
    }

    /// The photons of every bounce, if so many leave the lights, for which it makes room.
    fn make_room(&mut self, context: &Context, sent: usize, bounces: u32) -> Result<Vec<Bounce>> {
        let mut found = Vec::new();
        let (mut first, mut count) = (0_u64, sent as u64);
        for number in 0..bounces as usize {
            // What would be too many to be counted does not fit either.
            let all = first.saturating_add(count);
            let what = "photons of all bounces: fewer, or less branches";
            context.check_storage_size(what, all.saturating_mul(PHOTON))?;
            context.check_storage_size(what, count.saturating_mul(LEAVING))?;
            found.push(Bounce {
                first: first as u32,
                count: count as u32,
                padding: [0; 2],
            });
            first = all;
            let branches = self.branches.get(number).map_or(0, Vec::len);
            count = count.saturating_mul(branches as u64);
        }
        self.count = first as u32;
        self.points = context.storage("photons as points", POINT * first)?;
        self.photons = context.storage("photons", PHOTON * first)?;
        Ok(found)
    }

    /// Records that photons that leave land.
    fn land(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        (gpu_scene, exact): (&GpuScene, &dyn GpuTracer),
        leaving: &Buffer,
        emission: Emission,
    ) -> Result<()> {
        let told = context.buffer("emission", &[emission], BufferUsages::UNIFORM)?;
        let bound = [
            (0, told.as_entire_binding()),
            (1, leaving.as_entire_binding()),
            (2, self.points.as_entire_binding()),
            (3, self.photons.as_entire_binding()),
        ];
        let bound = self.emission.bind(context, &bound)?;
        let groups = [&bound, exact.bind_group(), gpu_scene.bind_group()];
        let dispatch = [over(emission.count)];
        self.emission
            .record(encoder, "emission", None, &groups, &dispatch);
        Ok(())
    }

    /// Records that photons that landed leave along directions.
    fn leave_again(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        (directions, leaving): (&[Vec3], &Buffer),
        bounce: Bounce,
    ) -> Result<()> {
        let told = context.buffer("bouncing", &[bounce], BufferUsages::UNIFORM)?;
        let along = as_storage(context, directions)?;
        let bound = [
            (0, told.as_entire_binding()),
            (1, along.as_entire_binding()),
            (2, self.points.as_entire_binding()),
            (3, self.photons.as_entire_binding()),
            (4, leaving.as_entire_binding()),
        ];
        let bound = self.bounce.bind(context, &bound)?;
        let dispatch = [over(bounce.count * directions.len() as u32)];
        self.bounce
            .record(encoder, "bounce", None, &[&bound], &dispatch);
        Ok(())
    }

    /// Records by how much the cosines of photons are divided.
    fn weigh(&self, context: &Context, encoder: &mut wgpu::CommandEncoder) -> Result<()> {
        let along = as_storage(context, &self.directions)?;
        let bound = [
            (0, along.as_entire_binding()),
            (1, self.points.as_entire_binding()),
            (2, self.photons.as_entire_binding()),
        ];
        let bound = self.weigh.bind(context, &bound)?;
        let dispatch = [over(self.count)];
        self.weigh
            .record(encoder, "weights", None, &[&bound], &dispatch);
        Ok(())
    }

    /// Fits maps around photons that landed.
    fn fit(&mut self, context: &Context, triangles: &Triangles, resolution: u32) -> Result<()> {
        let records: Vec<[Vec4; 3]> =
            context.read("photons as points", &self.points, self.count as usize)?;
        let landed = records.iter().filter(|record| record[0].w != 0.0);
        let landed: Vec<Vec3> = landed.map(|record| record[0].truncate()).collect();
        self.landed = landed.len() as u32;
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

/// Photons that leave the lights.
fn upload(context: &Context, sent: &[Leaving]) -> Result<Buffer> {
    let words: Vec<[Vec4; 7]> = sent
        .iter()
        .map(|photon| {
            let [x, y] = photon.differential.position;
            let [dx, dy] = photon.differential.direction;
            let more = [photon.ray.direction, photon.flux, x, y, dx, dy];
            let [direction, flux, x, y, dx, dy] = more.map(|vector| vector.extend(0.0));
            let start = photon.ray.origin.extend(1.0);
            [start, direction, flux, x, y, dx, dy]
        })
        .collect();
    Ok(context.buffer("photons that leave", &words, BufferUsages::STORAGE)?)
}

fn as_storage(context: &Context, directions: &[Vec3]) -> Result<Buffer> {
    let words: Vec<Vec4> = directions.iter().map(|d| d.extend(0.0)).collect();
    Ok(context.buffer("directions", &words, BufferUsages::STORAGE)?)
}

/// One invocation for each of so many, in workgroups of 64.
fn over(count: u32) -> Dispatch {
    Dispatch {
        offset: None,
        workgroups: grid(u64::from(count.div_ceil(64))),
    }
}
