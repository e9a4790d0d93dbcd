//! Keys and the mouse.

use std::time::Instant;

use clap::ValueEnum;
use eframe::egui::{Context, Key, Modifiers, PointerButton, Rect, Response, Ui, ViewportCommand};
use glam::Vec3;

use super::{
    Viewer,
    camera::Viewpoint,
    shown::{Against, Look},
};
use crate::{technique::TechniqueChoice, tracers::AnyTracer};

/// Radians that the camera turns when the mouse crosses the picture's height.
const TURN: f32 = 2.5;
/// How near to the line of a split one must press to take it, in points.
const GRIP: f32 = 8.0;

impl Viewer {
    /// What keys do, unless text is being typed.
    pub(super) fn keys(&mut self, context: &Context) {
        if context.text_edit_focused() {
            return;
        }
        let pressed = |key| context.input_mut(|input| input.consume_key(Modifiers::NONE, key));
        if pressed(Key::Space) {
            self.shown.flip();
        }
        for (key, look) in [
            (Key::Num1, Look::Picture),
            (Key::Num2, Look::Other),
            (Key::Num3, Look::Split),
            (Key::Num4, Look::Error),
        ] {
            if pressed(key) {
                self.shown.look = look;
            }
        }
        if pressed(Key::K) {
            self.keep();
        }
        if pressed(Key::T) {
            let names = TechniqueChoice::value_variants().iter();
            self.choose_next(
                "technique",
                &names.map(|one| one.name()).collect::<Vec<_>>(),
            );
        }
        if pressed(Key::R) {
            let names = AnyTracer::value_variants().iter();
            self.choose_next("tracer", &names.map(|one| one.name()).collect::<Vec<_>>());
        }
        if pressed(Key::P) {
            self.is_playing = !self.is_playing;
        }
        if pressed(Key::Home) {
            self.reset_camera();
        }
        if pressed(Key::H) {
            self.has_panel = !self.has_panel;
        }
        if pressed(Key::F2) {
            self.save_window(context);
        }
        if pressed(Key::F3) {
            self.save_picture();
        }
        if context.input_mut(|input| input.consume_key(Modifiers::COMMAND, Key::Q)) {
            context.send_viewport_cmd(ViewportCommand::Close);
        }
        self.fly(context);
    }

    /// The next of a flag's values, round about, with which there is a picture.
    fn choose_next(&mut self, id: &str, names: &[String]) {
        let now = self.flags.one(id);
        let at = now.and_then(|now| names.iter().position(|name| *name == now));
        let first = at.map_or(0, |at| at + 1);
        let can_be = |name: &&String| self.flags.with(id, vec![(*name).clone()]).wish().is_ok();
        let next = names
            .iter()
            .cycle()
            .skip(first)
            .take(names.len())
            .find(can_be);
        if let Some(next) = next.cloned() {
            self.flags.set_one(id, next);
        }
    }

    /// Keeps the picture to compare others with it.
    pub(super) fn keep(&mut self) {
        self.shown.kept.clone_from(&self.shown.picture);
        self.shown.against = Against::Kept;
    }

    pub(super) fn reset_camera(&mut self) {
        self.flags.set("camera", Vec::new());
        self.viewpoint = None;
    }

    fn fly(&mut self, context: &Context) {
        let (keys, seconds, fast) = context.input(|input| {
            let axis = |plus: &[Key], minus: &[Key]| {
                let down = |keys: &[Key]| f32::from(keys.iter().any(|key| input.key_down(*key)));
                down(plus) - down(minus)
            };
            let keys = Vec3::new(
                axis(&[Key::D, Key::ArrowRight], &[Key::A, Key::ArrowLeft]),
                axis(&[Key::E, Key::PageUp], &[Key::Q, Key::PageDown]),
                axis(&[Key::W, Key::ArrowUp], &[Key::S, Key::ArrowDown]),
            );
            // A pause is no flight.
            (keys, input.stable_dt.min(0.1), input.modifiers.shift)
        });
        if keys == Vec3::ZERO {
            return;
        }
        let Some(picture) = &self.shown.picture else {
            return;
        };
        let measure = picture.shot.scene.bounds().diagonal();
        let metres = self.speed * measure * seconds * if fast { 4.0 } else { 1.0 };
        self.move_camera(|viewpoint| viewpoint.fly(metres * keys));
        context.request_repaint();
    }

