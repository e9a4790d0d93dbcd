//! Stage 4: fields placed in a scene answer rays of the world.
//!
//! A ray is taken to the space of each field whose sphere it meets; there its span (`span.rs`) says which part of it can
//! hit, and [`look_up`](super::look_up) what it hits. Moving instances moves spheres and nothing else.

use std::sync::Arc;

use glam::{Affine3A, Vec2, Vec3};
use isophote_scene::{
    Aabb, Answers, Hit, Ray, Scene, Selection, SurfaceId, Tracer, check_transforms,
};

use super::{
    field::Field,
    look_up::LookUp,
    object::{Object, bounds, is_selected},
    placed::{One, Placed, all_hits, in_64_bits},
    top::Top,
    walk::Fields,
};
use crate::{
    Error, Result, Sphere,
    lanes::{self, Kernel, Lanes},
};

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
    /// A field of every kind that is placed.
    kinds: Vec<Arc<Field>>,
    placed: Vec<Placed>,
    top: Top,
    far: Option<(Vec3, f32)>,
}

impl FieldTracer {
    /// Places objects: one for every mesh of the scene, which may be empty for those that
    /// [`meshes`](crate::meshes) does not name.
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
        let mut tracer = Self {
            scene: scene.clone(),
            selection: *selection,
            objects,
            bounds: bounds(scene),
            look_up,
            kinds: Vec::new(),
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
    /// As [`new`](Self::new), also when an instance without an object comes into the selection's bounds; the instances
    /// then are where they were.
    pub fn update(&mut self, transforms: &[Affine3A]) -> Result<()> {
        check_transforms(&self.scene, transforms)?;
        self.place(transforms)
    }

    /// Instances further than `radii` of their own from `eye` are answered by their fields of one bit, where they have
    /// any (§4); from the next [`update`](Self::update) on. `None` takes that back.
    pub fn look_from(&mut self, eye: Option<(Vec3, f32)>) {
        self.far = eye;
    }

    /// Every field of the objects once: levels of detail of a mesh may share one.
    pub(crate) fn distinct(&self) -> Vec<Arc<Field>> {
        let mut fields: Vec<Arc<Field>> = Vec::new();
        for object in &self.objects {
            for field in object.parts.iter().chain(&object.distant) {
                if !fields.iter().any(|known| Arc::ptr_eq(known, field)) {
                    fields.push(field.clone());
                }
            }
        }
        fields
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn scene(&self) -> &Scene {
        &self.scene
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn placed(&self) -> &[Placed] {
        &self.placed
    }

    /// Which samples answer a ray.
    pub const fn look_up(&self) -> LookUp {
        self.look_up
    }

    /// The objects, one for every mesh of the scene.
    pub fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// Bytes of all fields, those that several meshes share once, and of the tree over their spheres.
    pub fn bytes(&self) -> usize {
        let fields: usize = self.distinct().iter().map(|field| field.bytes()).sum();
        fields + size_of_val(&self.placed[..]) + self.top.bytes()
    }

    /// Spheres placed in the world.
    pub fn spheres(&self) -> impl Iterator<Item = Sphere> {
        self.placed.iter().map(|placed| placed.sphere)
    }

    /// The distance from a point to the closest surface of an instance, metres: too far rather than too near, by up to
    /// the distance between samples or where what is closest is hidden, as [`Field::closest`] says. `None` where nothing is
    /// found within `limit`.
    pub fn closest(&self, point: Vec3, limit: f32) -> Option<(f32, u32)> {
        let mut best: Option<(f32, u32)> = None;
        self.top.near(point, limit, |index, limit| {
            let placed = &self.placed[index];
            let scale = placed.sphere.radius;
            if let Some(found) = placed.field.closest(placed.to_unit(point)) {
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
        let (mut placed, mut kinds) = (Vec::with_capacity(self.placed.len()), Vec::new());
        for (instance, transform) in transforms.iter().enumerate() {
            let mesh = self.scene.instances[instance].mesh as usize;
            let bounds = &self.bounds[mesh];
            if !is_selected(&self.scene, instance, bounds, transform, &self.selection) {
                continue;
            }
            let object = self.objects.get(mesh);
            let object = object.filter(|object| !object.parts.is_empty());
            let object = object.ok_or_else(|| self.missing(mesh))?;
            let refused = |what| Error::Transform {
                instance,
                name: self.scene.instances[instance].name.clone(),
                what,
            };
            let scale = uniform_scale(transform).map_err(refused)?;
            for (part, field) in object.parts.iter().enumerate() {
                let place = |field: &Arc<Field>, kinds: &mut Vec<_>| {
                    Placed::new(field, kind(kinds, field), instance as u32, transform, scale)
                };
                let near = place(field, &mut kinds);
                if !near.is_within_range() {
                    return Err(refused(
                        "so small, so large or so far away that 32 bits do not hold it (its sphere may have 1e-15 to 1e15 m)",
                    ));
                }
                let distant = object
                    .distant
                    .get(part)
                    .filter(|_| self.is_far(&near.sphere));
                placed.push(match distant {
                    Some(distant) => place(distant, &mut kinds),
                    None => near,
                });
            }
        }
        let spheres: Vec<Sphere> = placed.iter().map(|placed| placed.sphere).collect();
        self.top = Top::new(&spheres);
        (self.placed, self.kinds) = (placed, kinds);
        Ok(())
    }

    fn missing(&self, mesh: usize) -> Error {
        Error::Parameter {
            name: "a mesh without an object",
            value: format!("{mesh} ('{}')", self.scene.meshes[mesh].name),
            expected: "every mesh of a selected instance needs a field",
        }
    }

    fn is_far(&self, sphere: &Sphere) -> bool {
        self.far
            .is_some_and(|(eye, radii)| sphere.center.distance(eye) > radii * sphere.radius)
    }

    fn fields(&self) -> Fields<'_> {
        Fields {
            kinds: &self.kinds,
            placed: &self.placed,
            top: &self.top,
            look_up: self.look_up,
        }
    }

    /// Where one ray hits, which may start on an instance.
    fn trace<const ANY: bool>(&self, ray: &Ray, start: SurfaceId) -> Option<f32> {
        let mut found = f32::INFINITY;
        lanes::run(TraceOne::<ANY, _> {
            fields: self.fields(),
            ray,
            start,
            answer: |t| found = t,
        });
        Some(found).filter(|t| t.is_finite())
    }

    /// Calls with the number of each ray and where it hits, infinite where it does not; of a ray more than once, the last
    /// time counts.
    fn trace_all<const ANY: bool>(&self, rays: &[Ray], answer: impl FnMut(usize, f32)) {
        lanes::run(TraceAll::<ANY, _> {
            fields: self.fields(),
            rays,
            answer,
        });
    }
}

struct TraceOne<'a, const ANY: bool, A> {
    fields: Fields<'a>,
    ray: &'a Ray,
    start: SurfaceId,
    answer: A,
}

impl<const ANY: bool, A: FnMut(f32)> Kernel for TraceOne<'_, ANY, A> {
    type Output = ();

    #[inline(always)]
    fn run<W: Lanes>(mut self) {
        let rays = std::slice::from_ref(self.ray);
        let answer = &mut |_, t| (self.answer)(t);
        self.fields
            .trace::<ANY, 1, f32, W>(rays, self.start, answer);
    }
}

struct TraceAll<'a, const ANY: bool, A> {
    fields: Fields<'a>,
    rays: &'a [Ray],
    answer: A,
}

impl<const ANY: bool, A: FnMut(usize, f32)> Kernel for TraceAll<'_, ANY, A> {
    type Output = ();

    #[inline(always)]
    fn run<W: Lanes>(mut self) {
        match self.fields.placed {
            [placed] => {
                let one = One {
                    placed,
                    look_up: self.fields.look_up,
                };
                all_hits::<ANY, W>(&one, self.rays, &mut self.answer);
            }
            _ => {
                let start = SurfaceId::UNKNOWN;
                self.fields
                    .trace::<ANY, 8, W, W>(self.rays, start, &mut self.answer);
            }
        }
    }
}

/// The number of a field's kind among those there are, to which a new one is added.
fn kind(kinds: &mut Vec<Arc<Field>>, field: &Arc<Field>) -> u32 {
    let known = kinds.iter().position(|kind| kind.is_like(field));
    let index = known.unwrap_or_else(|| {
        kinds.push(field.clone());
        kinds.len() - 1
    });
    index as u32
}

/// The scale of a transform that keeps angles, or what else it does.
fn uniform_scale(transform: &Affine3A) -> Result<f64, &'static str> {
    let matrix = in_64_bits(transform).matrix3;
    let scale = matrix.determinant().abs().cbrt();
    if !transform.is_finite() || scale == 0.0 {
        return Err("flattened, or not finite");
    }
    let square = matrix.transpose() * matrix * (1.0 / (scale * scale));
    let [x, y, z] = [square.x_axis, square.y_axis, square.z_axis];
    let uneven = [x.x, y.y, z.z].map(|length| (length - 1.0).abs());
    let sheared = [x.y, x.z, y.z].map(f64::abs);
    if uneven.into_iter().chain(sheared).any(|off| off > 2e-3) {
        return Err("sheared, or scaled by different amounts along its axes");
    }
    Ok(scale)
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

    /// A quarter of the coarsest [`Field::tolerance`] of the spheres that hold the point: no bound, but what suits most
    /// rays as a lift of their origins. Lifted by all of it, points of a floor would look under what stands on it.
    fn tolerance(&self, point: Vec3) -> f32 {
        let mut tolerance = 0.0_f32;
        self.top.near(point, 0.0, |index, _| {
            let placed = &self.placed[index];
            if placed.sphere.center.distance(point) <= placed.sphere.radius {
                tolerance = tolerance.max(placed.lift() * placed.sphere.radius);
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

    fn closest_hits(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "one answer per ray");
        self.trace_all::<false>(rays, |ray, t| hits[ray] = t.is_finite().then(|| hit(t)));
    }

    fn any_hits(&self, rays: &[Ray], hits: &mut [bool]) {
        assert_eq!(rays.len(), hits.len(), "one answer per ray");
        self.trace_all::<true>(rays, |ray, t| hits[ray] = t.is_finite());
    }
}
