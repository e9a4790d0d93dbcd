//! One suite for every tracer: rays of many kinds, asked of the tracer and of an oracle, and the differences counted.
//!
//! [`conformance`] checks what must hold for every tracer whatever its accuracy (degenerate rays miss, the range of a
//! ray is respected, the length of its direction does not matter, batches answer as single rays do, any hit agrees with
//! closest hit) and measures what may differ: hits that are missing or invented, surfaces that rays leak through, and
//! quantiles of the error in t. What is allowed of the latter is said by [`Tolerances`]; an exact tracer is allowed
//! nothing but rounding.
//!
//! Beside it there is what tests of techniques share: [`mean`] and [`relative_rmse`] of pictures, and [`Golden`], numbers
//! that must stay as they were.

mod difference;
mod golden;

use std::fmt;

use glam::{Vec2, Vec3};

pub use self::{
    difference::{mean, relative_rmse},
    golden::{Golden, Metrics},
};
use crate::{
    Aabb, Agreement, Answers, Hit, Ray, Scene, SurfaceId, Tracer,
    sample::{Frame, Sampler, cosine_hemisphere, uniform_sphere, uniform_triangle},
};

/// What a tracer may get wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerances {
    /// Share of all rays that may hit where the oracle misses.
    pub false_hits: f64,
    /// Share of the rays that the oracle says hit which may miss, or pass the surface by more than the error in t.
    pub leaks: f64,
    /// An error in t up to this, relative to the larger of t and the scene's diagonal, is none.
    pub t_error: f32,
    /// Share of the hits of both that may lie before the oracle's by more than the error in t.
    pub early: f64,
}

impl Tolerances {
    /// What exact tracers must keep to: rounding only.
    pub const EXACT: Self = Self {
        false_hits: 0.0,
        leaks: 0.0,
        t_error: 1e-6,
        early: 0.0,
    };
}

/// What the suite found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// How well the tracer answered each kind of rays.
    pub kinds: Vec<(RayKind, Agreement)>,
    /// What was broken, in words; empty when the tracer passes.
    pub violations: Vec<String>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (kind, found) in &self.kinds {
            writeln!(
                f,
                "{:<12} {:>8} rays, {:>8} hit; false hits {}, false misses {}, late {}, early {}; error in t \
                 50/90/99/99.9/100 %: {:?}",
                format!("{kind:?}"),
                found.rays,
                found.hits,
                found.false_hits,
                found.false_misses,
                found.late,
                found.early,
                found.t_error
            )?;
        }
        self.violations
            .iter()
            .try_for_each(|violation| writeln!(f, "violated: {violation}"))
    }
}

/// The kinds of rays that the suite asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RayKind {
    /// From anywhere in and around the scene in any direction.
    Uniform,
    /// From surfaces, cosine-distributed on either side.
    Diffuse,
    /// From surfaces, almost along them.
    Grazing,
    /// From anywhere, parallel to an axis.
    Axis,
    /// From one surface to another, so that only what is between may be hit.
    Segment,
    /// Aimed at a corner or the middle of an edge of a triangle.
    Edge,
}

impl RayKind {
    /// Every kind.
    pub const ALL: [Self; 6] = [
        Self::Uniform,
        Self::Diffuse,
        Self::Grazing,
        Self::Axis,
        Self::Segment,
        Self::Edge,
    ];
}

/// The corners of a triangle and the middles of its edges, in barycentric coordinates.
const EDGES: [Vec2; 6] = [
    Vec2::ZERO,
    Vec2::X,
    Vec2::Y,
    Vec2::new(0.5, 0.0),
    Vec2::new(0.0, 0.5),
    Vec2::new(0.5, 0.5),
];

