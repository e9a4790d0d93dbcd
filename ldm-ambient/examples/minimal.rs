//! Ambient occlusion and indirect light: `cargo run --release -p isophote-ldm-ambient --example minimal -- ao.png light.png`.

use std::{path::Path, sync::Arc};

use glam::Vec3;
use isophote_ldm_ambient::{
    OcclusionParams, PhotonParams,
    cpu::{Points, Triangles, occlusion::Occlusion, photons::light},
};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, GBuffer, Image, Selection, builtin,
    reference::{Materials, Normals},
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut outputs = std::env::args().skip(1);
    let scene = Arc::new(builtin::build("builtin:office")?);
    let exact = BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default())?;
    let triangles = Triangles::new(&scene, &scene.transforms(), &Selection::default())?;
    let (camera, size) = (&scene.cameras[0], [640, 480]);
    let save = |output: Option<String>, default: &str, values: &[Vec3]| {
        let output = output.unwrap_or(default.into());
        let mut image = Image::new(size[0], size[1]);
        image.push_layer("", "RGB", values);
        println!("{output}");
        image.save(Path::new(&output))
    };

    // Four points a pixel, which share the maps.
    let mut occlusion = Occlusion::new(&triangles, 640 * 480, &OcclusionParams::default())?;
    for sample in 0..4 {
        let points = Points::from_camera(&scene, &exact, camera, size, sample, Normals::Smooth);
        occlusion.add(&points, [sample, 4], &|_, _| {});
    }
    let open: Vec<Vec3> = occlusion
        .skies()
        .iter()
        .map(|sky| Vec3::splat(sky.ao))
        .collect();
    save(outputs.next(), "ao.png", &open)?;

    let seen = GBuffer::see(&scene, &exact, camera, size, Materials::Lambert);
    let lit = light(
        &triangles,
        &exact,
        camera,
        &seen,
        &PhotonParams::default(),
        &|_, _| {},
    )?;
    save(outputs.next(), "light.png", &lit.indirect)?;
    for pass in &lit.passes {
        println!("{:10} {:8.1} ms", pass.name, 1e3 * pass.seconds);
    }
    Ok(())
}
