//! How a surface scatters light: diffuse, GGX, mirror and dielectric lobes of glTF's metallic-roughness model.
//!
//! A metal is a reflector whose reflectance is the base colour at every angle (no Fresnel term), as
//! `metallic = 1` is defined here; everything else is diffuse with albedo/π, or refracts. Between the two the
//! lobes are blended by `metallic`.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use crate::{
    SurfaceMaterial,
    sample::{Frame, cosine_hemisphere, cosine_hemisphere_pdf, ggx_visible_normal},
};

/// Below this roughness a metal is a perfect mirror.
pub const MIRROR_ROUGHNESS: f32 = 0.05;

/// The scattering of a point, ready to be evaluated and sampled.
///
/// Directions leave the surface; `view` is where the light goes, `light` where it comes from.
#[derive(Clone, Copy, Debug)]
pub struct Bsdf {
    frame: Frame,
    /// Albedo of the diffuse lobe.
    diffuse: Vec3,
    /// Reflectance of the metal lobe.
    metal: Vec3,
    /// GGX α of the metal lobe; 0 is a mirror.
    alpha: f32,
    /// Tint of the refracted light; zero without transmission.
    glass: Vec3,
    /// Share of the light that meets the dielectric lobe.
    glass_share: f32,
    /// Index of refraction on the far side over that on the near side.
    eta: f32,
}

/// A direction that [`Bsdf::sample`] chose.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample {
    /// Unit, leaves the surface.
    pub light: Vec3,
    /// Value × cosine / density.
    pub weight: Vec3,
    /// Solid-angle density; infinite for a mirror or refraction, which light sampling cannot find.
    pub pdf: f32,
}

impl Bsdf {
    /// A Lambertian reflector with a shading normal on the viewer's side.
    pub fn diffuse(normal: Vec3, albedo: Vec3) -> Self {
        Self {
            frame: Frame::new(normal),
            diffuse: albedo,
            metal: Vec3::ZERO,
            alpha: 0.0,
            glass: Vec3::ZERO,
            glass_share: 0.0,
            eta: 1.0,
        }
    }

    /// A material with a shading normal on the viewer's side; `outside` tells whether the viewer is on the front.
    pub fn new(normal: Vec3, material: &SurfaceMaterial, outside: bool) -> Self {
        let rest = 1.0 - material.metallic;
        let glass_share = rest * material.transmission;
        let mirror = material.roughness < MIRROR_ROUGHNESS;
        Self {
            frame: Frame::new(normal),
            diffuse: (rest - glass_share) * material.base_color,
            metal: material.metallic * material.base_color,
            alpha: if mirror {
                0.0
            } else {
                material.roughness * material.roughness
            },
            glass: material.base_color,
            glass_share,
            eta: if outside {
                material.ior
            } else {
                1.0 / material.ior
            },
        }
    }

    /// Value × cosine of the lobes that light sampling can find; the others are 0 here.
    pub fn evaluate(&self, view: Vec3, light: Vec3) -> Vec3 {
        let (view, light) = (self.frame.to_local(view), self.frame.to_local(light));
        if view.z <= 0.0 || light.z <= 0.0 {
            return Vec3::ZERO;
        }
        let mut value = self.diffuse * (light.z / PI);
        if self.alpha > 0.0 && self.metal != Vec3::ZERO {
            let half = (view + light).normalize();
            let d = ggx_distribution(half, self.alpha);
            let g = smith_g1(view, self.alpha) * smith_g1(light, self.alpha);
            value += self.metal * (d * g / (4.0 * view.z));
        }
        value
    }

