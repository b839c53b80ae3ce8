//! Figures of runs, their medians and ratios.

use std::collections::BTreeMap;

use serde_json::Value;

/// What one run gave, by name; times in seconds, memory in bytes.
pub(crate) type Figures = BTreeMap<&'static str, f64>;

/// The runs of one program on one scene, in order.
#[derive(Debug, Default)]
pub(crate) struct Series(Vec<Figures>);

impl Series {
    pub(crate) fn push(&mut self, figures: Figures) {
        self.0.push(figures);
    }

    /// Notes a figure that is the same for all runs.
    pub(crate) fn note(&mut self, name: &'static str, value: f64) {
        for figures in &mut self.0 {
            figures.insert(name, value);
        }
    }

    /// The median of figure `name`; `None` where no run has it.
    pub(crate) fn median(&self, name: &str) -> Option<f64> {
        median(self.0.iter().filter_map(|f| f.get(name).copied()).collect())
    }

    /// The least of figure `name`; `None` where no run has it.
    pub(crate) fn least(&self, name: &str) -> Option<f64> {
        self.0.iter().filter_map(|f| f.get(name).copied()).min_by(f64::total_cmp)
    }

    /// The median over rounds of `self`'s figure divided by `by`'s in the same round.
    pub(crate) fn ratio(&self, name: &str, by: &Self, by_name: &str) -> Option<f64> {
        let pairs = self.0.iter().zip(&by.0);
        median(pairs.filter_map(|(a, b)| Some(a.get(name)? / b.get(by_name)?)).collect())
    }

    pub(crate) fn json(&self) -> Value {
        self.0.iter().map(|f| f.iter().map(|(k, v)| ((*k).to_owned(), Value::from(*v))).collect::<Value>()).collect()
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        n if n % 2 == 0 => Some((values[middle - 1] + values[middle]) / 2.0),
        _ => Some(values[middle]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_taken_within_rounds() {
        let series = |values: [f64; 3]| Series(values.iter().map(|v| Figures::from([("whole", *v)])).collect());
        // The machine got slower twice; in every round one is twice as slow as the other.
        let (a, b) = (series([2.0, 8.0, 4.0]), series([1.0, 4.0, 2.0]));
        assert_eq!(a.ratio("whole", &b, "whole"), Some(2.0));
        assert_eq!((a.median("whole"), a.median("trace")), (Some(4.0), None));
    }
}
