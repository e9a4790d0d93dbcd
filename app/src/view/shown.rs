//! What is shown: the technique's picture, the right answer, both, or where they differ.

use std::sync::Arc;

use eframe::egui::{
    Align2, Color32, ColorImage, Context, FontId, Painter, Pos2, Rect, Stroke, TextureHandle,
    TextureOptions, Ui, Vec2, pos2, vec2,
};
use glam::Vec3;
use isophote_scene::linear_to_srgb;

use super::{studio::Picture, truth::Truth};
use crate::{compare::error_colors, metrics::Errors};

/// How the picture and what it is compared with are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Look {
    /// The picture of the settings.
    Picture,
    /// What it is compared with.
    Other,
    /// The picture left and the other right of a line.
    Split,
    /// Where they differ, in false colour.
    Error,
}

/// What the picture is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Against {
    /// The right answer.
    Reference,
    /// A picture that was kept.
    Kept,
}

/// Pictures, and which of them are to be seen how.
pub(super) struct Shown {
    pub(super) look: Look,
    pub(super) against: Against,
    /// Where the line is, as a share of the width.
    pub(super) split: f32,
    /// Whether the line is being moved.
    pub(super) is_dragged: bool,
    pub(super) exposure: f32,
    pub(super) picture: Option<Arc<Picture>>,
    pub(super) truth: Option<Arc<Truth>>,
    pub(super) kept: Option<Arc<Picture>>,
    films: [Film; 3],
    /// Of the pictures with these numbers.
    errors: Option<([u64; 2], Errors)>,
}

/// Linear light of a size.
#[derive(Clone, Copy)]
struct Plate<'a> {
    id: u64,
    size: [u32; 2],
    values: &'a [Vec3],
    divisor: u32,
}

/// A texture, and what of.
#[derive(Default)]
struct Film {
    texture: Option<TextureHandle>,
    of: Option<([u64; 2], u32)>,
}

impl Shown {
    pub(super) fn new() -> Self {
        Self {
            look: Look::Picture,
            against: Against::Reference,
            split: 0.5,
            is_dragged: false,
            exposure: 0.0,
            picture: None,
            truth: None,
            kept: None,
            films: Default::default(),
            errors: None,
        }
    }

    /// Whether the technique's picture must be made.
    pub(super) fn needs_picture(&self) -> bool {
        self.look != Look::Other || self.against == Against::Kept
    }

    /// Whether the right answer must be found.
    pub(super) fn needs_truth(&self) -> bool {
        self.look != Look::Picture && self.against == Against::Reference
    }

    /// From the picture to what it is compared with, and back.
    pub(super) fn flip(&mut self) {
        self.look = match self.look {
            Look::Other => Look::Picture,
            _ => Look::Other,
        };
    }

    /// What is shown, in words.
    pub(super) fn title(&self) -> String {
        let samples = self.truth.as_ref().map_or(0, |truth| truth.samples);
        let other = match self.against {
            Against::Reference => format!("reference of {samples} samples"),
            Against::Kept => "kept picture".into(),
        };
        match self.look {
            Look::Picture => "picture".into(),
            Look::Other => other,
            Look::Split => format!("picture and {other}"),
            Look::Error => format!("error against {other}"),
        }
    }

