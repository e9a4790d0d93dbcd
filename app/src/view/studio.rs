//! Makes pictures of wishes, and keeps what the next one can use: the scene, its tracers, what was moved where.

use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use anyhow::{Context, Result};
use glam::Vec3;
use isophote_scene::{
    Image, Scene,
    reference::{Progress, Render},
};

use super::flags::{Values, Wish};
use crate::{
    output::{Voice, timed},
    picture::{Shot, image},
    reference::{Ground, Made},
    tracers::Choice,
};

/// Tracers that are kept: those of the picture, of the right answer, and of what was last seen.
const KEPT: usize = 3;

/// A picture by a technique.
pub(super) struct Picture {
    pub(super) id: u64,
    pub(super) wish: Arc<Wish>,
    pub(super) shot: Arc<Shot>,
    pub(super) made: Made,
    /// As in the header of its file.
    stored: BTreeMap<String, String>,
    pub(super) device: String,
    /// That it took, without the tracer.
    pub(super) seconds: f64,
    /// That the tracer took, where it was not there yet.
    pub(super) build_seconds: f64,
    /// By how much it is smaller than asked for, as long as that takes too long.
    pub(super) divisor: u32,
    /// Whether it is what was asked for, in every pixel and sample.
    pub(super) is_whole: bool,
}

/// Every picture has another number.
pub(super) fn next_id() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

impl Picture {
    pub(super) fn size(&self) -> [u32; 2] {
        self.made.render.size
    }

    /// Linear light, row by row.
    pub(super) fn values(&self) -> &[Vec3] {
        let first = self.made.render.estimates.first();
        first.map_or(&[], |estimate| &estimate.values)
    }

    /// The image of a file, as `isophote render` writes it.
    pub(super) fn image(&self) -> Image {
        let (render, stages) = (self.made.render.clone(), self.made.stages.clone());
        image(render, stages, &self.stored, &self.device)
    }
}

/// What is to be made of a wish.
#[derive(Clone, Copy)]
pub(super) struct Step {
    pub(super) size: [u32; 2],
    /// Samples a pixel of the technique `reference`.
    pub(super) samples: u32,
    pub(super) seed: u64,
}

/// What has been loaded and built.
pub(super) struct Studio {
    scene: Option<(Values, Scene)>,
    shot: Option<(Values, Arc<Shot>)>,
    /// The one that was used last comes last.
    grounds: Vec<(Values, Ground)>,
    voice: Voice,
}

impl Studio {
    pub(super) fn new() -> Self {
        Self {
            scene: None,
            shot: None,
            grounds: Vec::new(),
            voice: Voice::new(false),
        }
    }

    /// What is seen from where; `say` hears what takes long.
    pub(super) fn shot(&mut self, wish: &Wish, say: &dyn Fn(&str)) -> Result<Arc<Shot>> {
        let key = wish.of_shot();
        if let Some((of, shot)) = &self.shot
            && *of == key
        {
            return Ok(shot.clone());
        }
        let key_of_scene = wish.of_scene();
        if self
            .scene
            .as_ref()
            .is_none_or(|(of, _)| *of != key_of_scene)
        {
            say("loading the scene");
            self.scene = Some((key_of_scene, wish.args.load(self.voice)?));
        }
        let (_, scene) = self.scene.as_ref().context("there is no scene")?;
        let shot = Arc::new(wish.args.shot(scene.clone(), self.voice)?);
        // Once is enough.
        self.voice = Voice::new(true);
        self.shot = Some((key, shot.clone()));
        Ok(shot)
    }

    /// Makes a picture by the wish's technique.
    pub(super) fn picture(
        &mut self,
        wish: &Arc<Wish>,
        step: Step,
        say: &dyn Fn(&str),
        progress: &dyn Progress,
    ) -> Result<Picture> {
        let shot = self.shot(wish, say)?;
        let (ground, build_seconds) = self.ground(wish, wish.choice, &shot, say)?;
        say("rendering");
        let mut settings = wish.args.settings();
        (settings.samples, settings.seed) = (step.samples, step.seed);
        let mut order = wish.args.order(&shot, &settings);
        order.size = step.size;
        let mut stored = wish.stored.clone();
        wish.args.complete(&mut stored, wish.choice, ground, &order);
        let chosen = wish.args.chosen();
        let (made, seconds) = timed(|| chosen.render(&shot.scene, ground, order, progress));
        Ok(Picture {
            id: next_id(),
            made: made?,
            device: ground.device(),
            wish: wish.clone(),
            shot,
            stored,
            seconds,
            build_seconds,
            divisor: 1,
            is_whole: false,
        })
    }

