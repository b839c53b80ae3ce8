//! Adaptive sampling.

use glam::DVec3;
use rayon::prelude::*;

use crate::film::{ErrorEstimate, Region, Tile};
use crate::sampling::outline::{self, Crossing};
use crate::sampling::small;
use crate::trace::{PlanePoint, RayCounts, Sample, Tracer};

/// Cells of the lattice along half a pixel's edge times two.
pub(crate) const GRID: u32 = 512;
const UNIT: i32 = 2 * GRID as i32;

const BLOCK: u32 = 32;

/// sigma of area of a curved edge's chord of one pixel length
const SHAPE: f64 = 0.03;
const SMOOTH: f64 = 0.05;
const DOUBT: f64 = 0.144;
const CONFIRMED: f64 = 0.04;
const JUNCTION: f64 = 0.15;
const MERGE: f64 = 2.0;
const FAINT: f64 = 0.12;
const HIDDEN: f64 = 0.3;
const HIDDEN_CENTRE: f64 = 0.12;
const MAX_LEVEL: u32 = 6;

struct Store<'a> {
    tracer: &'a Tracer,
    origin: (i32, i32),
    samples: Vec<Sample>,
    pending: Vec<PlanePoint>,
    counts: RayCounts,
}

impl Store<'_> {
    fn request(&mut self, u: i32, v: i32) -> u32 {
        let at = self.samples.len() + self.pending.len();
        self.pending.push(PlanePoint { x: self.origin.0 + u, y: self.origin.1 - v });
        at as u32
    }
    fn flush(&mut self) {
        if self.pending.is_empty() {
            return;
        }
        let (s, c) = self.tracer.samples(&self.pending);
        self.samples.extend(s);
        self.counts += c;
        self.pending.clear();
    }
    fn object(&self, s: u32) -> u32 {
        self.samples[s as usize].object
    }
    fn line(&self, u: f64, v: f64, step: (f64, f64)) -> outline::Line {
        self.tracer.plane_line(f64::from(self.origin.0) + u, f64::from(self.origin.1) - v, (step.0, -step.1))
    }
    fn sig(&self, s: u32) -> u64 {
        self.samples[s as usize].signature
    }
    fn rgb(&self, s: u32) -> DVec3 {
        self.samples[s as usize].radiance
    }
}

fn rms(d: DVec3) -> f64 {
    (d.dot(d) / 3.0).sqrt()
}

/// One square cell.
#[derive(Clone, Debug)]
struct Cell {
    pixel: u32,
    x: i32,
    y: i32,
    size: i32,
    /// tl tr br bl
    corners: [u32; 4],
    /// top right bottom left: index of chain
    sides: [u32; 4],
    centre: u32,
    /// Largest contrast of an edge nearby
    nearby: f64,
    /// Objects known to be seen inside.
    features: Vec<Feature>,
}

/// A small object seen in a cell.
#[derive(Clone, Copy, Debug)]
struct Feature {
    object: u32,
    sample: u32,
    /// Its outline's overlap with the cell, in pixels.
    area: f64,
}

const NONE: u32 = u32::MAX;

#[derive(Clone, Copy, Debug)]
struct P {
    x: f64,
    y: f64,
}

fn cross(a: P, b: P) -> f64 {
    a.x * b.y - a.y * b.x
}

#[derive(Clone, Debug)]
struct Arc {
    sig: u64,
    sum: DVec3,
    n: f64,
    lo: DVec3,
    hi: DVec3,
    /// twice signed area along its path so far
    swept: f64,
    start: P,
    end: P,
    tags: [Option<Crossing>; 2],
}

struct Outcome {
    value: DVec3,
    var: f64,
    /// chord that could be verified
    chord: Option<Chord>,
    smooth: bool,
    class: u8,
}

#[derive(Clone, Debug)]
struct Chord {
    p: P,
    q: P,
    sig: [u64; 2],
    contrast: f64,
    colors: [DVec3; 2],
    /// variance without the shape
    rest: f64,
}

/// A sample on a side, and where between it and the next the outline runs, if known.
#[derive(Clone, Copy, Debug)]
struct Entry {
    t: i32,
    s: u32,
    next: Option<Crossing>,
    doubt: f64,
}

impl Entry {
    fn new(t: i32, s: u32) -> Self {
        Self { t, s, next: None, doubt: DOUBT }
    }
}

type Chain = Vec<Entry>;

fn chain_range(chain: &Chain, lo: i32, hi: i32) -> (usize, usize) {
    (chain.partition_point(|e| e.t < lo), chain.partition_point(|e| e.t <= hi))
}

fn insert(chain: &mut Chain, t: i32, s: u32) {
    let at = chain.partition_point(|e| e.t < t);
    if at > 0 {
        chain[at - 1].next = None;
        chain[at - 1].doubt = DOUBT;
    }
    chain.insert(at, Entry::new(t, s));
}

/// A point of a cell's boundary; `next` as in [`Entry`], towards the next point clockwise.
#[derive(Clone, Copy, Debug)]
struct Stop {
    x: i32,
    y: i32,
    s: u32,
    next: Option<Crossing>,
    doubt: f64,
}

