//! Ambient occlusion by displacement fields: `cargo run --release -p isophote-displacement-field --example minimal -- out.png`.

use std::{path::Path, sync::Arc};

use glam::Vec3;
use isophote_displacement_field::{FieldTracer, LookUp, Object, ObjectParams};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Image, InstanceMask, Scene, Selection, builtin,
    reference::{Quantity, Settings, Tracers, render},
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let output = std::env::args().nth(1).unwrap_or("minimal.png".into());
    let mut scene = builtin::build("builtin:corner")?;
    // The three planes and a stretched box receive and do not cast.
    for other in [0, 1, 2, 6] {
        scene.instances[other].mask = InstanceMask::NONE;
    }
    let scene = Arc::new(scene);
    let (casters, options) = (Selection::default(), BvhOptions::default());
    let exact = |scene: &Arc<Scene>| BvhTracer::build(scene, &casters, &options);
    let params = ObjectParams::default();
    let objects = Object::build_all(&scene, &casters, &params, &exact, &|_, _| {})?;
    let fields = FieldTracer::new(&scene, &casters, objects, LookUp::Interpolated)?;
    let everything = Selection {
        mask: InstanceMask::NONE,
        bounds: None,
    };
    let camera_rays = BvhTracer::build(&scene, &everything, &options)?;
    let tracers = Tracers {
        exact: &camera_rays,
        secondary: &fields,
    };
    let size = [640, 480];
    let picture = render(
        &scene,
        tracers,
        &scene.cameras[0],
        size,
        &[Quantity::Ao],
        &Settings::default(),
        &|_, _| {},
    )?;
    let values: &[Vec3] = &picture.estimates[0].values;
    let mut image = Image::new(size[0], size[1]);
    image.push_layer("", "RGB", values);
    image.save(Path::new(&output))?;
    println!(
        "{output}: {} rays, {} bytes of fields",
        picture.rays,
        fields.bytes()
    );
    Ok(())
}
