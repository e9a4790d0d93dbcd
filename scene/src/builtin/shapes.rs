//! Grows a mesh out of boxes, grids and swept profiles.
//!
//! Everything round is a [`grid`](Shape::grid) of points: its normals are smooth within the grid and creased between
//! grids. A [`sweep`](Shape::sweep) moves a profile along a path and starts a new grid at every sharp corner of
//! the profile, so mouldings, turned balusters, tubes and arches shade as they should without further ado.

use std::collections::HashMap;
use std::f32::consts::TAU;

use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A};

use crate::{Mesh, unit_normal};

/// Corners of a profile that turn by more than this are sharp.
const CREASE_COS: f32 = 0.82;

/// A mesh under construction.
#[derive(Clone, Debug)]
pub(super) struct Shape {
    mesh: Mesh,
    material: u32,
    place: Affine3A,
}

impl Shape {
    /// An empty mesh whose first triangles get `material`.
    pub(super) fn new(name: &str, material: u32) -> Self {
        let mesh = Mesh {
            name: name.to_owned(),
            ..Mesh::default()
        };
        Self {
            mesh,
            material,
            place: Affine3A::IDENTITY,
        }
    }

    /// What follows is made of this.
    pub(super) fn material(&mut self, material: u32) -> &mut Self {
        self.material = material;
        self
    }

    /// What follows is moved by this, which must not mirror.
    pub(super) fn place(&mut self, place: Affine3A) -> &mut Self {
        self.place = place;
        self
    }

    /// What follows is moved by this.
    pub(super) fn at(&mut self, x: f32, y: f32, z: f32) -> &mut Self {
        self.place(Affine3A::from_translation(Vec3::new(x, y, z)))
    }

    pub(super) fn triangle_count(&self) -> usize {
        self.mesh.triangles.len()
    }

    pub(super) fn finish(self) -> Mesh {
        self.mesh
    }

    /// A flat convex polygon, counter-clockwise from its front. Texture coordinates are metres in the two axes it
    /// faces least, so that neighbours continue each other.
    pub(super) fn polygon(&mut self, corners: &[Vec3]) -> &mut Self {
        let first = self.mesh.positions.len() as u32;
        let normal = unit_normal(corners[0], corners[1], corners[2]);
        for &corner in corners {
            let uv = match normal.abs().max_position() {
                0 => Vec2::new(corner.z, -corner.y),
                1 => Vec2::new(corner.x, corner.z),
                _ => Vec2::new(corner.x, -corner.y),
            };
            self.vertex(corner, normal, uv);
        }
        for i in 1..corners.len() as u32 - 1 {
            self.triangle([first, first + i, first + i + 1]);
        }
        self
    }

    /// An axis-aligned box.
    pub(super) fn cuboid(&mut self, min: impl Into<Vec3>, max: impl Into<Vec3>) -> &mut Self {
        self.chamfered(min, max, 0.0)
    }