    fn test(&self) -> Option<Plate<'_>> {
        self.picture.as_deref().map(plate)
    }

    fn other(&self) -> Option<Plate<'_>> {
        match self.against {
            Against::Kept => self.kept.as_deref().map(plate),
            Against::Reference => self.truth.as_deref().map(|truth| Plate {
                id: truth.id,
                size: truth.size,
                values: &truth.values,
                divisor: truth.divisor,
            }),
        }
    }

    /// Errors of the picture against the other, where both are there in one size.
    pub(super) fn errors(&mut self) -> Option<Errors> {
        let [test, other] = self.pair()?;
        let ids = [test.id, other.id];
        let errors = match self.errors {
            Some((of, errors)) if of == ids => errors,
            _ => Errors::of(test.values, other.values),
        };
        self.errors = Some((ids, errors));
        Some(errors)
    }

    /// The picture and the other where these can be compared: in one size, and the right answer of the same thing.
    fn pair(&self) -> Option<[Plate<'_>; 2]> {
        let (test, other) = (self.test()?, self.other()?);
        let is_same = match (self.against, &self.picture, &self.truth) {
            (Against::Reference, Some(picture), Some(truth)) => {
                picture.wish.of_reference() == truth.key
            }
            _ => true,
        };
        (is_same && test.size == other.size).then_some([test, other])
    }

    /// Whether the errors are told in grey levels.
    pub(super) fn is_grey(&self) -> bool {
        let quantity = |picture: &Arc<Picture>| picture.wish.args.quantity[0].is_occlusion();
        self.picture.as_ref().is_some_and(quantity)
    }

    /// Paints what is to be seen into a rectangle.
    pub(super) fn paint(&mut self, ui: &Ui, area: Rect) {
        let painter = ui.painter_at(area);
        let context = ui.ctx();
        let mut films = std::mem::take(&mut self.films);
        let [test, other, error] = &mut films;
        let exposure = self.exposure;
        if self.look != Look::Other
            && let Some(plate) = self.test()
        {
            test.develop(context, plate, exposure);
        }
        if self.look != Look::Picture
            && let Some(plate) = self.other()
        {
            other.develop(context, plate, exposure);
        }
        match self.look {
            Look::Picture => test.paint(&painter, area),
            Look::Other => other.paint(&painter, area),
            Look::Split => {
                let x = area.left() + (self.split * area.width()).round();
                let [left, right] = [
                    Rect::from_min_max(area.min, pos2(x, area.bottom())),
                    Rect::from_min_max(pos2(x, area.top()), area.max),
                ];
                test.paint(&painter.with_clip_rect(left), area);
                other.paint(&painter.with_clip_rect(right), area);
                painter.vline(x, area.y_range(), Stroke::new(1.0, Color32::WHITE));
            }
            Look::Error => {
                self.develop_errors(context, error);
                error.paint(&painter, area);
            }
        }
        self.films = films;
        if let Some(what) = self.missing() {
            let center = area.center();
            let font = FontId::proportional(16.0);
            painter.text(center, Align2::CENTER_CENTER, what, font, Color32::GRAY);
        }
    }

    fn develop_errors(&self, context: &Context, film: &mut Film) {
        let Some([test, other]) = self.pair() else {
            return;
        };
        film.keep(context, [test.id, other.id], 0, || {
            let (colors, _) = error_colors(test.size, test.values, other.values, self.is_grey());
            (screen(test.size, &colors, 0.0), test.divisor)
        });
    }

    /// What there is to wait for.
    fn missing(&self) -> Option<&'static str> {
        let (test, other) = (self.test().is_some(), self.other().is_some());
        match (self.look, self.against) {
            (Look::Picture | Look::Split | Look::Error, _) if !test => Some("no picture yet"),
            (Look::Picture, _) => None,
            (_, Against::Kept) if !other => Some("no picture is kept: press K"),
            (_, Against::Reference) if !other => Some("no reference yet"),
            _ => None,
        }
    }
}

fn plate(picture: &Picture) -> Plate<'_> {
    Plate {
        id: picture.id,
        size: picture.size(),
        values: picture.values(),
        divisor: picture.divisor,
    }
}

impl Film {
    fn develop(&mut self, context: &Context, plate: Plate<'_>, exposure: f32) {
        self.keep(context, [plate.id; 2], exposure.to_bits(), || {
            (screen(plate.size, plate.values, exposure), plate.divisor)
        });
    }

    /// Makes the texture, unless it is there already.
    fn keep(
        &mut self,
        context: &Context,
        ids: [u64; 2],
        exposure: u32,
        image: impl FnOnce() -> (ColorImage, u32),
    ) {
        if self.of == Some((ids, exposure)) {
            return;
        }
        let (image, divisor) = image();
        // Pixels are pixels, but those of a small picture are blurred rather than blocks.
        let options = if divisor == 1 {
            TextureOptions::NEAREST
        } else {
            TextureOptions::LINEAR
        };
        self.of = Some((ids, exposure));
        match &mut self.texture {
            Some(texture) => texture.set(image, options),
            None => self.texture = Some(context.load_texture("picture", image, options)),
        }
    }

    fn paint(&self, painter: &Painter, area: Rect) {
        if let Some(texture) = &self.texture {
            let whole = Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0));
            painter.image(
                texture.id(),
                fit(area, texture.size_vec2()),
                whole,
                Color32::WHITE,
            );
        }
    }
}

/// Where a picture goes in an area: all of it where it has its shape, give or take a pixel of its own, and else as much as
/// keeps the picture's.
fn fit(area: Rect, size: Vec2) -> Rect {
    let scale = (area.width() / size.x).min(area.height() / size.y);
    let fitted = scale * size;
    let same = (area.size() - fitted).max_elem() <= 2.0 * scale.max(1.0);
    if same {
        return area;
    }
    Rect::from_min_size(area.center() - 0.5 * fitted, vec2(fitted.x, fitted.y))
}

/// What a screen shows of linear light, brightened by stops.
fn screen([width, height]: [u32; 2], values: &[Vec3], exposure: f32) -> ColorImage {
    let factor = exposure.exp2();
    let byte =
        |value: f32| (255.0 * linear_to_srgb((factor * value).clamp(0.0, 1.0))).round() as u8;
    let pixels = values.iter();
    let pixels = pixels.map(|value| Color32::from_rgb(byte(value.x), byte(value.y), byte(value.z)));
    ColorImage::new([width as usize, height as usize], pixels.collect())
}