    /// What the mouse does in the picture's area.
    pub(super) fn mouse(&mut self, ui: &Ui, area: Rect, response: &Response) {
        let delta = response.drag_delta();
        let [x, y] = [delta.x / area.height(), delta.y / area.height()];
        let line = area.left() + self.shown.split * area.width();
        let origin = ui.input(|input| input.pointer.press_origin());
        if response.drag_started_by(PointerButton::Primary) {
            let is_near = origin.is_some_and(|origin| (origin.x - line).abs() < GRIP);
            self.shown.is_dragged = self.shown.look == Look::Split && is_near;
        }
        if response.drag_stopped() {
            self.shown.is_dragged = false;
        }
        let drags = |button| response.dragged_by(button) && (x != 0.0 || y != 0.0);
        if drags(PointerButton::Primary) {
            if self.shown.is_dragged {
                let at = ui.input(|input| input.pointer.interact_pos());
                let share = |at: eframe::egui::Pos2| (at.x - area.left()) / area.width();
                self.shown.split = at.map_or(0.5, share).clamp(0.0, 1.0);
            } else {
                self.move_camera(|viewpoint| viewpoint.orbit(-TURN * x, -TURN * y));
            }
        } else if drags(PointerButton::Secondary) {
            self.move_camera(|viewpoint| viewpoint.look(-TURN * x, -TURN * y));
        } else if drags(PointerButton::Middle) {
            self.move_camera(|viewpoint| viewpoint.pan(-x, y));
        }
        let wheel = ui.input(|input| input.smooth_scroll_delta().y);
        if response.hovered() && wheel != 0.0 {
            self.move_camera(|viewpoint| viewpoint.approach((-0.004 * wheel).exp()));
        }
    }

    /// Moves the camera, from where the last picture was seen if it was not moved yet.
    fn move_camera(&mut self, change: impl FnOnce(&mut Viewpoint)) {
        let Some(picture) = &self.shown.picture else {
            return;
        };
        let is_new = self.moved.is_none_or(|moved| moved.elapsed() > super::REST);
        let mut viewpoint = match &self.viewpoint {
            Some(viewpoint) => viewpoint.clone(),
            None => {
                let measure = picture.shot.scene.bounds().diagonal();
                Viewpoint::of(&picture.shot.camera, 0.5 * measure)
            }
        };
        // What is orbited is what is seen in the middle when the movement starts.
        if is_new {
            let ([width, height], depth) = (picture.size(), &picture.made.render.layers.depth);
            let middle = (height / 2 * width + width / 2) as usize;
            viewpoint.set_distance(depth.get(middle).copied().unwrap_or(f32::NAN));
        }
        change(&mut viewpoint);
        self.flags.set_one("camera", viewpoint.text());
        self.viewpoint = Some(viewpoint);
        self.moved = Some(Instant::now());
    }

    /// Lets the time pass.
    pub(super) fn play(&mut self, context: &Context) {
        let scene = self
            .shown
            .picture
            .as_ref()
            .map(|picture| &picture.shot.scene);
        let duration = scene.map_or(0.0, |scene| scene.animation.duration());
        if !self.is_playing || duration <= 0.0 {
            return;
        }
        let seconds = context.input(|input| input.stable_dt.min(0.5));
        let time = self.flags.one("time").and_then(|text| text.parse().ok());
        let time = (time.unwrap_or(0.0_f32) + seconds) % duration;
        self.flags.set_one("time", time.to_string());
        self.moved = Some(Instant::now());
        context.request_repaint();
    }
}
