//! Pictures from the command line: submitted piece by piece, so that no driver's watchdog minds, and read back.

use isophote_scene::{
    Camera, Pass,
    gpu::{Context, GpuScene, reference::World},
    reference::Progress,
};

use super::{
    super::{Points, finish},
    Gather, Lit, LitTargets,
    looks::Looks,
};
use crate::Result;

impl Gather {
    /// Lights what a camera sees, reads it back, and tells what it took. Submits in pieces that no driver's watchdog minds.
    ///
    /// # Errors
    /// As [`see`](Self::see); [`Error::Scene`](crate::Error::Scene) when the device fails.
    pub fn render(
        &mut self,
        context: &Context,
        world: World<'_>,
        camera: &Camera,
        samples: u32,
        progress: &dyn Progress,
    ) -> Result<(Lit, Vec<Pass>)> {
        let mut points = Points::new(context, self.picture.size)?;
        let targets = LitTargets::new(context, self.picture.size)?;
        let encoder = || context.device().create_command_encoder(&Default::default());
        // More of them would ask no map.
        let maps = self.params.maps.maps.saturating_mul(self.params.frames);
        let samples = samples.clamp(1, maps);
        let mut passes = Vec::new();
        let mut sample = 0;
        while sample < samples {
            if sample == 0 {
                passes.clear();
                let mut first = encoder();
                self.begin(&mut first, world.gpu_scene);
                context.submit("light", first)?;
            }
            let look = (camera, [sample, samples]);
            self.take(context, world, look, &mut points, &mut passes)?;
            sample = match self.has_room(context)? {
                true => sample + 1,
                false => 0,
            };
            progress.advance(u64::from(sample), u64::from(samples));
        }
        let mut last = encoder();
        self.resolve(context, &mut last, &targets)?;
        context.submit("light", last)?;
        let (mut lit, rays) = targets.read(context)?;
        passes[0].rays += rays;
        if !self.picture.irradiance {
            lit.direct.irradiance.clear();
        }
        Ok((lit, passes))
    }

    /// Sees and lights one place of each pixel, and waits for it, piece by piece.
    fn take(
        &mut self,
        context: &Context,
        world: World<'_>,
        (camera, [sample, samples]): (&Camera, [u32; 2]),
        points: &mut Points,
        passes: &mut Vec<Pass>,
    ) -> Result<()> {
        let pixels = u64::from(self.picture.size[0]) * u64::from(self.picture.size[1]);
        let encoder = || context.device().create_command_encoder(&Default::default());
        Pass::timed(passes, "direct", || {
            let mut encoder = encoder();
            let on = (world.gpu_scene, world.exact);
            let seen = self.see(context, &mut encoder, on, (camera, sample), points, None);
            (seen.and_then(|()| finish(context, encoder)), [pixels, 0])
        })?;
        let Some(shining) = self.shining.as_ref().filter(|one| !one.is_dark()) else {
            return Ok(());
        };
        points.tighten(context)?;
        let ways = shining.ways(context, points, [sample, samples]);
        Pass::timed(passes, "room", || {
            let mut encoder = encoder();
            encoder.clear_buffer(&self.arriving, 0, None);
            let (on, about) = ((world.gpu_scene, world.exact), (&ways, &*points));
            let measured = shining.measure(context, &mut encoder, on, about, &self.arriving);
            let rays = u64::from(shining.measures_room()) * 4 * pixels;
            (measured.and_then(|()| finish(context, encoder)), [rays, 0])
        })?;
        let looks = shining.gather(context, &ways, points, &self.arriving)?;
        let rays = |maps: usize| maps as u64 * pixels;
        look(context, world.gpu_scene, &looks, rays, ("gather", passes))?;
        let mut last = encoder();
        self.shade(context, &mut last)?;
        context.submit("light", last)?;
        self.weight += ways.weight();
        let Some(mirror) = self
            .mirror
            .as_mut()
            .filter(|one| one.is_due([sample, samples]))
        else {
            return Ok(());
        };
        if let Some(ways) = mirror.ways(context, shining)? {
            let looks = mirror.looks(context, shining, &ways)?;
            look(context, world.gpu_scene, &looks, |_| 0, ("mirror", passes))?;
        }
        let mut last = encoder();
        mirror.add(context, &mut last, [&self.lit, &self.shown])?;
        Ok(context.submit("light", last)?)
    }
}

/// Looks along the maps batch by batch, and waits for each, which takes so many look-ups for so many maps.
fn look(
    context: &Context,
    gpu_scene: &GpuScene,
    looks: &Looks<'_>,
    rays: impl Fn(usize) -> u64,
    (name, passes): (&'static str, &mut Vec<Pass>),
) -> Result<()> {
    for batch in 0..looks.len() {
        Pass::timed(passes, name, || {
            let mut encoder = context.device().create_command_encoder(&Default::default());
            looks.record(&mut encoder, batch, gpu_scene, None);
            (finish(context, encoder), [rays(looks.maps(batch)), 0])
        })?;
    }
    Ok(())
}
