//! Deterministic sequences and the warps that turn their points into directions.
//!
//! [`Sampler`] gives padded two-dimensional Sobol' points with hash-based Owen scrambling: every pair of
//! dimensions is an independently scrambled and shuffled (0, 2)-sequence (Burley, "Practical Hash-based Owen
//! Scrambling", JCGT 9(4), 2020; the permutation is Laine and Karras's of 2011 with Burley's constants). It needs
//! no tables and no state, so the same few lines run in a shader.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use glam::{Vec2, Vec3};

/// The points of one sample of one pixel (or vertex, or texel).
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    seed: u32,
    index: u32,
}

impl Sampler {
    /// Sample number `index` of the sequence that belongs to `seed` and `stream` (a pixel's number, for example).
    pub fn new(seed: u64, stream: u32, index: u32) -> Self {
        let seed = hash(hash_seed(seed) ^ hash(stream ^ 0x5bd1_e995));
        Self { seed, index }
    }

    /// A point in [0, 1)². The first 2ᵏ samples of every dimension pair are stratified.
    pub fn get_2d(&self, dimension: u32) -> Vec2 {
        let seed = hash(self.seed ^ hash(dimension.wrapping_mul(0x9e37_79b9) ^ 0x68bc_21eb));
        let index = owen_scramble(self.index, seed);
        let x = owen_scramble(index.reverse_bits(), hash(seed ^ 0xa511_e9b3));
        let y = owen_scramble(sobol_1(index), hash(seed ^ 0x63d8_3595));
        Vec2::new(to_unit(x), to_unit(y))
    }

    /// A number in [0, 1), stratified as the points are.
    pub fn get_1d(&self, dimension: u32) -> f32 {
        self.get_2d(dimension).x
    }
}

/// The digits of an index in a base, mirrored at the point: in [0, 1). In coprime bases the dimensions of a Halton
/// sequence.
pub fn radical_inverse(base: u32, mut index: u32) -> f32 {
    let (mut value, mut digit) = (0.0_f64, 1.0 / f64::from(base));
    while index > 0 {
        value += f64::from(index % base) * digit;
        index /= base;
        digit /= f64::from(base);
    }
    // Rounding up to 1 is not in the range.
    (value as f32).min(1.0_f32.next_down())
}

/// What a [`Sampler`] needs to know of its seed; that of `scene::sample` in shaders takes it in the seed's place.
pub fn hash_seed(seed: u64) -> u32 {
    hash(seed as u32) ^ hash((seed >> 32) as u32).rotate_left(16)
}

/// A 32-bit integer hash with good avalanche (a multiply–xorshift bijection).
pub fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x21f0_aaad);
    x ^= x >> 15;
    x = x.wrapping_mul(0x735a_2d97);
    x ^ (x >> 15)
}

/// Nested uniform (Owen) scrambling of the bits of `x`, most significant first (Burley 2020, listing 3).
fn owen_scramble(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits();
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x.reverse_bits()
}

/// The second dimension of the Sobol' sequence; the first is the radical inverse in base 2.
fn sobol_1(mut index: u32) -> u32 {
    let (mut result, mut column) = (0, 1 << 31);
    while index != 0 {
        if index & 1 == 1 {
            result ^= column;
        }
        index >>= 1;
        column ^= column >> 1;
    }
    result
}

/// The upper 24 bits as a number in [0, 1).
fn to_unit(x: u32) -> f32 {
    (x >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A right-handed orthonormal frame around a unit vector (Duff et al., JCGT 6(1), 2017).
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// First tangent.
    pub x: Vec3,
    /// Second tangent.
    pub y: Vec3,
    /// The vector itself.
    pub z: Vec3,
}

impl Frame {
    /// The frame around a unit vector.
    pub fn new(z: Vec3) -> Self {
        // Either sign is right while sign + z.z is not near 0. The paper changes it at z.z = 0, where the normals of
        // floors and walls lie, and rounding would decide between two frames.
        let sign = if z.z < -0.55 { -1.0 } else { 1.0 };
        let a = -1.0 / (sign + z.z);
        let b = z.x * z.y * a;
        Self {
            x: Vec3::new(1.0 + sign * z.x * z.x * a, sign * b, -sign * z.x),
            y: Vec3::new(b, sign + z.y * z.y * a, -z.y),
            z,
        }
    }

    /// From the frame to the world.
    pub fn to_world(&self, local: Vec3) -> Vec3 {
        self.x * local.x + self.y * local.y + self.z * local.z
    }

    /// From the world to the frame.
    pub fn to_local(&self, world: Vec3) -> Vec3 {
        Vec3::new(self.x.dot(world), self.y.dot(world), self.z.dot(world))
    }
}

/// [0, 1)² to the unit disk, concentric rings to rings (Shirley and Chiu 1997).
pub fn concentric_disk(u: Vec2) -> Vec2 {
    let p = 2.0 * u - 1.0;
    if p == Vec2::ZERO {
        return Vec2::ZERO;
    }
    let (radius, angle) = if p.x.abs() > p.y.abs() {
        (p.x, FRAC_PI_4 * (p.y / p.x))
    } else {
        (p.y, FRAC_PI_2 - FRAC_PI_4 * (p.x / p.y))
    };
    radius * Vec2::from_angle(angle)
}

/// A direction around +Z with density cosθ/π (Malley's method).
pub fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let p = concentric_disk(u);
    p.extend((1.0 - p.length_squared()).max(0.0).sqrt())
}

