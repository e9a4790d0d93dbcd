//! Positions and directions: every inverse gives back what it was given, and the nearest sample is near.
use std::collections::{BTreeSet, HashMap};

use glam::{Vec2, Vec3};
use isophote_displacement_field::{Directions, FieldParams, Positions, Storage};
use isophote_scene::sample::{Sampler, uniform_sphere};
use proptest::prelude::*;

const POSITIONS: [Positions; 9] = [
    Positions::Slater { rings: 1 },
    Positions::Slater { rings: 2 },
    Positions::Slater { rings: 8 },
    Positions::Slater { rings: 32 },
    Positions::PAPER_SPHERICAL,
    Positions::Spherical {
        rows: 2,
        columns: 3,
    },
    Positions::Octahedral { side: 2 },
    Positions::Octahedral { side: 33 },
    Positions::Octahedral { side: 64 },
];

fn direction(index: u32) -> Vec3 {
    uniform_sphere(Sampler::new(0, 0, index).get_2d(0))
}

#[test]
fn there_are_as_many_as_in_the_paper() {
    let slater = [8, 16, 32, 64].map(|rings| Positions::Slater { rings }.count());
    assert_eq!(slater, [290, 1090, 4226, 16642]);
    assert_eq!(Positions::PAPER_SPHERICAL.count(), 1122);
}

#[test]
fn points_are_nearest_to_themselves() {
    for positions in POSITIONS {
        for index in 0..positions.count() {
            let point = positions.point(index);
            assert!((point.length() - 1.0).abs() < 1e-6);
            assert_eq!(
                positions.nearest(point) as usize,
                index,
                "{positions:?} {point}"
            );
            let weight: f32 = positions
                .around(point)
                .into_iter()
                .filter(|corner| corner.0 as usize == index)
                .map(|corner| corner.1)
                .sum();
            assert!(weight > 0.99, "{positions:?} {index}: {weight}");
        }
    }
}

#[test]
fn the_nearest_is_within_reach_and_mostly_the_nearest() {
    for positions in POSITIONS {
        let points: Vec<Vec3> = (0..positions.count()).map(|i| positions.point(i)).collect();
        let (mut furthest, mut excess) = (0.0_f32, 0.0);
        let count = 2000;
        for index in 0..count {
            let direction = direction(index);
            let found = points[positions.nearest(direction) as usize].distance(direction);
            let best = points
                .iter()
                .map(|point| point.distance(direction))
                .fold(f32::INFINITY, f32::min);
            furthest = furthest.max(found);
            excess += (found - best) / count as f32;
        }
        assert!(
            furthest <= positions.reach(),
            "{positions:?}: {furthest} {}",
            positions.reach()
        );
        assert!(
            excess <= 0.05 * positions.reach(),
            "{positions:?}: {excess}"
        );
    }
}

/// Whatever the numbers are, there are points.
#[test]
fn numbers_out_of_range_count_as_the_nearest_within() {
    for positions in [
        Positions::Slater { rings: 0 },
        Positions::Slater { rings: u32::MAX },
        Positions::Spherical {
            rows: 0,
            columns: 0,
        },
        Positions::Spherical {
            rows: u32::MAX,
            columns: u32::MAX,
        },
        Positions::Octahedral { side: 0 },
        Positions::Octahedral { side: 50_000 },
    ] {
        let count = positions.count();
        assert!((2..=600_000).contains(&count));
        for direction in [Vec3::Z, Vec3::NEG_Z, direction(7)] {
            assert!((positions.nearest(direction) as usize) < count);
            let corners = positions.around(direction);
            assert!(corners.iter().all(|corner| (corner.0 as usize) < count));
        }
        let params = FieldParams {
            positions,
            resolution: u32::MAX,
            storage: Storage::Float,
            ..FieldParams::default()
        };
        assert_eq!(params.bytes(), u64::MAX);
    }
}

/// No corner of a neighbouring triangle is within the circle around a triangle's own: beyond its plane, on a sphere.
#[test]
fn the_triangles_of_positions_are_delaunays() {
    for rings in [1, 2, 3, 8, 16] {
        let positions = Positions::Slater { rings };
        // Those that interpolation is over, found by asking all over the sphere.
        let mut triangles = BTreeSet::new();
        for index in 0..60_000 {
            let corners = positions.around(direction(index));
            if corners.iter().all(|corner| corner.1 > 1e-3) {
                let mut triangle = corners.map(|corner| corner.0 as usize);
                triangle.sort_unstable();
                triangles.insert(triangle);
            }
        }
        assert_eq!(triangles.len(), 2 * positions.count() - 4, "{rings}");
        let mut opposite: HashMap<[usize; 2], Vec<usize>> = HashMap::new();
        for &[a, b, c] in &triangles {
            for ([from, to], third) in [([a, b], c), ([b, c], a), ([a, c], b)] {
                opposite.entry([from, to]).or_default().push(third);
            }
        }
        let point = |index: usize| positions.point(index).as_dvec3();
        for ([a, b], thirds) in opposite {
            let [c, d] = thirds[..] else {
                panic!("{rings}: {thirds:?} at {a} and {b}");
            };
            let normal = (point(b) - point(a)).cross(point(c) - point(a)).normalize();
            let outward = normal * normal.dot(point(a)).signum();
            let beyond = outward.dot(point(d) - point(a));
            assert!(beyond < 1e-6, "{rings}: {beyond} at {a} and {b}");
        }
    }
}

