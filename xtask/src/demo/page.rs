//! The demo's page: one HTML file with its style and script inside, pictures as files beside it.

use std::fmt::Write;

use crate::{
    html::{STYLE, escape},
    machine::Machine,
};

const SCRIPT: &str = include_str!("page.js");

/// Everything the page shows. Texts are plain; they are escaped here.
pub(super) struct Page {
    pub(super) machine: Machine,
    /// `WIDTHxHEIGHT` of every picture.
    pub(super) size: (u32, u32),
    /// How long all of it took.
    pub(super) seconds: f64,
    pub(super) scenes: Vec<Scene>,
}

/// One scene with a card for each quantity.
pub(super) struct Scene {
    pub(super) name: &'static str,
    pub(super) title: &'static str,
    pub(super) what: &'static str,
    pub(super) cards: Vec<Card>,
}

/// One quantity: pictures by the techniques against the converged reference.
pub(super) struct Card {
    pub(super) title: &'static str,
    pub(super) what: String,
    pub(super) reference: Picture,
    pub(super) others: Vec<(Picture, Errors)>,
}

/// A picture and what it took.
pub(super) struct Picture {
    pub(super) title: &'static str,
    /// Its file's name, beside the page.
    pub(super) file: String,
    /// Seconds of rendering alone.
    pub(super) seconds: f64,
    pub(super) rays_per_second: Option<f64>,
    /// Its own, relative to its mean, where it is known.
    pub(super) noise: Option<f64>,
    /// What to type to get it again.
    pub(super) command: String,
}

/// How far a picture is from the reference.
pub(super) struct Errors {
    /// With its unit.
    pub(super) error: String,
    /// With its unit.
    pub(super) bias: String,
    /// The mean FLIP error of the pictures as shown.
    pub(super) flip: Option<f64>,
    /// The file of the error picture, beside the page.
    pub(super) file: String,
}

impl Page {
    /// The whole file.
    pub(super) fn html(&self) -> String {
        let mut links = String::new();
        let mut sections = String::new();
        for scene in &self.scenes {
            let id = scene.name.replace(':', "-");
            let title = escape(scene.title);
            push(&mut links, format_args!("<a href=\"#{id}\">{title}</a>\n"));
            let (what, name) = (escape(scene.what), escape(scene.name));
            let cards: String = scene
                .cards
                .iter()
                .map(|card| self.card(scene, card))
                .collect();
            push(
                &mut sections,
                format_args!(
                    "<section id=\"{id}\">\n<h2>{title}</h2>\n\
                     <p>{what} <code>{name}</code></p>\n<div class=\"cards\">\n{cards}</div>\n</section>\n"
                ),
            );
        }
        let machine = &self.machine;
        let made = escape(&format!(
            "{} × {} pixels, {:.0} s in all on {} ({} threads, {}); commit {}, {}",
            self.size.0,
            self.size.1,
            self.seconds,
            machine.cpu,
            machine.threads,
            machine.system,
            machine.commit,
            machine.rustc
        ));
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>Isophote: the techniques side by side</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
             <header>\n<h1>Isophote</h1>\n\
             <p>Every technique on the built-in scenes, beside the converged reference that its errors are \
             measured against. Move the slider over a picture; choose what its left side shows in the table \
             below it.</p>\n<nav>\n{links}</nav>\n</header>\n<main>\n{sections}</main>\n\
             <footer>\n<p>{made}</p>\n<p>Errors are measured in linear light before the pictures were made for the \
             screen. <dfn>Error</dfn> is the root mean square over all pixels and channels: in grey levels of 255 for \
             occlusion, relative to the reference's mean otherwise. <dfn>Bias</dfn> is the difference of the \
             means. <dfn>Own noise</dfn> is the reference's error by its own estimate, relative to its mean: smaller errors do not show.</p>\n\
             </footer>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n"
        )
    }

    fn card(&self, scene: &Scene, card: &Card) -> String {
        let Some((first, _)) = card.others.first() else {
            return String::new();
        };
        let (width, height) = self.size;
        let picture = |side: &str, picture: &Picture| {
            let alt = escape(&format!(
                "{}, {}: {}",
                scene.title, card.title, picture.title
            ));
            let file = escape(&picture.file);
            format!(
                "<img class=\"{side}\" src=\"{file}\" alt=\"{alt}\" width=\"{width}\" height=\"{height}\">\n"
            )
        };
        let others: String = card
            .others
            .iter()
            .enumerate()
            .map(|(index, (picture, errors))| row(picture, Some(errors), index == 0))
            .collect();
        let commands: String = card
            .others
            .iter()
            .map(|(picture, _)| picture)
            .chain([&card.reference])
            .map(|picture| escape(&picture.command) + "\n")
            .collect();
        format!(
            "<article>\n<h3>{title} <small>{what}</small></h3>\n<figure>\n{right}{left}\
             <span class=\"label\">{label}</span><span class=\"label reference\">{reference}</span>\n\
             <input type=\"range\" min=\"0\" max=\"100\" step=\"0.1\" value=\"50\" \
             aria-label=\"Where the pictures meet\">\n</figure>\n\
             <table>\n<thead><tr><th>left side</th><th>error</th><th>bias</th><th>FLIP</th><th>time</th>\
             <th>rays/s</th></tr></thead>\n<tbody>\n{others}{last}</tbody>\n</table>\n\
             <details><summary>Commands</summary><pre>{commands}</pre></details>\n</article>\n",
            title = escape(card.title),
            what = escape(&card.what),
            right = picture("right", &card.reference),
            left = picture("left", first),
            label = escape(first.title),
            reference = escape(card.reference.title),
            last = row(&card.reference, None, false),
        )
    }
}

