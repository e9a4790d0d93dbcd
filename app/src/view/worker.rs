//! The thread that renders: always what was asked for last.
//!
//! The window never waits for it. It makes a small picture first where a whole one takes long, and gives a whole one up
//! when something else is asked for.

use std::{
    collections::BTreeMap,
    path::PathBuf,
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, AtomicU64, Ordering},
        mpsc::{Receiver, Sender, channel},
    },
    thread::{Builder, JoinHandle},
    time::{Duration, Instant},
};

use anyhow::{Context, Result};
use isophote_scene::gpu::replace_modules;

use super::{
    flags::Wish,
    gate::{Gate, stoppable},
    pace::Pace,
    shaders::Shaders,
    studio::{Picture, Step, Studio},
    truth::{Sums, Truth},
};
use crate::{technique::TechniqueChoice, whole};

/// What the thread tells the window.
pub(super) enum News {
    Picture(Arc<Picture>),
    Truth(Arc<Truth>),
    /// Why there is no picture.
    Failed(String),
    /// Why the old shaders are still in use; nothing where the new ones are.
    Shaders(Option<String>),
}

/// What the window wants to see.
#[derive(Clone, Default)]
pub(super) struct Wanted {
    pub(super) wish: Option<Arc<Wish>>,
    /// Whether it will be something else in a moment.
    pub(super) is_moving: bool,
    /// Whether the technique's picture is shown.
    pub(super) picture: bool,
    /// Whether the right answer is shown.
    pub(super) truth: bool,
}

/// How far the thread is.
#[derive(Clone, Default)]
pub(super) struct Status {
    /// Nothing where it rests.
    pub(super) doing: String,
    /// 0 to 1.
    pub(super) share: f32,
}

/// The window's end of it.
pub(super) struct Worker {
    shared: Arc<Shared>,
    pub(super) news: Receiver<News>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
pub(super) struct Shared {
    /// And how many pictures were wanted so far.
    wanted: Mutex<(Wanted, u64)>,
    changed: Condvar,
    /// The same number, for those that cannot wait.
    pub(super) number: AtomicU64,
    pub(super) truth_is_wanted: AtomicBool,
    pub(super) quits: AtomicBool,
    doing: Mutex<String>,
    pub(super) done: AtomicU64,
    pub(super) total: AtomicU64,
}

/// How often shaders are looked at, and how long the thread sleeps at most where there are none to look at.
pub(super) const LOOK: Duration = Duration::from_millis(400);
const REST: Duration = Duration::from_secs(3600);
/// How long closing the window waits for the thread.
const PATIENCE: Duration = Duration::from_secs(3);

impl Worker {
    /// Starts the thread; `wake` is called when there is news, and shaders are taken from a checkout where there is one.
    pub(super) fn start(
        checkout: Option<PathBuf>,
        wake: impl Fn() + Send + 'static,
    ) -> Result<Self> {
        let shared = Arc::new(Shared::default());
        let (sender, news) = channel();
        let hand = Hand {
            shared: shared.clone(),
            news: sender,
            wake: Box::new(wake),
            studio: Studio::new(),
            pictured: None,
            refused: None,
            pace: Pace::default(),
            truth: None,
            truth_pace: Pace::default(),
            shaders: checkout.map(Shaders::new),
            trusted: None,
        };
        let thread = Builder::new().name("render".into()).spawn(|| hand.work());
        Ok(Self {
            shared,
            news,
            thread: Some(thread.context("cannot start the thread that renders")?),
        })
    }

    /// Says what is wanted from now on.
    pub(super) fn want(&self, new: Wanted) {
        let mut guard = lock(&self.shared.wanted);
        let (wanted, number) = &mut *guard;
        let same = match (&wanted.wish, &new.wish) {
            (Some(old), Some(new)) => Arc::ptr_eq(old, new),
            (None, None) => true,
            _ => false,
        };
        if !same || wanted.is_moving != new.is_moving {
            *number += 1;
            self.shared.number.store(*number, Ordering::Relaxed);
        }
        self.shared
            .truth_is_wanted
            .store(new.truth, Ordering::Relaxed);
        *wanted = new;
        self.shared.changed.notify_all();
    }

