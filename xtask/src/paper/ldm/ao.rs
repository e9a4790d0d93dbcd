//! Fig. 8 and 9: ambient occlusion and obscurance, against the reference and beside what a camera alone knows (HBAO).

use anyhow::Result;
use serde_json::{Value, json};

use super::{Measured, cornell, hairball, sibenik, sponza};
use crate::paper::{
    lab::{Lab, Scene, Shot, number},
    page::{Part, Picture, Section},
    plot::{Curve, Plot},
    report::cells,
};

const TEXT: &str = "512 maps; RMS and bias in grey levels. 'constant' is how many times worse a picture of the reference's mean is: \
    below 5 an error shows nothing. References have 4096 rays a pixel. Maps and HBAO have 16 points a pixel; those of HBAO four \
    directions each, of at most 32 steps, over depths that are twice as fine as pixels and known a tenth of the height beyond the \
    picture.";

/// Metres.
const REACHES: [&str; 7] = ["0.25", "0.5", "1", "1.5", "3", "6", "12"];

pub(super) fn measure(lab: &Lab) -> Measured {
    let mut table = Table {
        lab,
        rows: Vec::new(),
        numbers: Vec::new(),
        pictures: Vec::new(),
    };
    for (scene, resolutions) in [
        (sponza(lab), &["200"][..]),
        (cornell(lab), &["200"]),
        (hairball(lab), &["200", "50"]),
    ] {
        let truth = table.truth(&scene, "ao", None)?;
        for resolution in resolutions {
            table.maps(&scene, "ao", None, resolution, &truth)?;
        }
    }
    let (mut curves, mut crossings) = (Vec::new(), Vec::new());
    for scene in [sponza(lab), sibenik(lab)] {
        let mut points = [Vec::new(), Vec::new()];
        let reaches = if lab.quick {
            &REACHES[4..]
        } else {
            &REACHES[..]
        };
        for reach in reaches {
            let truth = table.truth(&scene, "ao", Some(reach))?;
            let d_max: f64 = reach.parse()?;
            for (points, [error, seconds]) in points.iter_mut().zip([
                table.maps(&scene, "ao", Some(reach), "200", &truth)?,
                table.hbao(&scene, Some(reach), &truth)?,
            ]) {
                points.push((d_max, [error, seconds]));
            }
            if *reach == "12" {
                let truth = table.truth(&scene, "obscurance", Some(reach))?;
                table.maps(&scene, "obscurance", Some(reach), "200", &truth)?;
            }
        }
        let mut crossing = vec![scene.title.clone()];
        crossing.extend([1, 0].map(|what| {
            let [maps, hbao] = &points;
            let pairs = maps.iter().zip(hbao);
            let pairs: Vec<_> = pairs.map(|(a, b)| (a.0, [b.1[what], a.1[what]])).collect();
            below(&pairs)
        }));
        let last = [0, 1].map(|by: usize| points[by].last().map_or(0.0, |(_, found)| found[0]));
        crossing.push(format!("{:.1}", last[1] / last[0]));
        crossings.push(crossing);
        for (what, title) in ["RMS, grey levels", "seconds"].into_iter().enumerate() {
            let plot = Plot {
                title: &format!("{title}: {}", scene.title),
                x: "d_max, m",
                curves: ["maps", "HBAO"]
                    .into_iter()
                    .zip(&points)
                    .map(|(name, points)| Curve {
                        name: name.to_owned(),
                        points: points.iter().map(|(x, y)| (*x, y[what])).collect(),
                    })
                    .collect(),
            };
            curves.push(Part::Plot(plot.svg()?));
        }
    }
    let head = cells([
        "scene",
        "quantity",
        "d_max",
        "by",
        "RMS",
        "beyond the noise",
        "bias",
        "constant",
        "seconds",
    ]);
    let mut parts = vec![
        Part::Text(TEXT.to_owned()),
        Part::Table {
            head,
            rows: table.rows,
        },
    ];
    parts.push(Part::Table {
        head: cells([
            "scene",
            "HBAO is cheaper for d_max",
            "HBAO errs less for d_max",
            "HBAO's RMS at the largest, of that of maps",
        ]),
        rows: crossings,
    });
    parts.extend(curves);
    parts.push(Part::Pictures {
        title: "Maps, HBAO and the reference".to_owned(),
        pictures: table.pictures,
    });
    let section = Section {
        id: "ao",
        title: "Fig. 8 and 9: ambient occlusion",
        parts,
    };
    Ok((section, Value::Array(table.numbers)))
}

