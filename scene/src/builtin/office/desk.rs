//! The desk and what stands on it.

use std::f32::consts::{PI, TAU};

use glam::{Affine3A, Quat, Vec2, Vec3};

use super::Materials;
use crate::builtin::{
    random::Random,
    shapes::{Shape, profile},
    stage::Stage,
};

/// Height of the desk's top, metres.
const TOP: f32 = 0.74;
/// Where the desk lamp's bulb is in the world, and what it shines on.
pub(super) const LAMP_BULB: [f32; 3] = [0.98, 1.13, 0.02];
pub(super) const LAMP_TARGET: [f32; 3] = [0.80, 0.74, 0.12];

/// 1.6 m wide along x, the sitter at +z; drawers on the right, so it is not symmetric.
pub(super) fn desk(materials: &Materials) -> Shape {
    let mut desk = Shape::new("desk", materials.wood);
    desk.chamfered([-0.8, 0.705, -0.38], [0.8, TOP, 0.38], 0.004);
    desk.material(materials.lacquer)
        .cuboid([-0.74, 0.35, -0.33], [0.74, 0.71, -0.31]);
    // Two legs on the left, the drawers carry the right.
    desk.material(materials.steel);
    for z in [-0.32, 0.32] {
        let leg = [-0.001, 0.71].map(|y| Vec3::new(-0.74, y, z));
        desk.tube(&leg, 12, |_| 0.022);
    }
    let rail = [-0.32, 0.32].map(|z| Vec3::new(-0.74, 0.12, z));
    desk.tube(&rail, 12, |_| 0.015);
    desk.material(materials.lacquer)
        .chamfered([0.33, 0.03, -0.335], [0.77, 0.712, 0.33], 0.004);
    desk.material(materials.plastic)
        .cuboid([0.36, -0.001, -0.3], [0.74, 0.04, 0.3]);
    for (y0, y1) in [(0.06, 0.33), (0.34, 0.51), (0.52, 0.69)] {
        desk.material(materials.wood)
            .chamfered([0.345, y0, 0.32], [0.755, y1, 0.348], 0.003);
        let y = y1 - 0.05;
        let handle = [
            [0.47, y, 0.345],
            [0.47, y, 0.37],
            [0.48, y, 0.378],
            [0.62, y, 0.378],
            [0.63, y, 0.37],
            [0.63, y, 0.345],
        ];
        desk.material(materials.chrome)
            .tube(&handle.map(Vec3::from), 8, |_| 0.005);
    }
    desk
}

/// Puts things on the desks, whose places map the desk's space to the world.
pub(super) fn equip(stage: &mut Stage, materials: &Materials, desks: [Affine3A; 3]) {
    let [near, far, window] = desks;
    // Writing must not be mirrored with its desk.
    let upright = |desk: Affine3A, x: f32, z: f32, angle: f32| {
        let turn = Quat::from_rotation_y(angle);
        let place = desk * Affine3A::from_rotation_translation(turn, Vec3::new(x, TOP, z));
        if place.matrix3.determinant() < 0.0 {
            place * Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0))
        } else {
            place
        }
    };
    let monitor = stage.mesh(monitor(materials));
    let keyboard = stage.mesh(keyboard(materials));
    let mouse = stage.mesh(mouse(materials));
    for (desk, x, angle) in [(near, -0.2, 0.0), (far, -0.15, 0.12), (window, -0.1, -0.15)] {
        stage.put(monitor, upright(desk, x, -0.2, angle));
        stage.put(keyboard, upright(desk, x + 0.02, 0.14, angle));
        stage.put(mouse, upright(desk, x + 0.33, 0.16, angle - 0.2));
    }
    let mug = stage.mesh(mug(materials));
    stage.put(mug, upright(near, 0.3, 0.2, 0.7));
    stage.put(mug, upright(window, -0.55, 0.1, 2.4));
    stage.put(mug, upright(far, -0.6, 0.1, -0.4));
    let papers = stage.mesh(papers(materials));
    stage.put(papers, upright(near, 0.52, 0.12, 0.15));
    stage.put(papers, upright(window, 0.5, 0.1, -0.3));
    let pens = stage.mesh(pens(materials));
    stage.put(pens, upright(near, 0.3, -0.22, 0.0));
    stage.single(lamp(materials));
    let plant = stage.mesh(plant(materials));
    stage.put(plant, upright(window, 0.62, -0.18, 0.0));
    let bin = stage.mesh(bin(materials));
    stage.put_at(bin, [-0.75, 0.0, 0.25], 0.0);
    stage.put_at(bin, [-2.6, 0.0, 1.15], 0.0);
    // The large plant in the corner is the small one, grown.
    let corner = Affine3A::from_scale_rotation_translation(
        Vec3::splat(2.6),
        Quat::from_rotation_y(1.0),
        Vec3::new(-2.55, 0.0, -1.95),
    );
    stage.put(plant, corner);
}

