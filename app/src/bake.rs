//! `isophote bake`: light becomes a part of a scene's file.
//!
//! 1. The scene is loaded, with where everything came from ([`isophote_scene::GltfSource`]).
//! 2. What light is computed for: the vertices of all instances ([`vertices`]), or the texels of a lightmap ([`texels`]) over
//!    the scene's texture coordinates or new ones ([`layout`]).
//! 3. Values for them ([`work`]), in pieces that are independent of each other ([`light`]); some of them in another process
//!    ([`parts`]).
//! 4. What the values look like ([`report`]), and the file with them in it ([`document`], [`meshes`], [`textures`]).

mod document;
mod layout;
mod light;
mod meshes;
mod parts;
mod report;
mod seams;
mod techniques;
mod texels;
mod textures;
mod vertices;
mod work;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use anyhow::{Result, ensure};
use clap::{Args, ValueEnum};
use glam::Vec3;
use isophote_scene::{
    GltfSource, Image, Receiver, Scene, check_writable,
    reference::{Materials, Normals, Quantity, Settings},
};

pub(crate) use self::parts::settings as settings_of_part;
use self::{
    document::Document,
    layout::Layout,
    parts::{Fingerprint, Shard},
    report::Report,
    techniques::Techniques,
    texels::{Lightmap, Texels},
    vertices::{Attribute, COLOR, Vertices},
    work::Work,
};
use crate::{
    applies::Idle,
    output::{PROGRAM, Voice, has_suffix, timed},
    scene_args::{SceneArgs, note_moving, require_geometry, require_light},
    technique::TechniqueChoice,
    tracers::{AnyTracer, TracerArgs},
    values,
};

const EXAMPLES: &str = "\
The output is the input with light added: everything else in it stays as it is. A .gltf becomes a .glb that holds all its \
files.

Examples:
  isophote bake hall.glb -o baked.glb                                ambient occlusion in the colours of vertices
  isophote bake hall.glb --d-max 2 --attribute _AO -o baked.glb      in an attribute of its own, looking 2 m far
  isophote bake hall.glb --quantity irradiance -o baked.glb          light in the attribute _IRRADIANCE [W/m²]
  isophote bake hall.glb --to texels --size 2048 -o baked.glb        in a lightmap (occlusionTexture)
  isophote bake hall.glb --to texels --quantity irradiance -o baked.glb -o light.exr   light, by MOZ_lightmap
  isophote bake hall.glb --technique ldm --ldm-maps 2048 -o baked.glb   by layered depth maps
  isophote bake hall.glb --technique ldm --quantity irradiance.indirect -o baked.glb   the light of one bounce, by photons
  isophote bake hall.glb --technique igi --quantity irradiance.indirect -o baked.glb   the same by virtual point lights
  isophote bake hall.glb --shard 1/2 -o 1.part                       half of the work; 2/2 elsewhere, and then
  isophote bake hall.glb --merge 1.part 2.part -o baked.glb          what one process would have made";

/// The channel of a lightmap's .exr that is 1 where a texel was computed, and 0 where its neighbours were spread into it.
pub(crate) const COVERAGE: &str = "coverage";

