//! The viewer in a window of its own on a virtual screen: keys and mouse go in, files and the window's picture come out.
#![cfg(all(feature = "viewer", target_os = "linux"))]
#![expect(clippy::unwrap_used, reason = "a test's helpers may fail the test")]

use std::{
    fs,
    io::{BufRead, BufReader, Write},
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    time::{Duration, Instant},
};

use assert_cmd::cargo::cargo_bin;
use glam::Vec3;
use isophote_scene::Image;

/// How long a picture may take on a machine that is busy with other tests.
const PATIENCE: Duration = Duration::from_secs(60);

/// A screen that nobody sees.
struct Screen {
    server: Child,
    name: String,
}

impl Screen {
    /// None, loudly, where it cannot be and need not.
    fn open() -> Option<Self> {
        let is_there = |program: &str| {
            let paths = std::env::var_os("PATH").unwrap_or_default();
            std::env::split_paths(&paths).any(|folder| folder.join(program).exists())
        };
        let adapters = run(Path::new("."), &["devices"], None);
        let has_adapter = String::from_utf8_lossy(&adapters.stdout).contains("gpu");
        for (found, what) in [
            (is_there("Xvfb"), "Xvfb, the virtual screen"),
            (is_there("xdotool"), "xdotool, which types and clicks"),
            (has_adapter, "a GPU adapter that draws the window"),
        ] {
            if !found {
                let required =
                    std::env::var_os("ISOPHOTE_REQUIRE_GPU").is_some_and(|value| value == "1");
                assert!(!required, "a test of the viewer needs {what}");
                let _ = writeln!(
                    std::io::stderr(),
                    "SKIPPED a test of the viewer: there is no {what}"
                );
                return None;
            }
        }
        // Without -noreset the server starts over whenever its last client leaves, as xdotool does after
        // every word, and a window that is opening just then is cut off.
        let mut server = Command::new("Xvfb")
            .args([
                "-noreset",
                "-displayfd",
                "1",
                "-screen",
                "0",
                "1000x700x24",
                "-nolisten",
                "tcp",
            ])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut number = String::new();
        let said = server.stdout.take().unwrap();
        BufReader::new(said).read_line(&mut number).unwrap();
        let name = format!(":{}", number.trim());
        Some(Self { server, name })
    }

    fn xdotool(&self, arguments: &[&str]) -> String {
        let mut command = Command::new("xdotool");
        let output = command
            .args(arguments)
            .env("DISPLAY", &self.name)
            .output()
            .unwrap();
        String::from_utf8_lossy(&output.stdout).trim().to_owned()
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// The program in a folder of its own, on a screen or on none.
fn run(folder: &Path, arguments: &[&str], screen: Option<&Screen>) -> Output {
    program(folder, arguments, screen).output().unwrap()
}

fn program(folder: &Path, arguments: &[&str], screen: Option<&Screen>) -> Command {
    let mut command = Command::new(cargo_bin!("isophote"));
    command
        .args(arguments)
        .current_dir(folder)
        .env_remove("RUST_LOG");
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    if let Some(screen) = screen {
        command.env("DISPLAY", &screen.name);
    }
    command
}

/// A window that is open.
struct Window<'a> {
    screen: &'a Screen,
    viewer: Child,
    folder: PathBuf,
    id: String,
    pictures: u32,
    shots: u32,
}

impl<'a> Window<'a> {
    fn open(screen: &'a Screen, folder: &Path, arguments: &[&str]) -> Self {
        let viewer = program(folder, arguments, Some(screen)).spawn().unwrap();
        let mut window = Self {
            screen,
            viewer,
            folder: folder.to_owned(),
            id: String::new(),
            pictures: 0,
            shots: 0,
        };
        window.wait(|window| {
            window.id = screen.xdotool(&["search", "--onlyvisible", "--name", "^isophote"]);
            !window.id.is_empty()
        });
        screen.xdotool(&["windowfocus", &window.id]);
        window
    }

    fn title(&self) -> String {
        self.screen.xdotool(&["getwindowname", &self.id])
    }

    fn wait(&mut self, mut until: impl FnMut(&mut Self) -> bool) {
        let start = Instant::now();
        while !until(self) {
            let ended = self.viewer.try_wait().unwrap();
            assert!(ended.is_none(), "the viewer ended: {ended:?}");
            assert!(
                start.elapsed() < PATIENCE,
                "waited in vain at '{}'",
                self.title()
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    fn wait_for_title(&mut self, part: &str) {
        self.wait(|window| window.title().contains(part));
    }

    fn press(&self, key: &str) {
        self.screen.xdotool(&["key", key]);
    }

    fn wait_for_file(&mut self, name: &str) -> PathBuf {
        let path = self.folder.join(name);
        self.wait(|_| path.exists());
        path
    }

    /// The picture as the viewer saves it, once it is finished.
    fn picture(&mut self) -> Image {
        self.press("F3");
        self.pictures += 1;
        let name = format!("picture-{:03}.exr", self.pictures);
        Image::load(self.wait_for_file(&name)).unwrap()
    }

    /// The part of the window that shows the picture.
    fn seen(&mut self, size: [u32; 2]) -> Vec<Vec3> {
        self.press("F2");
        self.shots += 1;
        let name = format!("window-{:03}.png", self.shots);
        let window = Image::load(self.wait_for_file(&name)).unwrap();
        let pixels = window.rgb("").unwrap();
        let rows = pixels.chunks_exact(window.width as usize);
        let rows = rows.take(size[1] as usize);
        rows.flat_map(|row| row[..size[0] as usize].to_vec())
            .collect()
    }

    fn close(mut self) {
        self.press("ctrl+q");
        let start = Instant::now();
        loop {
            if let Some(status) = self.viewer.try_wait().unwrap() {
                assert!(status.success(), "{status}");
                return;
            }
            assert!(start.elapsed() < PATIENCE, "the viewer does not end");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Window<'_> {
    fn drop(&mut self) {
        let _ = self.viewer.kill();
        let _ = self.viewer.wait();
    }
}

/// RMS difference over the mean of the second.
fn difference(a: &[Vec3], b: &[Vec3]) -> f32 {
    assert_eq!(a.len(), b.len());
    let squares: f32 = a
        .iter()
        .zip(b)
        .map(|(a, b)| (*a - *b).length_squared())
        .sum();
    (squares / (3 * a.len()) as f32).sqrt() / mean(b)
}

fn mean(values: &[Vec3]) -> f32 {
    values.iter().map(|value| value.element_sum()).sum::<f32>() / (3 * values.len()) as f32
}

/// What `isophote render` makes of the settings in a file's header.
fn rendered_again(folder: &Path, file: &str) -> Vec<Vec3> {
    let output = run(
        folder,
        &["render", "--settings", file, "-q", "-o", "again.exr"],
        None,
    );
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    Image::load(folder.join("again.exr"))
        .unwrap()
        .rgb("")
        .unwrap()
}

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
    let corner = window
        .screen
        .xdotool(&["getwindowgeometry", "--shell", &window.id]);
    assert!(corner.contains("X="), "{corner}");
    screen.xdotool(&["mousemove", "--window", &window.id, "100", "70"]);
    screen.xdotool(&["mousedown", "1"]);
    for _ in 0..5 {
        screen.xdotool(&["mousemove_relative", "--", "6", "3"]);
        std::thread::sleep(Duration::from_millis(30));
    }
    screen.xdotool(&["mouseup", "1"]);
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
