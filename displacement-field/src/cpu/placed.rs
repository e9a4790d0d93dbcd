//! A field placed in the world, and lanes of rays at such.

use std::sync::Arc;

use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};
use isophote_scene::Ray;

use super::{
    build::SIZES,
    field::Field,
    look_up::{LookUp, Question, with_maps},
    samples::Store,
    span::{Distances, Span},
};
use crate::{
    Sphere,
    lanes::{Lanes, Mask, Two, set_bits},
};

/// The share of a field's largest error that origins are lifted by. Measured: lifted by all of it, the floor's points look
/// under what stands on it, which costs more than what their own objects shadow of the others.
const LIFT: f32 = 0.25;

/// A field placed in the world.
#[derive(Clone, Debug)]
pub(crate) struct Placed {
    /// The rows of the matrix from the world to the space where the sphere is the unit sphere.
    pub(crate) to_unit: [[f32; 4]; 3],
    pub(crate) field: Arc<Field>,
    /// Fields of the same kind are sampled and kept alike.
    pub(crate) kind: u32,
    pub(crate) instance: u32,
    /// In the world.
    pub(crate) sphere: Sphere,
    /// How far off answers may be, radii.
    pub(crate) slack: f32,
}

impl Placed {
    pub(crate) fn new(
        field: &Arc<Field>,
        kind: u32,
        instance: u32,
        transform: &Affine3A,
        scale: f64,
    ) -> Self {
        let sphere = field.sphere();
        let (center, radius) = (sphere.center.as_dvec3(), f64::from(sphere.radius));
        let to_sphere = DAffine3 {
            matrix3: DMat3::from_diagonal(DVec3::splat(1.0 / radius)),
            translation: -center / radius,
        };
        // In 32 bits the determinants of tiny and of huge scales leave the range.
        let to_unit = to_sphere * in_64_bits(transform).inverse();
        let row = |index| {
            let row = to_unit.matrix3.row(index);
            row.extend(to_unit.translation[index]).as_vec4()
        };
        Self {
            to_unit: [0, 1, 2].map(|index| row(index).to_array()),
            field: field.clone(),
            kind,
            instance,
            sphere: Sphere {
                center: transform.transform_point3(sphere.center),
                radius: (scale * radius) as f32,
            },
            slack: field.tolerance() / sphere.radius,
        }
    }

    /// Whether 32 bits hold the squares of its radius, and the way to its space.
    pub(crate) fn is_within_range(&self) -> bool {
        let radius = f64::from(self.sphere.radius);
        // What `Field::build` takes may be placed as it is, though its sphere is a little larger than the mesh.
        (*SIZES.start()..=1.1 * SIZES.end()).contains(&radius)
            && self.sphere.center.is_finite()
            && self
                .to_unit
                .as_flattened()
                .iter()
                .all(|value| value.is_finite())
    }

    /// [`Tracer::tolerance`](isophote_scene::Tracer::tolerance) within the sphere, radii.
    pub(crate) fn lift(&self) -> f32 {
        LIFT * self.slack
    }

    /// A point of the world in the space where the sphere is the unit sphere.
    pub(crate) fn to_unit(&self, point: Vec3) -> Vec3 {
        let point = point.extend(1.0);
        Vec3::from_array(
            self.to_unit
                .map(|row| glam::Vec4::from_array(row).dot(point)),
        )
    }
}

/// A transform, to calculate with.
pub(crate) fn in_64_bits(transform: &Affine3A) -> DAffine3 {
    DAffine3 {
        matrix3: glam::Mat3::from(transform.matrix3).as_dmat3(),
        translation: Vec3::from(transform.translation).as_dvec3(),
    }
}

/// The eight numbers of rays: origin and `t_min`, direction and `t_max`.
#[inline(always)]
pub(crate) fn columns<'r, L: Lanes>(ray: impl Fn(usize) -> &'r Ray) -> [[L; 4]; 2] {
    let half = |ray: &Ray, second: bool| {
        let halves: &[[f32; 4]; 2] = bytemuck::cast_ref(ray);
        halves[usize::from(second)]
    };
    [
        L::columns(
            #[inline(always)]
            |lane| half(ray(lane), false),
        ),
        L::columns(
            #[inline(always)]
            |lane| half(ray(lane), true),
        ),
    ]
}

/// One field for all lanes.
pub(crate) struct One<'a> {
    pub(crate) placed: &'a Placed,
    pub(crate) look_up: LookUp,
}

impl<L: Lanes> Distances<L> for One<'_> {
    #[inline(always)]
    fn distances(&self, question: &Question<L>) -> L {
        let field = &*self.placed.field;
        with_maps!(field, S, maps => {
            let store = <S<'_> as Store<'_>>::of(&field.samples, field.params.cells());
            let stores = L::array(#[inline(always)] |_| store);
            maps.distances::<S<'_>, L>(stores, question, self.look_up)
        })
    }
}

/// A field of its own for each lane.
pub(crate) struct Many<'a, L: Lanes> {
    /// A field of every kind.
    pub(crate) kinds: &'a [Arc<Field>],
    pub(crate) placed: L::Array<&'a Placed>,
    pub(crate) look_up: LookUp,
}

