//! What the points of a net show of a pixel: the value they give, and how far that may be off.

use std::ops::Range;

use glam::DVec3;

use super::lattice::{extent, rms};
use super::net::Cells;
use super::strata::Strata;
use super::tiers::Powers;
use super::work::{CLAIMED, How, View, Work, sum};
use crate::trace::Tracer;
use crate::trace::record::{Probe, TIERS, Tiers};

/// The first points of a pixel's net, of which 2^`powers` reach each tier.
#[derive(Default)]
pub(super) struct Points {
    pub(super) powers: Powers,
    /// What they show, as far as they go, and what they meet first.
    pub(super) tiers: [Vec<DVec3>; TIERS],
    pub(super) firsts: Vec<u32>,
    /// Those that were asked to go as far as each tier. Their answers begin at `start`, among the looks
    /// or, if `whole`, among the paths up to that tier.
    pub(super) asked: [Vec<u32>; TIERS],
    pub(super) start: [usize; TIERS],
    pub(super) whole: bool,
}

impl Points {
    /// Makes room for 2^`powers` points.
    pub(super) fn extend(&mut self, powers: Powers) {
        self.powers = powers;
        for (tier, power) in self.tiers.iter_mut().zip(powers) {
            tier.resize(1 << power, DVec3::ZERO);
        }
    }

    /// Notes what the `k`-th point shows up to `tier`.
    pub(super) fn show(&mut self, k: u32, tier: usize, light: &Tiers) {
        for (to, x) in self.tiers[..=tier].iter_mut().zip(light) {
            to[k as usize] = *x;
        }
    }

    /// The same of a point for strata.
    pub(super) fn show_all(&mut self, k: u32, tier: usize, probe: &Probe) {
        self.show(k, tier, &probe.radiance);
        self.firsts.resize(self.tiers[0].len(), 0);
        self.firsts[k as usize] = probe.first;
    }
}

impl Work {
    /// The value that a net's points give, and the variance of its error: by tiers, and what more points
    /// would not take off. `cells` is memory.
    pub(super) fn evaluate(&mut self, tracer: &Tracer, cells: &mut Vec<DVec3>) -> (DVec3, [f64; TIERS], f64) {
        let How::Net(points) = &self.how else { return (DVec3::ZERO, [0.0; TIERS], f64::INFINITY) };
        if self.strata.is_some() {
            let views = self.views.iter().map(|v| (v.at, v.seen.first));
            let points = (0..).zip(&points.firsts).map(|(k, first)| (self.net.place(k), *first));
            let samples: Vec<_> = views.chain(points).collect();
            self.strata = Some(Strata::new(tracer, self.origin, &samples));
        }
        let (value, mut variances, doubt) = match self.strata.as_ref().filter(|s| !s.parts.is_empty()) {
            Some(strata) => self.by_parts(points, strata, cells),
            None => self.at_large(points, cells),
        };
        let missed = self.missed(points.powers.map(|p| f64::from(1u32 << p)));
        for (v, missed) in variances.iter_mut().zip(missed) {
            *v += missed;
        }
        (value, variances, self.still + doubt)
    }

    /// The mean over points and its variance, where there are no parts.
    fn at_large(&self, points: &Points, cells: &mut Vec<DVec3>) -> (DVec3, [f64; TIERS], f64) {
        let mut value = self.base;
        for tier in &points.tiers {
            value += tier.iter().fold(DVec3::ZERO, |sum, x| sum + *x) * (1.0 / tier.len() as f64);
        }
        (value, self.errors(points, cells, &|t, k| points.tiers[t][k], &|t, v| v.tiers[t]), 0.0)
    }

