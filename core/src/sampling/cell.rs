//! One part's integral over one square cell, from samples and edges around it.
//!
//! The boundary is walked once around. Edges cut it into arcs of one key each; two arcs are
//! separated by the chord between their edges, bent as far as the edge's shape is known; more
//! arcs are cut off one by one where two of the others are alike, and meet in a point where not.
//! Each area is taken with the mean of its samples. Beside the value goes the variance of its
//! error: of crossings, by how narrowly they were found; of chords, by how far an edge of that
//! length usually leaves its chord; of areas, by the spread of the samples.

use glam::DVec3;

use super::curve::{Bulge, bulge};
use super::outline::{self, Crossing};
use super::part::Part;
use super::side::{Chain, DOUBT};
use super::store::{NONE, SampleId, Store, UNIT, rms};

/// Standard deviation of the mean over an area, as a share of its samples' spread: where
/// nothing discrete differs, and where something does.
const SMOOTH: f64 = 0.08;
const MIXED: f64 = 0.3;
/// The same for the share of several areas that meet inside a cell, of their contrast.
const JUNCTION: f64 = 0.21;
/// The same where edges too faint to be followed cross.
const FAINT: f64 = 0.18;
/// The same where a middle differs from everything around it.
const INNER: f64 = 0.3;
/// Samples closer than this many tolerances count as one.
const MERGE: f64 = 2.0;

/// A point of a cell, in pixels from its upper left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spot {
    pub(crate) x: f64,
    pub(crate) y: f64,
}

pub(crate) fn cross(a: Spot, b: Spot) -> f64 {
    a.x * b.y - a.y * b.x
}

pub(crate) fn distance(a: Spot, b: Spot) -> f64 {
    ((a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y)).sqrt()
}

/// A square of the picture and a part to be integrated over it.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    pub(crate) part: Part,
    /// Upper left corner and edge, in lattice units.
    pub(crate) x: i32,
    pub(crate) y: i32,
    pub(crate) size: i32,
    /// Clockwise from the upper left one.
    pub(crate) corners: [SampleId; 4],
    /// The sample in the middle, if there is one.
    pub(crate) centre: SampleId,
}

impl Cell {
    /// Its edge in pixels.
    pub(crate) fn edge(&self) -> f64 {
        f64::from(self.size) / f64::from(UNIT)
    }

    /// Its upper, right, lower or left side.
    pub(crate) fn side(&self, k: usize) -> SidePlace {
        let [tl, tr, br, bl] = self.corners;
        let (horizontal, fixed, start, ends) = match k {
            0 => (true, self.y, self.x, [tl, tr]),
            1 => (false, self.x + self.size, self.y, [tr, br]),
            2 => (true, self.y + self.size, self.x, [bl, br]),
            _ => (false, self.x, self.y, [tl, bl]),
        };
        SidePlace { horizontal, fixed, start, ends }
    }

    /// A point of the lattice relative to the cell.
    fn spot(&self, x: f64, y: f64) -> Spot {
        let unit = 1.0 / f64::from(UNIT);
        Spot { x: (x - f64::from(self.x)) * unit, y: (y - f64::from(self.y)) * unit }
    }
}

/// Where a cell's side is.
pub(crate) struct SidePlace {
    pub(crate) horizontal: bool,
    /// Its row, or column.
    pub(crate) fixed: i32,
    /// Where it starts along the other axis.
    pub(crate) start: i32,
    pub(crate) ends: [SampleId; 2],
}

/// A stretch of a cell's boundary that shows one thing.
#[derive(Clone, Debug)]
pub(crate) struct Arc {
    key: u64,
    signature: u64,
    mixed: bool,
    sum: DVec3,
    count: f64,
    low: DVec3,
    high: DVec3,
    /// Twice the signed area swept about the cell's corner so far.
    swept: f64,
    pub(crate) start: Spot,
    pub(crate) end: Spot,
    /// The outlines that cross at start and end, where known.
    pub(crate) tags: [Option<Crossing>; 2],
}

impl Arc {
    fn mean(&self) -> DVec3 {
        if self.count > 0.0 { self.sum / self.count } else { DVec3::ZERO }
    }

    /// Variance of the mean over `area`.
    fn doubt(&self, area: f64) -> f64 {
        if self.count == 0.0 {
            return 0.0;
        }
        let e = if self.mixed { MIXED } else { SMOOTH } * rms(self.high - self.low) * area;
        e * e
    }

    fn area(&self, other_way: Spot) -> f64 {
        0.5 * (self.swept + cross(self.end, other_way) + cross(other_way, self.start))
    }
}

