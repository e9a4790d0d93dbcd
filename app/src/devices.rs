//! `isophote devices`: what there is to compute with.

use anyhow::Result;
use clap::Args;
use serde::Serialize;

use crate::output::{device, print, print_json};

const EXAMPLES: &str = "\
Ray query is tried with a few rays whose answers are known before it is called 'passed'.

Examples:
  isophote devices
  isophote trace hall.glb --rays rays.npy --adapter llvmpipe --tracer ray-query -o hits.npy";

/// List the processor and the GPU adapters, and what each supports.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct DevicesArgs {
    /// Print the list as JSON
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report {
    cpu: String,
    threads: usize,
    adapters: Vec<AdapterReport>,
}

#[derive(Serialize)]
struct AdapterReport {
    name: String,
    kind: String,
    backend: String,
    driver: String,
    /// The largest buffer, and how much of one a shader can bind.
    buffer_bytes: u64,
    binding_bytes: u64,
    storage_buffers_per_stage: u32,
    texture_side: u32,
    timestamps: bool,
    ray_query: String,
}

pub(crate) fn devices(args: &DevicesArgs) -> Result<()> {
    let report = Report {
        cpu: device().trim_start_matches("cpu: ").to_owned(),
        threads: rayon::current_num_threads(),
        adapters: adapters(),
    };
    if args.json {
        print_json(&report)
    } else {
        print(&report.text())
    }
}

#[cfg(feature = "gpu")]
fn adapters() -> Vec<AdapterReport> {
    use isophote_scene::gpu::{self, check_ray_query};

    let ray_query = |adapter: &gpu::Adapter| {
        if !adapter.has_ray_query() {
            return "not supported".to_owned();
        }
        match adapter.open().and_then(|context| check_ray_query(&context)) {
            Ok(()) => "passed its self-test".into(),
            Err(error) => format!("failed: {error}"),
        }
    };
    gpu::adapters()
        .iter()
        .map(|adapter| AdapterReport {
            name: adapter.info.name.clone(),
            kind: format!("{:?}", adapter.info.device_type),
            backend: adapter.info.backend.to_string(),
            driver: format!("{} {}", adapter.info.driver, adapter.info.driver_info)
                .trim()
                .to_owned(),
            buffer_bytes: adapter.limits.max_buffer_size,
            binding_bytes: adapter.limits.max_storage_buffer_binding_size,
            storage_buffers_per_stage: adapter.limits.max_storage_buffers_per_shader_stage,
            texture_side: adapter.limits.max_texture_dimension_2d,
            timestamps: adapter.has_timestamps(),
            ray_query: ray_query(adapter),
        })
        .collect()
}

#[cfg(not(feature = "gpu"))]
fn adapters() -> Vec<AdapterReport> {
    Vec::new()
}

impl Report {
    fn text(&self) -> String {
        let mut text = format!("cpu: {}, {} threads\n", self.cpu, self.threads);
        for one in &self.adapters {
            let mebibytes = |bytes: u64| bytes >> 20;
            text += &format!(
                "gpu: {} ({}, {}, {})\n  buffers of {} MiB, bound up to {} MiB, {} per shader stage; textures up to {}²\n  \
                 timestamps: {}\n  ray query: {}\n",
                one.name,
                one.kind,
                one.backend,
                one.driver,
                mebibytes(one.buffer_bytes),
                mebibytes(one.binding_bytes),
                one.storage_buffers_per_stage,
                one.texture_side,
                if one.timestamps { "yes" } else { "no" },
                one.ray_query,
            );
        }
        if !cfg!(feature = "gpu") {
            text += "no GPUs: this program was built without its feature `gpu`\n";
        } else if self.adapters.is_empty() {
            text += "no GPUs: there is no Vulkan, Metal or DirectX 12 driver \
                     (Mesa's llvmpipe, Debian's mesa-vulkan-drivers, needs no GPU)\n";
        }
        text
    }
}
