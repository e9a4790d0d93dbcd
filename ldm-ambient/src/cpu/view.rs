//! Stage 2, how a map looks at the scene: in parallel along its direction, over a rectangle of square pixels.
//!
//! Rays run along the direction only, so a map needs to reach no further than the points that it is asked for: the
//! rectangle is fitted around them. Its sides lie along and across the longest side of their box.

use glam::{Vec2, Vec3};
use isophote_scene::{Aabb, sample::Frame};

/// How much a map reaches beyond its points, of its size.
const ROOM: f32 = 1e-3;

/// The projection of a map.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct View {
    /// Unit axes of the picture.
    pub(crate) right: Vec3,
    pub(crate) up: Vec3,
    /// The map's direction; depths grow along it.
    pub(crate) forward: Vec3,
    /// The corner of the picture, metres along its axes.
    pub(crate) low: Vec2,
    /// Metres.
    pub(crate) pixel: f32,
    pub(crate) columns: usize,
    pub(crate) rows: usize,
}

impl View {
    /// The view along a unit direction whose picture holds all boxes and has at most resolution² pixels.
    pub(crate) fn fit(forward: Vec3, boxes: &[Aabb], longest: Vec3, resolution: u32) -> Self {
        let right = longest.reject_from_normalized(forward);
        let right = if right.length_squared() > 1e-4 {
            right.normalize()
        } else {
            Frame::new(forward).x
        };
        let up = forward.cross(right).normalize();
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for bounds in boxes {
            let (center, half) = (bounds.center(), 0.5 * (bounds.max - bounds.min));
            let middle = Vec2::new(center.dot(right), center.dot(up));
            let reach = Vec2::new(half.dot(right.abs()), half.dot(up.abs()));
            low = low.min(middle - reach);
            high = high.max(middle + reach);
        }
        let size = (high - low).max(Vec2::ZERO);
        // A line or a point of a picture gets some width.
        let room = (ROOM * size.max_element()).max(1e-6 * low.abs().max(high.abs()).max_element());
        let size = (size + 2.0 * room).max(Vec2::splat(f32::MIN_POSITIVE));
        let cells = f64::from(resolution).powi(2);
        let shape = f64::from(size.x) / f64::from(size.y);
        let columns = (cells * shape).sqrt().floor().clamp(1.0, cells);
        let rows = (cells / columns).floor().max(1.0);
        let pixel = (size.x / columns as f32).max(size.y / rows as f32);
        Self {
            right,
            up,
            forward,
            low: 0.5 * (low + high) - 0.5 * pixel * Vec2::new(columns as f32, rows as f32),
            pixel,
            columns: columns as usize,
            rows: rows as usize,
        }
    }

    pub(crate) fn pixels(&self) -> usize {
        self.columns * self.rows
    }

    /// Where a point is in the picture, pixels, and how deep, metres.
    #[inline]
    pub(crate) fn place(&self, point: Vec3) -> (Vec2, f32) {
        let at = Vec2::new(point.dot(self.right), point.dot(self.up)) - self.low;
        (at / self.pixel, point.dot(self.forward))
    }

    /// The number of the pixel at a place, if it is in the picture.
    #[inline]
    pub(crate) fn index(&self, at: Vec2) -> Option<usize> {
        let inside =
            at.cmpge(Vec2::ZERO).all() && at.x < self.columns as f32 && at.y < self.rows as f32;
        inside.then(|| at.y as usize * self.columns + at.x as usize)
    }
}

/// The unit axis along which a box is longest.
pub(crate) fn longest_axis(bounds: &Aabb) -> Vec3 {
    Vec3::AXES[(bounds.max - bounds.min).max_position()]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every point of the boxes is in the picture, which has no more pixels than asked for.
    #[test]
    fn pictures_hold_the_boxes() {
        let boxes = [
            Aabb {
                min: Vec3::new(-20.0, 0.0, -3.0),
                max: Vec3::new(1.0, 5.0, 9.0),
            },
            Aabb {
                min: Vec3::splat(7.0),
                max: Vec3::splat(7.0),
            },
        ];
        for resolution in [1, 2, 50, 200] {
            for &forward in crate::Directions::new(64).vectors() {
                let view = View::fit(forward, &boxes, Vec3::X, resolution);
                assert!(view.pixels() <= (resolution * resolution) as usize);
                assert!((view.right.cross(view.up) - forward).length() < 1e-5);
                for corner in boxes.iter().flat_map(Aabb::corners) {
                    assert!(
                        view.index(view.place(corner).0).is_some(),
                        "{view:?} {corner}"
                    );
                }
            }
        }
        let flat = View::fit(
            Vec3::X,
            &[Aabb {
                min: Vec3::ZERO,
                max: Vec3::X,
            }],
            Vec3::X,
            200,
        );
        assert!(flat.index(flat.place(Vec3::ZERO).0).is_some());
    }
}
