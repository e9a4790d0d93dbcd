//! Renders pair after pair, and measures what comes of each.

use std::{collections::BTreeMap, sync::Arc};

use anyhow::{Context, Result, ensure};
use glam::Vec3;
use isophote_scene::{
    Agreement, Camera, Image, Ray, Scene, Selection,
    reference::{Quantity, Settings},
};

use super::{MatrixArgs, Measured, Outcome, Row};
use crate::{
    metrics::Errors,
    output::{Voice, advance, timed},
    pairs::Pair,
    rays::{self, RayKind},
    reference::{Ground, Order},
    tracers::{AnyTracer, Choice, Device, Plan, TracerChoice},
};

/// Triangles up to which every ray can be tested against every triangle in a reasonable time.
const BRUTE_FORCE: usize = 1000;
/// Rays by which leaks are found.
const PROBES: usize = 1 << 16;

/// What all pairs have in common.
pub(super) struct Lab<'a> {
    args: &'a MatrixArgs,
    scene: &'a Arc<Scene>,
    camera: &'a Camera,
    selection: &'a Selection,
    voice: Voice,
    /// What every picture is compared with, and its noise.
    references: Vec<(Quantity, Vec<Vec3>, f32)>,
    /// Rays, and whether they hit anything.
    probes: Vec<Ray>,
    truth: Vec<bool>,
}

impl<'a> Lab<'a> {
    pub(super) fn new(
        args: &'a MatrixArgs,
        scene: &'a Arc<Scene>,
        camera: &'a Camera,
        selection: &'a Selection,
        voice: Voice,
    ) -> Result<Self> {
        let mut lab = Self {
            args,
            scene,
            camera,
            selection,
            voice,
            references: Vec::new(),
            probes: Vec::new(),
            truth: Vec::new(),
        };
        let exact = Ground::build(Choice::Cpu(TracerChoice::Bvh), None, &lab.plan())?;
        voice.note("rendering what all are compared with");
        let settings = lab.settings(args.reference_spp, args.seed.wrapping_add(1));
        let bar = voice.bar();
        let made = exact.render(scene, lab.order(&args.quantity, &settings), &advance(&bar));
        bar.finish_and_clear();
        for estimate in made?.render.estimates {
            lab.references
                .push((estimate.quantity, estimate.values, estimate.noise));
        }
        let tracers = exact.on_cpu().context("the CPU's tracer is on the CPU")?;
        let (kind, seed) = (RayKind::Diffuse, args.seed);
        lab.probes = rays::make(kind, scene, tracers.exact, camera, PROBES, seed)?;
        lab.truth = exact.any_hits(&lab.probes)?;
        Ok(lab)
    }

