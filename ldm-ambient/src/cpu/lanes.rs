//! Eight of everything: loops over lanes that compilers turn into vector instructions, and their choice at run time.

/// How many are worked on together.
pub(crate) const LANES: usize = 8;
/// A value of each of eight.
pub(crate) type Lanes = [f32; LANES];
/// A vector of each of eight, by axis.
pub(crate) type Vectors = [Lanes; 3];

/// Runs a function with AVX2 where there is AVX2. The arithmetic is the same, so results are.
#[inline]
pub(crate) fn vectorised<R>(work: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("bmi1") {
        #[expect(unsafe_code, reason = "instructions that not every processor has")]
        // SAFETY: the instructions have just been detected.
        return unsafe { with_avx2(work) };
    }
    work()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1")]
fn with_avx2<R>(work: impl FnOnce() -> R) -> R {
    work()
}

/// The scalar products of eight vectors with one.
#[inline(always)]
pub(crate) fn dot(vectors: &Vectors, with: glam::Vec3) -> Lanes {
    let [x, y, z] = vectors;
    std::array::from_fn(|lane| x[lane] * with.x + y[lane] * with.y + z[lane] * with.z)
}
