//! Wavefront OBJ with its MTL materials (B1 and MTL specifications of Alias|Wavefront, and what became custom since).
//!
//! The way of a file: [`text`] decodes it and joins continued lines, [`geometry`] reads the statements, [`mesh`]
//! makes one mesh per object or group of them and has [`polygon`] cut faces into triangles, [`mtl`] reads materials
//! and [`material`] translates those that are used.
//!
//! No crate reads the text: `tobj` refuses a whole file for one bad face, number or colour, and some lines make it
//! panic. Here a face that refers to no vertex is dropped and counted, and a number that is none becomes NaN, which
//! drops what uses it.
//!
//! Read are: polygons with negative and forward references, texture coordinates, normals, vertex colours (as sRGB),
//! `o` and `g`, `usemtl`, several `mtllib`. Faces without normals are flat. Ignored, with a warning: points, lines,
//! curves and surfaces. Smoothing groups are ignored silently.

mod geometry;
mod material;
mod mesh;
mod mtl;
mod polygon;
mod text;

use std::path::Path;

use self::{geometry::Geometry, material::Materials, mtl::Library};
use super::{LoadOptions, budget::Budget, context::Context};
use crate::{Result, Scene};

/// Loads an OBJ file and the material libraries that it names.
pub(super) fn load(path: &Path, options: &LoadOptions) -> Result<Scene> {
    let budget = Budget::new(path, options.memory_limit);
    let context = Context::new(path, &budget);
    let geometry = {
        let (bytes, _held) = context.read(path)?;
        let (text, _held) = text::decode(&bytes, &budget)?;
        Geometry::parse(&context, &text)?
    };
    let library = Library::load(&context, &geometry.libraries)?;
    let mut materials = Materials::new(&context, &library);
    let mut scene = Scene::default();
    let dropped = mesh::build(&context, &geometry, &mut materials, &mut scene)?;
    (scene.materials, scene.textures) = materials.finish();
    Ok(context.finish(scene, dropped))
}
