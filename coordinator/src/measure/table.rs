//! What was measured, for people.

use std::fmt::Write;

use super::knob::Method;
use super::point::{Measured, Point, Skipped};
use super::reference::{Reference, Source};
use crate::columns::columns;

/// Names of columns, with their alignment: texts to the left, numbers to the right.
const COLUMNS: [(&str, bool); 9] = [
    ("", true),
    ("setting", true),
    ("quality", true),
    ("seconds", false),
    ("±", false),
    ("gain", false),
    ("rays/px", false),
    ("RMSE", false),
    ("told", false),
];

impl Measured {
    /// The table, what its marks mean, and what is recommended. `command` gives the command line that renders a point.
    #[must_use]
    pub fn to_text(&self, command: impl Fn(&Point) -> String) -> String {
        let mut text = String::new();
        let view = &self.settings.view;
        // Writing to a string does not fail.
        let _ = writeln!(text, "{}, {}x{} pixels", self.scene, view.width(), view.height());
        match &self.reference {
            Some(reference) => {
                let _ = writeln!(text, "reference: {}", told(reference));
            }
            None => text.push_str("there was no time for a reference, so nothing was measured\n"),
        }
        if !self.points.is_empty() {
            text.push('\n');
            self.rows(&mut text);
            text.push('\n');
            self.legend(&mut text);
        }
        self.left_out(&mut text);
        if self.interrupted {
            text.push_str("\ninterrupted: this is what was measured until then\n");
        }
        if !self.points.is_empty() {
            text.push('\n');
            text.push_str(&self.advice(command));
        }
        text
    }

    fn rows(&self, text: &mut String) {
        let pixels = f64::from(self.settings.view.width()) * f64::from(self.settings.view.height());
        let recommended = self.recommendation.as_ref().map(|r| r.point);
        let mut rows = vec![COLUMNS.map(|(name, _)| name.to_owned()).to_vec()];
        for (i, p) in self.points.iter().enumerate() {
            // A line between methods keeps them apart.
            if i > 0 && self.points[i - 1].method != p.method {
                rows.push(Vec::new());
            }
            rows.push(self.cells(p, pixels, recommended == Some(i)).to_vec());
        }
        let right: Vec<usize> = (0..COLUMNS.len()).filter(|c| !COLUMNS[*c].1).collect();
        text.push_str(&columns(&rows, &right));
    }

    fn cells(&self, p: &Point, pixels: f64, recommended: bool) -> [String; 9] {
        let none = || "–".to_owned();
        let mark = |is: bool, mark: char| if is { mark } else { ' ' };
        let (seconds, (least, most)) = (p.trace.as_secs_f64(), p.spread);
        let half = 0.5 * (most.saturating_sub(least)).as_secs_f64() / seconds.max(1e-9);
        let gain = self.uniform_seconds(p.metrics.rmse).filter(|_| seconds > 0.0).map(|uniform| uniform / seconds);
        [
            [mark(recommended, '>'), mark(p.front, '*')].iter().collect(),
            format!("{} {}", p.method.name(), p.value),
            p.quality().map_or_else(none, |q| q.name().into()),
            figure(seconds),
            if p.runs > 1 { format!("{:.0}%", 100.0 * half) } else { none() },
            gain.map_or_else(none, |g| format!("{}x", rough(g))),
            p.rays.map_or_else(none, |r| figure(r.camera as f64 / pixels)),
            format!("{}{}", if p.beyond_reference { "~" } else { "" }, figure(p.metrics.rmse_steps())),
            p.predicted.map_or_else(none, |e| figure(255.0 * e.rmse)),
        ]
    }

    /// What was not measured, by reasons.
    fn left_out(&self, text: &mut String) {
        let mut told: Vec<&str> = Vec::new();
        for Skipped { why, .. } in &self.skipped {
            if told.contains(&why.as_str()) {
                continue;
            }
            told.push(why);
            let whats = self.skipped.iter().filter(|s| s.why == *why).map(|s| s.what.as_str());
            // Writing to a string does not fail.
            let _ = writeln!(text, "\nleft out, for {why}: {}", whats.collect::<Vec<_>>().join(", "));
        }
    }

