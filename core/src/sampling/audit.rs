//! The audit: some pixels, drawn at random, are sampled afresh.
//!
//! See [`ErrorEstimate`] for what it tells. Which pixels are drawn is a function of the scene, the settings and
//! the pass alone.

use glam::DVec3;

use super::adaptive::mean;
use super::points::{Sequence, hash};
use crate::film::ErrorEstimate;
use crate::settings::{AuditRate, Tolerance};
use crate::trace::{RayCounts, Sample, Tracer, WaveScratch};

/// Sets of points: whose hash draws a pixel, and the two that it is sampled by.
const DRAW: u64 = 1;
const SETS: [u64; 2] = [2, 3];
/// Points of each set at least, and at most.
const LEAST: u32 = 4;
const MOST: u32 = 1024;

/// The probability that a pixel of such an expected squared error is audited.
fn probability(expected: f64, tolerance: Tolerance, rate: AuditRate) -> f64 {
    let typical = tolerance.fraction() * tolerance.fraction();
    (rate.factor() * (AuditRate::FLOOR + expected / typical)).min(1.0)
}

/// Draws among pixels, given by place, value, points and expected squared error, and notes what is found.
pub(super) fn audit(
    tracer: &Tracer,
    pixels: impl Iterator<Item = ((u32, u32), DVec3, u32, f64)>,
    tolerance: Tolerance,
    rate: AuditRate,
    scratch: &mut WaveScratch,
    counts: &mut RayCounts,
    error: &mut ErrorEstimate,
) {
    if rate == AuditRate::default() {
        return;
    }
    let view = &tracer.settings().view;
    let (mut drawn, mut points) = (Vec::new(), Vec::new());
    for (at, value, n, expected) in pixels {
        let probability = probability(expected, tolerance, rate);
        if (hash(at.0, at.1, DRAW) >> 11) as f64 >= probability * (1u64 << 53) as f64 {
            continue;
        }
        let n = n.clamp(LEAST, MOST);
        drawn.push((value, probability, n as usize));
        for set in SETS {
            let sequence = Sequence::new(view, at, set);
            points.extend((0..n).map(|k| sequence.point(k)));
        }
    }
    let mut samples = vec![Sample::BLANK; points.len()];
    tracer.trace(&points, 0.0, &mut samples, scratch, counts);
    let mut rest = &samples[..];
    for (value, probability, n) in drawn {
        let (pair, behind) = rest.split_at(2 * n);
        rest = behind;
        let (a, b) = (mean(&pair[..n]), mean(&pair[n..]));
        // The value as the picture has it.
        let value = value.to_array().map(|c| f64::from(c as f32));
        let [a, b] = [a, b].map(|m| m.to_array());
        let (mut square, mut noise) = (0.0, 0.0);
        for k in 0..3 {
            square += (value[k] - a[k]) * (value[k] - b[k]) / 3.0;
            noise += (a[k] - b[k]) * (a[k] - b[k]) / 6.0;
        }
        // With σ² the variance of a set's mean, that of the product is 2σ²·(error)² + σ⁴.
        let noise = noise * (2.0 * square.max(0.0) + noise);
        error.audit(square, noise, probability);
    }
}