fn monitor(materials: &Materials) -> Shape {
    let mut monitor = Shape::new("monitor", materials.plastic);
    monitor.chamfered([-0.3, 0.12, -0.02], [0.3, 0.48, 0.015], 0.006);
    monitor.chamfered([-0.16, 0.2, -0.05], [0.16, 0.4, -0.01], 0.015);
    monitor
        .material(materials.screen)
        .cuboid([-0.288, 0.135, 0.0], [0.288, 0.468, 0.0155]);
    monitor
        .material(materials.steel)
        .chamfered([-0.03, 0.005, -0.06], [0.03, 0.3, -0.045], 0.003)
        .chamfered([-0.13, -0.001, -0.11], [0.13, 0.012, 0.07], 0.004);
    monitor
}

fn keyboard(materials: &Materials) -> Shape {
    let mut keyboard = Shape::new("keyboard", materials.plastic);
    let tilt = Affine3A::from_rotation_translation(
        Quat::from_rotation_x(0.06),
        Vec3::new(0.0, 0.005, 0.0),
    );
    keyboard
        .place(tilt)
        .chamfered([-0.22, -0.006, -0.075], [0.22, 0.012, 0.075], 0.004)
        .material(materials.covers[4]);
    for row in 0..4 {
        let z = -0.054 + 0.036 * row as f32;
        // The space bar takes the place of five keys.
        let mut column = 0;
        while column < 12 {
            let wide = if row == 3 && column == 3 { 5 } else { 1 };
            let x = -0.21 + 0.035 * column as f32;
            let end = x + 0.035 * wide as f32 - 0.004;
            keyboard.cuboid([x, 0.005, z - 0.0155], [end, 0.017, z + 0.0155]);
            column += wide;
        }
    }
    keyboard
}

fn mouse(materials: &Materials) -> Shape {
    let mut mouse = Shape::new("mouse", materials.plastic);
    mouse.cushion([0.0, 0.008, 0.0], [0.03, 0.022, 0.052], 0.7, 12);
    mouse
}

fn mug(materials: &Materials) -> Shape {
    let mut mug = Shape::new("mug", materials.covers[5]);
    mug.lathe(
        &profile([
            [0.0, -0.001],
            [0.034, -0.001],
            [0.038, 0.004],
            [0.04, 0.05],
            [0.041, 0.094],
            [0.0395, 0.0955],
            [0.038, 0.094],
            [0.037, 0.05],
            [0.035, 0.012],
            [0.0, 0.0115],
        ]),
        16,
    );
    let handle: Vec<Vec3> = (0..=8)
        .map(|i| {
            let (sin, cos) = (PI * i as f32 / 8.0).sin_cos();
            Vec3::new(0.037 + 0.03 * sin, 0.05 + 0.028 * cos, 0.0)
        })
        .collect();
    mug.tube(&handle, 6, |_| 0.005);
    mug
}

fn papers(materials: &Materials) -> Shape {
    let mut papers = Shape::new("papers", materials.paper);
    let mut random = Random::new(11);
    for i in 0..6 {
        let y = 0.004 * i as f32;
        let turn = Quat::from_rotation_y(random.range(-0.25, 0.25));
        papers.place(Affine3A::from_rotation_translation(
            turn,
            Vec3::new(random.range(-0.01, 0.01), y, random.range(-0.01, 0.01)),
        ));
        papers.cuboid([-0.105, -0.001, -0.148], [0.105, 0.0035, 0.148]);
    }
    papers
}