/// A direction with density 1/(4π).
pub fn uniform_sphere(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.x;
    let radius = (1.0 - z * z).max(0.0).sqrt();
    (radius * Vec2::from_angle(TAU * u.y)).extend(z)
}

/// A direction within the cone around +Z whose half angle has the cosine `cos_max`; density
/// 1/(2π(1 − `cos_max`)).
pub fn uniform_cone(u: Vec2, cos_max: f32) -> Vec3 {
    let z = 1.0 - u.x * (1.0 - cos_max);
    let radius = (1.0 - z * z).max(0.0).sqrt();
    (radius * Vec2::from_angle(TAU * u.y)).extend(z)
}

/// Barycentric coordinates (u, v) of a point with uniform density on a triangle (Heitz's low-distortion map, 2019).
pub fn uniform_triangle(u: Vec2) -> Vec2 {
    let half = 0.5 * u;
    if u.y > u.x {
        Vec2::new(half.x, u.y - half.x)
    } else {
        Vec2::new(u.x - half.y, half.y)
    }
}

/// A microfacet normal around +Z that is visible from the local direction `view` (z > 0), for isotropic GGX of
/// roughness `alpha` (Dupuy and Benyoub, "Sampling Visible GGX Normals with Spherical Caps", 2023).
pub fn ggx_visible_normal(view: Vec3, alpha: f32, u: Vec2) -> Vec3 {
    let stretched = Vec3::new(alpha * view.x, alpha * view.y, view.z).normalize();
    let z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    let radius = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
    let cap = (radius * Vec2::from_angle(TAU * u.x)).extend(z);
    let half = cap + stretched;
    Vec3::new(alpha * half.x, alpha * half.y, half.z.max(1e-12)).normalize()
}

/// Density of [`cosine_hemisphere`] at a cosine.
pub fn cosine_hemisphere_pdf(cosine: f32) -> f32 {
    cosine.max(0.0) / PI
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_of_dimensions_is_a_net() {
        for (seed, dimension) in [(0, 0), (7, 1), (7, 2), (9, 40)] {
            // Each elementary interval of volume 1/64 holds one of 64 points.
            for (columns, rows) in [(64, 1), (16, 4), (8, 8), (2, 32), (1, 64)] {
                let mut seen = [false; 64];
                for index in 0..64 {
                    let p = Sampler::new(seed, 3, index).get_2d(dimension);
                    let cell =
                        (p.x * columns as f32) as usize * rows + (p.y * rows as f32) as usize;
                    assert!(
                        !std::mem::replace(&mut seen[cell], true),
                        "{seed} {dimension} {columns}"
                    );
                }
            }
        }
    }

    /// χ² of a warp's directions in equal-probability cells: `cell` maps a direction to 0..64.
    fn chi_squared(cell: impl Fn(Vec2) -> usize) -> f64 {
        let count = 64_000;
        let mut cells = [0_u32; 64];
        for index in 0..count {
            // Independent points, since χ² knows nothing of stratification.
            let u = Vec2::new(to_unit(hash(2 * index)), to_unit(hash(2 * index + 1)));
            cells[cell(u)] += 1;
        }
        let expected = f64::from(count) / 64.0;
        cells
            .iter()
            .map(|&n| (f64::from(n) - expected).powi(2) / expected)
            .sum()
    }

    fn sector(direction: Vec3) -> usize {
        (((direction.y.atan2(direction.x) / TAU + 0.5) * 8.0) as usize).min(7)
    }

    #[test]
    fn warps_have_their_densities() {
        // 63 degrees of freedom: above 120 happens once in 10⁵.
        let cosine = chi_squared(|u| {
            let d = cosine_hemisphere(u);
            ((d.truncate().length_squared() * 8.0) as usize).min(7) * 8 + sector(d)
        });
        let sphere = chi_squared(|u| {
            let d = uniform_sphere(u);
            (((d.z + 1.0) * 4.0) as usize).min(7) * 8 + sector(d)
        });
        let cone = chi_squared(|u| {
            let d = uniform_cone(u, 0.6);
            (((1.0 - d.z) / 0.4 * 8.0) as usize).min(7) * 8 + sector(d)
        });
        let triangle = chi_squared(|u| {
            let uv = uniform_triangle(u);
            assert!(uv.x >= 0.0 && uv.y >= 0.0 && uv.x + uv.y <= 1.0);
            // 1 − √(1 − a)-shaped strips along u have equal areas, and so have cuts of each strip along v.
            let strip = (((1.0 - (1.0 - uv.x).powi(2)) * 8.0) as usize).min(7);
            strip * 8 + ((uv.y / (1.0 - uv.x) * 8.0) as usize).min(7)
        });
        for (name, value) in [
            ("cosine", cosine),
            ("sphere", sphere),
            ("cone", cone),
            ("triangle", triangle),
        ] {
            assert!(value < 120.0, "{name}: {value}");
        }
    }

    #[test]
    fn frames_are_orthonormal() {
        for index in 0..1000 {
            let u = Vec2::new(to_unit(hash(index)), to_unit(hash(index + 1_000_000)));
            let frame = Frame::new(uniform_sphere(u));
            let error = frame.x.cross(frame.y) - frame.z;
            assert!(error.length() < 1e-5 && frame.x.dot(frame.z).abs() < 1e-6);
        }
    }
}