/// What is thought of a cell.
pub(crate) struct Outcome {
    /// The integral over the cell, in pixels.
    pub(crate) value: DVec3,
    /// Of its error, the components' mean.
    pub(crate) variance: f64,
    /// The chord of its only edge, if that might be bent.
    pub(crate) chord: Option<Chord>,
    /// Whether a sample in the middle would tell more.
    pub(crate) wants_centre: bool,
}

/// The only edge through a cell.
#[derive(Clone, Debug)]
pub(crate) struct Chord {
    pub(crate) ends: [Spot; 2],
    /// What is seen on its sides, and the parts' values there.
    pub(crate) keys: [u64; 2],
    pub(crate) values: [DVec3; 2],
    /// The variance that is not due to its shape.
    pub(crate) rest: f64,
}

/// A point of the boundary.
#[derive(Clone, Copy)]
struct Stop {
    x: i32,
    y: i32,
    sample: SampleId,
    like: SampleId,
    next: Option<Crossing>,
    doubt: f64,
}

/// The points around a cell, clockwise; `next` of each leads to the one after it.
fn boundary(cell: &Cell, sides: [Option<&Chain>; 4]) -> Vec<Stop> {
    let mut stops = Vec::with_capacity(8);
    let (x0, y0, x1, y1) = (cell.x, cell.y, cell.x + cell.size, cell.y + cell.size);
    for (k, (x, y)) in [(x0, y0), (x1, y0), (x1, y1), (x0, y1)].into_iter().enumerate() {
        let place = |t: i32| if k % 2 == 0 { (t, y) } else { (x, t) };
        let Some(chain) = sides[k] else {
            let sample = cell.corners[k];
            stops.push(Stop { x, y, sample, like: sample, next: None, doubt: DOUBT });
            continue;
        };
        // The lower and the left side run against the chain.
        stops.extend(chain.windows(2).map(|pair| {
            let (at, before) = if k < 2 { (&pair[0], &pair[0]) } else { (&pair[1], &pair[0]) };
            let (x, y) = place(at.t);
            Stop { x, y, sample: at.sample, like: at.like, next: before.next, doubt: before.doubt }
        }));
        if k >= 2 {
            let first = stops.len() - (chain.len() - 1);
            stops[first..].reverse();
        }
    }
    stops
}

/// Integrates `cell`; `sides` are the chains of its upper, right, lower and left side.
pub(crate) fn integrate(cell: &Cell, sides: [Option<&Chain>; 4], store: &Store<'_>, tolerance: f64) -> Outcome {
    let part = cell.part;
    let stops = boundary(cell, sides);
    let area = cell.edge() * cell.edge();
    let keys: Vec<u64> = stops.iter().map(|p| store.key(p.sample, part)).collect();
    if keys.iter().all(|&k| k == keys[0]) {
        return even(cell, store, keys[0]);
    }
    let values: Vec<DVec3> = stops.iter().map(|p| store.value(p.like, part)).collect();
    let merge = MERGE * tolerance / area;
    let n = stops.len();
    let same = |i: usize, j: usize| keys[i] == keys[j] || rms(values[i] - values[j]) <= merge;
    let Some(start) = (0..n).find(|&i| !same(i, (i + n - 1) % n)) else {
        return faint(cell, &stops, &values, store);
    };
    let mut variance = 0.0;
    let mut arcs: Vec<Arc> = Vec::with_capacity(4);
    for k in 0..n {
        let (i, j) = ((start + k) % n, (start + k + n - 1) % n);
        let (stop, before) = (&stops[i], &stops[j]);
        let here = cell.spot(f64::from(stop.x), f64::from(stop.y));
        if k == 0 || !same(j, i) {
            let there = cell.spot(f64::from(before.x), f64::from(before.y));
            let width = (here.x - there.x).abs() + (here.y - there.y).abs();
            let e = before.doubt * store.contrast(stop.like, before.like, part) * width * cell.edge();
            variance += e * e;
            let edge = match before.next {
                None => Spot { x: (here.x + there.x) * 0.5, y: (here.y + there.y) * 0.5 },
                Some(c) if stop.y == before.y => Spot { x: cell.spot(c.t, 0.0).x, y: here.y },
                Some(c) => Spot { x: here.x, y: cell.spot(0.0, c.t).y },
            };
            if let Some(last) = arcs.last_mut() {
                last.swept += cross(last.end, edge);
                (last.end, last.tags[1]) = (edge, before.next);
            }
            arcs.push(Arc {
                key: keys[i],
                signature: store.signature(stop.like, part),
                mixed: false,
                sum: DVec3::ZERO,
                count: 0.0,
                low: values[i],
                high: values[i],
                swept: 0.0,
                start: edge,
                end: edge,
                tags: [before.next, None],
            });
        }
        let Some(arc) = arcs.last_mut() else { continue };
        arc.swept += cross(arc.end, here);
        arc.end = here;
        // Others only stand for samples counted elsewhere.
        if stop.sample == stop.like || stop.like == NONE || arc.count == 0.0 {
            arc.sum += values[i];
            arc.count += 1.0;
            arc.low = arc.low.min(values[i]);
            arc.high = arc.high.max(values[i]);
            arc.mixed |= store.signature(stop.like, part) != arc.signature;
        }
    }
    if let [head, .., tail] = &mut arcs[..] {
        tail.swept += cross(tail.end, head.start);
        (tail.end, tail.tags[1]) = (head.start, head.tags[0]);
    }
    if arcs.len() == 1 {
        // A jump that fades out along the boundary.
        let mut o = faint(cell, &stops, &values, store);
        let e = JUNCTION * rms(arcs[0].high - arcs[0].low) * area;
        (o.variance, o.wants_centre) = (e * e, false);
        return o;
    }
    Areas { cell, store, value: DVec3::ZERO, variance, merge }.divide(arcs)
}

