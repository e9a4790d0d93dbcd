//! Meshes: one of ours for each of the file's, all its primitives together (glTF 2.0 §3.7).

use std::{collections::HashMap, sync::Arc};

use glam::{Vec2, Vec3, Vec4};
use gltf_json::{
    mesh::{Mesh as JsonMesh, Mode, Primitive as JsonPrimitive, Semantic},
    validation::Checked,
};

use super::{
    accessor::{Floats, Integers},
    document::Document,
    materials::Materials,
    source::{GltfMesh, GltfPrimitive},
};
use crate::{
    Aabb, Dropped, Material, Mesh, Result, Texture, clean, load::budget::bytes_of, unit_normal,
};

/// The meshes that the scene uses, converted when first asked for.
pub(super) struct Meshes<'a> {
    document: &'a Document<'a>,
    materials: Materials<'a>,
    index_of: HashMap<usize, Option<u32>>,
    meshes: Vec<Arc<Mesh>>,
    /// Of each mesh: many nodes can ask for the same.
    bounds: Vec<Aabb>,
    sources: Vec<GltfMesh>,
}

impl<'a> Meshes<'a> {
    pub(super) fn new(document: &'a Document<'a>) -> Self {
        Self {
            document,
            materials: Materials::new(document),
            index_of: HashMap::new(),
            meshes: Vec::new(),
            bounds: Vec::new(),
            sources: Vec::new(),
        }
    }

    /// The place in the scene of a mesh of the file, or `None` if no triangle is left of it.
    pub(super) fn get(&mut self, index: usize) -> Result<Option<u32>> {
        if let Some(&place) = self.index_of.get(&index) {
            return Ok(place);
        }
        let json = self
            .document
            .item(&self.document.root.meshes, "mesh", index)?;
        let (mut mesh, source) = self.convert(index, json)?;
        self.document.drop_triangles(clean(&mut mesh));
        let place = (!mesh.triangles.is_empty()).then(|| {
            self.bounds.push(mesh.bounds());
            self.sources.push(source);
            self.meshes.push(Arc::new(mesh));
            self.meshes.len() as u32 - 1
        });
        self.index_of.insert(index, place);
        Ok(place)
    }

    /// The box around one of the scene's meshes, in its own space.
    pub(super) fn bounds(&self, place: u32) -> Aabb {
        self.bounds[place as usize]
    }

    /// The meshes, where each came from, their materials and textures.
    pub(super) fn finish(self) -> Made {
        let (materials, textures) = self.materials.finish();
        (self.meshes, self.sources, materials, textures)
    }

