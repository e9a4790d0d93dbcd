//! What the stages of a technique take.

use std::time::Instant;

/// What a stage took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pass {
    /// The stage.
    pub name: &'static str,
    /// Its rays: the camera's, those towards lights, or secondary ones.
    pub rays: u64,
    /// Rays towards lights from what its secondary rays hit.
    pub shadow_rays: u64,
    /// Of wall time.
    pub seconds: f64,
}

impl Pass {
    /// Runs a stage and notes what it took; the stage tells its rays and its shadow rays beside its result.
    pub fn timed<T>(
        passes: &mut Vec<Self>,
        name: &'static str,
        stage: impl FnOnce() -> (T, [u64; 2]),
    ) -> T {
        let start = Instant::now();
        let (result, [rays, shadow_rays]) = stage();
        passes.push(Self {
            name,
            rays,
            shadow_rays,
            seconds: start.elapsed().as_secs_f64(),
        });
        result
    }
}
