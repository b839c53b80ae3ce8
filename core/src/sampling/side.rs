//! Where edges cross the sides of cells.

use super::outline::{self, Crossing};
use super::part::Part;
use super::store::{SampleId, Store, UNIT};

/// Standard deviation of a place known to lie between two points, as a share of their distance:
/// half of that of an even spread, since bisection ends at an eighth of what matters.
pub(crate) const DOUBT: f64 = 0.144;
/// The same where an outline was computed and seen from one side.
const CONFIRMED: f64 = 0.04;
/// How far from a computed crossing its sides are looked at, in lattice units.
const NEAR: f64 = 3.0;

/// A sample on a side, and where between it and the next the edge runs, if known.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    /// Along the side.
    pub(crate) t: i32,
    pub(crate) sample: SampleId,
    /// A sample of the same key that has a value.
    pub(crate) like: SampleId,
    pub(crate) next: Option<Crossing>,
    pub(crate) doubt: f64,
}

impl Entry {
    /// An entry that nothing is known beyond.
    pub(crate) fn new(t: i32, sample: SampleId, like: SampleId) -> Self {
        Self { t, sample, like, next: None, doubt: DOUBT }
    }
}

/// The entries of a side, by rising t, both ends included.
pub(crate) type Chain = Vec<Entry>;

/// Puts a sample with a value into a chain.
pub(crate) fn insert(chain: &mut Chain, t: i32, sample: SampleId) {
    let at = chain.partition_point(|e| e.t < t);
    match chain.get_mut(at) {
        Some(e) if e.t == t => (e.sample, e.like) = (sample, sample),
        _ => {
            if let Some(before) = at.checked_sub(1).map(|i| &mut chain[i]) {
                // An edge known to be beyond the new point stays known.
                let next = before.next.take_if(|c| c.t > f64::from(t));
                let mut new = Entry::new(t, sample, sample);
                if next.is_some() {
                    (new.next, new.doubt) = (next, before.doubt);
                }
                before.doubt = if before.next.is_some() { before.doubt } else { DOUBT };
                chain.insert(at, new);
            }
        }
    }
}

/// A cell's side whose ends differ in a part.
#[derive(Clone, Debug)]
pub(crate) struct Side {
    pub(crate) part: Part,
    pub(crate) horizontal: bool,
    /// Its row, or column.
    pub(crate) fixed: i32,
    /// Its length.
    pub(crate) size: i32,
    /// What is known of it, both ends at least.
    pub(crate) chain: Chain,
}

/// A stretch of a side with an edge somewhere.
#[derive(Clone, Copy)]
struct Bracket {
    side: usize,
    a: Entry,
    b: Entry,
}

/// What to do about a bracket.
enum Next {
    /// The edge is known well enough to lie at a crossing.
    At(Crossing, f64),
    /// It is known well enough to lie between the ends.
    Between,
    Ask(i32),
}

/// Finds the edges on `sides`, each as well as `tolerance` asks for.
pub(crate) fn search(store: &mut Store<'_>, sides: &[Side], tolerance: f64) -> Vec<Chain> {
    let mut chains: Vec<Chain> = sides.iter().map(|s| s.chain.clone()).collect();
    let mut open = Vec::with_capacity(sides.len());
    for (i, s) in sides.iter().enumerate() {
        for pair in s.chain.windows(2) {
            let differ = store.key(pair[0].sample, s.part) != store.key(pair[1].sample, s.part);
            if differ && pair[0].next.is_none() {
                open.push(Bracket { side: i, a: pair[0], b: pair[1] });
            }
        }
    }
    let mut found = Vec::new();
    while !open.is_empty() {
        let mut asked = Vec::with_capacity(open.len());
        open.retain(|bracket| {
            let side = &sides[bracket.side];
            match next(store, side, bracket, tolerance, &mut found) {
                Next::Between => false,
                Next::At(crossing, doubt) => {
                    let chain = &mut chains[bracket.side];
                    let at = chain.partition_point(|e| e.t < bracket.a.t);
                    (chain[at].next, chain[at].doubt) = (Some(crossing), doubt);
                    false
                }
                Next::Ask(t) => {
                    let (u, v) = if side.horizontal { (t, side.fixed) } else { (side.fixed, t) };
                    asked.push((t, (u, v), store.ask(u, v, side.part.side())));
                    true
                }
            }
        });
        store.flush();
        let mut narrower = Vec::with_capacity(open.len());
        for (bracket, (t, (u, v), sample)) in open.iter().zip(asked) {
            let part = sides[bracket.side].part;
            let key = store.key(sample, part);
            let (a, b) = (store.key(bracket.a.sample, part), store.key(bracket.b.sample, part));
            let like = if key == a {
                bracket.a.like
            } else if key == b {
                bracket.b.like
            } else {
                store.ask(u, v, part.whole())
            };
            let middle = Entry::new(t, sample, like);
            let chain = &mut chains[bracket.side];
            let at = chain.partition_point(|e| e.t < t);
            chain.insert(at, middle);
            if key != a {
                narrower.push(Bracket { b: middle, ..*bracket });
            }
            if key != b {
                narrower.push(Bracket { a: middle, ..*bracket });
            }
        }
        store.flush();
        open = narrower;
    }
    chains
}

