//! The splats of a batch of maps: made, one for each photon and map or none, and added to the light of the picture.

mod quads;
mod tiles;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use isophote_scene::{
    Pinhole,
    gpu::{ComputePass, Context, Dispatch, Timer, UniformArray},
};
use wgpu::{BindGroup, BindingResource, Buffer, BufferUsages};

use self::{
    quads::Quads,
    tiles::{Lists, Tiles},
};
use super::super::{BuildMethod, grid, linker, maps::Batch};
use crate::{PhotonParams, Result};

/// Photons that are split together.
const MANY: u32 = 1 << 15;
/// Splats that are listed together on software adapters: more than 65,535 turns of all its loops llvmpipe denies an invocation,
/// without a word, and one may add all splats up.
const FEW: u32 = 61_440;
/// Bytes of a splat.
const SPLAT: u64 = 32;

/// How splats are added up on a GPU: the same light but for rounding. Both add in the order of the splats, so that two frames of
/// the same scene are equal bit by bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum SplatMethod {
    /// By the tiles of the picture: prefix sums list for them what reaches them, and each pixel reads and writes its light
    /// once for some thousand photons.
    #[default]
    Tiled,
    /// The paper's (§4.2): each splat is an instance of a quad that additive blending adds, in the order in which they are drawn,
    /// as graphics interfaces guarantee. The device must blend 32-bit floats
    /// ([`FLOAT32_BLENDABLE`](wgpu::Features::FLOAT32_BLENDABLE)): sums of many small splats would be lost in 16 bits.
    Quads,
}

/// `Splatting` of photons/splats.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Splatting {
    right: Vec3,
    scale: f32,
    up: Vec3,
    splat_size: f32,
    forward: Vec3,
    flatness: f32,
    eye: Vec3,
    first: u32,
    size: [u32; 2],
    count: u32,
    lists: Lists,
}

