//! `isophote view`: a scene in a window, by any technique over any tracer, with every flag of `isophote render` live.
//!
//! 1. What is to be seen is a set of flags, as on the command line. [`flags`]
//! 2. The panel, the keys and the mouse change flags: the camera, moved lights and the time are flags too. [`panel`],
//!    [`parameters`], [`moves`], [`input`], [`camera`]
//! 3. A thread renders what the flags say, small at first, and refines the right answer to compare it with. [`worker`],
//!    [`studio`], [`truth`], [`pace`], [`gate`]; shaders can be changed under its hands. [`shaders`]
//! 4. The window shows the picture, the right answer, both, or where they differ, and saves them. [`shown`], [`save`]

mod camera;
mod flags;
mod gate;
mod input;
mod moves;
mod pace;
mod panel;
mod parameters;
mod save;
mod shaders;
mod shown;
mod studio;
mod truth;
mod worker;

use std::{
    path::PathBuf,
    sync::{Arc, mpsc::Receiver},
    time::{Duration, Instant},
};

use anyhow::{Result, anyhow, ensure};
use clap::{ArgMatches, Args};
use eframe::egui::{
    CentralPanel, Context, Frame, Panel, Sense, Ui, ViewportBuilder, ViewportCommand, vec2,
};

use self::{
    camera::Viewpoint,
    flags::{Flags, Wish},
    parameters::Drafts,
    save::{Saver, Told},
    shown::Shown,
    worker::{News, Wanted, Worker},
};
use crate::{applies::Idle, picture::PictureArgs, values};

const EXAMPLES: &str = "\
Drag to go around what is in the middle, with the right button to look around, with the middle one to shift the picture; \
the wheel comes nearer. W, A, S, D, Q and E fly. Space flips to the reference and back, 1 to 4 show the picture, the \
reference, both beside each other, and where they differ. T and R choose the next technique and tracer that can be. K keeps a \
picture to compare others with. F2 saves the window as a PNG, F3 the picture as EXR and PNG, with all settings. Ctrl+Q closes it.

Examples:
  isophote view hall.glb
  isophote view hall.glb --technique igi --device gpu --quantity indirect
  isophote view --settings hall.exr      (what a picture was rendered with)";

/// Look at a scene in a window.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub(crate) struct ViewArgs {
    #[command(flatten)]
    picture: PictureArgs,
    /// Threads to use; all unless given
    #[arg(long, value_name = "N", value_parser = values::threads)]
    pub(crate) threads: Option<usize>,
    /// The folder that pictures are saved in
    #[arg(short, long, value_name = "FOLDER", default_value = ".")]
    output: PathBuf,
    /// Take shaders from this checkout of Isophote, and again whenever one of them is changed; the old ones stay in use
    /// where the new ones cannot be
    #[arg(long, value_name = "FOLDER")]
    shaders: Option<PathBuf>,
}

/// The width of the panel, in points.
const PANEL: f32 = 340.0;
/// The size of the picture unless one is given.
const WINDOW: &str = "960x640";
/// How long after the last movement things have come to rest.
const REST: Duration = Duration::from_millis(180);

/// Opens the window, and returns when it is closed.
pub(crate) fn view(args: &ViewArgs, given: &ArgMatches) -> Result<()> {
    ensure!(
        args.output.is_dir(),
        "--output: the folder {} does not exist",
        args.output.display()
    );
    let mut flags = Flags::given(given);
    if flags.is_default("size") {
        flags.set_one("size", WINDOW);
    }
    // What is wrong with the command line is told there.
    let wish = flags.wish()?;
    let [width, height] = wish.args.size.map(|side| side as f32);
    let viewport = ViewportBuilder::default()
        .with_title("isophote")
        .with_inner_size(vec2(width + PANEL, height.max(320.0)));
    let options = eframe::NativeOptions {
        viewport,
        // Pixels are shown as they are.
        dithering: false,
        ..Default::default()
    };
    let (folder, checkout) = (args.output.clone(), args.shaders.clone());
    let create = |creation: &eframe::CreationContext<'_>| {
        let viewer = Viewer::new(flags, folder, checkout, &creation.egui_ctx)?;
        Ok(Box::new(viewer) as Box<dyn eframe::App>)
    };
    eframe::run_native("isophote", options, Box::new(create))
        .map_err(|error| anyhow!("cannot open a window: {error}; `isophote render` needs none"))
}

/// The window.
struct Viewer {
    flags: Flags,
    /// The flags that the wish was made of.
    wished: Option<Flags>,
    /// The last that could be.
    wish: Option<Arc<Wish>>,
    idle: Vec<Idle>,
    /// Why there can be no picture of the flags.
    error: Option<String>,
    /// Why there is none all the same.
    failed: Option<String>,
    /// Why the last change of a flag was not taken.
    refused: Option<String>,
    /// Why new shaders are not in use.
    shaders: Option<String>,
    drafts: Drafts,
    worker: Worker,
    shown: Shown,
    /// Where the camera is, once it was moved.
    viewpoint: Option<Viewpoint>,
    /// When something was moved last.
    moved: Option<Instant>,
    /// Metres a second, over the scene's own measure.
    speed: f32,
    /// By how much the picture is smaller than its place in the window.
    coarseness: u32,
    is_playing: bool,
    movable: String,
    has_panel: bool,
    saver: Saver,
    messages: Receiver<Told>,
    /// The last of them.
    message: Option<Told>,
    title: String,
}

