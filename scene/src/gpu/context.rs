//! A device and its queue, and the adapters there are.

use std::sync::{Arc, Mutex, OnceLock};

use wgpu::{Backends, DeviceType, Features, Limits};

use crate::{Error, Result};

/// Which adapter to open.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// The fastest there is; a software adapter where there is no hardware.
    #[default]
    Any,
    /// The fastest that is hardware.
    Hardware,
    /// One that runs on the processor, like Mesa's llvmpipe.
    Software,
    /// The first whose name contains this, upper and lower case alike.
    Named(String),
}

/// What an adapter is and supports.
#[derive(Clone, Debug)]
pub struct Adapter {
    /// Its name, kind, driver and backend.
    pub info: wgpu::AdapterInfo,
    /// What it can do.
    pub features: Features,
    /// How much of it.
    pub limits: Limits,
    adapter: wgpu::Adapter,
}

/// What is used of an adapter where it is supported.
const OPTIONAL: Features = Features::TIMESTAMP_QUERY
    .union(Features::TIMESTAMP_QUERY_INSIDE_ENCODERS)
    .union(Features::EXPERIMENTAL_RAY_QUERY)
    .union(Features::FLOAT32_FILTERABLE)
    .union(Features::FLOAT32_BLENDABLE);

/// All adapters, the one that is likely the fastest first.
pub fn adapters() -> Vec<Adapter> {
    // OpenGL is left out: its adapters repeat those of Vulkan with less.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: Backends::VULKAN | Backends::METAL | Backends::DX12,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let mut adapters: Vec<Adapter> =
        pollster::block_on(instance.enumerate_adapters(Backends::all()))
            .into_iter()
            .map(|adapter| Adapter {
                info: adapter.get_info(),
                features: adapter.features(),
                limits: adapter.limits(),
                adapter,
            })
            .collect();
    adapters.sort_by_key(|adapter| match adapter.info.device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    });
    adapters
}

impl Adapter {
    /// The first of [`adapters`] that is of a kind.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] when there is none.
    pub fn find(choice: &AdapterChoice) -> Result<Self> {
        let mut adapters = adapters();
        let wanted = adapters.iter().position(|adapter| match choice {
            AdapterChoice::Any => true,
            AdapterChoice::Hardware => !adapter.is_software(),
            AdapterChoice::Software => adapter.is_software(),
            AdapterChoice::Named(name) => {
                let (name, of) = (name.to_lowercase(), adapter.info.name.to_lowercase());
                of.contains(&name)
            }
        });
        if let Some(wanted) = wanted {
            return Ok(adapters.swap_remove(wanted));
        }
        let names: Vec<&str> = adapters.iter().map(|one| one.info.name.as_str()).collect();
        Err(Error::NoAdapter {
            wanted: match choice {
                AdapterChoice::Any => "GPU adapter".into(),
                AdapterChoice::Hardware => "hardware GPU adapter".into(),
                AdapterChoice::Software => "software GPU adapter".into(),
                AdapterChoice::Named(name) => format!("GPU adapter with '{name}' in its name"),
            },
            found: if names.is_empty() {
                "there is none at all; install a Vulkan driver \
                 (Mesa's llvmpipe, Debian package mesa-vulkan-drivers, needs no GPU)"
                    .into()
            } else {
                format!("there is {}", names.join(", "))
            },
        })
    }

    /// Whether it runs on the processor.
    pub fn is_software(&self) -> bool {
        self.info.device_type == DeviceType::Cpu
    }

    /// Whether it says that shaders can ask its own ray tracing hardware or code.
    pub fn has_ray_query(&self) -> bool {
        self.features.contains(Features::EXPERIMENTAL_RAY_QUERY)
    }

    /// Whether the time of a pass can be measured on it.
    pub fn has_timestamps(&self) -> bool {
        self.features.contains(Features::TIMESTAMP_QUERY)
    }

    /// Opens it, with everything that this crate can make use of, within [`limits`](Self::limits).
    ///
    /// # Errors
    /// [`Error::Gpu`] when the driver refuses.
    pub fn open(&self) -> Result<Context> {
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("isophote"),
            required_features: self.features & OPTIONAL,
            required_limits: self.limits.clone(),
            experimental_features: experimental(),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(self.adapter.request_device(&descriptor))
            .map_err(|error| Error::gpu(format!("opening {}", self.info.name), error))?;
        Ok(Context::new(device, queue))
    }
}

fn experimental() -> wgpu::ExperimentalFeatures {
    #[expect(unsafe_code, reason = "wgpu calls ray queries experimental")]
    // SAFETY: of the experimental features only ray queries are asked for. What wgpu leaves undefined for them is
    // kept out here: geometry is finite (`clean`), structures are rebuilt rather than updated.
    unsafe {
        wgpu::ExperimentalFeatures::enabled()
    }
}

