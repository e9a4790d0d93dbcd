//! A tree in buffers that the shader walks itself: exact, and works on every adapter.
//!
//! The tree is the CPU's ([`BvhTracer`](crate::BvhTracer)) with leaves of up to three triangles; `encode` packs a node
//! into 80 bytes.

mod encode;

use std::sync::Arc;

use glam::Affine3A;

use self::encode::{Encoded, MAX_DEPTH};
use super::{BuildGpuTracer, GpuTracer, storage_entries};
use crate::{
    Aabb, Answers, Error, Result, Scene, Selection,
    gpu::{Context, upload::entries},
    trace::{
        brute_force::{WorldTriangle, check_transforms, world_triangles},
        bvh::{
            binary::BinaryTree,
            wide::{Costs, WideTree},
        },
    },
};

/// Finds what [`BvhTracer`](crate::BvhTracer) finds, in a shader. Binds two storage buffers.
#[derive(Debug)]
pub struct ComputeBvhTracer {
    scene: Arc<Scene>,
    selection: Selection,
    layout: wgpu::BindGroupLayout,
    bind_group: wgpu::BindGroup,
    bytes: u64,
}

impl GpuTracer for ComputeBvhTracer {
    fn name(&self) -> &'static str {
        "compute-bvh"
    }

    fn answers(&self) -> Answers {
        Answers::Surface
    }

    fn module(&self) -> &'static str {
        "scene::tracer::compute_bvh"
    }

    fn bind_group_layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    fn bind_group(&self) -> &wgpu::BindGroup {
        &self.bind_group
    }
}

impl BuildGpuTracer for ComputeBvhTracer {
    type Options = ();

    fn build(
        context: &Context,
        scene: &Arc<Scene>,
        selection: &Selection,
        (): &(),
    ) -> Result<Self> {
        let layout = context.check("compute BVH", |device| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("compute BVH"),
                entries: &storage_entries(2),
            })
        })?;
        let (bind_group, bytes) = upload(context, &layout, scene, selection, &scene.transforms())?;
        Ok(Self {
            scene: scene.clone(),
            selection: *selection,
            layout,
            bind_group,
            bytes,
        })
    }

    fn update(&mut self, context: &Context, transforms: &[Affine3A]) -> Result<()> {
        check_transforms(&self.scene, transforms)?;
        (self.bind_group, self.bytes) = upload(
            context,
            &self.layout,
            &self.scene,
            &self.selection,
            transforms,
        )?;
        Ok(())
    }

    fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// Builds the tree and puts it where the shader finds it.
fn upload(
    context: &Context,
    layout: &wgpu::BindGroupLayout,
    scene: &Scene,
    selection: &Selection,
    transforms: &[Affine3A],
) -> Result<(wgpu::BindGroup, u64)> {
    let triangles = world_triangles(scene, transforms, selection);
    if triangles.is_empty() {
        return Err(Error::NoGeometry {
            reason: "no triangle is selected".into(),
        });
    }
    context.check_storage_size("the tree's triangles", 48 * triangles.len() as u64)?;
    let encoded = tree(&triangles);
    context.check_storage_size("the tree's nodes", size_of_val(&encoded.nodes[..]) as u64)?;
    let faces: Vec<[[u32; 4]; 3]> = encoded
        .items
        .iter()
        .map(|&item| face(scene, &triangles[item as usize]))
        .collect();
    let nodes = context.buffer("tree nodes", &encoded.nodes, wgpu::BufferUsages::STORAGE)?;
    let faces = context.buffer("tree triangles", &faces, wgpu::BufferUsages::STORAGE)?;
    let bind_group = context.check("compute BVH", |device| {
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("compute BVH"),
            layout,
            entries: &entries([nodes.as_entire_binding(), faces.as_entire_binding()]),
        })
    })?;
    Ok((bind_group, nodes.size() + faces.size()))
}

fn tree(triangles: &[WorldTriangle]) -> Encoded {
    let boxes: Vec<Aabb> = triangles
        .iter()
        .map(|triangle| Aabb::around(triangle.corners))
        .collect();
    let encoded = encode_tree(&BinaryTree::new(&boxes, 0.2));
    if encoded.depth <= MAX_DEPTH {
        return encoded;
    }
    encode_tree(&BinaryTree::balanced(&boxes))
}

fn encode_tree(binary: &BinaryTree) -> Encoded {
    let costs = Costs {
        node: 1.0,
        leaf_items: encode::LEAF_ITEMS as u32,
    };
    let mut leaves = Vec::new();
    let wide = WideTree::collapse(binary, &costs, &mut |items| {
        leaves.push(items.to_vec());
        leaves.len() - 1
    });
    Encoded::new(&wide, &leaves)
}

/// What the shader knows of a triangle.
fn face(scene: &Scene, triangle: &WorldTriangle) -> [[u32; 4]; 3] {
    let masked = u32::from(scene.is_masked(triangle.surface));
    let extras = [
        triangle.surface.instance,
        triangle.surface.primitive,
        masked,
    ];
    let mut extras = extras.into_iter();
    triangle.corners.map(|corner| {
        let [x, y, z] = corner.to_array().map(f32::to_bits);
        [x, y, z, extras.next().unwrap_or_default()]
    })
}
