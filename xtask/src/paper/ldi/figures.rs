//! Figures 1 and 4 to 9, from real scenes where they are.

use anyhow::Result;
use serde_json::{Value, json};

use super::{sibenik, sponza};
use crate::paper::{
    lab::{Lab, Scene, Shot, number},
    page::{Part, Picture, Section},
    report::{percent, signed},
};

const EXACT: &[&str] = &["--tracer=bvh"];
/// As the paper has it: layers at the pixels' centres, a Gaussian that stops nowhere.
const PAPER: &[&str] = &["--ldi-layers=center", "--ldi-filter-stops=nowhere"];

/// A figure under construction.
struct Figure<'a> {
    lab: &'a Lab,
    id: &'static str,
    title: String,
    scene: Scene,
    /// Of every picture of it.
    flags: Vec<&'static str>,
    pictures: Vec<Picture>,
    numbers: Vec<Value>,
}

pub(super) fn measure(lab: &Lab) -> Result<(Section, Value)> {
    let figures = [fig1, fig4, fig5, fig6, fig7, fig8, fig9a, fig9b, fig9c];
    let mut parts = Vec::new();
    let mut numbers = json!({});
    for figure in figures {
        let figure = figure(lab)?;
        numbers[figure.id] = Value::Array(figure.numbers);
        parts.push(Part::Pictures {
            title: format!("{}. {}", figure.title, figure.scene.title),
            pictures: figure.pictures,
        });
    }
    let section = Section {
        id: "figures",
        title: "Figures",
        parts,
    };
    Ok((section, numbers))
}

impl<'a> Figure<'a> {
    fn new(
        lab: &'a Lab,
        id: &'static str,
        title: &str,
        scene: Scene,
        flags: &[&'static str],
    ) -> Self {
        let size = if lab.quick {
            "--size=96x96"
        } else {
            "--size=512x512"
        };
        Self {
            lab,
            id,
            title: title.to_owned(),
            scene,
            flags: [&["--technique=ldi", size], flags].concat(),
            pictures: Vec::new(),
            numbers: Vec::new(),
        }
    }

    fn shoot(&self, name: &str, flags: &[&str]) -> Result<Shot> {
        let name = format!("{}-{name}", self.id);
        self.lab
            .render(&name, &self.scene, &[&self.flags[..], flags].concat())
    }

    /// Shows a picture, with its error where it has a truth.
    fn show(&mut self, what: &str, shot: &Shot, truth: Option<&Shot>) -> Result<()> {
        let mut numbers = json!({
            "what": what,
            "command": shot.command,
            "seconds": shot.seconds()?,
            "rays": shot.report["rays"],
            "passes": shot.report["passes"],
            "maps": shot.report["maps"],
        });
        let mut caption = format!("{what}: {:.1} s", shot.seconds()?);
        if let Some(truth) = truth {
            let [rel_rmse, bias] = self.lab.compare(shot, truth)?;
            let error = format!(", relRMSE {}, bias {}", percent(rel_rmse), signed(bias));
            caption += &error;
            numbers["rel_rmse"] = json!(rel_rmse);
            numbers["bias"] = json!(bias);
        }
        self.pictures.push(Picture {
            png: self.lab.png(shot)?,
            left: None,
            caption,
            command: shot.command.clone(),
        });
        self.numbers.push(numbers);
        Ok(())
    }

    /// The exact tracer on the same rays, the maps, and the paper's maps and filter.
    fn three(mut self, maps: &[&str]) -> Result<Self> {
        let exact = self.shoot("exact", EXACT)?;
        let ours = self.shoot("maps", maps)?;
        let paper = self.shoot("paper", &[maps, PAPER].concat())?;
        self.show("exact tracer, same rays", &exact, None)?;
        self.show("maps, layers 'touched'", &ours, Some(&exact))?;
        self.show(
            "as the paper: layers 'center', plain Gaussian",
            &paper,
            Some(&exact),
        )?;
        Ok(self)
    }
}

fn box_with_sphere(lab: &Lab) -> Scene {
    lab.scene("cornell_glossy", "Cornell box with a sphere", &[], "office")
}

fn fig1(lab: &Lab) -> Result<Figure<'_>> {
    let mut scene = box_with_sphere(lab);
    if !scene.is_builtin {
        for flag in [
            "--add=../shared/scenes/dragon.glb#dragon@0.38,0,0.3,0.75,-30",
            "--add=../shared/scenes/bunny.glb#bunny@-0.55,0,0.55,0.45,20",
            "--material=bunny=1,0.25,0.9,0.85,0.7",
        ] {
            scene.flags.push(flag.to_owned());
        }
    }
    let title =
        "Fig. 1: glossy sphere and bunny (the paper: lion), diffuse dragon; then 27 frames/s";
    Figure::new(lab, "fig-1", title, scene, &["--ldi-samples=4"]).three(&["--ldi-cells=5"])
}

