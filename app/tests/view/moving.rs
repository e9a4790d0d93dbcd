//! What moves: the camera by keys and mouse, things by time and by hand, and the line between two pictures.

use std::{fs, path::Path, time::Duration};

use glam::Vec3;
use isophote_scene::Image;
use serde_json::json;

use crate::window::{Screen, Window, difference, rendered_again};

/// Where the camera of a picture is, and what it looks at.
fn camera(picture: &Image) -> [Vec3; 2] {
    let numbers = picture.attributes["camera"].split(',');
    let numbers: Vec<f32> = numbers.map(|text| text.parse().unwrap()).collect();
    [
        Vec3::from_slice(&numbers[..3]),
        Vec3::from_slice(&numbers[3..6]),
    ]
}

#[test]
fn the_camera_flies_looks_around_and_comes_back() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let arguments = [
        "view",
        "builtin:cornell",
        "--device",
        "cpu",
        "--quantity",
        "ao",
        "--d-max",
        "1",
        "--spp",
        "2",
        "--size",
        "160x120",
        "--camera",
        "0.28,0.27,-0.8,0.28,0.27,0.2,40",
    ];
    let mut window = Window::open(&screen, at, &arguments);
    window.wait_for_title("finished, picture");
    let first = window.picture();
    let [mut eye, mut target] = camera(&first);
    // By its own axes: right, up, ahead.
    for (key, along) in [("w", Vec3::Z), ("Right", Vec3::NEG_X), ("q", Vec3::NEG_Y)] {
        window.hold(key);
        let [new_eye, new_target] = camera(&window.picture());
        let step = new_eye - eye;
        assert!(
            step.dot(along) > 0.02 && step.dot(along) > 0.999 * step.length(),
            "{key}: {step}"
        );
        assert!((new_target - new_eye).normalize().dot(Vec3::Z) > 0.9999);
        (eye, target) = (new_eye, new_target);
    }
    let ahead = |eye: Vec3, target: Vec3| (target - eye).normalize();

    // To the right with the right button: the eye stays, and looks to the left.
    window.drag("3", [60, 60], [6, 0]);
    let looked = window.picture();
    let [new_eye, new_target] = camera(&looked);
    assert!(new_eye.distance(eye) < 1e-4);
    let turned = ahead(new_eye, new_target) - ahead(eye, target);
    assert!(turned.x.abs() > 0.1 && turned.y.abs() < 1e-3, "{turned}");
    (eye, target) = (new_eye, new_target);

    // With the middle one the picture is shifted: the direction stays.
    window.drag("2", [60, 60], [0, 4]);
    let [new_eye, new_target] = camera(&window.picture());
    assert!(ahead(new_eye, new_target).dot(ahead(eye, target)) > 0.9999);
    let step = new_eye - eye;
    assert!(step.y > 0.003 && step.y > 0.9 * step.length(), "{step}");
    (eye, target) = (new_eye, new_target);

    // The wheel comes nearer to what is looked at.
    screen.xdotool(&["click", "--repeat", "3", "4"]);
    std::thread::sleep(Duration::from_millis(500));
    let near = window.picture();
    let [new_eye, new_target] = camera(&near);
    assert!(ahead(new_eye, new_target).dot(ahead(eye, target)) > 0.9999);
    assert!((new_eye - eye).dot(ahead(eye, target)) > 0.003);
    let values = near.rgb("").unwrap();
    assert!(difference(&values, &first.rgb("").unwrap()) > 0.02);
    assert_eq!(rendered_again(at, "picture-007.exr"), values);

    // Back to the scene's own, which has a name.
    window.press("Home");
    assert!(!window.picture().attributes["camera"].contains(','));
    window.close();
}

