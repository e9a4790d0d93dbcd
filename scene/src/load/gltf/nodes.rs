//! The node hierarchy and what hangs on it: instances, lights, cameras (glTF 2.0 §3.5).

use std::collections::HashMap;

use glam::{Affine3A, Mat4, Quat, Vec3};
use gltf_json::{
    camera,
    extensions::scene::khr_lights_punctual::{self as punctual, Light as JsonLight},
    scene::Node as JsonNode,
    validation::Checked,
};

use super::{
    animations,
    document::Document,
    meshes::Meshes,
    source::{GltfInstance, Origins},
};
use crate::{
    Aabb, Animation, Camera, Instance, InstanceMask, Light, LightKind, Local, Node, Projection,
    Result, Scene, clean::LARGEST_COORDINATE,
};

/// Loads the scene of that name or number, or the default one, and says where its parts came from.
pub(super) fn load(document: &Document<'_>, scene: Option<&str>) -> Result<(Scene, Origins)> {
    let roots = document.roots(scene)?;
    let (nodes, order) = document.hierarchy(&roots)?;
    let mut animation = Animation {
        nodes,
        channels: Vec::new(),
    };
    // The pose of the file; animations are applied by time only.
    let world = animation.world_transforms(0.0);
    let index_of: HashMap<usize, u32> = order.iter().copied().zip(0..).collect();
    animation.channels = animations::load(document, &animation.nodes, &index_of)?;
    let moving = animation.moving();
    let mut builder = Builder {
        document,
        meshes: Meshes::new(document),
        instances: Vec::new(),
        origins: Vec::new(),
        lights: Vec::new(),
        cameras: Vec::new(),
        known_nodes: animation.nodes.len(),
        instance_nodes: Vec::new(),
    };
    for (place, &index) in order.iter().enumerate() {
        builder.node(
            index,
            &document.root.nodes[index],
            &animation.nodes[place].name,
            world[place],
            moving[place].then_some(place as u32),
        )?;
    }
    let Builder {
        meshes,
        instances,
        origins,
        lights,
        cameras,
        instance_nodes,
        ..
    } = builder;
    animation.nodes.extend(instance_nodes);
    let (meshes, sources, materials, textures) = meshes.finish();
    let origins = Origins {
        meshes: sources,
        instances: origins,
    };
    let scene = Scene {
        meshes,
        materials,
        textures,
        instances,
        lights,
        cameras,
        animation,
        ..Scene::default()
    };
    Ok((scene, origins))
}

impl Document<'_> {
    /// The root nodes of the chosen scene.
    fn roots(&self, wanted: Option<&str>) -> Result<Vec<usize>> {
        let scenes = &self.root.scenes;
        let scene = match wanted {
            Some(wanted) => {
                let named = scenes
                    .iter()
                    .find(|scene| scene.name.as_deref() == Some(wanted));
                let found = named.or_else(|| scenes.get(wanted.parse::<usize>().ok()?));
                let count = scenes.len();
                Some(found.ok_or_else(|| {
                    self.malformed(format!(
                        "has no scene '{wanted}'; it has {count}, numbered from 0"
                    ))
                })?)
            }
            None => {
                let default = self.root.scene.map_or(0, |scene| scene.value());
                if self.root.scene.is_some() && default >= scenes.len() {
                    self.warn(format!("the default scene {default} does not exist"));
                }
                scenes.get(default).or(scenes.first())
            }
        };
        if let Some(scene) = scene {
            return Ok(scene.nodes.iter().map(|node| node.value()).collect());
        }
        // A file without scenes is a library; all of it is shown.
        let mut is_root = vec![true; self.root.nodes.len()];
        for child in self.root.nodes.iter().flat_map(children) {
            if let Some(flag) = is_root.get_mut(child) {
                *flag = false;
            }
        }
        Ok((0..is_root.len()).filter(|&node| is_root[node]).collect())
    }

    /// All nodes below the roots, every parent before its children, and their indices in the file.
    fn hierarchy(&self, roots: &[usize]) -> Result<(Vec<Node>, Vec<usize>)> {
        let (mut nodes, mut order) = (Vec::new(), Vec::new());
        let mut met = vec![false; self.root.nodes.len()];
        // A stack of our own: a file can nest deeper than the thread's reaches.
        let mut stack: Vec<(usize, Option<u32>)> =
            roots.iter().rev().map(|&node| (node, None)).collect();
        while let Some((index, parent)) = stack.pop() {
            let node = self.item(&self.root.nodes, "node", index)?;
            if std::mem::replace(&mut met[index], true) {
                return Err(self.malformed(format!(
                    "node {index} hangs in the tree twice or below itself; every node has at most one parent"
                )));
            }
            let place = nodes.len() as u32;
            nodes.push(Node {
                name: node.name.clone().unwrap_or_default(),
                parent,
                local: self.local(index, node),
            });
            order.push(index);
            let below: Vec<_> = children(node).collect();
            stack.extend(below.into_iter().rev().map(|child| (child, Some(place))));
        }
        Ok((nodes, order))
    }

    /// A node's transform; what is not finite or no rotation is replaced by none, with a warning.
    fn local(&self, index: usize, node: &JsonNode) -> Local {
        let wrong =
            |what: &str| self.warn(format!("node {index} has no valid {what}; it is ignored"));
        if let Some(matrix) = &node.matrix {
            let matrix = Affine3A::from_mat4(Mat4::from_cols_array(matrix));
            if matrix.is_finite() {
                return Local::Matrix(matrix);
            }
            wrong("matrix");
            return Local::IDENTITY;
        }
        let vector = |value: Option<[f32; 3]>, default: Vec3, what: &str| match value {
            Some(value) if Vec3::from(value).is_finite() => value.into(),
            Some(_) => {
                wrong(what);
                default
            }
            None => default,
        };
        let rotation = match node.rotation {
            Some(rotation) => unit_quaternion(rotation.0).unwrap_or_else(|| {
                wrong("rotation");
                Quat::IDENTITY
            }),
            None => Quat::IDENTITY,
        };
        Local::Parts {
            translation: vector(node.translation, Vec3::ZERO, "translation"),
            rotation,
            scale: vector(node.scale, Vec3::ONE, "scale"),
        }
    }
}

