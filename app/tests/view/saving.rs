//! Saving that is cut short: what is there is whole, why something is not is told, and the next try works.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    time::Instant,
};

use isophote_scene::Image;

use crate::window::{PATIENCE, Screen, Window, rendered_again};

/// A picture that is soon there, in a folder.
const WHAT: [&str; 12] = [
    "view",
    "builtin:cornell",
    "--device",
    "cpu",
    "--quantity",
    "ao",
    "--spp",
    "2",
    "--size",
    "400x320",
    "--output",
    "out",
];

/// Files by their names, but for those that have none yet: on Linux they get their first name when all of them is written.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    let is_named = |path: &PathBuf| !path.to_string_lossy().contains("/.isophote-");
    files.retain(is_named);
    files.sort();
    files
}

fn check_all_are_whole(folder: &Path) {
    for file in files(folder) {
        let image = Image::load(&file).unwrap();
        assert_eq!(image.width, 400, "{}", file.display());
    }
}

/// Whether a process has a file of a folder open that is not in it yet.
fn is_writing(process: u32, folder: &Path) -> bool {
    let Ok(open) = fs::read_dir(format!("/proc/{process}/fd")) else {
        return false;
    };
    let mut targets = open.filter_map(|entry| fs::read_link(entry.ok()?.path()).ok());
    targets.any(|target| target.starts_with(folder))
}

/// Lets a window save its picture, and kills it while it writes the first or the last of the two files; returns whether that
/// was in time.
fn kill_while_it_saves(mut window: Window<'_>, is_last: bool) -> bool {
    let out = window.folder.join("out").canonicalize().unwrap();
    let before = files(&out).len();
    let mut xdotool = window.begin_to_press("F3");
    let start = Instant::now();
    let caught = loop {
        let more = files(&out).len() - before;
        if more == usize::from(is_last) && is_writing(window.viewer.id(), &out) {
            break true;
        }
        if more > usize::from(is_last) {
            break false;
        }
        assert!(start.elapsed() < PATIENCE, "nothing was saved");
    };
    window.viewer.kill().unwrap();
    window.viewer.wait().unwrap();
    xdotool.wait().unwrap();
    caught
}

#[test]
fn a_viewer_that_is_killed_while_it_saves_leaves_whole_files_alone() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let out = at.join("out");
    fs::create_dir(&out).unwrap();
    for is_last in [false, true] {
        let caught = (0..5).any(|_| {
            let mut window = Window::open(&screen, at, &WHAT);
            window.wait_for_title("finished, picture");
            let caught = kill_while_it_saves(window, is_last);
            check_all_are_whole(&out);
            caught
        });
        assert!(caught, "it always saves before it can be killed");
    }

    // A rerun takes the next number that is free.
    let free = (1..)
        .map(|number| format!("out/picture-{number:03}"))
        .find(|name| !at.join(name).with_extension("png").exists())
        .unwrap();
    let mut window = Window::open(&screen, at, &WHAT);
    window.wait_for_title("finished, picture");
    window.press("F3");
    let saved = format!("{free}.exr");
    let picture = Image::load(window.wait_for_file(&saved)).unwrap();
    window.close();
    check_all_are_whole(&out);
    assert_eq!(rendered_again(at, &saved), picture.rgb("").unwrap());
}

/// A small disk of its own at a folder; gone when it is dropped.
struct Disk(PathBuf);

impl Disk {
    /// None, loudly, where none can be mounted.
    fn mount(at: &Path, options: &str) -> Option<Self> {
        let disk = Self::command("mount", &["-t", "tmpfs", "-o", options, "none"], at);
        if !disk {
            eprintln!("skipped: no small disk can be mounted here");
        }
        disk.then(|| Self(at.to_owned()))
    }

    fn change(&self, options: &str) {
        let options = format!("remount,{options}");
        assert!(Self::command("mount", &["-o", &options], &self.0));
    }

    fn command(program: &str, arguments: &[&str], at: &Path) -> bool {
        let output = Command::new(program).args(arguments).arg(at).output();
        output.is_ok_and(|output| output.status.success())
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        Self::command("umount", &[], &self.0);
    }
}

/// Presses a key whose file cannot be saved, and checks that the window says why and nothing new is there.
fn refuses(window: &mut Window<'_>, key: &str, reason: &str) {
    let out = window.folder.join("out");
    let there = |out: &Path| if out.exists() { files(out) } else { Vec::new() };
    let (before, said) = (there(&out), window.said().len());
    window.press(key);
    window.wait(|window| window.said().len() > said && window.title().ends_with("not saved"));
    let said = window.said()[said..].to_owned();
    assert!(said.starts_with("warning: not saved: "), "{said}");
    assert!(said.contains("-00") && said.contains(reason), "{said}");
    assert_eq!(there(&out), before);
}

/// Presses F3, and checks that this works.
fn saves(window: &mut Window<'_>, name: &str) {
    window.press("F3");
    Image::load(window.wait_for_file(name)).unwrap();
    window.wait(|window| !window.title().contains("not saved"));
}

#[test]
fn what_cannot_be_saved_is_told_and_the_next_try_works() {
    let Some(screen) = Screen::open() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let out = at.join("out");
    fs::create_dir(&out).unwrap();
    let mut window = Window::open(&screen, at, &WHAT);
    window.wait_for_title("finished, picture");

    fs::remove_dir(&out).unwrap();
    refuses(&mut window, "F3", "does not exist");
    fs::create_dir(&out).unwrap();
    saves(&mut window, "out/picture-001.exr");

    if let Some(disk) = Disk::mount(&out, "size=16k") {
        refuses(&mut window, "F3", "No space");
        // Room for the PNG, which is gone again when the EXR has none.
        disk.change("size=600k");
        refuses(&mut window, "F3", "No space");
        disk.change("ro");
        refuses(&mut window, "F3", "Read-only");
        refuses(&mut window, "F2", "Read-only");
        disk.change("rw,size=64m");
        saves(&mut window, "out/picture-001.exr");
    }
    saves(&mut window, "out/picture-002.exr");
    window.close();
    check_all_are_whole(&out);
}
