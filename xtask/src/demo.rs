//! `cargo xtask demo`: the built-in scenes by every technique, as a page to look at.
//!
//! Every picture is made by `isophote render` and compared by `isophote compare` with the converged reference of the
//! same scene and quantity. The tables below say which; a new technique is one more line in [`TECHNIQUES`].

mod page;

use std::{fs, path::PathBuf, time::Instant};

use anyhow::{Context, Result};
use serde_json::Value;

use crate::{
    isophote::{Isophote, Source},
    machine::Machine,
    workspace::Workspace,
};

/// Render the built-in scenes with every technique into target/demo/index.html
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Small pictures with few samples: a look in a minute
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    source: Source,
}

/// A built-in scene and how far its ambient occlusion looks.
struct Scene {
    name: &'static str,
    title: &'static str,
    what: &'static str,
    d_max: &'static str,
    /// Stops by which the pictures of light are brightened for the screen.
    exposure: &'static str,
}

const SCENES: [Scene; 5] = [
    Scene {
        name: "builtin:cornell",
        title: "Cornell box",
        what: "The box that was built and measured at Cornell: light from one lamp, colour from the walls.",
        d_max: "0.25",
        exposure: "-0.5",
    },
    Scene {
        name: "builtin:corner",
        title: "Corner",
        what: "Three planes with objects on them: contact shadows in the open.",
        d_max: "1",
        exposure: "0",
    },
    Scene {
        name: "builtin:atrium",
        title: "Atrium",
        what: "A colonnaded hall on two storeys: a quarter of a million triangles, many of them behind one another.",
        d_max: "1.5",
        exposure: "0",
    },
    Scene {
        name: "builtin:office",
        title: "Office",
        what: "A furnished room: most of its light has bounced.",
        d_max: "1",
        exposure: "0",
    },
    Scene {
        name: "builtin:hairball",
        title: "Hairball",
        what: "Thin strands in every direction: the worst case for whatever simplifies geometry.",
        d_max: "0.3",
        exposure: "0",
    },
];

/// What is computed, in the page's order.
struct Quantity {
    name: &'static str,
    title: &'static str,
    what: &'static str,
    /// Whether `--d-max` applies, and the error is counted in grey levels.
    is_occlusion: bool,
    /// Samples of the converged reference at full quality: as many as the time allows.
    samples: u32,
}

const QUANTITIES: [Quantity; 4] = [
    Quantity {
        name: "ao",
        title: "Ambient occlusion",
        what: "how much of the hemisphere is open",
        is_occlusion: true,
        samples: 64,
    },
    Quantity {
        name: "direct",
        title: "Direct light",
        what: "straight from the lights",
        is_occlusion: false,
        samples: 64,
    },
    Quantity {
        name: "indirect",
        title: "Indirect light",
        what: "after one diffuse bounce",
        is_occlusion: false,
        samples: 128,
    },
    Quantity {
        name: "path",
        title: "All light",
        what: "up to eight bounces",
        is_occlusion: false,
        samples: 64,
    },
];

/// A way to compute some of the quantities.
struct Technique {
    title: &'static str,
    /// A word for file names.
    id: &'static str,
    arguments: &'static [&'static str],
    quantities: &'static [&'static str],
    /// Those it is for; all if none is named.
    scenes: &'static [&'static str],
}

impl Technique {
    fn is_for(&self, scene: &Scene, quantity: &Quantity) -> bool {
        let in_scene = self.scenes.is_empty() || self.scenes.contains(&scene.name);
        in_scene && self.quantities.contains(&quantity.name)
    }
}

/// What everything is compared with.
const CONVERGED: Technique = Technique {
    title: "Reference, converged",
    id: "converged",
    arguments: &["--technique", "reference", "--tracer", "bvh"],
    quantities: &["ao", "direct", "indirect", "path"],
    scenes: &[],
};

