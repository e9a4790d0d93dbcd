//! The GPU's answers beside the CPU's.
#![cfg(feature = "gpu")]
#![expect(clippy::unwrap_used, reason = "tests may")]

use std::sync::Arc;

use isophote_ldi::{
    Coverage, LdiParams, LdiTracer,
    gpu::{BuildMethod, LdiGpuTracer},
};
use isophote_scene::{
    BuildTracer, Hit, Ray, Scene, Selection, Tracer, builtin,
    gpu::{BuildGpuTracer, Context, GpuScene, GpuTracer, RayBatch},
    sample::{Sampler, uniform_sphere},
    testing::{RayKind, rays},
};

/// How the answers for some rays differ.
#[derive(Debug, Default)]
struct Differences {
    rays: usize,
    hits: usize,
    /// One hits, the other does not; or any hit disagrees with closest hit.
    confused: usize,
    /// Distances differ by more than 10⁻⁴, and the places across the surface by more than 10⁻⁶ of the scene's size: the
    /// last digits of corners move hits far along surfaces that rays graze.
    far: usize,
    /// Different triangles.
    others: usize,
}

/// Rays of every kind; and for those that hit something and do not graze it, the pieces before, around and behind the
/// hit.
fn all_kinds(scene: &Scene, cpu: &LdiTracer, count: usize) -> Vec<Ray> {
    let mut all: Vec<Ray> = RayKind::ALL
        .into_iter()
        // Exactly at edges either side is right.
        .filter(|kind| *kind != RayKind::Edge)
        .flat_map(|kind| rays(scene, kind, count, 5))
        .collect();
    let pieces = |ray: &Ray| {
        let hit = cpu.closest_hit(ray)?;
        let normal = scene.surface_point(&hit).geometric_normal;
        if normal.dot(ray.direction).abs() < 0.1 {
            return None;
        }
        let (before, behind) = (hit.t * (1.0 - 1e-3), hit.t * (1.0 + 1e-3));
        let piece = |t_min, t_max| Ray {
            t_min,
            t_max,
            ..*ray
        };
        Some([
            piece(ray.t_min, before),
            piece(before, behind),
            piece(behind, ray.t_max),
        ])
    };
    let more: Vec<Ray> = all
        .iter()
        .step_by(3)
        .filter_map(pieces)
        .flatten()
        .filter(|ray| ray.t_min < ray.t_max)
        .collect();
    all.extend(more);
    all
}

/// Rays into a scene from so many of its diagonals away.
fn from_afar(scene: &Scene, away: f32, count: u32) -> Vec<Ray> {
    let bounds = scene.bounds();
    let ray = |index| {
        let sampler = Sampler::new(11, 0, index);
        let direction = uniform_sphere(sampler.get_2d(0));
        let share = sampler.get_2d(1).extend(sampler.get_1d(2));
        let target = bounds.min + share * (bounds.max - bounds.min);
        Ray::new(target - away * bounds.diagonal() * direction, direction)
    };
    (0..count).map(ray).collect()
}

/// With maps of the CPU, unless they are built on the device.
fn differences(
    context: &Context,
    scene: &Arc<Scene>,
    params: &LdiParams,
    built: Option<BuildMethod>,
    rays: impl FnOnce(&LdiTracer) -> Vec<Ray>,
) -> Differences {
    let selection = Selection::default();
    let cpu = LdiTracer::build(scene, &selection, params).unwrap();
    let gpu = match built {
        None => LdiGpuTracer::upload(context, &cpu),
        Some(method) => LdiGpuTracer::build_with(context, scene, &selection, params, method),
    };
    let gpu = gpu.unwrap();
    let gpu_scene = GpuScene::new(context, scene).unwrap();
    let mut batch = RayBatch::new(context, &gpu_scene, &gpu).unwrap();
    let rays = rays(&cpu);
    let mut answers: Vec<Option<Hit>> = vec![None; rays.len()];
    batch
        .closest_hits(context, &gpu_scene, &gpu, &rays, &mut answers)
        .unwrap();
    let mut any = vec![false; rays.len()];
    batch
        .any_hits(context, &gpu_scene, &gpu, &rays, &mut any)
        .unwrap();
    let diagonal = scene.bounds().diagonal();
    let mut found = Differences {
        rays: rays.len(),
        ..Differences::default()
    };
    for ((ray, answer), any) in rays.iter().zip(answers).zip(any) {
        let expected = cpu.closest_hit(ray);
        found.confused += usize::from(answer.is_some() != any);
        match (expected, answer) {
            (Some(a), Some(b)) => {
                found.hits += 1;
                let error = (a.t - b.t).abs();
                let across = error * scene.surface_point(&a).geometric_normal.dot(ray.direction);
                found.far += usize::from(error > 1e-4 * a.t && across.abs() > 1e-6 * diagonal);
                found.others += usize::from(a.surface != b.surface);
            }
            (None, None) => {}
            _ => found.confused += 1,
        }
    }
    println!("{params:?} {built:?}: {found:?}");
    found
}

