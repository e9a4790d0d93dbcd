//! Pictures to filter, and the filters' weights once more, in f64 and straight from the formulas.

#![allow(clippy::unwrap_used, reason = "a test may fail")]
#![allow(
    dead_code,
    reason = "every test file takes what it needs of this module, and one may take all"
)]

#[cfg(feature = "gpu")]
pub(crate) mod textures;

use isophote_filters::{Guides, ImageView, Pinhole};

/// What a camera at the origin sees.
pub(crate) struct Picture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) yfov: f32,
    pub(crate) normals: Vec<f32>,
    pub(crate) depths: Vec<f32>,
}

/// Numbers from 0 to 1 that depend on the seed alone.
pub(crate) fn noise(seed: u32, count: usize) -> Vec<f32> {
    let mut state = seed.wrapping_mul(2_654_435_769).wrapping_add(12_345);
    std::iter::repeat_with(|| {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state >> 8) as f32 / 16_777_216.0
    })
    .skip(8)
    .take(count)
    .collect()
}

pub(crate) fn view(data: &[f32], width: usize, height: usize, channels: usize) -> ImageView<'_> {
    ImageView::new(data, width, height, channels).unwrap()
}

impl Picture {
    /// A wall that faces the camera at depth 2.
    pub(crate) fn wall(width: usize, height: usize) -> Self {
        Self::of(width, height, |_, _| Some(([0.0, 0.0, 1.0], 2.0)))
    }

    /// The normal and the depth of every pixel, or background.
    pub(crate) fn of(
        width: usize,
        height: usize,
        at: impl Fn(usize, usize) -> Option<([f32; 3], f32)>,
    ) -> Self {
        let (mut normals, mut depths) = (Vec::new(), Vec::new());
        for y in 0..height {
            for x in 0..width {
                let (normal, depth) = at(x, y).unwrap_or(([0.0; 3], f32::INFINITY));
                normals.extend(normal);
                depths.push(depth);
            }
        }
        Self {
            width,
            height,
            yfov: 1.0,
            normals,
            depths,
        }
    }

    /// Planes in random places, seen from the front to a grazing angle, with background in between.
    pub(crate) fn planes(width: usize, height: usize, seed: u32) -> Self {
        let numbers = noise(seed, 60);
        let planes: Vec<_> = numbers.chunks_exact(6).collect();
        let mut picture = Self::wall(width, height);
        for y in 0..height {
            for x in 0..width {
                let distance = |plane: &&&[f32]| {
                    (plane[0] - x as f32 / width as f32).hypot(plane[1] - y as f32 / height as f32)
                };
                let nearest = planes
                    .iter()
                    .min_by(|a, b| distance(a).total_cmp(&distance(b)))
                    .unwrap();
                let pixel = y * width + x;
                let normal = [
                    f64::from(nearest[2]) * 2.0 - 1.0,
                    f64::from(nearest[3]) * 2.0 - 1.0,
                    0.5,
                ];
                let facing = dot(normal, picture.ray(x as f64, y as f64));
                let depth = -f64::from(1.0 + nearest[4]) / facing;
                // At flatter angles the tangent plane is not used as it is.
                let seen = nearest[5] < 0.9 && facing < -0.06 * dot(normal, normal).sqrt();
                picture.depths[pixel] = if seen { depth as f32 } else { f32::INFINITY };
                picture.normals[3 * pixel..][..3].copy_from_slice(&normal.map(|v| v as f32));
            }
        }
        picture
    }

    pub(crate) fn camera(&self) -> Pinhole {
        Pinhole::at_origin(self.yfov).unwrap()
    }

    pub(crate) fn guides(&self) -> Guides {
        let normals = view(&self.normals, self.width, self.height, 3);
        let depths = view(&self.depths, self.width, self.height, 1);
        Guides::new(normals, depths, &self.camera()).unwrap()
    }

    /// The direction through a pixel's centre, its part into the picture 1.
    pub(crate) fn ray(&self, x: f64, y: f64) -> [f64; 3] {
        let scale = 2.0 * (0.5 * f64::from(self.yfov)).tan() / self.height as f64;
        let (x, y) = (
            x + 0.5 - 0.5 * self.width as f64,
            y + 0.5 - 0.5 * self.height as f64,
        );
        [x * scale, -y * scale, -1.0]
    }

