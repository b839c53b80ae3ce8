//! Which settings are worth their time.

use std::time::Duration;

use super::knob::Method;
use super::point::{Point, Recommendation};

/// Whether nothing among `all` is quicker and no less close, or closer and no slower.
fn unbeaten((seconds, error): (Duration, f64), all: &[(Duration, f64)]) -> bool {
    !all.iter().any(|&(s, e)| s <= seconds && e <= error && (s < seconds || e < error))
}

/// Brings points into order of their methods, marks the Pareto front of trace time against RMSE, and recommends
/// the cheapest setting of this program whose RMSE is at most `target` 8-bit steps.
pub(super) fn conclude(points: &mut [Point], target: f64) -> Option<Recommendation> {
    points.sort_by_key(|p| p.method);
    let all: Vec<(Duration, f64)> = points.iter().map(|p| (p.trace, p.metrics.rmse)).collect();
    for (point, &of) in points.iter_mut().zip(&all) {
        point.front = unbeaten(of, &all);
    }
    let reaches = |p: &&(usize, &Point)| p.1.method != Method::PovRay && p.1.metrics.rmse_steps() <= target;
    let candidates: Vec<(usize, &Point)> = points.iter().enumerate().collect();
    let cheapest = candidates.iter().filter(reaches).min_by_key(|(_, p)| p.trace)?;
    Some(Recommendation { point: cheapest.0 })
}

#[cfg(test)]
pub(super) mod tests {
    use tessera_core::film::Metrics;

    use super::*;

    /// A point of `trace` seconds and `rmse` 8-bit steps.
    pub(in crate::measure) fn point(method: Method, value: &str, trace: f64, rmse: f64) -> Point {
        let rmse = rmse / 255.0;
        Point {
            method,
            value: value.into(),
            flags: vec![format!("--{}", method.name()), value.into()],
            trace: Duration::from_secs_f64(trace),
            whole: Duration::from_secs_f64(trace + 0.1),
            spread: (Duration::from_secs_f64(0.9 * trace), Duration::from_secs_f64(1.1 * trace)),
            runs: 1,
            rays: None,
            metrics: Metrics {
                rmse,
                psnr: -20.0 * rmse.log10(),
                largest: 0.25,
                largest_at: (1, 2),
                beyond_255th: 0.02,
                beyond_510th: 0.04,
                ssim: 0.99,
                flip: 0.01,
            },
            predicted: None,
            beyond_reference: false,
            front: false,
        }
    }

    fn front(points: &[Point]) -> Vec<&str> {
        points.iter().filter(|p| p.front).map(|p| p.value.as_str()).collect()
    }

    #[test]
    fn the_front_is_what_nothing_beats_both_ways() {
        let mut points = vec![
            point(Method::Samples, "64", 4.0, 0.5),
            point(Method::Samples, "1", 0.1, 8.0),
            point(Method::Samples, "16", 1.0, 1.5),
            point(Method::MaxError, "1", 0.5, 0.9),
            point(Method::MaxError, "0.5", 1.0, 0.4),
            point(Method::PovRay, "default", 0.2, 3.0),
        ];
        assert_eq!(conclude(&mut points, 0.01), None);
        assert_eq!(front(&points), ["1", "0.5", "1", "default"]);
        // By method, and within it as they came.
        let order: Vec<&str> = points.iter().map(|p| p.value.as_str()).collect();
        assert_eq!(order, ["1", "0.5", "64", "1", "16", "default"]);
    }

    #[test]
    fn equals_share_the_front() {
        let mut points = vec![point(Method::Samples, "a", 1.0, 1.0), point(Method::Samples, "b", 1.0, 1.0)];
        conclude(&mut points, 1.0);
        assert_eq!(front(&points), ["a", "b"]);
        let mut points = vec![point(Method::Samples, "a", 1.0, 1.0), point(Method::Samples, "b", 1.0, 0.0)];
        conclude(&mut points, 1.0);
        assert_eq!(front(&points), ["b"]);
    }

    #[test]
    fn the_cheapest_of_this_program_that_reaches_the_target_is_recommended() {
        let mut points = vec![
            point(Method::PovRay, "default", 0.2, 0.1),
            point(Method::Samples, "16", 2.0, 0.4),
            point(Method::MaxError, "0.5", 0.7, 0.5),
            point(Method::MaxError, "1", 0.4, 0.9),
        ];
        let chosen = conclude(&mut points, 0.5).expect("two reach it");
        assert_eq!(points[chosen.point].value, "0.5");
        assert_eq!(conclude(&mut points, 0.3), None);
    }
}
