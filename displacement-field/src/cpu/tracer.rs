//! Stage 4: fields placed in a scene answer rays of the world.
//!
//! A ray is taken to the space of each field whose sphere it meets; there its span says which part of it can hit, and
//! [`look_up`](super::look_up) what it hits. Moving instances moves spheres and nothing else.

use std::sync::Arc;

use glam::{Affine3A, Vec2, Vec3};
use isophote_scene::{
    Aabb, Answers, Hit, Mesh, Ray, Scene, Selection, SurfaceId, Tracer, check_transforms,
    reference::Progress,
};

use super::{
    build::alone,
    field::Field,
    look_up::{Chord, LookUp, Mapping, Maps, Question, Sites, with_maps},
    samples::Store,
    split::split,
    top::Top,
};
use crate::{Error, FieldParams, Result, Sphere};

/// What stands for a mesh: a field, or several of its parts.
#[derive(Clone, Debug, Default)]
pub struct Object {
    /// The fields of its parts, in the mesh's space.
    pub parts: Vec<Arc<Field>>,
    /// What stands for it where it is [distant](FieldTracer::look_from): the same, but of one bit a direction. May be empty.
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
fn is_selected(
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

fn bounds(scene: &Scene) -> Vec<Aabb> {
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

/// Answers rays from displacement fields, one for every distinct mesh.
///
/// Knows distances but no triangles. What is inside an object's sphere and hidden from everywhere on the sphere does not
/// exist for it.
#[derive(Clone, Debug)]
pub struct FieldTracer {
    scene: Arc<Scene>,
    selection: Selection,
    /// For every mesh of the scene; empty where none is needed.
    objects: Vec<Object>,
    /// Of every mesh.
    bounds: Vec<Aabb>,
    look_up: LookUp,
    placed: Vec<Placed>,
    top: Top,
    far: Option<(Vec3, f32)>,
}

/// A field placed in the world.
#[derive(Clone, Debug)]
struct Placed {
    /// From the world to the space where the sphere is the unit sphere.
    to_unit: Affine3A,
    field: Arc<Field>,
    instance: u32,
    /// In the world.
    sphere: Sphere,
    /// How far off answers may be, radii.
    slack: f32,
}

impl FieldTracer {
    /// Places objects: one for every mesh of the scene, which may be empty for those that [`meshes`] does not name.
    ///
    /// # Errors
    /// [`Error::Transform`] for an instance that is not only turned, moved, mirrored and scaled uniformly;
    /// [`Error::Scene`] when nothing is selected; [`Error::Parameter`] when an object is missing.
    pub fn new(
        scene: &Arc<Scene>,
        selection: &Selection,
        objects: Vec<Object>,
        look_up: LookUp,
    ) -> Result<Self> {
        let missing = |index: &usize| {
            objects
                .get(*index)
                .is_none_or(|object| object.parts.is_empty())
        };
        if let Some(index) = meshes(scene, selection).into_iter().find(missing) {
            return Err(Error::Parameter {
                name: "a mesh without an object",
                value: format!("{index} ('{}')", scene.meshes[index].name),
                expected: "every mesh of a selected instance needs a field",
            });
        }
        let mut tracer = Self {
            scene: scene.clone(),
            selection: *selection,
            objects,
            bounds: bounds(scene),
            look_up,
            placed: Vec::new(),
            top: Top::default(),
            far: None,
        };
        tracer.place(&scene.transforms())?;
        if tracer.placed.is_empty() {
            let reason = "no triangle is selected".into();
            return Err(isophote_scene::Error::NoGeometry { reason }.into());
        }
        Ok(tracer)
    }

    /// Moves the instances, as [`BuildTracer::update`](isophote_scene::BuildTracer::update): nothing is precomputed but the
    /// tree over the spheres.
    ///
    /// # Errors
    /// As [`new`](Self::new); the instances then are where they were.
    pub fn update(&mut self, transforms: &[Affine3A]) -> Result<()> {
        check_transforms(&self.scene, transforms)?;
        self.place(transforms)
    }

    /// Instances further than `radii` of their own from `eye` are answered by their fields of one bit, where they have
    /// any (§4); from the next [`update`](Self::update) on. `None` takes that back.
    pub fn look_from(&mut self, eye: Option<(Vec3, f32)>) {
        self.far = eye;
    }

    /// Which samples answer a ray, from now on.
    pub fn set_look_up(&mut self, look_up: LookUp) {
        self.look_up = look_up;
    }

    /// The objects, one for every mesh of the scene.
    pub fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// Bytes of all fields, and of the tree over their spheres.
    pub fn bytes(&self) -> usize {
        let fields: usize = self.objects.iter().map(Object::bytes).sum();
        fields + size_of_val(&self.placed[..]) + self.top.bytes()
    }

    /// Spheres placed in the world.
    pub fn spheres(&self) -> impl Iterator<Item = Sphere> {
        self.placed.iter().map(|placed| placed.sphere)
    }

    /// The distance from a point to the closest surface of an instance, metres, about as exact as
    /// [`tolerance`](Tracer::tolerance) says: see [`Field::closest`]. `None` where nothing is within `limit`.
    pub fn closest(&self, point: Vec3, limit: f32) -> Option<(f32, u32)> {
        let mut best: Option<(f32, u32)> = None;
        self.top.near(point, limit, |index, limit| {
            let placed = &self.placed[index];
            let scale = placed.sphere.radius;
            if let Some(found) = placed.field.closest(placed.to_unit.transform_point3(point)) {
                let distance = scale * found;
                if distance < *limit {
                    *limit = distance;
                    best = Some((distance, placed.instance));
                }
            }
        });
        best
    }

    fn place(&mut self, transforms: &[Affine3A]) -> Result<()> {
        let mut placed = Vec::with_capacity(self.placed.len());
        for (instance, transform) in transforms.iter().enumerate() {
            let mesh = self.scene.instances[instance].mesh as usize;
            let bounds = &self.bounds[mesh];
            if !is_selected(&self.scene, instance, bounds, transform, &self.selection) {
                continue;
            }
            let scale = uniform_scale(transform).map_err(|what| Error::Transform {
                instance,
                name: self.scene.instances[instance].name.clone(),
                what,
            })?;
            let object = &self.objects[mesh];
            let first = placed.len();
            placed.extend(
                object
                    .parts
                    .iter()
                    .map(|field| Placed::new(field, instance as u32, transform, scale)),
            );
            let is_far = |placed: &Placed| {
                self.far.is_some_and(|(eye, radii)| {
                    placed.sphere.center.distance(eye) > radii * placed.sphere.radius
                })
            };
            for (placed, distant) in placed[first..].iter_mut().zip(&object.distant) {
                if is_far(placed) {
                    placed.field = distant.clone();
                }
            }
        }
        self.top = Top::new(placed.iter().map(|placed| placed.sphere));
        self.placed = placed;
        Ok(())
    }

    fn trace<const ANY: bool>(&self, ray: &Ray, start: SurfaceId) -> Option<f32> {
        if !ray.is_valid() {
            return None;
        }
        let mut found = None;
        let mut rest = *ray;
        self.top.visit(ray, |index, limit| {
            let placed = &self.placed[index];
            rest.t_max = *limit;
            let own = start.instance == placed.instance;
            if let Some(t) = placed.hit::<ANY>(&rest, self.look_up, own) {
                found = Some(t);
                *limit = if ANY { f32::NEG_INFINITY } else { t };
            }
        });
        found
    }
}

/// The scale of a transform that keeps angles, or what else it does.
fn uniform_scale(transform: &Affine3A) -> Result<f32, &'static str> {
    let matrix = glam::DMat3::from_cols(
        Vec3::from(transform.matrix3.x_axis).as_dvec3(),
        Vec3::from(transform.matrix3.y_axis).as_dvec3(),
        Vec3::from(transform.matrix3.z_axis).as_dvec3(),
    );
    let scale = matrix.determinant().abs().cbrt();
    if !transform.is_finite() || !(1e-15..=1e15).contains(&scale) {
        return Err("flattened, or scaled out of range");
    }
    let square = matrix.transpose() * matrix * (1.0 / (scale * scale));
    let [x, y, z] = [square.x_axis, square.y_axis, square.z_axis];
    let uneven = [x.x, y.y, z.z].map(|length| (length - 1.0).abs());
    let sheared = [x.y, x.z, y.z].map(f64::abs);
    if uneven.into_iter().chain(sheared).any(|off| off > 2e-3) {
        return Err("sheared, or scaled by different amounts along its axes");
    }
    Ok(scale as f32)
}

/// Where a ray and a sphere overlap: in radii along the ray.
#[derive(Clone, Copy, Debug)]
struct Span {
    chord: Chord,
    /// Lengths of the ray's direction in a radius.
    unit: f32,
    /// Where the ray starts.
    start: f32,
    /// Whether it can hit anything.
    meets: bool,
}

impl Span {
    #[inline(always)]
    fn enter(&self) -> f32 {
        self.chord.at - self.chord.half
    }

    #[inline(always)]
    fn leave(&self) -> f32 {
        self.chord.at + self.chord.half
    }

    /// Whether the ray starts within the sphere: what lies before it has to be looked up from behind.
    #[inline(always)]
    fn is_inside(&self) -> bool {
        self.start > self.enter()
    }

    /// Of a distance along the line, in lengths of the ray's direction.
    #[inline(always)]
    fn t(&self, distance: f32) -> f32 {
        distance * self.unit
    }
}

impl Placed {
    fn new(field: &Arc<Field>, instance: u32, transform: &Affine3A, scale: f32) -> Self {
        let sphere = field.sphere();
        let to_sphere = Affine3A::from_scale_rotation_translation(
            Vec3::splat(1.0 / sphere.radius),
            glam::Quat::IDENTITY,
            -sphere.center / sphere.radius,
        );
        Self {
            to_unit: to_sphere * transform.inverse(),
            field: field.clone(),
            instance,
            sphere: Sphere {
                center: transform.transform_point3(sphere.center),
                radius: scale * sphere.radius,
            },
            slack: field.tolerance() / sphere.radius,
        }
    }

    /// The part of a ray within the sphere; total for any ray.
    #[inline(always)]
    fn span(&self, ray: &Ray) -> Span {
        let matrix = &self.to_unit.matrix3;
        let of = |axis: glam::Vec3A| Vec3::new(axis.x, axis.y, axis.z);
        let (x, y, z) = (of(matrix.x_axis), of(matrix.y_axis), of(matrix.z_axis));
        let shift = of(self.to_unit.translation);
        let origin = x * ray.origin.x + y * ray.origin.y + z * ray.origin.z + shift;
        let turned = x * ray.direction.x + y * ray.direction.y + z * ray.direction.z;
        // Squares of very long and very short directions would leave the range.
        let largest = turned.x.abs().max(turned.y.abs()).max(turned.z.abs());
        let scaled = turned * (1.0 / largest);
        let length = scaled.length_squared().sqrt();
        let direction = scaled * (1.0 / length);
        let length = length * largest;
        let chord = Chord::new(origin, direction);
        let (start, end) = (ray.t_min * length, ray.t_max * length);
        // Whatever is NaN makes one of these false.
        let meets = (chord.half > 0.0)
            & (chord.at + chord.half > start)
            & (chord.at - chord.half < end)
            & (ray.t_min >= 0.0)
            & (ray.t_min < ray.t_max);
        Span {
            chord,
            unit: 1.0 / length,
            start,
            meets,
        }
    }

    /// Where a ray hits, if it does. `own` rays start on the object itself and do not hit what is nearer than the field's
    /// error.
    ///
    /// Any and closest agree: a ray from within hits if the chord's last surface is in its range, or lies before it and
    /// the first is in its range.
    fn hit<const ANY: bool>(&self, ray: &Ray, look_up: LookUp, own: bool) -> Option<f32> {
        let span = self.span(ray);
        if !span.meets {
            return None;
        }
        let first = || {
            let distance = self.field.distance(&span.chord, false, look_up);
            span.t(span.enter() + distance)
        };
        let is_before_end = |t: f32| t < ray.t_max;
        if !span.is_inside() {
            return Some(first()).filter(|&t| t > ray.t_min && is_before_end(t));
        }
        let distance = self.field.distance(&span.chord, true, look_up);
        let last = span.t(span.leave() - distance);
        let start = ray.t_min + if own { span.t(self.slack) } else { 0.0 };
        // Minus infinity where nothing is hit.
        if last <= start {
            return None;
        }
        if ANY && is_before_end(last) {
            return Some(last);
        }
        let first = first();
        let t = if first > start { first.min(last) } else { last };
        Some(t).filter(|&t| is_before_end(t))
    }
}

/// Rays that are sorted out together.
const BLOCK: usize = 256;
/// Rays that are looked up together.
const LANES: usize = 16;

/// Rays that meet a sphere, and what became of them.
struct Group {
    question: Question<LANES>,
    /// Where the chord is looked up from, and the sign of the way from there: t = (end + sign · distance) · unit.
    end: [f32; LANES],
    sign: [f32; LANES],
    unit: [f32; LANES],
    /// 1 where the ray can hit anything.
    meets: [f32; LANES],
}

impl Placed {
    /// Whether a ray's line may meet the sphere before the ray: a cheap test that lets no ray go that [`Self::span`] takes.
    #[inline(always)]
    fn may_meet(&self, ray: &Ray) -> bool {
        let away = self.sphere.center - ray.origin;
        let radius = self.sphere.radius * 1.001;
        let (ahead, length) = (away.dot(ray.direction), ray.direction.length_squared());
        let outside = away.length_squared() - radius * radius;
        let misses =
            (outside > 0.0) & ((ahead < 0.0) | (ahead * ahead < 0.9999 * outside * length));
        !misses
    }

    /// [`hit`](Self::hit) of many rays that start elsewhere.
    #[inline(always)]
    fn any_hits<S: Store, P: Sites, D: Mapping>(
        &self,
        maps: &Maps<'_, S, P, D>,
        look_up: LookUp,
        rays: &[Ray],
        hits: &mut [bool],
    ) {
        for (rays, hits) in rays.chunks(BLOCK).zip(hits.chunks_mut(BLOCK)) {
            hits.fill(false);
            let (mut list, mut count) = ([0_usize; BLOCK + LANES], 0);
            for (index, ray) in rays.iter().enumerate() {
                list[count] = index;
                count += usize::from(self.may_meet(ray));
            }
            for first in (0..count).step_by(LANES) {
                let Some(lanes) = list[first..].first_chunk::<LANES>() else {
                    break;
                };
                let group = self.group(rays, lanes);
                let distances = maps.distances(&group.question, look_up);
                for (lane, &index) in lanes.iter().enumerate().take(count - first) {
                    let ray = &rays[index];
                    let t =
                        (group.end[lane] + group.sign[lane] * distances[lane]) * group.unit[lane];
                    let meets = group.meets[lane] > 0.0;
                    hits[index] = if meets & (group.sign[lane] < 0.0) & (t >= ray.t_max) {
                        self.hit::<true>(ray, look_up, false).is_some()
                    } else {
                        meets & (t > ray.t_min) & (t < ray.t_max)
                    };
                }
            }
        }
    }

    #[inline(always)]
    #[expect(
        clippy::needless_range_loop,
        reason = "a lane is of several arrays at once"
    )]
    fn group(&self, rays: &[Ray], lanes: &[usize; LANES]) -> Group {
        let mut group = Group {
            question: Question {
                middle: [[0.0; LANES]; 3],
                toward: [[0.0; LANES]; 3],
                half: [0.0; LANES],
            },
            end: [0.0; LANES],
            sign: [0.0; LANES],
            unit: [0.0; LANES],
            meets: [0.0; LANES],
        };
        let mut numbers = [[0.0; LANES]; 8];
        for (lane, &index) in lanes.iter().enumerate() {
            let Ray {
                origin: o,
                t_min,
                direction: d,
                t_max,
            } = rays[index];
            for (row, value) in numbers
                .iter_mut()
                .zip([o.x, o.y, o.z, t_min, d.x, d.y, d.z, t_max])
            {
                row[lane] = value;
            }
        }
        for lane in 0..LANES {
            let [x, y, z, t_min, u, v, w, t_max] =
                [0, 1, 2, 3, 4, 5, 6, 7].map(|row| numbers[row][lane]);
            let span = self.span(&Ray {
                origin: Vec3::new(x, y, z),
                t_min,
                direction: Vec3::new(u, v, w),
                t_max,
            });
            let chord = &span.chord;
            let sign = if span.is_inside() { -1.0 } else { 1.0 };
            let toward = sign * chord.direction;
            group.question.half[lane] = chord.half;
            group.question.middle[0][lane] = chord.middle.x;
            group.question.middle[1][lane] = chord.middle.y;
            group.question.middle[2][lane] = chord.middle.z;
            group.question.toward[0][lane] = toward.x;
            group.question.toward[1][lane] = toward.y;
            group.question.toward[2][lane] = toward.z;
            group.end[lane] = chord.at - sign * chord.half;
            group.sign[lane] = sign;
            group.unit[lane] = span.unit;
            group.meets[lane] = if span.meets { 1.0 } else { 0.0 };
        }
        group
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn any_hits_avx2<S: Store, P: Sites, D: Mapping>(
        &self,
        maps: &Maps<'_, S, P, D>,
        look_up: LookUp,
        rays: &[Ray],
        hits: &mut [bool],
    ) {
        self.any_hits(maps, look_up, rays, hits);
    }

    fn any_hits_best<S: Store, P: Sites, D: Mapping>(
        &self,
        maps: &Maps<'_, S, P, D>,
        look_up: LookUp,
        rays: &[Ray],
        hits: &mut [bool],
    ) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            #[expect(unsafe_code, reason = "calls code for a processor found at run time")]
            // SAFETY: the processor has just been asked for AVX2 and FMA, all that the function needs.
            return unsafe { self.any_hits_avx2(maps, look_up, rays, hits) };
        }
        self.any_hits(maps, look_up, rays, hits);
    }
}

