//! Twice as many numbers: two halves that do not wait for each other, which keeps a processor busy where one chain of
//! operations would not.

use std::ops::{Add, BitAnd, BitOr, Div, Index, Mul, Neg, Not, Sub};

use super::{Lanes, Mask};

#[derive(Clone, Copy)]
pub(crate) struct Two<L>(L, L);

#[derive(Clone, Copy)]
pub(crate) struct TwoMask<M> {
    halves: [M; 2],
    /// Lanes of a half.
    count: u32,
}

/// Something for each lane of both.
#[derive(Clone, Copy)]
pub(crate) struct TwoArray<A> {
    halves: [A; 2],
    /// Lanes of a half.
    count: usize,
}

impl<A: Index<usize>> Index<usize> for TwoArray<A> {
    type Output = A::Output;
    #[inline(always)]
    fn index(&self, lane: usize) -> &A::Output {
        let [first, second] = &self.halves;
        if lane < self.count {
            &first[lane]
        } else {
            &second[lane - self.count]
        }
    }
}

macro_rules! operator {
    ($trait:ident, $name:ident) => {
        impl<L: Lanes> $trait for Two<L> {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self(self.0.$name(other.0), self.1.$name(other.1))
            }
        }
    };
}
operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl<L: Lanes> Neg for Two<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}

impl<M: Mask> TwoMask<M> {
    #[inline(always)]
    fn with(self, other: Self, combine: impl Fn(M, M) -> M) -> Self {
        let ([a, b], [c, d]) = (self.halves, other.halves);
        Self {
            halves: [combine(a, c), combine(b, d)],
            ..self
        }
    }
}

impl<M: Mask> BitAnd for TwoMask<M> {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        self.with(other, M::bitand)
    }
}

impl<M: Mask> BitOr for TwoMask<M> {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        self.with(other, M::bitor)
    }
}

impl<M: Mask> Not for TwoMask<M> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        let [first, second] = self.halves;
        Self {
            halves: [!first, !second],
            ..self
        }
    }
}

impl<M: Mask> Mask for TwoMask<M> {
    #[inline(always)]
    fn bits(self) -> u32 {
        self.halves[0].bits() | self.halves[1].bits() << self.count
    }
}

impl<L: Lanes> Lanes for Two<L> {
    const COUNT: usize = 2 * L::COUNT;
    type Mask = TwoMask<L::Mask>;
    type Array<T: Copy> = TwoArray<L::Array<T>>;

    #[inline(always)]
    fn array<T: Copy>(mut value: impl FnMut(usize) -> T) -> Self::Array<T> {
        let first = L::array(&mut value);
        let second = L::array(
            #[inline(always)]
            |lane| value(L::COUNT + lane),
        );
        TwoArray {
            halves: [first, second],
            count: L::COUNT,
        }
    }

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(L::splat(value), L::splat(value))
    }

    #[inline(always)]
    fn of(mut value: impl FnMut(usize) -> f32) -> Self {
        let first = L::of(&mut value);
        let second = L::of(
            #[inline(always)]
            |lane| value(L::COUNT + lane),
        );
        Self(first, second)
    }

    #[inline(always)]
    fn of_whole(mut value: impl FnMut(usize) -> u32) -> Self {
        let first = L::of_whole(&mut value);
        let second = L::of_whole(
            #[inline(always)]
            |lane| value(L::COUNT + lane),
        );
        Self(first, second)
    }

    #[inline(always)]
    fn columns(mut row: impl FnMut(usize) -> [f32; 4]) -> [Self; 4] {
        let first = L::columns(&mut row);
        let second = L::columns(
            #[inline(always)]
            |lane| row(L::COUNT + lane),
        );
        [0, 1, 2, 3].map(|column| Self(first[column], second[column]))
    }

    #[inline(always)]
    fn load(values: &[f32]) -> Self {
        Self(L::load(values), L::load(&values[L::COUNT..]))
    }

    #[inline(always)]
    fn to_array(self) -> Self::Array<f32> {
        TwoArray {
            halves: [self.0.to_array(), self.1.to_array()],
            count: L::COUNT,
        }
    }

    #[inline(always)]
    fn to_whole(self) -> Self::Array<u32> {
        TwoArray {
            halves: [self.0.to_whole(), self.1.to_whole()],
            count: L::COUNT,
        }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0), self.1.min(other.1))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0), self.1.max(other.1))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt(), self.1.sqrt())
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs(), self.1.abs())
    }

    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        Self(self.0.copysign(sign.0), self.1.copysign(sign.1))
    }

    #[inline(always)]
    fn less(self, other: Self) -> Self::Mask {
        TwoMask {
            halves: [self.0.less(other.0), self.1.less(other.1)],
            count: L::COUNT as u32,
        }
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        let [first, second] = mask.halves;
        Self(
            L::select(first, yes.0, no.0),
            L::select(second, yes.1, no.1),
        )
    }
}
