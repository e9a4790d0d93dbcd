//! Occlusion by what the camera sees alone.

use anyhow::{Result, ensure};
use glam::Vec3;
use isophote_ldm_ambient::cpu::{
    Points, Triangles,
    hbao::{Depths, HbaoParams, hbao},
    occlusion::Sky,
};
use isophote_scene::{Pass, Tracer};

use super::{Found, LdmTechnique};
use crate::reference::Order;

/// Directions of a pixel in HBAO, of all its points; each has at least four.
const HBAO_DIRECTIONS: u32 = 16;

impl LdmTechnique {
    pub(super) fn hbao(&self, order: &Order<'_>) -> Result<HbaoParams> {
        ensure!(
            order.settings.d_max.is_finite(),
            "--ldm-occlusion hbao needs a finite --d-max: it knows nothing beyond the picture"
        );
        Ok(HbaoParams {
            d_max: order.settings.d_max,
            // Points of a pixel share the directions.
            directions: (HBAO_DIRECTIONS / self.ldm_samples).max(4),
            ..HbaoParams::default()
        })
    }

    pub(super) fn by_hbao(
        &self,
        triangles: &Triangles<'_>,
        exact: &dyn Tracer,
        order: &Order<'_>,
        found: &mut Found,
    ) -> Result<Vec<Sky>> {
        let (scene, normals) = (triangles.scene(), order.settings.normals);
        let (samples, params) = (self.ldm_samples, self.hbao(order)?);
        let (camera, size) = (order.camera, order.size);
        let depths = Pass::timed(&mut found.passes, "depths", || {
            let depths = Depths::see(scene, exact, camera, size, &params);
            let rays = depths.as_ref().map_or(0, Depths::len) as u64;
            (depths, [rays, 0])
        })?;
        let mut skies = Vec::new();
        for sample in 0..samples {
            let points = Pass::timed(&mut found.passes, "camera", || {
                let points = Points::from_camera(scene, exact, camera, size, sample, normals);
                (points, [u64::from(size[0]) * u64::from(size[1]), 0])
            });
            let more = Pass::timed(&mut found.passes, "occlusion", || {
                (hbao(&points, &depths, sample, &params), [0, 0])
            })?;
            skies.resize(more.len(), (0.0, 0.0));
            for (sum, sky) in skies.iter_mut().zip(more) {
                *sum = (sum.0 + sky.ao, sum.1 + sky.obscurance);
            }
        }
        let mean = |(ao, obscurance): &(f32, f32)| Sky {
            ao: ao / samples as f32,
            obscurance: obscurance / samples as f32,
            bent_normal: Vec3::ZERO,
        };
        Ok(skies.iter().map(mean).collect())
    }
}