/// A device and its queue.
///
/// Everything that records or creates takes it by reference. A renderer that has its own device wraps it with
/// [`new`](Self::new); errors that no scope caught are collected and returned by the next call that waits for the
/// device.
#[derive(Clone, Debug)]
pub struct Context {
    device: wgpu::Device,
    queue: wgpu::Queue,
    failure: Arc<Mutex<Option<String>>>,
    ray_query_test: Arc<OnceLock<Result<(), String>>>,
}

impl Context {
    /// Opens an adapter.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] when there is none of the kind, [`Error::Gpu`] when its driver refuses.
    pub fn open(choice: &AdapterChoice) -> Result<Self> {
        Adapter::find(choice)?.open()
    }

    /// Wraps a device that someone else opened. Its handler of uncaptured errors is replaced by one that keeps the
    /// error for the next call that can return it.
    pub fn new(device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let failure = Arc::new(Mutex::new(None));
        let keep = failure.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            tracing::error!("GPU: {error}");
            note(&keep, error.to_string());
        }));
        let keep = failure.clone();
        device.set_device_lost_callback(move |reason, message| {
            if reason != wgpu::DeviceLostReason::Destroyed {
                note(&keep, format!("the device was lost: {message}"));
            }
        });
        Self {
            device,
            queue,
            failure,
            ray_query_test: Arc::default(),
        }
    }

    /// A device that checks everything and computes nothing, with WebGPU's default limits and ray queries: for tests
    /// of shaders and pipelines that need no GPU.
    pub fn noop() -> Self {
        Self::noop_within(Limits::default())
    }

    /// As [`noop`](Self::noop) with other limits.
    pub fn noop_within(limits: Limits) -> Self {
        let noop = wgpu::NoopBackendOptions {
            enable: true,
            // Unlimited as it is, wgpu would refuse to look through what indirect draws are told.
            limits: Some(Limits {
                min_storage_buffer_offset_alignment: 256,
                ..Limits::unlimited()
            }),
            ..Default::default()
        };
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: Backends::NOOP,
            backend_options: wgpu::BackendOptions {
                noop,
                ..Default::default()
            },
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let adapter = instance.request_adapter(&wgpu::RequestAdapterOptions::default());
        let adapter = pollster::block_on(adapter).expect("this backend is always there");
        let device = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("noop"),
            required_features: OPTIONAL,
            required_limits: Limits {
                // Of one stage; every Vulkan device with ray queries has 16.
                max_acceleration_structures_per_shader_stage: 2,
                ..limits.using_minimum_supported_acceleration_structure_values()
            },
            experimental_features: experimental(),
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(device).expect("it refuses nothing");
        let context = Self::new(device, queue);
        // What computes nothing would fail the test.
        context.ray_query_test.get_or_init(|| Ok(()));
        context
    }

    /// Any adapter, for tests: where there is none they say so on stderr and are skipped, unless the environment variable
    /// `ISOPHOTE_REQUIRE_GPU` is 1.
    ///
    /// # Panics
    /// If a GPU is required and there is none, or there is one that does not open.
    #[cfg(feature = "testing")]
    pub fn for_tests() -> Option<Self> {
        Self::for_tests_of(Features::empty())
    }

    /// As [`for_tests`](Self::for_tests) for tests that need certain features.
    ///
    /// # Panics
    /// If a GPU with those features is required and there is none, or there is one that does not open.
    #[cfg(feature = "testing")]
    pub fn for_tests_of(features: Features) -> Option<Self> {
        Self::for_tests_within(features, u64::MAX)
    }

    /// As [`for_tests_of`](Self::for_tests_of) with a device that binds no storage buffer of more than so many bytes.
    ///
    /// # Panics
    /// If a GPU with those features is required and there is none, or there is one that does not open.
    #[cfg(feature = "testing")]
    pub fn for_tests_within(features: Features, binding_size: u64) -> Option<Self> {
        let opened = Adapter::find(&AdapterChoice::Any).and_then(|mut adapter| {
            if !adapter.features.contains(features) {
                return Err(Error::NoAdapter {
                    wanted: format!("GPU adapter with {features:?}"),
                    found: format!("{} has not", adapter.info.name),
                });
            }
            let size = &mut adapter.limits.max_storage_buffer_binding_size;
            *size = binding_size.min(*size);
            adapter.open()
        });
        let required = std::env::var_os("ISOPHOTE_REQUIRE_GPU").is_some_and(|value| value == "1");
        match opened {
            Ok(context) => Some(context),
            Err(error @ Error::NoAdapter { .. }) if !required => {
                use std::io::Write;
                // Not eprintln!, which tests that pass do not show.
                let _ = writeln!(std::io::stderr(), "SKIPPED a GPU test: {error}");
                None
            }
            Err(error) => panic!("{error}"),
        }
    }

    /// Runs a test of ray query once, and from then on returns its outcome.
    pub(crate) fn ray_query_test(
        &self,
        run: impl FnOnce() -> Result<(), String>,
    ) -> Result<(), String> {
        self.ray_query_test.get_or_init(run).clone()
    }

    /// The device.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// The queue.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Runs something that creates resources or records commands, and returns the error it caused.
    ///
    /// # Errors
    /// [`Error::Gpu`] with what the validation said, or that memory is out.
    pub fn check<T>(&self, what: &str, run: impl FnOnce(&wgpu::Device) -> T) -> Result<T> {
        let scopes = [
            wgpu::ErrorFilter::Internal,
            wgpu::ErrorFilter::OutOfMemory,
            wgpu::ErrorFilter::Validation,
        ]
        .map(|filter| self.device.push_error_scope(filter));
        let value = run(&self.device);
        // Scopes are a stack: the last pushed goes first.
        let error = scopes
            .into_iter()
            .rev()
            .filter_map(|scope| pollster::block_on(scope.pop()))
            .last();
        match error {
            Some(error) => Err(Error::gpu(what, error)),
            None => Ok(value),
        }
    }

    /// Submits commands.
    ///
    /// # Errors
    /// [`Error::Gpu`] when the commands are not valid.
    pub fn submit(&self, what: &str, encoder: wgpu::CommandEncoder) -> Result<()> {
        self.check(what, |_| self.queue.submit([encoder.finish()]))?;
        Ok(())
    }

    /// Waits until everything submitted has been done.
    ///
    /// # Errors
    /// [`Error::Gpu`] when the device was lost, or an error happened that no scope caught.
    pub fn wait(&self, what: &str) -> Result<()> {
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        if let Some(failure) = take(&self.failure) {
            return Err(Error::gpu(what, failure));
        }
        polled.map(|_| ()).map_err(|error| Error::gpu(what, error))
    }

    /// A buffer with contents, also `COPY_DST` and `COPY_SRC`; of at least one value.
    ///
    /// # Errors
    /// [`Error::GpuLimit`] when it is larger than the device can hold, [`Error::Gpu`] when memory is out.
    pub fn buffer<T: bytemuck::Pod>(
        &self,
        label: &str,
        contents: &[T],
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer> {
        let bytes: &[u8] = bytemuck::cast_slice(contents);
        let size = bytes.len().max(size_of::<T>()) as u64;
        self.check_size(label, size, self.device.limits().max_buffer_size)?;
        self.check(label, |device| {
            let buffer = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT),
                usage: usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            });
            // Written in pieces, so that staging memory stays small.
            const PIECE: usize = 64 << 20;
            for (index, piece) in bytes.chunks(PIECE).enumerate() {
                self.queue
                    .write_buffer(&buffer, (index * PIECE) as u64, piece);
                if bytes.len() > PIECE {
                    self.queue.submit([]);
                }
            }
            buffer
        })
    }

    /// A buffer of zeros that shaders write, also `COPY_DST` and `COPY_SRC`; of at least 16 bytes.
    ///
    /// # Errors
    /// [`Error::GpuLimit`] when the device could not bind it as a whole, [`Error::Gpu`] when memory is out.
    pub fn storage(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer> {
        let size = bytes.max(16).next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
        self.check_storage_size(label, size)?;
        self.check(label, |device| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_SRC
                    | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        })
    }

    /// Refuses a buffer that the device could not bind to a shader as a whole. To be asked before it is filled.
    ///
    /// # Errors
    /// [`Error::GpuLimit`], which says how large it would be and what is allowed.
    pub fn check_storage_size(&self, what: &str, bytes: u64) -> Result<()> {
        let limits = self.device.limits();
        let limit = limits
            .max_buffer_size
            .min(limits.max_storage_buffer_binding_size);
        self.check_size(what, bytes, limit)
    }

    pub(crate) fn check_size(&self, what: &str, bytes: u64, limit: u64) -> Result<()> {
        if bytes <= limit {
            return Ok(());
        }
        Err(Error::GpuLimit {
            what: what.into(),
            needs: bytes,
            limit,
            adapter: self.device.adapter_info().name,
        })
    }
}

fn note(failure: &Mutex<Option<String>>, message: String) {
    let mut failure = failure
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner());
    failure.get_or_insert(message);
}

fn take(failure: &Mutex<Option<String>>) -> Option<String> {
    failure
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner())
        .take()
}
