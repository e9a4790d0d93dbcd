//! Pictures against each other.

use std::fs;

use glam::Vec3;
use isophote_scene::Image;
use serde_json::Value;

use crate::{Place, text};

#[test]
fn comparisons_measure_and_gate() {
    let place = Place::new();
    let render = |quantity: &str, spp: &str, seed: &str, name: &str| {
        let quantity = format!("--quantity={quantity}");
        place.ok(&[
            "render",
            "builtin:cornell",
            "-q",
            "--size=24x24",
            "--materials=lambert",
            &quantity,
            "--spp",
            spp,
            "--seed",
            seed,
            "-o",
            name,
        ]);
    };
    render("direct", "64", "1", "a.exr");
    render("direct", "64", "2", "b.exr");
    render("ao,direct", "64", "1", "both.exr");
    let report = place.json(&[
        "compare",
        "a.exr",
        "b.exr",
        "--json",
        "--error-image",
        "error.png",
    ]);
    let number = |name: &str| report[name].as_f64().unwrap();
    assert_eq!(report["headline"], "relrmse");
    assert!(
        number("rel_rmse") > 0.0 && number("rel_rmse_beyond_noise") <= 0.5 * number("rel_rmse")
    );
    assert!(number("bias").abs() < 0.02 && number("constant_ratio") > 5.0);
    assert!(number("ssim") > 0.9 && number("flip") < 0.1 && number("psnr") > 20.0);
    assert!(report["silhouettes"]["share"].as_f64().unwrap() > 0.0);
    assert_eq!(place.image("error.png").width, 24);
    let same = place.json(&[
        "compare",
        "both.exr",
        "a.exr",
        "--layer=direct",
        "--json",
        "--error-image=e.exr",
    ]);
    assert_eq!(same["rel_rmse"], 0.0);
    assert!(
        place
            .image("e.exr")
            .rgb("")
            .unwrap()
            .iter()
            .all(|pixel| pixel.length() == 0.0)
    );
    let ao = place.run(&["compare", "both.exr", "both.exr", "--layer=ao"]);
    assert!(text(&ao.stdout).lines().nth(1).unwrap().starts_with("rms"));
    let code = |flag| {
        place
            .run(&["compare", "a.exr", "b.exr", flag])
            .status
            .code()
    };
    assert_eq!(code("--max-relrmse=0.5"), Some(0));
    assert_eq!(code("--max-rms=200"), Some(0));
    render("direct", "64", "1", "c.exr");
    let mut darker = place.image("c.exr");
    for channel in &mut darker.channels {
        channel.samples.iter_mut().for_each(|value| *value *= 0.5);
    }
    darker.save(place.path("c.exr")).unwrap();
    let gate = place.run(&["compare", "c.exr", "b.exr", "--json", "--max-relrmse=0.04"]);
    assert_eq!(gate.status.code(), Some(1));
    let report: Value = serde_json::from_slice(&gate.stdout).unwrap();
    assert!((report["bias"].as_f64().unwrap() + 0.5).abs() < 0.01);
}

#[test]
fn wrong_comparisons_are_refused() {
    let place = Place::new();
    let save = |name: &str, width: u32, value: f32| {
        let mut image = Image::new(width, 2);
        let mut values = vec![Vec3::ONE; 2 * width as usize];
        values[1].y = value;
        image.push_layer("", "RGB", &values);
        image.save(place.path(name)).unwrap();
    };
    save("a.exr", 2, 0.5);
    save("b.exr", 3, 0.5);
    save("nan.exr", 2, f32::NAN);
    save("a.png", 2, 0.5);
    place
        .put("cut.exr", &fs::read(place.path("a.exr")).unwrap()[..150])
        .put("empty.exr", "");
    place.ok(&["compare", "a.exr", "a.png"]);
    for (arguments, expected) in [
        (&["a.exr", "b.exr"][..], "2×2 pixels"),
        (&["a.exr", "nan.exr"], "1 of 4 pixels are NaN"),
        (&["no.exr", "a.exr"], "no.exr"),
        (&["cut.exr", "a.exr"], "cut.exr"),
        (&["a.exr", "empty.exr"], "empty"),
        (&["a.exr", "a.txt"], "suffix"),
        (&["a.exr"], "REFERENCE"),
        (&["a.exr", "a.exr", "--error-image=e.jpg"], "suffix"),
        (
            &["a.exr", "a.exr", "--error-image=no/e.png"],
            "does not exist",
        ),
    ] {
        place.refused(&[&["compare"], arguments].concat(), expected);
    }
    place.put("a.json", "[]");
    place.refused(&["compare", "a.exr", "a.exr"], "a.json");
}

#[test]
fn a_record_beside_a_reference_tells_its_noise() {
    let place = Place::new();
    let mut image = Image::new(2, 1);
    image.push_layer("", "RGB", &[Vec3::ONE, Vec3::splat(0.5)]);
    image.save(place.path("ref.exr")).unwrap();
    image.save(place.path("test.exr")).unwrap();
    place.put(
        "ref.json",
        r#"{"quantity": "ao_1.5m", "relative_noise": 0.25}"#,
    );
    let report = place.json(&["compare", "test.exr", "ref.exr", "--json"]);
    assert_eq!(report["noise_reference"], 0.25);
    assert_eq!(report["noise_test"], Value::Null);
    assert_eq!(
        (&report["quantity"], &report["headline"]),
        (&"ao".into(), &"rms".into())
    );
    // Equal pictures: no finite decibels.
    assert_eq!(report["psnr"], Value::Null);
}
