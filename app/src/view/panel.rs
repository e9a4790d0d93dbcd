//! The panel beside the picture.

use clap::ValueEnum;
use eframe::egui::{
    Button, Color32, ComboBox, DragValue, Grid, ProgressBar, RichText, ScrollArea, Slider, Ui,
};
use isophote_scene::reference::Quantity;

use super::{
    Viewer, moves, parameters,
    shown::{Against, Look},
};
use crate::{
    technique::TechniqueChoice,
    tracers::{AnyTracer, Device},
};

const KEYS: &str = "\
left drag: orbit    right drag: look
middle drag: shift    wheel: come nearer
W A S D Q E: fly, with Shift faster
Home: the scene's own camera
Space: flip to the reference
1 2 3 4: picture, reference, both, error
K: keep the picture to compare with
T, R: next technique, next tracer
P: play    H: hide the panel
F2: save the window    F3: save the picture
Ctrl Q: close";

impl Viewer {
    pub(super) fn panel(&mut self, ui: &mut Ui) {
        // What is wider than the panel must not push it into the picture.
        let area = ScrollArea::both().auto_shrink(false);
        area.show(ui, |ui| {
            ui.add_space(4.0);
            self.choices(ui);
            ui.separator();
            self.looks(ui);
            ui.separator();
            self.state(ui);
            ui.separator();
            self.places(ui);
            ui.separator();
            let (flags, idle) = (&mut self.flags, &self.idle);
            parameters::groups(ui, flags, idle, &mut self.drafts, &mut self.refused);
            ui.separator();
            ui.collapsing("Keys and mouse", |ui| ui.monospace(KEYS));
        });
    }

    /// What is computed, how, by whom and where.
    fn choices(&mut self, ui: &mut Ui) {
        let named = |names: Vec<String>| names.into_iter().map(|name| (name.clone(), vec![name]));
        let techniques = TechniqueChoice::value_variants().iter();
        let techniques = named(techniques.map(|one| one.name()).collect());
        let tracers = AnyTracer::value_variants().iter();
        let tracers = named(tracers.map(|one| one.name()).collect());
        let quantities = Quantity::ALL.iter().map(|one| one.name().to_owned());
        let quantities = named(quantities.collect());
        let devices = Device::value_variants()
            .iter()
            .filter_map(ValueEnum::to_possible_value);
        let devices = named(devices.map(|one| one.get_name().to_owned()).collect());
        let automatic = ("automatic".to_owned(), Vec::new());
        Grid::new("choices").num_columns(2).show(ui, |ui| {
            self.choice(ui, "technique", &techniques.collect::<Vec<_>>());
            let tracers: Vec<_> = std::iter::once(automatic).chain(tracers).collect();
            self.choice(ui, "tracer", &tracers);
            self.choice(ui, "device", &devices.collect::<Vec<_>>());
            self.choice(ui, "quantity", &quantities.collect::<Vec<_>>());
        });
    }

    /// A drop-down; what cannot be is grey and says why.
    fn choice(&mut self, ui: &mut Ui, id: &str, choices: &[(String, Vec<String>)]) {
        ui.label(id);
        let now = self.flags.get(id);
        let shown = choices.iter().find(|(_, values)| *values == now);
        let mut text = shown.map_or_else(String::new, |(name, _)| name.clone());
        if id == "tracer"
            && now.is_empty()
            && let Some(wish) = &self.wish
        {
            text = format!("automatic ({})", wish.choice.name());
        }
        let combo = ComboBox::from_id_salt(id).width(200.0).selected_text(text);
        combo.show_ui(ui, |ui| {
            for (name, values) in choices {
                let other = self.flags.with(id, values.clone());
                let outcome = other.wish();
                let button = Button::selectable(*values == now, name);
                let response = ui.add_enabled(outcome.is_ok() || *values == now, button);
                if let Err(error) = &outcome {
                    response.clone().on_disabled_hover_text(crate::whole(error));
                }
                if response.clicked() {
                    self.flags = other;
                }
            }
        });
        ui.end_row();
    }

