//! Where each triangle of a scene lies in a lightmap: one atlas for all instances.
//!
//! Texture coordinates of set 1 are taken where all meshes have them and no two triangles overlap. Otherwise they are made
//! (Lévy et al. 2002, least squares conformal maps, by the crate `uvunwrap`), which splits vertices where charts meet.

use std::collections::HashMap;

use anyhow::{Context, Result, anyhow, ensure};
use glam::Vec2;
use isophote_scene::{GltfPrimitive, GltfSource, Mesh, Scene};
use rayon::prelude::*;
use serde_json::Value;
use uvunwrap::{Density, MeshInput, Options, OutputMesh, Packing};

use super::{document::Document, texels::Texels};

/// Triangles above which charts are packed fast rather than densely.
const MANY_TRIANGLES: usize = 20_000;

/// The places of all triangles in the atlas.
pub(super) struct Layout {
    /// Texels on each side.
    pub(super) size: u32,
    /// The set of texture coordinates.
    pub(super) set: usize,
    /// For every instance and triangle the corners in texels, (0, 0) at the top left.
    pub(super) corners: Vec<Vec<[Vec2; 3]>>,
    /// For every instance its primitives with new texture coordinates, where these had to be made.
    pub(super) made: Option<Vec<Vec<Unwrapped>>>,
    pub(super) charts: Option<u32>,
}

/// A primitive whose vertices are split where charts meet.
pub(super) struct Unwrapped {
    /// For every vertex its index in the accessors of the file.
    pub(super) sources: Vec<u32>,
    /// For every vertex its place in the atlas, 0 to 1.
    pub(super) uvs: Vec<Vec2>,
    /// Corners of triangles.
    pub(super) indices: Vec<u32>,
}

impl Layout {
    /// Takes the texture coordinates that are there, or makes some with so many empty texels around each chart.
    pub(super) fn new(
        document: &Document,
        source: &GltfSource,
        scene: &Scene,
        size: u32,
        padding: u32,
    ) -> Result<Self> {
        if let Some(layout) = Self::existing(document, source, scene, size) {
            return Ok(layout);
        }
        Self::unwrapped(document, source, scene, size, padding)
    }

    /// Set 1, if every mesh has it and nothing overlaps.
    fn existing(
        document: &Document,
        source: &GltfSource,
        scene: &Scene,
        size: u32,
    ) -> Option<Self> {
        let mut all = primitives(document, source);
        if !all.all(|json| json["attributes"].get("TEXCOORD_1").is_some()) {
            return None;
        }
        let corners = |instance: usize| {
            let mesh = scene.mesh(&scene.instances[instance]);
            let corner = |vertex: u32| mesh.uvs[1].get(vertex as usize).copied();
            let triangle = |triangle: &[u32; 3]| {
                let [a, b, c] = triangle.map(corner);
                Some([a?, b?, c?].map(|uv| uv * size as f32))
            };
            mesh.triangles.iter().map(triangle).collect()
        };
        let corners: Option<Vec<Vec<[Vec2; 3]>>> =
            (0..source.instances.len()).map(corners).collect();
        let layout = Self {
            size,
            set: 1,
            corners: corners?,
            made: None,
            charts: None,
        };
        let range = 0.0..=size as f32;
        let is_inside = |uv: &Vec2| range.contains(&uv.x) && range.contains(&uv.y);
        let mut all = layout.corners.iter().flatten().flatten();
        let fits = all.all(is_inside) && Texels::draw(&layout).overlapping == 0;
        fits.then_some(layout)
    }