#[test]
fn the_gpu_finds_what_the_cpu_finds() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    // Exact answers may differ where a ray grazes an edge. Planes within pixels are cut off at the pixels' sides,
    // which a ray may pass on the one side by the CPU's rounding and on the other by the GPU's.
    // On the device triangles are in pixels by the rounding of its rasteriser.
    for (coverage, allowed, built) in [
        (Coverage::Touched, 1e-4, None),
        (Coverage::Center, 2e-3, None),
        (Coverage::Touched, 1e-4, Some(BuildMethod::SinglePass)),
        (Coverage::Center, 1e-2, Some(BuildMethod::SinglePass)),
    ] {
        for (name, cells, resolution, count) in [
            ("cornell", 4, 128, 4000),
            ("office", 3, 64, 2000),
            ("office", 2, 300, 2000),
        ] {
            // A software adapter takes its time to build so many pixels.
            if built.is_some() && resolution > 128 {
                continue;
            }
            let scene = Arc::new(builtin::build(&format!("builtin:{name}")).unwrap());
            let params = LdiParams {
                cells,
                resolution,
                coverage,
                ..LdiParams::default()
            };
            let found = differences(&context, &scene, &params, built, |cpu| {
                all_kinds(&scene, cpu, count)
            });
            assert!(found.hits > found.rays / 4, "{name}: {found:?}");
            let most = (allowed * found.rays as f64) as usize;
            assert!(
                found.confused <= most && found.far <= most && found.others <= 10 * most,
                "{name} {params:?}: {found:?}, allowed {most}"
            );
        }
    }
}

/// 32 bits tell positions apart to about 10⁻⁷ of how far away a ray starts: rays that pass an edge more closely may be
/// answered otherwise, but none leaks through a surface.
#[test]
fn rays_from_afar_do_not_leak() {
    let Some(context) = Context::for_tests() else {
        return;
    };
    for (away, allowed) in [(1e3, 1e-4), (1e5, 1e-3)] {
        let scene = Arc::new(builtin::build("builtin:office").unwrap());
        let found = differences(&context, &scene, &LdiParams::default(), None, |_| {
            from_afar(&scene, away, 20_000)
        });
        assert!(found.hits > found.rays / 4, "{found:?}");
        let most = (allowed * found.rays as f64) as usize;
        assert!(found.confused <= most, "{found:?}, allowed {most}");
    }
}

/// Maps that the device builds in its buffers but cannot bind as a whole.
#[test]
fn large_maps_are_copied_to_textures() {
    let Some(context) = Context::for_tests_within(wgpu::Features::empty(), 500_000) else {
        return;
    };
    let scene = Arc::new(builtin::build("builtin:cornell").unwrap());
    let params = LdiParams {
        cells: 2,
        resolution: 64,
        ..LdiParams::default()
    };
    let selection = Selection::default();
    let gpu = LdiGpuTracer::build(&context, &scene, &selection, &params).unwrap();
    assert_eq!(gpu.shader_flags(), ["tracer_in_textures"]);
    let built = Some(BuildMethod::SinglePass);
    let found = differences(&context, &scene, &params, built, |cpu| {
        all_kinds(&scene, cpu, 1000)
    });
    assert!(
        found.confused + found.far <= 1 && found.hits > found.rays / 4,
        "{found:?}"
    );
}
