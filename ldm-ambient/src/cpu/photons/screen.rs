//! What the camera sees, tile by tile: the surfaces that photons light.

use glam::{Vec2, Vec3};
use isophote_scene::{Camera, GBuffer, Pinhole};

use crate::cpu::lanes::{LANES, Lanes, Vectors};

/// Pixels of a tile's side.
pub(crate) const TILE: usize = 16;

/// Eight pixels beside each other. Where nothing is seen normals are zero.
#[derive(Clone, Copy)]
pub(crate) struct Pixels {
    pub(crate) positions: Vectors,
    pub(crate) normals: Vectors,
}

/// The surfaces of a picture.
pub(crate) struct Screen {
    pub(crate) size: [u32; 2],
    /// How many tiles there are, across and down.
    pub(crate) tiles: [usize; 2],
    /// By tile, row of the tile, and eight columns.
    pub(crate) pixels: Vec<Pixels>,
    eye: Pinhole,
    /// Half the picture's height in pixels over the tangent of half the opening.
    scale: f32,
}

impl Screen {
    pub(crate) fn new(seen: &GBuffer, camera: &Camera) -> Self {
        let [width, height] = seen.size;
        let tiles = [width, height].map(|side| (side as usize).div_ceil(TILE));
        let none = Pixels {
            positions: [[0.0; LANES]; 3],
            normals: [[0.0; LANES]; 3],
        };
        let eye = camera.pinhole();
        let mut screen = Self {
            size: seen.size,
            tiles,
            pixels: vec![none; tiles[0] * tiles[1] * TILE * TILE / LANES],
            eye,
            scale: 0.5 * height as f32 / (0.5 * eye.yfov).tan(),
        };
        for (index, seen) in seen.pixels.iter().enumerate() {
            let Some(seen) = seen else { continue };
            let (block, lane) = screen.place(index % width as usize, index / width as usize);
            let normal = isophote_scene::facing(seen.point.geometric_normal, seen.view);
            for axis in 0..3 {
                screen.pixels[block].positions[axis][lane] = seen.point.position[axis];
                screen.pixels[block].normals[axis][lane] = normal[axis];
            }
        }
        screen
    }

    /// The block and the lane of a pixel.
    pub(crate) fn place(&self, column: usize, row: usize) -> (usize, usize) {
        let tile = row / TILE * self.tiles[0] + column / TILE;
        let within = row % TILE * (TILE / LANES) + column % TILE / LANES;
        (tile * (TILE * TILE / LANES) + within, column % LANES)
    }

    /// Where a point is in the picture, pixels; none where it is behind the viewer.
    #[inline]
    pub(crate) fn project(&self, point: Vec3) -> Option<Vec2> {
        let offset = point - self.eye.eye;
        let depth = offset.dot(self.eye.forward);
        if depth <= 1e-4 {
            return None;
        }
        let at =
            Vec2::new(offset.dot(self.eye.right), -offset.dot(self.eye.up)) * (self.scale / depth);
        Some(at + 0.5 * Vec2::new(self.size[0] as f32, self.size[1] as f32))
    }

    /// How many pixels a metre has at a point.
    #[inline]
    pub(crate) fn pixels_per_metre(&self, point: Vec3) -> f32 {
        self.scale / self.eye.depth(point).max(1e-4)
    }

    /// The surface in the pixel at a place, or in the nearest of the picture's border: a point of it and its normal.
    #[inline]
    pub(crate) fn surface(&self, at: Vec2) -> Option<(Vec3, Vec3)> {
        let last = Vec2::new((self.size[0] - 1) as f32, (self.size[1] - 1) as f32);
        let at = at.floor().clamp(Vec2::ZERO, last);
        let (block, lane) = self.place(at.x as usize, at.y as usize);
        let of = |vectors: &Vectors| Vec3::from_array(vectors.map(|axis| axis[lane]));
        let normal = of(&self.pixels[block].normals);
        (normal != Vec3::ZERO).then(|| (of(&self.pixels[block].positions), normal))
    }

    /// No light, laid out as splats are added.
    pub(super) fn dark(&self) -> Vec<[Lanes; 3]> {
        vec![[[0.0; LANES]; 3]; self.pixels.len()]
    }

    /// Light row by row.
    pub(super) fn rows(&self, light: &[[Lanes; 3]]) -> Vec<Vec3> {
        debug_assert_eq!(light.len() % (TILE * TILE / LANES), 0);
        let [width, height] = self.size.map(|side| side as usize);
        let pixel = |index: usize| {
            let (block, lane) = self.place(index % width, index / width);
            Vec3::from_array(light[block].map(|channel| channel[lane]))
        };
        (0..width * height).map(pixel).collect()
    }
}
