//! How open pixels are settled, round after round: by their only edge, or by their cells.

use glam::DVec2;

use super::block::{Block, Search, WORTH};
use super::cells::{Cells, Cut};
use super::cuts::{self, Limits};
use super::fit::{Fit, Next, Side};
use super::lattice::{UNIT, rms};
use super::work::{How, Key, Work};
use crate::trace::record::{Look, NONE};
use crate::trace::{PlanePoint, mix};

/// Halvings that a pixel begins with, and where small things are many.
const FIRST_CELLS: u32 = 2;
const CROWDED: u32 = 4;
/// Where more neighbours than this differ, a pixel begins with nearly as many as it will need, and with so many
/// at most: points that are traced together cost less.
const BUSY: f64 = 0.7;
const FORESEEN: f64 = 6.0;
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
        let (hidden, gaps) = (work.hidden, work.gaps);
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
                    let places = (0..TRIALS).map(|k| trial_place(work.at, k));
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
        self.begin(work);
        false
    }

    /// The variance that a pixel's points must take off each to be worth it, if that counts.
    fn a_point(&self, work: &Work) -> Option<f64> {
        (!self.every_pixel).then_some(self.tolerance * self.tolerance / WORTH * work.rays)
    }

    /// Begins to look at a pixel's cells.
    pub(super) fn begin(&mut self, work: &mut Work) {
        let mut times = if work.crowded { CROWDED } else { FIRST_CELLS };
        if work.busy > BUSY {
            let limits = (self.a_point(work), self.tolerance * self.tolerance);
            times = times.max(work.foreseen(limits).min(FORESEEN) as u32);
            // Among so much else, outlines of what is seen first tell little.
            work.strata = None;
        }
        let mut cells = self.spare.pop().unwrap_or_default();
        cells.begin([0, 1, 2, 3].map(|k| (work.views[k].open, work.views[k].seen.first)));
        cells.whole = work.wants_whole_paths();
        cells.cut(&[(0, Cut { times, upright: true, along: false })]);
        self.ask_fresh(work, &mut cells);
        work.how = How::Cells(cells);
    }

    /// Asks for a pixel's fresh points, but those whose answer is known.
    fn ask_fresh(&mut self, work: &Work, cells: &mut Cells) {
        let sure = work.unseen() + work.slope <= self.limit(0, work.rays);
        let settled = if sure { work.settled_parts() } else { Vec::new() };
        let strata = work.strata.as_ref().filter(|_| !settled.is_empty());
        for k in cells.take_fresh() {
            let point = &mut cells.points[k];
            if let Some(known) = strata.and_then(|s| settled.get(s.of(point.place()))?.as_ref()) {
                (point.open, point.first) = (known.radiance, known.first);
                continue;
            }
            let at = point.from(work.origin);
            let place = if cells.whole {
                let new = (self.found.len() + self.whole.len()) as u32;
                let name = u64::from(at.x as u32) << 32 | u64::from(at.y as u32);
                let place = if point.shared() { *self.shared.entry(name).or_insert(new) } else { new };
                if place == new {
                    self.whole.push(at);
                }
                place
            } else {
                self.ask(at, work.look) as u32
            };
            cells.asked.push((k as u32, place));
        }
    }

    /// Takes in what a pixel's points showed, and asks for more if need be. Whether it is settled.
    fn grow(&mut self, work: &mut Work) -> bool {
        let How::Cells(cells) = &mut work.how else { return true };
        let mut cells = std::mem::take(cells);
        let mut astray = false;
        for (k, place) in cells.asked.drain(..) {
            let point = &mut cells.points[k as usize];
            if cells.whole {
                point.open = self.found[place as usize].radiance;
            } else {
                let probe = &self.probes[place as usize];
                (point.open, point.first) = (probe.radiance, probe.first);
                astray |= probe.hash != work.hash;
            }
        }
        if astray {
            // Something was met that no corner shows: nothing is known to be the same everywhere.
            self.spare.push(cells);
            self.look_at_all(work, self.all_rays(work));
            self.begin(work);
            return false;
        }
        let estimate = work.estimate(&mut cells, self.tracer);
        let limits = Limits { enough: self.tolerance * self.tolerance, a_point: self.a_point(work) };
        cuts::next(&cells.cells, estimate.fixed, limits, &mut self.cuts);
        if self.cuts.is_empty() {
            self.finish(work.pixel, estimate.value(work, &cells), estimate.variance(&cells));
            self.spare.push(cells);
            return true;
        }
        cells.cut(&self.cuts);
        self.ask_fresh(work, &mut cells);
        work.how = How::Cells(cells);
        false
    }
}

/// The `k`-th place, in pixels, by which an edge of pixel (x, y) is tried: evenly spread (Roberts, *The
/// unreasonable effectiveness of quasirandom sequences*, 2018), and other places in every pixel.
fn trial_place((x, y): (u32, u32), k: u32) -> DVec2 {
    let hash = mix(u64::from(x) << 32 | u64::from(y), 0);
    let start = |bits: u64| (bits & 0xffff) as f64 * (1.0 / 65536.0);
    let at = DVec2::new(start(hash >> 20), start(hash >> 40)) + DVec2::new(0.754_877_666, 0.569_840_291) * f64::from(k);
    at.fract()
}
