//! The smallest sphere around points.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// A sphere, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Its centre.
    pub center: Vec3,
    /// Its radius.
    pub radius: f32,
}

/// Points within this share of the radius beyond the sphere count as inside.
const ROUNDING: f64 = 1e-10;
/// Each step grows the sphere, so that in exact arithmetic none comes twice; rounding must not make it endless.
const STEPS: usize = 1000;

/// The smallest sphere around finite points, in 64 bits: its centre and radius; `None` without points.
///
/// The sphere of at most four points that hold it is found; then the point furthest outside joins them and one may leave,
/// until none is outside (a simplex method; that at most four points hold the sphere: E. Welzl, "Smallest enclosing disks
/// (balls and ellipsoids)", 1991). A pass over all points for each of some ten steps.
pub(crate) fn smallest(points: &[Vec3]) -> Option<(DVec3, f64)> {
    let first = points.first()?.as_dvec3();
    let mut support = vec![first];
    let (mut center, mut radius) = (first, 0.0);
    for _ in 0..STEPS {
        let (distance, furthest) = furthest(points, center);
        if distance <= radius * (1.0 + ROUNDING) {
            break;
        }
        let Some((next, held)) = around_with(&support, furthest) else {
            // No sphere through these points within rounding: grow the one there is.
            return Some((center, distance));
        };
        (center, radius, support) = (next.0, next.1, held);
    }
    // Whatever rounding left outside.
    Some((center, furthest(points, center).0.max(radius)))
}

fn furthest(points: &[Vec3], center: DVec3) -> (f64, DVec3) {
    let distance = |point: &Vec3| {
        let point = point.as_dvec3();
        (point.distance_squared(center), point)
    };
    let larger = |a: (f64, DVec3), b: (f64, DVec3)| if b.0 > a.0 { b } else { a };
    let start = || (-1.0, DVec3::ZERO);
    // Points at the same distance must not depend on the number of threads: chunks are joined in their order.
    let ends: Vec<_> = points
        .par_chunks(1 << 14)
        .map(|chunk| chunk.iter().map(distance).fold(start(), larger))
        .collect();
    let (squared, point) = ends.into_iter().fold(start(), larger);
    (squared.max(0.0).sqrt(), point)
}

/// The smallest sphere around a few points and a new one, which lies on it; and the points that hold it.
fn around_with(support: &[DVec3], new: DVec3) -> Option<((DVec3, f64), Vec<DVec3>)> {
    let mut best: Option<((DVec3, f64), Vec<DVec3>)> = None;
    for chosen in 0_u32..1 << support.len() {
        let mut held = vec![new];
        held.extend(
            (0..support.len())
                .filter(|index| chosen >> index & 1 == 1)
                .map(|index| support[index]),
        );
        let Some((center, radius)) = through(&held) else {
            continue;
        };
        let inside = |point: &DVec3| point.distance(center) <= radius * (1.0 + 1e-9);
        let smaller = best.as_ref().is_none_or(|best| radius < best.0.1);
        if held.len() <= 4 && smaller && support.iter().all(inside) {
            best = Some(((center, radius), held));
        }
    }
    best
}

/// The smallest sphere through up to four points; `None` where they lie on fewer dimensions than they could.
fn through(points: &[DVec3]) -> Option<(DVec3, f64)> {
    let origin = points[0];
    let sides: Vec<DVec3> = points[1..].iter().map(|point| *point - origin).collect();
    let count = sides.len();
    if count > 3 {
        return None;
    }
    // Its centre is origin + Σ λᵢ sideᵢ with 2 sideᵢ · Σ λⱼ sideⱼ = |sideᵢ|².
    let mut rows = [[0.0; 4]; 3];
    for (row, side) in rows.iter_mut().zip(&sides) {
        let scale = side.length_squared();
        if scale == 0.0 {
            return None;
        }
        for (value, other) in row.iter_mut().zip(&sides) {
            *value = 2.0 * side.dot(*other) / scale;
        }
        row[3] = 1.0;
    }
    let factors = solve(&mut rows, count)?;
    let offset: DVec3 = sides
        .iter()
        .zip(factors)
        .map(|(side, factor)| *side * factor)
        .sum();
    Some((origin + offset, offset.length()))
}

/// Gauss with pivots; the right sides stand in the last column.
fn solve(rows: &mut [[f64; 4]; 3], count: usize) -> Option<[f64; 3]> {
    for column in 0..count {
        let pivot = (column..count)
            .max_by(|&a, &b| rows[a][column].abs().total_cmp(&rows[b][column].abs()))?;
        rows.swap(column, pivot);
        if rows[column][column].abs() < 1e-12 {
            return None;
        }
        for row in 0..count {
            if row != column {
                let factor = rows[row][column] / rows[column][column];
                let pivot = rows[column];
                for (value, of) in rows[row].iter_mut().zip(pivot) {
                    *value -= factor * of;
                }
            }
        }
    }
    let mut factors = [0.0; 3];
    for (index, factor) in factors.iter_mut().enumerate().take(count) {
        *factor = rows[index][3] / rows[index][index];
    }
    Some(factors)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-1.0_f32..1.0).prop_map(Vec3::from)
    }

    proptest! {
        /// It holds every point, and is held by points around its centre: there is no smaller one.
        #[test]
        fn spheres_are_smallest(points in prop::collection::vec(point(), 1..60), scale in -20_i32..20) {
            let points: Vec<Vec3> = points.iter().map(|p| *p * 10_f32.powi(scale)).collect();
            let (center, radius) = smallest(&points).unwrap();
            let distances = points.iter().map(|p| p.as_dvec3().distance(center));
            for distance in distances {
                prop_assert!(distance <= radius * (1.0 + 1e-9));
            }
            // In every direction there is a point of the boundary not behind the centre.
            for direction in 0..200 {
                let axis = crate::Positions::Spherical { rows: 10, columns: 20 }.point(direction).as_dvec3();
                let ahead = points.iter().any(|p| {
                    let side = p.as_dvec3() - center;
                    side.length() >= radius * (1.0 - 1e-6) && side.dot(axis) >= -2e-3 * radius
                });
                prop_assert!(ahead || radius == 0.0, "{axis} {points:?}");
            }
        }
    }

    #[test]
    fn a_cube_and_a_segment() {
        let cube: Vec<Vec3> = (0..8)
            .map(|i| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32))
            .collect();
        let (center, radius) = smallest(&cube).unwrap();
        assert!(
            (radius - 0.75_f64.sqrt()).abs() < 1e-9 && center.distance(DVec3::splat(0.5)) < 1e-9
        );
        let (center, radius) = smallest(&[Vec3::ZERO, Vec3::X, Vec3::X * 0.3]).unwrap();
        assert!((radius - 0.5).abs() < 1e-12 && (center.x - 0.5).abs() < 1e-12);
        assert!(smallest(&[]).is_none());
    }
}