/// Bake occlusion or light into a glTF file.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
// Maps are drawn around receivers that are computed together, and these are finer than pixels.
#[command(mut_arg("ldm_resolution", |arg| arg.default_value("400")))]
pub(crate) struct BakeArgs {
    /// A .glb or .gltf file
    scene: String,
    /// What to bake: ao, obscurance, irradiance.direct, irradiance.indirect or irradiance.path, which is also called
    /// irradiance
    #[arg(long, value_name = "NAME", default_value = "ao", value_parser = quantity)]
    quantity: Quantity,
    /// How it is calculated: by the reference's rays, by the maps of ldm or by the virtual lights of igi
    #[arg(long, value_enum, default_value = "reference")]
    technique: TechniqueChoice,
    /// Who answers rays: bvh unless given; not on GPUs
    #[arg(long, value_enum)]
    tracer: Option<AnyTracer>,
    /// What receives the light
    #[arg(long, value_enum, default_value = "vertices")]
    to: Target,
    #[arg(long, value_name = "NAME", value_parser = vertices::name,
        help = "The attribute of vertices: COLOR_0 for ao and obscurance unless given, _IRRADIANCE for irradiance, or one \
                of your own such as _AO")]
    attribute: Option<String>,
    /// Texels on each side of the lightmap
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(16..=8192))]
    size: u32,
    /// Empty texels around each chart of the lightmap, into which its light is spread
    #[arg(long, value_name = "TEXELS", default_value_t = 2, value_parser = clap::value_parser!(u32).range(0..=64))]
    padding: u32,
    /// What becomes of occlusion or light that is in the file already
    #[arg(long, value_enum, default_value = "refuse")]
    existing: Existing,
    /// How far ao and obscurance look; obscurance needs a finite one [metres]
    #[arg(long, value_name = "METRES", default_value = "inf", value_parser = values::distance)]
    d_max: f32,
    /// Rays or light paths a receiver; powers of two have the least noise
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    samples: u32,
    /// Chooses the random numbers; the same seed gives the same light
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Surfaces that a light path may meet
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1000))]
    path_bounces: u32,
    /// Compute one of so many parts only, and write it to the output for --merge
    #[arg(long, value_name = "I/N", value_parser = Shard::parse)]
    shard: Option<Shard>,
    /// Put parts together instead of computing: all that were made of the scene; their settings need not be repeated
    #[arg(long, value_name = "PART", num_args = 1.., conflicts_with = "shard")]
    pub(crate) merge: Vec<PathBuf>,
    /// Threads to use; all unless given
    #[arg(long, value_name = "N", value_parser = values::threads)]
    pub(crate) threads: Option<usize>,
    /// What to write: a .glb, and of a lightmap also an .exr with all its precision
    #[arg(short, long, value_name = "FILE", required = true)]
    output: Vec<PathBuf>,
    /// Print settings, times and what was found as JSON
    #[arg(long)]
    json: bool,
    /// Say nothing but errors
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten)]
    tracer_args: TracerArgs,
    #[command(flatten)]
    techniques: Techniques,
    #[command(flatten)]
    changes: SceneArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Target {
    /// An attribute of vertices
    Vertices,
    /// A lightmap: one texture over the whole scene
    Texels,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Existing {
    /// It stays, and nothing is baked
    Refuse,
    /// Colours of vertices are multiplied with the occlusion
    Multiply,
    /// It is replaced
    Replace,
}

/// What light is computed for.
enum Sites {
    Vertices(Vertices),
    Texels {
        layout: Layout,
        texels: Texels,
        receivers: Vec<Receiver>,
    },
}

impl Sites {
    fn receivers(&self) -> &[Receiver] {
        match self {
            Self::Vertices(vertices) => &vertices.receivers,
            Self::Texels { receivers, .. } => receivers,
        }
    }
}

impl BakeArgs {
    /// Flags that have no effect beside the others.
    pub(crate) fn idle(&self) -> Vec<Idle> {
        let mut idle = self.tracer_args.idle(self.tracer, self.technique);
        idle.extend(self.techniques.idle(self.technique, self.quantity));
        match self.to {
            Target::Vertices => {
                let why = "it is for --to texels";
                idle.extend(Idle::all(["size", "padding"], why));
            }
            Target::Texels => {
                idle.extend(Idle::all(["attribute"], "it is for --to vertices"));
            }
        }
        if self.quantity.is_occlusion() {
            idle.extend(Idle::all(["path_bounces"], "occlusion knows no light"));
        } else {
            idle.extend(Idle::all(["d_max"], "light comes from everywhere"));
        }
        idle
    }

    fn settings(&self) -> Settings {
        Settings {
            d_max: self.d_max,
            min_d: 0.0,
            materials: Materials::Pbr,
            normals: Normals::Smooth,
            samples: self.samples,
            seed: self.seed,
            path_bounces: self.path_bounces,
        }
    }

    fn attribute(&self) -> Attribute<'_> {
        let is_occlusion = self.quantity.is_occlusion();
        let default = if is_occlusion { COLOR } else { "_IRRADIANCE" };
        Attribute {
            name: self.attribute.as_deref().unwrap_or(default),
            is_occlusion,
            default: if is_occlusion { Vec3::ONE } else { Vec3::ZERO },
            existing: self.existing,
        }
    }
}

