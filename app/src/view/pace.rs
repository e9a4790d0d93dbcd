//! How small a picture must be to come at once.

/// How much smaller a picture must be so that it comes at once, found by trying.
pub(super) struct Pace {
    /// What it is the pace of.
    of: String,
    pub(super) divisor: u32,
    /// That a whole picture took last.
    pub(super) whole_seconds: Option<f64>,
}

impl Default for Pace {
    fn default() -> Self {
        Self {
            of: String::new(),
            divisor: 4,
            whole_seconds: None,
        }
    }
}

impl Pace {
    /// Seconds within which something must be seen.
    const SOON: f64 = 0.15;

    pub(super) fn start(&mut self, of: String) {
        if self.of != of {
            *self = Self {
                of,
                ..Self::default()
            };
        }
    }

    pub(super) fn took(&mut self, seconds: f64) {
        if seconds > Self::SOON {
            self.divisor = (self.divisor + 1).min(12);
        } else if seconds < 0.3 * Self::SOON {
            self.divisor = (self.divisor - 1).max(1);
        }
    }

    pub(super) fn needs_preview(&self) -> bool {
        self.divisor > 1
            && self
                .whole_seconds
                .is_none_or(|seconds| seconds > Self::SOON)
    }

    pub(super) fn size(&self, size: [u32; 2]) -> [u32; 2] {
        size.map(|side| side.div_ceil(self.divisor).max(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_pictures_get_smaller_and_quick_ones_larger() {
        let mut pace = Pace::default();
        pace.start("a".into());
        assert!(pace.needs_preview());
        assert_eq!(pace.size([101, 2]), [26, 1]);
        for _ in 0..20 {
            pace.took(1.0);
        }
        assert_eq!(pace.divisor, 12);
        for _ in 0..20 {
            pace.took(0.001);
        }
        assert_eq!(pace.divisor, 1);
        assert!(!pace.needs_preview());
        // Something else is tried anew.
        pace.start("b".into());
        assert_eq!(pace.divisor, Pace::default().divisor);
    }
}
