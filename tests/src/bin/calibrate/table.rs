//! What was fitted, beside what the source says.

use std::fmt;

/// How a constant is held against what was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Held {
    /// It holds where it lies within the spread, or within a tenth of the middle.
    Within,
    /// It is a bound, which holds where nothing is above it.
    Above,
    /// It holds where it loses no more than what is named here, which was found by trying it and others.
    Tried(bool),
}

/// One constant.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    pub(crate) name: &'static str,
    pub(crate) unit: &'static str,
    pub(crate) now: f64,
    pub(crate) fitted: f64,
    /// The least and the greatest that the data would allow.
    pub(crate) spread: (f64, f64),
    pub(crate) held: Held,
    /// What it was fitted to.
    pub(crate) data: String,
}

impl Row {
    /// Of one value for each of several scenes or runs: their median, and their middle half.
    pub(crate) fn of(
        name: &'static str,
        unit: &'static str,
        now: f64,
        values: &[f64],
        data: impl Into<String>,
    ) -> Self {
        let (fitted, spread) = (quantile(values, 0.5), (quantile(values, 0.25), quantile(values, 0.75)));
        Self { name, unit, now, fitted, spread, held: Held::Within, data: data.into() }
    }

    /// A bound of the greatest of several values.
    pub(crate) fn bound(
        name: &'static str,
        unit: &'static str,
        now: f64,
        values: &[f64],
        data: impl Into<String>,
    ) -> Self {
        let (least, greatest) = (quantile(values, 0.0), quantile(values, 1.0));
        let row = Self::of(name, unit, now, values, data);
        Self { fitted: greatest, spread: (least, greatest), held: Held::Above, ..row }
    }

    fn holds(&self) -> bool {
        let (least, most) = self.spread;
        match self.held {
            Held::Within => {
                (least..=most).contains(&self.now) || (self.now - self.fitted).abs() <= 0.1 * self.fitted.abs()
            }
            Held::Above => self.now >= self.fitted,
            Held::Tried(holds) => holds,
        }
    }
}

/// The constants of one model.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    name: &'static str,
    rows: Vec<Row>,
    /// All fields of the model, as `{:?}` has them.
    fields: Vec<(String, String)>,
}

impl Table {
    /// `model` is the whole struct, of which rows that are named after a field were fitted.
    pub(crate) fn new(name: &'static str, model: &impl fmt::Debug, rows: Vec<Row>) -> Self {
        Self { name, rows, fields: fields(&format!("{model:?}")) }
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "| {} | in the source | fitted now | spread | | fitted to |", self.name)?;
        writeln!(f, "| --- | ---: | ---: | ---: | --- | --- |")?;
        for row in &self.rows {
            let Row { name, unit, now, fitted, spread, data, .. } = row;
            let unit = if unit.is_empty() { String::new() } else { format!(" ({unit})") };
            let spread = format!("{} to {}", short(spread.0), short(spread.1));
            let verdict = if row.holds() { "holds" } else { "refit" };
            writeln!(f, "| `{name}`{unit} | {} | {} | {spread} | {verdict} | {data} |", short(*now), short(*fitted))?;
        }
        let fitted = |name: &str| self.rows.iter().any(|r| r.name == name);
        let others: Vec<String> =
            self.fields.iter().filter(|(n, _)| !fitted(n)).map(|(n, v)| format!("`{n}` {v}")).collect();
        writeln!(f, "\nNot fitted here, for the reasons beside them: {}.", others.join(", "))
    }
}

/// A number in about three digits.
fn short(x: f64) -> String {
    match x.abs() {
        a if a == 0.0 || a >= 100.0 => format!("{x:.0}"),
        a if a >= 10.0 => format!("{x:.1}"),
        a if a >= 0.01 => format!("{x:.3}"),
        _ => format!("{x:.2e}"),
    }
}

/// Names and values of a struct's fields, from its `{:?}`.
fn fields(debug: &str) -> Vec<(String, String)> {
    let inside = debug.split_once('{').and_then(|(_, rest)| rest.rsplit_once('}')).map_or("", |(inside, _)| inside);
    let (mut depth, mut from, mut all) = (0, 0, Vec::new());
    for (at, c) in inside.char_indices().chain([(inside.len(), ',')]) {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            ',' if depth == 0 => {
                let field = inside[from..at].split_once(':');
                all.extend(field.map(|(name, value)| (name.trim().to_owned(), value.trim().to_owned())));
                from = at + 1;
            }
            _ => {}
        }
    }
    all
}

/// The value below which lies such a share of several, between two of them in proportion; 0 of none.
pub(crate) fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let at = share * last as f64;
    let (below, above) = (sorted[at as usize], sorted[(at as usize + 1).min(last)]);
    below + (above - below) * at.fract()
}

/// The power of x by which y rises: the slope of a straight line through their logarithms.
pub(crate) fn power(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> =
        points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0).map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len().max(1) as f64;
    let (x, y) = logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let (both, square) = logs.iter().fold((0.0, 0.0), |(a, b), (u, v)| (a + (u - x) * (v - y), b + (u - x) * (u - x)));
    if square > 0.0 { both / square } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_told_apart_at_the_top_only() {
        let all = fields("Model { edge: 0.5, looks: [(1.0, 2.0), (3.0, 4.0)], rate: Rate(7) }");
        let names: Vec<&str> = all.iter().map(|(n, _)| n.as_str()).collect();
        assert_eq!(names, ["edge", "looks", "rate"]);
        assert_eq!(all[1].1, "[(1.0, 2.0), (3.0, 4.0)]");
    }

    #[test]
    fn quantiles_lie_between_values_and_powers_are_found() {
        assert_eq!([0.0, 0.5, 1.0].map(|q| quantile(&[3.0, 1.0, 2.0], q)), [1.0, 2.0, 3.0]);
        assert_eq!((quantile(&[1.0, 2.0], 0.25), quantile(&[], 0.5)), (1.25, 0.0));
        let curve: Vec<(f64, f64)> = [1.0, 2.0, 4.0].map(|x: f64| (x, 3.0 * x.powf(-1.5))).into();
        assert!((power(&curve) + 1.5).abs() < 1e-9);
    }

    #[test]
    fn what_lies_outside_of_the_data_is_to_be_fitted_again() {
        let row = |now: f64| Row::of("a", "", now, &[1.0, 2.0, 3.0, 4.0], "");
        assert_eq!([0.9, 1.8, 3.2, 3.9].map(|now| row(now).holds()), [false, true, true, false]);
        assert!(Row::bound("a", "", 4.0, &[3.0, 4.0], "").holds() && !Row::bound("a", "", 3.9, &[4.0], "").holds());
    }
}
