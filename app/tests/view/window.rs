//! A window on a screen that nobody sees: keys and mouse go in, its title, files and picture come out.

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
use tempfile::NamedTempFile;

/// How long a picture may take on a machine that is busy with other tests.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// A screen that nobody sees.
pub(crate) struct Screen {
    server: Child,
    name: String,
}

impl Screen {
    /// None, loudly, where it cannot be and need not.
    pub(crate) fn open() -> Option<Self> {
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

    pub(crate) fn xdotool(&self, arguments: &[&str]) -> String {
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
pub(crate) fn run(folder: &Path, arguments: &[&str], screen: Option<&Screen>) -> Output {
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
pub(crate) struct Window<'a> {
    screen: &'a Screen,
    pub(crate) viewer: Child,
    pub(crate) folder: PathBuf,
    /// What it printed on standard error.
    said: NamedTempFile,
    id: String,
    pictures: u32,
    shots: u32,
}

impl<'a> Window<'a> {
    pub(crate) fn open(screen: &'a Screen, folder: &Path, arguments: &[&str]) -> Self {
        let said = NamedTempFile::new().unwrap();
        let viewer = program(folder, arguments, Some(screen))
            .stderr(said.reopen().unwrap())
            .spawn()
            .unwrap();
        let mut window = Self {
            screen,
            viewer,
            folder: folder.to_owned(),
            said,
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

    pub(crate) fn title(&self) -> String {
        self.screen.xdotool(&["getwindowname", &self.id])
    }

    pub(crate) fn wait(&mut self, mut until: impl FnMut(&mut Self) -> bool) {
        let start = Instant::now();
        while !until(self) {
            let ended = self.viewer.try_wait().unwrap();
            assert!(
                ended.is_none(),
                "the viewer ended: {ended:?}, {}",
                self.said()
            );
            assert!(
                start.elapsed() < PATIENCE,
                "waited in vain at '{}'; {}",
                self.title(),
                self.said()
            );
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    pub(crate) fn wait_for_title(&mut self, part: &str) {
        self.wait(|window| window.title().contains(part));
    }

    /// What it has printed on standard error so far.
    pub(crate) fn said(&self) -> String {
        fs::read_to_string(self.said.path()).unwrap()
    }

    pub(crate) fn press(&self, key: &str) {
        self.screen.xdotool(&["key", key]);
    }

    /// As [`Self::press`], without waiting until the key is up again.
    pub(crate) fn begin_to_press(&self, key: &str) -> Child {
        let mut command = Command::new("xdotool");
        command.args(["key", key]).env("DISPLAY", &self.screen.name);
        command.spawn().unwrap()
    }

    /// Holds a key down for a while.
    pub(crate) fn hold(&self, key: &str) {
        self.screen.xdotool(&["keydown", key]);
        std::thread::sleep(Duration::from_millis(300));
        self.screen.xdotool(&["keyup", key]);
    }

    /// Drags from a point of the window by five times as many pixels.
    pub(crate) fn drag(&self, button: &str, [x, y]: [u32; 2], [right, down]: [i32; 2]) {
        let screen = self.screen;
        let [x, y] = [x, y].map(|pixel| pixel.to_string());
        screen.xdotool(&["mousemove", "--window", &self.id, &x, &y]);
        screen.xdotool(&["mousedown", button]);
        let [right, down] = [right, down].map(|pixels| pixels.to_string());
        for _ in 0..5 {
            screen.xdotool(&["mousemove_relative", "--", &right, &down]);
            std::thread::sleep(Duration::from_millis(30));
        }
        screen.xdotool(&["mouseup", button]);
    }

    pub(crate) fn wait_for_file(&mut self, name: &str) -> PathBuf {
        let path = self.folder.join(name);
        self.wait(|_| path.exists());
        path
    }

    /// The picture as the viewer saves it, once it is finished.
    pub(crate) fn picture(&mut self) -> Image {
        self.press("F3");
        self.pictures += 1;
        let name = format!("picture-{:03}.exr", self.pictures);
        Image::load(self.wait_for_file(&name)).unwrap()
    }

    /// The part of the window that shows the picture.
    pub(crate) fn seen(&mut self, size: [u32; 2]) -> Vec<Vec3> {
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

    pub(crate) fn close(mut self) {
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
pub(crate) fn difference(a: &[Vec3], b: &[Vec3]) -> f32 {
    assert_eq!(a.len(), b.len());
    let squares: f32 = a
        .iter()
        .zip(b)
        .map(|(a, b)| (*a - *b).length_squared())
        .sum();
    (squares / (3 * a.len()) as f32).sqrt() / mean(b)
}

pub(crate) fn mean(values: &[Vec3]) -> f32 {
    values.iter().map(|value| value.element_sum()).sum::<f32>() / (3 * values.len()) as f32
}

/// What `isophote render` makes of the settings in a file's header.
pub(crate) fn rendered_again(folder: &Path, file: &str) -> Vec<Vec3> {
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