fn fig4(lab: &Lab) -> Result<Figure<'_>> {
    let title = "Fig. 4: anti-aliasing; then 17.5 and 16.5 frames/s, 6 % of the frame";
    let mut figure = Figure::new(lab, "fig-4", title, sibenik(lab), &[]);
    let one = figure.shoot("1", &["--ldi-samples=1"])?;
    let four = figure.shoot("4", &["--ldi-samples=4"])?;
    figure.show("1 sample a pixel", &one, None)?;
    let share = 1.0 - one.seconds()? / four.seconds()?;
    let what = format!(
        "4 samples a pixel, {} of the frame (aim: 10 %)",
        percent(share)
    );
    figure.show(&what, &four, None)?;
    figure.numbers.push(json!({ "share_of_frame": share }));
    Ok(figure)
}

fn fig5(lab: &Lab) -> Result<Figure<'_>> {
    let title = "Fig. 5: the stages";
    let floor = ["--material=floors=1,0.15,0.8,0.75,0.7"];
    let scene = sponza(lab);
    let flags = if scene.is_builtin {
        &[][..]
    } else {
        &floor[..]
    };
    let mut figure = Figure::new(lab, "fig-5", title, scene, flags);
    let shot = figure.shoot("stages", &["--exposure=-0.5"])?;
    for (layer, what) in [
        ("direct", "direct light with shadows"),
        ("irradiance.noisy", "irradiance by 8 diffuse rays"),
        ("irradiance.indirect", "the same after the Gaussian"),
        ("diffuse", "diffuse indirect light"),
        ("glossy", "glossy indirect light"),
        ("", "all together"),
    ] {
        let exposure = if layer.starts_with("irradiance") {
            "-1.5"
        } else {
            "-0.5"
        };
        figure.pictures.push(Picture {
            png: lab.layer(&shot, layer, exposure)?,
            left: None,
            caption: what.to_owned(),
            command: shot.command.clone(),
        });
    }
    figure
        .numbers
        .push(json!({ "passes": shot.report["passes"] }));
    Ok(figure)
}

fn fig6(lab: &Lab) -> Result<Figure<'_>> {
    let title = "Fig. 6: an object in the maps, and left out because it moves: it receives, and its shadow is in the \
                 reflection, but it is not";
    let scene = box_with_sphere(lab);
    let (still, moving) = if scene.is_builtin {
        (
            "--add=builtin:hairball:1000@0,0,0.5,0.5",
            "--add=builtin:hairball:1000@0,0,0.5,0.5:moving",
        )
    } else {
        (
            "--add=../shared/scenes/igea_67k.glb#igea_67k@-0.05,0,0.62,0.6,20",
            "--add=../shared/scenes/igea_67k.glb#igea_67k@-0.05,0,0.62,0.6,20:moving",
        )
    };
    let mut figure = Figure::new(lab, "fig-6", title, scene, &["--ldi-cells=5"]);
    let inside = figure.shoot("inside", &[still])?;
    let left_out = figure.shoot("left-out", &[moving])?;
    figure.show("in the maps", &inside, None)?;
    figure.show("left out", &left_out, None)?;
    Ok(figure)
}

fn fig7(lab: &Lab) -> Result<Figure<'_>> {
    let scene = lab.scene("cornell_mirror", "Cornell box with a mirror", &[], "office");
    let title = "Fig. 7: a mirror by 150 directions; then 336 frames/s at 512² and 600 at 128²";
    let mut figure = Figure::new(lab, "fig-7", title, scene, &["--ldi-light-rays=1"]);
    let exact = figure.shoot("exact", EXACT)?;
    figure.show("exact tracer, same rays", &exact, None)?;
    for (name, resolution, layers) in [
        ("center-512", "--ldi-resolution=512", "--ldi-layers=center"),
        ("center-128", "--ldi-resolution=128", "--ldi-layers=center"),
        (
            "touched-128",
            "--ldi-resolution=128",
            "--ldi-layers=touched",
        ),
    ] {
        let shot = figure.shoot(name, &["--ldi-cells=5", resolution, layers])?;
        figure.show(name, &shot, Some(&exact))?;
    }
    Ok(figure)
}

