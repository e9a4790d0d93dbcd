//! Stage 2, how a map looks at the scene: in parallel along its direction, over a rectangle of square pixels.
//!
//! Rays run along the direction only, so a map needs to reach no further than the points that it is asked for: the
//! rectangle is fitted around them, in pixels of a lattice that stays where it is. Its sides lie along and across the longest side
//! of their box.

use glam::{DVec2, Vec2, Vec3};
use isophote_scene::{Aabb, sample::Frame};

/// How much a map reaches beyond its points, of its size.
const ROOM: f32 = 1e-3;
/// Sizes of pixels from one to its double.
const SIZES: f64 = 4.0;
/// Sizes that are tried before there is no lattice.
const TRIES: u32 = 9;

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
    /// The view along a unit direction whose picture holds all boxes, which are relative to an origin, and has at most resolution²
    /// pixels.
    ///
    /// Pixels are those of a lattice through the world's origin, and of one of a few sizes: while something moves, maps change
    /// only where it is, but for those whose pixels become of the next size.
    pub(crate) fn fit(
        forward: Vec3,
        origin: Vec3,
        boxes: &[Aabb],
        longest: Vec3,
        resolution: u32,
    ) -> Self {
        let (right, up) = axes(forward, longest);
        let (low, high) = extent(right, up, boxes);
        let of_origin = DVec2::new(
            origin.as_dvec3().dot(right.as_dvec3()),
            origin.as_dvec3().dot(up.as_dvec3()),
        );
        let (low, high) = (low.as_dvec2() + of_origin, high.as_dvec2() + of_origin);
        let (size, cells) = (high - low, f64::from(resolution).powi(2));
        let least = (size.element_product() / cells).sqrt();
        let least = least.max(size.max_element() / cells).max(1e-30);
        let number = (SIZES * least.log2()).ceil();
        for step in 0..TRIES {
            let pixel = ((number + f64::from(step)) / SIZES).exp2() as f32;
            let first = (low / f64::from(pixel)).floor();
            let count = (high / f64::from(pixel)).floor() + 1.0 - first;
            if count.element_product() <= cells {
                return Self {
                    right,
                    up,
                    forward,
                    low: (first * f64::from(pixel) - of_origin).as_vec2(),
                    pixel,
                    columns: count.x as usize,
                    rows: count.y as usize,
                };
            }
        }
        // A lattice has no picture of one pixel around its middle.
        Self::around(forward, boxes, longest, resolution)
    }

    /// The same with the boxes in the middle of the picture, and pixels as small as they can be.
    pub(crate) fn around(forward: Vec3, boxes: &[Aabb], longest: Vec3, resolution: u32) -> Self {
        let (right, up) = axes(forward, longest);
        let (low, high) = extent(right, up, boxes);
        let (size, cells) = (high - low, f64::from(resolution).powi(2));
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
        (at * (1.0 / self.pixel), point.dot(self.forward))
    }

    /// The number of the pixel at a place, if it is in the picture.
    #[inline]
    pub(crate) fn index(&self, at: Vec2) -> Option<usize> {
        let inside =
            at.cmpge(Vec2::ZERO).all() && at.x < self.columns as f32 && at.y < self.rows as f32;
        inside.then(|| at.y as usize * self.columns + at.x as usize)
    }
}

/// Right and up in a picture along a direction; a longest side is as much to the right as it can be.
fn axes(forward: Vec3, longest: Vec3) -> (Vec3, Vec3) {
    let right = longest.reject_from_normalized(forward);
    let right = if right.length_squared() > 1e-4 {
        right.normalize()
    } else {
        Frame::new(forward).x
    };
    (right, forward.cross(right).normalize())
}

/// The corners of a rectangle that holds boxes, with some room.
fn extent(right: Vec3, up: Vec3, boxes: &[Aabb]) -> (Vec2, Vec2) {
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
    let room = room.max(f32::MIN_POSITIVE);
    (low - room, high + room)
}

/// A place near the middle of a box; the same one where the box changes a little.
pub(crate) fn origin_in(bounds: &Aabb) -> Vec3 {
    let (center, step) = (
        bounds.center(),
        (bounds.diagonal().log2().floor() - 1.0).exp2(),
    );
    match step.is_normal() {
        true => (center / step).round() * step,
        false => center,
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
        let origin = Vec3::new(300.0, -7.0, 0.1);
        for resolution in [1, 2, 50, 200] {
            for &forward in crate::Directions::new(64).vectors() {
                let view = View::fit(forward, origin, &boxes, Vec3::X, resolution);
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
            Vec3::ZERO,
            &[Aabb {
                min: Vec3::ZERO,
                max: Vec3::X,
            }],
            Vec3::X,
            200,
        );
        assert!(flat.index(flat.place(Vec3::ZERO).0).is_some());
    }

    /// Whatever grows somewhere else, a place has the same pixel around it, in most maps at least.
    #[test]
    fn pixels_stay_where_they_are() {
        let around = |side: f32| Aabb {
            min: Vec3::new(-2.0, -1.0, -3.0),
            max: Vec3::new(2.0, 1.0, side),
        };
        let point = Vec3::new(0.3, 0.2, -1.7);
        let directions = crate::Directions::new(200);
        let mut moved = 0;
        for &forward in directions.vectors() {
            let view = |side: f32| {
                let bounds = around(side);
                let origin = Vec3::splat(40.0) + 0.1 * side;
                let relative = Aabb {
                    min: bounds.min - origin,
                    max: bounds.max - origin,
                };
                let view = View::fit(forward, origin, &[relative], Vec3::Z, 100);
                assert!(view.pixels() > 4000, "{view:?}");
                (view.place(point - origin).0.fract(), view.pixel)
            };
            let (at, pixel) = view(3.0);
            let (then, other) = view(3.1);
            moved += u32::from(other != pixel || (at - then).abs().max_element() > 1e-2);
        }
        // The maps grow by up to 0.8 % a side, and sizes are 19 % apart.
        assert!(moved < 20, "{moved}");
    }
}
