//! What was baked, in numbers: how much, and where it looks wrong.

use std::{collections::BTreeMap, path::PathBuf};

use glam::Vec3;
use isophote_scene::{
    Ray, Receiver, Scene, Tracer,
    reference::Quantity,
    sample::{Frame, Sampler, cosine_hemisphere},
};
use rayon::prelude::*;
use serde::Serialize;

use super::{
    layout::Layout,
    seams::seams,
    texels::{Lightmap, Texels},
    vertices::Vertices,
};
use crate::output::{PROGRAM, Program, device, memory_peak_bytes};

/// Receivers that are looked at for being inside of something, at most.
const PROBES: usize = 1 << 16;
/// Rays that each of these sends out.
const PROBE_RAYS: u32 = 16;
/// Occlusion below which a receiver is dark, and above which its neighbour is open.
const DARK: f32 = 1.0 / 255.0;
const OPEN: f32 = 0.25;
/// The cosine of how much normals may differ where a seam should not be seen.
pub(super) const SMOOTH: f32 = 0.866;

/// What is known of a bake.
#[derive(Serialize)]
pub(super) struct Report {
    #[serde(skip)]
    is_occlusion: bool,
    pub(super) seconds: Seconds,
    /// Rays traced, or look-ups in maps.
    pub(super) rays: u64,
    /// relRMSE of the values, from two independent halves of the samples.
    pub(super) noise: Option<f64>,
    /// Points that light was computed for.
    receivers: usize,
    mean: f64,
    /// Of lightmaps only.
    #[serde(skip_serializing_if = "Option::is_none")]
    coverage: Option<Coverage>,
    leaks: Option<Leaks>,
    seams: Option<Seams>,
}

#[derive(Default, Serialize)]
pub(super) struct Seconds {
    pub(super) load: f64,
    /// Of finding the points, texture coordinates included.
    pub(super) layout: f64,
    /// Of building tracers.
    pub(super) build: f64,
    pub(super) light: f64,
    pub(super) write: f64,
}

/// What of a lightmap is used.
#[derive(Serialize)]
struct Coverage {
    /// Texels on each side.
    size: u32,
    /// The set of texture coordinates, and whether it had to be made.
    set: usize,
    made: bool,
    /// Of made ones.
    charts: Option<u32>,
    /// Texels whose centres are on a surface, and their share of all.
    covered: usize,
    share: f64,
    /// Texels around these that are computed too, at the rims of charts.
    rim: usize,
    /// Texels whose centres are on two surfaces; the first one counts.
    overlapping: usize,
    /// Triangles that are too small for a texel of their own.
    triangles_without: usize,
}

/// Where light or its absence comes from the wrong side.
#[derive(Default, Serialize)]
struct Leaks {
    /// Receivers that were looked at.
    probed: usize,
    /// Of these the share that is inside of something or behind it: more than half of the rays over the hemisphere meet the
    /// back of a surface first.
    buried: f64,
    /// Receivers, of all, that see nothing at all (occlusion below 1/255) beside one that is open (above 1/4). None for light.
    dark_beside_open: Option<usize>,
}

/// How much values differ where the surface does not.
#[derive(Default, Serialize)]
pub(super) struct Seams {
    /// Pairs of values that should be equal.
    pub(super) pairs: usize,
    /// Root of the mean square of their differences: in grey levels for occlusion, over the mean value for light.
    pub(super) rms: f64,
    /// The largest difference, alike.
    pub(super) max: f64,
}

/// The report with what it was made of.
#[derive(Serialize)]
pub(super) struct Whole<'a> {
    outputs: &'a [PathBuf],
    #[serde(flatten)]
    program: Program,
    device: String,
    threads: usize,
    settings: &'a BTreeMap<String, String>,
    triangles: usize,
    #[serde(flatten)]
    report: &'a Report,
    memory_peak_bytes: Option<u64>,
}

impl Report {
    pub(super) fn new(quantity: Quantity) -> Self {
        Self {
            is_occlusion: quantity.is_occlusion(),
            seconds: Seconds::default(),
            rays: 0,
            noise: None,
            receivers: 0,
            mean: 0.0,
            coverage: None,
            leaks: None,
            seams: None,
        }
    }