fn next(store: &Store<'_>, side: &Side, bracket: &Bracket, tolerance: f64, found: &mut Vec<Crossing>) -> Next {
    let (a, b) = (bracket.a, bracket.b);
    let width = b.t - a.t;
    let unit = f64::from(UNIT);
    let area = f64::from(width) / unit * f64::from(side.size) / unit;
    let e = store.contrast(a.like, b.like, side.part) * area;
    let enough = |doubt: f64| 1.5 * (doubt * e) * (doubt * e) <= tolerance * tolerance;
    if width < 2 || enough(DOUBT) {
        return Next::Between;
    }
    let middle = (a.t + b.t) / 2;
    if !side.part.has_outlines() {
        return Next::Ask(middle);
    }
    let line = if side.horizontal {
        store.line(0.0, f64::from(side.fixed), (1.0, 0.0))
    } else {
        store.line(f64::from(side.fixed), 0.0, (0.0, 1.0))
    };
    found.clear();
    let range = (f64::from(a.t), f64::from(b.t));
    let objects = [store.object(a.sample), store.object(b.sample)];
    let prepared = store.tracer.prepared();
    // By rising id, so that both ways along a side give the same.
    let (low, high) = (objects[0].min(objects[1]), objects[0].max(objects[1]));
    let mut first = 0;
    for (object, count) in [(low, true), (high, false)] {
        if let Some(object) = object {
            outline::crossings(prepared, object, &line, range, found);
        }
        if count {
            first = found.len();
        }
    }
    let crossing = match (first, found.len() - first) {
        (1, 0) | (0, 1) => found[0],
        (1, 1) => {
            let apart = (found[0].t - found[1].t).abs();
            // Two faces that meet in an edge: nothing is between.
            if apart < 1e-6 * unit
                && low.zip(high).is_some_and(|(a, b)| prepared.same_mesh(a, b))
                && store.same_lights(a.like, b.like)
            {
                return Next::At(found[0], 0.0);
            }
            let between = (0.5 * (found[0].t + found[1].t)).round() as i32;
            if apart >= 0.01 * unit && between > a.t && between < b.t {
                return Next::Ask(between);
            }
            found[0]
        }
        _ => return Next::Ask(middle),
    };
    let near = [crossing.t - range.0 <= NEAR, range.1 - crossing.t <= NEAR];
    let doubt = match near {
        [true, true] => 0.0,
        [false, false] => DOUBT,
        _ => CONFIRMED,
    };
    if enough(doubt) {
        return Next::At(crossing, doubt);
    }
    let (below, above) = ((crossing.t - 1.0).floor() as i32, (crossing.t + 1.0).ceil() as i32);
    // The outline's owner reaches it; what lies beyond is to be seen.
    let t = match near {
        [true, _] => above,
        [_, true] => below,
        _ if Some(crossing.object) == objects[0] => above,
        _ => below,
    };
    Next::Ask(t.clamp(a.t + 1, b.t - 1))
}
