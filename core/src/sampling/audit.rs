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

/// A pixel that was drawn.
pub(super) struct Audited<'a> {
    pub(super) at: (u32, u32),
    pub(super) value: DVec3,
    pub(super) points: u32,
    /// With which it was drawn.
    pub(super) probability: f64,
    /// Its parts, where it has some.
    pub(super) parts: Option<&'a Composite>,
}

/// Of the floor, how likely pixels are drawn that were proven.
const PROVEN: f64 = 1.0 / 16.0;

/// Draws pixels, and samples them afresh.
pub(super) struct Audit<'a> {
    pub(super) tracer: &'a Tracer,
    pub(super) tolerance: Tolerance,
    pub(super) rate: AuditRate,
}

impl Audit<'_> {
    /// The probability with which pixel `at` was drawn, of which such a squared error is expected, and which is not
    /// proven where it is `open`; `None` where it was not.
    pub(super) fn draws(&self, at: (u32, u32), expected: f64, open: bool) -> Option<f64> {
        if self.rate == AuditRate::default() {
            return None;
        }
        let typical = self.tolerance.fraction() * self.tolerance.fraction();
        let floor = AuditRate::FLOOR * if open { 1.0 } else { PROVEN };
        let probability = (self.rate.factor() * (floor + expected / typical)).min(1.0);
        let is_drawn = ((hash(at.0, at.1, DRAW) >> 11) as f64) < probability * (1u64 << 53) as f64;
        is_drawn.then_some(probability)
    }

    /// Samples what was drawn, and notes what is found.
    pub(super) fn check(
        &self,
        drawn: &[Audited<'_>],
        scratch: &mut WaveScratch,
        counts: &mut RayCounts,
        error: &mut ErrorEstimate,
    ) {
        if drawn.is_empty() {
            return;
        }
        let view = &self.tracer.settings().view;
        Buffers::with(|Buffers { points, samples }| {
            let mut sets = Vec::with_capacity(2 * drawn.len());
            for pixel in drawn {
                for set in SETS {
                    let from = points.len();
                    let fresh = pixel.parts.map(|parts| (parts.afresh(set), parts.taken()));
                    if let Some((fresh, taken)) = &fresh {
                        fresh.ask(view, taken, points);
                    } else {
                        let sequence = Sequence::new(view, pixel.at, set);
                        points.extend((0..pixel.points.clamp(LEAST, MOST)).map(|k| sequence.point(k)));
                    }
                    sets.push((fresh, points.len() - from));
                }
            }
            samples.resize(points.len(), Sample::BLANK);
            self.tracer.trace(points, 0.0, samples, scratch, counts);
            let mut rest = &samples[..];
            let mut means = sets.into_iter().map(|(fresh, n)| {
                let (these, behind) = rest.split_at(n);
                rest = behind;
                match fresh {
                    Some((mut fresh, taken)) => {
                        fresh.take(view, &taken, these);
                        fresh.mean()
                    }
                    None => mean(these),
                }
            });
            for pixel in drawn {
                let (Some(a), Some(b)) = (means.next(), means.next()) else { break };
                // The value as the picture has it.
                let value = pixel.value.to_array().map(|c| f64::from(c as f32));
                let [a, b] = [a, b].map(|m| m.to_array());
                let (mut square, mut noise) = (0.0, 0.0);
                for k in 0..3 {
                    square += (value[k] - a[k]) * (value[k] - b[k]) / 3.0;
                    noise += (a[k] - b[k]) * (a[k] - b[k]) / 6.0;
                }
                // With σ² the variance of a set's mean, that of the product is 2σ²·(error)² + σ⁴.
                let noise = noise * (2.0 * square.max(0.0) + noise);
                error.audit(square, noise, pixel.probability);
            }
        });
    }
}
