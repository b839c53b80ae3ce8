//! How far edges leave the chords between their crossings.

use glam::DVec3;

use super::cell::{Arc, Cell, Chord, Outcome, Spot, corner_in, cross, distance};
use super::outline;
use super::store::{Store, UNIT, rms};

/// Standard deviation of the area between an edge of unknown shape and its chord, for a chord of
/// one pixel in a cell of one pixel; both enter with their squares' product.
const SHAPE: f64 = 0.045;
/// The same for both ends on one side of a cell: the tip between them may be long.
const TIP: f64 = 0.35;
/// Steps that narrow an edge's place on the chord's perpendicular, at most.
const STEPS: u32 = 12;

/// How the edge between two crossings leaves their chord.
pub(crate) struct Bulge {
    /// Area between the chord from `end` to `start` and the edge.
    pub(crate) area: f64,
    /// Standard deviation of that area.
    pub(crate) sigma: f64,
    pub(crate) known: bool,
}

fn triangle(a: Spot, b: Spot, c: Spot) -> f64 {
    0.5 * (cross(a, b) + cross(b, c) + cross(c, a))
}

/// The outline's point on the perpendicular of the middle of the chord from `p` to `q`.
fn middle(store: &Store<'_>, cell: &Cell, object: u32, p: Spot, q: Spot) -> Option<Spot> {
    let unit = f64::from(UNIT);
    let m = Spot { x: 0.5 * (p.x + q.x), y: 0.5 * (p.y + q.y) };
    let length = distance(p, q);
    if !(length > 0.0) {
        return None;
    }
    let n = Spot { x: -(q.y - p.y) / length, y: (q.x - p.x) / length };
    let line = store.line(f64::from(cell.x) + m.x * unit, f64::from(cell.y) + m.y * unit, (n.x * unit, n.y * unit));
    let mut found = Vec::new();
    let reach = 2.0 * cell.edge();
    outline::crossings(store.tracer.prepared(), object, &line, (-reach, reach), &mut found);
    let near = found.iter().map(|c| c.t).min_by(|a, b| a.abs().total_cmp(&b.abs()))?;
    (near.abs() < 0.75 * length.max(0.05)).then_some(Spot { x: m.x + n.x * near, y: m.y + n.y * near })
}

/// The bulge of the edge that `arc` ends at.
pub(crate) fn bulge(store: &Store<'_>, cell: &Cell, arc: &Arc) -> Bulge {
    let a = cell.edge();
    let (p, q) = (arc.end, arc.start);
    let length = distance(p, q);
    if let [Some(s), Some(e)] = arc.tags
        && s.object == e.object
    {
        if outline::is_straight(store.tracer.prepared(), s.object) {
            if s.curve == e.curve {
                return Bulge { area: 0.0, sigma: 0.0, known: true };
            }
            if let Some(v) = corner_in(store, cell, s, e, 0.02 * a) {
                return Bulge { area: triangle(p, v, q), sigma: 0.0, known: true };
            }
        } else if let Some(m) = middle(store, cell, s.object, p, q) {
            let mut area = triangle(p, m, q);
            for (a, b) in [(p, m), (m, q)] {
                if let Some(m) = middle(store, cell, s.object, a, b) {
                    // A parabola's segment.
                    area += 4.0 / 3.0 * triangle(a, m, b);
                }
            }
            return Bulge { area, sigma: 0.01 * area.abs(), known: true };
        }
    }
    let same_side = p.x == q.x || p.y == q.y;
    Bulge { area: 0.0, sigma: if same_side { TIP * length * a } else { SHAPE * length * a * a }, known: false }
}

/// Looks for the edge on the perpendicular of its chord's middle.
pub(crate) struct Check {
    /// Place of the cell among those at hand.
    pub(crate) cell: usize,
    chord: Chord,
    m: Spot,
    /// Unit normal towards the first side.
    n: Spot,
    length: f64,
    /// The farthest that shows the second side, and the nearest that shows the first.
    low: Option<f64>,
    high: Option<f64>,
    asked: Vec<(f64, u32)>,
    steps: u32,
}

/// How a check stands.
pub(crate) enum Verdict {
    Open,
    /// By how much the value changes, and the variance of the whole.
    Found(DVec3, f64),
    /// The cell is not divided by one edge.
    Failed,
}