impl Viewer {
    fn new(
        flags: Flags,
        folder: PathBuf,
        checkout: Option<PathBuf>,
        context: &Context,
    ) -> Result<Self> {
        let wake = context.clone();
        let worker = Worker::start(checkout, move || wake.request_repaint())?;
        let (saver, messages) = Saver::new(folder, context.clone());
        let mut shown = Shown::new();
        let exposure = flags.one("exposure").and_then(|text| text.parse().ok());
        shown.exposure = exposure.unwrap_or(0.0);
        Ok(Self {
            flags,
            wished: None,
            wish: None,
            idle: Vec::new(),
            error: None,
            failed: None,
            refused: None,
            shaders: None,
            drafts: Drafts::new(),
            worker,
            shown,
            viewpoint: None,
            moved: None,
            speed: 0.2,
            coarseness: 1,
            is_playing: false,
            movable: String::new(),
            has_panel: true,
            saver,
            messages,
            message: None,
            title: String::new(),
        })
    }

    fn hear(&mut self) {
        for news in self.worker.news.try_iter() {
            match news {
                News::Picture(picture) => {
                    self.failed = None;
                    self.shown.picture = Some(picture);
                }
                News::Truth(truth) => self.shown.truth = Some(truth),
                News::Failed(error) => self.failed = Some(error),
                News::Shaders(error) => {
                    let kept = |error| format!("the old shaders are in use: {error}");
                    self.shaders = error.map(kept);
                }
            }
        }
        if let Some(message) = self.messages.try_iter().last() {
            self.message = Some(message);
        }
    }

    /// Tells the thread what is wanted now.
    fn want(&mut self, context: &Context) {
        if !self
            .wished
            .as_ref()
            .is_some_and(|old| old.is_as(&self.flags))
        {
            self.wished = Some(self.flags.clone());
            self.idle = self.flags.idle().unwrap_or_default();
            match self.flags.wish() {
                Ok(wish) => {
                    (self.error, self.failed) = (None, None);
                    self.wish = Some(Arc::new(wish));
                }
                Err(error) => self.error = Some(crate::whole(&error)),
            }
        }
        let rest = self.moved.map(|moved| REST.saturating_sub(moved.elapsed()));
        let rest = rest.filter(|rest| !rest.is_zero());
        if let Some(rest) = rest {
            context.request_repaint_after(rest + Duration::from_millis(5));
        }
        self.worker.want(Wanted {
            wish: self.wish.clone(),
            is_moving: rest.is_some(),
            picture: self.shown.needs_picture(),
            truth: self.shown.needs_truth(),
        });
    }

    /// Whether the picture of the flags as they are is there in full.
    fn is_whole(&self) -> bool {
        let of_now = |wish: &Arc<Wish>| {
            let picture = self.shown.picture.as_ref();
            picture.is_some_and(|picture| picture.is_whole && Arc::ptr_eq(&picture.wish, wish))
        };
        self.error.is_none() && self.failed.is_none() && self.wish.as_ref().is_some_and(of_now)
    }

    fn picture(&mut self, ui: &mut Ui) {
        let scale = ui.pixels_per_point();
        let space = ui.available_rect_before_wrap();
        let pixels = (space.size() * scale).floor();
        let side = |length: f32| (length as u32 / self.coarseness).max(8);
        let size = [side(pixels.x), side(pixels.y)];
        self.flags
            .set_one("size", format!("{}x{}", size[0], size[1]));
        let area = eframe::egui::Rect::from_min_size(space.min, pixels / scale);
        let response = ui.allocate_rect(area, Sense::click_and_drag());
        self.mouse(ui, area, &response);
        self.shown.paint(ui, area);
    }

    fn name_window(&mut self, context: &Context) {
        let args = self.wish.as_ref().map(|wish| (&wish.args, wish.choice));
        let Some((args, choice)) = args else { return };
        let scene = args.scene.as_deref().unwrap_or_default();
        let error = self.error.as_ref().or(self.failed.as_ref());
        let state = match (error, self.is_whole()) {
            (Some(_), _) => "refused",
            (None, true) if self.shaders.is_some() => "finished with old shaders",
            (None, true) => "finished",
            (None, false) => "working",
        };
        let (technique, tracer) = (args.technique.name(), choice.name());
        let look = self.shown.title();
        let saved = match self.message {
            Some(Err(_)) => ", not saved",
            _ => "",
        };
        let title = format!("isophote: {scene}, {technique} by {tracer}, {state}, {look}{saved}");
        if title != self.title {
            context.send_viewport_cmd(ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }
}

impl eframe::App for Viewer {
    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        let context = ui.ctx().clone();
        self.hear();
        self.keys(&context);
        self.play(&context);
        if self.has_panel {
            let panel = Panel::right("settings").exact_size(PANEL);
            panel.show(ui, |ui| self.panel(ui));
        }
        let frame = Frame::NONE.fill(eframe::egui::Color32::BLACK);
        CentralPanel::default()
            .frame(frame)
            .show(ui, |ui| self.picture(ui));
        self.want(&context);
        self.save_when_whole();
        self.name_window(&context);
        if !self.worker.status().doing.is_empty() {
            context.request_repaint_after(Duration::from_millis(100));
        }
    }
}
