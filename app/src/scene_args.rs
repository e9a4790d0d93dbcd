//! The scene on the command line: where it comes from and what is changed in it.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use anyhow::{Result, bail, ensure};
use clap::Args;
use glam::Vec3;
use isophote_scene::{
    Aabb, Camera, Environment, EnvironmentMap, GltfSource, Image, InstanceMask, LightKind,
    LoadOptions, Material, Mesh, Scene, builtin, load_gltf, load_with,
};

use crate::{
    output::{Voice, timed},
    tracers::AnyTracer,
    values::{self, Addition, Bounds, EnvironmentChoice, MaterialOverride, Shift},
};

/// What is changed in a scene before anything is done with it; few files have all that a method needs.
#[derive(Args, Debug)]
#[command(next_help_heading = "Changes to the scene")]
pub(crate) struct SceneArgs {
    /// Give a material, or all of an object, these values, 0..1, instead of their own and their textures'; may be
    /// repeated
    #[arg(long, value_name = "NAME=METALLIC,ROUGHNESS[,R,G,B]", value_parser = values::material)]
    material: Vec<MaterialOverride>,
    /// Make every point light a sphere of this radius, which softens its shadows [metres]
    #[arg(long, value_name = "METRES", value_parser = values::not_negative)]
    light_radius: Option<f32>,
    /// Light from outside: a radiance [W/(sr·m²)] from everywhere, or a panorama (.exr or .hdr, its middle towards −Z)
    #[arg(long, value_name = "FILE|R,G,B", value_parser = values::environment, allow_hyphen_values = true)]
    environment: Option<EnvironmentChoice>,
    /// Put the objects of another scene, or the one of that name, at a place, without its lights and cameras [metres,
    /// degrees about +Y]; may be repeated. ':moving' marks them as not static
    #[arg(long, value_name = "FILE[#OBJECT]@X,Y,Z[,SCALE[,YAW]][:moving]", value_parser = values::addition)]
    add: Vec<Addition>,
    /// The part of the scene that tracers hold: all of it, or what touches a box [metres]
    #[arg(long, value_name = "all|X0,Y0,Z0,X1,Y1,Z1", default_value = "all", value_parser = values::bounds, allow_hyphen_values = true)]
    bounds: Bounds,
    /// Show animated things where they are at this time [seconds]
    #[arg(long, value_name = "SECONDS", value_parser = values::finite, allow_hyphen_values = true)]
    time: Option<f32>,
    /// Move a light or an object, by its name or as light#N or object#N (counted from 0), by so much [metres], and turn it
    /// about its own X axis (PITCH) and then about +Y (YAW) where it is [degrees]; may be repeated
    #[arg(long = "move", value_name = "NAME=X,Y,Z[,YAW[,PITCH]]", value_parser = values::shift)]
    moves: Vec<Shift>,
    /// The scene to take from a glTF file that holds several, by name or number from 0; its default scene otherwise
    #[arg(long, value_name = "NAME|NUMBER")]
    gltf_scene: Option<String>,
    /// Refuse a scene file that takes more memory than this [MiB]
    #[arg(long, value_name = "MIB", default_value_t = 1024, value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    memory_limit: u64,
}

impl SceneArgs {
    /// Loads the scene, changes it, and says what the loader had to say.
    pub(crate) fn load(&self, scene: &str, voice: Voice) -> Result<Scene> {
        let mut scene = self.load_unmoved(scene, voice)?;
        self.place(&mut scene)?;
        Ok(scene)
    }

    /// As [`load`](Self::load), of a glTF file, with what else was in it. What is added to the scene comes last.
    pub(crate) fn load_gltf(&self, scene: &str, voice: Voice) -> Result<(Scene, GltfSource)> {
        let (scene, source) = load_gltf(Path::new(scene), &self.options())?;
        let mut scene = self.changed(scene, voice)?;
        self.place(&mut scene)?;
        Ok((scene, source))
    }

    /// As [`load`](Self::load), with nothing moved yet: [`place`](Self::place) does that.
    pub(crate) fn load_unmoved(&self, scene: &str, voice: Voice) -> Result<Scene> {
        let (loaded, seconds) = timed(|| self.load_one(scene));
        let loaded = loaded?;
        tracing::debug!(
            scene,
            triangles = loaded.triangle_count(),
            bytes = loaded.bytes(),
            seconds,
            "scene loaded"
        );
        self.changed(loaded, voice)
    }

    /// Puts what moves where it is asked to be.
    pub(crate) fn place(&self, scene: &mut Scene) -> Result<()> {
        if let Some(seconds) = self.time {
            scene.set_time(seconds);
        }
        self.moves
            .iter()
            .try_for_each(|change| shift(scene, change))
    }