/// The areas of a cell that its edges leave.
struct Areas<'a, 'b> {
    cell: &'a Cell,
    store: &'a Store<'b>,
    value: DVec3,
    variance: f64,
    merge: f64,
}

impl Areas<'_, '_> {
    fn divide(mut self, mut arcs: Vec<Arc>) -> Outcome {
        let single = arcs.len() == 2;
        while arcs.len() > 2 {
            let n = arcs.len();
            // The smallest between two that are alike.
            let small = (0..n)
                .filter(|&i| self.alike(&arcs[(i + n - 1) % n], &arcs[(i + 1) % n]))
                .map(|i| (distance(arcs[i].start, arcs[i].end), i))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, i)) = small else { return self.junction(&arcs) };
            self.cut_off(&mut arcs, i);
        }
        match &arcs[..] {
            [x, y] => self.halves(x, y, single),
            [x] => {
                self.value += x.mean() * (0.5 * x.swept);
                self.outcome(None)
            }
            _ => self.outcome(None),
        }
    }

    fn outcome(self, chord: Option<Chord>) -> Outcome {
        Outcome { value: self.value, variance: self.variance, chord, wants_centre: false }
    }

    fn alike(&self, x: &Arc, y: &Arc) -> bool {
        x.key == y.key || rms(x.mean() - y.mean()) <= self.merge
    }

    /// Takes arc `i` out and joins its neighbours.
    fn cut_off(&mut self, arcs: &mut Vec<Arc>, i: usize) {
        let n = arcs.len();
        let area = self.cell.edge() * self.cell.edge();
        let (before, after) = ((i + n - 1) % n, (i + 1) % n);
        let x = arcs[i].clone();
        let bulge = bulge(self.store, self.cell, &x);
        let cut = x.area(x.start) + bulge.area;
        let contrast = rms(x.mean() - (arcs[before].mean() + arcs[after].mean()) * 0.5);
        // Which of two opposite areas is the bridge?
        let ambiguous = n == 4 && self.alike(&arcs[(i + 2) % n], &x) && !bulge.known;
        let e = contrast * if ambiguous { 0.2 * area } else { bulge.sigma * 2.0 };
        self.variance += e * e + x.doubt(cut);
        self.value += x.mean() * cut;
        let y = arcs[after].clone();
        let joint = &mut arcs[before];
        if joint.signature != y.signature {
            joint.mixed = true;
        }
        joint.swept += cross(x.start, x.end) - 2.0 * bulge.area + y.swept;
        joint.end = y.end;
        joint.tags[1] = y.tags[1];
        joint.sum += y.sum;
        joint.count += y.count;
        joint.low = joint.low.min(y.low);
        joint.high = joint.high.max(y.high);
        arcs.remove(after);
        arcs.remove(if after < i { i - 1 } else { i });
    }

    fn halves(mut self, x: &Arc, y: &Arc, single: bool) -> Outcome {
        let bulge: Bulge = bulge(self.store, self.cell, x);
        let (ax, ay) = (x.area(x.start) + bulge.area, y.area(y.start) - bulge.area);
        let (mx, my) = (x.mean(), y.mean());
        self.variance += x.doubt(ax) + y.doubt(ay);
        let rest = self.variance;
        let e = rms(mx - my) * bulge.sigma;
        self.variance += e * e;
        self.value += mx * ax + my * ay;
        let same_side = x.start.x == x.end.x || x.start.y == x.end.y;
        let chord = (single && !same_side && !bulge.known).then_some(Chord {
            ends: [x.start, x.end],
            keys: [x.key, y.key],
            values: [mx, my],
            rest,
        });
        self.outcome(chord)
    }

    /// Three or more areas that meet somewhere inside.
    fn junction(mut self, arcs: &[Arc]) -> Outcome {
        let n = arcs.len() as f64;
        let (sx, sy) = arcs.iter().fold((0.0, 0.0), |s, x| (s.0 + x.start.x, s.1 + x.start.y));
        let mut meet = Spot { x: sx / n, y: sy / n };
        let mut factor = JUNCTION;
        for x in arcs {
            if let [Some(s), Some(e)] = x.tags
                && let Some(v) = corner_in(self.store, self.cell, s, e, 0.0)
            {
                meet = v;
                factor = 0.2 * JUNCTION;
                break;
            }
        }
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for x in arcs {
            let (area, mean) = (x.area(meet), x.mean());
            low = low.min(mean);
            high = high.max(mean);
            self.value += mean * area;
            self.variance += x.doubt(area);
        }
        let e = factor * rms(high - low) * self.cell.edge() * self.cell.edge();
        self.variance += e * e;
        self.outcome(None)
    }
}

