//! The points that maps are asked for: what a camera sees by a tracer, what a G-buffer holds, or any points at all.

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3, Vec4};
use isophote_scene::{
    Aabb, Camera, Projection,
    gpu::{ComputePass, Context, Dispatch, GpuScene, GpuTracer, Rasters, View},
    reference::Normals,
};
use wgpu::BufferUsages;

use super::{Filler, Occlusion, linker};
use crate::{Result, cpu};

/// Bytes of a point.
const POINT: u64 = 48;
/// Points in a box around which maps are fitted.
const BOX: usize = 64;

/// `Asking` of points/store.wesl.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Asking {
    view: View,
    origin: Vec3,
    sample: u32,
    place: Vec2,
    size: [u32; 2],
    flat_normals: u32,
    padding: [u32; 3],
}

/// Points on the device: one for each pixel of a picture, or none.
#[derive(Debug)]
pub struct Points {
    pub(super) buffer: wgpu::Buffer,
    size: [u32; 2],
    /// Boxes that hold all points, relative to the occlusion's origin.
    pub(super) boxes: Vec<Aabb>,
}

impl Points {
    /// Room for the points of a picture of a size in pixels. Any list of points is a picture of some width.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device does not bind buffers that large.
    pub fn new(context: &Context, size: [u32; 2]) -> Result<Self> {
        let count = u64::from(size[0]) * u64::from(size[1]);
        Ok(Self {
            buffer: context.storage("points", POINT * count)?,
            size,
            boxes: Vec::new(),
        })
    }

    /// Width and height of the picture.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Around all of them, relative to the occlusion's origin; none where there is none.
    pub(super) fn bounds(&self) -> Option<Aabb> {
        let around = |bounds: Aabb, other: &Aabb| bounds.union(other);
        let bounds = self.boxes.iter().fold(Aabb::EMPTY, around);
        (!bounds.is_empty()).then_some(bounds)
    }

    /// Refuses points of a picture of another size.
    pub(super) fn require(&self, size: [u32; 2]) -> Result<()> {
        if self.size == size {
            return Ok(());
        }
        let [width, height] = self.size;
        Err(crate::Error::Parameter {
            name: "the picture of the points",
            value: format!("{width}x{height} pixels"),
            expected: "it must be of the size for which the occlusion was made",
        })
    }

    /// Replaces the points by others, from the next submission on; those whose index is beyond the picture are left out.
    pub fn upload(&mut self, context: &Context, occlusion: &Occlusion, points: &cpu::Points) {
        self.upload_about(context, occlusion.origin(), points);
    }

    /// The same, relative to any origin.
    pub fn upload_about(&mut self, context: &Context, origin: Vec3, points: &cpu::Points) {
        let [width, height] = self.size.map(|side| side as usize);
        let mut words = vec![[[0.0_f32; 4]; 3]; width * height];
        for (point, &index) in points.points.iter().zip(&points.indices) {
            if let Some(word) = words.get_mut(index as usize) {
                *word = [
                    (point.position - origin).extend(1.0).to_array(),
                    point.shading_normal.extend(0.0).to_array(),
                    point.geometric_normal.extend(0.0).to_array(),
                ];
            }
        }
        let bytes = bytemuck::cast_slice(&words);
        context.queue().write_buffer(&self.buffer, 0, bytes);
        let around = |points: &[cpu::Point]| {
            Aabb::around(points.iter().map(|point| point.position - origin))
        };
        self.boxes = points.points.chunks(BOX).map(around).collect();
    }

    /// Fits what follows around the points that were found, once that was submitted, instead of around what a camera may see: maps
    /// are finer then, and those of the CPU. Waits for the device.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device fails.
    pub fn tighten(&mut self, context: &Context) -> Result<()> {
        let [width, height] = self.size.map(|side| side as usize);
        let points: Vec<[Vec4; 3]> = context.read("points", &self.buffer, width * height)?;
        let found = points.iter().filter(|point| point[0].w != 0.0);
        let found: Vec<Vec3> = found.map(|point| point[0].truncate()).collect();
        let boxes = found.chunks(BOX);
        let boxes = boxes.map(|some| Aabb::around(some.iter().copied()));
        self.boxes = boxes.collect();
        Ok(())
    }

    /// Boxes around what a camera may see, and what a shader is told that finds its points.
    pub(super) fn look(&mut self, origin: Vec3, gpu_scene: &GpuScene, look: &Look<'_>) -> Asking {
        let corners = seen_part(look.camera, self.size, &gpu_scene.bounds());
        self.boxes = corners
            .into_iter()
            .map(|corner| Aabb {
                min: corner - origin,
                max: corner - origin,
            })
            .collect();
        Asking {
            view: View::of_camera(look.camera, self.size, &gpu_scene.bounds()),
            origin,
            sample: look.sample,
            place: look.place,
            size: self.size,
            flat_normals: u32::from(look.normals == Normals::Flat),
            padding: [0; 3],
        }
    }
}

