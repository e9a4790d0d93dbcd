//! Many-light importance: what choosing virtual lights, for the picture or for each pixel, gains at the same time.

use anyhow::Result;
use serde_json::{Value, json};

use super::{Measured, conference, cornell, office};
use crate::paper::{
    lab::{Lab, number},
    page::{Part, Section},
    plot::{Curve, Plot},
    report::{cells, percent, signed},
};

const TEXT: &str = "The paper gathers all virtual lights at all points. Here some are chosen, by what they would bring if nothing were in \
    the way: 'kept' shoots eight times as many light paths and keeps the lights that the picture's error would come from; \
    'selected' shoots four or sixteen times as many, of which every pixel asks for some. Beside them interleaving by 3 × 3, whose nine \
    times as many lights are joined by filters: the only rows whose pixels share what they find, since their error is smaller and not \
    noise alone. Errors are those of the indirect light against the plain method with 16,384 light paths of another seed; \
    times are those of light paths, choice, gathering and filters. 'Of plain' is the error divided by what the plain method's is at the \
    same time, between its measured points along a power law.";

/// Which ways, by their names in the bench.
const WAYS: [(&str, &str); 7] = [
    ("plain", "plain"),
    ("kept", "kept of 8 times as many"),
    ("selected", "selected of 4 times as many"),
    ("selected-16", "selected of 16 times as many"),
    ("interleaved", "interleaved 3 × 3, one pass with depths"),
    ("filled", "interleaved 3 × 3, gaps filled"),
    ("kept-filled", "the same, kept of 8 times as many"),
];

pub(super) fn measure(lab: &Lab) -> Measured {
    let (mut rows, mut plots, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
    let flags = match lab.quick {
        true => ["--size", "60x45", "--seeds", "1", "--truth", "2048"],
        false => ["--size", "160x120", "--seeds", "2", "--truth", "16384"],
    };
    for scene in [conference(lab), office(lab), cornell(lab)] {
        let lines = lab.bench(["isophote-instant-gi", "importance"], &scene, &flags)?;
        let points = |way: &str| -> Result<Vec<(f64, f64)>> {
            let of_way = lines.iter().filter(|line| line["way"] == way);
            of_way
                .map(|line| Ok((1e3 * number(line, "/seconds")?, number(line, "/rel_rmse")?)))
                .collect()
        };
        let plain = points("plain")?;
        let mut curves = Vec::new();
        for (way, name) in WAYS {
            for line in lines.iter().filter(|line| line["way"] == way) {
                let (time, error) = (1e3 * number(line, "/seconds")?, number(line, "/rel_rmse")?);
                rows.push(vec![
                    scene.title.clone(),
                    name.to_owned(),
                    line["lights"].to_string(),
                    format!("{time:.0} ms"),
                    percent(error),
                    signed(number(line, "/bias")?),
                    format!("{:.2}", error / at(&plain, time)),
                ]);
            }
            if ["plain", "kept", "selected", "filled"].contains(&way) {
                curves.push(Curve {
                    name: name.to_owned(),
                    points: points(way)?,
                });
            }
        }
        let title = format!("{}: relRMSE over time", scene.title);
        let plot = Plot {
            title: &title,
            x: "milliseconds",
            curves,
        };
        plots.push(Part::Plot(plot.svg()?));
        numbers.push(json!({ "title": scene.title, "measured": lines }));
    }
    let head = cells([
        "scene",
        "way",
        "lights of a pixel",
        "time",
        "relRMSE",
        "bias",
        "of plain",
    ]);
    let mut parts = vec![Part::Text(TEXT.to_owned())];
    parts.append(&mut plots);
    parts.push(Part::Table { head, rows });
    let section = Section {
        id: "importance",
        title: "Which lights: many-light importance",
        parts,
    };
    Ok((section, Value::Array(numbers)))
}

/// The error at a time along the power laws between points that are sorted by time; beyond them along the last one.
fn at(points: &[(f64, f64)], time: f64) -> f64 {
    let next = points.iter().position(|point| point.0 >= time);
    let next = next
        .unwrap_or(points.len())
        .clamp(1, points.len().max(2) - 1);
    match (points.get(next - 1), points.get(next)) {
        (Some(a), Some(b)) if b.0 > a.0 => {
            let slope = (b.1 / a.1).ln() / (b.0 / a.0).ln();
            a.1 * (time / a.0).powf(slope)
        }
        (Some(only), _) => only.1,
        _ => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_follow_power_laws() {
        let points = [(1.0, 8.0), (4.0, 4.0), (16.0, 1.0)];
        for (time, error) in [
            (1.0, 8.0),
            (2.0, 5.656_854),
            (8.0, 2.0),
            (64.0, 0.25),
            (0.25, 16.0),
        ] {
            assert!((at(&points, time) - error).abs() < 1e-5, "{time}");
        }
    }
}
