//! Hybrid stage 4, the two-pass Gaussian (§5), over what belongs to surfaces that scatter diffusely.
//!
//! Neither the background nor metal may darken them: how much of a pixel they fill is filtered too, and divided by.
//! The paper's blurs across silhouettes; by default this one stops there.

use std::f32::consts::PI;

use glam::{Vec3, Vec4};
use isophote_filters::{EdgeStop, Gaussian, Guides, ImageView, Pinhole};
use isophote_scene::Camera;

use super::fragments::{Fragment, Fragments};
use crate::Result;

/// What the Gaussians of a picture have in common.
pub(super) struct Blur {
    size: [usize; 2],
    edges: Option<(Guides, EdgeStop)>,
}

impl Blur {
    pub(super) fn new(
        fragments: &Fragments,
        camera: &Camera,
        size: [u32; 2],
        edges: Option<EdgeStop>,
    ) -> Result<Self> {
        let size = size.map(|side| side as usize);
        let edges = match edges {
            None => None,
            Some(edges) => Some((guides(fragments, camera, size)?, edges)),
        };
        Ok(Self { size, edges })
    }

    /// The blurred mean of the fragments that count, in every pixel; 0 where there are none around.
    pub(super) fn over(
        &self,
        gaussian: &Gaussian,
        fragments: &Fragments,
        values: &[Vec3],
        counts: impl Fn(&Fragment) -> bool,
    ) -> Result<Vec<Vec3>> {
        let mut sums = vec![Vec4::ZERO; self.size[0] * self.size[1]];
        for (fragment, value) in fragments.all.iter().zip(values) {
            if counts(fragment) {
                sums[fragment.pixel as usize] += fragment.weight * value.extend(1.0);
            }
        }
        let [width, height] = self.size;
        let view = ImageView::new(bytemuck::cast_slice(&sums), width, height, 4)?;
        let mut blurred = vec![Vec4::ZERO; sums.len()];
        let output = bytemuck::cast_slice_mut(&mut blurred);
        match &self.edges {
            None => gaussian.apply(view, output)?,
            Some((guides, edges)) => gaussian.apply_guided(view, guides, edges, output)?,
        }
        let mean = |sum: &Vec4| {
            if sum.w > 0.0 {
                sum.truncate() / sum.w
            } else {
                Vec3::ZERO
            }
        };
        Ok(blurred.iter().map(mean).collect())
    }

    /// Blurs light straight from the lights: of diffuse surfaces the irradiance, so that textures stay sharp; all
    /// others keep the radiance they have.
    pub(super) fn lit(
        &self,
        gaussian: &Gaussian,
        fragments: &Fragments,
        mut radiance: Vec<Vec3>,
    ) -> Result<Vec<Vec3>> {
        let blurs =
            |fragment: &Fragment| fragment.is_matte() && fragment.diffuse.min_element() > 0.0;
        let irradiance: Vec<Vec3> = fragments
            .all
            .iter()
            .zip(&radiance)
            .map(|(fragment, &light)| {
                if blurs(fragment) {
                    light * PI / fragment.diffuse
                } else {
                    Vec3::ZERO
                }
            })
            .collect();
        let blurred = self.over(gaussian, fragments, &irradiance, blurs)?;
        for (fragment, light) in fragments.all.iter().zip(&mut radiance) {
            if blurs(fragment) {
                *light = fragment.diffuse / PI * blurred[fragment.pixel as usize];
            }
        }
        Ok(radiance)
    }
}

/// Normals and depths of what fills most of each pixel.
fn guides(fragments: &Fragments, camera: &Camera, [width, height]: [usize; 2]) -> Result<Guides> {
    let (pinhole, eye, forward) = pinhole(camera)?;
    let mut filled = vec![0.0; width * height];
    let mut normals = vec![Vec3::ZERO; width * height];
    let mut depths = vec![0.0; width * height];
    for fragment in &fragments.all {
        let pixel = fragment.pixel as usize;
        if fragment.weight > filled[pixel] {
            filled[pixel] = fragment.weight;
            normals[pixel] = fragment.normal();
            depths[pixel] = (fragment.point.position - eye).dot(forward);
        }
    }
    let normals = ImageView::new(bytemuck::cast_slice(&normals), width, height, 3)?;
    let depths = ImageView::new(&depths, width, height, 1)?;
    Ok(Guides::new(normals, depths, &pinhole)?)
}

/// The camera as the filters know it, where it stands, and where it looks.
pub(crate) fn pinhole(camera: &Camera) -> Result<(Pinhole, Vec3, Vec3)> {
    let seen_by = camera.pinhole();
    let axes = [seen_by.right, seen_by.up, seen_by.forward].map(|axis| axis.to_array());
    let pinhole = Pinhole::new(seen_by.eye.to_array(), axes, seen_by.yfov)?;
    Ok((pinhole, seen_by.eye, seen_by.forward))
}