/// What splats are made of.
pub(super) struct Resources<'a> {
    pub(super) batches: BindingResource<'a>,
    pub(super) tables: [(u32, BindingResource<'a>); 2],
    pub(super) points: &'a Buffer,
    pub(super) photons: &'a Buffer,
    pub(super) screen: &'a Buffer,
}

/// Makes and adds splats; it keeps its pipelines and its memory.
#[derive(Debug)]
pub(super) struct Splats {
    size: [u32; 2],
    maps: usize,
    /// Photons that are split together.
    many: u32,
    split: ComputePass,
    adder: Adder,
    /// Most layers and entries that were needed, and whether a layer was lost.
    status: Buffer,
    photons: u32,
    splats: Buffer,
}

/// Who adds them.
#[derive(Debug)]
enum Adder {
    Tiles(Box<Tiles>),
    Quads(Quads),
}

/// What is bound for some photons.
pub(super) struct Groups {
    photons: u32,
    split: BindGroup,
    /// Of each pass of who adds.
    added: Vec<BindGroup>,
}

impl Splats {
    pub(super) fn new(
        context: &Context,
        method: SplatMethod,
        size: [u32; 2],
        maps: usize,
    ) -> Result<Self> {
        Ok(Self {
            size,
            maps,
            many: match context.device().adapter_info().device_type {
                wgpu::DeviceType::Cpu => FEW / maps as u32,
                _ => MANY,
            },
            split: split(context, BuildMethod::default())?,
            adder: match method {
                SplatMethod::Tiled => Adder::Tiles(Box::new(Tiles::new(context, size)?)),
                SplatMethod::Quads => Adder::Quads(Quads::new(context, size)?),
            },
            status: context.storage("status", 12)?,
            photons: 0,
            splats: context.storage("splats", SPLAT)?,
        })
    }

    /// Asks maps that are built in another way from now on.
    pub(super) fn ask(&mut self, context: &Context, method: BuildMethod) -> Result<()> {
        self.split = split(context, method)?;
        Ok(())
    }

    /// The light that is added up, W/m²: a buffer, or a texture where they are quads.
    pub(super) fn light(&self) -> BindingResource<'_> {
        match &self.adder {
            Adder::Tiles(tiles) => tiles.light.as_entire_binding(),
            Adder::Quads(quads) => BindingResource::TextureView(&quads.light),
        }
    }

    /// Makes room for the splats of so many photons.
    pub(super) fn reserve(&mut self, context: &Context, photons: u32) -> Result<()> {
        self.photons = photons;
        let slots = u64::from(photons.min(self.many)) * self.maps as u64;
        self.splats = context.storage("splats", SPLAT * slots)?;
        match &mut self.adder {
            Adder::Tiles(tiles) => tiles.reserve(context, slots),
            Adder::Quads(_) => Ok(()),
        }
    }

    /// Makes room for so many entries of lists; whether there was not.
    pub(super) fn make_room(&mut self, context: &Context, needed: u32) -> Result<bool> {
        match &mut self.adder {
            Adder::Tiles(tiles) => tiles.make_room(context, needed),
            Adder::Quads(_) => Ok(false),
        }
    }

    pub(super) fn status(&self, context: &Context) -> Result<[u32; 3]> {
        let status: Vec<u32> = context.read("status", &self.status, 3)?;
        Ok([status[0], status[1], status[2]])
    }

    /// Passes that a batch takes, at most.
    pub(super) fn passes(&self) -> u32 {
        (1 + tiles::PASSES as u32) * self.photons.div_ceil(self.many)
    }

    /// Records that there is no light yet.
    pub(super) fn begin(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.clear_buffer(&self.status, 0, None);
        match &self.adder {
            Adder::Tiles(tiles) => encoder.clear_buffer(&tiles.light, 0, None),
            Adder::Quads(quads) => quads.clear(encoder),
        }
    }

    /// What is bound for as many photons as are split together, as often as it takes.
    pub(super) fn bind(
        &self,
        context: &Context,
        params: &PhotonParams,
        (eye, origin): (Pinhole, Vec3),
        resources: Resources<'_>,
    ) -> Result<Vec<Groups>> {
        let firsts = (0..self.photons).step_by(self.many as usize);
        let group = |first: u32| {
            let splatting = Splatting {
                right: eye.right,
                scale: 0.5 * self.size[1] as f32 / (0.5 * eye.yfov).tan(),
                up: eye.up,
                splat_size: params.splat_size,
                forward: eye.forward,
                flatness: params.flatness,
                eye: eye.eye - origin,
                first,
                size: self.size,
                count: (self.photons - first).min(self.many),
                lists: match &self.adder {
                    Adder::Tiles(tiles) => tiles.lists(),
                    Adder::Quads(_) => Lists::zeroed(),
                },
            };
            self.group(context, splatting, &resources)
        };
        firsts.map(group).collect()
    }

    fn group(
        &self,
        context: &Context,
        splatting: Splatting,
        resources: &Resources<'_>,
    ) -> Result<Groups> {
        let uniform = context.buffer("splatting", &[splatting], BufferUsages::UNIFORM)?;
        let [pixels, layers] = resources.tables.clone();
        let all = [
            (0, resources.batches.clone()),
            pixels,
            layers,
            (3, uniform.as_entire_binding()),
            (4, resources.points.as_entire_binding()),
            (5, resources.photons.as_entire_binding()),
            (6, self.splats.as_entire_binding()),
            (7, resources.screen.as_entire_binding()),
            (8, self.status.as_entire_binding()),
        ];
        Ok(Groups {
            photons: splatting.count,
            split: self.split.bind(context, &all)?,
            added: match &self.adder {
                Adder::Tiles(tiles) => tiles.bind(context, &all)?,
                Adder::Quads(quads) => vec![quads.bind(context, &all)?],
            },
        })
    }

    /// Records that the splats of a batch of so many maps are made and added.
    pub(super) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        groups: &[Groups],
        batch: usize,
        maps: usize,
        mut timer: Option<&mut Timer>,
    ) {
        let offset = UniformArray::<Batch>::offset(batch as u32);
        for group in groups {
            let slots = group.photons * maps as u32;
            let dispatch = Dispatch {
                offset: Some(offset),
                workgroups: grid(u64::from(slots.div_ceil(64))),
            };
            let bound = [&group.split];
            self.split
                .record(encoder, "split", timer.as_deref_mut(), &bound, &[dispatch]);
            let timer = timer.as_deref_mut();
            match &self.adder {
                Adder::Tiles(tiles) => tiles.record(encoder, &group.added, slots, offset, timer),
                Adder::Quads(quads) => quads.record(encoder, &group.added, slots, offset, timer),
            }
        }
    }
}

/// What makes splats of maps.
fn split(context: &Context, method: BuildMethod) -> Result<ComputePass> {
    let shader = linker()
        .feature("lists", method == BuildMethod::LinkedLists)
        .link("ldm_ambient::photons::split")?;
    Ok(shader.compute_pass(context, "split", &[], &[0])?)
}