fn fig8(lab: &Lab) -> Result<Figure<'_>> {
    let scene = lab.scene("dragon", "Dragon", &["--light-radius=0.15"], "corner");
    let title = "Fig. 8: soft shadows of area lights by 384 directions of 512², 16 rays a pixel and a filter; then 19.5 and \
                 22.5 frames/s";
    let flags = ["--quantity=direct", "--ldi-diffuse-rays=1"];
    let mut figure = Figure::new(lab, "fig-8", title, scene, &flags);
    let truth = figure.shoot("truth", &[EXACT, &["--ldi-light-rays=256"]].concat())?;
    let exact = figure.shoot(
        "exact",
        &[
            EXACT,
            &["--ldi-light-filter-width=5", "--ldi-filter-sigma=1"],
        ]
        .concat(),
    )?;
    let resolution = if lab.quick {
        "--ldi-resolution=64"
    } else {
        "--ldi-resolution=512"
    };
    let maps = [
        "--ldi-cells=8",
        resolution,
        "--ldi-shadows=tracer",
        "--ldi-memory-limit=16384",
    ];
    let filter = ["--ldi-light-filter-width=5", "--ldi-filter-sigma=1"];
    let center = ["--ldi-layers=center"];
    let plain = figure.shoot("center-noisy", &[&maps[..], &center].concat())?;
    let center = figure.shoot("center", &[&maps[..], &center, &filter].concat())?;
    let touched = figure.shoot("touched", &[&maps[..], &filter].concat())?;
    figure.show("exact tracer, 256 rays", &truth, None)?;
    figure.show("exact tracer, 16 rays, filtered", &exact, Some(&truth))?;
    figure.show("maps, 'center', not filtered", &plain, Some(&truth))?;
    figure.show("maps, 'center', filtered", &center, Some(&truth))?;
    figure.show("maps, 'touched', filtered", &touched, Some(&truth))?;
    Ok(figure)
}

fn fig9a(lab: &Lab) -> Result<Figure<'_>> {
    let mut scene = sibenik(lab);
    if !scene.is_builtin {
        for flag in [
            "--add=../shared/scenes/lucy_10k.glb#lucy_10k@15.5,0.1,0,4.5,-90",
            "--material=lucy_10k=1,0.15,0.95,0.9,0.8",
        ] {
            scene.flags.push(flag.to_owned());
        }
    }
    let title = "Fig. 9, top left: glossy Lucy in Sibenik by 150 directions; then 45 frames/s";
    Figure::new(lab, "fig-9a", title, scene, &["--ldi-samples=4"]).three(&["--ldi-cells=5"])
}

fn fig9b(lab: &Lab) -> Result<Figure<'_>> {
    let mut scene = sponza(lab);
    if !scene.is_builtin {
        let floor = "--material=floors=1,0.15,0.8,0.75,0.7";
        scene.flags.push(floor.to_owned());
    }
    let title = "Fig. 9, top right: glossy floor of Sponza by 96 directions; then 52.5 frames/s";
    Figure::new(lab, "fig-9b", title, scene, &["--exposure=-0.5"]).three(&[])
}

fn fig9c(lab: &Lab) -> Result<Figure<'_>> {
    let title = "Fig. 9, bottom left: diffuse Sponza by 96 directions, the left half without indirect light; then 19 frames/s";
    let mut figure = Figure::new(lab, "fig-9c", title, sponza(lab), &["--exposure=-0.5"]);
    let exact = figure.shoot("exact", EXACT)?;
    let whole = figure.shoot("whole", &[])?;
    let direct = figure.shoot("direct", &["--quantity=direct"])?;
    figure.show("maps, layers 'touched'", &whole, Some(&exact))?;
    let left = lab.png(&direct)?;
    if let Some(picture) = figure.pictures.last_mut() {
        picture.left = Some(left);
    }
    let share =
        number(&whole.report, "/seconds/render")? / number(&exact.report, "/seconds/render")?;
    figure.numbers.push(json!({ "seconds_over_exact": share }));
    Ok(figure)
}
