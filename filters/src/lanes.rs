//! Sixteen pixels at a time: kernels are plain loops over [`Lanes`] that the compiler turns into vector
//! instructions, compiled once for every processor and once for those with AVX2 and FMA.

/// Pixels that a kernel works on together.
pub(crate) const LANES: usize = 16;

/// One number for each of [`LANES`] neighbouring pixels.
pub(crate) type Lanes = [f32; LANES];

/// A loop that is worth compiling for newer processors.
///
/// `run` must be `#[inline(always)]`, and so must be all it calls in its loops.
pub(crate) trait Kernel {
    /// `FMA` says that a fused multiply-add costs one instruction.
    fn run<const FMA: bool>(self);
}

/// Runs a kernel with the best instructions this processor has.
pub(crate) fn run(kernel: impl Kernel) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,fma")]
        fn with_avx2(kernel: impl Kernel) {
            kernel.run::<true>();
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            #[expect(unsafe_code, reason = "calls code for a processor found at run time")]
            // SAFETY: the processor has just been asked for AVX2 and FMA, all that the function needs.
            return unsafe { with_avx2(kernel) };
        }
    }
    kernel.run::<false>();
}

/// a · b + c, rounded once where that costs nothing.
#[inline(always)]
pub(crate) fn multiply_add<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// `row[start..start + LANES]`, with `outside` where that leaves the row.
#[inline(always)]
pub(crate) fn load(row: &[f32], start: isize, outside: f32) -> Lanes {
    let inside = usize::try_from(start)
        .ok()
        .and_then(|start| row.get(start..)?.first_chunk());
    match inside {
        Some(lanes) => *lanes,
        None => load_edge(row, start, outside),
    }
}

/// The values that lie `steps` from `columns` in a row, with `outside` where that leaves it.
#[inline(always)]
pub(crate) fn load_apart(
    row: &[f32],
    columns: &[usize; LANES],
    steps: isize,
    outside: f32,
) -> Lanes {
    std::array::from_fn(|lane| {
        // Columns before the first become large ones.
        let column = columns[lane].wrapping_add_signed(steps);
        row.get(column).copied().unwrap_or(outside)
    })
}

#[cold]
#[inline(never)]
fn load_edge(row: &[f32], start: isize, outside: f32) -> Lanes {
    std::array::from_fn(|lane| {
        let index = usize::try_from(start + lane as isize).ok();
        index
            .and_then(|index| row.get(index))
            .copied()
            .unwrap_or(outside)
    })
}

/// Where the chunks of `N` of a row begin. The last one begins early, so that none but the only one leaves the row.
#[inline(always)]
pub(crate) fn chunks<const N: usize>(width: usize) -> impl Iterator<Item = usize> {
    (0..width)
        .step_by(N)
        .map(move |start| start.min(width.saturating_sub(N)))
}

/// eˣ for x ≤ 0, within 3 · 10⁻⁷ of its value where that is at least 10⁻³⁷, else 0.
///
/// 2ⁿ times a polynomial in the fraction (Cody and Waite's reduction, a Taylor series); the library's `exp` is a
/// call that keeps loops from becoming vector code.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    /// Adding and subtracting 1.5 · 2²³ rounds to an integer, which then lies in the lowest bits of the sum.
    const ROUND: f32 = 12_582_912.0;
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    let clamped = x.max(-87.0);
    let rounded = clamped * std::f32::consts::LOG2_E + ROUND;
    let n = rounded - ROUND;
    let f = clamped - n * LN_2_HIGH - n * LN_2_LOW;
    let series = 1.0 / 720.0;
    let series = series * f + 1.0 / 120.0;
    let series = series * f + 1.0 / 24.0;
    let series = series * f + 1.0 / 6.0;
    let series = series * f + 0.5;
    let series = series * f + 1.0;
    let series = series * f + 1.0;
    let bits = (rounded.to_bits() << 23).wrapping_add(127 << 23);
    let result = series * f32::from_bits(bits);
    if x < -85.0 { 0.0 } else { result }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_exact_enough() {
        for step in 0..=850_000 {
            let x = step as f32 * -1e-4;
            let exact = f64::from(x).exp();
            let error = (f64::from(exp(x)) / exact - 1.0).abs();
            assert!(error < 3e-7, "exp({x}) is off by {error}");
        }
        assert_eq!(exp(0.0), 1.0);
        assert_eq!(exp(-0.0), 1.0);
        assert_eq!(exp(-90.0), 0.0);
        assert_eq!(exp(-1e30), 0.0);
        assert_eq!(exp(f32::NEG_INFINITY), 0.0);
    }

    #[test]
    fn loads_stay_inside() {
        let row: Vec<f32> = (0..20).map(|i| i as f32).collect();
        assert_eq!(load(&row, 4, -1.0)[..2], [4.0, 5.0]);
        assert_eq!(load(&row, 5, -1.0)[14..], [19.0, -1.0]);
        assert_eq!(load(&row, -2, -1.0)[..3], [-1.0, -1.0, 0.0]);
        assert_eq!(load(&row, -40, -1.0), [-1.0; LANES]);
        assert_eq!(load(&row, 40, -1.0), [-1.0; LANES]);
        let columns = std::array::from_fn(|lane| 2 * lane);
        let apart = load_apart(&row, &columns, -1, -1.0);
        assert_eq!(apart[..3], [-1.0, 1.0, 3.0]);
        assert_eq!(apart[10..12], [19.0, -1.0]);
    }

    #[test]
    fn chunks_cover_a_row() {
        assert_eq!(chunks::<16>(40).collect::<Vec<_>>(), [0, 16, 24]);
        assert_eq!(chunks::<16>(16).collect::<Vec<_>>(), [0]);
        assert_eq!(chunks::<16>(5).collect::<Vec<_>>(), [0]);
    }
}
