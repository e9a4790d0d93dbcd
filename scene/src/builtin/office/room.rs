//! The room itself: walls, window, door, radiator, pendant lamps, and what hangs on the walls.

use glam::{Affine3A, Quat, Vec3};

use super::Materials;
use crate::builtin::{
    shapes::{Shape, profile, quarter_turn},
    stage::Stage,
};

/// Half the inner extents in x and z, and the height, metres.
const X: f32 = 3.0;
const Z: f32 = 2.5;
pub(super) const HEIGHT: f32 = 2.8;
const THICK: f32 = 0.3;
/// The window in the wall at −x: along the wall (z) and up (y).
const WINDOW: [[f32; 2]; 2] = [[-1.3, 0.95], [1.3, 2.4]];
/// x and z of the pendant lamps.
pub(super) const PENDANTS: [[f32; 2]; 2] = [[-1.25, -0.35], [1.25, -0.35]];

pub(super) fn build(stage: &mut Stage, materials: &Materials) {
    stage.single(shell(materials));
    stage.single(trim(materials));
    stage.single(window(materials));
    stage.single(door(materials));
    stage.single(wall_mirror(materials));
    stage.single(clock(materials));
    let radiator = stage.mesh(radiator(materials));
    for z in [-0.62, 0.62] {
        stage.put_at(radiator, [-X + 0.02, 0.0, z], 0.0);
    }
    let pendant = stage.mesh(pendant(materials));
    for [x, z] in PENDANTS {
        stage.put_at(pendant, [x, 0.0, z], 0.0);
    }
    let picture = stage.mesh(picture(materials));
    let hang = |x: f32, y: f32, scale: Vec3| {
        Affine3A::from_scale_rotation_translation(
            scale,
            Quat::IDENTITY,
            Vec3::new(x, y, -Z + 0.001),
        )
    };
    stage.put(picture, hang(-2.35, 1.75, Vec3::ONE));
    stage.put(picture, hang(-2.35, 1.15, Vec3::new(-0.8, 0.7, 1.0)));
}

/// Brings the local xy plane onto the wall at −x: local x runs along −z, local z into the room.
fn on_window_wall() -> Affine3A {
    Affine3A::from_translation(Vec3::new(-X, 0.0, 0.0)) * quarter_turn(1)
}

/// Slabs that go through each other at the corners by different lengths.
fn shell(materials: &Materials) -> Shape {
    let mut shell = Shape::new("shell", materials.carpet);
    let out = THICK;
    shell.cuboid([-X - 0.4, -out, -Z - 0.4], [X + 0.4, 0.0, Z + 0.4]);
    shell.material(materials.ceiling).cuboid(
        [-X - 0.4, HEIGHT, -Z - 0.4],
        [X + 0.4, HEIGHT + out, Z + 0.4],
    );
    shell.material(materials.wall);
    for side in [-1.0, 1.0_f32] {
        let [near, far] = [side * Z, side * (Z + out)];
        shell.cuboid(
            [-X - 0.35, -0.1, near.min(far)],
            [X + 0.35, HEIGHT + 0.1, near.max(far)],
        );
    }
    shell.cuboid([X, -0.15, -Z - 0.1], [X + out, HEIGHT + 0.15, Z + 0.1]);
    shell.place(on_window_wall()).frame(
        [[-Z - 0.1, -0.15], [Z + 0.1, HEIGHT + 0.15]],
        WINDOW,
        [-out, 0.0],
    );
    shell
}

/// Skirting board and cornice.
fn trim(materials: &Materials) -> Shape {
    let mut trim = Shape::new("trim", materials.lacquer);
    let corners = [[-X, -Z], [-X, Z], [X, Z], [X, -Z]];
    // Mouldings project to the left of the way, so the room is walked round counter-clockwise from above.
    let path = |y: f32| corners.map(|[x, z]| Vec3::new(x, y, z));
    let skirting = profile([[0.014, -0.01], [0.014, 0.07], [0.006, 0.09], [-0.01, 0.09]]);
    let cornice = profile([
        [-0.01, -0.09],
        [0.015, -0.09],
        [0.02, -0.06],
        [0.04, -0.03],
        [0.07, -0.015],
        [0.07, 0.01],
    ]);
    trim.moulding(&skirting, &path(0.0), true);
    trim.moulding(&cornice, &path(HEIGHT), true);
    trim
}