/// A table row. The buttons say what the left side of the slider shows; the reference is always its right side.
fn row(picture: &Picture, errors: Option<&Errors>, pressed: bool) -> String {
    let title = escape(picture.title);
    let button = |label: &str, file: &str, title: &str, pressed: bool| {
        format!(
            "<button data-file=\"{}\" data-title=\"{title}\" aria-pressed=\"{pressed}\">{label}</button>",
            escape(file)
        )
    };
    let (name, cells) = match errors {
        None => {
            let noise = picture.noise.map_or_else(String::new, |noise| {
                format!("own noise {:.2} %", 100.0 * noise)
            });
            (title, format!("<td colspan=\"3\">{noise}</td>"))
        }
        Some(errors) => {
            let show = button(&title, &picture.file, &title, pressed);
            let difference = format!("{title}, error");
            let error = button(&escape(&errors.error), &errors.file, &difference, false);
            let flip = errors
                .flip
                .map_or_else(String::new, |flip| format!("{flip:.3}"));
            let bias = escape(&errors.bias);
            (
                show,
                format!("<td>{error}</td><td>{bias}</td><td>{flip}</td>"),
            )
        }
    };
    let rate = picture
        .rays_per_second
        .map_or_else(String::new, |rate| format!("{:.2} M", rate / 1e6));
    let seconds = picture.seconds;
    format!("<tr><td>{name}</td>{cells}<td>{seconds:.2} s</td><td>{rate}</td></tr>\n")
}

fn push(text: &mut String, more: std::fmt::Arguments) {
    text.write_fmt(more)
        .expect("writing to a string cannot fail");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(title: &'static str, file: &str) -> Picture {
        Picture {
            title,
            file: file.to_owned(),
            seconds: 1.5,
            rays_per_second: None,
            noise: Some(0.01),
            command: "isophote render <scene>".to_owned(),
        }
    }

    #[test]
    fn the_page_shows_every_picture_and_escapes_texts() {
        let errors = Errors {
            error: "3.0 %".to_owned(),
            bias: "+0.1 %".to_owned(),
            flip: Some(0.25),
            file: "error.png".to_owned(),
        };
        let card = Card {
            title: "Light & <shade>",
            what: "\"all\"".to_owned(),
            reference: picture("Right", "right.png"),
            others: vec![(picture("Left", "left.png"), errors)],
        };
        let page = Page {
            machine: Machine::current(),
            size: (4, 3),
            seconds: 2.0,
            scenes: vec![Scene {
                name: "builtin:x",
                title: "X",
                what: "<b>",
                cards: vec![card],
            }],
        };
        let html = page.html();
        for expected in [
            "src=\"right.png\"",
            "src=\"left.png\"",
            "data-file=\"error.png\"",
            "Light &amp; &lt;shade&gt;",
            "&quot;all&quot;",
            "isophote render &lt;scene&gt;",
            "href=\"#builtin-x\"",
            "id=\"builtin-x\"",
        ] {
            assert!(html.contains(expected), "no {expected} in\n{html}");
        }
        assert!(!html.contains("<b>") && !html.contains("<shade>") && !html.contains("<scene>"));
    }
}
