//! The computing: tracers are built, pieces computed, and what came of it is told.

use std::{collections::BTreeMap, sync::Arc};

use anyhow::{Result, bail};
use isophote_scene::{Camera, Receiver, Scene, Selection, Tracer, reference::Tracers};

use super::{
    BakeArgs,
    light::{Light, Lit},
    parts::Fingerprint,
    report::Report,
};
use crate::{
    output::{Voice, print_json, timed},
    reference::Ground,
    tracers::{Device, Plan, choose},
};

/// Everything that is ready when light is computed.
pub(super) struct Work<'a> {
    pub(super) args: &'a BakeArgs,
    pub(super) scene: &'a Arc<Scene>,
    pub(super) ground: Ground,
    pub(super) fingerprint: Fingerprint,
    pub(super) voice: Voice,
}

impl Work<'_> {
    fn selection(args: &BakeArgs) -> Selection {
        Selection {
            bounds: args.changes.bounds(),
            ..Selection::default()
        }
    }

    /// Builds the tracers.
    pub(super) fn ground(
        args: &BakeArgs,
        scene: &Arc<Scene>,
        report: &mut Report,
        voice: Voice,
    ) -> Result<Ground> {
        let choice = choose(Device::Cpu, args.tracer, None)?;
        args.tracer_args.check(choice)?;
        let camera = Camera::framing(&scene.bounds());
        let selection = Self::selection(args);
        let plan = Plan {
            args: &args.tracer_args,
            scene,
            selection: &selection,
            camera: &camera,
        };
        let (ground, seconds) = timed(|| {
            let _wheel = voice.wheel("building the tracer");
            Ground::build(choice, None, &plan)
        });
        report.seconds.build = seconds;
        ground
    }

    fn tracers(&self) -> Result<Tracers<'_, dyn Tracer, dyn Tracer>> {
        match self.ground.on_cpu() {
            Some(tracers) => Ok(tracers),
            None => bail!("baking runs on the CPU"),
        }
    }

    /// The tracer that is exact.
    pub(super) fn exact(&self) -> Result<&dyn Tracer> {
        Ok(self.tracers()?.exact)
    }

    /// Computes some pieces.
    pub(super) fn compute(
        &self,
        receivers: &[Receiver],
        order: &[u32],
        pieces: &[usize],
        report: &mut Report,
    ) -> Result<Lit> {
        let args = self.args;
        let selection = Self::selection(args);
        let light = Light {
            scene: self.scene,
            tracers: self.tracers()?,
            selection: &selection,
            technique: args.technique,
            quantity: args.quantity,
            settings: args.settings(),
            maps: args.tracer_args.depth_maps.params(),
            techniques: args.techniques,
        };
        let bar = self.voice.bar();
        let advance = |done: u64, total: u64| {
            bar.set_length(total);
            bar.set_position(bar.position().max(done));
        };
        let (lit, seconds) = timed(|| light.compute(receivers, order, pieces, &advance));
        bar.finish_and_clear();
        let lit = lit?;
        report.seconds.light = seconds;
        report.rays = lit.rays;
        report.noise = lit.noise;
        Ok(lit)
    }

    /// Says what was found.
    pub(super) fn tell(&self, report: &Report, settings: &BTreeMap<String, String>) -> Result<()> {
        if self.args.json {
            return print_json(&report.whole(&self.args.output, self.scene, settings));
        }
        report.lines().iter().for_each(|line| self.voice.note(line));
        Ok(())
    }
}