/// The corner between two sides of one triangle's outline, if it is seen in the cell, or by
/// `margin` outside.
pub(crate) fn corner_in(store: &Store<'_>, cell: &Cell, s: Crossing, e: Crossing, margin: f64) -> Option<Spot> {
    if s.object != e.object || s.curve == e.curve {
        return None;
    }
    let corner = outline::corner(store.tracer.prepared(), s.object, (s.curve, e.curve))?;
    let (x, y) = store.project(corner)?;
    let v = cell.spot(x, y);
    let inside = |c: f64| c >= -margin && c <= cell.edge() + margin;
    (inside(v.x) && inside(v.y)).then_some(v)
}

/// A cell whose boundary shows one thing.
fn even(cell: &Cell, store: &Store<'_>, key: u64) -> Outcome {
    let area = cell.edge() * cell.edge();
    let v = cell.corners.map(|s| store.value(s, cell.part));
    let mean = (v[0] + v[1] + v[2] + v[3]) * 0.25;
    let range = rms(v[0].max(v[1]).max(v[2]).max(v[3]) - v[0].min(v[1]).min(v[2]).min(v[3]));
    let mixed =
        cell.corners.iter().any(|&s| store.signature(s, cell.part) != store.signature(cell.corners[0], cell.part));
    let (value, e) = if cell.centre == NONE {
        (mean, if mixed { MIXED } else { SMOOTH } * range)
    } else {
        let m = store.value(cell.centre, cell.part);
        if store.key(cell.centre, cell.part) == key {
            ((mean + m * 2.0) / 3.0, 0.33 * rms(m - mean) + 0.01 * range)
        } else {
            ((mean + m) * 0.5, INNER * rms(m - mean))
        }
    };
    let e = e * area;
    Outcome { value: value * area, variance: e * e, chord: None, wants_centre: cell.centre == NONE && !mixed }
}

/// A cell crossed by faint edges only: its boundary's mean.
fn faint(cell: &Cell, stops: &[Stop], values: &[DVec3], store: &Store<'_>) -> Outcome {
    let area = cell.edge() * cell.edge();
    let mut sum = DVec3::ZERO;
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (i, p) in stops.iter().enumerate() {
        let next = (i + 1) % stops.len();
        let q = &stops[next];
        let width = f64::from((q.x - p.x).abs() + (q.y - p.y).abs()) / f64::from(UNIT);
        sum += (values[i] + values[next]) * (0.5 * width);
        low = low.min(values[i]);
        high = high.max(values[i]);
    }
    let mut value = sum / (4.0 * cell.edge());
    let mut e = FAINT * rms(high - low);
    if cell.centre != NONE {
        let m = store.value(cell.centre, cell.part);
        e = 0.15 * rms(m - value) + 0.3 * e;
        value = (value + m) * 0.5;
    }
    let e = e * area;
    Outcome { value: value * area, variance: e * e, chord: None, wants_centre: cell.centre == NONE }
}