/// Frame, two mullions, a transom, the sill, and a blind whose slats the sun just passes.
fn window(materials: &Materials) -> Shape {
    let [[x0, y0], [x1, y1]] = WINDOW;
    let mut window = Shape::new("window", materials.lacquer);
    window.place(on_window_wall());
    let (o, f) = (0.02, 0.06);
    window.frame(
        [[x0 - o, y0 - o], [x1 + o, y1 + o]],
        [[x0 + f, y0 + f], [x1 - f, y1 - f]],
        [-0.2, -0.13],
    );
    for x in [-0.42, 0.42] {
        window.cuboid([x - 0.025, y0 + 0.01, -0.19], [x + 0.025, y1 - 0.01, -0.14]);
    }
    window.cuboid([x0 + 0.01, 1.94, -0.185], [x1 - 0.01, 1.98, -0.145]);
    window.chamfered(
        [x0 - 0.06, y0 - 0.03, -0.16],
        [x1 + 0.06, y0 + 0.012, 0.14],
        0.006,
    );
    // Head rail, then slats turned about their length into the sun's direction.
    window.cuboid(
        [x0 + 0.07, y1 - 0.09, -0.115],
        [x1 - 0.07, y1 - 0.052, -0.065],
    );
    for i in 0..28 {
        let y = y1 - 0.12 - 0.048 * i as f32;
        window.place(
            on_window_wall()
                * Affine3A::from_rotation_translation(
                    Quat::from_rotation_x(0.62),
                    Vec3::new(0.0, y, -0.09),
                ),
        );
        window.cuboid([x0 + 0.08, -0.0006, -0.025], [x1 - 0.08, 0.0006, 0.025]);
    }
    window.place(on_window_wall());
    // Handles.
    window.material(materials.chrome);
    for x in [-0.42, 0.42] {
        window.chamfered([x - 0.01, 1.40, -0.145], [x + 0.01, 1.52, -0.115], 0.004);
    }
    window
}

fn door(materials: &Materials) -> Shape {
    let mut door = Shape::new("door", materials.lacquer);
    door.place(Affine3A::from_translation(Vec3::new(X, 0.0, 0.9)) * quarter_turn(3));
    door.frame(
        [[-0.56, -0.02], [0.56, 2.2]],
        [[-0.46, -0.005], [0.46, 2.1]],
        [-0.03, 0.04],
    );
    door.material(materials.wood)
        .cuboid([-0.47, 0.006, -0.02], [0.47, 2.11, 0.025]);
    for [y0, y1] in [[0.15, 0.95], [1.1, 1.98]] {
        door.frame(
            [[-0.36, y0], [0.36, y1]],
            [[-0.31, y0 + 0.05], [0.31, y1 - 0.05]],
            [0.02, 0.034],
        );
    }
    door.material(materials.chrome);
    door.tube(
        &[
            [0.39, 1.02, 0.02],
            [0.39, 1.02, 0.065],
            [0.375, 1.02, 0.078],
            [0.27, 1.02, 0.08],
            [0.268, 1.02, 0.08],
        ]
        .map(Vec3::from),
        10,
        |j| if j == 4 { 0.0 } else { 0.009 },
    );
    door
}

fn wall_mirror(materials: &Materials) -> Shape {
    let mut mirror = Shape::new("wall_mirror", materials.wood);
    mirror.at(2.35, 1.35, -Z);
    mirror.frame(
        [[-0.36, -0.62], [0.36, 0.62]],
        [[-0.3, -0.56], [0.3, 0.56]],
        [-0.01, 0.035],
    );
    mirror
        .material(materials.mirror)
        .cuboid([-0.33, -0.59, -0.005], [0.33, 0.59, 0.015]);
    mirror
}