/// Every technique there is.
const TECHNIQUES: [Technique; 5] = [
    Technique {
        title: "Reference, 4 samples",
        id: "reference-4",
        arguments: &["--technique", "reference", "--tracer", "bvh", "--spp", "4"],
        quantities: &["ao", "direct", "indirect", "path"],
        scenes: &[],
    },
    Technique {
        title: "Layered depth images, 8 rays, filtered",
        id: "ldi",
        arguments: &["--technique", "ldi"],
        quantities: &["indirect"],
        scenes: &[],
    },
    Technique {
        title: "Virtual point lights, 720 paths",
        id: "igi",
        arguments: &["--technique", "igi", "--igi-paths", "720"],
        quantities: &["indirect"],
        scenes: &[],
    },
    Technique {
        title: "Displacement fields, 64 samples",
        id: "field",
        arguments: &[
            "--technique",
            "reference",
            "--tracer",
            "field",
            "--spp",
            "64",
        ],
        quantities: &["ao"],
        // A room is not an object.
        scenes: &["builtin:corner"],
    },
    Technique {
        title: "Layered depth maps, 512 directions",
        id: "ldm",
        arguments: &["--technique", "ldm"],
        quantities: &["ao", "indirect"],
        scenes: &[],
    },
];

/// How large and how good the pictures are.
struct Quality {
    size: (u32, u32),
    /// The reference's samples are divided by this.
    fewer_samples: u32,
}

const FULL: Quality = Quality {
    size: (320, 240),
    fewer_samples: 1,
};
const QUICK: Quality = Quality {
    size: (160, 120),
    fewer_samples: 4,
};

/// Renders everything and writes the page.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let isophote = arguments.source.isophote()?;
    let folder = Workspace::load()?.target_directory.join("demo");
    // Pictures of an earlier run would outlive the scenes and techniques they belong to.
    if folder.exists() {
        fs::remove_dir_all(&folder)
            .with_context(|| format!("cannot empty {}", folder.display()))?;
    }
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let start = Instant::now();
    let mut demo = Demo {
        isophote,
        folder,
        quality: if arguments.quick { QUICK } else { FULL },
        start,
        done: 0,
    };
    let scenes = SCENES
        .iter()
        .map(|scene| demo.scene(scene))
        .collect::<Result<_>>()?;
    let page = page::Page {
        machine: Machine::current(),
        size: demo.quality.size,
        seconds: start.elapsed().as_secs_f64(),
        scenes,
    };
    let index = demo.folder.join("index.html");
    fs::write(&index, page.html()).with_context(|| format!("cannot write {}", index.display()))?;
    println!("{} shows {} pictures", index.display(), demo.done);
    Ok(())
}

struct Demo {
    isophote: Isophote,
    folder: PathBuf,
    quality: Quality,
    start: Instant,
    /// Pictures made so far.
    done: usize,
}

impl Demo {
    fn scene(&mut self, scene: &Scene) -> Result<page::Scene> {
        let cards = QUANTITIES
            .iter()
            .map(|quantity| self.card(scene, quantity))
            .collect::<Result<_>>()?;
        Ok(page::Scene {
            name: scene.name,
            title: scene.title,
            what: scene.what,
            cards,
        })
    }

    fn card(&mut self, scene: &Scene, quantity: &Quantity) -> Result<page::Card> {
        let spp = (quantity.samples / self.quality.fewer_samples).to_string();
        let reference = self.render(scene, quantity, &CONVERGED, &["--spp", &spp])?;
        let mut others = Vec::new();
        for technique in &TECHNIQUES {
            if technique.is_for(scene, quantity) {
                let picture = self.render(scene, quantity, technique, &[])?;
                let errors = self.compare(scene, &picture, &reference, quantity)?;
                others.push((picture, errors));
            }
        }
        let what = if quantity.is_occlusion {
            format!("{}, within {} m", quantity.what, scene.d_max)
        } else {
            quantity.what.to_owned()
        };
        Ok(page::Card {
            title: quantity.title,
            what,
            reference,
            others,
        })
    }

