//! What the cells of a pixel tell: its value, and how far that may be off.

use glam::DVec3;

use super::cells::{Cell, Cells, Point};
use super::cuts::Error;
use super::lattice::{extent, rms};
use super::strata::Strata;
use super::work::{CLAIMED, Work};
use crate::trace::Tracer;

/// The variance of a cell's mean, as a share of its corners' variance. Measured over scenes of all kinds.
const SPREAD: f64 = 0.35;
/// Of what hides, so many cells of a size are likely to show the most.
const HIDES: f64 = 0.6;
/// The same where every pixel is to keep to the tolerance.
const THOROUGH: f64 = 2.0;
/// The same of a spot of light between shadows.
const SPOTS: f64 = 4.0;

/// What is known of a pixel, beside the errors of its cells.
pub(super) struct Estimate {
    /// Where it has parts: their means.
    parts: Option<Parts>,
    /// The variance that cutting cells does not take off.
    pub(super) fixed: f64,
}

/// Means of the parts of a pixel, and in which of them each point is.
struct Parts {
    means: Vec<DVec3>,
    of: Vec<u32>,
}

impl Estimate {
    /// The variance of the pixel's error.
    pub(super) fn variance(&self, cells: &Cells) -> f64 {
        cells.cells.iter().filter_map(|c| c.error).map(|e| e.variance).sum::<f64>() + self.fixed
    }

    /// The pixel's value.
    pub(super) fn value(&self, work: &Work, cells: &Cells) -> DVec3 {
        if let (Some(parts), Some(strata)) = (&self.parts, &work.strata) {
            let mean = |(k, mean): (usize, &DVec3)| *mean * strata.area(k);
            return work.base + parts.means.iter().enumerate().map(mean).sum::<DVec3>();
        }
        let mean = |cell: &Cell| {
            cell.corners.iter().map(|k| cells.points[*k as usize].open).sum::<DVec3>() * (0.25 * cell.area())
        };
        work.base + cells.cells.iter().map(mean).sum::<DVec3>()
    }
}

impl Work {
    /// How often halving a pixel whose corners are no exception would be worth it, less one. Takes the variance
    /// that a point must take off to be worth it, if that counts, and the variance that is enough.
    pub(super) fn foreseen(&self, (a_point, enough): (Option<f64>, f64)) -> f64 {
        let variance = SPREAD * spread(&[0, 1, 2, 3].map(|k| self.views[k].open));
        // A halving leaves a quarter of a cell's variance to each half, and half of the pixel's.
        let times = a_point.map_or_else(|| libm::log2(variance / enough), |v| 0.5 * libm::log2(variance / v));
        (times - 1.0).max(0.0)
    }

    /// What the cells tell by now; their errors are noted with them.
    pub(super) fn estimate(&mut self, cells: &mut Cells, tracer: &Tracer) -> Estimate {
        if self.strata.is_some() {
            let views = self.views[4..].iter().map(|v| (v.at, v.seen.first));
            let samples: Vec<_> = cells.points.iter().map(|p| (p.place(), p.first)).chain(views).collect();
            self.strata = Some(Strata::new(tracer, self.origin, &samples));
        }
        let Some(strata) = self.strata.as_ref().filter(|s| !s.parts.is_empty()) else {
            let views: Vec<DVec3> = self.views[4..].iter().map(|v| v.open).collect();
            self.judge(cells, |p, _| p.open, &views, self.strata.is_some());
            return Estimate { parts: None, fixed: self.still };
        };
        let parts = self.parts(cells, strata);
        let views: Vec<DVec3> = self.views[4..].iter().map(|v| v.open - parts.means[strata.of(v.at)]).collect();
        let doubt = CLAIMED * strata.doubt * extent(parts.means.iter().copied());
        self.judge(cells, |p, k| p.open - parts.means[parts.of[k] as usize], &views, true);
        Estimate { parts: Some(parts), fixed: self.still + doubt * doubt }
    }

    /// The means of what cells tell of the parts, whose areas are exact.
    fn parts(&self, cells: &Cells, strata: &Strata) -> Parts {
        let of: Vec<u32> = cells.points.iter().map(|p| strata.of(p.place()) as u32).collect();
        let mut sums = vec![(DVec3::ZERO, 0.0); strata.parts.len() + 1];
        let mut all = DVec3::ZERO;
        for cell in &cells.cells {
            let weight = 0.25 * cell.area();
            for &k in &cell.corners {
                let x = cells.points[k as usize].open * weight;
                let sum = &mut sums[of[k as usize] as usize];
                *sum = (sum.0 + x, sum.1 + weight);
                all += x;
            }
        }
        for v in &self.views[4..] {
            // A small thing is no fair sample, but better than none.
            let sum = &mut sums[strata.of(v.at)];
            if sum.1 == 0.0 {
                *sum = (v.open, 1.0);
            }
        }
        let mean = |(sum, weight): (DVec3, f64)| if weight > 0.0 { sum * (1.0 / weight) } else { all };
        Parts { means: sums.into_iter().map(mean).collect(), of }
    }

    /// Notes the errors of the cells, of those that are new or of `all`: from what is left at points and views
    /// when means are taken off.
    fn judge(&self, cells: &mut Cells, rest: impl Fn(&Point, usize) -> DVec3, views: &[DVec3], all: bool) {
        let Cells { cells, points, near, compared, .. } = cells;
        if all || near.is_empty() {
            (*near, *compared) = (views.iter().map(|r| rms(*r)).collect(), 0);
        }
        for v in &self.views[4..] {
            if let Some(cell) = cells.iter_mut().find(|c| c.contains(v.at)) {
                cell.error = None;
            }
        }
        let rest = |k: u32| rest(&points[k as usize], k as usize);
        for cell in cells.iter_mut().filter(|c| all || c.error.is_none()) {
            cell.error = Some(self.error(cell, cell.corners.map(rest)));
        }
        // Small things that were seen, but by no point.
        let new = std::mem::replace(compared, points.len())..points.len();
        for ((v, r), near) in self.views[4..].iter().zip(views).zip(near) {
            *near = new.clone().map(|k| rms(rest(k as u32) - *r)).fold(*near, f64::min);
            if let Some(error) = cells.iter_mut().find(|c| c.contains(v.at)).and_then(|c| c.error.as_mut()) {
                let e = *near * v.area;
                error.variance += e * e;
            }
        }
    }

    /// The error of a cell whose corners show this.
    fn error(&self, cell: &Cell, corners: [DVec3; 4]) -> Error {
        let area = cell.area();
        // Looked for in so many cells and not met, little is left of what hides.
        let hides = if self.thorough { THOROUGH } else { HIDES };
        let found = |often: f64| {
            let share = area / (area + 1.0 / often);
            area * share * share
        };
        let unseen = self.hidden * found(hides) + self.gaps * found(SPOTS);
        let [a, b, c, d] = corners;
        let spread = spread(&corners);
        // Written so that NaN is never sure.
        let spread = if spread < cell.inherited { cell.inherited } else { spread };
        Error {
            variance: SPREAD * area * area * spread + unseen,
            spread,
            across: ((a - b).length_squared() + (d - c).length_squared()) as f32,
            down: ((a - d).length_squared() + (b - c).length_squared()) as f32,
        }
    }
}

/// The variance of four colours' components.
fn spread(values: &[DVec3; 4]) -> f64 {
    let mean = (values[0] + values[1] + values[2] + values[3]) * 0.25;
    values.iter().map(|x| (*x - mean).length_squared()).sum::<f64>() * (1.0 / 12.0)
}