    pub(super) fn status(&self) -> Status {
        let total = self.shared.total.load(Ordering::Relaxed).max(1);
        Status {
            doing: lock(&self.shared.doing).clone(),
            share: self.shared.done.load(Ordering::Relaxed) as f32 / total as f32,
        }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.shared.quits.store(true, Ordering::Relaxed);
        // The thread has either seen it or waits already.
        drop(lock(&self.shared.wanted));
        self.shared.changed.notify_all();
        let Some(thread) = self.thread.take() else {
            return;
        };
        let start = Instant::now();
        // It hears of it at the next part of its work; building a tracer has none.
        while !thread.is_finished() && start.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(5));
        }
        if thread.is_finished() {
            let _ = thread.join();
        }
    }
}

/// A thread that panicked holds nothing half-made.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The thread's end of it.
struct Hand {
    shared: Arc<Shared>,
    news: Sender<News>,
    wake: Box<dyn Fn() + Send>,
    studio: Studio,
    /// The last number that was seen to.
    pictured: Option<u64>,
    /// The last number of which there can be no right answer.
    refused: Option<u64>,
    pace: Pace,
    truth: Option<Sums>,
    truth_pace: Pace,
    shaders: Option<Shaders>,
    /// The shaders before those that are being tried.
    trusted: Option<BTreeMap<String, String>>,
}

impl Hand {
    fn work(mut self) {
        while let Some((wanted, number)) = self.next() {
            let Some(wish) = &wanted.wish else { continue };
            let outcome = if wanted.picture && self.pictured != Some(number) {
                self.see_to(wish, &wanted, number)
            } else {
                self.refine(wish, wanted.is_moving, number)
            };
            if let Err(error) = outcome {
                self.fail(number, &whole(&error));
            }
        }
    }

    /// Tells why there is no picture. Where shaders are on trial they may be why, and the old ones are asked again.
    fn fail(&mut self, number: u64, why: &str) {
        if let Some(trusted) = self.trusted.take() {
            replace_modules(trusted);
            self.studio.forget_tracers();
            self.tell(News::Shaders(Some(why.to_owned())));
            return;
        }
        // Not again before something changes.
        (self.pictured, self.refused) = (Some(number), Some(number));
        self.tell(News::Failed(why.to_owned()));
    }

    /// What was on trial is there to stay.
    fn trust(&mut self) {
        if self.trusted.take().is_some() {
            self.tell(News::Shaders(None));
        }
    }

    /// Makes the picture that is wanted.
    fn see_to(&mut self, wish: &Arc<Wish>, wanted: &Wanted, number: u64) -> Result<()> {
        if !self.make_picture(wish, wanted.is_moving, number)? {
            // Something else is wanted.
            return Ok(());
        }
        self.pictured = Some(number);
        self.trust();
        // What moves is soon wanted elsewhere, and what is compared moves together.
        if wanted.is_moving && wanted.truth {
            self.refine(wish, true, number)?;
        }
        Ok(())
    }

    /// Takes shaders that were changed, on trial.
    fn look_for_shaders(&mut self) {
        let Some(texts) = self.shaders.as_mut().and_then(Shaders::changed) else {
            return;
        };
        match texts {
            Ok(texts) => {
                let old = replace_modules(texts);
                // Of several on trial, none is trusted.
                self.trusted.get_or_insert(old);
                self.studio.forget_tracers();
                (self.pictured, self.truth, self.refused) = (None, None, None);
            }
            Err(error) => self.tell(News::Shaders(Some(whole(&error)))),
        }
    }

    /// Waits for something to do.
    fn next(&mut self) -> Option<(Wanted, u64)> {
        let shared = self.shared.clone();
        loop {
            self.look_for_shaders();
            let guard = lock(&shared.wanted);
            if shared.quits.load(Ordering::Relaxed) {
                return None;
            }
            let (wanted, number) = &*guard;
            if let Some(wish) = &wanted.wish {
                let picture = wanted.picture && self.pictured != Some(*number);
                let truth = wanted.truth
                    && self.refused != Some(*number)
                    && !self.truth_is_enough(wish, wanted.is_moving);
                if picture || truth {
                    return Some((wanted.clone(), *number));
                }
            }
            if !lock(&shared.doing).is_empty() {
                lock(&shared.doing).clear();
                (self.wake)();
            }
            let patience = match self.shaders {
                Some(_) => LOOK,
                None => REST,
            };
            let waited = shared.changed.wait_timeout(guard, patience);
            drop(waited.unwrap_or_else(PoisonError::into_inner));
        }
    }

