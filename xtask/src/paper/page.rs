//! One HTML file: sections of texts, tables, pictures and plots, with everything inside.

use base64::{Engine, engine::general_purpose::STANDARD};

use crate::{
    html::{STYLE, escape},
    machine::Machine,
};

const MORE_STYLE: &str = include_str!("page.css");

/// The page. Texts are plain; they are escaped here.
pub(super) struct Page<'a> {
    pub(super) title: &'a str,
    pub(super) intro: &'a str,
    pub(super) machine: &'a Machine,
    /// How long all of it took.
    pub(super) seconds: f64,
    pub(super) sections: &'a [Section],
}

/// One of its parts, with a heading.
pub(super) struct Section {
    /// For links, and the name of its numbers in the JSON.
    pub(super) id: &'static str,
    pub(super) title: &'static str,
    pub(super) parts: Vec<Part>,
}

/// What a section shows.
pub(super) enum Part {
    Text(String),
    Table {
        head: Vec<String>,
        rows: Vec<Vec<String>>,
    },
    Pictures {
        title: String,
        pictures: Vec<Picture>,
    },
    /// SVG.
    Plot(String),
}

/// A picture and what is to be said of it.
pub(super) struct Picture {
    pub(super) png: Vec<u8>,
    /// Shown over its left half, where that is another.
    pub(super) left: Option<Vec<u8>>,
    pub(super) caption: String,
    /// What to type to get it again.
    pub(super) command: String,
}

impl Page<'_> {
    /// The whole file.
    pub(super) fn html(&self) -> String {
        let link = |section: &Section| {
            let title = escape(section.title);
            format!("<a href=\"#{}\">{title}</a>\n", section.id)
        };
        let links: String = self.sections.iter().map(link).collect();
        let sections: String = self.sections.iter().map(Section::html).collect();
        let machine = self.machine;
        let made = escape(&format!(
            "{:.0} s in all on {} ({} threads, {}); commit {}, {}",
            self.seconds,
            machine.cpu,
            machine.threads,
            machine.system,
            machine.commit,
            machine.rustc
        ));
        let (title, intro) = (escape(self.title), escape(self.intro));
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>\n{STYLE}{MORE_STYLE}</style>\n</head>\n<body>\n\
             <header>\n<h1>{title}</h1>\n<p>{intro}</p>\n<nav>\n{links}</nav>\n</header>\n\
             <main>\n{sections}</main>\n<footer>\n<p>{made}</p>\n</footer>\n</body>\n</html>\n"
        )
    }
}

impl Section {
    fn html(&self) -> String {
        let parts: String = self.parts.iter().map(Part::html).collect();
        let (id, title) = (self.id, escape(self.title));
        format!("<section id=\"{id}\">\n<h2>{title}</h2>\n{parts}</section>\n")
    }
}

impl Part {
    fn html(&self) -> String {
        match self {
            Self::Text(text) => format!("<p>{}</p>\n", escape(text)),
            Self::Table { head, rows } => {
                let row = |cells: &[String], tag: &str| {
                    let cells = cells.iter();
                    let cells: String = cells
                        .map(|cell| format!("<{tag}>{}</{tag}>", escape(cell)))
                        .collect();
                    format!("<tr>{cells}</tr>\n")
                };
                let rows: String = rows.iter().map(|cells| row(cells, "td")).collect();
                let head = row(head, "th");
                format!(
                    "<div class=\"scroll\"><table>\n<thead>{head}</thead>\n<tbody>\n{rows}</tbody>\n</table></div>\n"
                )
            }
            Self::Pictures { title, pictures } => {
                let commands: String = pictures
                    .iter()
                    .map(|picture| escape(&picture.command) + "\n")
                    .collect();
                let pictures: String = pictures.iter().map(Picture::html).collect();
                format!(
                    "<h3>{}</h3>\n<div class=\"row\">\n{pictures}</div>\n\
                     <details><summary>Commands</summary><pre>{commands}</pre></details>\n",
                    escape(title)
                )
            }
            Self::Plot(svg) => format!("<div class=\"plot\">{svg}</div>\n"),
        }
    }
}

impl Picture {
    fn html(&self) -> String {
        let caption = escape(&self.caption);
        let img = |class: &str, png: &[u8]| {
            let data = STANDARD.encode(png);
            format!(
                "<img class=\"{class}\" src=\"data:image/png;base64,{data}\" alt=\"{caption}\">"
            )
        };
        let left = self
            .left
            .as_ref()
            .map_or_else(String::new, |png| img("half", png));
        format!(
            "<div class=\"picture\"><div class=\"stack\">{}{left}</div><span>{caption}</span></div>\n",
            img("whole", &self.png)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_is_inside_and_escaped() {
        let picture = Picture {
            png: b"png".to_vec(),
            left: Some(b"left".to_vec()),
            caption: "a < b".to_owned(),
            command: "isophote <x>".to_owned(),
        };
        let parts = vec![
            Part::Text("<text>".to_owned()),
            Part::Table {
                head: vec!["then & now".to_owned()],
                rows: vec![vec!["1".to_owned()]],
            },
            Part::Pictures {
                title: "Fig.".to_owned(),
                pictures: vec![picture],
            },
            Part::Plot("<svg></svg>".to_owned()),
        ];
        let section = Section {
            id: "one",
            title: "One",
            parts,
        };
        let html = Page {
            title: "T",
            intro: "I",
            machine: &Machine::current(),
            seconds: 1.0,
            sections: &[section],
        }
        .html();
        for expected in [
            "href=\"#one\"",
            "&lt;text&gt;",
            "then &amp; now",
            "data:image/png;base64,cG5n",
            "data:image/png;base64,bGVmdA==",
            "a &lt; b",
            "isophote &lt;x&gt;",
            "<svg></svg>",
        ] {
            assert!(html.contains(expected), "no {expected} in\n{html}");
        }
    }
}
