//! A scene's data in GPU memory: everything a shader needs to know about a hit.
//!
//! 1. `vertices`: positions, normals, texture coordinates and colours, 32 bytes a vertex; triangles, 16 bytes each.
//! 2. `tables`: instances, materials, textures and lights, how lights are chosen, and where each begins.
//! 3. `atlas`: all mip levels of all textures as rectangles in the layers of one array texture.
//!
//! All of it is measured against the device's limits before anything is created; tables that are too large for buffers
//! go into textures ([`words`](super::words)). In shaders the modules `scene::scene_data`, `scene::texture` and
//! `scene::surface` read it.

mod atlas;
mod tables;
mod vertices;

use self::{
    atlas::Atlas,
    tables::{SceneInfo, Tables, least_bytes},
    vertices::{Geometry, MeshPlace},
};
use super::{
    Context,
    raster::uniform_entry,
    words::{Placement, Words},
};
use crate::{Aabb, Alpha, Environment, Error, InstanceMask, Result, Scene};

/// A scene's data in GPU memory, bound as group 2.
#[derive(Debug)]
pub struct GpuScene {
    placement: Placement,
    layout: wgpu::BindGroupLayout,
    bind_group: wgpu::BindGroup,
    places: Vec<MeshPlace>,
    meshes: Vec<MeshFacts>,
    /// Mesh and roles of every instance.
    instances: Vec<(u32, InstanceMask)>,
    bounds: Aabb,
    material_count: usize,
    light_count: usize,
    info: SceneInfo,
    info_buffer: wgpu::Buffer,
    tables: Words,
    bytes: u64,
}

/// What is known of a mesh without reading it again.
#[derive(Clone, Copy, Debug)]
struct MeshFacts {
    bounds: Aabb,
    /// Whether rays may pass some of its triangles.
    masked: bool,
}

/// Neighbouring instances of one mesh, to be drawn at once.
#[derive(Clone, Debug)]
pub(super) struct Draw {
    pub(super) instances: std::ops::Range<u32>,
    pub(super) triangle_count: u32,
    /// Whether rays may pass some of its triangles.
    pub(super) masked: bool,
}

