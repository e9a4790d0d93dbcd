//! The thread that renders: always what was asked for last.
//!
//! The window never waits for it. It makes a small picture first where a whole one takes long, and gives a whole one up
//! when something else is asked for.

use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, AtomicU64, Ordering},
        mpsc::{Receiver, Sender, channel},
    },
    thread::{Builder, JoinHandle},
    time::{Duration, Instant},
};

use anyhow::{Context, Result, anyhow};
use isophote_scene::reference::Progress;

use super::{
    flags::Wish,
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

struct Shared {
    /// And how many pictures were wanted so far.
    wanted: Mutex<(Wanted, u64)>,
    changed: Condvar,
    /// The same number, for those that cannot wait.
    number: AtomicU64,
    truth_is_wanted: AtomicBool,
    quits: AtomicBool,
    doing: Mutex<String>,
    done: AtomicU64,
    total: AtomicU64,
}

/// How long closing the window waits for the thread.
const PATIENCE: Duration = Duration::from_secs(3);

impl Worker {
    /// Starts the thread; `wake` is called when there is news.
    pub(super) fn start(wake: impl Fn() + Send + 'static) -> Result<Self> {
        let shared = Arc::new(Shared {
            wanted: Mutex::default(),
            changed: Condvar::new(),
            number: AtomicU64::new(0),
            truth_is_wanted: AtomicBool::new(false),
            quits: AtomicBool::new(false),
            doing: Mutex::default(),
            done: AtomicU64::new(0),
            total: AtomicU64::new(0),
        });
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
        self.shared.number.fetch_add(1, Ordering::Relaxed);
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

/// How much smaller a picture must be so that it comes at once, found by trying.
struct Pace {
    /// What it is the pace of.
    of: String,
    divisor: u32,
    /// That a whole picture took last.
    whole_seconds: Option<f64>,
}

impl Default for Pace {
    fn default() -> Self {
        Self {
            of: String::new(),
            divisor: 4,
            whole_seconds: None,
        }
    }
}

impl Pace {
    /// Seconds within which something must be seen.
    const SOON: f64 = 0.15;

    fn start(&mut self, of: String) {
        if self.of != of {
            *self = Self {
                of,
                ..Self::default()
            };
        }
    }

    fn took(&mut self, seconds: f64) {
        if seconds > Self::SOON {
            self.divisor = (self.divisor + 1).min(12);
        } else if seconds < 0.3 * Self::SOON {
            self.divisor = (self.divisor - 1).max(1);
        }
    }

    fn needs_preview(&self) -> bool {
        self.divisor > 1
            && self
                .whole_seconds
                .is_none_or(|seconds| seconds > Self::SOON)
    }

    fn size(&self, size: [u32; 2]) -> [u32; 2] {
        size.map(|side| side.div_ceil(self.divisor).max(1))
    }
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
                // Not again before something changes.
                self.pictured = Some(number);
                self.refused = Some(number);
                self.tell(News::Failed(whole(&error)));
            }
        }
    }

    /// Makes the picture that is wanted.
    fn see_to(&mut self, wish: &Arc<Wish>, wanted: &Wanted, number: u64) -> Result<()> {
        if self.make_picture(wish, wanted.is_moving, number)? {
            self.pictured = Some(number);
            // What moves is soon wanted elsewhere, and what is compared moves together.
            if wanted.is_moving && wanted.truth {
                self.refine(wish, true, number)?;
            }
        }
        Ok(())
    }

    /// Waits for something to do.
    fn next(&mut self) -> Option<(Wanted, u64)> {
        let shared = self.shared.clone();
        let mut guard = lock(&shared.wanted);
        loop {
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
            let waited = shared.changed.wait(guard);
            guard = waited.unwrap_or_else(PoisonError::into_inner);
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

/// Thrown through a renderer when something else is wanted.
struct Stopped;

/// Hears how far a renderer is, and stops it when something else is wanted: the next part of the work unwinds, as
/// renderers have no other way to end early.
struct Gate<'a> {
    shared: &'a Shared,
    /// The only number that may be wanted; whatever is wanted where there is none.
    number: Option<u64>,
    is_of_truth: bool,
}

impl<'a> Gate<'a> {
    fn new(shared: &'a Shared, number: Option<u64>, is_of_truth: bool) -> Self {
        Self {
            shared,
            number,
            is_of_truth,
        }
    }

    fn is_shut(&self) -> bool {
        let other = |number| self.shared.number.load(Ordering::Relaxed) != number;
        self.shared.quits.load(Ordering::Relaxed)
            || self.number.is_some_and(other)
            || self.is_of_truth && !self.shared.truth_is_wanted.load(Ordering::Relaxed)
    }
}

impl Progress for Gate<'_> {
    fn advance(&self, done: u64, total: u64) {
        self.shared.done.fetch_max(done, Ordering::Relaxed);
        self.shared.total.store(total, Ordering::Relaxed);
        if self.is_shut() {
            // Unlike a panic it says nothing.
            resume_unwind(Box::new(Stopped));
        }
    }
}

/// The result, or none where the work was stopped.
fn stoppable<T>(work: impl FnOnce() -> Result<T>) -> Result<Option<T>> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(result) => result.map(Some),
        Err(payload) if payload.is::<Stopped>() => Ok(None),
        Err(payload) => Err(anyhow!("this is a bug: {}", said(&*payload))),
    }
}

/// What a panic said.
fn said(payload: &(dyn Any + Send)) -> &str {
    let text = payload.downcast_ref::<&str>().copied();
    text.or(payload.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("the renderer stopped")
}
