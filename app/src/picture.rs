//! What a picture is to be: the flags that `render` and `view` have in common, and what becomes of them.

use std::{collections::BTreeMap, path::PathBuf, sync::Arc};

use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};
use glam::Vec3;
use isophote_scene::{
    Camera, Image, Scene, Selection,
    reference::{Materials, Normals, Quantity, Render, Settings},
};

use crate::{
    applies::{Idle, of_other_quantities},
    output::{PROGRAM, Voice, check_available, gibibytes},
    pairs,
    reference::{Ground, Order},
    scene_args::{SceneArgs, choose_camera, note_moving, require_geometry, require_light},
    technique::{Technique, TechniqueArgs, TechniqueChoice},
    tracers::{AnyTracer, Choice, Device, Plan, TracerArgs, choose},
    values,
};

/// What a picture is to be.
#[derive(Args, Debug)]
pub(crate) struct PictureArgs {
    /// A .glb, .gltf or .obj file, or builtin:NAME as `isophote --help` lists them
    #[arg(required_unless_present = "settings")]
    pub(crate) scene: Option<String>,
    /// How light is calculated
    #[arg(long, value_enum, default_value = "reference")]
    pub(crate) technique: TechniqueChoice,
    /// Who answers its rays; bvh on the CPU and compute-bvh on a GPU unless given, but for the techniques ldi and field, which
    /// have the tracers of these names
    #[arg(long, value_enum)]
    pub(crate) tracer: Option<AnyTracer>,
    /// Where; auto is where the tracer runs, or a GPU if there is one in hardware
    #[arg(long, value_enum, default_value = "auto")]
    pub(crate) device: Device,
    /// A part of the name of the GPU to use; the fastest unless given (`isophote devices` lists them)
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
    /// What to calculate: ao, obscurance, direct, indirect, path, irradiance.direct, irradiance.indirect or
    /// irradiance.path; several with commas. The techniques ldi and igi know direct, indirect, and path with as many
    /// bounces as they have, igi irradiance.indirect too; field knows ao, obscurance, direct and irradiance.direct
    #[arg(
        long,
        value_name = "NAME[,…]",
        value_delimiter = ',',
        default_value = "path"
    )]
    pub(crate) quantity: Vec<Quantity>,
    /// How far ao and obscurance look; obscurance needs a finite one [metres]
    #[arg(long, value_name = "METRES", default_value = "inf", value_parser = values::distance)]
    d_max: f32,
    /// Leave out the indirect light of surfaces nearer than about this, as methods with virtual lights must; 0 unless
    /// given, and 0.1 with --technique igi [metres]
    #[arg(long, value_name = "METRES", value_parser = values::not_negative)]
    min_d: Option<f32>,
    /// Which part of the materials counts
    #[arg(long, value_enum, default_value = "pbr")]
    materials: MaterialsChoice,
    /// Which normals surfaces are shaded with
    #[arg(long, value_enum, default_value = "smooth")]
    normals: NormalsChoice,
    /// Surfaces that a light path of 'path' may meet
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(crate) path_bounces: u32,
    /// Width and height of the picture [pixels]
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = values::size)]
    pub(crate) size: Size,
    /// Samples per pixel; powers of two have the least noise
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub(crate) spp: u32,
    /// Chooses the random numbers; the same seed gives the same picture
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,
    /// The camera, by its node's name; the scene's first one unless given. 'auto' frames the scene. Or where it stands, what it
    /// looks at [metres] and how far it opens, in degrees or with parallel rays as a height in metres: X,Y,Z,X,Y,Z[,50|,3m]
    #[arg(long, value_name = "NAME|NUMBERS", allow_hyphen_values = true)]
    pub(crate) camera: Option<String>,
    /// Brighten a .png by this many stops (each doubles the light); .exr stays as it is
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, value_parser = values::finite, allow_hyphen_values = true)]
    pub(crate) exposure: f32,
    /// Repeat the settings in this file's header; flags given beside it win
    #[arg(long, value_name = "OLD.exr")]
    pub(crate) settings: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) tracer_args: TracerArgs,
    #[command(flatten)]
    pub(crate) techniques: TechniqueArgs,
    #[command(flatten)]
    pub(crate) changes: SceneArgs,
}