fn picture(materials: &Materials) -> Shape {
    let mut picture = Shape::new("picture", materials.plastic);
    picture.frame(
        [[-0.3, -0.22], [0.3, 0.22]],
        [[-0.27, -0.19], [0.27, 0.19]],
        [-0.01, 0.025],
    );
    picture
        .material(materials.paper)
        .cuboid([-0.28, -0.2, -0.005], [0.28, 0.2, 0.012]);
    for (i, [x, y, w, h]) in [
        [-0.12, 0.02, 0.09, 0.12],
        [0.05, -0.05, 0.07, 0.08],
        [0.13, 0.06, 0.05, 0.06],
    ]
    .into_iter()
    .enumerate()
    {
        let depth = 0.013 + 0.0005 * i as f32;
        picture
            .material(materials.covers[i])
            .cuboid([x - w, y - h, depth - 0.008], [x + w, y + h, depth]);
    }
    picture
}

fn clock(materials: &Materials) -> Shape {
    let mut clock = Shape::new("clock", materials.chrome);
    let upright = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
    clock.place(Affine3A::from_rotation_translation(
        upright,
        Vec3::new(1.35, 2.3, -Z - 0.005),
    ));
    clock.lathe(
        &profile([[0.16, 0.0], [0.16, 0.035], [0.145, 0.04], [0.14, 0.03]]),
        32,
    );
    clock
        .material(materials.paper)
        .lathe(&profile([[0.15, 0.0], [0.15, 0.025], [0.0, 0.025]]), 32);
    clock.at(1.35, 2.3, -Z - 0.005).material(materials.plastic);
    for (angle, length, z) in [(0.6_f32, 0.08, 0.028), (-1.9, 0.115, 0.031)] {
        let turn = Quat::from_rotation_z(angle);
        clock.place(Affine3A::from_rotation_translation(
            turn,
            Vec3::new(1.35, 2.3, -Z - 0.005),
        ));
        clock.cuboid([-0.005, -0.02, z], [0.005, length, z + 0.002]);
    }
    clock
}

/// Fins on two pipes; in front of the wall at −x, along z.
fn radiator(materials: &Materials) -> Shape {
    let mut radiator = Shape::new("radiator", materials.lacquer);
    for i in 0..12 {
        let z = (i as f32 - 5.5) * 0.085;
        radiator.cuboid([0.03, 0.14, z - 0.03], [0.11, 0.72, z + 0.03]);
    }
    for y in [0.2, 0.66] {
        let pipe = [-0.52, 0.52].map(|z| Vec3::new(0.07, y, z));
        radiator.tube(&pipe, 10, |_| 0.018);
    }
    radiator
}

fn pendant(materials: &Materials) -> Shape {
    let mut pendant = Shape::new("pendant_lamp", materials.steel);
    pendant.lathe(
        &profile([
            [0.225, 2.06],
            [0.23, 2.06],
            [0.215, 2.12],
            [0.17, 2.18],
            [0.10, 2.22],
            [0.045, 2.24],
            [0.04, 2.30],
            [0.0, 2.31],
        ]),
        28,
    );
    // The same from inside, white.
    pendant.material(materials.lacquer).lathe(
        &profile([
            [0.0, 2.215],
            [0.095, 2.205],
            [0.16, 2.17],
            [0.205, 2.115],
            [0.225, 2.06],
        ]),
        28,
    );
    pendant.material(materials.plastic);
    let cord = [2.3, HEIGHT + 0.01].map(|y| Vec3::new(0.0, y, 0.0));
    pendant.tube(&cord, 8, |_| 0.004);
    pendant.lathe(
        &profile([
            [0.0, HEIGHT - 0.03],
            [0.05, HEIGHT - 0.025],
            [0.055, HEIGHT + 0.01],
        ]),
        24,
    );
    pendant
}