/// Standard deviation of a failed cell's value, as a share of its contrast.
const FAILED: f64 = 0.15;

impl Check {
    /// A check of `cell`, if its shape's doubt is worth it.
    pub(crate) fn new(cell: usize, outcome: &Outcome, tolerance: f64) -> Option<Self> {
        let chord = outcome.chord.clone()?;
        if !(outcome.variance - chord.rest > 2.0 * tolerance * tolerance) {
            return None;
        }
        let [p, q] = chord.ends;
        let length = distance(p, q);
        let n = Spot { x: -(p.y - q.y) / length, y: (p.x - q.x) / length };
        let m = Spot { x: 0.5 * (p.x + q.x), y: 0.5 * (p.y + q.y) };
        Some(Self { cell, chord, m, n, length, low: None, high: None, asked: Vec::new(), steps: 0 })
    }

    fn contrast(&self) -> f64 {
        rms(self.chord.values[0] - self.chord.values[1])
    }

    /// The variance of a cell of edge `a` that failed.
    pub(crate) fn variance_if_failed(&self, a: f64) -> f64 {
        let e = FAILED * self.contrast() * a * a;
        self.chord.rest + e * e
    }

    /// Takes in what was asked for, and asks for more.
    pub(crate) fn step(&mut self, cell: &Cell, store: &mut Store<'_>, tolerance: f64) -> Verdict {
        for (h, sample) in std::mem::take(&mut self.asked) {
            let key = store.key(sample, cell.part);
            if key == self.chord.keys[0] {
                self.high = Some(self.high.map_or(h, |x| x.min(h)));
            } else if key == self.chord.keys[1] {
                self.low = Some(self.low.map_or(h, |x| x.max(h)));
            } else {
                return Verdict::Failed;
            }
        }
        let (a, unit) = (cell.edge(), f64::from(UNIT));
        // A parabola's segment has two thirds of the rectangle about it.
        let area = self.contrast() * self.length * 2.0 / 3.0;
        let reach = 0.45 * a;
        self.steps += 1;
        let going = match (self.low, self.high) {
            (Some(low), Some(high)) if low >= high => false,
            (Some(low), Some(high)) => {
                let e = area * (high - low) * 0.289;
                if !(e * e > tolerance * tolerance && (high - low) * unit > 2.0 && self.steps < STEPS) {
                    let s = 0.5 * (low + high);
                    let shift = 2.0 / 3.0 * s * self.length;
                    let shape = 0.15 * s.abs() * self.length * self.contrast();
                    let variance = self.chord.rest + e * e + shape * shape;
                    return Verdict::Found((self.chord.values[1] - self.chord.values[0]) * shift, variance);
                }
                self.ask(cell, store, 0.5 * (low + high))
            }
            (Some(low), None) => {
                let h = low.abs().max(1.0 / unit) * 4.0;
                low < 0.9 * reach && self.steps < STEPS && self.ask(cell, store, h.min(reach))
            }
            (None, Some(high)) => {
                let h = high.abs().max(1.0 / unit) * 4.0;
                -high < 0.9 * reach && self.steps < STEPS && self.ask(cell, store, -(h.min(reach)))
            }
            (None, None) => {
                let d = (1.7 * tolerance / area).clamp(2.0 / unit, 0.2 * a);
                self.ask(cell, store, d) && self.ask(cell, store, -d)
            }
        };
        if going { Verdict::Open } else { Verdict::Failed }
    }

    /// Asks for the sample at height `h` over the chord, if that is in the cell.
    fn ask(&mut self, cell: &Cell, store: &mut Store<'_>, h: f64) -> bool {
        let unit = f64::from(UNIT);
        let (x, y) = (self.m.x + self.n.x * h, self.m.y + self.n.y * h);
        let (u, v) = ((x * unit).round() as i32, (y * unit).round() as i32);
        if u < 0 || v < 0 || u > cell.size || v > cell.size {
            return false;
        }
        let on_lattice = (f64::from(u) / unit - self.m.x) * self.n.x + (f64::from(v) / unit - self.m.y) * self.n.y;
        let sample = store.ask(cell.x + u, cell.y + v, cell.part.side());
        self.asked.push((on_lattice, sample));
        true
    }
}
