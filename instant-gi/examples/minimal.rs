//! Indirect light by virtual point lights: `cargo run --release -p isophote-instant-gi --example minimal -- out.png`.

use std::{path::Path, sync::Arc};

use isophote_instant_gi::{GiParams, InstantGi};
use isophote_scene::{BuildTracer, BvhOptions, BvhTracer, Selection, builtin, reference::Tracers};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let output = std::env::args().nth(1).unwrap_or("minimal.png".into());
    let scene = Arc::new(builtin::build("builtin:office")?);
    let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default())?;
    let tracers = Tracers {
        exact: &exact,
        secondary: &exact,
    };
    // The paper's shortcuts: every 4th pixel, and of 3 × 3 of those each a ninth of the lights.
    let params = GiParams {
        downsampling: 4,
        interleaving: [3, 3],
        ..GiParams::default()
    };
    let size = [800, 600];
    let stages =
        InstantGi::new(&scene, tracers, &params)?.render(&scene.cameras[0], size, &|_, _| {})?;
    stages.image(size).save(Path::new(&output))?;
    println!("{output}: {} virtual point lights", stages.vpls.len());
    for pass in &stages.passes {
        println!(
            "{:10} {:8.1} ms {:10} rays",
            pass.name,
            1e3 * pass.seconds,
            pass.rays
        );
    }
    Ok(())
}
