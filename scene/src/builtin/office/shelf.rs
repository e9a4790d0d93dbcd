//! Shelves along the back wall and the books in them.

use glam::{Affine3A, Quat, Vec3};

use super::Materials;
use crate::builtin::{random::Random, shapes::Shape, stage::Stage};

const WIDTH: f32 = 1.1;
const DEPTH: f32 = 0.3;
/// Tops of the boards that books stand on.
const BOARDS: [f32; 5] = [0.09, 0.48, 0.86, 1.24, 1.62];
/// Left edges of the two shelves, and their backs' z.
const PLACES: [f32; 2] = [-1.55, -0.15];
const BACK: f32 = -2.498;

pub(super) fn build(stage: &mut Stage, materials: &Materials) {
    let shelf = stage.mesh(shelf(materials));
    let place = |x: f32| Affine3A::from_translation(Vec3::new(x, 0.0, BACK));
    stage.put(shelf, place(PLACES[0]));
    let mirrored = place(PLACES[1] + WIDTH) * Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    stage.put(shelf, mirrored);

    let books: Vec<u32> = (0..materials.covers.len())
        .map(|color| stage.mesh(book(materials, color)))
        .collect();
    let mut random = Random::new(2);
    for left in PLACES {
        for board in BOARDS {
            row(stage, &books, &mut random, left, board);
        }
    }
}

/// Sides, boards, back, and a door before the lowest compartment's left half.
fn shelf(materials: &Materials) -> Shape {
    let mut shelf = Shape::new("shelf", materials.wood);
    shelf.cuboid([0.0, -0.001, 0.0], [0.022, 2.0, DEPTH]);
    shelf.cuboid([WIDTH - 0.022, -0.001, 0.0], [WIDTH, 2.0, DEPTH]);
    shelf.cuboid([0.01, -0.002, 0.002], [WIDTH - 0.01, 1.995, 0.013]);
    for top in BOARDS {
        shelf.cuboid(
            [0.011, top - 0.022, 0.005],
            [WIDTH - 0.011, top, DEPTH - 0.004],
        );
    }
    shelf.cuboid([-0.01, 1.985, -0.001], [WIDTH + 0.01, 2.01, DEPTH + 0.01]);
    shelf.material(materials.lacquer).chamfered(
        [0.024, 0.095, DEPTH - 0.025],
        [0.55, 0.455, DEPTH - 0.002],
        0.002,
    );
    shelf
        .material(materials.chrome)
        .sphere(Vec3::new(0.51, 0.3, DEPTH + 0.008), 0.012, 12);
    shelf
}

/// 1 wide (x), 1 high and 1 deep, its back towards +z: two boards, a spine, and the pages between.
fn book(materials: &Materials, color: usize) -> Shape {
    const NAMES: [&str; 6] = [
        "book_red",
        "book_blue",
        "book_green",
        "book_ochre",
        "book_grey",
        "book_cream",
    ];
    let mut book = Shape::new(NAMES[color], materials.covers[color]);
    book.cuboid([0.0, 0.002, 0.0], [0.09, 0.998, 0.98]);
    book.cuboid([0.91, 0.003, 0.0015], [1.0, 0.997, 0.981]);
    book.cuboid([-0.015, 0.0, 0.97], [1.015, 1.0, 1.0]);
    book.material(materials.paper)
        .cuboid([0.05, 0.02, 0.02], [0.95, 0.98, 0.975]);
    book
}

/// Fills a board from the left until the books would reach the other side; some rows end early and lean.
fn row(stage: &mut Stage, books: &[u32], random: &mut Random, left: f32, board: f32) {
    let mut x = left + 0.03;
    // The lowest board's left half is behind a door.
    if board == BOARDS[0] {
        x += if left == PLACES[0] { 0.56 } else { 0.0 };
    }
    let behind_mirrored_door = board == BOARDS[0] && left != PLACES[0];
    let room = if behind_mirrored_door {
        0.5
    } else {
        random.range(0.7, 1.04)
    };
    let end = left + room.min(WIDTH - 0.03);
    loop {
        let size = Vec3::new(
            random.range(0.045, 0.1),
            random.range(0.2, 0.31),
            random.range(0.15, 0.22),
        );
        if x + size.x + 0.004 > end {
            return;
        }
        // Spines nearly in line; every book a millimetre into its board.
        let front = DEPTH - 0.02 - random.range(0.0, 0.02);
        let corner = Vec3::new(x, board - 0.001, BACK + front - size.z);
        let place = Affine3A::from_scale_rotation_translation(size, Quat::IDENTITY, corner);
        stage.put(books[random.index(books.len())], place);
        x += size.x * 1.03 + 0.003;
    }
}