    /// Density of [`sample`](Self::sample) over the same lobes.
    pub fn pdf(&self, view: Vec3, light: Vec3) -> f32 {
        let (view, light) = (self.frame.to_local(view), self.frame.to_local(light));
        if view.z <= 0.0 || light.z <= 0.0 {
            return 0.0;
        }
        let [diffuse, metal, _] = self.lobe_probabilities();
        let mut pdf = diffuse * cosine_hemisphere_pdf(light.z);
        if self.alpha > 0.0 && metal > 0.0 {
            let half = (view + light).normalize();
            pdf += metal * ggx_distribution(half, self.alpha) * smith_g1(view, self.alpha)
                / (4.0 * view.z);
        }
        pdf
    }

    /// Chooses a direction by importance, or none where all light is absorbed. `lobe` in [0, 1) chooses the lobe.
    pub fn sample(&self, view: Vec3, lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let local = self.frame.to_local(view);
        if local.z <= 0.0 {
            return None;
        }
        let [diffuse, metal, glass] = self.lobe_probabilities();
        if diffuse + metal + glass <= 0.0 {
            return None;
        }
        if lobe < diffuse {
            return self.smooth_sample(view, cosine_hemisphere(u));
        }
        if lobe < diffuse + metal {
            if self.alpha == 0.0 {
                let light = self.frame.to_world(Vec3::new(-local.x, -local.y, local.z));
                return Some(BsdfSample {
                    light,
                    weight: self.metal / metal,
                    pdf: f32::INFINITY,
                });
            }
            let normal = ggx_visible_normal(local, self.alpha, u);
            return self.smooth_sample(view, 2.0 * local.dot(normal) * normal - local);
        }
        // Rounding may leave a little of `lobe` behind the last lobe there is.
        if glass <= 0.0 {
            return None;
        }
        let choice = ((lobe - diffuse - metal) / glass).clamp(0.0, 1.0);
        Some(self.sample_dielectric(local, choice, glass))
    }

    fn smooth_sample(&self, view: Vec3, local_light: Vec3) -> Option<BsdfSample> {
        let light = self.frame.to_world(local_light).normalize();
        let pdf = self.pdf(view, light);
        (pdf > 0.0).then(|| BsdfSample {
            light,
            weight: self.evaluate(view, light) / pdf,
            pdf,
        })
    }

    /// A smooth dielectric: reflects with the Fresnel probability, refracts otherwise.
    fn sample_dielectric(&self, view: Vec3, choice: f32, probability: f32) -> BsdfSample {
        let (reflectance, cos_t) = fresnel(view.z, self.eta);
        let share = self.glass_share / probability;
        let (local, weight) = if choice < reflectance {
            (Vec3::new(-view.x, -view.y, view.z), Vec3::splat(share))
        } else {
            // Radiance changes with the square of the index of refraction.
            let radiance = 1.0 / (self.eta * self.eta);
            let refracted = Vec3::new(-view.x / self.eta, -view.y / self.eta, -cos_t);
            (refracted, self.glass * (share * radiance))
        };
        let light = self.frame.to_world(local).normalize();
        BsdfSample {
            light,
            weight,
            pdf: f32::INFINITY,
        }
    }

    /// With which probabilities the diffuse, metal and dielectric lobes are chosen; they sum to 1 or are all 0.
    fn lobe_probabilities(&self) -> [f32; 3] {
        let glass = if self.glass_share > 0.0 {
            self.glass_share * self.glass.max_element().max(0.05)
        } else {
            0.0
        };
        let weights = [self.diffuse.max_element(), self.metal.max_element(), glass];
        let sum: f32 = weights.iter().sum();
        if sum > 0.0 {
            weights.map(|weight| weight / sum)
        } else {
            [0.0; 3]
        }
    }
}

/// GGX distribution of normals (Walter et al. 2007, Eq. 33).
fn ggx_distribution(half: Vec3, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    let cos2 = half.z * half.z;
    let sin2 = half.x * half.x + half.y * half.y;
    // Written without 1 − cos², which cancels for small α.
    let root = sin2 / a2 + cos2;
    1.0 / (PI * a2 * root * root)
}

