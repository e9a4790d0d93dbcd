//! Stage 6 over a sequence of pictures: irradiance of earlier ones, carried to where it is seen now.
//!
//! Every picture shoots other light paths, so that the mean of n pictures has the light of n times as many.

use glam::Vec3;
use isophote_filters::{Guides, ImageView, Temporal, TemporalParams, camera_motion};
use isophote_scene::GBuffer;

use super::filter::pinhole;
use crate::Result;

/// Irradiance that the pictures of a sequence have gathered so far; see
/// [`InstantGi::render_next`](crate::InstantGi::render_next).
#[derive(Clone, Debug)]
pub struct History {
    temporal: Temporal,
    light: isophote_filters::History,
    before: Option<isophote_filters::Pinhole>,
    pictures: u64,
}

impl History {
    /// An empty one, whose mean becomes an exponential one after so many pictures: the more, the longer light that changed
    /// is seen.
    ///
    /// # Errors
    /// [`Error::Filter`](crate::Error::Filter) unless `most` is 1 to 65,536.
    pub fn new(most: u32) -> Result<Self> {
        let params = TemporalParams {
            max_pictures: most,
            ..TemporalParams::default()
        };
        Ok(Self {
            temporal: Temporal::new(params)?,
            light: isophote_filters::History::default(),
            before: None,
            pictures: 0,
        })
    }

    /// Pictures so far.
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// Adds the irradiance of a picture, and returns what all of them know of what it sees.
    pub(super) fn add(
        &mut self,
        irradiance: &[Vec3],
        seen: &GBuffer,
        eye: &isophote_scene::Pinhole,
    ) -> Result<Vec<Vec3>> {
        let [width, height] = seen.size.map(|side| side as usize);
        let (normals, depths) = seen.normals_and_depths(eye);
        let now = pinhole(eye)?;
        let depths = ImageView::new(&depths, width, height, 1)?;
        let normals = ImageView::new(bytemuck::cast_slice(&normals), width, height, 3)?;
        let motion = camera_motion(depths, &now, self.before.as_ref().unwrap_or(&now))?;
        self.temporal.apply(
            ImageView::new(bytemuck::cast_slice(irradiance), width, height, 3)?,
            Guides::new(normals, depths, &now)?,
            ImageView::new(&motion, width, height, 3)?,
            &mut self.light,
        )?;
        self.before = Some(now);
        self.pictures += 1;
        let values = self.light.values();
        Ok(values.map_or_else(Vec::new, |values| {
            let values = values.data().chunks_exact(3);
            values.map(Vec3::from_slice).collect()
        }))
    }
}
