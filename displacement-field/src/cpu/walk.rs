//! Rays through many placed fields: one a lane, each with its own way through the tree over the spheres.
//!
//! As soon as a ray is answered the next one takes its lane, so that all lanes are busy until none is left.

use std::sync::Arc;

use isophote_scene::{Ray, SurfaceId};

use super::{
    field::Field,
    look_up::LookUp,
    placed::{Many, Placed, columns, hits},
    top::{Top, Walk},
};
use crate::lanes::Lanes;

/// What rays are traced through.
#[derive(Clone, Copy)]
pub(crate) struct Fields<'a> {
    pub(crate) kinds: &'a [Arc<Field>],
    pub(crate) placed: &'a [Placed],
    pub(crate) top: &'a Top,
    pub(crate) look_up: LookUp,
}

/// A ray on its way.
#[derive(Clone, Copy, Default)]
struct Traveller {
    /// `None` where none is left.
    ray: Option<usize>,
    walk: Walk,
    /// The nearest hit so far; infinite without one.
    found: f32,
}

impl Fields<'_> {
    /// Calls with the number of each ray and where it hits, infinite where it does not. `L` rays, no more than `N`, travel
    /// together; `W` are the lanes that boxes are tested by. `start` is of all rays.
    #[inline(always)]
    pub(crate) fn trace<const ANY: bool, const N: usize, L: Lanes, W: Lanes>(
        &self,
        rays: &[Ray],
        start: SurfaceId,
        answer: &mut impl FnMut(usize, f32),
    ) {
        let mut next = 0;
        let mut travellers = [Traveller::default(); N];
        loop {
            // A lane without a ray asks what the answer is not used of.
            let (mut at, mut ray, mut end) = ([0_usize; N], [0_usize; N], [0.0; N]);
            let mut busy = false;
            for lane in 0..L::COUNT {
                let traveller = &mut travellers[lane];
                if let Some(placed) = self.next::<W>(rays, traveller, &mut next, answer) {
                    at[lane] = placed;
                    busy = true;
                }
                ray[lane] = traveller.ray.unwrap_or(0);
                end[lane] = traveller.found;
            }
            if !busy {
                return;
            }
            let many = Many {
                kinds: self.kinds,
                placed: L::array(
                    #[inline(always)]
                    |lane| &self.placed[at[lane]],
                ),
                look_up: self.look_up,
            };
            let mut lanes = columns::<L>(
                #[inline(always)]
                |lane| &rays[ray[lane]],
            );
            lanes[1][3] = lanes[1][3].min(L::load(&end));
            let own = L::array(
                #[inline(always)]
                |lane| self.placed[at[lane]].instance == start.instance,
            );
            let hits = hits::<ANY, L>(&many, lanes, own).to_array();
            for lane in 0..L::COUNT {
                let traveller = &mut travellers[lane];
                if hits[lane] < traveller.found {
                    traveller.found = hits[lane];
                    traveller
                        .walk
                        .shorten(if ANY { f32::NEG_INFINITY } else { hits[lane] });
                }
            }
        }
    }

    /// The next sphere of a lane's ray, or of the next ray; `None` where no ray is left.
    #[inline(always)]
    fn next<W: Lanes>(
        &self,
        rays: &[Ray],
        traveller: &mut Traveller,
        next: &mut usize,
        answer: &mut impl FnMut(usize, f32),
    ) -> Option<usize> {
        loop {
            if let Some(ray) = traveller.ray {
                if let Some(placed) = self.top.next::<W>(&mut traveller.walk) {
                    return Some(placed);
                }
                answer(ray, traveller.found);
            }
            let ray = rays.get(*next);
            traveller.ray = ray.map(|_| *next);
            traveller.found = f32::INFINITY;
            self.top.start(&mut traveller.walk, ray?);
            *next += 1;
        }
    }
}
