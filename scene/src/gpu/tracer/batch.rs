//! Rays in bulk: upload, trace, read back, in pieces that no driver's watchdog minds.

use std::time::{Duration, Instant};

use bytemuck::{Pod, Zeroable};
use glam::Vec2;

use super::GpuTracer;
use crate::{
    Error, Hit, Ray, Result, SurfaceId,
    gpu::{Context, GpuScene, Linker, Timer, upload::entries},
};

/// Asks a [`GpuTracer`] about many rays.
#[derive(Debug)]
pub struct RayBatch {
    closest: wgpu::ComputePipeline,
    any: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    batch: wgpu::Buffer,
    rays: wgpu::Buffer,
    answers: wgpu::Buffer,
    /// Most rays in a dispatch.
    capacity: u32,
    /// Rays in the next dispatch: as many as take a moment.
    piece: u32,
    kernel_time: Duration,
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
        let device = context.device();
        let layout = context.check("ray batch", |device| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("ray batch"),
                entries: &layout_entries(),
            })
        })?;
        let groups = [
            &layout,
            tracer.bind_group_layout(),
            scene.bind_group_layout(),
        ];
        let limits = device.limits();
        let most = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size);
        let capacity = (most / size_of::<Ray>() as u64).min(u64::from(LARGEST_PIECE)) as u32;
        let storage = |label, bytes: usize| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: u64::from(capacity) * bytes as u64,
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_DST
                    | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        let (rays, answers) = context.check("ray batch", |_| {
            (
                storage("rays", size_of::<Ray>()),
                storage("hits", size_of::<GpuHit>()),
            )
        })?;
        Ok(Self {
            closest: shader.compute_pipeline(context, "closest_hits", &groups)?,
            any: shader.compute_pipeline(context, "any_hits", &groups)?,
            batch: context.buffer(
                "ray batch",
                &[Batch { count: 0, row: 0 }],
                wgpu::BufferUsages::UNIFORM,
            )?,
            layout,
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
        let pipeline = self.closest.clone();
        self.run(
            context,
            scene,
            tracer,
            &pipeline,
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
        let pipeline = self.any.clone();
        self.run(
            context,
            scene,
            tracer,
            &pipeline,
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
        pipeline: &wgpu::ComputePipeline,
        rays: &[Ray],
        answers: &mut [T],
        decode: impl Fn(&A) -> Result<T>,
    ) -> Result<()> {
        assert_eq!(rays.len(), answers.len(), "one answer per ray");
        let bind_group = context.check("ray batch", |device| {
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("ray batch"),
                layout: &self.layout,
                entries: &entries([
                    self.batch.as_entire_binding(),
                    self.rays.as_entire_binding(),
                    self.answers.as_entire_binding(),
                ]),
            })
        })?;
        let groups = [&bind_group, tracer.bind_group(), scene.bind_group()];
        let mut timer = Timer::new(context, 1);
        let mut done = 0;
        while done < rays.len() {
            let piece = &rays[done..rays.len().min(done + self.piece as usize)];
            let start = Instant::now();
            self.dispatch(
                context,
                pipeline,
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
        pipeline: &wgpu::ComputePipeline,
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
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("tracing rays"),
                timestamp_writes: timer.compute("tracing rays"),
            });
            pass.set_pipeline(pipeline);
            for (index, group) in (0..).zip(groups) {
                pass.set_bind_group(index, *group, &[]);
            }
            pass.dispatch_workgroups(columns, rows, 1);
            drop(pass);
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

fn layout_entries() -> [wgpu::BindGroupLayoutEntry; 3] {
    let mut binding = 0;
    [
        wgpu::BufferBindingType::Uniform,
        wgpu::BufferBindingType::Storage { read_only: true },
        wgpu::BufferBindingType::Storage { read_only: false },
    ]
    .map(|ty| {
        binding += 1;
        wgpu::BindGroupLayoutEntry {
            binding: binding - 1,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        }
    })
}

fn bad_answer(tracer: &dyn GpuTracer, answer: impl std::fmt::Display) -> Error {
    Error::gpu(
        format!("tracing rays with {}", tracer.name()),
        format!("an answer is {answer}: the device did not finish, or its driver is broken"),
    )
}