impl Cell {
    /// points around the loop, clockwise in y-down coordinates
    fn boundary(&self, chains: &[Chain], out: &mut Vec<Stop>) {
        out.clear();
        let (x0, y0, x1, y1) = (self.x, self.y, self.x + self.size, self.y + self.size);
        let corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)];
        for k in 0..4 {
            let (x, y) = corners[k];
            let chain = &chains[self.sides[k] as usize];
            if chain.is_empty() {
                out.push(Stop { x, y, s: self.corners[k], next: None, doubt: DOUBT });
                continue;
            }
            let t0 = if k % 2 == 0 { x0 } else { y0 };
            let (a, b) = chain_range(chain, t0, t0 + self.size);
            let place = |t: i32| if k % 2 == 0 { (t, y) } else { (x, t) };
            if k < 2 {
                out.extend(chain[a..b - 1].iter().map(|e| {
                    let (x, y) = place(e.t);
                    Stop { x, y, s: e.s, next: e.next, doubt: e.doubt }
                }));
            } else {
                out.extend(chain[a..b].windows(2).rev().map(|e| {
                    let (x, y) = place(e[1].t);
                    Stop { x, y, s: e[1].s, next: e[0].next, doubt: e[0].doubt }
                }));
            }
        }
    }
}

/// How the outline between two crossings leaves their chord.
struct Bulge {
    /// Area between the chord from `end` to `start` and the outline.
    area: f64,
    /// Standard deviation of that area, in shares of contrast.
    sigma: f64,
    known: bool,
}

fn triangle_area(a: P, b: P, c: P) -> f64 {
    0.5 * (cross(a, b) + cross(b, c) + cross(c, a))
}

/// The outline's point on the perpendicular of the middle of the chord from `p` to `q`.
fn outline_middle(store: &Store<'_>, cell: &Cell, object: u32, p: P, q: P) -> Option<P> {
    let unit = f64::from(UNIT);
    let m = P { x: 0.5 * (p.x + q.x), y: 0.5 * (p.y + q.y) };
    let (dx, dy) = (q.x - p.x, q.y - p.y);
    let l = (dx * dx + dy * dy).sqrt();
    if !(l > 0.0) {
        return None;
    }
    let n = P { x: -dy / l, y: dx / l };
    let line = store.line(f64::from(cell.x) + m.x * unit, f64::from(cell.y) + m.y * unit, (n.x * unit, n.y * unit));
    let mut found = Vec::new();
    let reach = 2.0 * f64::from(cell.size) / unit;
    outline::crossings(store.tracer.prepared(), object, &line, (-reach, reach), &mut found);
    let near = found.iter().map(|c| c.t).min_by(|a, b| a.abs().total_cmp(&b.abs()))?;
    (near.abs() < 0.75 * l.max(0.05)).then_some(P { x: m.x + n.x * near, y: m.y + n.y * near })
}

fn bulge(store: &Store<'_>, cell: &Cell, arc: &Arc) -> Bulge {
    let a = f64::from(cell.size) / f64::from(UNIT);
    let (p, q) = (arc.end, arc.start);
    let l = ((p.x - q.x).powi(2) + (p.y - q.y).powi(2)).sqrt();
    if let [Some(s), Some(e)] = arc.tags
        && s.object == e.object
    {
        let prepared = store.tracer.prepared();
        if outline::is_straight(prepared, s.object) {
            if s.curve == e.curve {
                return Bulge { area: 0.0, sigma: 0.0, known: true };
            }
            if let Some((x, y)) =
                outline::corner(prepared, s.object, (s.curve, e.curve)).and_then(|d| store.tracer.project(d))
            {
                let unit = 1.0 / f64::from(UNIT);
                let v = P {
                    x: (x - f64::from(store.origin.0 + cell.x)) * unit,
                    y: (f64::from(store.origin.1 - cell.y) - y) * unit,
                };
                let eps = 0.02 * a;
                if v.x > -eps && v.y > -eps && v.x < a + eps && v.y < a + eps {
                    return Bulge { area: triangle_area(p, v, q), sigma: 0.0, known: true };
                }
            }
        } else if let Some(m) = outline_middle(store, cell, s.object, p, q) {
            let mut area = triangle_area(p, m, q);
            for (a, b) in [(p, m), (m, q)] {
                if let Some(m) = outline_middle(store, cell, s.object, a, b) {
                    area += 4.0 / 3.0 * triangle_area(a, m, b);
                }
            }
            return Bulge { area, sigma: 0.01 * area.abs(), known: true };
        }
    }
    // A tip that enters through one side may be long.
    let same_side = p.x == q.x || p.y == q.y;
    Bulge { area: 0.0, sigma: if same_side { 0.35 * l * a } else { SHAPE * l * a * a }, known: false }
}