    /// The sum of the parts' means over points, its variance, and that of their areas.
    fn by_parts(&self, points: &Points, strata: &Strata, cells: &mut Vec<DVec3>) -> (DVec3, [f64; TIERS], f64) {
        let parts = strata.parts.len() + 1;
        let of: Vec<u32> = (0..points.tiers[0].len() as u32).map(|k| strata.of(self.net.place(k)) as u32).collect();
        let mut means = vec![Tiers::default(); parts];
        let mut value = self.base;
        let mut sums = Vec::with_capacity(parts);
        for (t, tier) in points.tiers.iter().enumerate() {
            sums.clear();
            sums.resize(parts, (DVec3::ZERO, 0.0));
            let mut all = DVec3::ZERO;
            for (x, &part) in tier.iter().zip(&of) {
                let sum = &mut sums[part as usize];
                sum.0 += *x;
                sum.1 += 1.0;
                all += *x;
            }
            all *= 1.0 / tier.len() as f64;
            for v in &self.views {
                let sum = &mut sums[strata.of(v.at)];
                // Corners are no fair sample, but better than none.
                if sum.1 < 1.0 {
                    sum.0 += v.tiers[t] * 1e-3;
                    sum.1 += 1e-3;
                }
            }
            for (k, (sum, count)) in sums.iter().enumerate() {
                means[k][t] = if *count > 0.0 { *sum * (1.0 / count) } else { all };
                value += means[k][t] * strata.area(k);
            }
        }
        let variances = self.errors(points, cells, &|t, k| points.tiers[t][k] - means[of[k] as usize][t], &|t, v| {
            v.tiers[t] - means[strata.of(v.at)][t]
        });
        let doubt = CLAIMED * strata.doubt * extent(means.iter().map(sum));
        (value, variances, doubt * doubt)
    }

    /// The variances of the tiers' means, from what is left at points and views.
    fn errors(
        &self,
        points: &Points,
        cells: &mut Vec<DVec3>,
        point: &impl Fn(usize, usize) -> DVec3,
        view: &impl Fn(usize, &View) -> DVec3,
    ) -> [f64; TIERS] {
        let powers = points.powers;
        let mut variances: [f64; TIERS] =
            std::array::from_fn(|t| self.variance(powers[t], cells, |k| point(t, k), |v| view(t, v)));
        let over = |term: &dyn Fn(usize) -> DVec3, tiers: Range<usize>| tiers.fold(DVec3::ZERO, |sum, t| sum + term(t));
        let mut together = |tiers: Range<usize>, power: u32| {
            let point = |k: usize| over(&|t| point(t, k), tiers.clone());
            let view = |v: &View| over(&|t| view(t, v), tiers.clone());
            self.variance(power, cells, point, view)
        };
        // Tiers err together: those of the same points, and those that share the first of them.
        let (mut first, mut before) = (0, None);
        while first < TIERS {
            let end = (first + 1..TIERS).find(|&t| powers[t] != powers[first]).unwrap_or(TIERS);
            let own = &variances[first..end];
            let alone: f64 = own.iter().sum();
            if alone > 0.0 {
                let mut joint = if own.len() > 1 { together(first..end, powers[first]) } else { alone };
                if let Some(nearer) = before {
                    let both = together(nearer..end, powers[first]) - together(nearer..first, powers[first]) - joint;
                    let apart = f64::from(1u32 << (powers[nearer] - powers[first]));
                    joint += both.max(0.0) / (apart * apart.sqrt());
                }
                variances[first..end].iter_mut().for_each(|v| *v *= joint / alone);
            }
            before = Some(first);
            first = end;
        }
        variances
    }

    /// The variance of the mean over 2^`power` points, from what is left at points and views.
    fn variance(
        &self,
        power: u32,
        cells: &mut Vec<DVec3>,
        point: impl Fn(usize) -> DVec3,
        view: impl Fn(&View) -> DVec3,
    ) -> f64 {
        let cells = Cells::new(power, self.net, &point, cells);
        let mut variance = cells.variance(std::array::from_fn(|k| view(&self.views[k])));
        // Small things that were seen, but by no point of the net.
        for v in &self.views[4..] {
            let r = view(v);
            let near = (0..1 << power).map(|k| rms(point(k) - r)).fold(rms(r), f64::min);
            let e = near * v.area;
            variance += e * e;
        }
        variance
    }
}