fn pens(materials: &Materials) -> Shape {
    let mut pens = Shape::new("pens", materials.steel);
    pens.lathe(
        &profile([
            [0.0, -0.001],
            [0.036, -0.001],
            [0.036, 0.1],
            [0.034, 0.1],
            [0.034, 0.004],
            [0.0, 0.003],
        ]),
        24,
    );
    for i in 0..5 {
        let angle = TAU * i as f32 / 5.0 + 0.4;
        let out = Vec2::from_angle(angle);
        let foot = Vec3::new(0.012 * out.x, 0.006, 0.012 * out.y);
        let head = Vec3::new(0.04 * out.x, 0.15 + 0.008 * i as f32, 0.04 * out.y);
        pens.material(materials.covers[i]);
        pens.tube(&[foot, head, head + 0.004 * Vec3::Y], 8, |j| {
            if j == 2 { 0.0 } else { 0.004 }
        });
    }
    pens
}

/// An arm in two parts on a round foot; stands on the near desk, in world space.
fn lamp(materials: &Materials) -> Shape {
    let mut lamp = Shape::new("desk_lamp", materials.yellow);
    let foot = Vec3::new(1.05, TOP, -0.2);
    let bulb = Vec3::from(LAMP_BULB);
    let axis = (bulb - Vec3::from(LAMP_TARGET)).normalize();
    let neck = bulb + 0.12 * axis;
    let elbow = Vec3::new(1.13, 1.08, -0.24);
    lamp.place(Affine3A::from_translation(foot)).lathe(
        &profile([
            [0.0, -0.001],
            [0.085, -0.001],
            [0.085, 0.012],
            [0.078, 0.02],
            [0.03, 0.026],
            [0.014, 0.05],
            [0.0, 0.052],
        ]),
        24,
    );
    lamp.place(Affine3A::IDENTITY).material(materials.chrome);
    lamp.tube(&[foot + 0.03 * Vec3::Y, elbow], 10, |_| 0.007);
    lamp.tube(&[elbow, neck], 10, |_| 0.007);
    lamp.sphere(elbow, 0.016, 12);
    // The shade opens downwards along the axis, the bulb in its mouth.
    let turn = Quat::from_rotation_arc(Vec3::Y, axis);
    lamp.place(Affine3A::from_rotation_translation(turn, bulb));
    lamp.material(materials.yellow).lathe(
        &profile([
            [0.083, 0.008],
            [0.085, 0.008],
            [0.065, 0.065],
            [0.04, 0.10],
            [0.03, 0.14],
            [0.0, 0.145],
        ]),
        24,
    );
    lamp.material(materials.lacquer).lathe(
        &profile([[0.0, 0.095], [0.036, 0.09], [0.06, 0.06], [0.083, 0.008]]),
        24,
    );
    lamp
}

/// A pot with bent leaves.
fn plant(materials: &Materials) -> Shape {
    let mut plant = Shape::new("plant", materials.clay);
    plant.lathe(
        &profile([
            [0.0, -0.001],
            [0.055, -0.001],
            [0.075, 0.11],
            [0.082, 0.11],
            [0.082, 0.13],
            [0.074, 0.13],
            [0.068, 0.115],
            [0.0, 0.11],
        ]),
        20,
    );
    plant.material(materials.leaf);
    let mut random = Random::new(5);
    for i in 0..16 {
        let angle = 2.399_963 * i as f32;
        let (sin, cos) = angle.sin_cos();
        let out = Vec3::new(cos, 0.0, sin);
        let side = Vec3::new(-sin, 0.0, cos);
        let reach = random.range(0.10, 0.2);
        let height = random.range(0.14, 0.3) * (1.0 - 0.02 * i as f32);
        // A blade that rises, bends over, and is folded along its middle.
        plant.grid([4, 6], [false; 2], |c, r| {
            let t = r as f32 / 6.0;
            let across = c as f32 / 2.0 - 1.0;
            let width = 0.028 * (PI * (0.12 + 0.88 * t)).sin() + 0.001;
            let stem = out * (0.015 + reach * t * t)
                + Vec3::Y * (0.105 + height * (1.6 * t - 0.75 * t * t * t));
            stem + side * (across * width) + (Vec3::Y - 0.6 * out) * (0.4 * width * across.abs())
        });
    }
    plant
}

fn bin(materials: &Materials) -> Shape {
    let mut bin = Shape::new("bin", materials.steel);
    bin.lathe(
        &profile([
            [0.0, -0.001],
            [0.11, -0.001],
            [0.14, 0.3],
            [0.144, 0.305],
            [0.14, 0.31],
            [0.136, 0.305],
            [0.107, 0.006],
            [0.0, 0.005],
        ]),
        20,
    );
    bin
}
