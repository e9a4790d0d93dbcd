//! Rays in bulk: upload, trace, read back, in pieces that no driver's watchdog minds.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use bytemuck::{Pod, Zeroable};
use glam::Vec2;

use super::GpuTracer;
use crate::{
    Error, Hit, Ray, Result, SurfaceId,
    gpu::{ComputePass, Context, Dispatch, GpuScene, Linker, Timer},
};

/// Asks a [`GpuTracer`] about many rays.
#[derive(Debug)]
pub struct RayBatch {
    closest: Arc<Question>,
    any: Arc<Question>,
    batch: wgpu::Buffer,
    rays: wgpu::Buffer,
    answers: wgpu::Buffer,
    /// Most rays in a dispatch.
    capacity: u32,
    /// Rays in the next dispatch: as many as take a moment.
    piece: u32,
    kernel_time: Duration,
}

/// One of the two things that rays ask, and what it binds.
#[derive(Debug)]
struct Question {
    pass: ComputePass,
    group: wgpu::BindGroup,
}

/// `scene::ray::Hit` as it lies in a buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct GpuHit {
    t: f32,
    padding: u32,
    uv: Vec2,
    instance: u32,
    primitive: u32,
}

/// The uniform `batch`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Batch {
    count: u32,
    row: u32,
}

const WORKGROUP: u32 = 64;
/// `ray::MISS`.
const MISS: f32 = f32::MAX;
/// Drivers give up after some seconds; this leaves room, and is long enough to hide what surrounds a dispatch.
const MOMENT: Duration = Duration::from_millis(200);
/// Even a slow tracer does this many in a moment.
const FIRST_PIECE: u32 = 1 << 12;
const LARGEST_PIECE: u32 = 1 << 21;

