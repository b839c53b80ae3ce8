//! A block of pixels: which of its cells are refined, round after round.
//!
//! Every pixel begins as one cell with samples at its corners. Where all four see the same
//! objects, the cell falls apart into parts ([`Part`]) that are judged one by one. What is not
//! known well enough is looked at closer: crossings on sides by bisection, chords by a look at
//! their middle, everything else by four cells of half the edge. Every decision is a function
//! of what is seen in the pixel and at the corners of its neighbours, so that blocks and
//! regions may be cut anyhow.

use std::collections::HashMap;

use glam::DVec3;

use super::cell::{Cell, Outcome, SidePlace, integrate};
use super::corners::Corners;
use super::curve::{Check, Verdict};
use super::detail;
use super::feature::{self, Feature};
use super::part::Part;
use super::side::{self, Chain, Entry, Side};
use super::store::{NONE, SampleId, Store, UNIT, lights_of};
use crate::film::{PixelError, Region};
use crate::trace::record::Want;
use crate::trace::{RayCounts, Tracer};

/// Times a pixel's cell is divided, at most.
const LEVELS: u32 = 6;
/// Cells are divided whose error's standard deviation is so many tolerances.
const DIVIDE: f64 = 2.0;
/// Edges whose contrast times the cell is less, in tolerances, are not looked beside.
const BESIDE: f64 = 4.0;
/// Standard deviation of what neighbours' edges let expect unseen in a pixel, as a share of
/// their contrast: seen at its corners only, in the middle too, at nine points.
const HIDDEN: [f64; 3] = [0.3, 0.12, 0.05];

/// A pixel's value and what is thought of its error.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pixel {
    pub(crate) value: DVec3,
    pub(crate) error: PixelError,
}

/// A cell with what belongs to its pixel.
#[derive(Clone)]
struct Job {
    pixel: usize,
    cell: Cell,
    features: Vec<Feature>,
    /// Whether to divide it whatever it looks like.
    divide: bool,
    /// Its place, or that of the cell it is a part of, among those of the round.
    root: usize,
    /// Whether its samples show one part alone.
    single: bool,
}

/// A sample on a cell's side, followed to its end.
#[derive(Clone, Copy, Debug)]
struct Seen {
    side: usize,
    t: i32,
    sample: SampleId,
}

/// The edges on the sides of cells.
struct Edges {
    chains: Vec<Chain>,
    /// Per cell, places in `chains`.
    sides: Vec<[Option<u32>; 4]>,
}

impl Edges {
    fn of(&self, cell: usize) -> [Option<&Chain>; 4] {
        self.sides[cell].map(|s| s.map(|i| &self.chains[i as usize]))
    }
}

/// What was seen on the sides of each root cell, the edges found before, and whose they are.
type Known<'a> = (&'a [Vec<Seen>], &'a Edges, &'a HashMap<(usize, Part), usize>);

struct Block<'a> {
    store: Store<'a>,
    region: Region,
    tolerance: f64,
    pixels: Vec<Pixel>,
}

/// Renders a block whose pixels' corners are in `corners`.
pub(crate) fn render(tracer: &Tracer, corners: &Corners, region: Region, tolerance: f64) -> (Vec<Pixel>, RayCounts) {
    let least = corners.least;
    let mut store = Store::new(tracer, &corners.records, region, least);
    let (w, h) = (region.width(), region.height());
    for j in 0..=h {
        for i in 0..=w {
            store.know(i as i32 * UNIT, j as i32 * UNIT, corners.at(region.x0 + i, region.y0 + j));
        }
    }
    let pixels = vec![Pixel::default(); region.area() as usize];
    let mut block = Block { store, region, tolerance, pixels };
    let mut jobs = block.roots(corners);
    for level in 0..=LEVELS {
        if jobs.is_empty() {
            break;
        }
        jobs = block.round(jobs, level);
    }
    (block.pixels, block.store.counts)
}