fn integrate(cell: &Cell, chains: &[Chain], store: &Store<'_>, pts: &mut Vec<Stop>, tol: f64) -> Outcome {
    cell.boundary(chains, pts);
    let a = f64::from(cell.size) / f64::from(UNIT);
    let area = a * a;
    let merge = MERGE * tol / area;
    let same = |p: u32, q: u32| store.sig(p) == store.sig(q) || rms(store.rgb(p) - store.rgb(q)) <= merge;
    let first = store.sig(pts[0].s);
    if pts.iter().all(|p| store.sig(p.s) == first) && (cell.centre == NONE || store.sig(cell.centre) == first) {
        let c = cell.corners.map(|s| store.rgb(s));
        let mean = (c[0] + c[1] + c[2] + c[3]) * 0.25;
        let lo = c[0].min(c[1]).min(c[2]).min(c[3]);
        let hi = c[0].max(c[1]).max(c[2]).max(c[3]);
        let range = rms(hi - lo);
        let detail = 0.5 * picture_detail(cell, store) * area;
        if cell.centre == NONE {
            let (e, h) = (SMOOTH * range * area, HIDDEN * cell.nearby * area);
            return Outcome {
                value: mean * area,
                var: e * e + h * h + detail * detail,
                chord: None,
                smooth: true,
                class: 1,
            };
        }
        let m = store.rgb(cell.centre);
        let e = (0.33 * rms(m - mean) + 0.01 * range) * area;
        let h = HIDDEN_CENTRE * cell.nearby * area;
        return Outcome {
            value: (mean + m * 2.0) / 3.0 * area,
            var: e * e + h * h + detail * detail,
            chord: None,
            smooth: false,
            class: 2,
        };
    }
    if pts.iter().all(|p| store.sig(p.s) == first) {
        // Centre differs: a feature inside.
        let c = cell.corners.map(|s| store.rgb(s));
        let mean = (c[0] + c[1] + c[2] + c[3]) * 0.25;
        let m = store.rgb(cell.centre);
        let e = 0.3 * rms(m - mean) * area;
        return Outcome { value: (mean + m) / 2.0 * area, var: e * e, chord: None, smooth: false, class: 3 };
    }
    let unit = 1.0 / f64::from(UNIT);
    let at = |p: &Stop| P { x: f64::from(p.x - cell.x) * unit, y: f64::from(p.y - cell.y) * unit };
    let n = pts.len();
    let Some(start) = (0..n).find(|&i| !same(pts[i].s, pts[(i + n - 1) % n].s)) else { return plain(cell, pts, store) };
    let mut arcs: Vec<Arc> = Vec::new();
    let mut var = 0.0;
    for k in 0..n {
        let i = (start + k) % n;
        let (stop, before) = (&pts[i], &pts[(i + n - 1) % n]);
        let (sig, rgb) = (store.sig(stop.s), store.rgb(stop.s));
        let here = at(stop);
        if k == 0 || !same(before.s, stop.s) {
            let there = at(before);
            let w = (here.x - there.x).abs() + (here.y - there.y).abs();
            let e = before.doubt * rms(rgb - store.rgb(before.s)) * w * a;
            var += e * e;
            let mid = match before.next {
                None => P { x: (here.x + there.x) * 0.5, y: (here.y + there.y) * 0.5 },
                Some(c) if here.y == there.y => P { x: (c.t - f64::from(cell.x)) * unit, y: here.y },
                Some(c) => P { x: here.x, y: (c.t - f64::from(cell.y)) * unit },
            };
            if let Some(last) = arcs.last_mut() {
                last.swept += cross(last.end, mid);
                last.end = mid;
                last.tags[1] = before.next;
            }
            arcs.push(Arc {
                sig,
                sum: DVec3::ZERO,
                n: 0.0,
                lo: rgb,
                hi: rgb,
                swept: 0.0,
                start: mid,
                end: mid,
                tags: [before.next, None],
            });
        }
        let Some(arc) = arcs.last_mut() else { continue };
        arc.swept += cross(arc.end, here);
        arc.end = here;
        arc.sum += rgb;
        arc.n += 1.0;
        arc.lo = arc.lo.min(rgb);
        arc.hi = arc.hi.max(rgb);
    }
    if let [head, .., tail] = &mut arcs[..] {
        tail.swept += cross(tail.end, head.start);
        tail.end = head.start;
        tail.tags[1] = head.tags[0];
    }
    if arcs.len() == 1 {
        // A jump that fades out along the boundary.
        let mut o = plain(cell, pts, store);
        let e = JUNCTION * rms(arcs[0].hi - arcs[0].lo) * area;
        o.var = e * e;
        o.smooth = false;
        return o;
    }
    let two = arcs.len() == 2;
    let mut value = DVec3::ZERO;
    let mean = |a: &Arc| a.sum / a.n;
    let spread = |a: &Arc| rms(a.hi - a.lo);
    let alike = |x: &Arc, y: &Arc| x.sig == y.sig || rms(mean(x) - mean(y)) <= merge;
    let span = |p: P, q: P| ((p.x - q.x).powi(2) + (p.y - q.y).powi(2)).sqrt();
    // cut off arcs between two of the same signature
    while arcs.len() > 2 {
        let m = arcs.len();
        let mut best: Option<(f64, usize)> = None;
        for i in 0..m {
            if alike(&arcs[(i + m - 1) % m], &arcs[(i + 1) % m]) {
                let l = span(arcs[i].start, arcs[i].end);
                if best.is_none_or(|b| l < b.0) {
                    best = Some((l, i));
                }
            }
        }
        let Some((_, i)) = best else { break };
        let (before, after) = ((i + m - 1) % m, (i + 1) % m);
        let x = arcs[i].clone();
        let bulge = bulge(store, cell, &x);
        let cut = 0.5 * (x.swept + cross(x.end, x.start)) + bulge.area;
        let c = rms(mean(&x) - (mean(&arcs[before]) + mean(&arcs[after])) * 0.5);
        let ambiguous = m == 4 && alike(&arcs[(i + 2) % m], &x) && !bulge.known;
        let e = c * if ambiguous { 0.2 * area } else { bulge.sigma * 2.0 };
        var += e * e;
        let e = SMOOTH * spread(&x) * cut;
        var += e * e;
        value += mean(&x) * cut;
        let y = arcs[after].clone();
        let joint = &mut arcs[before];
        joint.swept += cross(x.start, x.end) - 2.0 * bulge.area + y.swept;
        joint.end = y.end;
        joint.tags[1] = y.tags[1];
        joint.sum += y.sum;
        joint.n += y.n;
        joint.lo = joint.lo.min(y.lo);
        joint.hi = joint.hi.max(y.hi);
        arcs.remove(after);
        arcs.remove(if after < i { i - 1 } else { i });
    }
    if arcs.len() == 2 {
        let (x, y) = (&arcs[0], &arcs[1]);
        let bulge = bulge(store, cell, x);
        let ax = 0.5 * (x.swept + cross(x.end, x.start)) + bulge.area;
        let ay = 0.5 * (y.swept + cross(y.end, y.start)) - bulge.area;
        let (mx, my) = (mean(x), mean(y));
        let c = rms(mx - my);
        for (arc, area) in [(x, ax), (y, ay)] {
            let e = SMOOTH * spread(arc) * area;
            var += e * e;
        }
        let hidden = HIDDEN_CENTRE * cell.nearby * area;
        var += hidden * hidden;
        let rest = var;
        let same_side = (x.start.x == x.end.x) || (x.start.y == x.end.y);
        let e = c * bulge.sigma;
        var += e * e;
        value += mx * ax + my * ay;
        let chord = (two && !same_side && !bulge.known).then_some(Chord {
            p: x.start,
            q: x.end,
            sig: [x.sig, y.sig],
            contrast: c,
            colors: [mx, my],
            rest,
        });
        return Outcome { value, var, chord, smooth: false, class: 4 };
    }
    if arcs.len() == 1 {
        value += mean(&arcs[0]) * (0.5 * arcs[0].swept);
        return Outcome { value, var, chord: None, smooth: false, class: 5 };
    }
    let m = arcs.len() as f64;
    let (sx, sy) = arcs.iter().fold((0.0, 0.0), |s, x| (s.0 + x.start.x, s.1 + x.start.y));
    let mut j = P { x: sx / m, y: sy / m };
    let mut factor = JUNCTION;
    for x in &arcs {
        if let [Some(s), Some(e)] = x.tags
            && s.object == e.object
            && s.curve != e.curve
            && let Some((px, py)) = outline::corner(store.tracer.prepared(), s.object, (s.curve, e.curve))
                .and_then(|d| store.tracer.project(d))
        {
            let v = P {
                x: (px - f64::from(store.origin.0 + cell.x)) * unit,
                y: (f64::from(store.origin.1 - cell.y) - py) * unit,
            };
            if v.x >= 0.0 && v.y >= 0.0 && v.x <= a && v.y <= a {
                j = v;
                factor = 0.2 * JUNCTION;
                break;
            }
        }
    }
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for x in &arcs {
        let ax = 0.5 * (x.swept + cross(x.end, j) + cross(j, x.start));
        let mx = mean(x);
        lo = lo.min(mx);
        hi = hi.max(mx);
        value += mx * ax;
        let e = SMOOTH * spread(x) * ax;
        var += e * e;
    }
    let e = factor * rms(hi - lo) * area;
    var += e * e;
    Outcome { value, var, chord: None, smooth: false, class: 6 }
}