/// Bakes; `settings` are the command's settings by name.
pub(crate) fn bake(args: &BakeArgs, mut settings: BTreeMap<String, String>) -> Result<()> {
    let voice = Voice::new(args.quiet);
    check(args)?;
    // Files have different names on different machines; their contents are compared.
    settings.remove("scene");
    let mut report = Report::new(args.quantity);
    let (loaded, seconds) = timed(|| args.changes.load_gltf(&args.scene, voice));
    let (mut scene, source) = loaded?;
    report.seconds.load = seconds;
    require_geometry(&scene, &args.scene)?;
    if !args.quantity.is_occlusion() {
        require_light(&mut scene, voice);
    }
    note_moving(&scene, args.tracer, voice);
    let mut document = Document::new(&source)?;
    meshes::check(&document, &source)?;
    let scene = Arc::new(scene);
    let (sites, seconds) = timed(|| sites(args, &document, &source, &scene));
    let sites = sites?;
    report.seconds.layout = seconds;
    ensure!(
        !sites.receivers().is_empty(),
        "{}: nothing in it can receive light",
        args.scene
    );
    let fingerprint = Fingerprint {
        version: PROGRAM.version.into(),
        commit: PROGRAM.commit.map(Into::into),
        scene: parts::fingerprint(&source, &scene, sites.receivers()),
        receivers: sites.receivers().len(),
        piece: light::piece_size(args.technique),
        settings: settings.clone(),
    };
    let ground = Work::ground(args, &scene, &mut report, voice)?;
    let work = Work {
        args,
        scene: &scene,
        ground,
        fingerprint,
        voice,
    };
    let order = light::order(sites.receivers());
    if let Some(shard) = args.shard {
        let pieces = shard.pieces(work.fingerprint.pieces());
        let lit = work.compute(sites.receivers(), &order, &pieces, &mut report)?;
        let channels = if args.quantity.is_occlusion() { 1 } else { 3 };
        parts::save(
            &args.output[0],
            shard,
            &work.fingerprint,
            &lit.values,
            channels,
        )?;
        return work.tell(&report, &settings);
    }
    let ordered = if args.merge.is_empty() {
        let pieces: Vec<usize> = (0..work.fingerprint.pieces()).collect();
        work.compute(sites.receivers(), &order, &pieces, &mut report)?
            .values
    } else {
        parts::merge(&args.merge, &work.fingerprint)?
    };
    let mut values = vec![Vec3::ZERO; ordered.len()];
    for (&place, value) in order.iter().zip(ordered) {
        values[place as usize] = value;
    }
    report.receivers(&scene, work.exact()?, sites.receivers(), &values);
    let (written, seconds) = timed(|| -> Result<()> {
        match &sites {
            Sites::Vertices(all) => {
                report.vertices(&scene, all, &values);
                vertices::write(&mut document, &source, all, &values, &args.attribute())?;
                write(args, document, None)
            }
            Sites::Texels {
                layout,
                texels,
                receivers,
            } => {
                let map = Lightmap::new(args.size, receivers, &values, args.padding);
                report.texels(&scene, (layout, texels), (receivers, &values), &map);
                let is_occlusion = args.quantity.is_occlusion();
                textures::write(&mut document, &source, layout, &map, is_occlusion)?;
                write(
                    args,
                    document,
                    Some(image(map, receivers, &report, &settings)),
                )
            }
        }
    });
    written?;
    report.seconds.write = seconds;
    work.tell(&report, &settings)
}

