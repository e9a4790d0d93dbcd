//! Stage 4: the part of a ray that lies in a placed sphere, and what it meets there.
//!
//! A ray that starts outside is looked up from where it enters. One that starts inside, as under an object that stands on
//! the floor, is looked up from where it leaves: the chord's last surface, seen from behind, tells whether anything lies
//! before the ray at all; only how far away it is has to be found from the front.

use super::look_up::Question;
use crate::{
    lanes::{Lanes, Mask},
    math::Vector,
};

/// The part of a line that lies in the unit sphere.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Chord<L> {
    /// Its middle: the line's point that is closest to the centre.
    middle: Vector<L>,
    /// Unit direction of the line.
    direction: Vector<L>,
    /// Half its length; 0 where the line passes the sphere by, or is none.
    half: L,
    /// Where on the line its middle is.
    at: L,
}

impl<L: Lanes> Chord<L> {
    #[inline(always)]
    fn new(origin: Vector<L>, direction: Vector<L>) -> Self {
        let rough = -origin.dot(direction);
        let near = origin + direction * rough;
        // Far origins leave a rounding error along the line.
        let rest = -near.dot(direction);
        let middle = near + direction * rest;
        let squared = L::splat(1.0) - middle.dot(middle);
        Self {
            middle,
            direction,
            half: squared.max(L::splat(0.0)).sqrt(),
            at: rough + rest,
        }
    }
}

/// Where rays and spheres overlap: in radii along the ray.
#[derive(Clone, Copy)]
pub(crate) struct Span<L: Lanes> {
    chord: Chord<L>,
    /// Lengths of the ray's direction in a radius.
    unit: L,
    t_min: L,
    t_max: L,
    /// Whether the ray starts within the sphere.
    inside: L::Mask,
    /// Whether it can hit anything.
    pub(crate) meets: L::Mask,
}

/// The distances from the ends of chords in fields.
pub(crate) trait Distances<L: Lanes> {
    fn distances(&self, question: &Question<L>) -> L;
}

impl<L: Lanes> Span<L> {
    /// Of rays, by their eight numbers, and the rows of matrices to the spaces of spheres; total for any ray.
    #[inline(always)]
    pub(crate) fn new([start, way]: [[L; 4]; 2], rows: [[L; 4]; 3]) -> Self {
        let [x, y, z, t_min] = start;
        let [u, v, w, t_max] = way;
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let turned = |of: Vector<L>, row: [L; 4]| row[0] * of.x + row[1] * of.y + row[2] * of.z;
        let from = Vector::new(x, y, z);
        let origin = Vector::new(
            turned(from, rows[0]) + rows[0][3],
            turned(from, rows[1]) + rows[1][3],
            turned(from, rows[2]) + rows[2][3],
        );
        let way = Vector::new(u, v, w);
        let way = Vector::new(
            turned(way, rows[0]),
            turned(way, rows[1]),
            turned(way, rows[2]),
        );
        // Squares of very long and very short directions would leave the range.
        let largest = way.x.abs().max(way.y.abs()).max(way.z.abs());
        let scaled = way * (one / largest);
        let length = scaled.dot(scaled).sqrt();
        let chord = Chord::new(origin, scaled * (one / length));
        let length = length * largest;
        let begin = t_min * length;
        // Whatever is NaN makes one of these false.
        let meets = zero.less(chord.half)
            & begin.less(chord.at + chord.half)
            & (chord.at - chord.half).less(t_max * length)
            & !t_min.less(zero)
            & t_min.less(t_max);
        Self {
            chord,
            unit: one / length,
            t_min,
            t_max,
            inside: (chord.at - chord.half).less(begin),
            meets,
        }
    }

    /// Where rays hit, infinite where they do not; not nearer to their starts than `slack` radii.
    ///
    /// Any and closest agree: a ray from within hits if the chord's last surface is in its range, or lies before it and
    /// the first is in its range.
    #[inline(always)]
    pub(crate) fn hits<const ANY: bool>(&self, slack: L, fields: &impl Distances<L>) -> L {
        let (one, miss) = (L::splat(1.0), L::splat(f32::INFINITY));
        let Chord {
            middle,
            direction,
            half,
            at,
        } = self.chord;
        let start = self.t_min + slack * self.unit;
        let mut sign = L::select(self.inside, -one, one);
        let (mut t, mut found) = (miss, self.meets);
        // Once more for those from within of which the last surface does not tell all.
        for again in [false, true] {
            let question = Question {
                middle,
                toward: direction * sign,
                half,
            };
            let distance = fields.distances(&question);
            let end = (at + sign * (distance - half)) * self.unit;
            if again {
                let first = L::select(start.less(end), end.min(t), t);
                t = L::select(self.inside, first, t);
                break;
            }
            // Minus infinity where nothing is hit from within.
            t = end;
            found = found & start.less(t);
            let settled = if ANY { t.less(self.t_max) } else { !found };
            if (self.inside & found & !settled).bits() == 0 {
                break;
            }
            sign = one;
        }
        L::select(found & t.less(self.t_max), t, miss)
    }
}