/// Smith's masking for GGX (Walter et al. 2007, Eq. 34).
fn smith_g1(direction: Vec3, alpha: f32) -> f32 {
    let tan2 =
        (direction.x * direction.x + direction.y * direction.y) / (direction.z * direction.z);
    2.0 / (1.0 + (1.0 + alpha * alpha * tan2).sqrt())
}

/// Unpolarised Fresnel reflectance and the cosine of the refracted angle; `eta` is the far side's index over the near one's.
pub fn fresnel(cos_i: f32, eta: f32) -> (f32, f32) {
    let sin2_t = (1.0 - cos_i * cos_i).max(0.0) / (eta * eta);
    if sin2_t >= 1.0 {
        return (1.0, 0.0);
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    (
        0.5 * (parallel * parallel + perpendicular * perpendicular),
        cos_t,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Sampler, uniform_sphere};

    fn material(metallic: f32, roughness: f32, transmission: f32) -> SurfaceMaterial {
        SurfaceMaterial {
            base_color: Vec3::ONE,
            metallic,
            roughness,
            emissive: Vec3::ZERO,
            transmission,
            ior: 1.5,
            unlit: false,
        }
    }

    /// What is reflected by sampling must be what is reflected by integrating over all directions.
    #[test]
    fn sampling_agrees_with_evaluation() {
        let normal = Vec3::new(0.3, 0.8, -0.2).normalize();
        let view = (normal + Vec3::new(0.5, 0.1, 0.4)).normalize();
        for (metallic, roughness) in [(0.0, 1.0), (1.0, 0.6), (1.0, 1.0), (0.5, 0.5)] {
            let bsdf = Bsdf::new(normal, &material(metallic, roughness, 0.0), true);
            let count = 1 << 16;
            let (mut sampled, mut integrated, mut density) = (0.0, 0.0, 0.0);
            for index in 0..count {
                let sampler = Sampler::new(1, 2, index);
                if let Some(sample) = bsdf.sample(view, sampler.get_1d(0), sampler.get_2d(1)) {
                    sampled += sample.weight.x;
                }
                let light = uniform_sphere(sampler.get_2d(2));
                integrated += bsdf.evaluate(view, light).x * 4.0 * PI;
                density += bsdf.pdf(view, light) * 4.0 * PI;
            }
            let [sampled, integrated, density] =
                [sampled, integrated, density].map(|sum: f32| sum / count as f32);
            assert!(
                (sampled - integrated).abs() < 0.02,
                "{metallic} {roughness}: {sampled} {integrated}"
            );
            assert!(
                density < 1.02 && sampled < 1.01,
                "{metallic} {roughness}: {density} {sampled}"
            );
            assert!(metallic > 0.0 || (sampled - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn evaluation_is_reciprocal() {
        let bsdf = Bsdf::new(Vec3::Z, &material(0.7, 0.5, 0.0), true);
        let (a, b) = (
            Vec3::new(0.6, 0.0, 0.8),
            Vec3::new(-0.1, 0.3, 0.5).normalize(),
        );
        let forward = bsdf.evaluate(a, b) / b.z;
        let backward = bsdf.evaluate(b, a) / a.z;
        assert!((forward - backward).abs().max_element() < 1e-5);
    }

    #[test]
    fn glass_bends_and_reflects() {
        let (reflectance, cos_t) = fresnel(1.0, 1.5);
        assert!((reflectance - 0.04).abs() < 1e-6 && cos_t == 1.0);
        assert_eq!(fresnel(0.1, 1.0 / 1.5).0, 1.0);
        let bsdf = Bsdf::new(Vec3::Z, &material(0.0, 0.0, 1.0), true);
        let view = Vec3::new(0.6, 0.0, 0.8);
        let through = bsdf.sample(view, 0.99, Vec2::ZERO).expect("refracts");
        assert!((through.light - Vec3::new(-0.4, 0.0, -(1.0_f32 - 0.16).sqrt())).length() < 1e-5);
    }
}
