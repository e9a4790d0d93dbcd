//! The tracer `field` as the command line asks for it: a displacement field for each mesh, built, or loaded from files, and
//! exact rays for what is not worth one.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};
#[cfg(feature = "gpu")]
use isophote_displacement_field::gpu::FieldGpuTracer;
use isophote_displacement_field::{
    Directions, Field, FieldParams, FieldTracer, LookUp, Object, ObjectParams, Positions, Storage,
    Together, meshes, split,
};
use isophote_scene::{BuildTracer, BvhTracer, Scene, check_writable};

use crate::{
    applies::Idle,
    tracers::{BuiltTracer, Plan},
};

/// How the fields of the tracer `field` are made.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "The tracer field")]
pub(crate) struct FieldArgs {
    /// Rings of positions between pole and equator: 2 (2N² + 2N + 1) positions, 4226 for 32
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=256))]
    field_rings: u32,
    /// Directions on each side of a position's map
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=1024))]
    field_resolution: u32,
    /// How directions lie in a map
    #[arg(long, value_enum, value_name = "MAPPING", default_value = "concentric")]
    field_directions: Mapping,
    /// Bits kept of each ray
    #[arg(long, value_enum, value_name = "BITS", default_value = "8")]
    field_bits: Bits,
    /// Which samples answer a ray
    #[arg(long, value_enum, value_name = "WHICH", default_value = "interpolated")]
    field_look_up: Samples,
    /// Into how many parts, with spheres of their own, each mesh is divided
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64))]
    field_parts: u32,
    /// Meshes of fewer triangles have no field: an exact tracer answers for them
    #[arg(long, value_name = "N", default_value_t = 64)]
    field_least_triangles: usize,
    /// Refuse a field that takes more memory than this [MiB]
    #[arg(long, value_name = "MIB", default_value_t = 1024, value_parser = clap::value_parser!(u64).range(1..=1 << 20))]
    field_memory_limit: u64,
    /// Instances further from the camera than so many radii of their own are answered by one bit a direction
    #[arg(long, value_name = "RADII")]
    field_distant: Option<f32>,
    /// Write the fields into files in this folder
    #[arg(long, value_name = "FOLDER", conflicts_with = "field_load")]
    field_save: Option<PathBuf>,
    /// Take the fields from such a folder, instead of building them
    #[arg(long, value_name = "FOLDER")]
    field_load: Option<PathBuf>,
    /// Take fields of other levels of detail of the meshes too: of any that have about the same bounding spheres
    #[arg(long, requires = "field_load")]
    field_lod: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Mapping {
    /// Equal steps of both angles
    Polar,
    /// A disk within the square
    Rejection,
    /// The square bent into a disk
    Concentric,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Bits {
    /// Only whether anything is hit
    #[value(name = "1")]
    One,
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
    #[value(name = "32")]
    ThirtyTwo,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Samples {
    /// The nearest one, as in the paper
    Nearest,
    /// That which meets the ray in the middle of the sphere
    Aimed,
    /// Twelve around the ray
    Interpolated,
}

impl FieldArgs {
    /// Whether what is far from the camera is answered with less.
    pub(crate) fn depends_on_camera(&self) -> bool {
        self.field_distant.is_some()
    }

    fn params(&self) -> ObjectParams {
        ObjectParams {
            field: FieldParams {
                positions: Positions::Slater {
                    rings: self.field_rings,
                },
                directions: match self.field_directions {
                    Mapping::Polar => Directions::Polar,
                    Mapping::Rejection => Directions::Rejection,
                    Mapping::Concentric => Directions::Concentric,
                },
                resolution: self.field_resolution,
                storage: match self.field_bits {
                    Bits::One => Storage::Bit,
                    Bits::Eight => Storage::Byte,
                    Bits::Sixteen => Storage::Word,
                    Bits::ThirtyTwo => Storage::Float,
                },
                max_bytes: self.field_memory_limit << 20,
            },
            parts: self.field_parts,
            distant: self.field_distant.is_some(),
        }
    }

    /// Those of its flags that have no effect beside the others.
    pub(crate) fn idle(&self) -> Vec<Idle> {
        let ids = [
            "field_rings",
            "field_resolution",
            "field_directions",
            "field_bits",
        ];
        let loaded = ids.into_iter().filter(|_| self.field_load.is_some());
        Idle::all(loaded, "the files of --field-load say it").collect()
    }

    /// Minutes of work must not end at a file that cannot be written.
    pub(crate) fn check(&self) -> Result<()> {
        ensure!(
            self.field_distant.is_none_or(|radii| radii >= 0.0),
            "--field-distant: how far away is to be a number of radii from 0 on"
        );
        if let Some(folder) = &self.field_save {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("cannot make the folder {}", folder.display()))?;
            check_writable(&file(folder, 0, 0))?;
        }
        Ok(())
    }

    /// The tracer of what has many triangles, and the scene of which only the rest casts, if there is any.
    fn fields(&self, plan: &Plan<'_>) -> Result<(FieldTracer, Option<Arc<Scene>>)> {
        let selection = plan.selection;
        let [many, few] = [true, false].map(|many| self.part(plan, many));
        ensure!(
            !meshes(&many, selection).is_empty(),
            "no mesh has {} triangles or more, so there is nothing to make fields of: see --field-least-triangles",
            self.field_least_triangles
        );
        let objects = match &self.field_load {
            Some(folder) => {
                let objects = self.load(&many, plan, folder)?;
                match self.field_distant {
                    Some(_) => objects.into_iter().map(Object::with_distant).collect(),
                    None => objects,
                }
            }
            None => {
                let exact = |scene: &Arc<Scene>| {
                    BvhTracer::build(scene, &Default::default(), &plan.args.bvh_options())
                };
                Object::build_all(&many, selection, &self.params(), &exact, &|_, _| {})?
            }
        };
        if let Some(folder) = &self.field_save {
            save(&objects, folder)?;
        }
        let look_up = match self.field_look_up {
            Samples::Nearest => LookUp::Nearest,
            Samples::Aimed => LookUp::Aimed,
            Samples::Interpolated => LookUp::Interpolated,
        };
        let mut fields = FieldTracer::new(&many, selection, objects, look_up)?;
        if let Some(radii) = self.field_distant {
            fields.look_from(Some((plan.camera.position(), radii)));
            fields.update(&many.transforms())?;
        }
        let has_few = !meshes(&few, selection).is_empty();
        Ok((fields, has_few.then_some(few)))
    }

    /// The tracer: fields for what has many triangles, exact rays for the rest.
    pub(crate) fn build(&self, plan: &Plan<'_>) -> Result<BuiltTracer> {
        let (fields, few) = self.fields(plan)?;
        let bytes = fields.bytes();
        let Some(few) = few else {
            return Ok(BuiltTracer {
                bytes,
                tracer: Box::new(fields),
                maps: None,
            });
        };
        let exact = BvhTracer::build(&few, plan.selection, &plan.args.bvh_options())?;
        Ok(BuiltTracer {
            bytes: bytes + exact.bytes(),
            tracer: Box::new(Together(fields, exact)),
            maps: None,
        })
    }

    /// The same on a GPU.
    #[cfg(feature = "gpu")]
    pub(crate) fn build_gpu(
        &self,
        context: &isophote_scene::gpu::Context,
        plan: &Plan<'_>,
    ) -> Result<FieldGpuTracer> {
        let (fields, few) = self.fields(plan)?;
        let others = few.map(|few| (few, *plan.selection));
        Ok(FieldGpuTracer::new(context, fields, others)?)
    }

    /// The scene, of which only instances of many or of few triangles are selected.
    fn part(&self, plan: &Plan<'_>, many: bool) -> Arc<Scene> {
        let mut part = Scene::clone(plan.scene);
        for instance in &mut part.instances {
            let triangles = plan.scene.mesh(instance).triangles.len();
            if (triangles >= self.field_least_triangles) != many {
                instance.mask = instance.mask.without(plan.selection.mask);
            }
        }
        Arc::new(part)
    }

    fn load(&self, scene: &Scene, plan: &Plan<'_>, folder: &Path) -> Result<Vec<Object>> {
        let mut objects = vec![Object::default(); scene.meshes.len()];
        for mesh in meshes(scene, plan.selection) {
            let parts = split(&scene.meshes[mesh], self.field_parts)?;
            for (index, part) in parts.iter().enumerate() {
                let path = file(folder, mesh, index);
                let field = Field::load(&path, self.field_memory_limit << 20)?;
                ensure!(
                    field.is_of(part) || self.field_lod && field.fits(part),
                    "{}: the field is of another mesh than '{}', or of other --field-parts; build the field anew, or take \
                     that of another level of detail with --field-lod",
                    path.display(),
                    part.name
                );
                objects[mesh].parts.push(Arc::new(field));
            }
        }
        Ok(objects)
    }
}

fn save(objects: &[Object], folder: &Path) -> Result<()> {
    for (mesh, object) in objects.iter().enumerate() {
        for (index, field) in object.parts.iter().enumerate() {
            field.save(&file(folder, mesh, index))?;
        }
    }
    Ok(())
}

/// The file of a mesh's part.
fn file(folder: &Path, mesh: usize, part: usize) -> PathBuf {
    folder.join(format!("{mesh}-{part}.field"))
}
