//! A tree in buffers that the shader walks itself: exact, and works on every adapter.
//!
//! The tree is the CPU's ([`BvhTracer`](crate::BvhTracer)) with leaves of up to three triangles; `encode` packs a node
//! into 80 bytes.

mod encode;

use std::sync::Arc;

use glam::Affine3A;

use self::encode::{Encoded, MAX_DEPTH, Words};
use super::{
    BuildGpuTracer, GpuTracer,
    binding::{TracerBinding, TracerTable},
};
use crate::{
    Aabb, Answers, Error, Leaves, Result, Scene, Selection,
    gpu::Context,
    trace::{
        brute_force::{WorldTriangle, check_transforms, world_triangles},
        bvh::{
            binary::BinaryTree,
            wide::{Costs, WideTree},
        },
    },
};

/// Finds what [`BvhTracer`](crate::BvhTracer) finds, with triangles or boxes in its leaves, in a shader. Binds two storage
/// buffers, or two textures.
#[derive(Clone, Debug)]
pub struct ComputeBvhTracer {
    scene: Arc<Scene>,
    selection: Selection,
    leaves: Leaves,
    binding: TracerBinding,
}

impl ComputeBvhTracer {
    /// As [`build`](BuildGpuTracer::build), with triangles or the boxes around them in the leaves of one and the same tree.
    ///
    /// # Errors
    /// As [`build`](BuildGpuTracer::build).
    pub fn build_with(
        context: &Context,
        scene: &Arc<Scene>,
        selection: &Selection,
        leaves: Leaves,
    ) -> Result<Self> {
        let tree = Tree::new(scene, selection, &scene.transforms())?;
        Ok(Self {
            binding: TracerBinding::new(context, "compute BVH", None, &tree.tables())?,
            scene: scene.clone(),
            selection: *selection,
            leaves,
        })
    }

    /// The same tree, asked for other leaves: nothing is built or copied, until one of the two is moved.
    #[must_use]
    pub fn with_leaves(&self, leaves: Leaves) -> Self {
        Self {
            leaves,
            ..self.clone()
        }
    }
}

impl GpuTracer for ComputeBvhTracer {
    fn name(&self) -> &'static str {
        match self.leaves {
            Leaves::Triangles => "compute-bvh",
            Leaves::Boxes => "compute-boxes",
        }
    }

    fn answers(&self) -> Answers {
        match self.leaves {
            Leaves::Triangles => Answers::Surface,
            Leaves::Boxes => Answers::Distance,
        }
    }

    fn module(&self) -> &'static str {
        "scene::tracer::compute_bvh"
    }

    fn shader_flags(&self) -> &[&'static str] {
        match (self.leaves, self.binding.shader_flags()) {
            (Leaves::Triangles, flags) => flags,
            (Leaves::Boxes, []) => &["box_leaves"],
            (Leaves::Boxes, _) => &["box_leaves", "tracer_in_textures"],
        }
    }

    fn bind_group_layout(&self) -> &wgpu::BindGroupLayout {
        self.binding.layout()
    }

    fn bind_group(&self) -> &wgpu::BindGroup {
        self.binding.group()
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
        Self::build_with(context, scene, selection, Leaves::Triangles)
    }

    fn update(&mut self, context: &Context, transforms: &[Affine3A]) -> Result<()> {
        check_transforms(&self.scene, transforms)?;
        let tree = Tree::new(&self.scene, &self.selection, transforms)?;
        self.binding.replace(context, None, &tree.tables())
    }

    fn bytes(&self) -> u64 {
        self.binding.bytes()
    }
}

/// What the shader walks.
struct Tree {
    nodes: Vec<Words>,
    /// The triangles of all leaves.
    faces: Vec<[[u32; 4]; 3]>,
}

impl Tree {
    fn new(scene: &Scene, selection: &Selection, transforms: &[Affine3A]) -> Result<Self> {
        let triangles = world_triangles(scene, transforms, selection);
        if triangles.is_empty() {
            return Err(Error::NoGeometry {
                reason: "no triangle is selected".into(),
            });
        }
        let Encoded { nodes, items, .. } = encode(&triangles);
        let faces = items
            .iter()
            .map(|&item| face(scene, &triangles[item as usize]))
            .collect();
        Ok(Self { nodes, faces })
    }

    fn tables(&self) -> [TracerTable<'_>; 2] {
        [
            ("the tree's nodes", bytemuck::cast_slice(&self.nodes)),
            ("the tree's triangles", bytemuck::cast_slice(&self.faces)),
        ]
    }
}

fn encode(triangles: &[WorldTriangle]) -> Encoded {
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