    fn unwrapped(
        document: &Document,
        source: &GltfSource,
        scene: &Scene,
        size: u32,
        padding: u32,
    ) -> Result<Self> {
        let instances = 0..source.instances.len();
        let places: Vec<Vec<[f32; 3]>> = instances
            .clone()
            .into_par_iter()
            .map(|instance| {
                let instance = &scene.instances[instance];
                let place = |&at| instance.transform.transform_point3(at).to_array();
                scene.mesh(instance).positions.iter().map(place).collect()
            })
            .collect();
        let mesh = |instance: usize| scene.mesh(&scene.instances[instance]);
        let inputs: Vec<MeshInput<'_>> = instances
            .clone()
            .map(|i| MeshInput::new(&places[i], mesh(i).triangles.as_flattened()))
            .collect();
        let triangles: usize = instances.clone().map(|i| mesh(i).triangles.len()).sum();
        let options = Options {
            density: Density::Auto { page_size: size },
            padding,
            packing: if triangles > MANY_TRIANGLES {
                Packing::Fast
            } else {
                Packing::Shape
            },
            ..Options::default()
        };
        let atlas = uvunwrap::generate(&inputs, &options)
            .map_err(|error| anyhow!("no texture coordinates can be made: {error}"))?;
        ensure!(
            atlas.page_count == 1,
            "the scene does not fit into one lightmap of {size} texels with {padding} texels around each of its {} charts: give \
             a larger --size, or a smaller --padding",
            atlas.chart_count
        );
        // The page is cropped; ours is square.
        let scale = Vec2::new(atlas.width as f32, atlas.height as f32);
        let texels = |output: &OutputMesh| -> Vec<[Vec2; 3]> {
            let corner = |&i: &u32| Vec2::from(output.vertices[i as usize].uv) * scale;
            let (triangles, _) = output.indices.as_chunks::<3>();
            triangles
                .iter()
                .map(|t| [corner(&t[0]), corner(&t[1]), corner(&t[2])])
                .collect()
        };
        let split = |instance: usize| -> Result<Vec<Unwrapped>> {
            let output = &atlas.meshes[instance];
            let loaded = source.instances[instance].mesh as usize;
            let primitives = &source.meshes[loaded].primitives;
            let scale = scale / size as f32;
            split(mesh(instance), output, primitives, scale)
        };
        Ok(Self {
            size,
            set: free_set(document, source),
            corners: atlas.meshes.iter().map(texels).collect(),
            made: Some(instances.map(split).collect::<Result<_>>()?),
            charts: Some(atlas.chart_count),
        })
    }
}

/// The primitives of the file that are baked.
fn primitives<'a>(
    document: &'a Document,
    source: &'a GltfSource,
) -> impl Iterator<Item = &'a Value> {
    let json = &document.json["meshes"];
    source.meshes.iter().flat_map(move |mesh| {
        let primitives = mesh.primitives.iter();
        primitives.map(move |primitive| &json[mesh.mesh]["primitives"][primitive.primitive])
    })
}

/// The first set of texture coordinates after 0 that no primitive has.
fn free_set(document: &Document, source: &GltfSource) -> usize {
    let is_taken = |set: usize| {
        let name = format!("TEXCOORD_{set}");
        primitives(document, source).any(|json| json["attributes"].get(&name).is_some())
    };
    (1..).find(|&set| !is_taken(set)).unwrap_or(1)
}

/// The primitives of a mesh with the vertices that an unwrapped mesh has.
fn split(
    mesh: &Mesh,
    output: &OutputMesh,
    primitives: &[GltfPrimitive],
    scale: Vec2,
) -> Result<Vec<Unwrapped>> {
    let (triangles, _) = output.indices.as_chunks::<3>();
    let mut all = mesh.triangles.iter().zip(triangles).peekable();
    let mut unwrapped = Vec::with_capacity(primitives.len());
    for primitive in primitives {
        let mut made = Unwrapped {
            sources: Vec::new(),
            uvs: Vec::new(),
            indices: Vec::new(),
        };
        let mut index_of: HashMap<(u32, [u32; 2]), u32> = HashMap::new();
        while let Some((_, corners)) = all.next_if(|(old, _)| primitive.vertices.contains(&old[0]))
        {
            for &corner in corners {
                let vertex = &output.vertices[corner as usize];
                let place = vertex.xref.checked_sub(primitive.vertices.start);
                let source = place.and_then(|place| primitive.sources.get(place as usize));
                let source = *source.context("a vertex belongs to no primitive")?;
                let uv = Vec2::from(vertex.uv) * scale;
                let key = (source, uv.to_array().map(f32::to_bits));
                let index = *index_of.entry(key).or_insert_with(|| {
                    made.sources.push(source);
                    made.uvs.push(uv);
                    made.sources.len() as u32 - 1
                });
                made.indices.push(index);
            }
        }
        unwrapped.push(made);
    }
    Ok(unwrapped)
}