/// Hours of work must not end at a file that cannot be written, or at two settings that do not go together.
fn check(args: &BakeArgs) -> Result<()> {
    Techniques::check(args.technique, args.quantity)?;
    ensure!(
        args.d_max.is_finite() || args.quantity != Quantity::Obscurance,
        "obscurance needs a finite --d-max, since it grows with the distance over that"
    );
    ensure!(
        args.quantity.is_occlusion() || args.attribute.as_deref() != Some(COLOR),
        "irradiance is no factor of colours: give --attribute _NAME"
    );
    ensure!(
        args.existing != Existing::Multiply
            || args.to == Target::Vertices && args.attribute().name == COLOR,
        "--existing multiply is for colours of vertices: anything else is refused or replaced"
    );
    let scene = Path::new(&args.scene);
    ensure!(
        has_suffix(scene, &["glb", "gltf"]),
        "{}: only .glb and .gltf files can be baked",
        args.scene
    );
    if args.shard.is_some() {
        ensure!(
            args.output.len() == 1,
            "--shard writes one part: give one --output"
        );
    } else {
        for path in &args.output {
            ensure!(
                has_suffix(path, &["glb"])
                    || args.to == Target::Texels && has_suffix(path, &["exr"]),
                "{}: a baked scene is written as .glb, and a lightmap also as .exr",
                path.display()
            );
        }
    }
    let scenes = args.output.iter().filter(|path| has_suffix(path, &["glb"]));
    ensure!(
        scenes.count() <= 1,
        "--output: one .glb is written: leave the others out"
    );
    args.output
        .iter()
        .try_for_each(|path| Ok(check_writable(path)?))
}

/// What light is computed for. Refused before hours of work where the file cannot hold it.
fn sites(
    args: &BakeArgs,
    document: &Document,
    source: &GltfSource,
    scene: &Scene,
) -> Result<Sites> {
    match args.to {
        Target::Vertices => {
            vertices::check(document, source, &args.attribute())?;
            let vertices = Vertices::of(scene, source.instances.len());
            Ok(Sites::Vertices(vertices))
        }
        Target::Texels => {
            textures::check(
                document,
                source,
                args.quantity.is_occlusion(),
                args.existing,
            )?;
            let layout = Layout::new(document, source, scene, args.size, args.padding)?;
            let texels = Texels::draw(&layout);
            let receivers = texels.receivers(scene, &layout);
            Ok(Sites::Texels {
                layout,
                texels,
                receivers,
            })
        }
    }
}

fn write(args: &BakeArgs, document: Document, lightmap: Option<Image>) -> Result<()> {
    let mut document = Some(document);
    for path in &args.output {
        if let Some(image) = lightmap.as_ref().filter(|_| has_suffix(path, &["exr"])) {
            image.save(path)?;
        } else if let Some(document) = document.take() {
            document.save(path)?;
        }
    }
    Ok(())
}

/// A lightmap as a picture, with which texels are computed and the settings it was made with.
fn image(
    map: Lightmap,
    receivers: &[Receiver],
    report: &Report,
    settings: &BTreeMap<String, String>,
) -> Image {
    let mut image = Image::new(map.size, map.size);
    image.attributes.clone_from(settings);
    if let Some(noise) = report.noise {
        image.attributes.insert("noise".into(), noise.to_string());
    }
    image.push_layer("", "RGB", &map.texels);
    let mut coverage = vec![0.0; map.texels.len()];
    for receiver in receivers {
        coverage[receiver.index as usize] = 1.0;
    }
    image.push(COVERAGE, coverage);
    image
}

/// A quantity that can be baked.
fn quantity(name: &str) -> Result<Quantity, String> {
    use Quantity::{Ao, IrradianceDirect, IrradianceIndirect, IrradiancePath, Obscurance};
    if name == "irradiance" {
        return Ok(IrradiancePath);
    }
    [Ao, Obscurance, IrradianceDirect, IrradianceIndirect, IrradiancePath]
        .into_iter()
        .find(|quantity| quantity.name() == name)
        .ok_or_else(|| {
            "expected ao, obscurance, irradiance (or irradiance.path), irradiance.direct or irradiance.indirect: what \
             leaves a surface depends on where it is seen from"
                .into()
        })
}
