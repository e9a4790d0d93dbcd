//! What the shaders read beside the scene: how lights are chosen, receivers, and the settings.

use bytemuck::{Pod, Zeroable};

use crate::{
    Environment, Receiver, Result, Scene,
    gpu::{Context, view::View},
    reference::{
        Bounces, Materials, Normals, Quantity, Settings, Wanted, light_sampling::emitters,
    },
    sample::hash_seed,
};

type Word = [u32; 4];

/// A receiver as `work.wesl` reads it.
pub(super) type ReceiverWords = [Word; 6];

const NONE: u32 = u32::MAX;

/// A record's first words: passes done, rays traced.
pub(super) const COUNTERS: u32 = 2;

/// `chances`: emissive triangles, rows and texels of the environment.
pub(super) struct Tables {
    pub(super) chances: wgpu::Buffer,
    emitters: u32,
    /// In words of four, or [`NONE`] where the environment is black.
    rows: u32,
    texels: u32,
}

impl Tables {
    pub(super) fn new(context: &Context, scene: &Scene) -> Result<Self> {
        let emitters = emitters(scene);
        let mut words: Vec<Word> = emitters
            .iter()
            .map(|emitter| {
                let [sum, density] = [emitter.cumulative, emitter.density()].map(f32::to_bits);
                [
                    emitter.surface.instance,
                    emitter.surface.primitive,
                    sum,
                    density,
                ]
            })
            .collect();
        let rows = words.len() as u32;
        let mut texels = rows;
        if let Environment::Map(map) = &scene.environment {
            let [width, height] = map.size().map(u64::from);
            let bytes = 16 * (words.len() as u64 + height) + 4 * width * height;
            context.check_storage_size("the environment's probabilities", bytes)?;
            words.extend(map.row_chances().map(|row| row.map(f32::to_bits)));
            texels = words.len() as u32;
            words.extend(map.texel_chances().chunks(4).map(|chunk| {
                std::array::from_fn(|i| chunk.get(i).copied().unwrap_or_default().to_bits())
            }));
        }
        context.check_storage_size("the emissive triangles", 16 * words.len() as u64)?;
        Ok(Self {
            chances: context.buffer("chances", &words, wgpu::BufferUsages::STORAGE)?,
            emitters: emitters.len() as u32,
            rows: if scene.environment.is_black() {
                NONE
            } else {
                rows
            },
            texels,
        })
    }

    /// Whether a ray can find light: on an emissive triangle or outside the scene.
    pub(super) fn can_be_hit(&self) -> bool {
        self.emitters > 0 || self.rows != NONE
    }
}

/// What `scene::reference::lit` and `scene::reference::light_sampling` read of a scene's lights, for techniques that
/// light surfaces as the integrators do.
///
/// In a technique's group 0, binding 0 is the uniform buffer [`settings`](Self::settings) and binding 4 the read-only
/// storage buffer [`chances`](Self::chances).
#[derive(Clone, Debug)]
pub struct LightTables {
    settings: wgpu::Buffer,
    chances: wgpu::Buffer,
}

impl LightTables {
    /// Uploads what is known of a scene's lights.
    ///
    /// # Errors
    /// [`Error::GpuLimit`](crate::Error::GpuLimit) when it is larger than what the device binds,
    /// [`Error::Gpu`](crate::Error::Gpu) when memory is out.
    pub fn new(context: &Context, scene: &Scene, materials: Materials) -> Result<Self> {
        let tables = Tables::new(context, scene)?;
        let settings = GpuSettings {
            columns: [NONE; 8],
            pbr: u32::from(materials == Materials::Pbr),
            emitters: tables.emitters,
            rows: tables.rows,
            texels: tables.texels,
            ..GpuSettings::zeroed()
        };
        let usage = wgpu::BufferUsages::UNIFORM;
        Ok(Self {
            settings: context.buffer("light settings", &[settings], usage)?,
            chances: tables.chances,
        })
    }

    /// Binding 0.
    pub fn settings(&self) -> &wgpu::Buffer {
        &self.settings
    }

    /// Binding 4.
    pub fn chances(&self) -> &wgpu::Buffer {
        &self.chances
    }
}

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
    emitters: u32,
    rows: u32,
    texels: u32,
    receivers: [u32; 4],
}

impl GpuSettings {
    /// `view` is none for receivers.
    pub(super) fn new(
        view: Option<View>,
        settings: &Settings,
        wanted: &Wanted,
        tables: &Tables,
    ) -> Self {
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
            emitters: tables.emitters,
            rows: tables.rows,
            texels: tables.texels,
            receivers: [u32::from(view.is_none()), 0, 0, 0],
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
