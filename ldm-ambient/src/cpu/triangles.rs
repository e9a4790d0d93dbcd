//! Stage 1, what is drawn into every map: the selected triangles in world space, eight side by side.

use glam::{Affine3A, Vec2, Vec3};
use isophote_scene::{
    Aabb, Scene, Selection, SurfaceId, WorldTriangle, check_transforms, world_triangles,
};

use super::{
    lanes::{LANES, Vectors},
    view::origin_in,
};
use crate::Result;

/// The triangles of a scene, ready to be drawn. What is transparent in places comes last, by itself.
pub struct Triangles<'a> {
    scene: &'a Scene,
    /// What positions are relative to, so that far from the world's origin they lose nothing.
    pub(crate) origin: Vec3,
    pub(crate) bounds: Aabb,
    pub(crate) blocks: Vec<Block>,
    pub(crate) masked: Vec<Masked>,
}

/// The corners of eight triangles relative to the origin: by corner, axis and lane. NaN where there are fewer.
#[derive(Clone, Copy)]
pub(crate) struct Block {
    pub(crate) corners: [Vectors; 3],
}

/// A triangle that lets light pass in places.
pub(crate) struct Masked {
    pub(crate) corners: [Vec3; 3],
    surface: SurfaceId,
}

impl<'a> Triangles<'a> {
    /// The selected triangles, the instances where `transforms` put them.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when nothing is selected, or the number of transforms is not that of the
    /// instances.
    pub fn new(scene: &'a Scene, transforms: &[Affine3A], selection: &Selection) -> Result<Self> {
        check_transforms(scene, transforms)?;
        let triangles = world_triangles(scene, transforms, selection);
        let bounds = Aabb::around(triangles.iter().flat_map(|triangle| triangle.corners));
        if bounds.is_empty() {
            return Err(isophote_scene::Error::NoGeometry {
                reason: "no triangle is selected".into(),
            }
            .into());
        }
        let origin = origin_in(&bounds);
        let (masked, opaque): (Vec<_>, Vec<_>) = triangles
            .into_iter()
            .partition(|triangle| scene.is_masked(triangle.surface));
        let around_origin =
            |triangle: &WorldTriangle| triangle.corners.map(|corner| corner - origin);
        let opaque: Vec<[Vec3; 3]> = opaque.iter().map(around_origin).collect();
        Ok(Self {
            scene,
            origin,
            bounds: Aabb {
                min: bounds.min - origin,
                max: bounds.max - origin,
            },
            blocks: opaque.chunks(LANES).map(Block::of).collect(),
            masked: masked
                .iter()
                .map(|triangle| Masked {
                    corners: around_origin(triangle),
                    surface: triangle.surface,
                })
                .collect(),
        })
    }

    /// Only those that touch a box, which is relative to the origin; none where that are most of them. Blocks are kept whole.
    pub(crate) fn near(&self, bounds: &Aabb) -> Option<Self> {
        let is_near = |block: &&Block| {
            bounds.overlaps(&Aabb::around(
                (0..LANES).flat_map(|lane| block.corners_of(lane)),
            ))
        };
        let blocks: Vec<Block> = self.blocks.iter().filter(is_near).copied().collect();
        if 4 * blocks.len() > 3 * self.blocks.len() {
            return None;
        }
        let masked = self
            .masked
            .iter()
            .filter(|triangle| bounds.overlaps(&Aabb::around(triangle.corners)));
        Some(Self {
            scene: self.scene,
            origin: self.origin,
            bounds: self.bounds,
            blocks,
            masked: masked
                .map(|triangle| Masked {
                    corners: triangle.corners,
                    surface: triangle.surface,
                })
                .collect(),
        })
    }

    /// Whether light stops at a point of a triangle.
    #[inline]
    pub(crate) fn stops(&self, triangle: &Masked, uv: Vec2) -> bool {
        self.scene.alpha_passes(triangle.surface, uv)
    }

    /// The scene they are of.
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// Bytes that it holds.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.blocks[..]) + size_of_val(&self.masked[..])
    }
}

impl Block {
    fn of(triangles: &[[Vec3; 3]]) -> Self {
        let mut corners = [[[f32::NAN; LANES]; 3]; 3];
        for (lane, triangle) in triangles.iter().enumerate() {
            for (corner, position) in triangle.iter().enumerate() {
                for axis in 0..3 {
                    corners[corner][axis][lane] = position[axis];
                }
            }
        }
        Self { corners }
    }

    /// A corner of a triangle; NaN where there is no triangle.
    #[inline(always)]
    pub(crate) fn corner(&self, corner: usize, lane: usize) -> Vec3 {
        let [x, y, z] = &self.corners[corner];
        Vec3::new(x[lane], y[lane], z[lane])
    }

    /// The corners of a triangle; none where there is no triangle.
    fn corners_of(&self, lane: usize) -> impl Iterator<Item = Vec3> + '_ {
        (0..3)
            .map(move |corner| self.corner(corner, lane))
            .filter(|corner| !corner.is_nan())
    }
}