impl<L: Lanes> Distances<L> for Many<'_, L> {
    #[inline(always)]
    fn distances(&self, question: &Question<L>) -> L {
        let kinds = L::of_whole(
            #[inline(always)]
            |lane| self.placed[lane].kind,
        );
        let mut distances = L::splat(f32::INFINITY);
        for (kind, field) in self.kinds.iter().enumerate() {
            let kind = L::splat(kind as f32);
            let others = kinds.less(kind) | kind.less(kinds);
            if (!others).bits() == 0 {
                continue;
            }
            let of_kind = with_maps!(&**field, S, maps => {
                let cells = field.params.cells();
                let stores = L::array(
                    #[inline(always)]
                    |lane| <S<'_> as Store<'_>>::of(&self.placed[lane].field.samples, cells),
                );
                maps.distances::<S<'_>, L>(stores, question, self.look_up)
            });
            distances = L::select(others, distances, of_kind);
        }
        distances
    }
}

/// Where rays hit a field each; infinite where they do not. Rays that start on the field's own instance, which are told by
/// `own`, do not hit what is nearer than the field's error.
#[inline(always)]
pub(crate) fn hits<const ANY: bool, L: Lanes>(
    many: &Many<'_, L>,
    rays: [[L; 4]; 2],
    own: L::Array<bool>,
) -> L {
    let row = |index: usize| {
        L::columns(
            #[inline(always)]
            |lane| many.placed[lane].to_unit[index],
        )
    };
    let span = Span::new(rays, [row(0), row(1), row(2)]);
    if span.meets.bits() == 0 {
        return L::splat(f32::INFINITY);
    }
    let slack = L::of(
        #[inline(always)]
        |lane| {
            if own[lane] {
                many.placed[lane].slack
            } else {
                0.0
            }
        },
    );
    span.hits::<ANY>(slack, many)
}

/// Rays that are sorted out together.
const BLOCK: usize = 256;

/// Where many rays that start elsewhere hit one field: calls with the number of each ray and where it hits, infinite where
/// it does not. First those that pass the sphere by are sorted out, then the others are looked up, a lane each.
#[inline(always)]
pub(crate) fn all_hits<const ANY: bool, L: Lanes>(
    one: &One<'_>,
    rays: &[Ray],
    answer: &mut impl FnMut(usize, f32),
) {
    let rows = one.placed.to_unit.map(|row| row.map(Two::<L>::splat));
    let lanes = Two::<L>::COUNT;
    let mut list = [0_u16; BLOCK + 16];
    for first in (0..rays.len()).step_by(BLOCK) {
        let rays = &rays[first..rays.len().min(first + BLOCK)];
        (0..rays.len()).for_each(|ray| answer(first + ray, f32::INFINITY));
        let count = near_ones::<L>(&one.placed.sphere, rays, &mut list);
        for start in (0..count).step_by(lanes) {
            let list = &list[start..start + lanes];
            // What is left over from before fills the last lanes.
            let last = rays.len() - 1;
            let columns = columns::<Two<L>>(
                #[inline(always)]
                |lane| &rays[usize::from(list[lane]).min(last)],
            );
            let span = Span::new(columns, rows);
            let hits = span.hits::<ANY>(Two::splat(0.0), one);
            let met = hits.less(Two::splat(f32::INFINITY)).bits();
            let hits = hits.to_array();
            for lane in set_bits(met).take_while(|lane| start + lane < count) {
                answer(first + usize::from(list[lane]), hits[lane]);
            }
        }
    }
}

/// Lists the rays that may meet a sphere; how many there are.
#[inline(always)]
fn near_ones<L: Lanes>(sphere: &Sphere, rays: &[Ray], list: &mut [u16; BLOCK + 16]) -> usize {
    let (mut count, last) = (0, rays.len() - 1);
    for start in (0..rays.len()).step_by(L::COUNT) {
        let columns = columns::<L>(
            #[inline(always)]
            |lane| &rays[(start + lane).min(last)],
        );
        let meets = may_meet(sphere, columns).bits();
        for lane in set_bits(meets).take_while(|lane| start + lane <= last) {
            list[count] = (start + lane) as u16;
            count += 1;
        }
    }
    count
}

/// Whether rays' lines may meet a sphere before the rays: a cheap test that lets none go that [`Span`] takes.
#[inline(always)]
fn may_meet<L: Lanes>(sphere: &Sphere, [start, way]: [[L; 4]; 2]) -> L::Mask {
    let k = L::splat;
    let (center, radius) = (sphere.center, sphere.radius * 1.001);
    let (x, y, z) = (
        k(center.x) - start[0],
        k(center.y) - start[1],
        k(center.z) - start[2],
    );
    let ahead = x * way[0] + y * way[1] + z * way[2];
    let length = way[0] * way[0] + way[1] * way[1] + way[2] * way[2];
    let outside = x * x + y * y + z * z - k(radius * radius);
    let apart = (ahead * ahead).less(k(0.9999) * outside * length);
    !(k(0.0).less(outside) & (ahead.less(k(0.0)) | apart))
}