/// A rotation of unit length, if the components can be one.
pub(super) fn unit_quaternion(components: [f32; 4]) -> Option<Quat> {
    let components = glam::Vec4::from(components);
    components.try_normalize().map(Quat::from_vec4)
}

fn children(node: &JsonNode) -> impl Iterator<Item = usize> + '_ {
    node.children.iter().flatten().map(|child| child.value())
}

struct Builder<'a> {
    document: &'a Document<'a>,
    meshes: Meshes<'a>,
    instances: Vec<Instance>,
    /// Where each of them came from.
    origins: Vec<GltfInstance>,
    lights: Vec<Light>,
    cameras: Vec<Camera>,
    /// How many nodes there are without the following.
    known_nodes: usize,
    /// For moving instances beyond one a node.
    instance_nodes: Vec<Node>,
}

impl Builder<'_> {
    /// Adds what hangs on a node; `moved_by` is its place in the animation if it moves.
    fn node(
        &mut self,
        index: usize,
        node: &JsonNode,
        name: &str,
        transform: Affine3A,
        moved_by: Option<u32>,
    ) -> Result<()> {
        if !transform.is_finite() {
            self.document.warn(format!(
                "node '{name}' is placed beyond all numbers; what hangs on it is dropped"
            ));
            return Ok(());
        }
        if let Some(mesh) = node.mesh {
            let before = self.instances.len();
            let is_multiplied = self.instances(node, mesh.value(), name, transform, moved_by)?;
            let new = self.instances[before..].iter();
            self.origins.extend(new.map(|instance| GltfInstance {
                node: index,
                mesh: instance.mesh,
                is_multiplied,
            }));
        }
        if node.skin.is_some() {
            self.document
                .warn("skins are ignored: skinned meshes stand in the pose they are stored in");
        }
        if let Some(camera) = node.camera {
            let cameras = &self.document.root.cameras;
            let camera = self.document.item(cameras, "camera", camera.value())?;
            let named = [name, camera.name.as_deref().unwrap_or_default()];
            let name = named.into_iter().find(|name| !name.is_empty());
            match projection(camera) {
                Some(projection) => self.cameras.push(Camera {
                    name: name.unwrap_or_default().to_owned(),
                    projection,
                    transform,
                    node: moved_by,
                }),
                None => self.document.warn(format!(
                    "the camera '{}' has no valid angle or size; it is ignored",
                    name.unwrap_or_default()
                )),
            }
        }
        let extensions = node.extensions.as_ref();
        if let Some(light) = extensions.and_then(|all| all.khr_lights_punctual.as_ref()) {
            self.light(light.light.value(), name, transform, moved_by)?;
        }
        Ok(())
    }

    /// Adds the mesh of a node, once or as often as an extension says; returns whether one does.
    fn instances(
        &mut self,
        node: &JsonNode,
        mesh: usize,
        name: &str,
        transform: Affine3A,
        moved_by: Option<u32>,
    ) -> Result<bool> {
        let Some(mesh) = self.meshes.get(mesh)? else {
            return Ok(false);
        };
        let Some(locals) = self.document.instancing(node)? else {
            self.instance(mesh, name, transform, moved_by);
            return Ok(false);
        };
        for local in locals {
            // What moves needs a node of its own to move by.
            let place = (self.known_nodes + self.instance_nodes.len()) as u32;
            if moved_by.is_some() {
                self.instance_nodes.push(Node {
                    name: name.to_owned(),
                    parent: moved_by,
                    local: Local::Matrix(local),
                });
            }
            self.instance(mesh, name, transform * local, moved_by.map(|_| place));
        }
        Ok(true)
    }

    fn instance(&mut self, mesh: u32, name: &str, transform: Affine3A, moved_by: Option<u32>) {
        let reason = if !(transform.is_finite() && is_invertible(&transform)) {
            Some("has a transform that cannot be undone")
        } else if !is_within_reach(self.meshes.bounds(mesh), &transform) {
            Some("is placed too far away")
        } else {
            None
        };
        if let Some(reason) = reason {
            self.document
                .warn(format!("node '{name}' {reason}; its mesh is dropped"));
            return;
        }
        let mask = match moved_by {
            Some(_) => InstanceMask::ALL.without(InstanceMask::STATIC),
            None => InstanceMask::ALL,
        };
        self.instances.push(Instance {
            name: name.to_owned(),
            mesh,
            transform,
            mask,
            node: moved_by,
        });
    }

    fn light(
        &mut self,
        index: usize,
        node: &str,
        transform: Affine3A,
        moved_by: Option<u32>,
    ) -> Result<()> {
        let lights = self.document.root.extensions.as_ref();
        let lights = lights.and_then(|all| all.khr_lights_punctual.as_ref());
        let lights = lights.map_or(&[][..], |all| &all.lights);
        let light = self.document.item(lights, "light", index)?;
        let named = light.name.as_deref().filter(|name| !name.is_empty());
        let name = named.unwrap_or(node).to_owned();
        let intensity = Vec3::from(light.color) * light.intensity;
        let Some(kind) = light_kind(light).filter(|_| intensity.is_finite()) else {
            self.document
                .warn(format!("the light '{name}' is not valid; it is ignored"));
            return Ok(());
        };
        if light.range.is_some() {
            self.document
                .warn("the ranges of lights are ignored: they reach without end");
        }
        self.lights.push(Light {
            name,
            kind,
            intensity: intensity.max(Vec3::ZERO),
            transform,
            node: moved_by,
        });
        Ok(())
    }
}