impl GpuScene {
    /// Uploads a scene.
    ///
    /// # Errors
    /// [`Error::GpuLimit`] when a part is larger than the device's textures can be, [`Error::Gpu`] when memory is out or
    /// the device fails.
    pub fn new(context: &Context, scene: &Scene) -> Result<Self> {
        let Packed {
            atlas,
            environment,
            geometry,
            tables,
            placement,
        } = Packed::new(context, scene)?;
        let words = |label, words: &[[u32; 4]]| {
            Words::new(context, placement, label, bytemuck::cast_slice(words))
        };
        let buffers = [
            words("scene vertices", &geometry.vertices)?,
            words("scene triangles", &geometry.triangles)?,
            words("scene tables", &tables.words)?,
        ];
        let info = tables.info;
        let info_buffer = context.buffer("scene info", &[info], wgpu::BufferUsages::UNIFORM)?;
        let bytes = buffers.iter().map(Words::bytes).sum::<u64>() + atlas.bytes();
        let [vertices, triangles, tables] = buffers;
        let (layout, bind_group) = context.check("uploading the scene's textures", |device| {
            let pages = atlas.upload(context, &scene.textures);
            let pages = pages.create_view(&wgpu::TextureViewDescriptor {
                label: Some("scene textures"),
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                ..Default::default()
            });
            let environment = environment.upload(context);
            let layout = Self::layout(device, placement);
            let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("scene"),
                layout: &layout,
                entries: &entries([
                    info_buffer.as_entire_binding(),
                    vertices.binding(),
                    triangles.binding(),
                    tables.binding(),
                    wgpu::BindingResource::TextureView(&pages),
                    wgpu::BindingResource::TextureView(&environment),
                ]),
            });
            (layout, bind_group)
        })?;
        Ok(Self {
            placement,
            layout,
            bind_group,
            places: geometry.places,
            meshes: mesh_facts(scene),
            instances: scene
                .instances
                .iter()
                .map(|instance| (instance.mesh, instance.mask))
                .collect(),
            bounds: scene.bounds(),
            material_count: scene.materials.len(),
            light_count: scene.lights.len(),
            info,
            info_buffer,
            tables,
            bytes,
        })
    }

    /// Moves instances and lights to where they are in `scene`, which must otherwise be the scene that was uploaded.
    /// Commands that are submitted later see it.
    ///
    /// # Errors
    /// [`Error::Parameter`] when instances or lights are others.
    pub fn update(&mut self, context: &Context, scene: &Scene) -> Result<()> {
        let same = scene.instances.len() == self.instances.len()
            && scene.lights.len() == self.light_count
            && scene
                .instances
                .iter()
                .zip(&self.instances)
                .all(|(instance, (mesh, _))| instance.mesh == *mesh);
        if !same {
            return Err(Error::Parameter {
                name: "the moved scene",
                value: format!(
                    "{} instances, {} lights",
                    scene.instances.len(),
                    scene.lights.len()
                ),
                expected: "it must have the instances and lights of the scene that was uploaded",
            });
        }
        self.instances = scene
            .instances
            .iter()
            .map(|instance| (instance.mesh, instance.mask))
            .collect();
        self.bounds = scene
            .instances
            .iter()
            .filter(|instance| !self.meshes[instance.mesh as usize].bounds.is_empty())
            .flat_map(|instance| {
                let corners = self.meshes[instance.mesh as usize].bounds.corners();
                corners.map(|corner| instance.transform.transform_point3(corner))
            })
            .fold(Aabb::EMPTY, Aabb::grown);
        let moving = Tables::moved(&self.info, scene, &self.bounds, &self.places);
        self.info = moving.info;
        context.check("moving the scene", |_| {
            self.tables.write(context, &moving.words);
            let info = bytemuck::bytes_of(&self.info);
            context.queue().write_buffer(&self.info_buffer, 0, info);
        })
    }

    /// The box around all instances, where they were at the last upload or update; empty without geometry.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Whether a ray can find light: on an emissive triangle or outside the scene.
    pub(super) fn light_can_be_hit(&self) -> bool {
        self.info.can_be_hit()
    }

    pub(super) fn material_count(&self) -> usize {
        self.material_count
    }

    /// How to draw the instances that play all of some roles.
    pub(super) fn draws(&self, roles: InstanceMask) -> Vec<Draw> {
        let mut draws: Vec<(u32, Draw)> = Vec::new();
        for (index, &(mesh, mask)) in (0..).zip(&self.instances) {
            if !mask.contains(roles) {
                continue;
            }
            match draws.last_mut() {
                Some((last, draw)) if *last == mesh && draw.instances.end == index => {
                    draw.instances.end += 1;
                }
                _ => {
                    let draw = Draw {
                        instances: index..index + 1,
                        triangle_count: self.places[mesh as usize].triangle_count,
                        masked: self.meshes[mesh as usize].masked,
                    };
                    draws.push((mesh, draw));
                }
            }
        }
        draws.into_iter().map(|(_, draw)| draw).collect()
    }

    /// What the shader modules `scene::…` bind.
    pub fn bind_group(&self) -> &wgpu::BindGroup {
        &self.bind_group
    }

    /// The layout of [`bind_group`](Self::bind_group).
    pub fn bind_group_layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// Bytes of GPU memory taken.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Whether the data lie in textures, because the device binds no buffers that large.
    pub fn is_in_textures(&self) -> bool {
        self.placement == Placement::Textures
    }

    /// The layout of the bind group of every scene in buffers, or in textures; visible to all stages.
    pub(super) fn layout(device: &wgpu::Device, placement: Placement) -> wgpu::BindGroupLayout {
        let texture = |binding, view_dimension| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::all(),
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: false },
                view_dimension,
                multisampled: false,
            },
            count: None,
        };
        device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("scene"),
            entries: &[
                uniform_entry(0, false),
                placement.layout_entry(1),
                placement.layout_entry(2),
                placement.layout_entry(3),
                texture(4, wgpu::TextureViewDimension::D2Array),
                texture(5, wgpu::TextureViewDimension::D2),
            ],
        })
    }
}