/// How much a picture varies between the corners of a cell that all see it.
fn picture_detail(cell: &Cell, store: &Store<'_>) -> f64 {
    let prepared = store.tracer.prepared();
    let object = store.object(cell.corners[0]);
    if prepared.scene.pictures().is_empty() || object == Sample::NOTHING {
        return 0.0;
    }
    let at = |x: i32, y: i32| PlanePoint { x: store.origin.0 + x, y: store.origin.1 - y };
    let (x, y, s) = (cell.x, cell.y, cell.size);
    let spread = store.tracer.picture_spread(object, [at(x, y), at(x + s, y), at(x + s, y + s), at(x, y + s)]);
    spread.unwrap_or(0.0) * prepared.scene.lights().len().min(2) as f64
}

/// A cell's share of its pixel: [`integrate`], and what is known to lie inside.
fn evaluate(cell: &Cell, chains: &[Chain], store: &Store<'_>, pts: &mut Vec<Stop>, tol: f64) -> Outcome {
    let mut o = integrate(cell, chains, store, pts, tol);
    if cell.features.is_empty() {
        return o;
    }
    let a = f64::from(cell.size) / f64::from(UNIT);
    let hidden = cell.features.iter().filter(|f| pts.iter().all(|p| store.object(p.s) != f.object));
    let total: f64 = hidden.clone().map(|f| f.area).sum();
    let share = (0.9 * a * a / total).min(1.0);
    let around = o.value / (a * a);
    for f in hidden {
        let (area, rgb) = (f.area * share, store.rgb(f.sample));
        o.value += (rgb - around) * area;
        let e = (0.2 * rms(rgb - around) + 0.15 * rms(rgb)) * area;
        o.var += e * e;
        o.chord = None;
    }
    o
}

/// A cell crossed by faint edges only: its boundary's mean.
fn plain(cell: &Cell, pts: &[Stop], store: &Store<'_>) -> Outcome {
    let unit = 1.0 / f64::from(UNIT);
    let a = f64::from(cell.size) * unit;
    let mut sum = DVec3::ZERO;
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (i, p) in pts.iter().enumerate() {
        let q = &pts[(i + 1) % pts.len()];
        let w = f64::from((q.x - p.x).abs() + (q.y - p.y).abs()) * unit;
        let (f, g) = (store.rgb(p.s), store.rgb(q.s));
        sum += (f + g) * (0.5 * w);
        lo = lo.min(f);
        hi = hi.max(f);
    }
    let mut value = sum / (4.0 * a);
    let mut e = FAINT * rms(hi - lo) * a * a;
    if cell.centre != NONE {
        let m = store.rgb(cell.centre);
        e = (0.15 * rms(m - value) + 0.3 * e / (a * a)) * a * a;
        value = (value + m) * 0.5;
    }
    let h = HIDDEN * cell.nearby * a * a;
    Outcome { value: value * a * a, var: e * e + h * h, chord: None, smooth: cell.centre == NONE, class: 7 }
}

struct Verify {
    cell: usize,
    chord: Chord,
    /// middle of the chord in block units, unit normal towards the first side
    m: P,
    n: P,
    length: f64,
    lo: Option<f64>,
    hi: Option<f64>,
    asked: Vec<(f64, u32)>,
    steps: u32,
    extra: [(DVec3, f64); 2],
}

enum Verified {
    Going,
    Done(DVec3, f64),
    Failed,
}