/// A plate that goes to and fro over a floor.
fn write_animated(folder: &Path) {
    let square = [
        [-1.0_f32, 0.0, -1.0],
        [-1.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
        [1.0, 0.0, -1.0],
    ];
    let floats =
        |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|x| x.to_le_bytes()).collect() };
    let places = [[-0.6_f32, 0.4, 0.0], [0.6, 0.4, 0.0]];
    let parts = [
        floats(square.as_flattened()),
        [0_u16, 1, 2, 0, 2, 3]
            .iter()
            .flat_map(|i| i.to_le_bytes())
            .collect(),
        floats(&[0.0, 20.0]),
        floats(places.as_flattened()),
    ];
    let mut views = Vec::new();
    for part in &parts {
        let before: usize = parts[..views.len()].iter().map(Vec::len).sum();
        views.push(json!({ "buffer": 0, "byteOffset": before, "byteLength": part.len() }));
    }
    let accessor = |view: usize, of: u32, count: usize, kind: &str| json!({ "bufferView": view, "componentType": of, "count": count, "type": kind });
    let bytes = parts.concat();
    let file = json!({
        "asset": { "version": "2.0" },
        "scenes": [{ "nodes": [0, 1] }],
        "nodes": [
            { "mesh": 0, "name": "floor" },
            { "mesh": 0, "name": "plate", "translation": places[0], "scale": [0.5, 0.5, 0.5] },
        ],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [accessor(0, 5126, 4, "VEC3"), accessor(1, 5123, 6, "SCALAR"), accessor(2, 5126, 2, "SCALAR"), accessor(3, 5126, 2, "VEC3")],
        "bufferViews": views,
        "buffers": [{ "byteLength": bytes.len(), "uri": "moves.bin" }],
        "animations": [{
            "samplers": [{ "input": 2, "output": 3 }],
            "channels": [{ "sampler": 0, "target": { "node": 1, "path": "translation" } }],
        }],
    });
    fs::write(folder.join("moves.bin"), bytes).unwrap();
    fs::write(folder.join("moves.gltf"), file.to_string()).unwrap();
}

#[test]
fn time_passes_and_the_file_knows_where_everything_is() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_animated(at);
    let arguments = [
        "view",
        "moves.gltf",
        "--device",
        "cpu",
        "--quantity",
        "ao",
        "--spp",
        "4",
        "--size",
        "160x120",
        "--camera",
        "0,3,3,0,0,0,50",
        "--move",
        "plate=0,0.2,0,30",
    ];
    let mut window = Window::open(&screen, at, &arguments);
    window.wait_for_title("finished, picture");
    let first = window.picture();
    let values = first.rgb("").unwrap();
    assert_eq!(rendered_again(at, "picture-001.exr"), values);
    window.press("p");
    std::thread::sleep(Duration::from_millis(1500));
    window.press("p");
    let later = window.picture();
    let time: f32 = later.attributes["time"].parse().unwrap();
    assert!((0.5..20.0).contains(&time), "{time} s");
    assert_eq!(later.attributes["move"], first.attributes["move"]);
    let moved = later.rgb("").unwrap();
    assert!(difference(&moved, &values) > 0.01, "the plate did not move");
    assert_eq!(rendered_again(at, "picture-002.exr"), moved);
    // It stands still.
    assert_eq!(window.picture().rgb("").unwrap(), moved);
    window.close();
}

#[test]
fn the_line_between_two_pictures_is_dragged() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let arguments = [
        "view",
        "builtin:cornell",
        "--device",
        "cpu",
        "--quantity",
        "ao",
        "--d-max",
        "1",
        "--spp",
        "1",
        "--size",
        "200x150",
    ];
    let mut window = Window::open(&screen, at, &arguments);
    window.wait_for_title("finished, picture");
    let saved = window.picture();
    let size = [saved.width, saved.height];
    let picture = window.seen(size);
    window.press("3");
    window.wait_for_title("picture and reference of");
    // The right answer is not this noisy any more.
    window.wait(|window| {
        !["of 1 ", "of 2 ", "of 3 "]
            .iter()
            .any(|few| window.title().contains(few))
    });
    let columns = |pixels: &[Vec3], from: usize, to: usize| -> Vec<Vec3> {
        let rows = pixels.chunks_exact(size[0] as usize);
        rows.flat_map(|row| row[from..to].to_vec()).collect()
    };
    let same = |a: &[Vec3], b: &[Vec3], from, to| {
        difference(&columns(a, from, to), &columns(b, from, to)) < 1e-3
    };
    let before = window.seen(size);
    assert!(same(&before, &picture, 0, 96));
    assert!(!same(&before, &picture, 104, 146) && !same(&before, &picture, 154, 200));
    window.drag("1", [100, 70], [10, 0]);
    let after = window.seen(size);
    assert!(same(&after, &picture, 0, 146), "the line was not moved");
    assert!(!same(&after, &picture, 154, 200));
    // And nothing else was.
    assert_eq!(
        window.picture().attributes["camera"],
        saved.attributes["camera"]
    );
    window.close();
}