    fn convert(&mut self, index: usize, json: &JsonMesh) -> Result<(Mesh, GltfMesh)> {
        let (mut primitives, mut numbers) = (Vec::new(), Vec::new());
        for (number, primitive) in json.primitives.iter().enumerate() {
            if let Some(triangles) = self.document.primitive(index, primitive)? {
                let material = primitive.material.map(|material| material.value());
                primitives.push((triangles, self.materials.get(material)?));
                numbers.push(number);
            }
        }
        let mesh = Mesh::of(self.document, json, &primitives)?;
        let mut first = 0;
        let source = |(number, (primitive, _)): (usize, (Primitive<'_>, u32))| {
            let end = first + primitive.sources.len() as u32;
            GltfPrimitive {
                primitive: number,
                vertices: std::mem::replace(&mut first, end)..end,
                count: primitive.positions.count,
                sources: primitive.sources,
            }
        };
        let source = GltfMesh {
            mesh: index,
            primitives: numbers.into_iter().zip(primitives).map(source).collect(),
        };
        Ok((mesh, source))
    }
}

/// Meshes, where each came from, their materials and textures.
type Made = (
    Vec<Arc<Mesh>>,
    Vec<GltfMesh>,
    Vec<Material>,
    Vec<Arc<Texture>>,
);

/// Triangles and their vertices, still in the file's buffers.
struct Primitive<'a> {
    /// Corners as indices in `sources`.
    triangles: Vec<[u32; 3]>,
    /// For every vertex its place in the accessors.
    sources: Vec<u32>,
    positions: Floats<'a, 3>,
    /// Without them every triangle is flat and has vertices of its own.
    normals: Option<Floats<'a, 3>>,
    uvs: [Option<Floats<'a, 2>>; 2],
    colors: Option<Colors<'a>>,
}

enum Colors<'a> {
    Rgb(Floats<'a, 3>),
    Rgba(Floats<'a, 4>),
}

impl Colors<'_> {
    fn count(&self) -> usize {
        match self {
            Self::Rgb(colors) => colors.count,
            Self::Rgba(colors) => colors.count,
        }
    }

    fn get(&self, index: usize) -> Vec4 {
        match self {
            Self::Rgb(colors) => Vec3::from(colors.get(index)).extend(1.0),
            Self::Rgba(colors) => colors.get(index).into(),
        }
    }
}

impl Document<'_> {
    /// A primitive's triangles, or `None` if it has none.
    fn primitive(&self, mesh: usize, json: &JsonPrimitive) -> Result<Option<Primitive<'_>>> {
        let mode = match json.mode {
            Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => {
                mode
            }
            Checked::Valid(_) => {
                self.warn("points and lines are ignored");
                return Ok(None);
            }
            Checked::Invalid => {
                return Err(self.malformed(format!("mesh {mesh} has a primitive of unknown mode")));
            }
        };
        if json.targets.is_some() {
            self.warn("morph targets are ignored");
        }
        let attribute = |semantic| {
            json.attributes
                .get(&Checked::Valid(semantic))
                .map(|accessor| accessor.value())
        };
        let Some(positions) = attribute(Semantic::Positions) else {
            self.warn(format!(
                "mesh {mesh} has a primitive without positions; it is ignored"
            ));
            return Ok(None);
        };
        let positions = self.floats::<3>(positions)?;
        let normals = attribute(Semantic::Normals).map(|index| self.floats::<3>(index));
        let normals = normals.transpose()?;
        let uvs = [0, 1].map(|set| {
            let uvs = attribute(Semantic::TexCoords(set)).map(|index| self.floats::<2>(index));
            uvs.transpose()
        });
        let [uv0, uv1] = uvs;
        let colors = attribute(Semantic::Colors(0)).map(|index| self.colors(index));
        let count = positions.count;
        let indices = json.indices.map(|indices| self.integers(indices.value()));
        let mut triangles = self.triangles(mode, indices.transpose()?.as_ref(), count)?;
        if triangles.is_empty() {
            return Ok(None);
        }
        let fits = |what: &str, found: usize| {
            if found < count {
                self.warn(format!(
                    "mesh {mesh} has {found} {what} for {count} positions; they are ignored"
                ));
            }
            found >= count
        };
        let normals = normals.filter(|normals| fits("normals", normals.count));
        let sources = self.sources(&mut triangles, count, normals.is_none())?;
        Ok(Some(Primitive {
            triangles,
            sources,
            positions,
            normals,
            uvs: [uv0?, uv1?].map(|uvs| uvs.filter(|uvs| fits("texture coordinates", uvs.count))),
            colors: colors
                .transpose()?
                .filter(|colors| fits("colours", colors.count())),
        }))
    }

    fn colors(&self, accessor: usize) -> Result<Colors<'_>> {
        Ok(match self.components(accessor)? {
            3 => Colors::Rgb(self.floats(accessor)?),
            _ => Colors::Rgba(self.floats(accessor)?),
        })
    }

    /// The triangles of a primitive with `count` vertices; those that refer to none of them are dropped and counted.
    fn triangles(
        &self,
        mode: Mode,
        indices: Option<&Integers<'_>>,
        count: usize,
    ) -> Result<Vec<[u32; 3]>> {
        let corners = indices.map_or(count, |indices| indices.count);
        let number = match mode {
            Mode::Triangles => corners / 3,
            _ => corners.saturating_sub(2),
        };
        self.budget
            .claim("a mesh's triangles", bytes_of(number, 12))?;
        let corner = |i: usize| indices.map_or(i as u32, |indices| indices.get(i));
        let mut triangles = Vec::with_capacity(number);
        // The order of corners is that of glTF 2.0 §3.7.2.1.
        triangles.extend((0..number).map(|i| {
            match mode {
                Mode::TriangleStrip => [i, i + 1 + i % 2, i + 2 - i % 2],
                Mode::TriangleFan => [i + 1, i + 2, 0],
                _ => [3 * i, 3 * i + 1, 3 * i + 2],
            }
            .map(corner)
        }));
        triangles.retain(|triangle| triangle.iter().all(|&i| (i as usize) < count));
        self.drop_triangles(Dropped {
            out_of_range: (number - triangles.len()) as u64,
            ..Dropped::default()
        });
        Ok(triangles)
    }

    /// Chooses the vertices to keep and makes the triangles refer to them.
    fn sources(&self, triangles: &mut [[u32; 3]], count: usize, flat: bool) -> Result<Vec<u32>> {
        let corners = triangles.as_flattened_mut();
        self.budget
            .claim("a mesh's vertices", bytes_of(corners.len(), 4))?;
        if flat {
            let sources = corners.to_vec();
            corners
                .iter_mut()
                .zip(0..)
                .for_each(|(corner, i)| *corner = i);
            return Ok(sources);
        }
        if count <= corners.len() {
            return Ok((0..count as u32).collect());
        }
        // A few triangles of a large vertex buffer that many primitives share.
        let mut sources = corners.to_vec();
        sources.sort_unstable();
        sources.dedup();
        for corner in corners {
            *corner = sources.partition_point(|source| source < corner) as u32;
        }
        Ok(sources)
    }
}