fn step(v: &mut Verify, cell: &Cell, store: &mut Store<'_>, tol: f64) -> Verified {
    // judge what came back
    for &(h, s) in &v.asked {
        let sig = store.sig(s);
        let off = v.chord.colors.map(|c| rms(store.rgb(s) - c));
        let near = 0.3 * v.chord.contrast;
        if sig == v.chord.sig[0] || (sig != v.chord.sig[1] && off[0] < near) {
            v.hi = Some(v.hi.map_or(h, |x| x.min(h)));
            v.extra[0].0 += store.rgb(s);
            v.extra[0].1 += 1.0;
        } else if sig == v.chord.sig[1] || off[1] < near {
            v.lo = Some(v.lo.map_or(h, |x| x.max(h)));
            v.extra[1].0 += store.rgb(s);
            v.extra[1].1 += 1.0;
        } else {
            return Verified::Failed;
        }
    }
    v.asked.clear();
    let a = f64::from(cell.size) / f64::from(UNIT);
    let k = v.chord.contrast * v.length * 2.0 / 3.0;
    let unit = f64::from(UNIT);
    let reach = 0.45 * a;
    let mut ask = |v: &mut Verify, h: f64| -> bool {
        let (x, y) = (v.m.x + v.n.x * h, v.m.y + v.n.y * h);
        let (u, w) = ((x * unit).round() as i32, (y * unit).round() as i32);
        if u < 0 || w < 0 || u > cell.size || w > cell.size {
            return false;
        }
        let real = (f64::from(u) / unit - v.m.x) * v.n.x + (f64::from(w) / unit - v.m.y) * v.n.y;
        let s = store.request(cell.x + u, cell.y + w);
        v.asked.push((real, s));
        true
    };
    match (v.lo, v.hi) {
        (Some(lo), Some(hi)) if lo >= hi => Verified::Failed,
        (Some(lo), Some(hi)) => {
            let e = k * (hi - lo) * 0.289;
            if e * e > 1.0 * tol * tol && (hi - lo) * unit > 2.0 && v.steps < 12 {
                v.steps += 1;
                return if ask(v, 0.5 * (lo + hi)) { Verified::Going } else { Verified::Failed };
            }
            let s = 0.5 * (lo + hi);
            // The first side's region shrinks by the bulge towards it.
            let shift = 2.0 / 3.0 * s * v.length;
            let shape = 0.15 * s.abs() * v.length * v.chord.contrast;
            let var = v.chord.rest + e * e + shape * shape;
            Verified::Done((v.chord.colors[1] - v.chord.colors[0]) * shift, var)
        }
        (Some(lo), None) => {
            let h = lo.abs().max(1.0 / unit) * 4.0;
            v.steps += 1;
            if lo >= 0.9 * reach || v.steps > 6 || !ask(v, h.min(reach)) { Verified::Failed } else { Verified::Going }
        }
        (None, Some(hi)) => {
            let h = hi.abs().max(1.0 / unit) * 4.0;
            v.steps += 1;
            if -hi >= 0.9 * reach || v.steps > 6 || !ask(v, -(h.min(reach))) {
                Verified::Failed
            } else {
                Verified::Going
            }
        }
        (None, None) => {
            let d = (1.7 * tol / k).clamp(2.0 / unit, 0.2 * a);
            v.steps += 1;
            if ask(v, d) && ask(v, -d) { Verified::Going } else { Verified::Failed }
        }
    }
}

/// What a region's pixel corners show, with one more pixel all around.
struct Corners {
    region: Region,
    samples: Vec<Sample>,
    counts: RayCounts,
}

impl Corners {
    fn width(&self) -> usize {
        self.region.width() as usize + 3
    }

    fn new(tracer: &Tracer, region: Region) -> Self {
        let (x, y) = plane_origin(tracer, region);
        let (w, h) = (region.width() as i32 + 3, region.height() as i32 + 3);
        let edge = 16;
        let mut parts = Vec::new();
        for j in (0..h).step_by(edge) {
            for i in (0..w).step_by(edge) {
                parts.push((i, j, w.min(i + edge as i32), h.min(j + edge as i32)));
            }
        }
        let done: Vec<_> = parts
            .into_par_iter()
            .map(|(i0, j0, i1, j1)| {
                let points: Vec<PlanePoint> = (j0..j1)
                    .flat_map(|j| (i0..i1).map(move |i| PlanePoint { x: x + UNIT * (i - 1), y: y - UNIT * (j - 1) }))
                    .collect();
                ((i0, j0, i1), tracer.samples(&points))
            })
            .collect();
        let mut samples = vec![done[0].1.0[0]; (w * h) as usize];
        let mut counts = RayCounts::default();
        for ((i0, j0, i1), (part, c)) in done {
            counts += c;
            for (row, line) in part.chunks_exact((i1 - i0) as usize).enumerate() {
                let start = (j0 as usize + row) * w as usize + i0 as usize;
                samples[start..start + line.len()].copy_from_slice(line);
            }
        }
        Self { region, samples, counts }
    }
}

/// The plane point of a region's upper left corner.
fn plane_origin(tracer: &Tracer, region: Region) -> (i32, i32) {
    let view = &tracer.settings().view;
    let g = GRID as i32;
    (UNIT * region.x0 as i32 - g * view.width() as i32, g * view.height() as i32 - UNIT * region.y0 as i32)
}