/// A scene as it will be uploaded, which the device has room for.
struct Packed {
    atlas: Atlas,
    environment: EnvironmentTexels,
    geometry: Geometry,
    tables: Tables,
    placement: Placement,
}

impl Packed {
    fn new(context: &Context, scene: &Scene) -> Result<Self> {
        let [vertex_bytes, triangle_bytes] = Geometry::bytes(scene);
        let vertices = ("the scene's vertices", vertex_bytes);
        let triangles = ("the scene's triangles", triangle_bytes);
        let rest = ("the scene's tables", least_bytes(scene));
        Placement::of(context, &[vertices, triangles, rest])?;
        let limits = context.device().limits();
        let atlas = Atlas::pack(&scene.textures, &limits, || {
            context.device().adapter_info().name
        })?;
        let environment = environment(context, &scene.environment, &limits)?;
        let geometry = Geometry::new(scene);
        let tables = Tables::new(scene, &geometry.places, &atlas);
        let table_bytes = size_of_val(&tables.words[..]) as u64;
        let rest = ("the scene's tables", table_bytes);
        Ok(Self {
            placement: Placement::of(context, &[vertices, triangles, rest])?,
            atlas,
            environment,
            geometry,
            tables,
        })
    }
}

fn mesh_facts(scene: &Scene) -> Vec<MeshFacts> {
    let is_masked = |&material: &u32| scene.materials[material as usize].alpha != Alpha::Opaque;
    let facts = |mesh: &std::sync::Arc<crate::Mesh>| MeshFacts {
        bounds: mesh.bounds(),
        masked: mesh.triangle_materials.iter().any(is_masked),
    };
    scene.meshes.iter().map(facts).collect()
}

/// Resources bound in order from 0.
pub(super) fn entries<const N: usize>(
    resources: [wgpu::BindingResource<'_>; N],
) -> [wgpu::BindGroupEntry<'_>; N] {
    let mut binding = 0;
    resources.map(|resource| {
        binding += 1;
        wgpu::BindGroupEntry {
            binding: binding - 1,
            resource,
        }
    })
}

/// The environment as a texture: one texel where it is the same all around.
struct EnvironmentTexels {
    size: [u32; 2],
    texels: Vec<[f32; 4]>,
}

fn environment(
    context: &Context,
    environment: &Environment,
    limits: &wgpu::Limits,
) -> Result<EnvironmentTexels> {
    let (size, texels) = match environment {
        Environment::Black => ([1, 1], vec![[0.0; 4]]),
        Environment::Constant(radiance) => ([1, 1], vec![radiance.extend(0.0).to_array()]),
        Environment::Map(map) => {
            let texels = map
                .texels()
                .iter()
                .map(|texel| texel.extend(0.0).to_array());
            (map.size(), texels.collect())
        }
    };
    let [width, height] = size;
    let side = limits.max_texture_dimension_2d;
    if width.max(height) > side {
        return Err(Error::GpuLimit {
            what: format!("the environment of {width} × {height} texels"),
            needs: 16 * u64::from(width) * u64::from(height),
            limit: 16 * u64::from(side) * u64::from(side),
            adapter: context.device().adapter_info().name,
        });
    }
    Ok(EnvironmentTexels { size, texels })
}

impl EnvironmentTexels {
    fn upload(&self, context: &Context) -> wgpu::TextureView {
        let [width, height] = self.size;
        let size = wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        };
        let texture = context.device().create_texture(&wgpu::TextureDescriptor {
            label: Some("environment"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(16 * width),
            rows_per_image: Some(height),
        };
        let bytes = bytemuck::cast_slice(&self.texels);
        context
            .queue()
            .write_texture(texture.as_image_copy(), bytes, layout, size);
        texture.create_view(&wgpu::TextureViewDescriptor::default())
    }
}