    /// Looks at the values of all receivers.
    pub(super) fn receivers(
        &mut self,
        scene: &Scene,
        exact: &dyn Tracer,
        receivers: &[Receiver],
        values: &[Vec3],
    ) {
        self.receivers = receivers.len();
        let sum: f64 = values
            .iter()
            .map(|value| value.as_dvec3().element_sum() / 3.0)
            .sum();
        self.mean = sum / values.len().max(1) as f64;
        let step = receivers.len().div_ceil(PROBES).max(1);
        let probes: Vec<&Receiver> = receivers.iter().step_by(step).collect();
        let buried = probes
            .par_iter()
            .filter(|receiver| is_buried(scene, exact, receiver))
            .count();
        self.leaks = Some(Leaks {
            probed: probes.len(),
            buried: buried as f64 / probes.len().max(1) as f64,
            dark_beside_open: None,
        });
    }

    /// Looks at the values of vertices.
    pub(super) fn vertices(&mut self, scene: &Scene, vertices: &Vertices, values: &[Vec3]) {
        let instances = 0..scene.instances.len() as u32;
        let instances = instances.take(vertices.instances());
        let mut seams = Collected::default();
        let mut dark = 0;
        for instance in instances {
            let range = vertices.of_instance(instance);
            let (receivers, values) = (&vertices.receivers[range.clone()], &values[range]);
            let mut by_place: Vec<usize> = (0..receivers.len()).collect();
            let key = |i: &usize| receivers[*i].point.position.to_array().map(f32::to_bits);
            by_place.sort_by_key(key);
            for group in by_place.chunk_by(|a, b| key(a) == key(b)) {
                for pair in group.windows(2) {
                    let [a, b] = [pair[0], pair[1]].map(|i| &receivers[i].point.shading_normal);
                    if a.dot(*b) > SMOOTH {
                        seams.add(values[pair[0]], values[pair[1]]);
                    }
                }
            }
            if self.is_occlusion {
                dark += dark_vertices(scene, instance, receivers, values);
            }
        }
        self.seams = Some(seams.finish(self.is_occlusion, self.mean));
        self.set_dark(dark);
    }

    /// Looks at a lightmap.
    pub(super) fn texels(
        &mut self,
        scene: &Scene,
        (layout, texels): (&Layout, &Texels),
        (receivers, values): (&[Receiver], &[Vec3]),
        map: &Lightmap,
    ) {
        let all = f64::from(layout.size) * f64::from(layout.size);
        self.coverage = Some(Coverage {
            size: layout.size,
            set: layout.set,
            made: layout.made.is_some(),
            charts: layout.charts,
            covered: texels.covered,
            share: texels.covered as f64 / all,
            rim: texels.rim,
            overlapping: texels.overlapping,
            triangles_without: texels.without,
        });
        let seams = seams(scene, layout, map);
        self.seams = Some(seams.finish(self.is_occlusion, self.mean));
        self.set_dark(dark_texels(layout.size, receivers, values));
    }

    fn set_dark(&mut self, count: usize) {
        if let Some(leaks) = self.leaks.as_mut().filter(|_| self.is_occlusion) {
            leaks.dark_beside_open = Some(count);
        }
    }

    /// The report beside what it was made of.
    pub(super) fn whole<'a>(
        &'a self,
        outputs: &'a [PathBuf],
        scene: &Scene,
        settings: &'a BTreeMap<String, String>,
    ) -> Whole<'a> {
        Whole {
            outputs,
            program: PROGRAM,
            device: device(),
            threads: rayon::current_num_threads(),
            settings,
            triangles: scene.triangle_count(),
            report: self,
            memory_peak_bytes: memory_peak_bytes(),
        }
    }

    /// The report for people.
    pub(super) fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "{} receivers in {:.1} s, mean {:.3}",
            self.receivers, self.seconds.light, self.mean
        )];
        if let Some(coverage) = &self.coverage {
            lines.push(format!(
                "lightmap: {0}x{0} texels, {1:.1} % of them on surfaces by TEXCOORD_{2}{3}; {4} on two surfaces; {5} triangles \
                 without one",
                coverage.size,
                100.0 * coverage.share,
                coverage.set,
                coverage
                    .charts
                    .map_or_else(String::new, |charts| format!(", made of {charts} charts")),
                coverage.overlapping,
                coverage.triangles_without
            ));
        }
        if let Some(noise) = self.noise {
            lines.push(format!("noise: {:.2} % of the mean", 100.0 * noise));
        }
        if let Some(leaks) = &self.leaks {
            let dark = leaks.dark_beside_open.map_or_else(String::new, |count| {
                format!(", {count} that see nothing beside one that is open")
            });
            lines.push(format!(
                "leaks: {:.2} % of the receivers are inside or behind something{dark}",
                100.0 * leaks.buried
            ));
        }
        if let Some(seams) = self.seams.as_ref().filter(|seams| seams.pairs > 0) {
            let unit = if self.is_occlusion {
                "grey levels"
            } else {
                "of the mean"
            };
            lines.push(format!(
                "seams: {} pairs differ by {:.3} {unit} (RMS), at most {:.3}",
                seams.pairs, seams.rms, seams.max
            ));
        }
        lines
    }
}