fn block(tracer: &Tracer, corners: &Corners, region: Region, tol: f64) -> (Vec<(DVec3, f64, u8)>, RayCounts) {
    let (w, h) = (region.width() as usize, region.height() as usize);
    let mut samples = Vec::with_capacity(2 * (w + 3) * (h + 3));
    for j in 0..h + 3 {
        let start =
            ((region.y0 - corners.region.y0) as usize + j) * corners.width() + (region.x0 - corners.region.x0) as usize;
        samples.extend_from_slice(&corners.samples[start..start + w + 3]);
    }
    let origin = plane_origin(tracer, region);
    let mut store = Store { tracer, origin, samples, pending: Vec::new(), counts: RayCounts::default() };
    let corner = |i: usize, j: usize| ((j + 1) * (w + 3) + i + 1) as u32;
    // Squared contrast of the edges between each corner and its neighbours right and below.
    let mut edges = vec![[0.0f64; 2]; (w + 3) * (h + 3)];
    for j in 0..h + 3 {
        for i in 0..w + 3 {
            let at = j * (w + 3) + i;
            let next = [(i + 1 < w + 3).then_some(at + 1), (j + 1 < h + 3).then_some(at + w + 3)];
            for (to, next) in edges[at].iter_mut().zip(next) {
                let Some(next) = next else { continue };
                let (a, b) = (&store.samples[at], &store.samples[next]);
                if a.signature != b.signature {
                    let d = a.radiance - b.radiance;
                    *to = d.dot(d) / 3.0;
                }
            }
        }
    }
    // What may hide in a pixel whose surroundings have edges: by their contrast and how dense they are.
    let nearby = |i: usize, j: usize| {
        let (mut sum, mut count) = (0.0, 0.0);
        for y in j..j + 4 {
            for x in i..i + 4 {
                for (k, limit) in [(0, x < i + 3), (1, y < j + 3)] {
                    let e = edges[y * (w + 3) + x][k];
                    if limit && e > tol * tol {
                        sum += e;
                        count += 1.0;
                    }
                }
            }
        }
        if count == 0.0 {
            return 0.0;
        }
        let density: f64 = count / 24.0;
        (sum / count).sqrt() * density * density * density
    };
    // horizontal sides first, then vertical
    let hside = |i: usize, j: usize| (j * w + i) as u32;
    let nh = w * (h + 1);
    let vside = |i: usize, j: usize| (nh + j * (w + 1) + i) as u32;
    let mut chains: Vec<Chain> = vec![Vec::new(); nh + h * (w + 1)];
    let mut cells: Vec<Cell> = Vec::with_capacity(w * h);
    for j in 0..h {
        for i in 0..w {
            cells.push(Cell {
                pixel: (j * w + i) as u32,
                x: i as i32 * UNIT,
                y: j as i32 * UNIT,
                size: UNIT,
                corners: [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)],
                sides: [hside(i, j), vside(i + 1, j), hside(i, j + 1), vside(i, j)],
                centre: NONE,
                nearby: nearby(i, j),
                features: Vec::new(),
            });
        }
    }
    features(&mut cells, &mut store, region, tol);
    let mut result = vec![(DVec3::ZERO, 0.0, 0u8); w * h];
    let mut pts = Vec::new();
    let mut level = 0;
    while !cells.is_empty() {
        bisect(&cells, &mut chains, &mut store, tol);
        // evaluate, ask centres, verify
        let mut outcomes: Vec<Outcome> = cells.iter().map(|c| evaluate(c, &chains, &store, &mut pts, tol)).collect();
        let mut checks: Vec<Verify> = Vec::new();
        let mut centred = Vec::new();
        for (i, o) in outcomes.iter().enumerate() {
            if o.smooth {
                if o.var > tol * tol {
                    let c = &mut cells[i];
                    c.centre = store.request(c.x + c.size / 2, c.y + c.size / 2);
                    centred.push(i);
                }
            } else if let Some(chord) = &o.chord {
                let shape = o.var - chord.rest;
                if shape > 2.0 * tol * tol {
                    let (p, q) = (chord.p, chord.q);
                    let (dx, dy) = (p.x - q.x, p.y - q.y);
                    let length = (dx * dx + dy * dy).sqrt();
                    checks.push(Verify {
                        cell: i,
                        m: P { x: 0.5 * (p.x + q.x), y: 0.5 * (p.y + q.y) },
                        n: P { x: -dy / length, y: dx / length },
                        length,
                        chord: chord.clone(),
                        lo: None,
                        hi: None,
                        asked: Vec::new(),
                        steps: 0,
                        extra: [(DVec3::ZERO, 0.0); 2],
                    });
                }
            }
        }
        let mut failed = vec![false; cells.len()];
        loop {
            let mut going = Vec::new();
            for mut v in checks {
                let cell = v.cell;
                match step(&mut v, &cells[cell], &mut store, tol) {
                    Verified::Going => going.push(v),
                    Verified::Done(shift, var) => {
                        let o = &mut outcomes[v.cell];
                        o.value += shift;
                        o.var = var;
                        o.class = 10;
                    }
                    Verified::Failed => {
                        failed[v.cell] = true;
                        let a = f64::from(cells[v.cell].size) / f64::from(UNIT);
                        let e = 0.15 * v.chord.contrast * a * a;
                        outcomes[v.cell].var = v.chord.rest + e * e;
                    }
                }
            }
            if going.is_empty() && store.pending.is_empty() {
                break;
            }
            store.flush();
            checks = going;
        }
        for i in centred {
            outcomes[i] = evaluate(&cells[i], &chains, &store, &mut pts, tol);
        }
        // settle or split
        let mut split = Vec::new();
        for (i, o) in outcomes.iter().enumerate() {
            if level < MAX_LEVEL && o.var > 4.0 * tol * tol {
                split.push(i);
            } else {
                let r = &mut result[cells[i].pixel as usize];
                r.0 += o.value;
                r.1 += o.var;
                r.2 = if level > 0 {
                    20 + level as u8
                } else if failed[i] {
                    19
                } else {
                    o.class
                };
            }
        }
        // ask for centres and side middles
        for &i in &split {
            let c = &mut cells[i];
            let half = c.size / 2;
            if c.centre == NONE {
                c.centre = store.request(c.x + half, c.y + half);
            }
            let ends = [
                (c.x, c.corners[0], c.corners[1]),
                (c.y, c.corners[1], c.corners[2]),
                (c.x, c.corners[3], c.corners[2]),
                (c.y, c.corners[0], c.corners[3]),
            ];
            let at = [(c.x + half, c.y), (c.x + c.size, c.y + half), (c.x + half, c.y + c.size), (c.x, c.y + half)];
            for k in 0..4 {
                let chain = &mut chains[c.sides[k] as usize];
                if chain.is_empty() {
                    chain.push(Entry::new(ends[k].0, ends[k].1));
                    chain.push(Entry::new(ends[k].0 + c.size, ends[k].2));
                }
                let t = ends[k].0 + half;
                if chain.binary_search_by_key(&t, |e| e.t).is_err() {
                    let s = store.request(at[k].0, at[k].1);
                    insert(chain, t, s);
                }
            }
        }
        store.flush();
        let mut next = Vec::with_capacity(4 * split.len());
        for &i in &split {
            let c = cells[i].clone();
            let half = c.size / 2;
            let mid = |k: usize, t: i32| {
                let chain = &chains[c.sides[k] as usize];
                chain[chain.partition_point(|e| e.t < t)].s
            };
            let (mt, mr, mb, ml) = (mid(0, c.x + half), mid(1, c.y + half), mid(2, c.x + half), mid(3, c.y + half));
            let hz = chains.len() as u32;
            chains.push(vec![Entry::new(c.x, ml), Entry::new(c.x + half, c.centre), Entry::new(c.x + c.size, mr)]);
            let vt = chains.len() as u32;
            chains.push(vec![Entry::new(c.y, mt), Entry::new(c.y + half, c.centre), Entry::new(c.y + c.size, mb)]);
            let [tl, tr, br, bl] = c.corners;
            let [st, sr, sb, sl] = c.sides;
            let make = |x: i32, y: i32, corners, sides| Cell {
                pixel: c.pixel,
                x,
                y,
                size: half,
                corners,
                sides,
                centre: NONE,
                nearby: c.nearby,
                features: inherit(&c.features, tracer, region, (x, y, half)),
            };
            next.push(make(c.x, c.y, [tl, mt, c.centre, ml], [st, vt, hz, sl]));
            next.push(make(c.x + half, c.y, [mt, tr, mr, c.centre], [st, sr, hz, vt]));
            next.push(make(c.x + half, c.y + half, [c.centre, mr, br, mb], [hz, sr, sb, vt]));
            next.push(make(c.x, c.y + half, [ml, c.centre, mb, bl], [hz, vt, sb, sl]));
        }
        cells = next;
        level += 1;
    }
    (result, store.counts)
}