    /// Renders one picture, as EXR to compare and as PNG to look at.
    fn render(
        &mut self,
        scene: &Scene,
        quantity: &Quantity,
        technique: &Technique,
        more: &[&str],
    ) -> Result<page::Picture> {
        let file = format!(
            "{}-{}-{}",
            scene.name.replace(':', "-"),
            quantity.name,
            technique.id
        );
        let (width, height) = self.quality.size;
        let size = format!("{width}x{height}");
        let mut arguments = vec!["render", scene.name, "--quantity", quantity.name];
        arguments.extend(technique.arguments);
        arguments.extend(more);
        if quantity.is_occlusion {
            arguments.extend(["--d-max", scene.d_max]);
        } else {
            arguments.extend(["--exposure", scene.exposure]);
        }
        arguments.extend(["--size", &size]);
        let command = format!("isophote {} -o picture.exr", arguments.join(" "));
        eprintln!(
            "{:4.0} s  {} of {}  {file}",
            self.start.elapsed().as_secs_f64(),
            self.done + 1,
            pictures()
        );
        let (exr, png) = (self.file(&file, "exr"), self.file(&file, "png"));
        arguments.extend(["--quiet", "--json", "-o", &exr, "-o", &png]);
        let report = self.isophote.json(&arguments)?;
        self.done += 1;
        let noise = report["noise"][quantity.name].as_f64();
        Ok(page::Picture {
            title: technique.title,
            file: file + ".png",
            seconds: number(&report, "/seconds/render")?,
            rays_per_second: report.pointer("/rays_per_second").and_then(Value::as_f64),
            noise,
            command,
        })
    }

    fn compare(
        &self,
        scene: &Scene,
        picture: &page::Picture,
        reference: &page::Picture,
        quantity: &Quantity,
    ) -> Result<page::Errors> {
        let exr = |picture: &page::Picture| self.file(picture.file.trim_end_matches(".png"), "exr");
        let name = picture.file.trim_end_matches(".png").to_owned() + "-error";
        let exposure = if quantity.is_occlusion {
            "0"
        } else {
            scene.exposure
        };
        let report = self.isophote.json(&[
            "compare",
            &exr(picture),
            &exr(reference),
            "--json",
            "--exposure",
            exposure,
            "--quantity",
            quantity.name,
            "--error-image",
            &self.file(&name, "png"),
        ])?;
        let (error, bias) = if quantity.is_occlusion {
            (
                format!("{:.2} grey", number(&report, "/grey_rms")?),
                format!("{:+.2} grey", number(&report, "/grey_bias")?),
            )
        } else {
            (
                format!("{:.1} %", 100.0 * number(&report, "/rel_rmse")?),
                format!("{:+.2} %", 100.0 * number(&report, "/bias")?),
            )
        };
        Ok(page::Errors {
            error,
            bias,
            flip: report.pointer("/flip").and_then(Value::as_f64),
            file: name + ".png",
        })
    }

    fn file(&self, name: &str, extension: &str) -> String {
        let path = self.folder.join(format!("{name}.{extension}"));
        path.to_string_lossy().into_owned()
    }
}

/// How many pictures will be rendered.
fn pictures() -> usize {
    let of = |scene: &Scene, quantity: &Quantity| {
        let techniques = TECHNIQUES.iter();
        1 + techniques
            .filter(|technique| technique.is_for(scene, quantity))
            .count()
    };
    let scenes = SCENES.iter();
    scenes
        .flat_map(|scene| QUANTITIES.iter().map(move |quantity| of(scene, quantity)))
        .sum()
}

/// A number in a report of the application.
fn number(report: &Value, pointer: &str) -> Result<f64> {
    let value = report.pointer(pointer).and_then(Value::as_f64);
    value.with_context(|| format!("`isophote --json` printed no number at {pointer}"))
}