    /// The unit normal of a pixel.
    fn normal(&self, [x, y]: [usize; 2]) -> [f64; 3] {
        let normal = &self.normals[3 * (y * self.width + x)..][..3];
        let normal = [normal[0], normal[1], normal[2]].map(f64::from);
        normal.map(|value| value / dot(normal, normal).sqrt())
    }

    fn depth(&self, [x, y]: [usize; 2]) -> f64 {
        f64::from(self.depths[y * self.width + x])
    }

    /// The cosine between the normals of two pixels, and how far q lies from p's tangent plane; `None` for a surface
    /// and the background.
    pub(crate) fn likeness(&self, p: [usize; 2], q: [usize; 2]) -> Option<(f64, f64)> {
        match (self.depth(p).is_finite(), self.depth(q).is_finite()) {
            (true, true) => {}
            (false, false) => return Some((1.0, 0.0)),
            _ => return None,
        }
        let normal = self.normal(p);
        let [here, there] = [p, q].map(|[x, y]| dot(normal, self.ray(x as f64, y as f64)));
        let plane = there / (here * self.depth(p));
        let distance = (1.0 / self.depth(q) - plane).abs() * self.depth(p);
        Some((dot(normal, self.normal(q)), distance))
    }

    /// The weight of an `EdgeStop`: Eq. (2)'s cosine without an angle, else that of the angle.
    pub(crate) fn weight(
        &self,
        p: [usize; 2],
        q: [usize; 2],
        angle: Option<f64>,
        depth: f64,
    ) -> f64 {
        self.log_weight(p, q, angle, depth).exp()
    }

    /// Its logarithm.
    pub(crate) fn log_weight(
        &self,
        p: [usize; 2],
        q: [usize; 2],
        angle: Option<f64>,
        depth: f64,
    ) -> f64 {
        let Some((cosine, distance)) = self.likeness(p, q) else {
            return f64::NEG_INFINITY;
        };
        let normals = match angle {
            None => cosine.max(0.0).ln(),
            Some(angle) => -(1.0 - cosine) / (1.0 - angle.cos()),
        };
        normals - distance / depth
    }

    /// Σ w(p, q) I(q) / Σ w(p, q) at p over the pixels q = p + offset that exist.
    pub(crate) fn weighted_mean(
        &self,
        image: &[f32],
        channels: usize,
        p: [usize; 2],
        offsets: &[[isize; 2]],
        weight: impl Fn([usize; 2], [isize; 2]) -> f64,
    ) -> Vec<f64> {
        let mut sums = vec![0.0; channels];
        let mut total = 0.0;
        for &[dx, dy] in offsets {
            let (x, y) = (p[0] as isize + dx, p[1] as isize + dy);
            if x < 0 || y < 0 || x >= self.width as isize || y >= self.height as isize {
                continue;
            }
            let q = [x as usize, y as usize];
            let w = weight(q, [dx, dy]);
            total += w;
            for (channel, sum) in sums.iter_mut().enumerate() {
                *sum += w * f64::from(image[(q[1] * self.width + q[0]) * channels + channel]);
            }
        }
        sums.into_iter().map(|sum| sum / total).collect()
    }
}

/// All offsets in a window.
pub(crate) fn window(
    columns: impl Iterator<Item = isize> + Clone,
    rows: impl Iterator<Item = isize>,
) -> Vec<[isize; 2]> {
    rows.flat_map(|dy| columns.clone().map(move |dx| [dx, dy]))
        .collect()
}

/// Fails where two images differ by more than a tolerance.
pub(crate) fn assert_close(found: &[f32], expected: impl IntoIterator<Item = f64>, tolerance: f64) {
    let mut count = 0;
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (f64::from(*found) - expected).abs();
        assert!(
            error <= tolerance,
            "number {index}: {found}, expected {expected}, off by {error:e}"
        );
        count += 1;
    }
    assert_eq!(count, found.len(), "one expected number for each");
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
