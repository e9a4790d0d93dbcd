//! The oracle: every ray against every triangle.

use std::sync::Arc;

use glam::{Affine3A, Vec3};

use super::{Answers, BuildTracer, Hit, Ray, Selection, SurfaceId, Tracer, triangle::Shear};
use crate::{Aabb, Error, Result, Scene};

/// Tests every triangle, so that nothing can be missed. For checking other tracers on small scenes.
#[derive(Clone, Debug)]
pub struct BruteForceTracer {
    scene: Arc<Scene>,
    selection: Selection,
    triangles: Vec<WorldTriangle>,
}

/// A triangle in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldTriangle {
    /// Metres.
    pub corners: [Vec3; 3],
    /// Which triangle it is.
    pub surface: SurfaceId,
}

/// The selected triangles in world space, in the order of instances and primitives; one transform per instance.
pub fn world_triangles(
    scene: &Scene,
    transforms: &[Affine3A],
    selection: &Selection,
) -> Vec<WorldTriangle> {
    (0..scene.instances.len())
        .zip(transforms)
        .flat_map(|(instance, transform)| {
            instance_triangles(scene, instance, *transform, selection)
        })
        .collect()
}

/// The selected triangles of one instance. Those that overflow are left out, as no ray can hit them.
pub(crate) fn instance_triangles(
    scene: &Scene,
    index: usize,
    transform: Affine3A,
    selection: &Selection,
) -> impl Iterator<Item = WorldTriangle> {
    let instance = &scene.instances[index];
    let mesh = scene.mesh(instance);
    let count = if instance.mask.contains(selection.mask) {
        mesh.triangles.len()
    } else {
        0
    };
    (0..count).filter_map(move |primitive| {
        let corners = mesh
            .corners(primitive)
            .map(|corner| transform.transform_point3(corner));
        let is_finite = corners.iter().all(|corner| corner.is_finite());
        (is_finite && is_within(selection.bounds.as_ref(), corners)).then_some(WorldTriangle {
            corners,
            surface: SurfaceId {
                instance: index as u32,
                primitive: primitive as u32,
            },
        })
    })
}

/// Whether a triangle belongs to a selection of these bounds.
pub(crate) fn is_within(bounds: Option<&Aabb>, corners: [Vec3; 3]) -> bool {
    bounds.is_none_or(|bounds| bounds.overlaps(&Aabb::around(corners)))
}

/// The transforms of a scene's instances must be one each.
///
/// # Errors
/// [`Error::Parameter`] when their number is another.
pub fn check_transforms(scene: &Scene, transforms: &[Affine3A]) -> Result<()> {
    if transforms.len() == scene.instances.len() {
        return Ok(());
    }
    Err(Error::Parameter {
        name: "the number of transforms",
        value: transforms.len().to_string(),
        expected: "there must be one per instance",
    })
}

impl BruteForceTracer {
    fn trace(&self, ray: &Ray, start: SurfaceId) -> Option<Hit> {
        if !ray.is_valid() {
            return None;
        }
        let shear = Shear::new(ray);
        let mut closest: Option<Hit> = None;
        for triangle in &self.triangles {
            let Some((t, uv)) = shear.intersect(&triangle.corners) else {
                continue;
            };
            // Of hits at the same distance the first in scene order counts, for every exact tracer.
            let limit = closest.map_or(ray.t_max, |hit| hit.t);
            if t > ray.t_min
                && t < limit
                && triangle.surface != start
                && self.scene.alpha_passes(triangle.surface, uv)
            {
                closest = Some(Hit {
                    t,
                    uv,
                    surface: triangle.surface,
                });
            }
        }
        closest
    }
}

impl Tracer for BruteForceTracer {
    fn answers(&self) -> Answers {
        Answers::Surface
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.trace(ray, SurfaceId::UNKNOWN)
    }

    fn closest_hit_from(&self, ray: &Ray, start: SurfaceId) -> Option<Hit> {
        self.trace(ray, start)
    }

    fn any_hit_from(&self, ray: &Ray, start: SurfaceId) -> bool {
        self.trace(ray, start).is_some()
    }
}

impl BuildTracer for BruteForceTracer {
    type Options = ();

    fn build(scene: &Arc<Scene>, selection: &Selection, (): &()) -> Result<Self> {
        let triangles = world_triangles(scene, &scene.transforms(), selection);
        if triangles.is_empty() {
            return Err(Error::NoGeometry {
                reason: "no triangle is selected".into(),
            });
        }
        Ok(Self {
            scene: scene.clone(),
            selection: *selection,
            triangles,
        })
    }

    fn update(&mut self, transforms: &[Affine3A]) -> Result<()> {
        check_transforms(&self.scene, transforms)?;
        self.triangles = world_triangles(&self.scene, transforms, &self.selection);
        Ok(())
    }

    fn bytes(&self) -> usize {
        size_of_val(&self.triangles[..])
    }
}