// clap takes a bare array for a list of values.
pub(crate) type Size = [u32; 2];

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum MaterialsChoice {
    /// Every surface is diffuse with its base colour
    Lambert,
    /// Metallic-roughness and transmission
    Pbr,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum NormalsChoice {
    /// Interpolated from the vertices
    Smooth,
    /// The triangles' own
    Flat,
}

/// What is to be rendered, and from where.
pub(crate) struct Shot {
    pub(crate) scene: Arc<Scene>,
    pub(crate) camera: Camera,
    /// What tracers hold.
    pub(crate) selection: Selection,
}

impl PictureArgs {
    /// Flags that have no effect beside the others.
    pub(crate) fn idle(&self) -> Vec<Idle> {
        let mut idle = self.tracer_args.idle(self.tracer(), self.technique);
        idle.extend(self.techniques.idle(self.technique, &self.quantity));
        idle.extend(of_other_quantities(&self.quantity));
        if self.technique == TechniqueChoice::Igi && self.min_d == Some(0.0) {
            let why = "--min-d 0 leaves no light out that could be found again";
            idle.extend(Idle::all(["igi_compensation"], why));
        }
        idle
    }

    pub(crate) fn chosen(&self) -> &dyn Technique {
        self.techniques.chosen(self.technique)
    }

    /// The tracer that was asked for, by its name or with the technique.
    pub(crate) fn tracer(&self) -> Option<AnyTracer> {
        self.tracer.or(self.chosen().tracer())
    }

    /// The tracer to build, where these settings can be.
    pub(crate) fn choice(&self) -> Result<Choice> {
        let choice = choose(self.device, self.tracer(), self.adapter.as_deref())?;
        pairs::check(self.technique, self.chosen(), choice, &self.quantity)?;
        self.tracer_args.check(choice)?;
        Ok(choice)
    }

    /// Refuses settings that do not go together.
    pub(crate) fn check(&self) -> Result<()> {
        ensure!(
            self.d_max.is_finite() || !self.quantity.contains(&Quantity::Obscurance),
            "obscurance needs a finite --d-max, since it grows with the distance over that"
        );
        for (index, quantity) in self.quantity.iter().enumerate() {
            ensure!(
                !self.quantity[..index].contains(quantity),
                "the quantity {quantity} is asked for twice"
            );
        }
        check_memory(self.size, self.quantity.len(), self.chosen().costs())
    }

    /// The scene as it is asked for, loaded and changed, but with nothing moved.
    pub(crate) fn load(&self, voice: Voice) -> Result<Scene> {
        let name = self.scene.as_deref().unwrap_or_default();
        let mut scene = self.changes.load_unmoved(name, voice)?;
        require_geometry(&scene, name)?;
        require_light(&mut scene, voice);
        Ok(scene)
    }

    /// A loaded scene with everything in its place, and the camera.
    pub(crate) fn shot(&self, mut scene: Scene, voice: Voice) -> Result<Shot> {
        self.changes.place(&mut scene)?;
        let camera = choose_camera(&scene, self.camera.as_deref(), voice)?;
        note_moving(&scene, self.tracer(), voice);
        Ok(Shot {
            scene: Arc::new(scene),
            camera,
            selection: Selection {
                bounds: self.changes.bounds(),
                ..Selection::default()
            },
        })
    }

    /// What tracers of a shot are built of.
    pub(crate) fn plan<'a>(&'a self, shot: &'a Shot) -> Plan<'a> {
        Plan {
            args: &self.tracer_args,
            scene: &shot.scene,
            selection: &shot.selection,
            camera: &shot.camera,
        }
    }

    pub(crate) fn settings(&self) -> Settings {
        Settings {
            d_max: self.d_max,
            min_d: self.min_d.unwrap_or(0.0),
            materials: match self.materials {
                MaterialsChoice::Lambert => Materials::Lambert,
                MaterialsChoice::Pbr => Materials::Pbr,
            },
            normals: match self.normals {
                NormalsChoice::Smooth => Normals::Smooth,
                NormalsChoice::Flat => Normals::Flat,
            },
            samples: self.spp,
            seed: self.seed,
            path_bounces: self.path_bounces,
        }
    }

    pub(crate) fn order<'a>(&'a self, shot: &'a Shot, settings: &'a Settings) -> Order<'a> {
        Order {
            camera: &shot.camera,
            size: self.size,
            quantities: &self.quantity,
            settings,
            selection: &shot.selection,
            min_d: self.min_d,
            maps: self.tracer_args.depth_maps.params(),
        }
    }

    /// Completes the stored settings with those that were chosen for the user.
    pub(crate) fn complete(
        &self,
        stored: &mut BTreeMap<String, String>,
        choice: Choice,
        ground: &Ground,
        order: &Order<'_>,
    ) {
        stored.insert("tracer".into(), choice.name());
        // A viewpoint that was given as numbers has no name.
        let camera = self.camera.clone();
        stored.insert("camera".into(), camera.unwrap_or(order.camera.name.clone()));
        for (name, value) in ground.maps().iter().flat_map(|maps| maps.settings()) {
            stored.insert(name.into(), value);
        }
        for (name, value) in self.chosen().header(order) {
            stored.insert(name.into(), value);
        }
        if let Some(bounces) = self.chosen().path_bounces() {
            stored.insert("path-bounces".into(), bounces.to_string());
        }
    }
}

