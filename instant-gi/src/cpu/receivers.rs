//! The light of the virtual point lights at points that are no pixels: vertices, the texels of a lightmap.

use std::sync::atomic::AtomicU64;

use glam::Vec3;
use isophote_scene::{
    Receivers, Tracer,
    reference::{Normals, Progress},
};
use rayon::prelude::*;

use super::{
    InstantGi, Meter,
    emission::Vpl,
    indirect::{Gather, Receiver, Share},
    maps::Maps,
};
use crate::{Error, Result};

/// Points that are lit together.
const CHUNK: usize = 256;

/// The virtual point lights of a scene, and what they see where shadow maps tell.
pub struct Shot {
    pub(super) vpls: Vec<Vpl>,
    pub(super) maps: Option<Maps>,
    rays: u64,
}

impl Shot {
    /// The lights, in the order of their paths; where points pick some of them, along a curve through space.
    pub fn vpls(&self) -> &[Vpl] {
        &self.vpls
    }

    /// Rays of the light paths and of shadow maps.
    pub fn rays(&self) -> u64 {
        self.rays
    }
}

impl<E: Tracer + ?Sized, S: Tracer + ?Sized> InstantGi<'_, E, S> {
    /// Shoots the light paths once, for any number of [`irradiance`](Self::irradiance).
    ///
    /// # Errors
    /// [`Error::Parameter`] where lights are to be kept for a picture ([`kept`](crate::GiParams::kept)), since there is none;
    /// [`Error::TooLarge`] for shadow maps of more than 4 GiB.
    pub fn shoot(&self) -> Result<Shot> {
        if self.params.kept > 0 {
            return Err(Error::Parameter {
                name: "kept",
                value: self.params.kept.to_string(),
                expected: "lights can be kept for a picture only: it must be 0",
            });
        }
        let (vpls, rays) = self.paths(&self.params);
        let (maps, [map_rays, _]) = self.maps(&vpls);
        Ok(Shot {
            vpls,
            maps: maps?,
            rays: rays + map_rays,
        })
    }

    /// Irradiance at points, W/m², in their order; and the number of rays. A point's random numbers go by its
    /// [`index`](isophote_scene::Receiver::index), so it does not matter which points are lit together.
    pub fn irradiance(
        &self,
        shot: &Shot,
        receivers: &Receivers,
        normals: Normals,
        progress: &dyn Progress,
    ) -> (Vec<Vec3>, u64) {
        let gather = Gather::new(
            self.scene,
            self.tracers.secondary,
            &self.direct,
            &shot.vpls,
            shot.maps.as_ref().into(),
            &self.params,
        );
        let meter = Meter {
            progress,
            done: AtomicU64::new(0),
            total: receivers.points.len() as u64,
        };
        let mut light = vec![Vec3::ZERO; receivers.points.len()];
        let chunks = light.par_chunks_mut(CHUNK);
        let rays = chunks
            .zip(receivers.points.par_chunks(CHUNK))
            .map(|(light, points)| {
                let receivers: Vec<Receiver<'_>> = points
                    .iter()
                    .map(|receiver| Receiver {
                        point: &receiver.point,
                        normal: match normals {
                            Normals::Smooth => receiver.point.shading_normal,
                            Normals::Flat => receiver.point.geometric_normal,
                        },
                        parts: 1,
                        stream: receiver.index,
                    })
                    .collect();
                let rays = gather.irradiance(&receivers, &Share::ALL, light);
                meter.advance(points.len());
                rays
            })
            .sum();
        (light, rays)
    }
}
