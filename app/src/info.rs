//! `isophote info`: what a scene holds.

use anyhow::Result;
use clap::{ArgMatches, Args};
use glam::Vec3;
use isophote_scene::{Aabb, Environment, Light, LightKind, Material, Projection, Scene};
use serde::Serialize;

use crate::{
    applies::{Idle, refuse},
    output::{Voice, memory_peak_bytes, print, print_json, timed},
    scene_args::SceneArgs,
};

/// Show what a scene holds, and what the loader dropped or did not understand.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  isophote info builtin:atrium
  isophote info hall.glb --json")]
pub(crate) struct InfoArgs {
    /// A .glb, .gltf or .obj file, or builtin:NAME as `isophote --help` lists them
    scene: String,
    /// Print it as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    changes: SceneArgs,
}

#[derive(Serialize)]
struct Report<'a> {
    scene: &'a str,
    triangles: usize,
    instances: usize,
    moving_instances: usize,
    meshes: usize,
    mesh_triangles: usize,
    /// Metres; none without geometry.
    bounds: Option<Bounds>,
    materials: Vec<MaterialReport<'a>>,
    textures: Vec<TextureReport<'a>>,
    lights: Vec<LightReport<'a>>,
    cameras: Vec<CameraReport<'a>>,
    environment: EnvironmentReport,
    animation: AnimationReport,
    dropped: Dropped,
    warnings: &'a [String],
    /// Held by meshes and textures.
    bytes: usize,
    load_seconds: f64,
    memory_peak_bytes: Option<u64>,
}

#[derive(Serialize)]
struct Bounds {
    min: [f32; 3],
    max: [f32; 3],
    size: [f32; 3],
}

#[derive(Serialize)]
struct MaterialReport<'a> {
    name: &'a str,
    base_color: [f32; 4],
    metallic: f32,
    roughness: f32,
    emissive: [f32; 3],
    transmission: f32,
    masked: bool,
    unlit: bool,
    textures: usize,
}

#[derive(Serialize)]
struct TextureReport<'a> {
    name: &'a str,
    width: u32,
    height: u32,
}

#[derive(Serialize)]
struct LightReport<'a> {
    name: &'a str,
    kind: &'static str,
    /// W/sr, or W/m² of a directional light.
    intensity: [f32; 3],
    position: [f32; 3],
    direction: [f32; 3],
    radius: Option<f32>,
}

#[derive(Serialize)]
struct CameraReport<'a> {
    name: &'a str,
    position: [f32; 3],
    /// Vertical opening angle in degrees; none of a parallel camera.
    yfov: Option<f32>,
    /// Half the height seen in metres; none of a perspective camera.
    half_height: Option<f32>,
}

#[derive(Serialize)]
#[serde(rename_all = "lowercase", tag = "kind")]
enum EnvironmentReport {
    Black,
    Constant { radiance: [f32; 3] },
    Map,
}

#[derive(Serialize)]
struct AnimationReport {
    nodes: usize,
    channels: usize,
    /// Seconds.
    duration: f32,
}

#[derive(Serialize)]
struct Dropped {
    out_of_range: u64,
    non_finite: u64,
    zero_area: u64,
}

pub(crate) fn info(args: &InfoArgs, given: &ArgMatches) -> Result<()> {
    let why = "it is for tracers, and none is built";
    refuse(&Idle::all(["bounds"], why).collect::<Vec<_>>(), given)?;
    // What the loader had to say is part of the report.
    let (scene, load_seconds) = timed(|| args.changes.load(&args.scene, Voice::new(true)));
    let scene = scene?;
    let mut report = Report::of(&args.scene, &scene);
    report.load_seconds = load_seconds;
    report.memory_peak_bytes = memory_peak_bytes();
    if args.json {
        print_json(&report)
    } else {
        print(&report.text())
    }
}