fn hit(t: f32) -> Hit {
    Hit {
        t,
        uv: Vec2::ZERO,
        surface: SurfaceId::UNKNOWN,
    }
}

impl Tracer for FieldTracer {
    fn answers(&self) -> Answers {
        Answers::Distance
    }

    /// The coarsest [`Field::tolerance`] of the spheres that hold the point.
    fn tolerance(&self, point: Vec3) -> f32 {
        let mut tolerance = 0.0_f32;
        self.top.near(point, 0.0, |index, _| {
            let placed = &self.placed[index];
            if placed.sphere.center.distance(point) <= placed.sphere.radius {
                tolerance = tolerance.max(placed.slack * placed.sphere.radius);
            }
        });
        tolerance
    }

    fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.trace::<false>(ray, SurfaceId::UNKNOWN).map(hit)
    }

    fn any_hit(&self, ray: &Ray) -> bool {
        self.trace::<true>(ray, SurfaceId::UNKNOWN).is_some()
    }

    fn closest_hit_from(&self, ray: &Ray, start: SurfaceId) -> Option<Hit> {
        self.trace::<false>(ray, start).map(hit)
    }

    fn any_hit_from(&self, ray: &Ray, start: SurfaceId) -> bool {
        self.trace::<true>(ray, start).is_some()
    }

    fn any_hits(&self, rays: &[Ray], hits: &mut [bool]) {
        assert_eq!(rays.len(), hits.len(), "one answer per ray");
        match &self.placed[..] {
            [placed] => with_maps!(&placed.field, maps => {
                placed.any_hits_best(&maps, self.look_up, rays, hits);
            }),
            _ => {
                for (ray, hit) in rays.iter().zip(hits) {
                    *hit = self.any_hit(ray);
                }
            }
        }
    }
}