/// Up to where the first of two curves is below the second one, between the places where both are known.
fn below(pairs: &[(f64, [f64; 2])]) -> String {
    let off = |[first, second]: [f64; 2]| first - second;
    let (Some(least), Some(most)) = (pairs.first(), pairs.last()) else {
        return String::new();
    };
    let crossing = pairs
        .windows(2)
        .find(|ends| off(ends[0].1) < 0.0 && off(ends[1].1) >= 0.0);
    match crossing {
        Some(ends) => {
            let [before, after] = [0, 1].map(|end: usize| off(ends[end].1));
            let share = before / (before - after);
            format!("below {:.2} m", ends[0].0 + share * (ends[1].0 - ends[0].0))
        }
        None if off(least.1) < 0.0 => format!("all, up to {} m", most.0),
        None => format!("none, down to {} m", least.0),
    }
}

struct Table<'a> {
    lab: &'a Lab,
    rows: Vec<Vec<String>>,
    numbers: Vec<Value>,
    pictures: Vec<Picture>,
}

impl Table<'_> {
    fn shoot(
        &self,
        scene: &Scene,
        by: &str,
        [quantity, reach]: [&str; 2],
        flags: &[&str],
    ) -> Result<Shot> {
        let title = scene.title.split(' ').next().unwrap_or_default();
        let name = format!("{title}-{quantity}-{reach}-{by}");
        let quantity = format!("--quantity={quantity}");
        let reach = format!("--d-max={reach}");
        let size = if self.lab.quick {
            "--size=80x60"
        } else {
            "--size=320x240"
        };
        let mut all = vec![size, &quantity];
        if reach != "--d-max=inf" {
            all.push(&reach);
        }
        self.lab.render(&name, scene, &[&all[..], flags].concat())
    }

    fn truth(&mut self, scene: &Scene, quantity: &str, reach: Option<&str>) -> Result<Shot> {
        let samples = if self.lab.quick {
            "--spp=64"
        } else {
            "--spp=4096"
        };
        let flags = ["--technique=reference", "--tracer=bvh", samples];
        let what = [quantity, reach.unwrap_or("inf")];
        let shot = self.shoot(scene, "reference", what, &flags)?;
        self.show(scene, "the reference", what, &shot)?;
        Ok(shot)
    }

    fn maps(
        &mut self,
        scene: &Scene,
        quantity: &str,
        reach: Option<&str>,
        resolution: &str,
        truth: &Shot,
    ) -> Result<[f64; 2]> {
        let pixels = format!("--ldm-resolution={resolution}");
        let maps = if self.lab.quick {
            "--ldm-maps=128"
        } else {
            "--ldm-maps=512"
        };
        let what = [quantity, reach.unwrap_or("inf")];
        let by = format!("maps {resolution}²");
        let name = format!("maps-{resolution}");
        let shot = self.shoot(scene, &name, what, &["--technique=ldm", maps, &pixels])?;
        self.show(scene, &by, what, &shot)?;
        self.row(scene, &by, what, [&shot, truth])
    }

    fn hbao(&mut self, scene: &Scene, reach: Option<&str>, truth: &Shot) -> Result<[f64; 2]> {
        let what = ["ao", reach.unwrap_or("inf")];
        let flags = ["--technique=ldm", "--ldm-occlusion=hbao"];
        let shot = self.shoot(scene, "hbao", what, &flags)?;
        self.show(scene, "HBAO", what, &shot)?;
        self.row(scene, "HBAO", what, [&shot, truth])
    }

    fn show(
        &mut self,
        scene: &Scene,
        by: &str,
        [quantity, reach]: [&str; 2],
        shot: &Shot,
    ) -> Result<()> {
        if matches!(reach, "inf" | "1.5" | "12") {
            self.pictures.push(Picture {
                png: self.lab.png(shot)?,
                left: None,
                caption: format!("{}, {quantity}, d_max {reach}: {by}", scene.title),
                command: shot.command.clone(),
            });
        }
        Ok(())
    }

    /// A row; returns the RMS and the seconds.
    fn row(
        &mut self,
        scene: &Scene,
        by: &str,
        [quantity, reach]: [&str; 2],
        [shot, truth]: [&Shot; 2],
    ) -> Result<[f64; 2]> {
        let errors = self.lab.compare_whole(shot, truth)?;
        let rms = number(&errors, "/grey_rms")?;
        let text = |key: &str| {
            let value = errors[key].as_f64();
            value.map_or_else(|| "–".to_owned(), |value| format!("{value:.2}"))
        };
        self.rows.push(vec![
            scene.title.clone(),
            quantity.to_owned(),
            reach.to_owned(),
            by.to_owned(),
            format!("{rms:.2}"),
            text("grey_rms_beyond_noise"),
            text("grey_bias"),
            text("constant_ratio"),
            format!("{:.2}", shot.seconds()?),
        ]);
        self.numbers.push(json!({
            "scene": scene.title, "quantity": quantity, "d_max": reach, "by": by, "errors": errors,
            "seconds": shot.seconds()?, "passes": shot.report["passes"], "command": shot.command,
        }));
        Ok([rms, shot.seconds()?])
    }
}
