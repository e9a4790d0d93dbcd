//! Against the reference integrators.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;

use glam::Vec3;
use isophote_instant_gi::{GiParams, InstantGi};
use isophote_scene::{
    BuildTracer, BvhOptions, BvhTracer, Receivers, Scene, Selection, builtin, facing,
    reference::{Materials, Quantity, Settings, Tracers, bake},
    testing::{mean, relative_rmse},
};

const SIZE: [u32; 2] = [48, 36];

struct Lab {
    scene: Arc<Scene>,
    exact: BvhTracer,
}

impl Lab {
    fn new(name: &str) -> Self {
        let scene = Arc::new(builtin::build(name).unwrap());
        let exact =
            BvhTracer::build(&scene, &Selection::default(), &BvhOptions::default()).unwrap();
        Self { scene, exact }
    }

    fn tracers(&self) -> Tracers<'_, BvhTracer, BvhTracer> {
        Tracers {
            exact: &self.exact,
            secondary: &self.exact,
        }
    }

    fn found(&self, params: &GiParams) -> Vec<Vec3> {
        let gi = InstantGi::new(&self.scene, self.tracers(), params).unwrap();
        let camera = &self.scene.cameras[0];
        gi.render(camera, SIZE, &|_, _| {}).unwrap().indirect
    }

    /// The reference's light, and its noise as relRMSE.
    fn truth(&self, min_d: f32) -> (Vec<Vec3>, f32) {
        let settings = Settings {
            samples: 2048,
            materials: Materials::Lambert,
            min_d,
            seed: 9,
            ..Settings::default()
        };
        // At the very points that the pixels' centres show.
        let camera = &self.scene.cameras[0];
        let mut receivers = Receivers::from_camera(&self.scene, &self.exact, camera, SIZE);
        // Light is baked for the upper side of a surface; the camera may see the other.
        for receiver in &mut receivers.points {
            let point = &mut receiver.point;
            let view = camera.pinhole().eye - point.position;
            point.geometric_normal = facing(point.geometric_normal, view);
            point.shading_normal = facing(point.shading_normal, view);
        }
        let quantities = [Quantity::Indirect];
        let (estimates, _) = bake(
            &self.scene,
            self.tracers(),
            &receivers,
            &quantities,
            &settings,
            &|_, _| {},
        )
        .unwrap();
        let mut values = vec![Vec3::ZERO; (SIZE[0] * SIZE[1]) as usize];
        for (receiver, &value) in receivers.points.iter().zip(&estimates[0].values) {
            values[receiver.index as usize] = value;
        }
        (values, estimates[0].noise)
    }
}

fn params() -> GiParams {
    GiParams {
        paths: 4096,
        materials: Materials::Lambert,
        light_rays: 16,
        ..GiParams::default()
    }
}

/// One bounce by many virtual lights is the reference's, bounded alike.
#[test]
fn many_lights_are_one_bounce() {
    let lab = Lab::new("cornell");
    let (truth, noise) = lab.truth(0.1);
    let found = lab.found(&params());
    let bias = mean(&found) / mean(&truth) - 1.0;
    let beyond = |found: &[Vec3]| {
        let squares = relative_rmse(found, &truth).powi(2) - f64::from(noise).powi(2);
        squares.max(0.0).sqrt()
    };
    let rmse = beyond(&found);
    println!("noise {noise}, beyond it {rmse}, bias {bias}");
    let of = |paths, kept, selection| {
        beyond(&lab.found(&GiParams {
            paths,
            kept,
            selection,
            ..params()
        }))
    };
    // Of eight times as many lights as many are kept for the picture, or picked by each point.
    let [few, kept, picked] = [of(128, 0, 0), of(1024, 128, 0), of(1024, 0, 128)];
    println!("of 128 lights {few}, of 128 that were kept {kept}, picked {picked}");
    assert!(bias.abs() < 0.015 && rmse < 0.05, "{bias} {rmse}");
    assert!(kept < 0.9 * few, "{kept} {few}");
    assert!(picked < 0.8 * few, "{picked} {few}");
    let flat = vec![Vec3::splat(mean(&truth) as f32); truth.len()];
    assert!(
        relative_rmse(&flat, &truth) > 0.3,
        "the picture is not flat"
    );
}

/// A bound of 1.5 m darkens the box, and compensation gives the light back.
#[test]
fn compensation_gives_back_what_the_bound_took() {
    let lab = Lab::new("cornell");
    let truth = mean(&lab.truth(0.0).0);
    let bounded = GiParams {
        min_d: 1.5,
        ..params()
    };
    let lost = mean(&lab.found(&bounded)) / truth - 1.0;
    assert!(lost < -0.04, "{lost}");
    let compensated = GiParams {
        compensation: 64,
        ..bounded
    };
    let bias = mean(&lab.found(&compensated)) / truth - 1.0;
    assert!(bias.abs() < 0.02, "{bias}");
}