    fn legend(&self, text: &mut String) {
        let numbers = if self.clamped { "linear numbers, clamped to [0, 1]" } else { "linear numbers" };
        let _ = writeln!(
            text,
            "seconds: of tracing, median; ±: half their spread; gain: times as quick as the\n\
             quickest --samples of the same error; quality: the best one that it reaches;\n\
             rays/px: camera rays a pixel; RMSE: measured, and as told by the render itself,\n\
             in 8-bit steps of {numbers}.\n\
             * Pareto front: nothing here is quicker and closer   > recommended"
        );
        if self.points.iter().any(|p| p.beyond_reference) {
            text.push_str("~ within three times the reference's own error: the true one may be smaller\n");
        }
    }

    /// The setting to take for the target, and the command line for it.
    #[must_use]
    pub fn advice(&self, command: impl Fn(&Point) -> String) -> String {
        let target = self.target;
        match self.recommended() {
            Some(p) => format!(
                "for an RMSE of at most {target}, the quickest is\n{}: {} in {} s\n\n  {}\n",
                p.flags.join(" "),
                figure(p.metrics.rmse_steps()),
                figure(p.trace.as_secs_f64()),
                command(p)
            ),
            None => match self.closest() {
                Some(p) => format!(
                    "nothing measured reaches an RMSE of {target}; the closest is {} with {}\n",
                    p.flags.join(" "),
                    figure(p.metrics.rmse_steps())
                ),
                None => String::new(),
            },
        }
    }

    /// This program's closest point.
    fn closest(&self) -> Option<&Point> {
        let ours = self.points.iter().filter(|p| p.method != Method::PovRay);
        ours.min_by(|a, b| a.metrics.rmse.total_cmp(&b.metrics.rmse))
    }
}

/// What a reference is, and how good.
pub(super) fn told(reference: &Reference) -> String {
    let own = |by: &str| match reference.own_error {
        Some(e) => format!("; its own error is {}{by}", rough(255.0 * e)),
        None => "; its own error is not known".into(),
    };
    match &reference.source {
        Source::Rendered(grids) => {
            let parts: Vec<String> = grids.iter().map(|n| format!("{n}²")).collect();
            let samples = reference.samples().unwrap_or_default();
            format!("{samples} samples a pixel ({}){}", parts.join(" + "), own(""))
        }
        Source::File(path, codes) => {
            format!("{}{}", path.display(), own(if *codes { ", by rounding alone" } else { "" }))
        }
    }
}

/// At two significant digits.
pub(super) fn rough(x: f64) -> String {
    match x.abs() {
        a if a >= 9.95 => format!("{x:.0}"),
        a if a >= 0.995 => format!("{x:.1}"),
        a if a >= 0.0995 || a == 0.0 => format!("{x:.2}"),
        a if a >= 0.00995 => format!("{x:.3}"),
        _ => format!("{x:.4}"),
    }
}