/// The features of a cell that lie in its child at (x, y) of the block.
fn inherit(features: &[Feature], tracer: &Tracer, region: Region, (x, y, size): (i32, i32, i32)) -> Vec<Feature> {
    let place = |v: i32, start: u32| f64::from(v) / f64::from(UNIT) + f64::from(start);
    let rectangle = [place(x, region.x0), place(y, region.y0), place(x + size, region.x0), place(y + size, region.y0)];
    let inside = |f: &Feature| {
        let outline = small::outline(tracer, f.object)?;
        let area = small::area(&small::clip(&outline, rectangle)).0;
        (area > 0.0).then_some(Feature { area, ..*f })
    };
    features.iter().filter_map(inside).collect()
}

/// Looks at the small objects of every pixel that its corners do not show.
fn features(cells: &mut [Cell], store: &mut Store<'_>, region: Region, tol: f64) {
    let tracer = store.tracer;
    let (marks, prepared) = (tracer.marks(), tracer.prepared());
    if marks.is_empty() {
        return;
    }
    let mut asked = Vec::new();
    for (at, cell) in cells.iter().enumerate() {
        let (i, j) = (at as u32 % region.width(), at as u32 / region.width());
        let seen = cell.corners.map(|c| store.object(c));
        for mark in marks.of(region.x0 + i, region.y0 + j) {
            if seen.contains(&mark.object) {
                continue;
            }
            // A part of a mesh that the corners show differs from it by as much as the mesh varies.
            let alike = seen.iter().any(|&o| o != Sample::NOTHING && prepared.same_mesh(o, mark.object));
            if alike && (2.0 * cell.nearby + 12.0 / 255.0) * f64::from(mark.area) * 0.3 <= 1.5 * tol {
                continue;
            }
            let unit = f64::from(UNIT);
            let place = |k: usize| ((f64::from(mark.at[k]) * unit).round() as i32).clamp(0, UNIT);
            asked.push((at, mark, store.request(cell.x + place(0), cell.y + place(1))));
        }
    }
    store.flush();
    for (at, mark, sample) in asked {
        if store.object(sample) == mark.object {
            cells[at].features.push(Feature { object: mark.object, sample, area: f64::from(mark.area) });
        }
    }
}

