//! Cuts polygons into triangles.

use earcut::Earcut;
use glam::{DVec2, DVec3, Vec3};

use crate::Result;

/// Beyond so many corners a concave polygon is cut as if it were convex: the time to find ears grows with the square.
const MOST_CORNERS: usize = 20_000;

/// Cuts a polygon of at least three finite corners into triangles with the same winding: as a fan if it is convex,
/// else by cutting off ears in the plane it lies in most.
///
/// Calls `triangle` with the numbers of corners, until that fails.
pub(super) fn triangulate(
    corners: &[Vec3],
    mut triangle: impl FnMut([usize; 3]) -> Result<()>,
) -> Result<()> {
    let count = corners.len();
    if count > 3 && count <= MOST_CORNERS {
        let flat = flatten(corners);
        if !is_convex(&flat) {
            let mut ears = Vec::new();
            let points = flat.iter().map(|point| point.to_array());
            Earcut::new().earcut::<usize>(points, &[], &mut ears);
            if !ears.is_empty() {
                for ear in ears.as_chunks::<3>().0 {
                    let [a, b, c] = *ear;
                    let [pa, pb, pc] = ear.map(|i| flat[i]);
                    let turned = (pb - pa).perp_dot(pc - pa) < 0.0;
                    triangle(if turned { [a, c, b] } else { [a, b, c] })?;
                }
                return Ok(());
            }
        }
    }
    (2..count).try_for_each(|i| triangle([0, i - 1, i]))
}

/// The corners in the axis-aligned plane that shows most of them, counter-clockwise.
fn flatten(corners: &[Vec3]) -> Vec<DVec2> {
    let origin = corners[0].as_dvec3();
    let points: Vec<DVec3> = corners
        .iter()
        .map(|corner| corner.as_dvec3() - origin)
        .collect();
    let next = points.iter().cycle().skip(1);
    // Twice the area vector (Newell).
    let normal: DVec3 = points.iter().zip(next).map(|(a, b)| a.cross(*b)).sum();
    let size = normal.abs();
    let project = |point: &DVec3| {
        if size.z >= size.x && size.z >= size.y {
            DVec2::new(point.x, point.y * normal.z.signum())
        } else if size.x >= size.y {
            DVec2::new(point.y, point.z * normal.x.signum())
        } else {
            DVec2::new(point.z, point.x * normal.y.signum())
        }
    };
    points.iter().map(project).collect()
}

