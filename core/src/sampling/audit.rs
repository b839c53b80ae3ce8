//! The audit: some pixels, drawn at random, are sampled afresh.
//!
//! See [`ErrorEstimate`] for what it tells. Which pixels are drawn is a function of the scene, the settings and
//! the pass alone.

use glam::DVec3;

use super::adaptive::{Buffers, mean};
use super::composite::Composite;
use super::points::{Sequence, hash};
use crate::film::ErrorEstimate;
use crate::integrate::{RayCounts, Sample, Tracer, WaveScratch};
use crate::settings::{AuditRate, Tolerance};

/// Sets of points: whose hash draws a pixel, and the two that it is sampled by.
const DRAW: u64 = 1;
const SETS: [u64; 2] = [2, 3];
/// Points of each set at least, and at most.
const LEAST: u32 = 4;
const MOST: u32 = 1 << 14;

/// A pixel that may be audited.
#[derive(Clone, Copy)]
pub(super) struct Audited<'a> {
    pub(super) at: (u32, u32),
    pub(super) value: DVec3,
    pub(super) points: u32,
    /// Its expected squared error.
    pub(super) expected: f64,
    /// Whether it was not proven.
    pub(super) open: bool,
    /// Its parts, where it has some.
    pub(super) parts: Option<&'a Composite>,
}

/// Of the floor, how likely pixels are drawn that were proven.
const PROVEN: f64 = 1.0 / 16.0;

/// The probability that a pixel is audited.
fn probability(pixel: &Audited<'_>, tolerance: Tolerance, rate: AuditRate) -> f64 {
    let typical = tolerance.fraction() * tolerance.fraction();
    let floor = AuditRate::FLOOR * if pixel.open { 1.0 } else { PROVEN };
    (rate.factor() * (floor + pixel.expected / typical)).min(1.0)
}

/// Draws among pixels, and notes what is found.
pub(super) fn audit(
    tracer: &Tracer,
    pixels: &[Audited<'_>],
    tolerance: Tolerance,
    rate: AuditRate,
    scratch: &mut WaveScratch,
    counts: &mut RayCounts,
    error: &mut ErrorEstimate,
) {
    if rate == AuditRate::default() {
        return;
    }
    Buffers::with(|Buffers { points, samples }| {
        let view = &tracer.settings().view;
        let mut drawn = Vec::new();
        for pixel in pixels {
            let probability = probability(pixel, tolerance, rate);
            let at = pixel.at;
            if (hash(at.0, at.1, DRAW) >> 11) as f64 >= probability * (1u64 << 53) as f64 {
                continue;
            }
            for set in SETS {
                let from = points.len();
                if let Some(parts) = pixel.parts {
                    let fresh = parts.afresh(set);
                    let taken = parts.taken();
                    fresh.ask(view, &taken, points);
                    drawn.push((pixel, probability, Some((fresh, taken)), points.len() - from));
                } else {
                    let sequence = Sequence::new(view, at, set);
                    points.extend((0..pixel.points.clamp(LEAST, MOST)).map(|k| sequence.point(k)));
                    drawn.push((pixel, probability, None, points.len() - from));
                }
            }
        }
        samples.resize(points.len(), Sample::BLANK);
        tracer.trace(points, 0.0, samples, scratch, counts);
        let mut rest = &samples[..];
        let mut take = |parts: &mut Option<(Composite, Vec<u32>)>, n: usize| {
            let (these, behind) = rest.split_at(n);
            rest = behind;
            match parts {
                Some((fresh, taken)) => {
                    fresh.take(view, taken, these);
                    fresh.mean()
                }
                None => mean(these),
            }
        };
        for pair in drawn.chunks_exact_mut(2) {
            let [a, b] = [0, 1].map(|k| {
                let (_, _, parts, n) = &mut pair[k];
                take(parts, *n)
            });
            let (pixel, probability) = (pair[0].0, pair[0].1);
            let value = pixel.value;
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
    });
}
