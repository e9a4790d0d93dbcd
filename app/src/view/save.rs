//! Pictures and windows as files.

use std::{
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{Receiver, Sender, channel},
    },
};

use anyhow::Result;
use eframe::egui::{ColorImage, Context};
use glam::Vec3;
use isophote_scene::{Image, srgb_to_linear};

use super::{Viewer, studio::Picture};
use crate::{output::Voice, whole};

/// What was saved where, or why it was not.
pub(super) type Told = Result<String, String>;

/// Writes files without keeping the window waiting, and says how it went.
pub(super) struct Saver {
    /// Locked while something is written there, so that no two files choose the same free name.
    folder: Arc<Mutex<PathBuf>>,
    /// Whether a picture is to be saved as soon as it is whole.
    waits: bool,
    context: Context,
    messages: Sender<Told>,
}

impl Saver {
    /// With the end where it is told what was written.
    pub(super) fn new(folder: PathBuf, context: Context) -> (Self, Receiver<Told>) {
        let (messages, told) = channel();
        let saver = Self {
            folder: Arc::new(Mutex::new(folder)),
            waits: false,
            context,
            messages,
        };
        (saver, told)
    }

    /// Runs in a thread of its own, as a large file takes a while.
    fn spawn(&self, save: impl FnOnce(&Path) -> Result<String> + Send + 'static) {
        let (folder, messages) = (self.folder.clone(), self.messages.clone());
        let context = self.context.clone();
        std::thread::spawn(move || {
            let folder = folder.lock().unwrap_or_else(PoisonError::into_inner);
            let told = save(&folder).map_err(|error| format!("not saved: {}", whole(&error)));
            if let Err(why) = &told {
                // The panel may be hidden.
                Voice::new(false).warning(why);
            }
            // The window may be gone.
            let _ = messages.send(told);
            context.request_repaint();
        });
    }
}

impl Viewer {
    /// Saves the window as it will be painted next.
    pub(super) fn save_window(&mut self, context: &Context) {
        let saver = Saver {
            folder: self.saver.folder.clone(),
            waits: false,
            context: context.clone(),
            messages: self.saver.messages.clone(),
        };
        context.request_screenshot(move |window: Arc<ColorImage>| {
            saver.spawn(move |folder| {
                let path = free(folder, "window", &["png"]).with_extension("png");
                seen(&window).save_png(&path, 0.0)?;
                Ok(format!("saved {}", path.display()))
            });
        });
    }

    /// Saves the picture once it is whole.
    pub(super) fn save_picture(&mut self) {
        self.saver.waits = true;
        self.message = Some(Ok("saved when it is finished".into()));
    }

    pub(super) fn save_when_whole(&mut self) {
        if !self.saver.waits || !self.is_whole() {
            return;
        }
        let Some(picture) = self.shown.picture.clone() else {
            return;
        };
        self.saver.waits = false;
        let exposure = self.shown.exposure;
        self.saver
            .spawn(move |folder| save(folder, &picture, exposure));
    }
}

fn save(folder: &Path, picture: &Picture, exposure: f32) -> Result<String> {
    let path = free(folder, "picture", &["exr", "png"]);
    let (exr, png) = (path.with_extension("exr"), path.with_extension("png"));
    let mut image = picture.image();
    image
        .attributes
        .insert("exposure".into(), exposure.to_string());
    image.save_png(&png, exposure)?;
    // Last: who waits for it finds the other there.
    if let Err(error) = image.save(&exr) {
        // There is no half of a picture, and its number stays free. What cannot be removed is a whole file all the same.
        let _ = std::fs::remove_file(&png);
        return Err(error.into());
    }
    Ok(format!("saved {} and .png", exr.display()))
}

/// The first name with a number of which there is no file.
fn free(folder: &Path, name: &str, suffixes: &[&str]) -> PathBuf {
    let numbered = |number: u32| folder.join(format!("{name}-{number:03}"));
    let is_free = |path: &PathBuf| {
        let mut files = suffixes.iter().map(|suffix| path.with_extension(suffix));
        files.all(|file| !file.exists())
    };
    (1..u32::MAX)
        .map(numbered)
        .find(is_free)
        .unwrap_or_else(|| folder.join(name))
}

/// What a screen shows, as the light of it.
fn seen(window: &ColorImage) -> Image {
    let [width, height] = window.size.map(|side| side as u32);
    let light = |byte: u8| srgb_to_linear(f32::from(byte) / 255.0);
    let pixels = window.pixels.iter();
    let pixels =
        pixels.map(|pixel| Vec3::new(light(pixel.r()), light(pixel.g()), light(pixel.b())));
    let mut image = Image::new(width, height);
    image.push_layer("", "RGB", &pixels.collect::<Vec<_>>());
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_file_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let name = |path: PathBuf| path.file_name().unwrap().to_owned();
        let free = || name(free(folder.path(), "picture", &["exr", "png"]));
        assert_eq!(free(), "picture-001");
        std::fs::write(folder.path().join("picture-001.png"), "").unwrap();
        assert_eq!(free(), "picture-002");
    }
}
