//! What was found, as text and as a page.

use super::{Matrix, Measured, Outcome, Row};

const HEAD: [&str; 11] = [
    "quantity",
    "technique",
    "tracer",
    "device",
    "error",
    "bias",
    "leaks",
    "build",
    "render",
    "tracer's memory",
    "as reference",
];

const STYLE: &str = "
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 80rem; padding: 0 1rem;
  color: #d7d9dc; background: #1b1d20; }
table { border-collapse: collapse; }
th, td { padding: .2rem .8rem .2rem 0; text-align: left; border-bottom: 1px solid #33363b; }
.best td { color: #f2b04a; }
.pictures { display: flex; flex-wrap: wrap; gap: 1rem; }
figure { margin: 0; }
figcaption { color: #9da1a6; }
";

impl Matrix<'_> {
    pub(super) fn text(&self) -> String {
        let cells: Vec<[String; 11]> = self.shown().map(|(row, found)| row.cells(found)).collect();
        let widths: [usize; 11] = std::array::from_fn(|column| {
            let lengths = cells.iter().map(|row| row[column].chars().count());
            lengths.chain([HEAD[column].len()]).max().unwrap_or(0)
        });
        let line = |row: &[String; 11]| {
            let padded = row.iter().zip(widths);
            let padded: Vec<String> = padded
                .map(|(cell, width)| format!("{cell:<width$}"))
                .collect();
            padded.join("  ").trim_end().to_owned() + "\n"
        };
        let mut text = self.about() + "\n\n" + &line(&HEAD.map(str::to_owned));
        for row in &cells {
            text += &line(row);
        }
        for said in self.winners().into_iter().chain(self.reasons()) {
            text += &format!("\n{said}");
        }
        text + "\n"
    }

    pub(super) fn html(&self) -> String {
        let head: String = HEAD.iter().map(|cell| format!("<th>{cell}</th>")).collect();
        let rows: String = self
            .shown()
            .map(|(row, found)| self.html_row(row, found))
            .collect();
        let pictures: String = self
            .shown()
            .filter_map(|(row, found)| row.picture(found))
            .collect();
        let said: String = self
            .winners()
            .iter()
            .chain(&self.reasons())
            .map(|line| format!("<li>{}</li>\n", escape(line)))
            .collect();
        let about = escape(&self.about());
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{about}</title>\n\
             <style>{STYLE}</style>\n</head>\n<body>\n<h1>Every technique on every tracer</h1>\n<p>{about}</p>\n\
             <table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table>\n<ul>\n{said}</ul>\n\
             <div class=\"pictures\">\n{pictures}</div>\n</body>\n</html>\n"
        )
    }

    fn about(&self) -> String {
        let [width, height] = self.size;
        format!(
            "{}: {} triangles, {width}×{height}, {} samples a pixel against {}, {} threads",
            self.scene, self.triangles, self.samples, self.reference_samples, self.threads
        )
    }

    /// What was measured, the best of each quantity and device first.
    fn shown(&self) -> impl Iterator<Item = (&Row, &Measured)> {
        let measured = self
            .rows
            .iter()
            .filter_map(|row| Some((row, row.measured()?)));
        let mut shown: Vec<(&Row, &Measured)> = measured.collect();
        shown.sort_by(|(a, of_a), (b, of_b)| {
            let gains = |found: &Measured| found.gain().unwrap_or(0.0);
            (a.quantity, a.device)
                .cmp(&(b.quantity, b.device))
                .then(gains(of_b).total_cmp(&gains(of_a)))
        });
        shown.into_iter()
    }

    /// The first of each quantity and device.
    fn best(&self) -> Vec<(&Row, &Measured)> {
        let mut best: Vec<(&Row, &Measured)> = self.shown().collect();
        best.dedup_by_key(|(row, _)| (row.quantity, row.device));
        best
    }

    /// Which pair wins, of each quantity and device that the reference technique was measured for.
    fn winners(&self) -> Vec<String> {
        let of = |(row, found): (&Row, &Measured)| {
            let gain = found.gain()?;
            let place = format!("{} on the {}", row.quantity, row.device);
            Some(if row.is_exact_reference() || gain <= 1.0 {
                format!("{place}: nothing beats the reference technique at equal error")
            } else {
                format!(
                    "{place}: {} over {} wins at equal error, {gain:.2} times as fast as the reference technique",
                    row.technique, row.tracer
                )
            })
        };
        self.best().into_iter().filter_map(of).collect()
    }

    /// Why there are no others, each reason once.
    fn reasons(&self) -> Vec<String> {
        let of = |row: &Row| match &row.outcome {
            Outcome::Measured(found) => found.is_black.then(|| {
                format!(
                    "BLACK: {} by {} over {} on the {}",
                    row.quantity, row.technique, row.tracer, row.device
                )
            }),
            Outcome::Refused(why) => Some(format!("not there: {why}")),
            Outcome::Failed(why) => Some(format!(
                "FAILED: {} by {} over {} on the {}: {why}",
                row.quantity, row.technique, row.tracer, row.device
            )),
        };
        let mut reasons: Vec<String> = self.rows.iter().filter_map(of).collect();
        reasons.sort_unstable();
        reasons.dedup();
        reasons
    }

    fn html_row(&self, row: &Row, found: &Measured) -> String {
        let is_best = self.best().iter().any(|(best, _)| std::ptr::eq(*best, row));
        let class = if is_best { " class=\"best\"" } else { "" };
        let cells: String = row
            .cells(found)
            .iter()
            .map(|cell| format!("<td>{}</td>", escape(cell)))
            .collect();
        format!("<tr{class}>{cells}</tr>\n")
    }
}

impl Row {
    fn cells(&self, found: &Measured) -> [String; 11] {
        let errors = &found.errors;
        let error = if self.is_occlusion {
            format!("{:.2} grey levels", errors.grey_rms)
        } else {
            format!("{:.2} %", 100.0 * errors.rel_rmse)
        };
        let leaks = if found.leak_rate.is_nan() {
            "its own".to_owned()
        } else {
            format!("{:.4} %", 100.0 * found.leak_rate)
        };
        [
            self.quantity.to_owned(),
            self.technique.clone(),
            self.tracer.clone(),
            self.device.to_owned(),
            error,
            format!("{:+.2} %", 100.0 * errors.bias),
            leaks,
            format!("{:.2} s", found.build_seconds),
            format!("{:.2} s", found.render_seconds),
            format!("{:.1} MiB", found.tracer_bytes as f64 / f64::from(1 << 20)),
            found
                .gain()
                .map_or_else(String::new, |gain| format!("{gain:.2}")),
        ]
    }

    fn picture(&self, found: &Measured) -> Option<String> {
        let file = found.picture.as_ref()?;
        let caption = format!(
            "{}: {} over {}, {}",
            self.quantity, self.technique, self.tracer, self.device
        );
        let caption = escape(&caption);
        Some(format!(
            "<figure><img src=\"{file}\" alt=\"{caption}\"><figcaption>{caption}</figcaption></figure>\n"
        ))
    }
}

/// Text as HTML shows it.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::{matrix::estimate, metrics::Errors, output::PROGRAM};

    /// A row of a technique over bvh with a value everywhere where 1 is right, and the seconds it took.
    fn row(technique: &str, value: f32, render_seconds: f64) -> Row {
        let [test, reference] = [value, 1.0].map(|value| vec![glam::Vec3::splat(value); 4]);
        Row {
            technique: technique.into(),
            tracer: "bvh".into(),
            device: "cpu",
            quantity: "indirect",
            is_occlusion: false,
            outcome: Outcome::Measured(Measured {
                errors: Errors::of(&test, &reference),
                build_seconds: 0.0,
                render_seconds,
                tracer_bytes: 0,
                leak_rate: 0.0,
                reference_seconds: None,
                is_black: false,
                picture: None,
            }),
        }
    }

    fn winners(mut rows: Vec<Row>) -> Vec<String> {
        estimate(&mut rows);
        let matrix = Matrix {
            scene: "",
            program: PROGRAM,
            triangles: 0,
            threads: 1,
            size: [2, 2],
            samples: 1,
            reference_samples: 1,
            reference_noise: BTreeMap::new(),
            rows,
        };
        matrix.winners()
    }

    #[test]
    fn nothing_wins_over_itself() {
        let reference = || row("reference", 1.1, 1.0);
        let nothing = ["indirect on the cpu: nothing beats the reference technique at equal error"];
        assert_eq!(winners(vec![reference()]), nothing);
        assert_eq!(winners(vec![reference(), row("igi", 1.2, 0.5)]), nothing);
        let won = winners(vec![reference(), row("igi", 1.1, 0.5)]);
        assert!(
            won.len() == 1 && won[0].contains("igi over bvh wins") && won[0].contains("2.00"),
            "{won:?}"
        );
        assert!(winners(vec![row("igi", 1.1, 0.5)]).is_empty());
    }
}
