//! The swivel chair.

use std::f32::consts::TAU;

use glam::{Affine3A, Quat, Vec3};

use super::Materials;
use crate::builtin::shapes::{Shape, profile};

/// The sitter looks along +z.
pub(super) fn chair(materials: &Materials) -> Shape {
    let mut chair = Shape::new("chair", materials.fabric);
    chair.cushion([0.0, 0.46, 0.0], [0.24, 0.045, 0.23], 0.4, 20);
    back(&mut chair, materials);
    arms(&mut chair, materials);
    base(&mut chair, materials);
    chair
}

/// A cushion, leant back and bent round the sitter.
fn back(chair: &mut Shape, materials: &Materials) {
    let lean = Quat::from_rotation_x(-0.14);
    chair.place(Affine3A::from_rotation_translation(
        lean,
        Vec3::new(0.0, 0.80, -0.25),
    ));
    let cells = 8;
    // Two skins between a rectangle with round corners, thick in the middle.
    for side in [1.0, -1.0_f32] {
        chair.grid([cells, cells], [false; 2], |i, j| {
            let (u, v) = (i as f32 / 4.0 - 1.0, j as f32 / 4.0 - 1.0);
            let v = v * side;
            let round = (1.0 - 0.12 * v.powi(4)) * 0.22;
            let x = u * round;
            let y = v * (1.0 - 0.1 * u.powi(4)) * 0.27;
            let rim = ((1.0 - u.powi(6)) * (1.0 - v.powi(6))).max(0.0).sqrt();
            Vec3::new(x, y, 0.06 * u * u + side * 0.028 * rim)
        });
    }
    chair.place(Affine3A::IDENTITY).material(materials.plastic);
    let spine = [
        [0.0, 0.42, -0.1],
        [0.0, 0.42, -0.24],
        [0.0, 0.47, -0.285],
        [0.0, 0.85, -0.295],
    ];
    chair.tube(&spine.map(Vec3::from), 8, |_| 0.02);
}

fn arms(chair: &mut Shape, materials: &Materials) {
    for side in [-1.0, 1.0] {
        let x = 0.28 * side;
        let support = [
            [0.15 * side, 0.425, 0.0],
            [0.25 * side, 0.43, 0.0],
            [x, 0.46, 0.0],
            [x, 0.66, 0.0],
        ];
        chair
            .material(materials.chrome)
            .tube(&support.map(Vec3::from), 8, |_| 0.013);
        chair
            .material(materials.plastic)
            .cushion([x, 0.67, 0.02], [0.03, 0.018, 0.13], 0.5, 12);
    }
}

/// A gas spring on a star of five arms with castors.
fn base(chair: &mut Shape, materials: &Materials) {
    chair.material(materials.chrome).lathe(
        &profile([
            [0.05, 0.06],
            [0.05, 0.11],
            [0.032, 0.12],
            [0.032, 0.25],
            [0.018, 0.25],
            [0.018, 0.44],
        ]),
        16,
    );
    for arm in 0..5 {
        let turn = Quat::from_rotation_y(TAU * arm as f32 / 5.0 + 0.3);
        chair.place(Affine3A::from_quat(turn));
        let spoke = [
            [0.02, 0.1, 0.0],
            [0.12, 0.092, 0.0],
            [0.29, 0.062, 0.0],
            [0.3, 0.06, 0.0],
        ];
        chair
            .material(materials.chrome)
            .tube(&spoke.map(Vec3::from), 8, |j| [0.024, 0.021, 0.014, 0.0][j]);
        let on_side = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
        chair.material(materials.plastic);
        chair.place(
            Affine3A::from_quat(turn)
                * Affine3A::from_rotation_translation(on_side, Vec3::new(0.28, 0.027, 0.0)),
        );
        chair.lathe(
            &profile([
                [0.0, -0.022],
                [0.022, -0.022],
                [0.0275, -0.012],
                [0.0275, 0.012],
                [0.022, 0.022],
                [0.0, 0.022],
            ]),
            10,
        );
    }
    chair.place(Affine3A::IDENTITY);
}
