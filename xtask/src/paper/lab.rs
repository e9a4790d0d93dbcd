//! Where a page's measurements are made: the application, a crate's bench, the scenes, a folder for the results.

use std::{
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::{Context, Result};
use serde_json::Value;

use crate::{
    isophote::Isophote,
    workspace::{Workspace, cargo, output, root},
};

/// Where scenes lie that the workspace does not hold.
const SCENES: &str = "../shared/scenes";

/// The measurements of one page.
pub(super) struct Lab {
    isophote: Isophote,
    folder: PathBuf,
    start: Instant,
    /// Smaller pictures and fewer rays.
    pub(super) quick: bool,
    /// On a GPU too.
    pub(super) gpu: bool,
}

/// A scene to measure in.
#[derive(Clone)]
pub(super) struct Scene {
    /// For the command line.
    pub(super) path: String,
    /// For people.
    pub(super) title: String,
    /// Flags that belong to it.
    pub(super) flags: Vec<String>,
    /// Whether a built-in scene stands in for it.
    pub(super) is_builtin: bool,
}

/// A picture that `isophote render` made.
pub(super) struct Shot {
    /// File name without suffix.
    name: String,
    /// What to type to get it again.
    pub(super) command: String,
    /// What `--json` printed.
    pub(super) report: Value,
}

impl Lab {
    /// An empty folder for the page of that name.
    pub(super) fn new(isophote: &Isophote, name: &str, quick: bool, gpu: bool) -> Result<Self> {
        let folder = Workspace::load()?.target_directory.join("paper").join(name);
        // Pictures of an earlier run would outlive what they belong to.
        if folder.exists() {
            fs::remove_dir_all(&folder)
                .with_context(|| format!("cannot empty {}", folder.display()))?;
        }
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        Ok(Self {
            isophote: isophote.clone(),
            folder,
            start: Instant::now(),
            quick,
            gpu,
        })
    }

    /// Says what is done now.
    pub(super) fn note(&self, what: &str) {
        eprintln!("{:5.0} s  {what}", self.seconds());
    }

    pub(super) fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    /// A scene of the folder of scenes by its name, or else a built-in one.
    pub(super) fn scene(&self, name: &str, title: &str, flags: &[&str], builtin: &str) -> Scene {
        let path = format!("{SCENES}/{name}.glb");
        if root().join(&path).exists() {
            return Scene {
                path,
                title: title.to_owned(),
                flags: flags.iter().map(|flag| (*flag).to_owned()).collect(),
                is_builtin: false,
            };
        }
        Scene {
            path: format!("builtin:{builtin}"),
            title: format!("{builtin} (built in, for {title})"),
            flags: Vec::new(),
            is_builtin: true,
        }
    }

    /// Renders a picture, as EXR to compare and as PNG to look at.
    pub(super) fn render(&self, name: &str, scene: &Scene, flags: &[&str]) -> Result<Shot> {
        self.note(&format!("rendering {name}"));
        let mut arguments = vec!["render", &scene.path];
        arguments.extend(scene.flags.iter().map(String::as_str));
        arguments.extend(flags);
        let command = format!(
            "isophote {} -o picture.exr -o picture.png",
            arguments.join(" ")
        );
        let (exr, png) = (self.file(name, "exr"), self.file(name, "png"));
        arguments.extend(["--quiet", "--json", "-o", &exr, "-o", &png]);
        Ok(Shot {
            report: self.isophote.json(&arguments)?,
            name: name.to_owned(),
            command,
        })
    }

    /// The picture as PNG.
    pub(super) fn png(&self, shot: &Shot) -> Result<Vec<u8>> {
        self.read(&shot.name)
    }

    /// A layer of a picture as PNG.
    pub(super) fn layer(&self, shot: &Shot, layer: &str, exposure: &str) -> Result<Vec<u8>> {
        let name = format!(
            "{}-{}",
            shot.name,
            if layer.is_empty() { "all" } else { layer }
        );
        let (exr, png) = (self.file(&shot.name, "exr"), self.file(&name, "png"));
        let exposure = format!("--exposure={exposure}");
        self.isophote
            .run(&["show", &exr, "--layer", layer, &exposure, "-o", &png])?;
        self.read(&name)
    }

    /// relRMSE and bias of a picture against another.
    pub(super) fn compare(&self, shot: &Shot, truth: &Shot) -> Result<[f64; 2]> {
        let report = self.compare_whole(shot, truth)?;
        Ok([number(&report, "/rel_rmse")?, number(&report, "/bias")?])
    }

    /// All that `isophote compare` tells.
    pub(super) fn compare_whole(&self, shot: &Shot, truth: &Shot) -> Result<Value> {
        let [shot, truth] = [shot, truth].map(|shot| self.file(&shot.name, "exr"));
        self.isophote.json(&["compare", &shot, &truth, "--json"])
    }

    /// The lines that a bench of a crate prints.
    pub(super) fn bench(
        &self,
        [package, bench]: [&str; 2],
        scene: &Scene,
        flags: &[&str],
    ) -> Result<Vec<Value>> {
        self.note(&format!(
            "measuring in {}: {}",
            scene.title,
            flags.join(" ")
        ));
        let package = format!("--package={package}");
        let bench = format!("--bench={bench}");
        let mut command = cargo(["bench", "--quiet", &package, &bench, "--"]);
        // Cargo runs benches in the folder of their crate.
        if scene.is_builtin {
            command.arg(&scene.path);
        } else {
            command.arg(root().join(&scene.path));
        }
        let bounds = scene
            .flags
            .iter()
            .filter_map(|flag| flag.strip_prefix("--bounds="));
        for bounds in bounds {
            command.args(["--bounds", bounds]);
        }
        let printed = output(command.args(flags))?;
        let lines = printed.lines().filter(|line| line.starts_with('{'));
        lines
            .map(|line| serde_json::from_str(line).context("the bench printed no JSON"))
            .collect()
    }

    /// Whether the processor stands in for the GPU that is measured on.
    pub(super) fn is_gpu_software(&self) -> Result<bool> {
        let devices = self.isophote.json(&["devices", "--json"])?;
        Ok(devices["adapters"][0]["kind"] == "Cpu")
    }

    /// Writes a file of the page.
    pub(super) fn write(&self, name: &str, text: &str) -> Result<PathBuf> {
        let path = self.folder.join(name);
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
        Ok(path)
    }

    /// Where the files of the page are.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// A PNG among them by its name.
    pub(super) fn read(&self, name: &str) -> Result<Vec<u8>> {
        let path = self.file(name, "png");
        fs::read(&path).with_context(|| format!("cannot read {path}"))
    }

    fn file(&self, name: &str, extension: &str) -> String {
        let path = self.folder.join(format!("{name}.{extension}"));
        path.to_string_lossy().into_owned()
    }
}

impl Shot {
    /// Rays of a pass per second, in millions, its shadow rays not counted but in the time; by the GPU's own clock
    /// where it tells.
    pub(super) fn mrays(&self, name: &str) -> Result<f64> {
        let rays = number(self.pass(name)?, "/rays")?;
        Ok(rays / self.pass_seconds(name)? / 1e6)
    }

    /// Seconds of a pass; by the GPU's own clock where it tells.
    pub(super) fn pass_seconds(&self, name: &str) -> Result<f64> {
        match self.report["gpu_seconds"][name].as_f64() {
            Some(seconds) => Ok(seconds),
            None => number(self.pass(name)?, "/seconds"),
        }
    }

    fn pass(&self, name: &str) -> Result<&Value> {
        let passes = self.report["passes"].as_array();
        passes
            .and_then(|passes| passes.iter().find(|pass| pass["name"] == name))
            .with_context(|| format!("`isophote render --json` told nothing of the pass {name}"))
    }

    /// Seconds of rendering alone.
    pub(super) fn seconds(&self) -> Result<f64> {
        number(&self.report, "/seconds/render")
    }
}

/// A number in a report.
pub(super) fn number(report: &Value, pointer: &str) -> Result<f64> {
    let value = report.pointer(pointer).and_then(Value::as_f64);
    value.with_context(|| format!("a report has no number at {pointer}: {report}"))
}