/// Each point stands for the same area, but for spherical coordinates.
#[test]
fn positions_are_spread_evenly() {
    for positions in [
        Positions::Slater { rings: 8 },
        Positions::Octahedral { side: 17 },
    ] {
        let mut hits = vec![0.0; positions.count()];
        let each = 256;
        for index in 0..each * positions.count() as u32 {
            hits[positions.nearest(direction(index)) as usize] += 1.0 / f64::from(each);
        }
        for (index, share) in hits.into_iter().enumerate() {
            assert!(
                (share - 1.0_f64).abs() < 0.3,
                "{positions:?} {index}: {share}"
            );
        }
    }
}

proptest! {
    #[test]
    fn weights_are_shares_of_points_around(index in any::<u32>(), which in 0_usize..9) {
        let (direction, positions) = (direction(index), POSITIONS[which]);
        let corners = positions.around(direction);
        let sum: f32 = corners.iter().map(|corner| corner.1).sum();
        prop_assert!((sum - 1.0).abs() < 1e-4);
        for (point, weight) in corners {
            prop_assert!(weight >= -1e-4, "{weight}");
            prop_assert!((point as usize) < positions.count());
            let apart = positions.point(point as usize).distance(direction);
            prop_assert!(weight < 0.01 || apart <= 2.6 * positions.reach(), "{positions:?} {direction} {apart}");
        }
        if let Positions::Slater { rings: 8.. } = positions {
            // Their weighted mean is the direction, up to the curvature of the triangle.
            let mean: Vec3 = corners.iter().map(|c| positions.point(c.0 as usize) * c.1).sum();
            prop_assert!(mean.distance(direction) < 0.35 * positions.reach(), "{}", mean.distance(direction));
        }
    }

    /// A small step changes what is interpolated little: across triangles, quadrants and the equator.
    #[test]
    fn weights_are_continuous(index in any::<u32>(), rings in 1_u32..20, toward in any::<u32>()) {
        let positions = Positions::Slater { rings };
        let value = |direction: Vec3| -> f32 {
            let corners = positions.around(direction);
            corners.iter().map(|c| c.1 * positions.point(c.0 as usize).dot(Vec3::new(0.3, 0.5, 0.8))).sum()
        };
        let here = direction(index);
        // Half of them at the seams.
        let here = match index % 4 {
            0 => Vec3::new(here.x, here.y, 0.0).normalize(),
            1 => Vec3::new(0.0, here.y, here.z).normalize(),
            _ => here,
        };
        let there = (here + 1e-4 * direction(toward)).normalize();
        prop_assert!((value(here) - value(there)).abs() < 1e-3 * (1.0 + 8.0 / rings as f32));
    }

    #[test]
    fn places_come_back(x in 0.0_f32..1.0, y in 0.0_f32..1.0, which in 0_usize..3) {
        let directions = Directions::ALL[which];
        if let Some(direction) = directions.direction(Vec2::new(x, y)) {
            prop_assert!((direction.length() - 1.0).abs() < 1e-5 && direction.z >= 0.0);
            let place = directions.place(direction);
            let apart = directions.direction(place).unwrap().distance(direction);
            prop_assert!(apart < 5e-3, "{directions:?} {x} {y}: {place}");
            // Angles are lost at the pole.
            let near_pole = directions == Directions::Polar && x < 1e-2;
            prop_assert!(near_pole || place.distance(Vec2::new(x, y)) < 2e-3 , "{directions:?} {x} {y}: {place}");
        }
    }

    #[test]
    fn directions_come_back(index in any::<u32>(), which in 0_usize..3) {
        let directions = Directions::ALL[which];
        let mut direction = direction(index);
        direction.z = direction.z.abs();
        // The disk's rim is one number wide.
        if let Some(found) = directions.direction(directions.place(direction)) {
            prop_assert!(found.distance(direction) < 5e-3, "{directions:?} {direction} {found}");
        } else {
            prop_assert!(directions == Directions::Rejection && direction.z < 2e-3);
        }
    }
}

#[test]
fn cells_hold_their_own_directions() {
    for directions in Directions::ALL {
        for resolution in [1, 2, 3, 5, 32, 33] {
            let mut used = 0;
            for cell in 0..resolution * resolution {
                let place = Vec2::new((cell % resolution) as f32, (cell / resolution) as f32) + 0.5;
                if let Some(direction) = directions.direction(place / resolution as f32) {
                    assert_eq!(
                        directions.cell(direction, resolution),
                        cell,
                        "{directions:?}"
                    );
                    used += 1;
                }
            }
            let all = resolution * resolution;
            // The paper leaves out 21.5 % of the square.
            let expected = if directions == Directions::Rejection && resolution > 30 {
                0.77 * all as f32..0.80 * all as f32
            } else {
                1.0..all as f32 + 1.0
            };
            assert!(
                expected.contains(&(used as f32)),
                "{directions:?} {resolution}: {used}"
            );
        }
    }
}

/// Directions by uniform places have the density that is stated: cosθ is integrated right.
#[test]
fn densities_integrate() {
    for directions in Directions::ALL {
        let (mut sum, mut count) = (0.0, 0.0);
        for index in 0..40_000 {
            if let Some(direction) = directions.direction(Sampler::new(1, 0, index).get_2d(0)) {
                sum += f64::from(direction.z * direction.z / directions.density(direction));
                count += 1.0;
            }
        }
        // ∫ cos²θ dω over the hemisphere.
        let expected = 2.0 * std::f64::consts::PI / 3.0;
        assert!(
            (sum / count / expected - 1.0).abs() < 0.01,
            "{directions:?}: {}",
            sum / count
        );
    }
}
