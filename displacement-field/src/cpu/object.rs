//! Stage 2: what stands for the meshes of a scene: their fields, or those of their parts.

use std::sync::Arc;

use glam::Affine3A;
use isophote_scene::{Aabb, Mesh, Scene, Selection, Tracer, reference::Progress};

use super::{build::alone, field::Field, split::split};
use crate::{Error, FieldParams, Result};

/// What stands for a mesh: a field, or several of its parts.
#[derive(Clone, Debug, Default)]
pub struct Object {
    /// The fields of its parts, in the mesh's space.
    pub parts: Vec<Arc<Field>>,
    /// What stands for it where it is [distant](crate::FieldTracer::look_from): the same, but of one bit a direction. May be empty.
    pub distant: Vec<Arc<Field>>,
}

/// How the objects of a scene are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectParams {
    /// Of every field.
    pub field: FieldParams,
    /// Into how many parts of their own spheres each mesh is divided, 1..=64.
    pub parts: u32,
    /// Whether there are fields of one bit too, for what is distant.
    pub distant: bool,
}

impl Default for ObjectParams {
    fn default() -> Self {
        Self {
            field: FieldParams::default(),
            parts: 1,
            distant: false,
        }
    }
}

impl Object {
    /// A field that stands for all of its mesh.
    pub fn new(field: Field) -> Self {
        Self {
            parts: vec![Arc::new(field)],
            distant: Vec::new(),
        }
    }

    /// The same with fields of one bit for where it is distant.
    #[must_use]
    pub fn with_distant(mut self) -> Self {
        let bits = |field: &Arc<Field>| Arc::new(field.with_bits());
        self.distant = self.parts.iter().map(bits).collect();
        self
    }

    /// Builds the fields of a mesh of a scene; `tracer` makes an exact tracer of a scene of that mesh, or a part of it,
    /// alone. `progress` counts positions of each part anew.
    ///
    /// # Errors
    /// As [`Field::build`] and `tracer`, and [`Error::Parameter`].
    pub fn build<T: Tracer>(
        scene: &Scene,
        mesh: &Arc<Mesh>,
        params: &ObjectParams,
        tracer: &dyn Fn(&Arc<Scene>) -> isophote_scene::Result<T>,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let mut object = Self::default();
        if mesh.triangles.is_empty() {
            return Err(Error::Empty {
                mesh: mesh.name.clone(),
            });
        }
        for part in split(mesh, params.parts)? {
            let scene = Arc::new(alone(scene, &part));
            let field = Field::build(&part, &tracer(&scene)?, &params.field, progress)?;
            object.parts.push(Arc::new(field));
        }
        Ok(if params.distant {
            object.with_distant()
        } else {
            object
        })
    }

    /// [`build`](Self::build) of every mesh of a scene that a selection needs; the others get an empty object.
    ///
    /// # Errors
    /// As [`build`](Self::build).
    pub fn build_all<T: Tracer>(
        scene: &Scene,
        selection: &Selection,
        params: &ObjectParams,
        tracer: &dyn Fn(&Arc<Scene>) -> isophote_scene::Result<T>,
        progress: &dyn Progress,
    ) -> Result<Vec<Self>> {
        let mut objects = vec![Self::default(); scene.meshes.len()];
        for mesh in meshes(scene, selection) {
            objects[mesh] = Self::build(scene, &scene.meshes[mesh], params, tracer, progress)?;
        }
        Ok(objects)
    }

    /// Bytes of its fields.
    pub fn bytes(&self) -> usize {
        let fields = self.parts.iter().chain(&self.distant);
        fields.map(|field| field.bytes()).sum()
    }
}

/// Whether an instance of a mesh of these bounds belongs to a selection: bounds take or leave whole instances.
pub(crate) fn is_selected(
    scene: &Scene,
    instance: usize,
    bounds: &Aabb,
    transform: &Affine3A,
    selection: &Selection,
) -> bool {
    let touches = selection.bounds.is_none_or(|limits| {
        let corners = bounds
            .corners()
            .map(|corner| transform.transform_point3(corner));
        limits.overlaps(&Aabb::around(corners))
    });
    scene.instances[instance].mask.contains(selection.mask) && !bounds.is_empty() && touches
}

pub(crate) fn bounds(scene: &Scene) -> Vec<Aabb> {
    scene.meshes.iter().map(|mesh| mesh.bounds()).collect()
}

/// The meshes of a scene that fields are needed of, by index: those of selected instances.
pub fn meshes(scene: &Scene, selection: &Selection) -> Vec<usize> {
    let bounds = bounds(scene);
    let mut meshes: Vec<usize> = scene
        .instances
        .iter()
        .enumerate()
        .filter(|(index, instance)| {
            let bounds = &bounds[instance.mesh as usize];
            is_selected(scene, *index, bounds, &instance.transform, selection)
        })
        .map(|(_, instance)| instance.mesh as usize)
        .collect();
    meshes.sort_unstable();
    meshes.dedup();
    meshes
}
