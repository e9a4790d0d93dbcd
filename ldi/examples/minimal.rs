//! One bounce of light by layered depth images: `cargo run --release -p isophote-ldi --example minimal -- out.png`.

use std::{path::Path, sync::Arc};

use isophote_ldi::{Hybrid, HybridParams, LdiParams, LdiTracer};
use isophote_scene::{BuildTracer, BvhOptions, BvhTracer, Selection, builtin, reference::Tracers};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let output = std::env::args().nth(1).unwrap_or("minimal.png".into());
    let scene = Arc::new(builtin::build("builtin:office")?);
    let everything = Selection::default();
    let exact = BvhTracer::build(&scene, &everything, &BvhOptions::default())?;
    let maps = LdiTracer::build(&scene, &everything, &LdiParams::default())?;
    let tracers = Tracers {
        exact: &exact,
        secondary: &maps,
    };
    let size = [640, 480];
    let hybrid = Hybrid::new(&scene, tracers, &HybridParams::default())?;
    let stages = hybrid.render(&scene.cameras[0], size, &|_, _| {})?;
    stages.image(size).save(Path::new(&output))?;
    println!("{output}: {} rays", stages.rays());
    Ok(())
}