    fn changed(&self, mut scene: Scene, voice: Voice) -> Result<Scene> {
        for addition in &self.add {
            self.add(&mut scene, addition)?;
        }
        for change in &self.material {
            change_material(&mut scene, change)?;
        }
        if let Some(radius) = self.light_radius {
            set_light_radius(&mut scene, radius, voice);
        }
        if let Some(choice) = &self.environment {
            scene.environment = environment(choice)?;
        }
        for warning in &scene.report.warnings {
            voice.warning(warning);
        }
        let dropped = &scene.report.dropped;
        if dropped.total() > 0 {
            voice.warning(format_args!(
                "{} triangles were dropped: {} without area, {} with NaN or infinite corners, {} with corners that do not exist",
                dropped.total(), dropped.zero_area, dropped.non_finite, dropped.out_of_range
            ));
        }
        Ok(scene)
    }

    /// The box given with `--bounds`.
    pub(crate) fn bounds(&self) -> Option<Aabb> {
        match self.bounds {
            Bounds::All => None,
            Bounds::Box(bounds) => Some(bounds),
        }
    }

    fn load_one(&self, scene: &str) -> Result<Scene> {
        if builtin::is_builtin(scene) {
            return Ok(builtin::build(scene)?);
        }
        Ok(load_with(Path::new(scene), &self.options())?)
    }

    fn options(&self) -> LoadOptions {
        LoadOptions {
            scene: self.gltf_scene.clone(),
            memory_limit: self.memory_limit << 20,
        }
    }

    fn add(&self, scene: &mut Scene, addition: &Addition) -> Result<()> {
        let mut other = self.load_one(&addition.scene)?;
        if let Some(object) = &addition.object {
            keep_object(&mut other, &addition.scene, object)?;
        }
        ensure!(
            !other.instances.is_empty(),
            "{}: has no geometry to add",
            addition.scene
        );
        let added = scene.add(&other, addition.transform);
        if addition.moving {
            for instance in &mut scene.instances[added] {
                instance.mask = instance.mask.without(InstanceMask::STATIC);
            }
        }
        Ok(())
    }
}

/// The scene must have something to trace.
pub(crate) fn require_geometry(scene: &Scene, name: &str) -> Result<()> {
    ensure!(
        scene.triangle_count() > 0,
        "{name}: has no geometry: nothing to trace"
    );
    Ok(())
}

/// Says what the maps of the tracer `ldi` do not hold.
pub(crate) fn note_moving(scene: &Scene, tracer: Option<AnyTracer>, voice: Voice) {
    let instances = scene.instances.iter();
    let moving = instances.filter(|one| !one.mask.contains(InstanceMask::STATIC));
    let count = moving.count();
    if count > 0 && tracer == Some(AnyTracer::Ldi) {
        voice.note(format_args!(
            "{count} moving objects are left out of the maps: they receive light and reflect none"
        ));
    }
}

/// The camera of that name or at that viewpoint, the first one, or one that sees everything.
pub(crate) fn choose_camera(scene: &Scene, name: Option<&str>, voice: Voice) -> Result<Camera> {
    let framed = || Camera::framing(&scene.bounds());
    match name {
        Some(name)
            if scene.camera(name).is_none()
                && let Some(camera) = values::viewpoint(name) =>
        {
            Ok(camera)
        }
        Some(name) => match scene.camera(name) {
            Some(camera) => Ok(camera.clone()),
            None if name == framed().name => Ok(framed()),
            None => bail!(
                "no camera is called '{name}'; there are: {}",
                list(scene.cameras.iter().map(|camera| &camera.name[..]), "auto")
            ),
        },
        None => Ok(scene.cameras.first().cloned().unwrap_or_else(|| {
            voice.note("the scene has no camera: it is framed automatically");
            framed()
        })),
    }
}

/// Lights a scene without light from everywhere.
pub(crate) fn require_light(scene: &mut Scene, voice: Voice) {
    if !scene.has_light() {
        scene.environment = Environment::Constant(Vec3::ONE);
        voice.note("the scene has no light: a plain white environment is used");
    }
}

/// Leaves out all objects but those of a name.
fn keep_object(scene: &mut Scene, file: &str, name: &str) -> Result<()> {
    let names = scene.instances.iter().map(|instance| &instance.name[..]);
    ensure!(
        names.clone().any(|other| other == name),
        "{file}: no object is called '{name}'; there are: {}",
        list(names, "")
    );
    scene.instances.retain(|instance| instance.name == name);
    Ok(())
}