    /// What is shown of it.
    fn looks(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            let other = match self.shown.against {
                Against::Reference => "reference",
                Against::Kept => "kept",
            };
            for (look, name) in [
                (Look::Picture, "picture"),
                (Look::Other, other),
                (Look::Split, "both"),
                (Look::Error, "error"),
            ] {
                ui.selectable_value(&mut self.shown.look, look, name);
            }
        });
        ui.horizontal(|ui| {
            ui.label("against");
            let against = &mut self.shown.against;
            ui.selectable_value(against, Against::Reference, "the reference");
            ui.selectable_value(against, Against::Kept, "the kept picture");
            if ui.button("keep").clicked() {
                self.keep();
            }
        });
        ui.horizontal(|ui| {
            ui.label("exposure");
            let mut exposure = self.shown.exposure;
            let drag = DragValue::new(&mut exposure)
                .speed(0.02)
                .range(-20.0..=20.0);
            if ui.add(drag.suffix(" stops")).changed() {
                self.shown.exposure = exposure;
            }
            ui.label("pixels");
            for (coarseness, name) in [(1, "1:1"), (2, "1:2"), (4, "1:4")] {
                ui.selectable_value(&mut self.coarseness, coarseness, name);
            }
        });
        ui.horizontal(|ui| {
            if ui.button("save the picture (F3)").clicked() {
                self.save_picture();
            }
            if ui.button("save the window (F2)").clicked() {
                self.save_window(&ui.ctx().clone());
            }
        });
        match &self.message {
            Some(Ok(message)) => drop(ui.label(message)),
            Some(Err(error)) => drop(ui.label(RichText::new(error).color(Color32::LIGHT_RED))),
            None => {}
        }
    }

    /// How far it is, what it took, and how far off it is.
    fn state(&mut self, ui: &mut Ui) {
        let status = self.worker.status();
        if status.doing.is_empty() {
            ui.add(ProgressBar::new(1.0).text("finished").desired_height(14.0));
        } else {
            let bar = ProgressBar::new(status.share).desired_height(14.0);
            ui.add(bar.text(status.doing));
        }
        for error in [&self.error, &self.failed, &self.refused, &self.shaders]
            .into_iter()
            .flatten()
        {
            ui.label(RichText::new(error).color(Color32::LIGHT_RED));
        }
        if let Some(picture) = &self.shown.picture {
            let [width, height] = picture.size();
            let rays = picture.made.render.rays as f64;
            ui.label(format!(
                "{width}×{height}: {:.1} ms, {:.2} million rays/s",
                1e3 * picture.seconds,
                1e-6 * rays / picture.seconds.max(1e-9)
            ));
            if picture.build_seconds > 0.0 {
                ui.label(format!(
                    "the tracer was built in {:.1} ms",
                    1e3 * picture.build_seconds
                ));
            }
            ui.label(RichText::new(&picture.device).weak());
        }
        self.passes(ui);
        if let Some(truth) = &self.shown.truth
            && self.shown.needs_truth()
        {
            let noise = match truth.noise.is_finite() {
                true => format!("noise {:.2} %", 100.0 * truth.noise),
                false => "noise unknown".into(),
            };
            let (samples, seconds) = (truth.samples, truth.seconds);
            ui.label(format!(
                "reference: {samples} samples, {noise}, {seconds:.1} s"
            ));
        }
        if self.shown.look != Look::Picture
            && let Some(errors) = self.shown.errors()
        {
            ui.label(if self.shown.is_grey() {
                let (rms, bias) = (errors.grey_rms, errors.grey_bias);
                format!("error: rms {rms:.2} grey levels, bias {bias:+.2}")
            } else {
                let (relative, bias) = (100.0 * errors.rel_rmse, 100.0 * errors.bias);
                format!("error: relRMSE {relative:.2} %, bias {bias:+.2} %")
            });
        }
    }

    /// The time of each pass: by the GPU's clock where there is one.
    fn passes(&self, ui: &mut Ui) {
        let Some(picture) = &self.shown.picture else {
            return;
        };
        let made = &picture.made;
        let on_gpu = made.gpu_seconds.iter();
        let rest = on_gpu.filter(|(name, _)| made.passes.iter().all(|pass| pass.name != **name));
        let rest = rest.map(|(name, seconds)| (name.as_str(), *seconds, None));
        let passes = made.passes.iter();
        let passes =
            passes.map(|pass| (pass.name, pass.seconds, Some(pass.rays + pass.shadow_rays)));
        let rows: Vec<_> = passes.chain(rest).collect();
        if rows.is_empty() {
            return;
        }
        Grid::new("passes")
            .num_columns(3)
            .striped(true)
            .show(ui, |ui| {
                for (name, seconds, rays) in rows {
                    ui.label(name);
                    ui.label(format!("{:.2} ms", 1e3 * seconds));
                    ui.label(rays.map_or_else(String::new, |rays| format!("{rays} rays")));
                    ui.end_row();
                }
            });
    }

    /// The camera, the time, and what is moved by hand.
    fn places(&mut self, ui: &mut Ui) {
        let Some(picture) = self.shown.picture.clone() else {
            return;
        };
        let scene = &picture.shot.scene;
        ui.horizontal(|ui| {
            ui.label("camera");
            let now = self.flags.one("camera");
            let text = match &now {
                Some(_) if self.viewpoint.is_some() => "moved".to_owned(),
                Some(name) => name.clone(),
                None => picture.shot.camera.name.clone(),
            };
            ComboBox::from_id_salt("camera")
                .selected_text(text)
                .show_ui(ui, |ui| {
                    let names = scene.cameras.iter().map(|camera| camera.name.as_str());
                    for name in names.chain(["auto"]) {
                        if ui
                            .selectable_label(now.as_deref() == Some(name), name)
                            .clicked()
                        {
                            self.flags.set_one("camera", name);
                            self.viewpoint = None;
                        }
                    }
                });
            ui.label("speed");
            ui.add(
                DragValue::new(&mut self.speed)
                    .speed(0.005)
                    .range(0.001..=10.0),
            );
        });
        let duration = scene.animation.duration();
        if duration > 0.0 {
            ui.horizontal(|ui| {
                let name = if self.is_playing { "pause" } else { "play" };
                if ui.button(name).clicked() {
                    self.is_playing = !self.is_playing;
                }
                let time = self.flags.one("time").and_then(|text| text.parse().ok());
                let mut time: f32 = time.unwrap_or(0.0);
                let slider = Slider::new(&mut time, 0.0..=duration).suffix(" s");
                if ui.add(slider).changed() {
                    self.flags.set_one("time", time.to_string());
                    self.moved = Some(std::time::Instant::now());
                }
            });
        }
        ui.collapsing("Move lights and objects", |ui| self.movables(ui, scene));
    }

    fn movables(&mut self, ui: &mut Ui, scene: &isophote_scene::Scene) {
        let all = moves::movables(scene);
        let Some(first) = all.first() else { return };
        let chosen = all.iter().find(|one| one.name == self.movable);
        let chosen = chosen.unwrap_or(first).clone();
        let combo = ComboBox::from_id_salt("movable").width(200.0);
        combo.selected_text(&chosen.name).show_ui(ui, |ui| {
            for one in &all {
                if ui
                    .selectable_label(one.name == chosen.name, &one.name)
                    .clicked()
                {
                    self.movable.clone_from(&one.name);
                }
            }
        });
        let mut shift = moves::get(&self.flags, &chosen.name);
        let old = shift.clone();
        let speed = 0.002 * scene.bounds().diagonal();
        ui.horizontal(|ui| {
            // A sun is everywhere.
            ui.add_enabled_ui(!chosen.is_sun, |ui| {
                for (axis, value) in ["x ", "y ", "z "].into_iter().zip(shift.offset.as_mut()) {
                    ui.add(DragValue::new(value).speed(speed).prefix(axis).suffix(" m"));
                }
            });
        });
        ui.horizontal(|ui| {
            ui.label("yaw");
            ui.drag_angle(&mut shift.yaw);
            ui.label("pitch");
            ui.drag_angle(&mut shift.pitch);
            if ui.button("put back").clicked() {
                shift = moves::get(&self.flags, "");
                shift.name.clone_from(&chosen.name);
            }
        });
        if shift != old {
            moves::set(&mut self.flags, &shift);
            self.moved = Some(std::time::Instant::now());
        }
    }
}
