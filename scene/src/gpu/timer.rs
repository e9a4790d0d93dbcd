//! How long passes take on the device.

use std::time::Duration;

use super::Context;
use crate::Result;

/// What one pass took.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PassTime {
    /// The name given to the pass.
    pub name: String,
    /// From its first to its last command on the device.
    pub time: Duration,
}

/// Measures passes by timestamps. On devices without timestamp queries it measures nothing, at no cost.
///
/// Give [`compute`](Self::compute) or [`render`](Self::render) to each pass, or put [`around`](Self::around) around several;
/// [`resolve`](Self::resolve) after the last one, and [`read`](Self::read) once the commands have been submitted.
#[derive(Debug)]
pub struct Timer {
    queries: Option<Queries>,
    names: Vec<String>,
    tells_between_passes: bool,
    /// Whether a timestamp is taken when the next one is asked for.
    is_late: bool,
}

#[derive(Debug)]
struct Queries {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    passes: u32,
}

impl Timer {
    /// Passes that a timer measures at most.
    pub const MOST: u32 = (wgpu::QUERY_SET_MAX_QUERIES - 1) / 2;

    /// A timer for up to `passes` passes, [`MOST`](Self::MOST) at most; further ones are not measured.
    pub fn new(context: &Context, passes: u32) -> Self {
        let device = context.device();
        let passes = passes.min(Self::MOST);
        let supported = device.features().contains(wgpu::Features::TIMESTAMP_QUERY) && passes > 0;
        let queries = supported.then(|| Queries {
            set: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timer"),
                ty: wgpu::QueryType::Timestamp,
                // One more to throw away: the last, because wgpu resets what is between the two of a pass.
                count: 2 * passes + 1,
            }),
            resolved: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("timer"),
                size: 16 * u64::from(passes),
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            passes,
        });
        let tells_between_passes = device
            .features()
            .contains(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);
        let kind = device.adapter_info().device_type;
        Self {
            queries,
            names: Vec::new(),
            tells_between_passes,
            is_late: tells_between_passes && kind == wgpu::DeviceType::Cpu,
        }
    }

    /// What the next compute pass of an encoder is to be begun with.
    pub fn compute(
        &mut self,
        name: &str,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let is_late = self.is_late;
        let (query_set, first, spare) = self.begin(name)?;
        // llvmpipe, once it has drawn anything, takes a timestamp with the next commands that it flushes, and dispatches at once: a
        // pass would begin when it ends. Another timestamp before it flushes its own.
        let beginning = if is_late {
            encoder.write_timestamp(query_set, first);
            spare
        } else {
            first
        };
        Some(wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(beginning),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    /// What a render pass is to be begun with.
    pub fn render(&mut self, name: &str) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let (query_set, first, _) = self.begin(name)?;
        Some(wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        })
    }

    /// Times what is recorded by `record`, of as many passes as it likes. Where the device cannot tell the time between passes
    /// ([`TIMESTAMP_QUERY_INSIDE_ENCODERS`](wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS)) nothing is measured.
    pub fn around<T>(
        &mut self,
        name: &str,
        encoder: &mut wgpu::CommandEncoder,
        record: impl FnOnce(&mut wgpu::CommandEncoder) -> T,
    ) -> T {
        let is_late = self.is_late;
        let queries = match self.tells_between_passes {
            true => self.begin(name),
            false => None,
        };
        let Some((query_set, first, spare)) = queries else {
            return record(encoder);
        };
        encoder.write_timestamp(query_set, first);
        if is_late {
            encoder.write_timestamp(query_set, spare);
        }
        let result = record(encoder);
        encoder.write_timestamp(query_set, first + 1);
        result
    }

    /// The queries, that of the beginning, which the end's follows, and that which is thrown away.
    fn begin(&mut self, name: &str) -> Option<(&wgpu::QuerySet, u32, u32)> {
        let queries = self.queries.as_ref()?;
        let index = self.names.len() as u32;
        if index >= queries.passes {
            return None;
        }
        self.names.push(name.into());
        Some((&queries.set, 2 * index, 2 * queries.passes))
    }

    /// Collects the timestamps, after the last measured pass.
    pub fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        if let Some(queries) = &self.queries
            && !self.names.is_empty()
        {
            let count = 2 * self.names.len() as u32;
            encoder.resolve_query_set(&queries.set, 0..count, &queries.resolved, 0);
        }
    }

    /// The times of all passes since the last call, in order; empty where the device has no timestamps.
    ///
    /// # Errors
    /// [`Error::Gpu`](crate::Error::Gpu) when the device failed.
    pub fn read(&mut self, context: &Context) -> Result<Vec<PassTime>> {
        let names = std::mem::take(&mut self.names);
        let Some(queries) = &self.queries else {
            return Ok(Vec::new());
        };
        let stamps: Vec<u64> = context.read("timestamps", &queries.resolved, 2 * names.len())?;
        let nanoseconds = f64::from(context.queue().get_timestamp_period());
        Ok(names
            .into_iter()
            .zip(stamps.chunks_exact(2))
            .map(|(name, stamps)| {
                let ticks = stamps[1].saturating_sub(stamps[0]);
                let time = Duration::from_nanos((ticks as f64 * nanoseconds) as u64);
                PassTime { name, time }
            })
            .collect())
    }
}