/// Whether a counter-clockwise polygon always turns left, and only once around.
fn is_convex(points: &[DVec2]) -> bool {
    let count = points.len();
    let edge = |i: usize| points[(i + 1) % count] - points[i];
    let turns_left = (0..count).all(|i| edge(i).perp_dot(edge((i + 1) % count)) >= 0.0);
    // Around once, the direction changes between leftwards and rightwards twice; a star does so more often.
    let directions = (0..count).map(|i| edge(i).x).filter(|x| *x != 0.0);
    let directions: Vec<bool> = directions.map(|x| x > 0.0).collect();
    let changes = directions
        .iter()
        .zip(directions.iter().cycle().skip(1))
        .filter(|(a, b)| a != b);
    turns_left && changes.count() <= 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::area;

    fn cut(corners: &[Vec3]) -> Vec<[usize; 3]> {
        let mut triangles = Vec::new();
        triangulate(corners, |triangle| {
            triangles.push(triangle);
            Ok(())
        })
        .unwrap();
        triangles
    }

    fn total_area(corners: &[Vec3]) -> f64 {
        cut(corners)
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.map(|i| corners[i]);
                area(a, b, c)
            })
            .sum()
    }

    fn in_plane(points: &[[f32; 2]], place: fn(f32, f32) -> Vec3) -> Vec<Vec3> {
        points.iter().map(|&[x, y]| place(x, y)).collect()
    }

    const PLANES: [fn(f32, f32) -> Vec3; 4] = [
        |x, y| Vec3::new(x, y, 5.0),
        |x, y| Vec3::new(3.0, x, y),
        |x, y| Vec3::new(y, -2.0, x),
        |x, y| Vec3::new(x, y, x + y),
    ];

    /// An L, whose area is 5.
    const CONCAVE: [[f32; 2]; 6] = [
        [0.0, 0.0],
        [3.0, 0.0],
        [3.0, 1.0],
        [1.0, 1.0],
        [1.0, 3.0],
        [0.0, 3.0],
    ];

    #[test]
    fn concave_polygons_keep_their_area_and_winding() {
        for place in PLANES {
            for reversed in [false, true] {
                let mut corners = in_plane(&CONCAVE, place);
                if reversed {
                    corners.reverse();
                }
                let normal = crate::unit_normal(place(0.0, 0.0), place(1.0, 0.0), place(0.0, 1.0));
                let scale = area(place(0.0, 0.0), place(1.0, 0.0), place(0.0, 1.0)) * 2.0;
                assert!((total_area(&corners) - 5.0 * scale).abs() < 1e-5);
                for start in 0..corners.len() {
                    corners.rotate_left(1);
                    for triangle in cut(&corners) {
                        let [a, b, c] = triangle.map(|i| corners[i]);
                        let side = crate::unit_normal(a, b, c).dot(normal);
                        assert!(if reversed { side < -0.9 } else { side > 0.9 }, "{start}");
                    }
                }
            }
        }
    }

    proptest::proptest! {
        #[test]
        fn stars_of_any_shape_keep_their_area(
            radii in proptest::collection::vec(0.1_f32..10.0, 4..40),
            plane in 0..4_usize,
        ) {
            let count = radii.len() as f32;
            let points: Vec<[f32; 2]> = radii
                .iter()
                .enumerate()
                .map(|(i, radius)| {
                    let angle = i as f32 / count * std::f32::consts::TAU;
                    (glam::Vec2::from_angle(angle) * *radius).to_array()
                })
                .collect();
            let corners = in_plane(&points, PLANES[plane]);
            // The area vector of a flat polygon; f64 as the test's reference.
            let next = corners.iter().cycle().skip(1);
            let origin = corners[0].as_dvec3();
            let vector: DVec3 = corners
                .iter()
                .zip(next)
                .map(|(a, b)| (a.as_dvec3() - origin).cross(b.as_dvec3() - origin))
                .sum();
            let expected = 0.5 * vector.length();
            let found = total_area(&corners);
            proptest::prop_assert!((found / expected - 1.0).abs() < 1e-4, "{} {}", found, expected);
        }
    }

    #[test]
    fn convex_polygons_become_fans() {
        let corners: Vec<Vec3> = (0..100)
            .map(|i| {
                Vec3::from((
                    glam::Vec2::from_angle(i as f32 * 0.01 * std::f32::consts::TAU),
                    0.0,
                ))
            })
            .collect();
        assert_eq!(cut(&corners).len(), 98);
        assert!((total_area(&corners) - 3.1395).abs() < 1e-3);
    }

    #[test]
    fn nothing_is_lost_of_what_has_no_inside() {
        let line = [Vec3::ZERO, Vec3::X, Vec3::X * 2.0, Vec3::X];
        assert_eq!(cut(&line).len(), 2);
        let star: Vec<Vec3> = (0..5)
            .map(|i| {
                Vec3::from((
                    glam::Vec2::from_angle(i as f32 * 0.4 * std::f32::consts::TAU),
                    0.0,
                ))
            })
            .collect();
        assert!(total_area(&star) > 1.0);
    }

    #[test]
    fn many_corners_take_little_time() {
        // A comb: every other corner is reflex.
        let comb: Vec<Vec3> = (0..MOST_CORNERS)
            .map(|i| {
                Vec3::new(
                    i as f32,
                    if i % 2 == 0 {
                        0.0
                    } else {
                        1.0 + (i % 7) as f32
                    },
                    0.0,
                )
            })
            .collect();
        let start = std::time::Instant::now();
        assert!(!cut(&comb).is_empty());
        assert!(start.elapsed().as_secs_f32() < 5.0);
    }
}