/// Refuses a picture that would not fit into memory, or that no one could load again; `costs` are those of its technique.
pub(crate) fn check_memory(
    [width, height]: Size,
    quantities: usize,
    costs: [u64; 2],
) -> Result<()> {
    let (pixels, quantities) = (u64::from(width) * u64::from(height), quantities as u64);
    let [stages, bytes] = costs;
    // The channels of the file: RGB of each quantity, stage and of three layers, and depth, primitive, instance.
    let channels = 3 * (quantities + stages) + 12;
    let file = pixels * 4 * channels;
    // They are held three times while they are written; before, two halves and their mean.
    let needed = 3 * file.max(pixels * 12 * quantities + pixels * 48) + pixels * bytes;
    ensure!(
        file <= Image::MAX_BYTES,
        "--size {width}x{height}: the picture has {:.1} GiB, more than the {:.0} that can be loaded again",
        gibibytes(file),
        gibibytes(Image::MAX_BYTES)
    );
    check_available(needed, &format!("--size {width}x{height}"))
}

/// The image of a file: quantities, stages, layers, and the header.
pub(crate) fn image(
    render: Render,
    stages: Vec<(&'static str, Vec<Vec3>)>,
    settings: &BTreeMap<String, String>,
    device: &str,
) -> Image {
    let [width, height] = render.size;
    let mut image = Image::new(width, height);
    image.attributes.clone_from(settings);
    let single = render.estimates.len() == 1;
    for estimate in &render.estimates {
        let quantity = estimate.quantity.name();
        let (layer, noise) = if single {
            ("", "noise".to_owned())
        } else {
            (quantity, format!("noise.{quantity}"))
        };
        image.push_layer(layer, "RGB", &estimate.values);
        // With one sample there are no two halves to tell.
        if estimate.noise.is_finite() {
            image.attributes.insert(noise, estimate.noise.to_string());
        }
    }
    for (name, values) in stages {
        // A quantity may have the name of a stage, and then it is that stage.
        if image.channel(&format!("{name}.R")).is_none() {
            image.push_layer(name, "RGB", &values);
        }
    }
    let layers = render.layers;
    image.push_layer("albedo", "RGB", &layers.albedo);
    image.push_layer("normal", "XYZ", &layers.normal);
    image.push_layer("position", "XYZ", &layers.position);
    image.push("depth.Z", layers.depth);
    image.push("primitive", layers.primitive);
    image.push("instance", layers.instance);
    for (name, value) in [
        // OpenEXR has a meaning of its own for `version` and `software`.
        ("isophote", PROGRAM.version),
        ("commit", PROGRAM.commit.unwrap_or("unknown")),
        ("device", device),
        ("rays", &render.rays.to_string()),
    ] {
        image.attributes.insert(name.into(), value.into());
    }
    image
}
