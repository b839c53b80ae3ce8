//! How open pixels are settled, round after round: by their only edge, or by points of their nets.

use super::block::{Block, Search, WORTH};
use super::fit::{Fit, Next, Side};
use super::lattice::{UNIT, rms};
use super::net;
use super::points::Points;
use super::tiers::{self, Limits, Powers};
use super::work::{How, Key, Work};
use crate::trace::PlanePoint;
use crate::trace::record::{Look, NONE, TIERS};

/// The points that a net begins with, as a power of two.
pub(super) const FIRST_POINTS: u32 = 2;
/// Points by which an edge is tried.
const TRIALS: u32 = 6;

impl Block<'_> {
    /// Begins to look for the only edge through a pixel.
    pub(super) fn fit(&mut self, work: &mut Work, look: Look) -> bool {
        let first = work.views[0].seen.signature;
        let like: [bool; 4] = std::array::from_fn(|k| work.views[k].seen.signature == first);
        let Some(other) = (1..4).find(|&k| !like[k]) else { return false };
        if (1..4).any(|k| !like[k] && work.views[k].seen.signature != work.views[other].seen.signature) {
            return false;
        }
        let contrast = rms(work.open_of(&like, true).0 - work.open_of(&like, false).0);
        let Some(fit) = Fit::new(like, contrast) else { return false };
        let keys = [0, other].map(|k| Key::of(&self.corners.records, &work.views[k].seen, &look, &self.lights));
        let (i, j) = (work.at.0 - self.region.x0, work.at.1 - self.region.y0);
        let (width, from) = (self.region.width() + 1, self.origin());
        let mut sides = [0; 2];
        for (side, k) in sides.iter_mut().zip(fit.crossed()) {
            // The upper, right, lower and left one.
            let (i, j, horizontal) = [(i, j, true), (i + 1, j, false), (i, j + 1, true), (i, j, false)][k];
            let place = &mut self.places[(j * width + i) as usize][usize::from(!horizontal)];
            if *place == NONE {
                *place = self.searches.len() as u32;
                let start = if k < 2 { k } else { (k + 1) % 4 };
                let ends = if like[start] { keys } else { [keys[1], keys[0]] };
                let start = PlanePoint { x: from.x + UNIT * i as i32, y: from.y - UNIT * j as i32 };
                let side = Side::default();
                self.searches.push(Search { side, start, horizontal, look, ends, wanted: 0, asked: 0 });
            }
            *side = *place as usize;
        }
        work.how = How::Fit { fit, look, keys, sides, asked: None, trial: None };
        true
    }

    /// Goes on with a pixel. Whether it is settled.
    pub(super) fn advance(&mut self, work: &mut Work) -> bool {
        // Every look that agrees makes it less likely that more hides.
        let (hidden, gaps) = (work.hidden, work.all_gaps());
        // An edge is looked at, and not what other lights may do beside it.
        let doubt = |looks: u32| hidden / libm::pow(1.0 + f64::from(looks), 1.5) + gaps;
        let How::Fit { fit, look, keys, sides, asked, trial } = &mut work.how else { return self.grow(work) };
        let found = sides.map(|s| self.searches[s].side);
        let steps = fit.steps();
        let mut fits = (0..2).all(|k| found[k].broken >= steps[k]);
        if fits && let Some((start, count)) = asked.take() {
            let seen = self.probes[start..start + count].iter().map(Key::from);
            let like: Option<Vec<bool>> = seen.map(|k| (keys.contains(&k)).then_some(k == keys[0])).collect();
            let sides = [&found[0], &found[1]];
            fits = like.is_some_and(|like| match trial {
                Some(expected) => like == *expected,
                None => fit.learn(&like, sides),
            });
        }
        while fits {
            let samples = fit.samples + trial.as_ref().map_or(0, Vec::len) as u32;
            let limit = self.limit(samples, 2.0);
            match fit.next([&found[0], &found[1]], (limit - doubt(samples)).max(0.25 * limit)) {
                Next::Sides(steps) => {
                    let mut waits = false;
                    for k in 0..2 {
                        let search = &mut self.searches[sides[k]];
                        fits &= search.side.broken >= steps[k];
                        if search.side.known < steps[k] {
                            waits = true;
                            if search.wanted < steps[k] {
                                search.wanted = steps[k];
                                self.active.push(sides[k] as u32);
                            }
                        }
                    }
                    if fits && waits {
                        return false;
                    }
                }
                Next::Points(points) => {
                    *asked = Some(self.ask_all(work.origin, points, *look));
                    return false;
                }
                Next::Done(..) if trial.is_none() => {
                    let sides = [&found[0], &found[1]];
                    let places = (0..TRIALS).map(|k| work.net.place(k));
                    let known = places.filter_map(|p| Some((p, fit.side(p, sides)?)));
                    let (points, expected) = known.chain(fit.quarters(sides, limit)).unzip();
                    *trial = Some(expected);
                    *asked = Some(self.ask_all(work.origin, points, *look));
                    return false;
                }
                Next::Done(area, variance) => {
                    let (value, rest) = work.two_sided(area);
                    self.finish(work.pixel, value, variance + rest + doubt(samples));
                    return true;
                }
            }
        }
        self.spread(work, [FIRST_POINTS; TIERS]);
        false
    }

    /// Asks for the first 2^`powers` points of a pixel, or for those that are new in their tiers.
    pub(super) fn spread(&mut self, work: &mut Work, powers: Powers) {
        let (mut points, old) = match std::mem::replace(&mut work.how, How::Closed) {
            How::Net(points) => {
                let old = points.powers.map(|p| 1 << p);
                (points, old)
            }
            _ => (Points::default(), [0; TIERS]),
        };
        let sure = work.unseen() + work.slope <= self.limit(0, work.all_rays());
        let settled = if sure { work.settled_parts() } else { Vec::new() };
        points.whole = work.wants_whole_paths() && self.tracer.only_waves();
        points.extend(powers);
        for tier in 0..TIERS {
            points.start[tier] = if points.whole { self.whole[tier].len() } else { self.points.len() };
            let first = powers.get(tier + 1).map_or(0, |p| 1 << p).max(old[tier]);
            let mut asked = std::mem::take(&mut points.asked[tier]);
            asked.clear();
            asked.extend(work.net.side_by_side(first, 1 << powers[tier]));
            if let Some(strata) = work.strata.as_ref().filter(|_| !settled.is_empty()) {
                asked.retain(|&k| {
                    let known = settled.get(strata.of(work.net.place(k))).and_then(Option::as_ref);
                    known.is_none_or(|known| {
                        points.show_all(k, tier, known);
                        false
                    })
                });
            }
            let places = asked.iter().map(|&k| work.net.point_of(work.origin, k));
            if points.whole {
                self.whole[tier].extend(places);
            } else {
                self.points.extend(places);
                self.looks.resize(self.points.len(), work.look.up_to(tier));
            }
            points.asked[tier] = asked;
        }
        work.how = How::Net(points);
    }

    /// Takes in what a net's points showed, and asks for more if need be. Whether it is settled.
    fn grow(&mut self, work: &mut Work) -> bool {
        let How::Net(points) = &mut work.how else { return true };
        let powers = points.powers;
        let mut astray = false;
        for tier in 0..TIERS {
            let asked = std::mem::take(&mut points.asked[tier]);
            for (&k, i) in asked.iter().zip(points.start[tier]..) {
                if points.whole {
                    points.show(k, tier, &self.samples[tier][i]);
                } else {
                    let probe = &self.probes[i];
                    points.show_all(k, tier, probe);
                    astray |= probe.hash != work.hash;
                }
            }
            points.asked[tier] = asked;
        }
        if astray {
            // Something was met that no corner shows: nothing is known to be the same everywhere.
            self.look_at_all(work, self.all_rays(work));
            work.how = How::Closed;
            self.spread(work, powers);
            return false;
        }
        let (value, variances, fixed) = work.evaluate(self.tracer, &mut self.cells);
        let enough = self.tolerance * self.tolerance;
        let a_ray = (!self.every_pixel).then_some(enough / WORTH);
        match tiers::next(powers, (variances, fixed), work.rays, Limits { enough, a_ray, most: net::MOST }) {
            None => {
                self.finish(work.pixel, value, variances.iter().sum::<f64>() + fixed);
                true
            }
            Some(powers) => {
                self.spread(work, powers);
                false
            }
        }
    }
}