impl Block<'_> {
    /// One cell for every pixel.
    fn roots(&mut self, corners: &Corners) -> Vec<Job> {
        let (w, region, tolerance) = (self.region.width(), self.region, self.tolerance);
        let mut jobs = Vec::with_capacity(self.pixels.len());
        let mut looks = Vec::new();
        for pixel in 0..self.pixels.len() {
            let (i, j) = (pixel as u32 % w, pixel as u32 / w);
            let (x, y) = (region.x0 + i, region.y0 + j);
            let at = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)].map(|(x, y)| corners.at(x, y));
            let mut cell = Cell {
                part: Part::From(1),
                x: i as i32 * UNIT,
                y: j as i32 * UNIT,
                size: UNIT,
                corners: at,
                centre: NONE,
            };
            feature::look(&mut self.store, (x, y), &cell, pixel, &mut looks);
            let busy = corners.busy((x, y), tolerance);
            let mut looked = 0;
            if HIDDEN[0] * busy > tolerance {
                cell.centre = self.store.ask(cell.x + UNIT / 2, cell.y + UNIT / 2, Want::From(1));
                looked = 1;
            }
            let divide = HIDDEN[1] * busy > tolerance;
            if divide {
                looked = 2;
            }
            let hidden = HIDDEN[looked] * busy;
            self.pixels[pixel].error.samples += hidden * hidden;
            for s in at {
                let (faint, deep) = corners.lost(s);
                self.pixels[pixel].error.weight += 0.25 * faint;
                self.pixels[pixel].error.depth += 0.25 * deep;
            }
            jobs.push(Job { pixel, cell, features: Vec::new(), divide, root: 0, single: false });
        }
        self.store.flush();
        feature::take(&mut self.store, looks, |pixel, f| jobs[pixel].features.push(f));
        jobs
    }

    /// Settles what is known well enough of `jobs`, and gives the cells that others divide into.
    fn round(&mut self, jobs: Vec<Job>, level: u32) -> Vec<Job> {
        let mut parts = self.take_apart(&jobs, None);
        let edges = self.search(&parts, None);
        let seen = self.beside(&jobs, &parts, &edges);
        let edges = if seen.iter().all(Vec::is_empty) {
            edges
        } else {
            let before: HashMap<(usize, Part), usize> =
                parts.iter().enumerate().map(|(i, p)| ((p.root, p.cell.part), i)).collect();
            parts = self.take_apart(&jobs, Some(&seen));
            self.search(&parts, Some((&seen, &edges, &before)))
        };
        let mut outcomes: Vec<Outcome> = (0..parts.len()).map(|i| self.judge(&parts[i], edges.of(i))).collect();
        self.check(&parts, &mut outcomes);
        self.centre(&mut parts, &edges, &mut outcomes);
        let mut divided = Vec::new();
        for (job, o) in parts.into_iter().zip(outcomes) {
            let limit = DIVIDE * self.tolerance;
            if level < LEVELS && (o.variance > limit * limit || job.divide) {
                divided.push(job);
            } else {
                let pixel = &mut self.pixels[job.pixel];
                pixel.value += o.value;
                pixel.error.samples += o.variance;
            }
        }
        self.divide(divided)
    }

    /// The parts of cells, as far as their corners, middles and what was `seen` on their sides tell.
    fn take_apart(&mut self, jobs: &[Job], seen: Option<&[Vec<Seen>]>) -> Vec<Job> {
        let mut parts = Vec::with_capacity(jobs.len());
        for (root, job) in jobs.iter().enumerate() {
            let seen = seen.map_or(&[][..], |s| &s[root][..]);
            self.take_one_apart(&Job { root, ..job.clone() }, seen, &mut parts);
        }
        parts
    }

    /// Splits a cell that sees the same objects everywhere into its parts.
    fn take_one_apart(&mut self, job: &Job, seen: &[Seen], parts: &mut Vec<Job>) {
        let Part::From(first) = job.cell.part else {
            parts.push(job.clone());
            return;
        };
        if job.divide || job.features.iter().any(Feature::is_object) {
            parts.push(job.clone());
            return;
        }
        let mut samples: Vec<SampleId> = job.cell.corners.to_vec();
        samples.extend(seen.iter().map(|s| s.sample));
        samples.extend(job.features.iter().map(|f| f.sample));
        if job.cell.centre != NONE {
            samples.push(job.cell.centre);
        }
        for depth in first.. {
            let with = |part| Job { cell: Cell { part, ..job.cell.clone() }, ..job.clone() };
            let part = Part::From(depth);
            let key = self.store.key(samples[0], part);
            if samples[1..].iter().any(|&s| self.store.key(s, part) != key) {
                parts.push(with(part));
                return;
            }
            let Some((meeting, words)) = self.store.meeting(samples[0], depth) else { return };
            if meeting.object().is_none() {
                parts.push(with(part));
                return;
            }
            let (mut all, mut any) = (words.to_vec(), words.to_vec());
            for &s in &samples[1..] {
                let Some((_, words)) = self.store.meeting(s, depth) else { return };
                for (k, &word) in words.iter().enumerate() {
                    all[k] &= word;
                    any[k] |= word;
                }
            }
            let some: Vec<u64> = all.iter().zip(&any).map(|(a, b)| a ^ b).collect();
            for light in lights_of(&some) {
                parts.push(with(Part::Light(depth, light as u32)));
            }
            if all.iter().any(|&word| word != 0) {
                let set = self.store.keep(all);
                parts.push(with(Part::Lights(depth, set)));
            }
        }
    }

    /// Finds the edges on the sides of all cells, beginning with what is known of them.
    fn search(&mut self, parts: &[Job], known: Option<Known<'_>>) -> Edges {
        let mut wanted: Vec<Side> = Vec::new();
        let mut places: HashMap<(Part, bool, i32, i32, i32, usize), u32> = HashMap::new();
        let mut sides = Vec::with_capacity(parts.len());
        for job in parts {
            let c = &job.cell;
            let earlier = known.and_then(|(_, edges, before)| before.get(&(job.root, c.part)).map(|&i| edges.of(i)));
            // What was seen beside edges of other parts counts for its own cell alone.
            let seen = match (known, c.part) {
                (Some((seen, ..)), _) if !job.single => &seen[job.root][..],
                _ => &[],
            };
            let mut own = [None; 4];
            for (k, own) in own.iter_mut().enumerate() {
                let SidePlace { horizontal, fixed, start, ends } = c.side(k);
                let mut chain = match earlier.and_then(|e| e[k]) {
                    Some(chain) => chain.clone(),
                    None => vec![Entry::new(start, ends[0], ends[0]), Entry::new(start + c.size, ends[1], ends[1])],
                };
                for s in seen.iter().filter(|s| s.side == k) {
                    side::insert(&mut chain, s.t, s.sample);
                }
                let first = self.store.key(chain[0].sample, c.part);
                if chain[1..].iter().all(|e| self.store.key(e.sample, c.part) == first) {
                    continue;
                }
                let scope = if known.is_some() { job.root } else { 0 };
                *own = Some(*places.entry((c.part, horizontal, fixed, start, c.size, scope)).or_insert_with(|| {
                    wanted.push(Side { part: c.part, horizontal, fixed, size: c.size, chain });
                    wanted.len() as u32 - 1
                }));
            }
            sides.push(own);
        }
        Edges { chains: side::search(&mut self.store, &wanted, self.tolerance), sides }
    }

    /// Looks right beside the edges found: what else differs there comes to light.
    fn beside(&mut self, jobs: &[Job], parts: &[Job], edges: &Edges) -> Vec<Vec<Seen>> {
        let mut seen = vec![Vec::new(); jobs.len()];
        for (i, part) in parts.iter().enumerate() {
            let Part::From(first) = jobs[part.root].cell.part else { continue };
            let c = &part.cell;
            for (k, chain) in edges.of(i).into_iter().enumerate() {
                for pair in chain.map_or(&[][..], |c| c).windows(2) {
                    let (a, b) = (&pair[0], &pair[1]);
                    if self.store.key(a.sample, c.part) == self.store.key(b.sample, c.part)
                        || self.store.contrast(a.like, b.like, c.part) * c.edge() * c.edge() < BESIDE * self.tolerance
                        || (b.t - a.t == c.size && a.next.is_some() && a.doubt == 0.0)
                    {
                        continue;
                    }
                    let (low, high) = match a.next {
                        Some(e) if b.t - a.t > 4 => ((e.t - 1.0).floor() as i32, (e.t + 1.0).ceil() as i32),
                        _ => (a.t, b.t),
                    };
                    let SidePlace { horizontal, fixed, .. } = c.side(k);
                    // What is beside a shadow's edge is the same on both sides of it.
                    let both = if matches!(c.part, Part::Light(..)) { &[low][..] } else { &[low, high] };
                    for &t in both {
                        let t = t.clamp(a.t, b.t);
                        let (u, v) = if horizontal { (t, fixed) } else { (fixed, t) };
                        let sample = self.store.ask(u, v, Part::From(first).whole());
                        seen[part.root].push(Seen { side: k, t, sample });
                    }
                }
            }
        }
        self.store.flush();
        seen
    }

    /// What is thought of a cell.
    fn judge(&self, job: &Job, sides: [Option<&Chain>; 4]) -> Outcome {
        let mut o = integrate(&job.cell, sides, &self.store, self.tolerance);
        detail::add(&self.store, &job.cell, &mut o);
        feature::add(&self.store, &job.cell, &job.features, sides, &mut o);
        o
    }

    /// Looks where single edges leave their chords.
    fn check(&mut self, jobs: &[Job], outcomes: &mut [Outcome]) {
        let mut open: Vec<Check> =
            outcomes.iter().enumerate().filter_map(|(i, o)| Check::new(i, o, self.tolerance)).collect();
        while !open.is_empty() {
            open.retain_mut(|check| {
                let cell = &jobs[check.cell].cell;
                let o = &mut outcomes[check.cell];
                match check.step(cell, &mut self.store, self.tolerance) {
                    Verdict::Open => return true,
                    Verdict::Found(shift, variance) => {
                        o.value += shift;
                        o.variance = variance;
                    }
                    Verdict::Failed => o.variance = check.variance_if_failed(cell.edge()),
                }
                false
            });
            self.store.flush();
        }
    }

    /// Looks at the middle of cells where that may do.
    fn centre(&mut self, jobs: &mut [Job], edges: &Edges, outcomes: &mut [Outcome]) {
        let mut asked = Vec::new();
        for (i, (job, o)) in jobs.iter_mut().zip(&*outcomes).enumerate() {
            if o.wants_centre && o.variance > self.tolerance * self.tolerance {
                let c = &mut job.cell;
                c.centre = self.store.ask(c.x + c.size / 2, c.y + c.size / 2, c.part.whole());
                asked.push(i);
            }
        }
        self.store.flush();
        for i in asked {
            outcomes[i] = self.judge(&jobs[i], edges.of(i));
        }
    }

    /// Four cells for each.
    fn divide(&mut self, jobs: Vec<Job>) -> Vec<Job> {
        let mut next = Vec::with_capacity(4 * jobs.len());
        for job in jobs {
            let Cell { part, x, y, size, corners: [tl, tr, br, bl], .. } = job.cell;
            let half = size / 2;
            let want = part.whole();
            let mut ask = |u: i32, v: i32| self.store.ask(x + u, y + v, want);
            let [top, left, middle, right, bottom] =
                [(half, 0), (0, half), (half, half), (size, half), (half, size)].map(|(u, v)| ask(u, v));
            for (u, v, corners) in [
                (0, 0, [tl, top, middle, left]),
                (half, 0, [top, tr, right, middle]),
                (half, half, [middle, right, br, bottom]),
                (0, half, [left, middle, bottom, bl]),
            ] {
                let cell = Cell { part, x: x + u, y: y + v, size: half, corners, centre: NONE };
                let features = feature::inherit(self.store.tracer, &job.features, self.region, &cell);
                let single = !matches!(part, Part::From(_));
                next.push(Job { pixel: job.pixel, cell, features, divide: false, root: 0, single });
            }
        }
        self.store.flush();
        next
    }
}