/// Rays of a kind through a scene that has triangles; the same for the same seed.
///
/// # Panics
/// If the scene has no triangles.
pub fn rays(scene: &Scene, kind: RayKind, count: usize, seed: u64) -> Vec<Ray> {
    let bounds = scene.bounds();
    let surfaces = Surfaces::of(scene);
    (0..count)
        .map(|index| {
            let sampler = Sampler::new(seed, kind as u32, index as u32);
            let anywhere = |dimension| {
                let (xy, z) = (sampler.get_2d(dimension), sampler.get_1d(dimension + 1));
                bounds.center() + (xy.extend(z) - 0.5) * 1.2 * (bounds.max - bounds.min)
            };
            match kind {
                RayKind::Uniform => Ray::new(anywhere(0), uniform_sphere(sampler.get_2d(2))),
                RayKind::Axis => {
                    let axis = (sampler.get_1d(2) * 6.0) as usize;
                    let direction = Vec3::AXES[axis % 3] * if axis < 3 { 1.0 } else { -1.0 };
                    Ray::new(anywhere(0), direction)
                }
                RayKind::Diffuse | RayKind::Grazing => surfaces.leaving(scene, kind, &sampler),
                RayKind::Segment => {
                    let [from, to] = [0, 3].map(|dimension| {
                        surfaces.point(
                            scene,
                            sampler.get_1d(dimension),
                            sampler.get_2d(dimension + 1),
                        )
                    });
                    let direction = to.position - from.position;
                    let origin = from.lifted(direction, 0.0);
                    let end = to.lifted(-direction, 0.0);
                    let length = (end - origin).length();
                    Ray::new(origin, (end - origin).normalize_or(Vec3::X)).until(length)
                }
                RayKind::Edge => {
                    let uv = EDGES[(sampler.get_1d(1) * 6.0) as usize % 6];
                    let target = surfaces.point(scene, sampler.get_1d(0), uv);
                    let origin = anywhere(2);
                    Ray::new(origin, (target.position - origin).normalize_or(Vec3::X))
                }
            }
        })
        .collect()
}

/// All triangles of a scene, to choose from.
struct Surfaces(Vec<SurfaceId>);

impl Surfaces {
    fn of(scene: &Scene) -> Self {
        let triangles = |(instance, placed): (usize, &crate::Instance)| {
            let count = scene.mesh(placed).triangles.len() as u32;
            let instance = instance as u32;
            (0..count).map(move |primitive| SurfaceId {
                instance,
                primitive,
            })
        };
        let surfaces: Vec<_> = scene
            .instances
            .iter()
            .enumerate()
            .flat_map(triangles)
            .collect();
        assert!(!surfaces.is_empty(), "the scene has triangles");
        Self(surfaces)
    }

    fn point(&self, scene: &Scene, choice: f32, uv: Vec2) -> crate::SurfacePoint {
        let index = (f64::from(choice) * self.0.len() as f64) as usize;
        scene.point_on(self.0[index.min(self.0.len() - 1)], uv)
    }

    fn leaving(&self, scene: &Scene, kind: RayKind, sampler: &Sampler) -> Ray {
        let point = self.point(
            scene,
            sampler.get_1d(0),
            uniform_triangle(sampler.get_2d(1)),
        );
        let side = if sampler.get_1d(2) < 0.5 { 1.0 } else { -1.0 };
        let mut local = cosine_hemisphere(sampler.get_2d(3));
        if kind == RayKind::Grazing {
            local = (local.truncate().normalize_or(Vec2::X))
                .extend(0.01 * local.z)
                .normalize();
        }
        let direction = Frame::new(side * point.geometric_normal)
            .to_world(local)
            .normalize();
        Ray::new(point.lifted(direction, 0.0), direction)
    }
}

/// Asks a tracer of a scene `count` rays of every kind and compares its answers with those of an oracle, usually a
/// [`BruteForceTracer`](crate::BruteForceTracer) of the same scene.
///
/// # Panics
/// If the scene has no triangles.
pub fn conformance(
    scene: &Scene,
    tracer: &dyn Tracer,
    oracle: &dyn Tracer,
    tolerances: &Tolerances,
    count: usize,
    seed: u64,
) -> Report {
    let mut report = Report::default();
    degenerate_rays_miss(tracer, scene.bounds(), &mut report.violations);
    for kind in RayKind::ALL {
        let rays = rays(scene, kind, count, seed);
        let answers: Vec<Option<Hit>> = rays.iter().map(|ray| tracer.closest_hit(ray)).collect();
        let truth: Vec<Option<Hit>> = rays.iter().map(|ray| oracle.closest_hit(ray)).collect();
        consistent(scene, tracer, kind, &rays, &answers, &mut report.violations);
        let diagonal = scene.bounds().diagonal();
        let allowed = |t: f32| tolerances.t_error * t.max(diagonal);
        let found = Agreement::of(&answers, &truth, allowed);
        judge(
            kind,
            &found,
            tracer.answers(),
            tolerances,
            &mut report.violations,
        );
        report.kinds.push((kind, found));
    }
    report
}

