//! Eight of everything: loops over lanes that compilers turn into vector instructions, registers where those do not get far, and
//! the choice at run time.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod portable;

use glam::Vec3;

pub(crate) use self::portable::Portable;

/// How many are worked on together.
pub(crate) const LANES: usize = 8;
/// A value of each of eight.
pub(crate) type Lanes = [f32; LANES];
/// A vector of each of eight, by axis.
pub(crate) type Vectors = [Lanes; 3];

/// Eight values in registers. What uses them must be inlined into what runs with the instructions: an array's `map` is not.
/// Operations round as those of single numbers do, so results are the same to the bit whoever
/// computes them; where a minimum or a maximum is undefined it is the second one.
pub(crate) trait Simd: Copy {
    type Floats: Copy;
    /// Unsigned, 32 bits.
    type Ints: Copy;
    type Mask: Copy;

    fn load(self, lanes: &Lanes) -> Self::Floats;
    fn store(self, values: Self::Floats) -> Lanes;
    fn splat(self, value: f32) -> Self::Floats;
    fn splat_int(self, value: u32) -> Self::Ints;
    fn add(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn sub(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn mul(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn div(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn min(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn max(self, a: Self::Floats, b: Self::Floats) -> Self::Floats;
    fn abs(self, value: Self::Floats) -> Self::Floats;
    fn floor(self, value: Self::Floats) -> Self::Floats;
    /// The first with the sign of the second.
    fn with_sign(self, value: Self::Floats, sign: Self::Floats) -> Self::Floats;
    fn less(self, a: Self::Floats, b: Self::Floats) -> Self::Mask;
    fn at_most(self, a: Self::Floats, b: Self::Floats) -> Self::Mask;
    fn select(self, mask: Self::Mask, yes: Self::Floats, no: Self::Floats) -> Self::Floats;
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn or(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The first without the second.
    fn and_not(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn none(self) -> Self::Mask;
    /// A bit for each.
    fn bits(self, mask: Self::Mask) -> u32;
    /// Whole numbers below 2³¹.
    fn whole(self, value: Self::Floats) -> Self::Ints;
    /// Wraps.
    fn add_ints(self, a: Self::Ints, b: Self::Ints) -> Self::Ints;
    /// The values where the mask is set, and else 0.
    fn where_set(self, mask: Self::Mask, values: Self::Ints) -> Self::Ints;
    /// Of numbers below 2³¹.
    fn less_ints(self, a: Self::Ints, b: Self::Ints) -> Self::Mask;
    /// From a table; the last entry for places beyond it. An empty one has zeros.
    fn gather_ints(self, table: &[u32], places: Self::Ints) -> Self::Ints;
    /// From a table where the mask is set, and else what is given.
    fn gather_floats(
        self,
        table: &[f32],
        places: Self::Ints,
        mask: Self::Mask,
        otherwise: Self::Floats,
    ) -> Self::Floats;

    /// Four that follow each other from each place of a table, by how far they are from it; the last four for places beyond them.
    /// A table of fewer has zeros.
    fn quads(self, table: &[f32], places: Self::Ints) -> [Self::Floats; 4];

    /// The scalar products of eight vectors with one.
    #[inline(always)]
    fn dot(self, vectors: &Vectors, with: Vec3) -> Self::Floats {
        let [x, y, z] = vectors;
        let x = self.mul(self.load(x), self.splat(with.x));
        let y = self.mul(self.load(y), self.splat(with.y));
        let z = self.mul(self.load(z), self.splat(with.z));
        self.add(self.add(x, y), z)
    }
}

/// What is done with registers.
pub(crate) trait Work {
    fn run<S: Simd>(self, simd: S);
}

/// Runs a function with AVX2 where there is AVX2. The arithmetic is the same, so results are.
#[inline]
pub(crate) fn vectorised<R>(work: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = avx2::Avx2::detect() {
        return avx2.call(work);
    }
    work()
}

/// Does work with the registers that there are.
#[inline]
pub(crate) fn with_registers(work: impl Work) {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = avx2::Avx2::detect() {
        return avx2.call(
            #[inline(always)]
            || work.run(avx2),
        );
    }
    work.run(Portable);
}