impl<'a> Report<'a> {
    fn of(name: &'a str, scene: &'a Scene) -> Self {
        let dropped = &scene.report.dropped;
        Self {
            scene: name,
            triangles: scene.triangle_count(),
            instances: scene.instances.len(),
            moving_instances: scene
                .instances
                .iter()
                .filter(|instance| !instance.mask.contains(isophote_scene::InstanceMask::STATIC))
                .count(),
            meshes: scene.meshes.len(),
            mesh_triangles: scene.meshes.iter().map(|mesh| mesh.triangles.len()).sum(),
            bounds: Bounds::of(&scene.bounds()),
            materials: scene.materials.iter().map(MaterialReport::of).collect(),
            textures: scene
                .textures
                .iter()
                .map(|texture| {
                    let (width, height, _) = texture.level(0);
                    TextureReport {
                        name: &texture.name,
                        width,
                        height,
                    }
                })
                .collect(),
            lights: scene.lights.iter().map(LightReport::of).collect(),
            cameras: scene
                .cameras
                .iter()
                .map(|camera| {
                    let (yfov, half_height) = match camera.projection {
                        Projection::Perspective { yfov } => (Some(yfov.to_degrees()), None),
                        Projection::Orthographic { half_height } => (None, Some(half_height)),
                    };
                    CameraReport {
                        name: &camera.name,
                        position: camera.position().to_array(),
                        yfov,
                        half_height,
                    }
                })
                .collect(),
            environment: match &scene.environment {
                Environment::Black => EnvironmentReport::Black,
                Environment::Constant(radiance) => EnvironmentReport::Constant {
                    radiance: radiance.to_array(),
                },
                Environment::Map(_) => EnvironmentReport::Map,
            },
            animation: AnimationReport {
                nodes: scene.animation.nodes.len(),
                channels: scene.animation.channels.len(),
                duration: scene.animation.duration(),
            },
            dropped: Dropped {
                out_of_range: dropped.out_of_range,
                non_finite: dropped.non_finite,
                zero_area: dropped.zero_area,
            },
            warnings: &scene.report.warnings,
            bytes: scene.bytes(),
            load_seconds: 0.0,
            memory_peak_bytes: None,
        }
    }
}

impl Bounds {
    fn of(bounds: &Aabb) -> Option<Self> {
        (!bounds.is_empty()).then(|| Self {
            min: bounds.min.to_array(),
            max: bounds.max.to_array(),
            size: (bounds.max - bounds.min).to_array(),
        })
    }
}

impl<'a> MaterialReport<'a> {
    fn of(material: &'a Material) -> Self {
        let textures = [
            material.base_color_texture,
            material.metallic_roughness_texture,
            material.emissive_texture,
            material.transmission_texture,
        ];
        Self {
            name: &material.name,
            base_color: material.base_color.to_array(),
            metallic: material.metallic,
            roughness: material.roughness,
            emissive: material.emissive.to_array(),
            transmission: material.transmission,
            masked: material.alpha != isophote_scene::Alpha::Opaque,
            unlit: material.unlit,
            textures: textures.iter().flatten().count(),
        }
    }
}

impl<'a> LightReport<'a> {
    fn of(light: &'a Light) -> Self {
        let (kind, radius) = match light.kind {
            LightKind::Point { radius } => ("point", Some(radius)),
            LightKind::Spot { .. } => ("spot", None),
            LightKind::Directional => ("directional", None),
        };
        Self {
            name: &light.name,
            kind,
            intensity: light.intensity.to_array(),
            position: light.position().to_array(),
            direction: light.direction().to_array(),
            radius,
        }
    }
}