    /// An axis-aligned box whose edges are cut off at 45°, `bevel` deep.
    pub(super) fn chamfered(
        &mut self,
        min: impl Into<Vec3>,
        max: impl Into<Vec3>,
        bevel: f32,
    ) -> &mut Self {
        let (min, max) = (min.into(), max.into());
        // A corner by the signs of its axes, pulled in by the bevel along all axes but `outer`.
        let corner = |signs: Vec3, outer: usize| {
            let mut point = Vec3::select(signs.cmpgt(Vec3::ZERO), max, min) - bevel * signs;
            point[outer] += bevel * signs[outer];
            point
        };
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for side in [-1.0, 1.0] {
                let around = if side > 0.0 { [1.0, 1.0] } else { [-1.0, 1.0] };
                let signs = |su: f32, sv: f32| {
                    let mut signs = Vec3::ZERO;
                    (signs[axis], signs[u], signs[v]) = (side, su * around[0], sv);
                    signs
                };
                let ring = [
                    signs(-1.0, -1.0),
                    signs(1.0, -1.0),
                    signs(1.0, 1.0),
                    signs(-1.0, 1.0),
                ];
                self.polygon(&ring.map(|signs| corner(signs, axis)));
                if bevel > 0.0 {
                    // The edge between this face and the one along +v or -v belongs to this face's axis.
                    for [a, b] in [[ring[0], ring[1]], [ring[2], ring[3]]] {
                        let edge = [corner(b, axis), corner(a, axis), corner(a, v), corner(b, v)];
                        self.polygon(&edge);
                    }
                }
            }
        }
        if bevel > 0.0 {
            for i in 0..8 {
                let sign = |bit: i32| if i & bit == 0 { -1.0 } else { 1.0 };
                let signs = Vec3::new(sign(1), sign(2), sign(4));
                let [x, y, z] = [0, 1, 2].map(|axis| corner(signs, axis));
                let front = signs.element_product() > 0.0;
                self.polygon(&if front { [x, y, z] } else { [x, z, y] });
            }
        }
        self
    }

    /// A smooth surface through `point(column, row)` with so many cells; the front is where columns × rows points.
    /// Along a closed axis the last line of points is the first. Cells that shrink to nothing, as at the poles of
    /// a sphere, are left out. Texture coordinates are metres along the middle lines.
    pub(super) fn grid(
        &mut self,
        [columns, rows]: [usize; 2],
        closed: [bool; 2],
        point: impl Fn(usize, usize) -> Vec3,
    ) -> &mut Self {
        let wrap = |i: usize, n: usize, closed: bool| if closed && i == n { 0 } else { i };
        let width = columns + 1;
        let points: Vec<Vec3> = (0..width * (rows + 1))
            .map(|k| {
                let (i, j) = (k % width, k / width);
                // Adding zero turns -0 into 0, so that equal points have equal bits.
                point(wrap(i, columns, closed[0]), wrap(j, rows, closed[1])) + Vec3::ZERO
            })
            .collect();
        let mut triangles = Vec::with_capacity(2 * columns * rows);
        for j in 0..rows {
            for i in 0..columns {
                let [a, b] = [j * width + i, j * width + i + 1];
                let [d, c] = [a + width, b + width];
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        triangles.retain(|&[a, b, c]| {
            points[a] != points[b] && points[b] != points[c] && points[c] != points[a]
        });
        let normals = smooth_normals(&points, &triangles);
        let lengths = |count: usize, index: &dyn Fn(usize) -> usize| {
            let mut sum = 0.0;
            let step = |k: usize| {
                if k > 0 {
                    sum += points[index(k)].distance(points[index(k - 1)]);
                }
                sum
            };
            (0..=count).map(step).collect::<Vec<f32>>()
        };
        let u = lengths(columns, &|i| rows / 2 * width + i);
        let v = lengths(rows, &|j| j * width + columns / 2);
        let first = self.mesh.positions.len();
        for (k, (&position, &normal)) in points.iter().zip(&normals).enumerate() {
            self.vertex(position, normal, Vec2::new(u[k % width], v[k / width]));
        }
        for triangle in triangles {
            self.triangle(triangle.map(|i| (first + i) as u32));
        }
        self
    }

    /// Moves a profile in the xy plane through `steps + 1` frames; the first follows the last on a closed path.
    /// A closed profile repeats its first point at its end; counter-clockwise along +z its outside is the front.
    pub(super) fn sweep(
        &mut self,
        profile: &[Vec2],
        steps: usize,
        closed: bool,
        frame: impl Fn(usize) -> Affine3A,
    ) -> &mut Self {
        for (run, ring) in smooth_runs(profile) {
            self.grid([run.len() - 1, steps], [ring, closed], |i, j| {
                frame(j).transform_point3(run[i].extend(0.0))
            });
        }
        self
    }

    /// Turns a profile of (radius, height) about the y axis; from the bottom up its outside is the front.
    pub(super) fn lathe(&mut self, profile: &[Vec2], segments: usize) -> &mut Self {
        self.sweep(profile, segments, true, |j| {
            let (sin, cos) = (TAU * j as f32 / segments as f32).sin_cos();
            let axis = |x, y, z| Vec3A::new(x, y, z);
            Affine3A::from_mat3(
                Mat3A::from_cols(axis(cos, 0.0, sin), Vec3A::Y, axis(-sin, 0.0, cos)).into(),
            )
        })
    }

    /// A profile of (projection, height) along a path in the horizontal, mitred at its corners. Along the
    /// direction d of walking it projects towards +y × d.
    pub(super) fn moulding(&mut self, profile: &[Vec2], path: &[Vec3], closed: bool) -> &mut Self {
        let n = path.len();
        let edges = if closed { n } else { n - 1 };
        let outward = |edge: usize| {
            let along = (path[(edge + 1) % n] - path[edge]).normalize_or_zero();
            Vec3::Y.cross(along)
        };
        let mitre = |corner: usize| {
            let after = outward(corner.min(edges - 1));
            let before = match corner {
                0 if closed => outward(edges - 1),
                0 => after,
                _ => outward(corner - 1),
            };
            (before + after) / (1.0 + before.dot(after))
        };
        for edge in 0..edges {
            let ends = [edge, (edge + 1) % n];
            let frame = |j: usize| {
                let x: Vec3A = mitre(ends[j]).into();
                Affine3A {
                    matrix3: Mat3A::from_cols(x, Vec3A::Y, Vec3A::ZERO),
                    translation: path[ends[j]].into(),
                }
            };
            self.sweep(profile, 1, false, frame);
        }
        self
    }

    /// A round tube along a curve; where the radius is 0 it ends in a point.
    pub(super) fn tube(
        &mut self,
        curve: &[Vec3],
        sides: usize,
        radius: impl Fn(usize) -> f32,
    ) -> &mut Self {
        let frames = frames_along(curve);
        self.grid([sides, curve.len() - 1], [true, false], |i, j| {
            let (sin, cos) = (TAU * i as f32 / sides as f32).sin_cos();
            frames[j].transform_point3(radius(j) * Vec3::new(cos, sin, 0.0))
        })
    }

    /// A closed round tube.
    pub(super) fn ring(&mut self, curve: &[Vec3], sides: usize, radius: f32) -> &mut Self {
        let n = curve.len();
        let center = curve.iter().sum::<Vec3>() / n as f32;
        self.grid([sides, n], [true, true], |i, j| {
            let along = (curve[(j + 1) % n] - curve[(j + n - 1) % n]).normalize_or_zero();
            let out = (curve[j] - center).reject_from(along).normalize_or_zero();
            let (sin, cos) = (TAU * i as f32 / sides as f32).sin_cos();
            curve[j] + radius * (cos * out + sin * along.cross(out))
        })
    }

    /// A sphere.
    pub(super) fn sphere(&mut self, center: Vec3, radius: f32, segments: usize) -> &mut Self {
        let rings = segments / 2;
        self.grid([rings, segments], [false, true], |i, j| {
            let (sin, cos) = pole_to_pole(i, rings);
            let (s, c) = (TAU * j as f32 / segments as f32).sin_cos();
            center + radius * Vec3::new(sin * c, -cos, sin * s)
        })
    }

    /// A box with round edges and corners: the rounder, the smaller `power` is below 1 (a sphere has 1).
    pub(super) fn cushion(
        &mut self,
        center: impl Into<Vec3>,
        half: impl Into<Vec3>,
        power: f32,
        segments: usize,
    ) -> &mut Self {
        let (center, half, rings) = (center.into(), half.into(), segments / 2);
        let soft = |x: f32| x.abs().powf(power).copysign(x);
        self.grid([rings, segments], [false, true], |i, j| {
            let (sin, cos) = pole_to_pole(i, rings);
            let (s, c) = (TAU * (j as f32 + 0.5) / segments as f32).sin_cos();
            let around = soft(sin);
            center + half * Vec3::new(around * soft(c), -soft(cos), around * soft(s))
        })
    }

    /// A rectangular slab in the xy plane from `z[0]` to `z[1]` with a rectangular hole; `[min, max]` corners.
    pub(super) fn frame(
        &mut self,
        outer: [[f32; 2]; 2],
        inner: [[f32; 2]; 2],
        z: [f32; 2],
    ) -> &mut Self {
        let ring = |[min, max]: [[f32; 2]; 2], z: f32| {
            [
                Vec3::new(min[0], min[1], z),
                Vec3::new(max[0], min[1], z),
                Vec3::new(max[0], max[1], z),
                Vec3::new(min[0], max[1], z),
            ]
        };
        let [outer_back, outer_front] = z.map(|z| ring(outer, z));
        let [inner_back, inner_front] = z.map(|z| ring(inner, z));
        for i in 0..4 {
            let j = (i + 1) % 4;
            for [a, b] in [
                [&outer_front, &inner_front],
                [&outer_back, &outer_front],
                [&inner_back, &outer_back],
                [&inner_front, &inner_back],
            ] {
                self.polygon(&[a[i], a[j], b[j], b[i]]);
            }
        }
        self
    }

    fn vertex(&mut self, position: Vec3, normal: Vec3, uv: Vec2) {
        let normal = self.place.transform_vector3(normal);
        self.mesh
            .positions
            .push(self.place.transform_point3(position));
        self.mesh
            .normals
            .push(normal.try_normalize().unwrap_or(Vec3::Y));
        self.mesh.uvs[0].push(uv);
    }

    fn triangle(&mut self, corners: [u32; 3]) {
        self.mesh.triangles.push(corners);
        self.mesh.triangle_materials.push(self.material);
    }
}

/// Sine and cosine of the polar angle; exactly 0 and ±1 at the poles.
pub(super) fn pole_to_pole(i: usize, rings: usize) -> (f32, f32) {
    match i {
        0 => (0.0, 1.0),
        i if i == rings => (0.0, -1.0),
        i => (0.5 * TAU * i as f32 / rings as f32).sin_cos(),
    }
}

/// Area-weighted normals; vertices at the same position share one.
fn smooth_normals(points: &[Vec3], triangles: &[[usize; 3]]) -> Vec<Vec3> {
    let mut shared: HashMap<[u32; 3], usize> = HashMap::with_capacity(points.len());
    let owner: Vec<usize> = (points.iter().enumerate())
        .map(|(k, point)| {
            *shared
                .entry(point.to_array().map(f32::to_bits))
                .or_insert(k)
        })
        .collect();
    let mut sums = vec![Vec3::ZERO; points.len()];
    for &[a, b, c] in triangles {
        let cross = (points[b] - points[a]).cross(points[c] - points[a]);
        for k in [a, b, c] {
            sums[owner[k]] += cross;
        }
    }
    owner
        .iter()
        .map(|&k| sums[k].try_normalize().unwrap_or(Vec3::Y))
        .collect()
}

/// Cuts a profile at its sharp corners; the flag says that a run closes on itself.
fn smooth_runs(profile: &[Vec2]) -> Vec<(Vec<Vec2>, bool)> {
    let n = profile.len();
    let closed = n > 2 && profile[0] == profile[n - 1];
    let sharp = |before: Vec2, at: Vec2, after: Vec2| {
        let (a, b) = (
            (at - before).normalize_or_zero(),
            (after - at).normalize_or_zero(),
        );
        a.dot(b) < CREASE_COS
    };
    let mut corners: Vec<usize> = (1..n - 1)
        .filter(|&i| sharp(profile[i - 1], profile[i], profile[i + 1]))
        .collect();
    if closed && corners.is_empty() && !sharp(profile[n - 2], profile[0], profile[1]) {
        return vec![(profile.to_vec(), true)];
    }
    corners.insert(0, 0);
    corners.push(n - 1);
    corners
        .windows(2)
        .map(|ends| (profile[ends[0]..=ends[1]].to_vec(), false))
        .collect()
}

/// Frames along a curve, +z ahead, that turn about it as little as possible.
pub(super) fn frames_along(curve: &[Vec3]) -> Vec<Affine3A> {
    let n = curve.len();
    let mut side = Vec3::ZERO;
    (0..n)
        .map(|j| {
            let ahead = (curve[(j + 1).min(n - 1)] - curve[j.saturating_sub(1)])
                .try_normalize()
                .unwrap_or(Vec3::Z);
            side = side
                .reject_from(ahead)
                .try_normalize()
                .unwrap_or_else(|| ahead.any_orthonormal_vector());
            Affine3A::from_mat3_translation(
                glam::Mat3::from_cols(side, ahead.cross(side), ahead),
                curve[j],
            )
        })
        .collect()
}

/// A profile from pairs of numbers.
pub(super) fn profile<const N: usize>(points: [[f32; 2]; N]) -> Vec<Vec2> {
    points.map(Vec2::from).to_vec()
}

/// A quarter or half round: an arc of a circle as part of a profile, angles in degrees.
pub(super) fn arc(center: [f32; 2], radius: f32, from: f32, to: f32, steps: usize) -> Vec<Vec2> {
    (0..=steps)
        .map(|i| {
            let angle = from + (to - from) * i as f32 / steps as f32;
            Vec2::from(center) + radius * Vec2::from_angle(angle.to_radians())
        })
        .collect()
}

/// A turn about +y by quarters, without the rounding of sines.
pub(super) fn quarter_turn(quarters: u32) -> Affine3A {
    let (x, z) = match quarters % 4 {
        0 => (Vec3::X, Vec3::Z),
        1 => (Vec3::NEG_Z, Vec3::X),
        2 => (Vec3::NEG_X, Vec3::NEG_Z),
        _ => (Vec3::Z, Vec3::NEG_X),
    };
    Affine3A::from_mat3(glam::Mat3::from_cols(x, Vec3::Y, z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::area;

    /// Volume by the divergence theorem: positive when the triangles face outwards.
    fn volume(mesh: &Mesh) -> f32 {
        (0..mesh.triangles.len())
            .map(|i| {
                let [a, b, c] = mesh.corners(i);
                a.dot(b.cross(c)) / 6.0
            })
            .sum()
    }

    #[test]
    fn solids_face_outwards() {
        let mut cuboid = Shape::new("", 0);
        cuboid.cuboid([1.0, 2.0, 3.0], [2.0, 4.0, 7.0]);
        assert!((volume(&cuboid.finish()) - 8.0).abs() < 1e-4);
        let mut chamfered = Shape::new("", 0);
        chamfered.chamfered([-1.0; 3], [1.0; 3], 0.1);
        let chamfered = chamfered.finish();
        assert_eq!(chamfered.triangles.len(), 12 + 24 + 8);
        // Twelve prisms of half a square are cut off, 2 long but for what they share at the corners.
        let volume_cut = 8.0 - volume(&chamfered);
        assert!((0.1..0.12).contains(&volume_cut), "{volume_cut}");
        let mut sphere = Shape::new("", 0);
        sphere.sphere(Vec3::ONE, 1.0, 64);
        assert!((volume(&sphere.finish()) - TAU * 2.0 / 3.0).abs() < 0.03);
        let mut torus = Shape::new("", 0);
        let curve: Vec<Vec3> = (0..64)
            .map(|i| {
                let (sin, cos) = (TAU * i as f32 / 64.0).sin_cos();
                Vec3::new(cos, 0.0, sin)
            })
            .collect();
        torus.ring(&curve, 32, 0.25);
        assert!((volume(&torus.finish()) - 0.5 * TAU * TAU * 0.0625).abs() < 0.02);
        let mut vase = Shape::new("", 0);
        vase.lathe(
            &profile([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 2.0]]),
            64,
        );
        assert!((volume(&vase.finish()) - TAU).abs() < 0.02);
        let mut tube = Shape::new("", 0);
        let curve = [Vec3::ZERO, Vec3::Y, 2.0 * Vec3::Y, 3.0 * Vec3::Y];
        tube.tube(&curve, 32, |j| if j == 0 || j == 3 { 0.0 } else { 1.0 });
        assert!(volume(&tube.finish()) > 3.0);
    }

    #[test]
    fn normals_agree_with_the_winding_and_nothing_is_degenerate() {
        let mut shape = Shape::new("", 0);
        shape
            .sphere(Vec3::ZERO, 0.3, 12)
            .place(quarter_turn(3))
            .lathe(
                &profile([[0.0, 0.0], [0.5, 0.0], [0.4, 1.0], [0.0, 1.2]]),
                12,
            )
            .chamfered([0.0; 3], [1.0; 3], 0.2);
        let square = [
            Vec3::ZERO,
            Vec3::new(0.0, 0.0, 4.0),
            Vec3::new(4.0, 0.0, 4.0),
            Vec3::new(4.0, 0.0, 0.0),
        ];
        shape.moulding(
            &profile([[0.0, 0.0], [0.1, 0.05], [0.1, 0.1], [0.0, 0.1]]),
            &square,
            true,
        );
        let mesh = shape.finish();
        for (i, triangle) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = mesh.corners(i);
            assert!(area(a, b, c) > 1e-9);
            let face = unit_normal(a, b, c);
            for k in *triangle {
                assert!(face.dot(mesh.normals[k as usize]) > 0.5, "{i}: {face}");
            }
        }
    }

    #[test]
    fn mouldings_project_to_the_left_of_the_mitred_path() {
        let path = [Vec3::ZERO, Vec3::NEG_X, Vec3::new(-1.0, 0.0, 1.0)];
        let mut shape = Shape::new("", 0);
        shape.moulding(&profile([[0.1, 0.0], [0.1, 1.0]]), &path, false);
        let mesh = shape.finish();
        assert_eq!(mesh.triangles.len(), 4);
        let has = |at: Vec3| mesh.positions.iter().any(|p| p.distance(at) < 1e-6);
        assert!(has(Vec3::new(0.0, 0.0, 0.1)) && has(Vec3::new(-0.9, 1.0, 0.1)));
        assert!(mesh.normals[0].distance(Vec3::Z) < 1e-6);
    }
}
