//! The integrators that define the right answer, on a GPU: the twin of [`crate::reference`].
//!
//! Both take the same samples and choose the same lights, so that their pictures differ by rounding, by normals that
//! are stored in 32 bits, and where one of these moves a ray across an edge; not by noise.
//!
//! An [`Integrator`] works through passes, each over one sample of many pixels or receivers:
//! 1. `camera`: what a sample's camera ray meets (exact tracer). Receivers need none.
//! 2. `occlusion`: `ao` and `obscurance` (secondary tracer).
//! 3. `direct`: the first surface, lit straight from the lights (exact tracer).
//! 4. `path`: everything from the first scattered ray on (secondary tracer).
//!
//! All of them add to one buffer of sums, which is read when every sample has been taken. Work is submitted in pieces
//! that take a moment, so that no driver's watchdog minds.
//!
//! Of the 8 storage buffers of a stage the scene takes 3, the tracer 2, and this 2.

mod passes;
mod tables;
mod work;

use self::{
    passes::{Link, Passes},
    tables::{GpuSettings, ReceiverWords, receiver_words},
    work::{Sums, Work},
};
use super::{Context, GpuScene, GpuTracer, PassTime, RayBatch};
use crate::{
    Camera, Error, Ray, Receivers, Result, Scene,
    gpu::view::View,
    reference::{
        Estimate, Layers, Normals, Progress, Quantity, Render, Settings, Wanted,
        render::{center_ray, check_size, estimates},
    },
};

/// A scene, on both sides, and who answers which rays, as [`crate::reference::Tracers`].
#[derive(Clone, Copy)]
pub struct World<'a> {
    /// The scene as it is.
    pub scene: &'a Scene,
    /// The same on the GPU.
    pub gpu_scene: &'a GpuScene,
    /// Camera rays and the shadow rays of the first surface; must answer [`Answers::Surface`](crate::Answers::Surface).
    pub exact: &'a dyn GpuTracer,
    /// All other rays.
    pub secondary: &'a dyn GpuTracer,
}

/// Estimates quantities on a GPU, of any scene by any tracers: it keeps the pipelines that it has needed so far.
#[derive(Debug)]
pub struct Integrator {
    context: Context,
    passes: Passes,
    /// For what a camera sees, and what it was linked of.
    batch: Option<(Link, RayBatch)>,
    times: Vec<PassTime>,
}

impl Integrator {
    /// An integrator for a device.
    pub fn new(context: &Context) -> Self {
        Self {
            context: context.clone(),
            passes: Passes::default(),
            batch: None,
            times: Vec::new(),
        }
    }

    /// Renders quantities as a camera sees them; the twin of [`crate::reference::render()`].
    ///
    /// # Errors
    /// [`Error::Parameter`] for settings out of range, a size of zero, or one of more pixels than are counted here (2³¹);
    /// [`Error::TracerKnowsLess`] as [`crate::reference::Integrator::new`]; [`Error::Shader`] when a tracer's module does
    /// not link; [`Error::Gpu`] when the device fails, leaves work undone or calculates what is no
    /// number.
    pub fn render(
        &mut self,
        world: World<'_>,
        camera: &Camera,
        size: [u32; 2],
        quantities: &[Quantity],
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<Render> {
        check_size(size)?;
        let view = View::of_camera(camera, size, &world.scene.bounds());
        let target = Target {
            view: Some(view),
            receivers: &[],
            count: size[0] as usize * size[1] as usize,
        };
        let (estimates, rays) = self.run(world, &target, quantities, settings, progress)?;
        Ok(Render {
            size,
            estimates,
            layers: self.layers(world, camera, size, settings.normals)?,
            rays,
        })
    }

    /// Estimates quantities at receivers, seen from above; the twin of [`crate::reference::bake`]. Returns one value per
    /// receiver and quantity, and the number of rays.
    ///
    /// # Errors
    /// As [`render`](Self::render).
    pub fn bake(
        &mut self,
        world: World<'_>,
        receivers: &Receivers,
        quantities: &[Quantity],
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<(Vec<Estimate>, u64)> {
        let words: Vec<_> = receivers.points.iter().map(receiver_words).collect();
        let target = Target {
            view: None,
            receivers: &words,
            count: words.len(),
        };
        self.run(world, &target, quantities, settings, progress)
    }

    /// How long each pass has taken by the device's clock since the last call, all its pieces together; empty where the
    /// device has none.
    pub fn take_times(&mut self) -> Vec<PassTime> {
        std::mem::take(&mut self.times)
    }

    fn run(
        &mut self,
        world: World<'_>,
        target: &Target<'_>,
        quantities: &[Quantity],
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<(Vec<Estimate>, u64)> {
        let Some(slots) = u32::try_from(target.count)
            .ok()
            .and_then(|n| n.checked_mul(2))
        else {
            return Err(Error::Parameter {
                name: "the number of pixels or receivers",
                value: target.count.to_string(),
                expected: "a GPU counts up to 2147483647",
            });
        };
        let answers = [world.exact.answers(), world.secondary.answers()];
        let wanted = Wanted::checked(
            quantities,
            settings,
            world.gpu_scene.light_can_be_hit(),
            answers,
        )?;
        let values = GpuSettings::new(target.view, settings, &wanted);
        let uniform = wgpu::BufferUsages::UNIFORM;
        let passes = &mut self.passes;
        let work = Work {
            context: &self.context,
            passes: passes.choose(&self.context, world, target.view.is_some(), &wanted)?,
            scene: world.gpu_scene.bind_group(),
            settings: self
                .context
                .buffer("reference settings", &[values], uniform)?,
            receivers: target.view.is_none().then_some(target.receivers),
            record: values.record,
            samples: settings.halves(),
        };
        let Sums { halves, rays } = work.run(slots, &mut self.times, progress)?;
        Ok((estimates(quantities, settings, &halves), rays))
    }

    /// What a camera sees through the centres of pixels, in rows that together are not too many rays.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a size of zero, and what [`RayBatch`] can return.
    pub fn layers(
        &mut self,
        world: World<'_>,
        camera: &Camera,
        size: [u32; 2],
        normals: Normals,
    ) -> Result<Layers> {
        check_size(size)?;
        const RAYS: u32 = 1 << 20;
        let context = &self.context;
        let [width, height] = size;
        let mut layers = Layers::default();
        let link = Link::new("layers", world.gpu_scene, world.exact);
        let mut batch = match self.batch.take() {
            Some((of, batch)) if of == link => batch,
            _ => RayBatch::new(context, world.gpu_scene, world.exact)?,
        };
        let rows = (RAYS / width).max(1);
        for first in (0..height).step_by(rows as usize) {
            let rows = first..height.min(first.saturating_add(rows));
            let rays: Vec<Ray> = rows
                .flat_map(|y| (0..width).map(move |x| center_ray(camera, [x, y], size)))
                .collect();
            let mut hits = vec![None; rays.len()];
            batch.closest_hits(context, world.gpu_scene, world.exact, &rays, &mut hits)?;
            for row in hits.chunks_exact(width as usize) {
                layers.push_row(world.scene, camera, normals, size, row);
            }
        }
        self.batch = Some((link, batch));
        Ok(layers)
    }
}

/// What light is estimated for: a camera's pixels, or receivers.
struct Target<'a> {
    view: Option<View>,
    receivers: &'a [ReceiverWords],
    count: usize,
}
