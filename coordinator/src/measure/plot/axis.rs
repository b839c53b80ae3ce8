//! Logarithmic axes: where they begin and end, and which values are marked on them.

/// The least share between an axis's ends: less would show one tick or none.
const LEAST_SPAN: f64 = 6.0;

/// A logarithmic axis from `low` to `high`, both above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axis {
    pub(super) low: f64,
    pub(super) high: f64,
}

/// A value marked on an axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) label: String,
    /// Whether it is a power of ten.
    pub(super) decade: bool,
}

impl Axis {
    /// An axis that shows all `values` above 0, `margin` (a factor) beyond the outermost. What
    /// cannot be shown on a logarithmic axis is left out.
    pub(super) fn around(values: impl IntoIterator<Item = f64>, margin: f64) -> Self {
        let shown = values.into_iter().filter(|v| v.is_finite() && *v > 0.0);
        let (low, high) = shown.fold((f64::INFINITY, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
        let (low, high) = if low <= high { (low / margin, high * margin) } else { (0.1, 10.0) };
        let missing = (LEAST_SPAN / (high / low)).max(1.0).sqrt();
        Self { low: low / missing, high: high * missing }
    }

    /// Where `value` is between the ends: 0 at `low`, 1 at `high`; values beyond are taken to the ends.
    pub(super) fn place(&self, value: f64) -> f64 {
        if value.is_nan() || value <= self.low {
            return 0.0;
        }
        ((value / self.low).ln() / (self.high / self.low).ln()).min(1.0)
    }

    /// Marks at 1, 2 and 5 times powers of ten; at powers of ten alone, or every so many of them,
    /// where there would be more than `most`.
    pub(super) fn ticks(&self, most: usize) -> Vec<Tick> {
        let exponents = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
        let marks = |steps: &[u32], every: i32| -> Vec<Tick> {
            exponents
                .clone()
                .filter(|e| e.rem_euclid(every) == 0)
                .flat_map(|e| steps.iter().map(move |&s| (s, e)))
                .map(|(s, e)| (decimal(s, e), s == 1))
                .map(|(label, decade)| Tick { value: label.parse().unwrap_or(f64::NAN), label, decade })
                // A hair beyond the ends is still on them.
                .filter(|t| t.value >= self.low * (1.0 - 1e-9) && t.value <= self.high * (1.0 + 1e-9))
                .collect()
        };
        let fine = marks(&[1, 2, 5], 1);
        if fine.len() <= most {
            return fine;
        }
        (1..).map(|every| marks(&[1], every)).find(|m| m.len() <= most.max(1)).unwrap_or_default()
    }
}

/// `step` · 10^`exponent`, written out: exact, and as people write it.
fn decimal(step: u32, exponent: i32) -> String {
    match exponent {
        -4..0 => format!("0.{}{step}", "0".repeat((-exponent - 1) as usize)),
        0..5 => format!("{step}{}", "0".repeat(exponent as usize)),
        _ => format!("{step}e{exponent}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64, most: usize) -> Vec<String> {
        Axis { low, high }.ticks(most).into_iter().map(|t| t.label).collect()
    }

    #[test]
    fn ticks_are_ones_twos_and_fives() {
        assert_eq!(labels(0.04, 3.0, 12), ["0.05", "0.1", "0.2", "0.5", "1", "2"]);
        assert_eq!(labels(0.1, 10.0, 12), ["0.1", "0.2", "0.5", "1", "2", "5", "10"]);
        assert_eq!(labels(900.0, 60_000.0, 12), ["1000", "2000", "5000", "10000", "20000", "50000"]);
    }

    #[test]
    fn crowded_ticks_are_thinned_to_powers_of_ten() {
        assert_eq!(labels(0.003, 400.0, 8), ["0.01", "0.1", "1", "10", "100"]);
        assert_eq!(labels(1e-9, 1e9, 5), ["1e-8", "0.0001", "1", "10000", "1e8"]);
    }

    #[test]
    fn axes_show_every_value_and_never_too_little() {
        let axis = Axis::around([0.3, 20.0, 0.0, f64::NAN], 1.5);
        assert!(axis.place(0.3) > 0.0 && axis.place(20.0) < 1.0);
        assert_eq!((axis.place(0.0), axis.place(f64::NAN), axis.place(1e9)), (0.0, 0.0, 1.0));
        for values in [&[][..], &[5.0], &[0.0], &[1.2, 1.3]] {
            let axis = Axis::around(values.iter().copied(), 1.2);
            assert!(axis.high / axis.low >= LEAST_SPAN * 0.999 && axis.ticks(12).len() >= 2, "{values:?}: {axis:?}");
        }
    }

    #[test]
    fn places_are_logarithmic() {
        let axis = Axis { low: 0.1, high: 1000.0 };
        for (value, place) in [(0.1, 0.0), (1.0, 0.25), (10.0, 0.5), (1000.0, 1.0)] {
            assert!((axis.place(value) - place).abs() < 1e-12);
        }
    }
}
