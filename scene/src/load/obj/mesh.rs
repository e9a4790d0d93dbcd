//! From polygons to meshes: one for every object or group.

use std::sync::Arc;

use glam::{Affine3A, Vec2, Vec3};

use super::{
    geometry::{Corner, Face, Geometry, NONE},
    material::Materials,
    polygon::triangulate,
};
use crate::{
    Dropped, Instance, Mesh, Result, Scene, clean,
    load::{budget::bytes_of, context::Context, pool::Pool},
    unit_normal,
};

/// Adds the meshes and their instances to the scene. Returns how many triangles were dropped.
pub(super) fn build(
    context: &Context<'_>,
    geometry: &Geometry<'_>,
    materials: &mut Materials<'_>,
    scene: &mut Scene,
) -> Result<Dropped> {
    let mut dropped = Dropped::default();
    let count = geometry.faces.len();
    let _held = context
        .budget
        .borrow("the order of faces", bytes_of(count, 4))?;
    // The largest face is copied while it is cut.
    let largest = geometry.faces.iter().map(|face| face.corners).max();
    let _largest = context
        .budget
        .borrow("a face", bytes_of(largest.unwrap_or(0) as usize, 48))?;
    let mut order: Vec<u32> = (0..count as u32).collect();
    let face = |index: &u32| geometry.faces[*index as usize];
    // By group, and in the file's order within each.
    order.sort_unstable_by_key(|index| (face(index).group, *index));
    for faces in order.chunk_by(|a, b| face(a).group == face(b).group) {
        let name = &geometry.groups.list[face(&faces[0]).group as usize];
        let faces = faces.iter().map(face);
        let mut mesh = convert(context, geometry, materials, faces, name, &mut dropped)?;
        dropped += clean(&mut mesh);
        if !mesh.triangles.is_empty() {
            let instance = Instance::new(scene.meshes.len() as u32, Affine3A::IDENTITY);
            scene.instances.push(Instance {
                name: name.clone(),
                ..instance
            });
            scene.meshes.push(Arc::new(mesh));
        }
    }
    Ok(dropped)
}

fn convert(
    context: &Context<'_>,
    geometry: &Geometry<'_>,
    materials: &mut Materials<'_>,
    faces: impl Iterator<Item = Face>,
    name: &str,
    dropped: &mut Dropped,
) -> Result<Mesh> {
    let mut triangles = Pool::new(context.budget, "the triangles");
    let mut triangle_materials = Pool::new(context.budget, "the triangles' materials");
    let mut positions = Vec::new();
    let mut corners = Vec::new();
    for face in faces {
        let all = face.first as usize..(face.first + face.corners) as usize;
        corners.clear();
        corners.extend_from_slice(&geometry.corners[all]);
        let whole = u64::from(face.corners) - 2;
        let position = |corner: &Corner| geometry.positions.get(corner.position as usize).copied();
        positions.clear();
        positions.extend(corners.iter().map_while(position));
        if positions.len() < corners.len() {
            dropped.out_of_range += whole;
            continue;
        }
        if !positions.iter().all(|position| position.is_finite()) {
            dropped.non_finite += whole;
            continue;
        }
        complete(context, geometry, &mut corners);
        let material = materials.get(&geometry.materials.list[face.material as usize])?;
        let before = triangles.len();
        triangulate(&positions, |triangle| {
            triangles.push(triangle.map(|i| corners[i]))?;
            triangle_materials.push(material)
        })?;
        // Corners that lie on a line or on each other are cut off without a triangle.
        dropped.zero_area += whole.saturating_sub((triangles.len() - before) as u64);
    }
    assemble(context, geometry, &triangles, &triangle_materials, name)
}

/// Takes away references to normals and texture coordinates that are not there; a face has normals at all corners or
/// at none.
fn complete(context: &Context<'_>, geometry: &Geometry<'_>, corners: &mut [Corner]) {
    let refers = |index: u32, count: usize| {
        let found = (index as usize) < count;
        if !found && index != NONE {
            let line = "some faces refer to normals or texture coordinates that are not there";
            context.warn(line);
        }
        found
    };
    let smooth = corners
        .iter()
        .all(|corner| refers(corner.normal, geometry.normals.len()));
    for corner in corners {
        if !smooth {
            corner.normal = NONE;
        }
        if !refers(corner.uv, geometry.uvs.len()) {
            corner.uv = NONE;
        }
    }
}

/// Makes one vertex of equal corners; corners without normals stay separate, with the normal of their triangle.
fn assemble(
    context: &Context<'_>,
    geometry: &Geometry<'_>,
    triangles: &[[Corner; 3]],
    triangle_materials: &[u32],
    name: &str,
) -> Result<Mesh> {
    let is_flat = |triangle: &[Corner; 3]| triangle[0].normal == NONE;
    let _held = context.budget.borrow(
        "the corners",
        bytes_of(triangles.len(), size_of::<[Corner; 3]>()),
    )?;
    let mut shared: Vec<Corner> = Vec::with_capacity(3 * triangles.len());
    shared.extend(triangles.iter().filter(|all| !is_flat(all)).flatten());
    shared.sort_unstable();
    shared.dedup();
    let flat = triangles.iter().filter(|all| is_flat(all)).count();
    let vertices = shared.len() + 3 * flat;
    let has_uvs = triangles.iter().flatten().any(|corner| corner.uv != NONE);
    let has_colors = !geometry.colors.is_empty();
    let vertex = 24 + if has_uvs { 8 } else { 0 } + if has_colors { 16 } else { 0 };
    // A triangle has three indices, a material and a flag while it is cleaned.
    context.budget.claim(
        "a mesh",
        bytes_of(vertices, vertex).saturating_add(bytes_of(triangles.len(), 17)),
    )?;
    let mut mesh = Mesh {
        name: name.to_owned(),
        positions: Vec::with_capacity(vertices),
        normals: Vec::with_capacity(vertices),
        uvs: [has_uvs, false].map(|has| Vec::with_capacity(if has { vertices } else { 0 })),
        colors: Vec::with_capacity(if has_colors { vertices } else { 0 }),
        triangles: Vec::with_capacity(triangles.len()),
        triangle_materials: triangle_materials.to_vec(),
    };
    let mut add = |corner: &Corner, normal: Vec3| {
        mesh.positions
            .push(geometry.positions[corner.position as usize]);
        mesh.normals.push(normal);
        if has_uvs {
            let uv = geometry.uvs.get(corner.uv as usize);
            // OBJ counts v from the bottom.
            mesh.uvs[0].push(uv.map_or(Vec2::ZERO, |uv| Vec2::new(uv.x, 1.0 - uv.y)));
        }
        if has_colors {
            mesh.colors
                .push(geometry.colors[corner.position as usize].extend(1.0));
        }
    };
    for corner in &shared {
        add(corner, geometry.normals[corner.normal as usize]);
    }
    let mut next = shared.len() as u32;
    for triangle in triangles {
        if is_flat(triangle) {
            let [a, b, c] = triangle.map(|corner| geometry.positions[corner.position as usize]);
            let normal = unit_normal(a, b, c);
            triangle.iter().for_each(|corner| add(corner, normal));
            mesh.triangles.push([next, next + 1, next + 2]);
            next += 3;
        } else {
            let place = |corner| shared.partition_point(|other| *other < corner) as u32;
            mesh.triangles.push(triangle.map(place));
        }
    }
    Ok(mesh)
}