impl RayBatch {
    /// Prepares batches for a tracer, and for every other scene's tracer of the same kind: of the same
    /// [`shader_flags`](GpuTracer::shader_flags) and with a scene that also is in buffers, or also in textures.
    ///
    /// # Errors
    /// [`Error::Shader`] or [`Error::Gpu`] when the tracer's module does not link or the device lacks what it needs.
    pub fn new(context: &Context, scene: &GpuScene, tracer: &dyn GpuTracer) -> Result<Self> {
        let shader = Linker::default()
            .scene(scene)
            .tracer(tracer)
            .link("scene::trace_batch")?;
        let groups = [tracer.bind_group_layout(), scene.bind_group_layout()];
        let limits = context.device().limits();
        let most = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size);
        let capacity = (most / size_of::<Ray>() as u64).min(u64::from(LARGEST_PIECE)) as u32;
        let storage =
            |label, bytes: usize| context.storage(label, u64::from(capacity) * bytes as u64);
        let rays = storage("rays", size_of::<Ray>())?;
        let answers = storage("hits", size_of::<GpuHit>())?;
        let first = Batch { count: 0, row: 0 };
        let batch = context.buffer("ray batch", &[first], wgpu::BufferUsages::UNIFORM)?;
        let resources = [
            (0, batch.as_entire_binding()),
            (1, rays.as_entire_binding()),
            (2, answers.as_entire_binding()),
        ];
        let question = |entry_point| -> Result<_> {
            let pass = shader.compute_pass(context, entry_point, &groups, &[])?;
            let group = pass.bind(context, &resources)?;
            Ok(Arc::new(Question { pass, group }))
        };
        Ok(Self {
            closest: question("closest_hits")?,
            any: question("any_hits")?,
            batch,
            rays,
            answers,
            capacity,
            piece: FIRST_PIECE.min(capacity),
            kernel_time: Duration::ZERO,
        })
    }

    /// The first surface each ray meets.
    ///
    /// # Errors
    /// [`Error::Gpu`] when the device fails, leaves an answer unwritten or gives one that is no number.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn closest_hits(
        &mut self,
        context: &Context,
        scene: &GpuScene,
        tracer: &dyn GpuTracer,
        rays: &[Ray],
        hits: &mut [Option<Hit>],
    ) -> Result<()> {
        let question = self.closest.clone();
        self.run(
            context,
            scene,
            tracer,
            &question,
            rays,
            hits,
            |hit: &GpuHit| {
                // No hit lies at 0, which is what the buffer is cleared to.
                if hit.t.is_nan() || hit.t <= 0.0 {
                    return Err(bad_answer(tracer, hit.t));
                }
                Ok((hit.t < MISS).then_some(Hit {
                    t: hit.t,
                    uv: hit.uv,
                    surface: SurfaceId {
                        instance: hit.instance,
                        primitive: hit.primitive,
                    },
                }))
            },
        )
    }

    /// Whether each ray meets any surface.
    ///
    /// # Errors
    /// [`Error::Gpu`] when the device fails or leaves an answer unwritten.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn any_hits(
        &mut self,
        context: &Context,
        scene: &GpuScene,
        tracer: &dyn GpuTracer,
        rays: &[Ray],
        hits: &mut [bool],
    ) -> Result<()> {
        let question = self.any.clone();
        self.run(
            context,
            scene,
            tracer,
            &question,
            rays,
            hits,
            |&answer: &u32| match answer {
                1 => Ok(false),
                2 => Ok(true),
                _ => Err(bad_answer(tracer, answer)),
            },
        )
    }

    /// How long the device has traced since the last call, by its own clock; zero where it has none.
    pub fn take_kernel_time(&mut self) -> Duration {
        std::mem::take(&mut self.kernel_time)
    }

    #[expect(
        clippy::too_many_arguments,
        reason = "what both kinds of question share"
    )]
    fn run<A: Pod, T>(
        &mut self,
        context: &Context,
        scene: &GpuScene,
        tracer: &dyn GpuTracer,
        question: &Question,
        rays: &[Ray],
        answers: &mut [T],
        decode: impl Fn(&A) -> Result<T>,
    ) -> Result<()> {
        assert_eq!(rays.len(), answers.len(), "one answer per ray");
        let groups = [&question.group, tracer.bind_group(), scene.bind_group()];
        let mut timer = Timer::new(context, 1);
        let mut done = 0;
        while done < rays.len() {
            let piece = &rays[done..rays.len().min(done + self.piece as usize)];
            let start = Instant::now();
            self.dispatch(
                context,
                &question.pass,
                &groups,
                piece,
                &mut timer,
                size_of::<A>(),
            )?;
            let found: Vec<A> = context.read(tracer.name(), &self.answers, piece.len())?;
            self.adapt(start.elapsed(), piece.len());
            for (answer, found) in answers[done..].iter_mut().zip(&found) {
                *answer = decode(found)?;
            }
            self.kernel_time += timer
                .read(context)?
                .iter()
                .map(|pass| pass.time)
                .sum::<Duration>();
            done += piece.len();
        }
        Ok(())
    }

    fn dispatch(
        &self,
        context: &Context,
        pass: &ComputePass,
        groups: &[&wgpu::BindGroup],
        rays: &[Ray],
        timer: &mut Timer,
        answer_bytes: usize,
    ) -> Result<()> {
        let count = rays.len() as u32;
        let workgroups = count.div_ceil(WORKGROUP);
        let columns = workgroups.min(
            context
                .device()
                .limits()
                .max_compute_workgroups_per_dimension,
        );
        let rows = workgroups.div_ceil(columns);
        let batch = Batch {
            count,
            row: columns * WORKGROUP,
        };
        context.check("tracing rays", |device| {
            context
                .queue()
                .write_buffer(&self.batch, 0, bytemuck::bytes_of(&batch));
            context
                .queue()
                .write_buffer(&self.rays, 0, bytemuck::cast_slice(rays));
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("tracing rays"),
            });
            encoder.clear_buffer(&self.answers, 0, Some((rays.len() * answer_bytes) as u64));
            let dispatch = Dispatch {
                offset: None,
                workgroups: [columns, rows, 1],
            };
            pass.record(
                &mut encoder,
                "tracing rays",
                Some(timer),
                groups,
                &[dispatch],
            );
            timer.resolve(&mut encoder);
            context.queue().submit([encoder.finish()]);
        })
    }

    /// Chooses how many rays come next.
    fn adapt(&mut self, took: Duration, rays: usize) {
        if took > MOMENT {
            self.piece = (self.piece / 2).max(WORKGROUP.min(self.capacity));
        } else if took < MOMENT / 3 && rays == self.piece as usize {
            self.piece = (self.piece * 2).min(self.capacity);
        }
    }
}

fn bad_answer(tracer: &dyn GpuTracer, answer: impl std::fmt::Display) -> Error {
    Error::gpu(
        format!("tracing rays with {}", tracer.name()),
        format!("an answer is {answer}: the device did not finish, or its driver is broken"),
    )
}