    fn plan(&self) -> Plan<'_> {
        Plan {
            args: &self.args.tracer_args,
            scene: self.scene,
            selection: self.selection,
            camera: self.camera,
        }
    }

    fn settings(&self, samples: u32, seed: u64) -> Settings {
        Settings {
            d_max: self.args.d_max,
            samples,
            seed,
            ..Settings::default()
        }
    }

    fn order<'b>(&'b self, quantities: &'b [Quantity], settings: &'b Settings) -> Order<'b> {
        Order {
            camera: self.camera,
            size: self.args.size,
            quantities,
            settings,
            selection: self.selection,
            min_d: None,
            maps: self.args.tracer_args.depth_maps.params(),
        }
    }

    pub(super) fn noise(&self) -> BTreeMap<&'static str, f32> {
        let references = self.references.iter();
        references
            .map(|(quantity, _, noise)| (quantity.name(), *noise))
            .collect()
    }

    fn pairs(&self) -> impl Iterator<Item = Pair> + '_ {
        let on_gpu = has_adapter();
        self.args.pairs().filter(move |pair| {
            (self.args.device != Device::Auto || on_gpu || pair.device == Device::Cpu)
                && (pair.tracer != AnyTracer::BruteForce
                    || !self.args.tracer.is_empty()
                    || self.scene.triangle_count() <= BRUTE_FORCE)
        })
    }

    /// A row for every pair and quantity. Each tracer is built once.
    pub(super) fn rows(&self) -> Vec<Row> {
        let pairs: Vec<Pair> = self.pairs().collect();
        let mut rows = Vec::new();
        let mut grounds: Vec<(AnyTracer, Device)> = pairs
            .iter()
            .map(|pair| (pair.tracer, pair.device))
            .collect();
        grounds.sort_by_key(|&(tracer, device)| (device == Device::Gpu, tracer as u8));
        grounds.dedup();
        for (tracer, device) in grounds {
            let mut built = None;
            let same = |pair: &&Pair| (pair.tracer, pair.device) == (tracer, device);
            for &pair in pairs.iter().filter(same) {
                for &quantity in &self.args.quantity {
                    let outcome = match pair.check(&self.args.techniques, quantity) {
                        Err(error) => Outcome::Refused(error.to_string()),
                        Ok(choice) => {
                            let built = built.get_or_insert_with(|| self.build(choice));
                            self.outcome(pair, quantity, built)
                        }
                    };
                    let row = Row::new(pair, quantity, outcome);
                    self.tell(&row);
                    rows.push(row);
                }
            }
        }
        rows
    }

    fn build(&self, choice: Choice) -> Result<Built> {
        let wheel = self.voice.wheel("building a tracer");
        let (ground, seconds) = timed(|| Ground::build(choice, None, &self.plan()));
        drop(wheel);
        let ground = ground?;
        let found = Agreement::of_occlusion(&ground.any_hits(&self.probes)?, &self.truth);
        Ok(Built {
            ground,
            seconds,
            leak_rate: found.leak_rate(),
        })
    }

    fn outcome(&self, pair: Pair, quantity: Quantity, built: &Result<Built>) -> Outcome {
        let measured = match built {
            Ok(built) => self.measure(pair, quantity, built),
            Err(error) => return Outcome::Failed(format!("{error:#}")),
        };
        measured.map_or_else(
            |error| Outcome::Failed(format!("{error:#}")),
            Outcome::Measured,
        )
    }

    fn measure(&self, pair: Pair, quantity: Quantity, built: &Built) -> Result<Measured> {
        let technique = self.args.techniques.chosen(pair.technique);
        let settings = self.settings(self.args.spp, self.args.seed);
        let quantities = [quantity];
        let order = self.order(&quantities, &settings);
        let bar = self.voice.bar();
        let (made, render_seconds) =
            timed(|| technique.render(self.scene, &built.ground, order, &advance(&bar)));
        bar.finish_and_clear();
        let mut values = made?
            .render
            .estimates
            .into_iter()
            .map(|estimate| estimate.values);
        let values = values.next_back().context("nothing was rendered")?;
        ensure!(
            values.iter().all(|pixel| pixel.is_finite()),
            "the picture has pixels that are NaN or infinite"
        );
        let mut references = self.references.iter();
        let (_, reference, _) = references
            .find(|(of, ..)| *of == quantity)
            .context("there is no reference")?;
        let errors = Errors::of(&values, reference);
        let has_own_tracer = technique.has_own_tracer();
        Ok(Measured {
            errors,
            build_seconds: built.seconds,
            render_seconds,
            tracer_bytes: built.ground.bytes(),
            leak_rate: if has_own_tracer {
                f64::NAN
            } else {
                built.leak_rate
            },
            reference_seconds: None,
            is_black: errors.mean_test < 0.01 * errors.mean_reference,
            picture: self.save(pair, quantity, &values)?,
        })
    }

    /// Writes the picture beside the page.
    fn save(&self, pair: Pair, quantity: Quantity, values: &[Vec3]) -> Result<Option<String>> {
        let Some(folder) = &self.args.output else {
            return Ok(None);
        };
        let device = device_name(pair.device);
        let name = format!(
            "{}-{}-{device}-{quantity}.png",
            pair.technique.name(),
            pair.tracer.name()
        );
        let [width, height] = self.args.size;
        let mut image = Image::new(width, height);
        image.push_layer("", "RGB", values);
        image.save_png(folder.join(&name), 0.0)?;
        Ok(Some(name))
    }

    fn tell(&self, row: &Row) {
        let Row {
            technique,
            tracer,
            device,
            quantity,
            ..
        } = row;
        let what = format!("{quantity} by {technique} over {tracer} on the {device}");
        match &row.outcome {
            Outcome::Measured(measured) => {
                self.voice
                    .note(format_args!("{what}: {:.1} s", measured.seconds()));
            }
            Outcome::Refused(_) => {}
            Outcome::Failed(why) => self.voice.warning(format_args!("{what}: {why}")),
        }
    }
}

/// A tracer that is ready.
struct Built {
    ground: Ground,
    seconds: f64,
    leak_rate: f64,
}

impl Row {
    fn new(pair: Pair, quantity: Quantity, outcome: Outcome) -> Self {
        Self {
            technique: pair.technique.name(),
            tracer: pair.tracer.name(),
            device: device_name(pair.device),
            quantity: quantity.name(),
            is_occlusion: quantity.is_occlusion(),
            outcome,
        }
    }
}

fn device_name(device: Device) -> &'static str {
    match device {
        Device::Gpu => "gpu",
        _ => "cpu",
    }
}

#[cfg(feature = "gpu")]
fn has_adapter() -> bool {
    !isophote_scene::gpu::adapters().is_empty()
}

#[cfg(not(feature = "gpu"))]
fn has_adapter() -> bool {
    false
}