/// Which points are wanted.
#[derive(Clone, Copy, Debug)]
pub struct Look<'a> {
    /// Who sees them.
    pub camera: &'a Camera,
    /// Where in each pixel, 0 to 1 from its corner.
    pub place: Vec2,
    /// Which sample of a G-buffer.
    pub sample: u32,
    /// Their shading normals.
    pub normals: Normals,
}

/// Finds points with a tracer. Twin of [`cpu::Points::from_camera`].
#[derive(Debug)]
pub struct CameraPoints {
    pass: ComputePass,
}

impl CameraPoints {
    /// For a tracer that answers [`Answers::Surface`](isophote_scene::Answers::Surface).
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when it does not, or its module does not link.
    pub fn new(context: &Context, gpu_scene: &GpuScene, tracer: &dyn GpuTracer) -> Result<Self> {
        let answers = tracer.answers();
        answers.require(
            isophote_scene::Answers::Surface,
            "ldm",
            "the tracer of camera rays",
        )?;
        let shader = linker()
            .scene(gpu_scene)
            .tracer(tracer)
            .link("ldm_ambient::points::camera")?;
        let groups = [tracer.bind_group_layout(), gpu_scene.bind_group_layout()];
        Ok(Self {
            pass: shader.compute_pass(context, "camera", &groups, &[])?,
        })
    }

    /// Records what a camera sees at one place of each pixel, which is counted in pixels from its corner.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when recording fails.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        occlusion: &Occlusion,
        (gpu_scene, tracer): (&GpuScene, &dyn GpuTracer),
        look: &Look<'_>,
        points: &mut Points,
    ) -> Result<()> {
        let origin = occlusion.origin();
        self.record_about(context, encoder, origin, (gpu_scene, tracer), look, points)
    }

    /// The same, relative to any origin.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when recording fails.
    pub fn record_about(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        origin: Vec3,
        (gpu_scene, tracer): (&GpuScene, &dyn GpuTracer),
        look: &Look<'_>,
        points: &mut Points,
    ) -> Result<()> {
        let asking = points.look(origin, gpu_scene, look);
        let groups = [tracer.bind_group(), gpu_scene.bind_group()];
        record(&self.pass, context, encoder, asking, &groups, points)
    }
}

/// Takes points from G-buffers, of this workspace or of any other renderer.
///
/// Where a G-buffer does not say which triangle a pixel sees, the shading normal stands for the triangle's.
#[derive(Debug)]
pub struct GBufferPoints {
    pass: ComputePass,
    filler: Filler,
}

impl GBufferPoints {
    /// For G-buffers of so many samples, bound as [`Rasters`].
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when the device refuses the shader.
    pub fn new(
        context: &Context,
        gpu_scene: &GpuScene,
        samples: u32,
        rasters: &Rasters,
    ) -> Result<Self> {
        let filler = Filler::new(context)?;
        let shader = linker()
            .scene(gpu_scene)
            .feature("multisampled", samples > 1)
            .link("ldm_ambient::points::gbuffer")?;
        let groups = [
            &filler.layout,
            gpu_scene.bind_group_layout(),
            rasters.bind_group_layout(),
        ];
        Ok(Self {
            pass: shader.compute_pass(context, "gbuffer", &groups, &[])?,
            filler,
        })
    }

    /// Records what a G-buffer holds of one of its samples; `look.place` does not matter, and `points` must have its size.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when recording fails.
    pub fn record(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        occlusion: &Occlusion,
        (gpu_scene, rasters): (&GpuScene, &Rasters),
        look: &Look<'_>,
        points: &mut Points,
    ) -> Result<()> {
        let origin = occlusion.origin();
        self.record_about(context, encoder, origin, (gpu_scene, rasters), look, points)
    }

    /// The same, relative to any origin.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene) when recording fails.
    pub fn record_about(
        &self,
        context: &Context,
        encoder: &mut wgpu::CommandEncoder,
        origin: Vec3,
        (gpu_scene, rasters): (&GpuScene, &Rasters),
        look: &Look<'_>,
        points: &mut Points,
    ) -> Result<()> {
        let asking = points.look(origin, gpu_scene, look);
        let groups = [
            &self.filler.group,
            gpu_scene.bind_group(),
            rasters.bind_group(),
        ];
        record(&self.pass, context, encoder, asking, &groups, points)
    }
}