/// Whether a receiver is inside of something: most of what it sees are backs of surfaces.
fn is_buried(scene: &Scene, exact: &dyn Tracer, receiver: &Receiver) -> bool {
    let point = &receiver.point;
    let frame = Frame::new(point.shading_normal);
    let backs = (0..PROBE_RAYS).filter(|&number| {
        let local = cosine_hemisphere(Sampler::new(0, 0, number).get_2d(0));
        let direction = frame.to_world(local);
        let ray = Ray::new(point.lifted(direction, 0.0), direction);
        exact
            .closest_hit_from(&ray, point.surface)
            .is_some_and(|hit| scene.surface_point(&hit).geometric_normal.dot(direction) > 0.0)
    });
    2 * backs.count() > PROBE_RAYS as usize
}

/// Vertices that see nothing beside one that is open, along the edges of triangles.
fn dark_vertices(scene: &Scene, instance: u32, receivers: &[Receiver], values: &[Vec3]) -> usize {
    let mesh = scene.mesh(&scene.instances[instance as usize]);
    let mut value_of = vec![f32::NAN; mesh.positions.len()];
    for (receiver, value) in receivers.iter().zip(values) {
        value_of[receiver.index as usize] = value.x;
    }
    let mut is_dark = vec![false; mesh.positions.len()];
    for triangle in &mesh.triangles {
        let open = triangle.iter().any(|&i| value_of[i as usize] > OPEN);
        for &vertex in triangle.iter().filter(|_| open) {
            is_dark[vertex as usize] |= value_of[vertex as usize] < DARK;
        }
    }
    is_dark.into_iter().filter(|dark| *dark).count()
}

/// Texels that see nothing beside one on the same surface that is open.
fn dark_texels(size: u32, receivers: &[Receiver], values: &[Vec3]) -> usize {
    let find = |index: u32| receivers.binary_search_by_key(&index, |receiver| receiver.index);
    let is_open = |dark: &Receiver, index: u32| {
        let Some(number) = find(index).ok().filter(|&number| values[number].x > OPEN) else {
            return false;
        };
        let open = &receivers[number];
        let reach = 9.0 * dark.area.max(open.area);
        dark.point.position.distance_squared(open.point.position) <= reach
    };
    (0..receivers.len())
        .into_par_iter()
        .filter(|&number| values[number].x < DARK)
        .filter(|&number| {
            let dark = &receivers[number];
            let (x, y) = (dark.index % size, dark.index / size);
            (x > 0 && is_open(dark, dark.index - 1))
                || (x + 1 < size && is_open(dark, dark.index + 1))
                || (y > 0 && is_open(dark, dark.index - size))
                || (y + 1 < size && is_open(dark, dark.index + size))
        })
        .count()
}

/// Differences, summed up.
#[derive(Default)]
pub(super) struct Collected {
    pairs: usize,
    squares: f64,
    max: f64,
}

impl Collected {
    pub(super) fn add(&mut self, a: Vec3, b: Vec3) {
        let difference = (a - b).as_dvec3();
        self.pairs += 1;
        self.squares += difference.length_squared() / 3.0;
        self.max = self.max.max(difference.abs().max_element());
    }

    pub(super) fn finish(self, is_occlusion: bool, mean: f64) -> Seams {
        let scale = if is_occlusion {
            255.0
        } else {
            1.0 / mean.max(f64::MIN_POSITIVE)
        };
        Seams {
            pairs: self.pairs,
            rms: scale * (self.squares / self.pairs.max(1) as f64).sqrt(),
            max: scale * self.max,
        }
    }
}