impl Report<'_> {
    fn text(&self) -> String {
        let mut lines = vec![
            format!("scene        {}", self.scene),
            format!(
                "geometry     {} triangles in {} instances ({} moving) of {} meshes ({} triangles)",
                self.triangles,
                self.instances,
                self.moving_instances,
                self.meshes,
                self.mesh_triangles
            ),
            match &self.bounds {
                Some(bounds) => format!(
                    "bounds       {} to {}: {} m",
                    vector(bounds.min),
                    vector(bounds.max),
                    vector(bounds.size)
                ),
                None => "bounds       none: there is no geometry to render".into(),
            },
        ];
        self.list_cameras(&mut lines);
        self.list_lights(&mut lines);
        self.list_materials(&mut lines);
        lines.push(format!("textures     {}", self.textures.len()));
        lines.extend(self.textures.iter().map(|texture| {
            format!(
                "  {:<24} {}×{}",
                named(texture.name),
                texture.width,
                texture.height
            )
        }));
        lines.push(format!(
            "animation    {} channels on {} nodes, {} s",
            self.animation.channels, self.animation.nodes, self.animation.duration
        ));
        let dropped = &self.dropped;
        lines.push(format!(
            "dropped      {} triangles without area, {} with NaN or infinite corners, {} with corners that do not exist",
            dropped.zero_area, dropped.non_finite, dropped.out_of_range
        ));
        lines.push(format!(
            "memory       {:.1} MiB of meshes and textures, loaded in {:.3} s",
            self.bytes as f64 / f64::from(1 << 20),
            self.load_seconds
        ));
        lines.push(format!("warnings     {}", self.warnings.len()));
        lines.extend(self.warnings.iter().map(|warning| format!("  {warning}")));
        lines.join("\n") + "\n"
    }

    fn list_cameras(&self, lines: &mut Vec<String>) {
        lines.push(format!(
            "cameras      {}",
            some_or(self.cameras.len(), "none: it is framed automatically")
        ));
        lines.extend(self.cameras.iter().map(|camera| {
            let view = match (camera.yfov, camera.half_height) {
                (Some(yfov), _) => format!("{yfov:.1}° high"),
                (None, half_height) => format!("{} m high", 2.0 * half_height.unwrap_or(0.0)),
            };
            format!(
                "  {:<24} at {}, {view}",
                named(camera.name),
                vector(camera.position)
            )
        }));
    }

    fn list_lights(&self, lines: &mut Vec<String>) {
        let emissive = self
            .materials
            .iter()
            .filter(|material| Vec3::from(material.emissive).max_element() > 0.0)
            .count();
        let environment = match &self.environment {
            EnvironmentReport::Black => "black".into(),
            EnvironmentReport::Constant { radiance } => format!("radiance {}", vector(*radiance)),
            EnvironmentReport::Map => "a panorama".into(),
        };
        lines.push(format!(
            "lights       {}, {emissive} emissive materials, environment {environment}",
            self.lights.len()
        ));
        lines.extend(self.lights.iter().map(|light| {
            let place = if light.kind == "directional" {
                format!("along {}", vector(light.direction))
            } else {
                format!("at {}", vector(light.position))
            };
            format!(
                "  {:<24} {} {place}, intensity {}",
                named(light.name),
                light.kind,
                vector(light.intensity)
            )
        }));
    }

    fn list_materials(&self, lines: &mut Vec<String>) {
        lines.push(format!("materials    {}", self.materials.len()));
        lines.extend(self.materials.iter().map(|material| {
            let [r, g, b, _] = material.base_color;
            let mut line = format!(
                "  {:<24} colour {}, metallic {}, roughness {}",
                named(material.name),
                vector([r, g, b]),
                short(material.metallic),
                short(material.roughness)
            );
            if Vec3::from(material.emissive).max_element() > 0.0 {
                line += &format!(", emits {}", vector(material.emissive));
            }
            if material.transmission > 0.0 {
                line += &format!(", transmission {}", short(material.transmission));
            }
            if material.masked {
                line += ", masked";
            }
            if material.unlit {
                line += ", unlit";
            }
            if material.textures > 0 {
                line += &format!(", {} textures", material.textures);
            }
            line
        }));
    }
}

fn some_or(count: usize, none: &str) -> String {
    if count == 0 {
        none.into()
    } else {
        count.to_string()
    }
}

fn named(name: &str) -> &str {
    if name.is_empty() { "(no name)" } else { name }
}

fn vector(values: [f32; 3]) -> String {
    let [x, y, z] = values.map(short);
    format!("({x}, {y}, {z})")
}

/// Four digits are enough for reading; JSON has all.
fn short(value: f32) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) {
        let digits = (3.0 - value.abs().max(1e-3).log10().floor()).clamp(0.0, 6.0) as usize;
        let text = format!("{value:.digits$}");
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').into()
        } else {
            text
        }
    } else {
        format!("{value:.3e}")
    }
}