/// Whether all of a placed box has coordinates that can be traced.
fn is_within_reach(bounds: Aabb, transform: &Affine3A) -> bool {
    let limit = Vec3::splat(LARGEST_COORDINATE);
    bounds
        .corners()
        .iter()
        .all(|corner| transform.transform_point3(*corner).abs().cmple(limit).all())
}

/// Whether a transform can be undone.
fn is_invertible(transform: &Affine3A) -> bool {
    let matrix = transform.matrix3;
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis].map(|axis| axis.as_dvec3());
    let volume = x.cross(y).dot(z).abs();
    // The first for what is flat but for rounding, the second for what no float can undo.
    volume > 1e-12 * x.length() * y.length() * z.length() && transform.inverse().is_finite()
}

fn projection(camera: &camera::Camera) -> Option<Projection> {
    match camera.type_ {
        Checked::Valid(camera::Type::Perspective) => {
            let yfov = camera.perspective.as_ref()?.yfov;
            (yfov > 0.0 && yfov < std::f32::consts::PI).then_some(Projection::Perspective { yfov })
        }
        Checked::Valid(camera::Type::Orthographic) => {
            let half_height = camera.orthographic.as_ref()?.ymag.abs();
            (half_height > 0.0 && half_height.is_finite())
                .then_some(Projection::Orthographic { half_height })
        }
        Checked::Invalid => None,
    }
}

fn light_kind(light: &JsonLight) -> Option<LightKind> {
    match light.type_ {
        Checked::Valid(punctual::Type::Directional) => Some(LightKind::Directional),
        Checked::Valid(punctual::Type::Point) => Some(LightKind::Point { radius: 0.0 }),
        Checked::Valid(punctual::Type::Spot) => {
            let spot = light.spot.as_ref()?;
            let outer = spot.outer_cone_angle.min(std::f32::consts::FRAC_PI_2);
            let inner = spot.inner_cone_angle.clamp(0.0, outer.max(0.0));
            (outer > 0.0).then_some(LightKind::Spot { inner, outer })
        }
        Checked::Invalid => None,
    }
}