fn record(
    pass: &ComputePass,
    context: &Context,
    encoder: &mut wgpu::CommandEncoder,
    asking: Asking,
    groups: &[&wgpu::BindGroup],
    points: &Points,
) -> Result<()> {
    let asking = context.buffer("points", &[asking], BufferUsages::UNIFORM)?;
    let resources = [
        (0, asking.as_entire_binding()),
        (1, points.buffer.as_entire_binding()),
    ];
    let group = pass.bind(context, &resources)?;
    let groups: Vec<_> = [&group].into_iter().chain(groups.iter().copied()).collect();
    let dispatch = [Dispatch::over_pixels(points.size)];
    pass.record(encoder, "points", None, &groups, &dispatch);
    Ok(())
}

/// The corners of the part of a box that a camera sees, or of all of it where that is nothing.
fn seen_part(camera: &Camera, [width, height]: [u32; 2], bounds: &Aabb) -> Vec<Vec3> {
    let axes = camera.transform.matrix3;
    let axis = |axis: glam::Vec3A, other| Vec3::from(axis).normalize_or(other);
    let (right, up) = (axis(axes.x_axis, Vec3::X), axis(axes.y_axis, Vec3::Y));
    let (forward, eye) = (-axis(axes.z_axis, Vec3::Z), camera.position());
    let aspect = width as f32 / height as f32;
    let (half, depth) = match camera.projection {
        Projection::Perspective { yfov } => ((0.5 * yfov).tan(), forward),
        Projection::Orthographic { half_height } => (half_height, Vec3::ZERO),
    };
    // Inside where the product with the normal is not below −offset.
    let plane = |across: Vec3, half: f32| {
        let offset = if depth == Vec3::ZERO { half } else { 0.0 };
        (half * depth + across, offset)
    };
    let planes = [
        plane(right, half * aspect),
        plane(-right, half * aspect),
        plane(up, half),
        plane(-up, half),
    ];
    let mut corners = Vec::new();
    for axis in 0..3 {
        for end in [bounds.min[axis], bounds.max[axis]] {
            let corner = |a: usize, b: usize| {
                let mut corner = Vec3::ZERO;
                corner[axis] = end;
                corner[(axis + 1) % 3] = [bounds.min, bounds.max][a][(axis + 1) % 3];
                corner[(axis + 2) % 3] = [bounds.min, bounds.max][b][(axis + 2) % 3];
                corner
            };
            let mut face = vec![corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            for (normal, offset) in planes {
                face = clip(&face, |point| normal.dot(point - eye) + offset);
            }
            corners.extend(face);
        }
    }
    let inside = eye.cmpge(bounds.min).all() && eye.cmple(bounds.max).all();
    if inside && depth != Vec3::ZERO {
        corners.push(eye);
    }
    if corners.is_empty() {
        return bounds.corners().into();
    }
    corners
}

/// The part of a polygon where a linear function is not negative.
fn clip(polygon: &[Vec3], side: impl Fn(Vec3) -> f32) -> Vec<Vec3> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (index, &point) in polygon.iter().enumerate() {
        let next = polygon[(index + 1) % polygon.len()];
        let (here, there) = (side(point), side(next));
        if here >= 0.0 {
            kept.push(point);
        }
        if (here < 0.0) != (there < 0.0) {
            kept.push(point + here / (here - there) * (next - point));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use glam::Affine3A;

    use super::*;

    /// Every point of a box that a camera sees is in the box around the corners, which is not larger than it must be.
    #[test]
    fn the_part_that_is_seen_holds_what_is_seen() {
        let bounds = Aabb {
            min: Vec3::new(-3.0, -1.0, -9.0),
            max: Vec3::new(4.0, 2.0, 5.0),
        };
        let turn = glam::Quat::from_rotation_y(0.3);
        let transform = Affine3A::from_rotation_translation(turn, Vec3::new(0.5, 0.2, 1.0));
        for projection in [
            Projection::Perspective { yfov: 0.7 },
            Projection::Orthographic { half_height: 0.6 },
        ] {
            let camera = Camera {
                name: "camera".into(),
                transform,
                projection,
                node: None,
            };
            let part = Aabb::around(seen_part(&camera, [32, 24], &bounds));
            let mut seen = Aabb::EMPTY;
            for x in 0..=32 {
                for y in 0..=24 {
                    let ray = camera.ray(Vec2::new(x as f32, y as f32), 32, 24);
                    for step in 0..200 {
                        let point = ray.origin + 0.1 * step as f32 * ray.direction;
                        if point.cmpge(bounds.min).all() && point.cmple(bounds.max).all() {
                            seen = seen.grown(point);
                        }
                    }
                }
            }
            assert!(
                seen.min.cmpge(part.min - 1e-4).all() && seen.max.cmple(part.max + 1e-4).all(),
                "{projection:?}: {seen:?} {part:?}"
            );
            if matches!(projection, Projection::Perspective { .. }) {
                let off = (seen.min - part.min).abs().max((seen.max - part.max).abs());
                assert!(off.max_element() < 0.2, "{seen:?} {part:?}");
            }
        }
    }
}
