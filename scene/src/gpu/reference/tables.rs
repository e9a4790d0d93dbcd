//! What the shaders read beside the scene: receivers, and the settings.

use bytemuck::{Pod, Zeroable};

use crate::{
    Receiver,
    gpu::view::View,
    reference::{Bounces, Materials, Normals, Quantity, Settings, Wanted},
    sample::hash_seed,
};

type Word = [u32; 4];

/// A receiver as `work.wesl` reads it.
pub(super) type ReceiverWords = [Word; 6];

const NONE: u32 = u32::MAX;

/// A record's first words: passes done, rays traced.
pub(super) const COUNTERS: u32 = 2;

/// The uniform `settings`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct GpuSettings {
    view: View,
    columns: [u32; 8],
    samples: [u32; 2],
    seed: u32,
    pub(super) record: u32,
    radiance: [u32; 2],
    irradiance: [u32; 2],
    d_max: f32,
    min_d: f32,
    path_bounces: u32,
    pbr: u32,
    flat_normals: u32,
    receivers: u32,
    padding: [u32; 2],
}

impl GpuSettings {
    /// `view` is none for receivers.
    pub(super) fn new(view: Option<View>, settings: &Settings, wanted: &Wanted) -> Self {
        let place = |quantity| {
            let column = wanted.quantities.iter().position(|one| *one == quantity);
            column.map_or(NONE, |column| COUNTERS + 3 * column as u32)
        };
        let bounces = |Bounces { first, last }: Bounces| [first, last];
        Self {
            view: view.unwrap_or(View::zeroed()),
            columns: Quantity::ALL.map(place),
            samples: settings.halves(),
            seed: hash_seed(settings.seed),
            record: COUNTERS + 3 * wanted.quantities.len() as u32,
            radiance: bounces(wanted.radiance),
            irradiance: bounces(wanted.irradiance),
            // An infinite one is the largest number.
            d_max: settings.d_max.min(f32::MAX),
            min_d: settings.min_d,
            path_bounces: settings.path_bounces,
            pbr: u32::from(settings.materials == Materials::Pbr),
            flat_normals: u32::from(settings.normals == Normals::Flat),
            receivers: u32::from(view.is_none()),
            padding: [0; 2],
        }
    }
}

pub(super) fn receiver_words(receiver: &Receiver) -> ReceiverWords {
    let point = &receiver.point;
    let with = |v: glam::Vec3, last: u32| {
        let [x, y, z] = v.to_array().map(f32::to_bits);
        [x, y, z, last]
    };
    let [a, b] = point.uvs;
    [
        with(point.position, point.error.to_bits()),
        with(point.geometric_normal, point.material),
        with(point.shading_normal, point.surface.instance),
        [a.x, a.y, b.x, b.y].map(f32::to_bits),
        point.color.to_array().map(f32::to_bits),
        [point.surface.primitive, 0, 0, 0],
    ]
}