fn change_material(scene: &mut Scene, change: &MaterialOverride) -> Result<()> {
    let named = |material: &Material| material.name == change.name;
    if scene.materials.iter().any(named) {
        let materials = scene.materials.iter_mut();
        materials
            .filter(|material| named(material))
            .for_each(|material| change.apply(material));
        return Ok(());
    }
    let objects: Vec<usize> = (0..scene.instances.len())
        .filter(|&index| scene.instances[index].name == change.name)
        .collect();
    let materials = scene.materials.iter().map(|material| &material.name[..]);
    let instances = scene.instances.iter().map(|instance| &instance.name[..]);
    ensure!(
        !objects.is_empty(),
        "no material and no object is called '{}'; there are: {}",
        change.name,
        list(materials.chain(instances), "")
    );
    for object in objects {
        change_object(scene, object, change);
    }
    Ok(())
}

/// Moves what a name stands for: lights and objects.
fn shift(scene: &mut Scene, shift: &Shift) -> Result<()> {
    let wanted = |kind: &str, index: usize, name: &str| {
        name == shift.name || shift.name.strip_prefix(kind) == Some(&format!("#{index}")[..])
    };
    let mut found = false;
    for (index, light) in scene.lights.iter_mut().enumerate() {
        if wanted("light", index, &light.name) {
            (found, light.transform) = (true, shift.of(light.transform));
        }
    }
    for (index, object) in scene.instances.iter_mut().enumerate() {
        if wanted("object", index, &object.name) {
            (found, object.transform) = (true, shift.of(object.transform));
        }
    }
    let lights = scene.lights.iter().map(|light| &light.name[..]);
    let objects = scene.instances.iter().map(|object| &object.name[..]);
    ensure!(
        found,
        "--move: no light and no object is called '{}'; there are: {}",
        shift.name,
        list(lights.chain(objects), "light#N and object#N")
    );
    Ok(())
}

/// Gives an object a mesh and materials of its own, with these values.
fn change_object(scene: &mut Scene, object: usize, change: &MaterialOverride) {
    let instance = &scene.instances[object];
    let mut mesh = Mesh::clone(scene.mesh(instance));
    let first = scene.materials.len() as u32;
    let mut used: Vec<u32> = mesh.triangle_materials.clone();
    used.sort_unstable();
    used.dedup();
    for material in &mut mesh.triangle_materials {
        *material = first + used.partition_point(|other| other < material) as u32;
    }
    for material in used {
        let mut own = scene.materials[material as usize].clone();
        change.apply(&mut own);
        scene.materials.push(own);
    }
    scene.instances[object].mesh = scene.meshes.len() as u32;
    scene.meshes.push(Arc::new(mesh));
}

impl MaterialOverride {
    fn apply(&self, material: &mut Material) {
        (material.metallic, material.roughness) = (self.metallic, self.roughness);
        material.metallic_roughness_texture = None;
        if let Some(color) = self.base_color {
            material.base_color = color.extend(material.base_color.w);
            material.base_color_texture = None;
        }
    }
}

fn set_light_radius(scene: &mut Scene, metres: f32, voice: Voice) {
    let mut found = false;
    for light in &mut scene.lights {
        if let LightKind::Point { radius } = &mut light.kind {
            *radius = metres;
            found = true;
        }
    }
    if !found {
        voice.warning("--light-radius changes nothing: the scene has no point light");
    }
}

fn environment(choice: &EnvironmentChoice) -> Result<Environment> {
    match choice {
        EnvironmentChoice::Constant(radiance) => Ok(Environment::Constant(*radiance)),
        EnvironmentChoice::File(path) => panorama(path),
    }
}

fn panorama(path: &PathBuf) -> Result<Environment> {
    let image = Image::load(path)?;
    let Some(texels) = image.rgb("") else {
        bail!("{}: a panorama needs channels R, G and B", path.display());
    };
    let map = EnvironmentMap::new(image.width, image.height, texels)
        .map_err(|error| anyhow::anyhow!("{}: {error}", path.display()))?;
    Ok(Environment::Map(map))
}

/// Names for an error message: each once, cut where there are very many, with a last one that always exists.
fn list<'a>(names: impl Iterator<Item = &'a str>, last: &'a str) -> String {
    const MOST: usize = 40;
    let mut names: Vec<&str> = names.collect();
    names.sort_unstable();
    names.dedup();
    let more = names.len().saturating_sub(MOST);
    names.truncate(MOST);
    if !last.is_empty() {
        names.push(last);
    }
    let mut text = names.join(", ");
    if more > 0 {
        text += &format!(" and {more} more");
    }
    text
}
