//! Seconds as a function of the error reached.

/// The middle of several numbers, or the mean of the two in the middle; 0 of none.
pub(crate) fn median(numbers: &[f64]) -> f64 {
    let mut sorted = numbers.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        n if n % 2 == 1 => sorted[n / 2],
        n => 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]),
    }
}

/// Errors and seconds, the quickest first; without what is slower than another and no better.
#[derive(Debug)]
pub(crate) struct Curve(Vec<(f64, f64)>);

impl Curve {
    pub(crate) fn new(points: impl Iterator<Item = (f64, f64)>) -> Self {
        let mut points: Vec<_> = points.filter(|(error, seconds)| *error > 0.0 && *seconds > 0.0).collect();
        points.sort_by(|a, b| a.1.total_cmp(&b.1));
        let mut best = f64::INFINITY;
        points.retain(|(error, _)| {
            let is_better = *error < best;
            best = best.min(*error);
            is_better
        });
        Self(points)
    }

    /// Seconds until an error of so much: between two settings on logarithmic axes; those of the quickest one where
    /// it is better than that. `None` where nothing is.
    pub(crate) fn seconds(&self, error: f64) -> Option<f64> {
        let (first, quickest) = *self.0.first()?;
        if first <= error {
            return Some(quickest);
        }
        // Errors fall from one to the next.
        let w = self.0.windows(2).find(|w| w[1].0 <= error)?;
        let share = (w[0].0 / error).ln() / (w[0].0 / w[1].0).ln();
        Some(w[0].1 * (w[1].1 / w[0].1).powf(share))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_lie_between_those_measured() {
        let curve = Curve::new([(0.5, 4.0), (2.0, 1.0), (8.0, 0.25)].into_iter());
        assert_eq!(curve.seconds(9.0), Some(0.25));
        assert!(curve.seconds(1.0).is_some_and(|s| (s - 2.0).abs() < 1e-9));
        assert_eq!((curve.seconds(0.5), curve.seconds(0.4)), (Some(4.0), None));
        let with_worse = Curve::new([(0.5, 4.0), (6.0, 1.1), (2.0, 1.0), (8.0, 0.25), (2.0, 3.0)].into_iter());
        assert_eq!(with_worse.seconds(1.0), curve.seconds(1.0), "what is slower and no better counts for nothing");
        assert_eq!((median(&[3.0, 1.0, 2.0]), median(&[1.0, 3.0]), median(&[])), (2.0, 2.0, 0.0));
    }
}