impl Mesh {
    /// Puts the primitives of a mesh, each with the place of its material, into one.
    fn of(
        document: &Document<'_>,
        json: &JsonMesh,
        primitives: &[(Primitive<'_>, u32)],
    ) -> Result<Self> {
        let has = |what: fn(&Primitive<'_>) -> bool| primitives.iter().any(|(all, _)| what(all));
        let has_uvs = [
            has(|all| all.uvs[0].is_some()),
            has(|all| all.uvs[1].is_some()),
        ];
        let has_colors = has(|all| all.colors.is_some());
        let vertices: usize = primitives.iter().map(|(all, _)| all.sources.len()).sum();
        let triangles: usize = primitives.iter().map(|(all, _)| all.triangles.len()).sum();
        if u32::try_from(vertices).is_err() {
            return Err(document.malformed("a mesh has more than 2³² vertices"));
        }
        let vertex = 24
            + has_uvs
                .map(|has| if has { 8 } else { 0 })
                .iter()
                .sum::<usize>()
            + if has_colors { 16 } else { 0 };
        // A triangle has three indices, a material and a flag while it is cleaned.
        document.budget.claim(
            "a mesh",
            bytes_of(vertices, vertex).saturating_add(bytes_of(triangles, 17)),
        )?;
        let mut mesh = Self {
            name: json.name.clone().unwrap_or_default(),
            positions: Vec::with_capacity(vertices),
            normals: Vec::with_capacity(vertices),
            uvs: has_uvs.map(|has| Vec::with_capacity(if has { vertices } else { 0 })),
            colors: Vec::with_capacity(if has_colors { vertices } else { 0 }),
            triangles: Vec::with_capacity(triangles),
            triangle_materials: Vec::with_capacity(triangles),
        };
        for (primitive, material) in primitives {
            mesh.append(primitive, *material, has_uvs, has_colors);
        }
        Ok(mesh)
    }

    fn append(
        &mut self,
        primitive: &Primitive<'_>,
        material: u32,
        has_uvs: [bool; 2],
        has_colors: bool,
    ) {
        let first = self.positions.len() as u32;
        let sources = || primitive.sources.iter().map(|&source| source as usize);
        self.positions
            .extend(sources().map(|i| Vec3::from(primitive.positions.get(i))));
        match &primitive.normals {
            Some(normals) => self
                .normals
                .extend(sources().map(|i| Vec3::from(normals.get(i)))),
            None => {
                let corners = &self.positions[first as usize..];
                for corners in corners.as_chunks::<3>().0 {
                    let [a, b, c] = *corners;
                    self.normals.extend([unit_normal(a, b, c); 3]);
                }
            }
        }
        let vertices = self.positions.len();
        for ((uvs, from), has) in self.uvs.iter_mut().zip(&primitive.uvs).zip(has_uvs) {
            match from {
                Some(from) => uvs.extend(sources().map(|i| Vec2::from(from.get(i)))),
                None if has => uvs.resize(vertices, Vec2::ZERO),
                None => {}
            }
        }
        match &primitive.colors {
            Some(colors) => self.colors.extend(sources().map(|i| colors.get(i))),
            None if has_colors => self.colors.resize(vertices, Vec4::ONE),
            None => {}
        }
        let triangles = primitive.triangles.iter();
        self.triangles
            .extend(triangles.map(|triangle| triangle.map(|corner| first + corner)));
        self.triangle_materials
            .resize(self.triangles.len(), material);
    }
}