/// Whatever is no ray must miss, not panic, hang or answer.
fn degenerate_rays_miss(tracer: &dyn Tracer, bounds: Aabb, violations: &mut Vec<String>) {
    let inside = Ray::new(bounds.center(), Vec3::new(0.3, -0.8, 0.5));
    let nan = f32::NAN;
    let degenerate = [
        Ray {
            direction: Vec3::ZERO,
            ..inside
        },
        Ray {
            direction: Vec3::new(nan, 1.0, 0.0),
            ..inside
        },
        Ray {
            direction: Vec3::new(0.0, f32::INFINITY, 0.0),
            ..inside
        },
        Ray {
            origin: Vec3::new(0.0, nan, 0.0),
            ..inside
        },
        Ray {
            origin: Vec3::splat(f32::NEG_INFINITY),
            ..inside
        },
        Ray {
            t_min: 2.0,
            t_max: 1.0,
            ..inside
        },
        Ray {
            t_min: nan,
            ..inside
        },
        Ray {
            t_min: -1.0,
            ..inside
        },
        Ray {
            t_max: nan,
            ..inside
        },
        Ray {
            t_max: 0.0,
            ..inside
        },
        Ray {
            t_max: -1.0,
            ..inside
        },
    ];
    let mut batch = [true; 11];
    tracer.any_hits(&degenerate, &mut batch);
    for (ray, batch) in degenerate.iter().zip(batch) {
        if tracer.closest_hit(ray).is_some() || tracer.any_hit(ray) || batch {
            violations.push(format!("{ray:?} hits"));
        }
    }
}

/// What must hold of any tracer's answers among themselves.
fn consistent(
    scene: &Scene,
    tracer: &dyn Tracer,
    kind: RayKind,
    rays: &[Ray],
    answers: &[Option<Hit>],
    violations: &mut Vec<String>,
) {
    let mut wrong = [0_usize; 6];
    let (mut closest, mut any) = (vec![None; rays.len()], vec![false; rays.len()]);
    tracer.closest_hits(rays, &mut closest);
    tracer.any_hits(rays, &mut any);
    for (index, (ray, answer)) in rays.iter().zip(answers).enumerate() {
        wrong[0] += usize::from(closest[index] != *answer);
        wrong[1] +=
            usize::from(any[index] != answer.is_some() || tracer.any_hit(ray) != answer.is_some());
        let Some(hit) = answer else { continue };
        if tracer.answers() >= Answers::Distance {
            wrong[2] += usize::from(!(hit.t > ray.t_min && hit.t < ray.t_max));
            // Cut before its hit the ray meets nothing there; begun behind it, it does not meet it again.
            let before = Ray {
                t_max: hit.t * 0.999 - tracer.tolerance(ray.at(hit.t)),
                ..*ray
            };
            let again = tracer.closest_hit(&before);
            let behind = tracer.closest_hit(&Ray {
                t_min: hit.t,
                ..*ray
            });
            wrong[3] += usize::from(again.is_some() || behind.is_some_and(|next| next.t <= hit.t));
            // The same ray in lengths of a direction four times as long: powers of two leave no rounding to allow for.
            let longer = Ray {
                t_min: 0.25 * ray.t_min,
                direction: 4.0 * ray.direction,
                t_max: 0.25 * ray.t_max,
                ..*ray
            };
            let same = |found: Hit| (4.0 * found.t - hit.t).abs() <= 1e-5 * hit.t;
            wrong[5] += usize::from(!tracer.closest_hit(&longer).is_some_and(same));
        }
        if tracer.answers() >= Answers::Surface {
            let known = scene
                .instances
                .get(hit.surface.instance as usize)
                .is_some_and(|instance| {
                    (hit.surface.primitive as usize) < scene.mesh(instance).triangles.len()
                });
            let inside = hit.uv.min_element() >= -1e-5 && hit.uv.element_sum() <= 1.0 + 1e-5;
            wrong[4] += usize::from(!known || !inside);
        }
    }
    let names = [
        "answers differ between a batch and single rays",
        "any hit disagrees with closest hit",
        "hits lie outside the ray's range",
        "hits change when the ray's range is cut at them",
        "hits name no triangle or lie outside it",
        "hits change with the length of the direction",
    ];
    for (name, count) in names.into_iter().zip(wrong) {
        if count > 0 {
            violations.push(format!("{kind:?}: {count} of {} {name}", rays.len()));
        }
    }
}

fn judge(
    kind: RayKind,
    found: &Agreement,
    answers: Answers,
    allowed: &Tolerances,
    violations: &mut Vec<String>,
) {
    let mut check = |name: &str, value: f64, allowed: f64| {
        if value > allowed {
            violations.push(format!(
                "{kind:?}: {name} {value:.2e}, allowed {allowed:.2e}"
            ));
        }
    };
    check(
        "share of false hits",
        found.false_hit_rate(),
        allowed.false_hits,
    );
    if answers >= Answers::Distance {
        check("leak rate", found.leak_rate(), allowed.leaks);
        check(
            "share of early hits",
            found.early as f64 / found.hits.max(1) as f64,
            allowed.early,
        );
    } else {
        check(
            "leak rate",
            found.false_misses as f64 / found.hits.max(1) as f64,
            allowed.leaks,
        );
    }
}
