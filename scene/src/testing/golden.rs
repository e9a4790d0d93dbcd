//! What was measured before, kept in a file, and compared with what is measured now.

use std::{collections::BTreeMap, env, fs, path::Path};

/// Measured numbers by their names.
pub type Metrics = BTreeMap<String, f64>;

/// A JSON file of [`Metrics`] by case, and how far numbers may be from it.
#[derive(Clone, Copy, Debug)]
pub struct Golden<'a> {
    /// Where it lies.
    pub file: &'a Path,
    /// Metrics whose names start with `mean` stay the same but for this share of them.
    pub same: f64,
    /// All others are errors or costs: they may be smaller, and up to this many times as large.
    pub worse: f64,
}

impl Golden<'_> {
    /// Compares what was measured with the file, or where the environment says `ISOPHOTE_GOLDEN=write` writes it there.
    ///
    /// Only the cases that were measured are looked at, so that those whose scenes are absent here stay as they are.
    ///
    /// # Panics
    /// If a number is not what it may be, other numbers than those in the file were measured, or the file cannot be read
    /// or written.
    #[track_caller]
    pub fn check(&self, measured: &BTreeMap<String, Metrics>) {
        let mut golden = self.read();
        if env::var_os("ISOPHOTE_GOLDEN").is_some_and(|what| what == "write") {
            golden.extend(measured.clone());
            let text = serde_json::to_string_pretty(&golden).expect("numbers by names are JSON");
            fs::write(self.file, text + "\n")
                .unwrap_or_else(|error| panic!("{}: {error}", self.file.display()));
            return;
        }
        let wrong = self.wrong(measured, &golden);
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }

    /// Empty where there is no file.
    #[track_caller]
    fn read(&self) -> BTreeMap<String, Metrics> {
        if !self.file.exists() {
            return BTreeMap::new();
        }
        let text = fs::read_to_string(self.file).map_err(|error| error.to_string());
        let golden =
            text.and_then(|text| serde_json::from_str(&text).map_err(|error| error.to_string()));
        golden.unwrap_or_else(|error| panic!("{}: {error}", self.file.display()))
    }

    /// What is not as it was, a line each.
    fn wrong(
        &self,
        measured: &BTreeMap<String, Metrics>,
        golden: &BTreeMap<String, Metrics>,
    ) -> Vec<String> {
        let none = Metrics::new();
        let mut wrong = Vec::new();
        for (case, metrics) in measured {
            let golden = golden.get(case).unwrap_or(&none);
            if !metrics.keys().eq(golden.keys()) {
                let [now, was] = [metrics, golden].map(|one| Vec::from_iter(one.keys()));
                wrong.push(format!("{case}: {was:?} were measured, now {now:?} are"));
                continue;
            }
            for (name, &value) in metrics {
                let was = golden[name];
                let fine = if name.starts_with("mean") {
                    (value - was).abs() <= self.same * was
                } else {
                    value <= self.worse * was + 1e-6
                };
                if !fine {
                    wrong.push(format!("{case}: {name} was {was} and is {value}"));
                }
            }
        }
        wrong
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cases(of: &[(&str, &str, f64)]) -> BTreeMap<String, Metrics> {
        let mut cases = BTreeMap::<String, Metrics>::new();
        for &(case, name, value) in of {
            let metrics = cases.entry(case.to_owned()).or_default();
            metrics.insert(name.to_owned(), value);
        }
        cases
    }

    #[test]
    fn only_what_was_measured_is_compared() {
        let golden = Golden {
            file: Path::new("none"),
            same: 0.01,
            worse: 1.1,
        };
        let was = cases(&[
            ("box", "mean", 1.0),
            ("box", "error", 1.0),
            ("hall", "error", 2.0),
        ]);
        let wrong = |now: &[(&str, &str, f64)]| golden.wrong(&cases(now), &was).len();
        assert_eq!(wrong(&[("hall", "error", 0.1)]), 0);
        assert_eq!(wrong(&[("box", "mean", 1.005), ("box", "error", 1.05)]), 0);
        assert_eq!(wrong(&[("box", "mean", 0.9), ("box", "error", 1.2)]), 2);
        assert_eq!(wrong(&[("box", "mean", 1.0)]), 1, "a number is missing");
        assert_eq!(wrong(&[("hall", "error", f64::NAN)]), 1);
        assert_eq!(wrong(&[("cave", "error", 0.0)]), 1, "a case is new");
    }
}
