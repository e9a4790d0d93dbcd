//! Acceleration structures: one below for every part of the geometry, one on top that places them.

use glam::{Affine3A, Vec3};
use wgpu::{
    AccelerationStructureFlags as Flags, AccelerationStructureGeometryFlags as GeometryFlags,
    AccelerationStructureUpdateMode as UpdateMode, BlasGeometries, BlasGeometrySizeDescriptors,
};

use super::geometry::{Geometry, Part};
use crate::{Aabb, Error, Result, gpu::Context};

/// The structures of a tracer.
#[derive(Debug)]
pub(super) struct Structures {
    top: wgpu::Tlas,
    /// Instance of the scene and the structure it places.
    placed: Vec<(u32, wgpu::Blas)>,
}

impl Structures {
    /// Over triangles; each instance's number is what the shader gets as custom data.
    pub(super) fn of_triangles(
        context: &Context,
        geometry: &Geometry,
        transforms: &[Affine3A],
    ) -> Result<Self> {
        let parts: Vec<wgpu::Blas> = geometry
            .parts
            .iter()
            .map(|part| triangles_below(context, part))
            .collect::<Result<_>>()?;
        let placed = geometry
            .placed
            .iter()
            .map(|&(instance, part)| (instance, parts[part].clone()));
        Self::on_top(context, placed.collect(), transforms)
    }

    /// Over boxes in the world, as one instance.
    pub(super) fn of_boxes(context: &Context, boxes: &[Aabb]) -> Result<Self> {
        let below = boxes_below(context, boxes)?;
        Self::on_top(context, vec![(0, below)], &[Affine3A::IDENTITY])
    }

    fn on_top(
        context: &Context,
        placed: Vec<(u32, wgpu::Blas)>,
        transforms: &[Affine3A],
    ) -> Result<Self> {
        let limit = context.device().limits().max_tlas_instance_count;
        // Custom data has 24 bits.
        within("instances", transforms.len(), limit.min(1 << 24))?;
        let top = context.check("ray query, instances", |device| {
            device.create_tlas(&wgpu::CreateTlasDescriptor {
                label: Some("instances"),
                max_instances: placed.len() as u32,
                flags: Flags::PREFER_FAST_TRACE,
                update_mode: UpdateMode::Build,
            })
        })?;
        let mut structures = Self { top, placed };
        structures.place(context, transforms)?;
        Ok(structures)
    }

    /// Puts the instances where the scene's transforms say. Those whose transform cannot be undone are left out, since
    /// the API does not define what they are.
    pub(super) fn place(&mut self, context: &Context, transforms: &[Affine3A]) -> Result<()> {
        for (slot, (instance, below)) in self.placed.iter().enumerate() {
            let transform = &transforms[*instance as usize];
            let placed = || wgpu::TlasInstance::new(below, rows(transform), *instance, 0xff);
            self.top[slot] = transform.inverse().is_finite().then(placed);
        }
        context.check("ray query, instances", |device| {
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("instances"),
            });
            encoder.build_acceleration_structures([], [&self.top]);
            context.queue().submit([encoder.finish()]);
        })
    }

    /// What shaders bind.
    pub(super) fn top(&self) -> &wgpu::Tlas {
        &self.top
    }
}

fn rows(transform: &Affine3A) -> [f32; 12] {
    let (m, t) = (transform.matrix3, transform.translation);
    let row = |axis: usize| [m.x_axis[axis], m.y_axis[axis], m.z_axis[axis], t[axis]];
    let [a, b, c] = [row(0), row(1), row(2)];
    [
        a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], c[0], c[1], c[2], c[3],
    ]
}

fn within(what: &str, count: usize, limit: u32) -> Result<()> {
    if count <= limit as usize {
        return Ok(());
    }
    Err(Error::gpu(
        "ray query",
        format!("{count} {what} are more than the {limit} the adapter takes; use compute-bvh"),
    ))
}

fn triangles_below(context: &Context, part: &Part) -> Result<wgpu::Blas> {
    let count = part
        .geometries
        .iter()
        .map(|geometry| geometry.primitives.len())
        .sum();
    within(
        "triangles",
        count,
        context.device().limits().max_blas_primitive_count,
    )?;
    let buffers: Vec<wgpu::Buffer> = part
        .geometries
        .iter()
        .map(|geometry| {
            context.buffer(
                "triangles",
                &geometry.corners,
                wgpu::BufferUsages::BLAS_INPUT,
            )
        })
        .collect::<Result<_>>()?;
    let sizes: Vec<_> = part
        .geometries
        .iter()
        .map(|geometry| wgpu::BlasTriangleGeometrySizeDescriptor {
            vertex_format: wgpu::VertexFormat::Float32x3,
            vertex_count: 3 * geometry.corners.len() as u32,
            index_format: None,
            index_count: None,
            flags: if geometry.opaque {
                GeometryFlags::OPAQUE
            } else {
                // The shader reads a texture for every candidate: once is enough.
                GeometryFlags::NO_DUPLICATE_ANY_HIT_INVOCATION
            },
        })
        .collect();
    let geometries =
        sizes
            .iter()
            .zip(&buffers)
            .map(|(size, vertex_buffer)| wgpu::BlasTriangleGeometry {
                size,
                vertex_buffer,
                first_vertex: 0,
                vertex_stride: size_of::<Vec3>() as u64,
                index_buffer: None,
                first_index: None,
                transform_buffer: None,
                transform_buffer_offset: None,
            });
    below(
        context,
        BlasGeometrySizeDescriptors::Triangles {
            descriptors: sizes.clone(),
        },
        BlasGeometries::TriangleGeometries(geometries.collect()),
    )
}

fn boxes_below(context: &Context, boxes: &[Aabb]) -> Result<wgpu::Blas> {
    within(
        "boxes",
        boxes.len(),
        context.device().limits().max_blas_primitive_count,
    )?;
    // The device may test them as roughly as it likes; the shader tests the boxes as they are.
    let padded: Vec<[Vec3; 2]> = boxes
        .iter()
        .map(|one| {
            let pad = Vec3::splat(8.0 * f32::EPSILON * one.largest_coordinate());
            [one.min - pad, one.max + pad]
        })
        .collect();
    let aabb_buffer = context.buffer("boxes", &padded, wgpu::BufferUsages::BLAS_INPUT)?;
    let size = wgpu::BlasAABBGeometrySizeDescriptor {
        primitive_count: boxes.len() as u32,
        flags: GeometryFlags::empty(),
    };
    let geometry = wgpu::BlasAabbGeometry {
        size: &size,
        stride: size_of::<[Vec3; 2]>() as u64,
        aabb_buffer: &aabb_buffer,
        primitive_offset: 0,
    };
    below(
        context,
        BlasGeometrySizeDescriptors::AABBs {
            descriptors: vec![size.clone()],
        },
        BlasGeometries::AabbGeometries(vec![geometry]),
    )
}

fn below(
    context: &Context,
    sizes: BlasGeometrySizeDescriptors,
    geometry: BlasGeometries<'_>,
) -> Result<wgpu::Blas> {
    context.check("ray query, geometry", |device| {
        let descriptor = wgpu::CreateBlasDescriptor {
            label: Some("geometry"),
            flags: Flags::PREFER_FAST_TRACE,
            update_mode: UpdateMode::Build,
        };
        let blas = device.create_blas(&descriptor, sizes);
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor {
            label: Some("geometry"),
        });
        let entry = wgpu::BlasBuildEntry {
            blas: &blas,
            geometry,
        };
        encoder.build_acceleration_structures([&entry], []);
        context.queue().submit([encoder.finish()]);
        blas
    })
}
