//! The viewer in a window of its own on a virtual screen: keys and mouse go in, files and the window's picture come out.
#![cfg(all(feature = "viewer", target_os = "linux"))]
#![expect(clippy::unwrap_used, reason = "a test's helpers may fail the test")]

mod moving;
mod saving;
mod window;

use std::{
    fs,
    path::{Path, PathBuf},
    time::Duration,
};

use glam::Vec3;
use isophote_scene::Image;

use crate::window::{Screen, Window, difference, mean, rendered_again, run};

#[test]
fn a_scene_is_looked_at_from_all_sides() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let settings = [
        "--size",
        "200x150",
        "--igi-paths",
        "60",
        "--spp",
        "2",
        "--materials",
        "lambert",
    ];
    let first = [
        "view",
        "builtin:cornell",
        "--technique",
        "igi",
        "--device",
        "cpu",
    ];
    let mut window = Window::open(&screen, at, &[&first[..], &settings].concat());

    // The picture in the window is the one in the file, and that of `isophote render`.
    window.wait_for_title("igi by bvh, finished, picture");
    let saved = window.picture();
    let (size, picture) = ([saved.width, saved.height], saved.rgb("").unwrap());
    assert_eq!(size[0], 200);
    assert!(mean(&picture) > 0.05, "the picture is black");
    assert_eq!(saved.attributes["technique"], "igi");
    assert_eq!(rendered_again(at, "picture-001.exr"), picture);
    let png = Image::load(at.join("picture-001.png"))
        .unwrap()
        .rgb("")
        .unwrap();
    let seen = window.seen(size);
    assert!(
        difference(&seen, &png) < 0.01,
        "the window shows something else"
    );

    // Space flips to the right answer, which is noisy but alike.
    window.press("space");
    window.wait_for_title("reference of 2 samples");
    window.wait(|window| !window.title().contains("of 2 samples"));
    let reference = window.seen(size);
    let error = difference(&seen, &reference);
    assert!(
        (0.02..0.6).contains(&error),
        "the reference is off by {error}"
    );
    let ratio = mean(&reference) / mean(&seen);
    assert!(
        (0.6..1.4).contains(&ratio),
        "the reference is {ratio} times as light"
    );

    // Beside each other: left the one, right the other.
    window.press("3");
    window.wait_for_title("picture and reference");
    let both = window.seen(size);
    let half = |pixels: &[Vec3], right: bool| -> Vec<Vec3> {
        let width = size[0] as usize;
        let (from, to) = if right {
            (width / 2 + 4, width)
        } else {
            (0, width / 2 - 4)
        };
        pixels
            .chunks_exact(width)
            .flat_map(|row| row[from..to].to_vec())
            .collect()
    };
    assert!(difference(&half(&both, false), &half(&seen, false)) < 0.01);
    assert!(difference(&half(&both, true), &half(&seen, true)) > 0.01);
    window.press("4");
    window.wait_for_title("error against reference");
    let map = window.seen(size);
    assert!(difference(&map, &seen) > 0.3 && mean(&map) > 0.01);

    // The camera goes around, and the file knows where it went.
    window.press("space");
    window.press("space");
    window.press("1");
    window.wait_for_title("finished, picture");
    window.drag("1", [100, 70], [6, 3]);
    std::thread::sleep(Duration::from_millis(300));
    window.wait_for_title("finished, picture");
    let moved = window.picture();
    let values = moved.rgb("").unwrap();
    assert!(
        moved.attributes["camera"].contains(','),
        "{:?}",
        moved.attributes["camera"]
    );
    assert!(
        difference(&values, &picture) > 0.1,
        "the camera did not move"
    );
    assert_eq!(rendered_again(at, "picture-002.exr"), values);

    // The next technique that can be.
    window.press("t");
    window.wait_for_title("ldm by bvh, finished");
    assert_eq!(window.picture().attributes["technique"], "ldm");
    window.close();
}

/// The shaders of this checkout, copied to where they can be changed.
fn copy_shaders(to: &Path) {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut folders: Vec<PathBuf> = ["scene", "filters", "ldi", "instant-gi"]
        .map(|of| Path::new(of).join("shaders"))
        .into();
    while let Some(folder) = folders.pop() {
        fs::create_dir_all(to.join(&folder)).unwrap();
        for entry in fs::read_dir(workspace.join(&folder)).unwrap() {
            let path = folder.join(entry.unwrap().file_name());
            if workspace.join(&path).is_dir() {
                folders.push(path);
            } else {
                fs::copy(workspace.join(&path), to.join(&path)).unwrap();
            }
        }
    }
}

#[test]
fn shaders_change_under_its_hands_and_old_ones_stay_where_new_ones_fail() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    copy_shaders(at);
    let file = at.join("scene/shaders/reference/occlusion.wesl");
    let good = fs::read_to_string(&file).unwrap();
    let what = [
        "--quantity",
        "ao",
        "--d-max",
        "1",
        "--spp",
        "4",
        "--size",
        "120x90",
    ];
    let how = [
        "view",
        "builtin:cornell",
        "--device",
        "gpu",
        "--shaders",
        ".",
    ];
    let mut window = Window::open(&screen, at, &[&how[..], &what].concat());
    window.wait_for_title("finished, picture");
    let before = window.picture();
    assert!(before.attributes["device"].starts_with("gpu"));
    let ao = before.rgb("").unwrap();

    fs::write(
        &file,
        good.replace("var rays = 0u;", "var rays: u32 = 1.5f;"),
    )
    .unwrap();
    window.wait_for_title("finished with old shaders, picture");
    assert_eq!(window.picture().rgb("").unwrap(), ao);

    let half = good.replace("select(1.0, 0.0, any_hit", "select(0.5, 0.0, any_hit");
    assert_ne!(half, good);
    fs::write(&file, half).unwrap();
    window.wait_for_title("finished, picture");
    // What sees no surface is 1 all the same.
    let halved = window.picture();
    let (values, depth) = (halved.rgb("").unwrap(), halved.channel("depth.Z").unwrap());
    for ((value, ao), depth) in values.iter().zip(&ao).zip(depth) {
        if depth.is_finite() && ao.x < 1.0 {
            assert!(
                (value.x - 0.5 * ao.x).abs() < 0.26,
                "{value}, not half of {ao}"
            );
        }
    }
    assert!(mean(&values) < 0.9 * mean(&ao));
    window.close();
}

#[test]
fn without_a_screen_it_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &["view", "builtin:cornell"], None);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.starts_with("error: cannot open a window"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(fs::read_dir(folder.path()).unwrap().next().is_none());
}
