//! Footprints of photons where shaders find them: the grid is built on the CPU.

use bytemuck::{Pod, Zeroable};
use glam::{UVec3, Vec3};
use isophote_scene::gpu::Context;
use wgpu::{BindingResource, Buffer, BufferUsages};

use crate::{Result, cpu::photons::PackedField};

/// `Field` of gather/field.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Info {
    low: Vec3,
    cell: f32,
    cells: UVec3,
    padding: u32,
}

/// Bindings 8 to 10 of gather/field.wesl.
#[derive(Debug)]
pub(super) struct Field {
    info: Buffer,
    footprints: Buffer,
    listed: Buffer,
}

impl Field {
    pub(super) fn upload(context: &Context, packed: &PackedField) -> Result<Self> {
        let info = Info {
            low: packed.low,
            cell: packed.cell,
            cells: packed.cells,
            padding: 0,
        };
        let (footprints, listed) = (&packed.footprints[..], &packed.listed[..]);
        context.check_storage_size("footprints", size_of_val(footprints) as u64)?;
        context.check_storage_size("the grid of footprints", size_of_val(listed) as u64)?;
        Ok(Self {
            info: context.buffer("field", &[info], BufferUsages::UNIFORM)?,
            footprints: context.buffer("footprints", footprints, BufferUsages::STORAGE)?,
            listed: context.buffer("the grid of footprints", listed, BufferUsages::STORAGE)?,
        })
    }

    pub(super) fn resources(&self) -> [(u32, BindingResource<'_>); 3] {
        [
            (8, self.info.as_entire_binding()),
            (9, self.footprints.as_entire_binding()),
            (10, self.listed.as_entire_binding()),
        ]
    }
}