    /// Samples of the right answer, and the seconds that they took.
    pub(super) fn truth(
        &mut self,
        wish: &Wish,
        step: Step,
        say: &dyn Fn(&str),
        progress: &dyn Progress,
    ) -> Result<(Render, f64)> {
        let shot = self.shot(wish, say)?;
        let (ground, _) = self.ground(wish, wish.choice.exact(), &shot, say)?;
        say("refining the reference");
        let mut settings = wish.args.settings();
        (settings.samples, settings.seed) = (step.samples, step.seed);
        // Only methods with virtual lights leave something out.
        settings.min_d = 0.0;
        settings.path_bounces = wish.path_bounces();
        let mut order = wish.args.order(&shot, &settings);
        order.size = step.size;
        let (made, seconds) = timed(|| ground.render(&shot.scene, order, progress));
        Ok((made?.render, seconds))
    }

    /// The tracer, and how long it took where it was not there yet.
    fn ground(
        &mut self,
        wish: &Wish,
        choice: Choice,
        shot: &Shot,
        say: &dyn Fn(&str),
    ) -> Result<(&Ground, f64)> {
        let key = wish.of_tracer(choice);
        let mut seconds = 0.0;
        let kept = match self.grounds.iter().position(|(of, _)| *of == key) {
            Some(at) => self.grounds.remove(at),
            None => {
                say("building the tracer");
                if self.grounds.len() == KEPT {
                    self.grounds.remove(0);
                }
                let adapter = wish.args.adapter.as_deref();
                let (ground, time) =
                    timed(|| Ground::build(choice, adapter, &wish.args.plan(shot)));
                seconds = time;
                (key, ground?)
            }
        };
        self.grounds.push(kept);
        let (_, ground) = self.grounds.last().context("there is no tracer")?;
        Ok((ground, seconds))
    }

    /// Forgets what was built with other shaders.
    pub(super) fn forget_tracers(&mut self) {
        self.grounds.clear();
    }
}

#[cfg(test)]
mod tests {
    use clap::{Args, Command};

    use super::*;
    use crate::{picture::PictureArgs, view::flags::Flags};

    fn wish(technique: &str, camera: &str) -> Arc<Wish> {
        let command = PictureArgs::augment_args(Command::new("view"));
        let texts = format!(
            "view builtin:cornell --device gpu --tracer compute-bvh --technique {technique} --camera {camera} --spp 2 \
             --igi-paths 20 --materials lambert --size 40x30"
        );
        let matches = command.get_matches_from(texts.split_whitespace());
        Arc::new(Flags::given(&matches).wish().unwrap())
    }

    fn picture(studio: &mut Studio, wish: &Arc<Wish>) -> Picture {
        let step = Step {
            size: wish.args.size,
            samples: wish.args.spp,
            seed: 0,
        };
        let made = studio.picture(wish, step, &|_| {}, &|_, _| {});
        made.unwrap()
    }

    #[test]
    fn what_is_kept_on_a_gpu_makes_the_pictures_of_what_is_new() {
        if isophote_scene::gpu::adapters().is_empty() {
            let required = std::env::var_os("ISOPHOTE_REQUIRE_GPU");
            assert!(required.is_none_or(|value| value != "1"), "there is no GPU");
            eprintln!("SKIPPED a GPU test: there is no adapter");
            return;
        }
        let cameras = [
            "0.28,0.27,-0.8,0.28,0.27,0,40",
            "0.3,0.3,-0.6,0.28,0.27,0,50",
        ];
        for technique in ["reference", "ldi", "igi"] {
            let [one, other] = cameras.map(|camera| wish(technique, camera));
            let mut studio = Studio::new();
            let first = picture(&mut studio, &one);
            let second = picture(&mut studio, &other);
            let again = picture(&mut studio, &one);
            eprintln!(
                "{technique}: {:.3} s, then {:.3} and {:.3} s",
                first.seconds, second.seconds, again.seconds
            );
            assert!(second.build_seconds == 0.0 && again.build_seconds == 0.0);
            assert!(first.values() == again.values(), "{technique}");
            let new = picture(&mut Studio::new(), &other);
            assert!(second.values() == new.values(), "{technique}");
            assert!(first.values() != second.values(), "{technique}");
        }
    }
}
