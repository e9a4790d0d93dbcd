//! How well the answers of two tracers agree.

use crate::Hit;

/// How a tracer answered some rays, against the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Agreement {
    /// Rays asked.
    pub rays: usize,
    /// Rays that truly hit something.
    pub hits: usize,
    /// Hits where there is none.
    pub false_hits: usize,
    /// Misses where there is a hit.
    pub false_misses: usize,
    /// Hits behind the true ones by more than what is allowed.
    pub late: usize,
    /// Hits before the true ones by more than what is allowed.
    pub early: usize,
    /// |t − true t| in metres at 50, 90, 99, 99.9 and 100 % of the rays that both say hit.
    pub t_error: [f32; 5],
}

impl Agreement {
    /// The quantiles of [`t_error`](Self::t_error).
    pub const QUANTILES: [f64; 5] = [0.5, 0.9, 0.99, 0.999, 1.0];

    /// Compares answers, as many as both have. What is off by no more than `allowed(t)` metres at a true distance of t is
    /// neither late nor early.
    pub fn of(
        answers: &[Option<Hit>],
        truth: &[Option<Hit>],
        allowed: impl Fn(f32) -> f32,
    ) -> Self {
        let mut found = Self {
            rays: answers.len().min(truth.len()),
            ..Self::default()
        };
        let mut errors = Vec::new();
        for pair in answers.iter().zip(truth) {
            found.hits += usize::from(pair.1.is_some());
            match pair {
                (Some(_), None) => found.false_hits += 1,
                (None, Some(_)) => found.false_misses += 1,
                (None, None) => {}
                (Some(hit), Some(truth)) => {
                    let (error, allowed) = (hit.t - truth.t, allowed(truth.t));
                    found.late += usize::from(error > allowed);
                    found.early += usize::from(-error > allowed);
                    errors.push(error.abs());
                }
            }
        }
        errors.sort_by(f32::total_cmp);
        if let Some(last) = errors.len().checked_sub(1) {
            found.t_error = Self::QUANTILES.map(|share| errors[(share * last as f64) as usize]);
        }
        found
    }

    /// Compares whether anything was hit, as many answers as both have.
    pub fn of_occlusion(answers: &[bool], truth: &[bool]) -> Self {
        let count = |answer: bool, true_one: bool| {
            let pairs = answers.iter().zip(truth);
            pairs
                .filter(|&(&a, &t)| (a, t) == (answer, true_one))
                .count()
        };
        let false_misses = count(false, true);
        Self {
            rays: answers.len().min(truth.len()),
            hits: count(true, true) + false_misses,
            false_hits: count(true, false),
            false_misses,
            ..Self::default()
        }
    }

    /// Share of the true hits that were missed or passed.
    pub fn leak_rate(&self) -> f64 {
        (self.false_misses + self.late) as f64 / self.hits.max(1) as f64
    }

    /// Share of all rays that hit where there is nothing.
    pub fn false_hit_rate(&self) -> f64 {
        self.false_hits as f64 / self.rays.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::SurfaceId;

    #[test]
    fn every_pair_is_counted_once() {
        let at = |t| {
            Some(Hit {
                t,
                uv: Vec2::ZERO,
                surface: SurfaceId::UNKNOWN,
            })
        };
        let answers = [at(1.0), at(2.5), at(1.5), None, at(7.0), None, at(3.0001)];
        let truth = [at(1.0), at(2.0), at(2.0), at(1.0), None, None, at(3.0)];
        let found = Agreement::of(&answers, &truth, |t| 1e-3 * t);
        let expected = Agreement {
            rays: 7,
            hits: 5,
            false_hits: 1,
            false_misses: 1,
            late: 1,
            early: 1,
            t_error: found.t_error,
        };
        assert_eq!(found, expected);
        assert_eq!(found.t_error[4], 0.5);
        assert!((found.leak_rate() - 0.4).abs() < 1e-12);
        assert!((found.false_hit_rate() - 1.0 / 7.0).abs() < 1e-12);
        let any = |answers: &[Option<Hit>]| answers.iter().map(Option::is_some).collect::<Vec<_>>();
        let occlusion = Agreement::of_occlusion(&any(&answers), &any(&truth));
        assert_eq!((occlusion.rays, occlusion.hits), (7, 5));
        assert_eq!((occlusion.false_hits, occlusion.false_misses), (1, 1));
    }
}