    fn truth_is_enough(&self, wish: &Wish, is_moving: bool) -> bool {
        let key = wish.of_reference();
        let is_whole = |sums: &Sums| sums.is_of(&key, wish.args.size);
        let sums = self.truth.as_ref();
        sums.is_some_and(|sums| sums.is_enough() && (is_whole(sums) || is_moving))
    }

    /// Whether the picture is whole, or as whole as one that moves can be.
    fn make_picture(&mut self, wish: &Arc<Wish>, is_moving: bool, number: u64) -> Result<bool> {
        let (args, size) = (&wish.args, wish.args.size);
        let of = format!("{:?} {:?} {size:?}", args.technique, wish.choice);
        self.pace.start(of);
        // More and more samples of the technique that has all the time in the world.
        let is_progressive = args.technique == TechniqueChoice::Reference;
        let first = if is_progressive { 1 } else { args.spp };
        if is_moving || self.pace.needs_preview() {
            let (small, divisor) = (self.pace.size(size), self.pace.divisor);
            let is_whole = divisor == 1 && first == args.spp;
            let Some(mut picture) = self.step(wish, small, first, None)? else {
                return Ok(false);
            };
            (picture.divisor, picture.is_whole) = (divisor, is_whole);
            self.pace.took(picture.seconds);
            self.tell(News::Picture(Arc::new(picture)));
            if is_moving {
                return Ok(true);
            }
        }
        let mut samples = first;
        loop {
            let Some(mut picture) = self.step(wish, size, samples, Some(number))? else {
                return Ok(false);
            };
            if samples == first {
                self.pace.whole_seconds = Some(picture.seconds);
            }
            picture.is_whole = samples == args.spp;
            let is_whole = picture.is_whole;
            self.tell(News::Picture(Arc::new(picture)));
            if is_whole {
                return Ok(true);
            }
            samples = samples.saturating_mul(4).min(args.spp);
        }
    }

    /// Makes one picture, if nothing but `number` is wanted meanwhile.
    fn step(
        &mut self,
        wish: &Arc<Wish>,
        size: [u32; 2],
        samples: u32,
        number: Option<u64>,
    ) -> Result<Option<Picture>> {
        let gate = Gate::new(&self.shared, number, false);
        let step = Step {
            size,
            samples,
            seed: wish.args.seed,
        };
        let say = |what: &str| say(&self.shared, what);
        stoppable(|| self.studio.picture(wish, step, &say, &gate))
    }

    /// Adds a pass to the right answer.
    fn refine(&mut self, wish: &Wish, is_moving: bool, number: u64) -> Result<()> {
        let key = wish.of_reference();
        self.truth_pace.start(format!("{:?}", wish.choice.exact()));
        let is_seen = self.truth.as_ref().is_some_and(|sums| *sums.key() == key);
        let is_small = self.truth_pace.divisor > 1 && (is_moving || !is_seen);
        let (size, divisor) = if is_small {
            (
                self.truth_pace.size(wish.args.size),
                self.truth_pace.divisor,
            )
        } else {
            (wish.args.size, 1)
        };
        let sums = match &mut self.truth {
            Some(sums) if sums.is_of(&key, size) => sums,
            other => other.insert(Sums::new(key, size)),
        };
        let step = Step {
            size,
            samples: sums.next_samples(),
            // The technique's own random numbers must not be those it is compared with.
            seed: wish.args.seed.wrapping_add(1 + u64::from(sums.pass())),
        };
        let gate = Gate::new(&self.shared, (!is_small).then_some(number), true);
        let say = |what: &str| say(&self.shared, what);
        let Some((render, seconds)) = stoppable(|| self.studio.truth(wish, step, &say, &gate))?
        else {
            return Ok(());
        };
        let estimate = render.estimates.first().context("there is no estimate")?;
        sums.add(&estimate.values, step.samples, seconds);
        let truth = sums.truth(divisor);
        if is_small {
            self.truth_pace.took(seconds);
        }
        self.tell(News::Truth(Arc::new(truth)));
        self.trust();
        Ok(())
    }

    fn tell(&self, news: News) {
        // The window may be gone.
        let _ = self.news.send(news);
        (self.wake)();
    }
}

fn say(shared: &Shared, what: &str) {
    *lock(&shared.doing) = what.to_owned();
    shared.done.store(0, Ordering::Relaxed);
}