/// At three significant digits, as people write them.
pub(super) fn figure(x: f64) -> String {
    match x.abs() {
        a if a >= 99.95 => format!("{x:.0}"),
        a if a >= 9.995 => format!("{x:.1}"),
        a if a >= 0.9995 => format!("{x:.2}"),
        a if a >= 0.09995 || a == 0.0 => format!("{x:.3}"),
        a if a >= 0.009_995 => format!("{x:.4}"),
        _ => format!("{x:.5}"),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::time::Duration;

    use tessera_core::film::Image;
    use tessera_core::settings::{Sampling, Settings, Transfer, View};

    use super::*;
    use crate::measure::pareto::{conclude, tests::point};
    use crate::measure::point::{Predicted, Rays};

    /// A made-up measurement.
    pub(in crate::measure) fn measured() -> Measured {
        let mut points = vec![
            point(Method::Samples, "1", 0.1, 5.0),
            point(Method::Samples, "4", 0.4, 2.1),
            point(Method::Samples, "64", 6.0, 0.4),
            point(Method::MaxError, "2", 0.25, 1.6),
            point(Method::MaxError, "0.5", 0.5, 0.42),
            point(Method::Quality, "final", 1.0, 0.2),
            point(Method::PovRay, "+A0.3 +AM1 +R3", 0.9, 2.5),
        ];
        for p in &mut points[3..6] {
            p.predicted = Some(Predicted { rmse: 1.1 * p.metrics.rmse, upper: 1.3 * p.metrics.rmse });
            p.rays = Some(Rays { camera: 24, mirror: 6, shadow: Some(3_000_000) });
        }
        points[5].beyond_reference = true;
        let recommendation = conclude(&mut points, 0.5);
        let image = Image::new(4, 3, vec![[0.5; 3]; 12]).expect("whole");
        Measured {
            scene: "demo".into(),
            settings: Settings {
                view: View::new(4, 3, 1.0, 1.0).expect("valid"),
                max_depth: 16,
                sampling: Sampling::Uniform { grid: 1 },
                transfer: Transfer::Srgb,
            },
            workers: 2,
            threads: 2,
            read: Duration::from_millis(5),
            build: Duration::from_millis(3),
            target: 0.5,
            reference: Some(Reference { image, source: Source::Rendered(vec![11, 13]), own_error: Some(0.08 / 255.0) }),
            clamped: true,
            points,
            skipped: vec![Skipped { what: "--samples 144".into(), why: "there was no time".into() }],
            recommendation,
            interrupted: false,
        }
    }

    /// A made-up command line.
    pub(in crate::measure) fn command(point: &Point) -> String {
        format!("coordinator render demo.xml {}", point.flags.join(" "))
    }

    #[test]
    fn the_table_says_what_was_measured_and_what_to_take() {
        let text = measured().to_text(command);
        let line = |words: &[&str]| {
            let found = text.lines().find(|l| words.iter().all(|w| l.split_whitespace().any(|x| x == *w)));
            found.unwrap_or_else(|| panic!("no line of {words:?} in\n{text}")).to_owned()
        };
        assert!(line(&["max-error", "0.5"]).starts_with(">*"));
        assert!(line(&["samples", "1"]).starts_with(" *"));
        assert!(line(&["samples", "64"]).starts_with("  "));
        assert!(line(&["quality", "final"]).contains("~0.200") && line(&["quality", "final"]).contains("0.220"));
        assert!(line(&["quality", "final"]).contains(" final ") && line(&["samples", "4"]).contains(" – "));
        assert!(line(&["max-error", "0.5"]).contains(" normal ") && line(&["max-error", "0.5"]).contains("11x"));
        assert!(text.lines().all(|l| l.chars().count() <= 80), "{text}");
        assert!(text.contains("290 samples a pixel (11² + 13²); its own error is 0.080"));
        assert!(text.contains("  coordinator render demo.xml --max-error 0.5\n"));
        assert!(text.contains("left out, for there was no time: --samples 144"));
    }

    #[test]
    fn a_target_out_of_reach_is_said_to_be() {
        let mut measured = measured();
        measured.target = 0.01;
        measured.recommendation = conclude(&mut measured.points, 0.01);
        let advice = measured.advice(command);
        assert!(advice.contains("nothing measured reaches") && advice.contains("--quality final"), "{advice}");
    }

    #[test]
    fn figures_have_three_digits() {
        assert_eq!([12.3, 1.23, 0.123, 0.0123, 0.00123].map(rough), ["12", "1.2", "0.12", "0.012", "0.0012"]);
        let said = [123.4, 12.34, 9.999, 1.234, 0.1234, 0.01234, 0.0, 0.00012].map(figure);
        assert_eq!(said, ["123", "12.3", "10.0", "1.23", "0.123", "0.0123", "0.000", "0.00012"]);
    }
}