/// Narrows every crossing on the cells' sides.
fn bisect(cells: &[Cell], chains: &mut [Chain], store: &mut Store<'_>, tol: f64) {
    struct Bracket {
        side: u32,
        fixed: i32,
        horizontal: bool,
        size: i32,
        a: (i32, u32),
        b: (i32, u32),
    }
    let mut active: Vec<Bracket> = Vec::new();
    for c in cells {
        let s = c.size;
        let sides = [
            (c.sides[0], true, c.y, c.x, c.corners[0], c.corners[1]),
            (c.sides[1], false, c.x + s, c.y, c.corners[1], c.corners[2]),
            (c.sides[2], true, c.y + s, c.x, c.corners[3], c.corners[2]),
            (c.sides[3], false, c.x, c.y, c.corners[0], c.corners[3]),
        ];
        for (side, horizontal, fixed, t, a, b) in sides {
            let chain = &chains[side as usize];
            if chain.is_empty() {
                if store.sig(a) != store.sig(b) {
                    active.push(Bracket { side, fixed, horizontal, size: s, a: (t, a), b: (t + s, b) });
                }
            } else {
                let (i, j) = chain_range(chain, t, t + s);
                for p in chain[i..j].windows(2) {
                    if p[0].next.is_none() && store.sig(p[0].s) != store.sig(p[1].s) {
                        let (a, b) = ((p[0].t, p[0].s), (p[1].t, p[1].s));
                        active.push(Bracket { side, fixed, horizontal, size: s, a, b });
                    }
                }
            }
        }
    }
    active.sort_by_key(|b| (b.side, b.a.0));
    active.dedup_by_key(|b| (b.side, b.a.0));
    let mut found = Vec::new();
    loop {
        let mut asked: Vec<(i32, u32)> = Vec::new();
        active.retain(|b| {
            let w = b.b.0 - b.a.0;
            let unit = f64::from(UNIT);
            let e = DOUBT * rms(store.rgb(b.a.1) - store.rgb(b.b.1)) * f64::from(w) / unit * f64::from(b.size) / unit;
            if w < 2 || 1.5 * e * e <= tol * tol {
                return false;
            }
            let mut t = (b.a.0 + b.b.0) / 2;
            let (oa, ob) = (store.object(b.a.1), store.object(b.b.1));
            if oa != ob {
                let line = if b.horizontal {
                    store.line(0.0, f64::from(b.fixed), (1.0, 0.0))
                } else {
                    store.line(f64::from(b.fixed), 0.0, (0.0, 1.0))
                };
                found.clear();
                let range = (f64::from(b.a.0), f64::from(b.b.0));
                let (low, high) = (oa.min(ob), oa.max(ob));
                outline::crossings(store.tracer.prepared(), low, &line, range, &mut found);
                let first = found.len();
                outline::crossings(store.tracer.prepared(), high, &line, range, &mut found);
                let rest = found.len() - first;
                // Whose sides are known: the outline's owner reaches it, what lies beyond is to be seen.
                let candidate = match (first, rest) {
                    (1, 0) | (0, 1) => Some(found[0]),
                    (1, 1) if (found[0].t - found[1].t).abs() < 0.01 * f64::from(UNIT) => Some(found[0]),
                    (1, 1) => {
                        let between = (0.5 * (found[0].t + found[1].t)).round() as i32;
                        if between > b.a.0 && between < b.b.0 {
                            t = between;
                            None
                        } else {
                            Some(found[0])
                        }
                    }
                    _ => None,
                };
                if let Some(c) = candidate {
                    const NEAR: f64 = 3.0;
                    let near = [c.t - f64::from(b.a.0) <= NEAR, f64::from(b.b.0) - c.t <= NEAR];
                    let doubt = match near {
                        [true, true] => 0.0,
                        [false, false] => DOUBT,
                        _ => CONFIRMED,
                    };
                    let e = e / DOUBT * doubt;
                    if 1.5 * e * e <= tol * tol {
                        let chain = &mut chains[b.side as usize];
                        if chain.is_empty() {
                            chain.push(Entry::new(b.a.0, b.a.1));
                            chain.push(Entry::new(b.b.0, b.b.1));
                        }
                        let at = chain.partition_point(|e| e.t < b.a.0);
                        chain[at].next = Some(c);
                        chain[at].doubt = doubt;
                        return false;
                    }
                    let (below, above) = ((c.t - 1.0).floor() as i32, (c.t + 1.0).ceil() as i32);
                    let beyond = if c.object == oa { above } else { below };
                    t = match near {
                        [true, _] => above,
                        [_, true] => below,
                        _ => beyond,
                    };
                    t = t.clamp(b.a.0 + 1, b.b.0 - 1);
                }
            }
            let (u, v) = if b.horizontal { (t, b.fixed) } else { (b.fixed, t) };
            asked.push((t, store.request(u, v)));
            true
        });
        if active.is_empty() {
            return;
        }
        store.flush();
        let mut next = Vec::with_capacity(active.len());
        for (b, &m) in active.iter().zip(&asked) {
            let chain = &mut chains[b.side as usize];
            if chain.is_empty() {
                chain.push(Entry::new(b.a.0, b.a.1));
                chain.push(Entry::new(b.b.0, b.b.1));
            }
            insert(chain, m.0, m.1);
            for (a, e) in [(b.a, m), (m, b.b)] {
                if store.sig(a.1) != store.sig(e.1) {
                    next.push(Bracket { a, b: e, ..*b });
                }
            }
        }
        active = next;
    }
}

/// Renders `region`.
pub(crate) fn render(tracer: &Tracer, region: Region, tol: f64) -> (Tile, Vec<f32>, RayCounts) {
    let blocks = region.blocks(BLOCK);
    let corners = Corners::new(tracer, region);
    let done: Vec<_> = blocks.into_par_iter().map(|b| (b, block(tracer, &corners, b, tol))).collect();
    let mut pixels = vec![[0.0; 3]; region.area() as usize];
    let mut errors = vec![0.0; region.area() as usize];
    let mut error = ErrorEstimate::default();
    let mut counts = corners.counts;
    for (b, (part, c)) in done {
        counts += c;
        let width = b.width() as usize;
        for (row, line) in part.chunks_exact(width).enumerate() {
            let y = (b.y0 - region.y0) as usize + row;
            let start = y * region.width() as usize + (b.x0 - region.x0) as usize;
            for (k, (value, var, class)) in line.iter().enumerate() {
                pixels[start + k] = value.to_array().map(|c| c as f32);
                errors[start + k] = var.sqrt() as f32;
                error.add_pixel(*var);
                let _ = class;
            }
        }
    }
    (Tile { region, pixels, error }, errors, counts)
}
