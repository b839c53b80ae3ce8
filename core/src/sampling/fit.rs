//! The one edge through a pixel, from where it crosses two sides and the middle between.

use glam::DVec2;

use super::lattice::UNIT;

/// Bisections of a side, or of the middle, at most.
const STEPS: u32 = 11;
/// Standard deviation of an edge's bend that was not looked at, as a share of its chord.
const BEND: f64 = 0.03;
/// How far beside its chord a bend is looked for first, and at all, as shares of it.
const NEAR: f64 = 1.0 / 16.0;
const FAR: f64 = 0.35;

/// How far beside its quarters an edge may pass, in standard deviations of what that is worth.
const QUARTER: f64 = 2.0;
/// How close to the edge points say nothing about it, in pixels.
const UNSURE: f64 = 0.05;

/// What is known of an edge's place on a pixel's side, shared by two pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Side {
    /// Whether the middles looked at are like the side's start, the latest last.
    bits: u32,
    pub(crate) known: u32,
    /// The steps before something third was seen; `u32::MAX` if nothing was.
    pub(crate) broken: u32,
}

impl Default for Side {
    fn default() -> Self {
        Self { bits: 0, known: 0, broken: u32::MAX }
    }
}

impl Side {
    /// The stretch that `steps` bisections leave, from the start in shares of the side.
    fn bracket(&self, steps: u32) -> (f64, f64) {
        let (mut lo, mut width) = (0.0, 1.0);
        for step in 0..steps {
            width *= 0.5;
            if self.bits >> (self.known - 1 - step) & 1 == 1 {
                lo += width;
            }
        }
        (lo, width)
    }

    /// Where to look next, in lattice units from the start.
    pub(crate) fn next(&self) -> i32 {
        let (lo, width) = self.bracket(self.known);
        ((lo + 0.5 * width) * f64::from(UNIT)) as i32
    }

    /// Takes in whether that is like the start, like the end, or neither.
    pub(crate) fn learn(&mut self, like_start: Option<bool>) {
        match like_start {
            Some(b) => {
                self.bits = self.bits << 1 | u32::from(b);
                self.known += 1;
            }
            None => self.broken = self.known,
        }
    }
}

/// What is known of the middle of an edge.
#[derive(Clone, Copy, Debug)]
struct Bend {
    /// Looked at along this line.
    middle: DVec2,
    normal: DVec2,
    /// The edge is between, along it.
    lo: f64,
    hi: f64,
    /// Whether both ends were looked at.
    checked: bool,
    steps: u32,
}

impl Bend {
    /// Where the edge is taken to be.
    fn place(&self) -> DVec2 {
        self.middle + self.normal * (0.5 * (self.lo + self.hi))
    }

    /// How far that is beside the chord from p.
    fn beside(&self, p: DVec2, chord: DVec2, length: f64) -> f64 {
        cross(chord, self.place() - p) / length
    }
}

/// An edge that crosses two sides.
#[derive(Clone, Debug)]
pub(crate) struct Fit {
    /// Which corners, clockwise from the upper left one, are on the first one's side.
    like: [bool; 4],
    /// The sides crossed, the k-th from corner k to the next.
    crossed: [usize; 2],
    /// Bisections of each.
    steps: [u32; 2],
    bend: Option<Bend>,
    /// Root mean square of the jump across.
    contrast: f64,
    /// Samples so far.
    pub(crate) samples: u32,
}

/// What a fit needs.
pub(crate) enum Next {
    /// The edges on its sides known to so many steps.
    Sides([u32; 2]),
    /// Looks at these points.
    Points(Vec<DVec2>),
    /// Nothing more: the first corner's side has this area, with that variance of what is seen.
    Done(f64, f64),
}

fn cross(a: DVec2, b: DVec2) -> f64 {
    a.x * b.y - a.y * b.x
}

fn corner(k: usize) -> DVec2 {
    [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y][k % 4]
}

impl Fit {
    /// The edge between corners that are `like` the first and those that are not, where it
    /// crosses two sides.
    pub(crate) fn new(like: [bool; 4], contrast: f64) -> Option<Self> {
        let mut crossed = (0..4).filter(|&k| like[k] != like[(k + 1) % 4]);
        let crossed = [crossed.next()?, crossed.next().filter(|_| crossed.next().is_none())?];
        Some(Self { like, crossed, steps: [0; 2], bend: None, contrast, samples: 0 })
    }

    pub(crate) fn crossed(&self) -> [usize; 2] {
        self.crossed
    }

    pub(crate) fn steps(&self) -> [u32; 2] {
        self.steps
    }

    /// Where the edge crosses its k-th side, and how wide that stretch is.
    fn crossing(&self, k: usize, side: &Side) -> (DVec2, f64) {
        let (a, b) = (corner(self.crossed[k]), corner(self.crossed[k] + 1));
        // Sides start at the left, or at the top.
        let (start, end) = if self.crossed[k] < 2 { (a, b) } else { (b, a) };
        let (lo, width) = side.bracket(self.steps[k]);
        (start + (end - start) * (lo + 0.5 * width), width)
    }

    /// What is needed to know the value to a standard deviation whose square is `limit`.
    pub(crate) fn next(&mut self, sides: [&Side; 2], limit: f64) -> Next {
        let (p, q) = (self.crossing(0, sides[0]), self.crossing(1, sides[1]));
        let chord = q.0 - p.0;
        let length = chord.length();
        // A crossing that moves sweeps a triangle with the other at its top.
        let sweeps = [0, 1].map(|k| {
            let along = corner(self.crossed[k] + 1) - corner(self.crossed[k]);
            0.5 * cross(along, chord).abs()
        });
        let variance = |sweep: f64, width: f64| {
            let e = self.contrast * sweep * width;
            e * e / 12.0
        };
        let each = [variance(sweeps[0].max(0.1), p.1), variance(sweeps[1].max(0.1), q.1)];
        if each[0] + each[1] > 0.5 * limit {
            let mut steps = self.steps;
            for k in 0..2 {
                if each[k] > 0.2 * limit && steps[k] < STEPS {
                    steps[k] += 1;
                }
            }
            if steps != self.steps {
                self.samples += steps[0] + steps[1] - self.steps[0] - self.steps[1];
                self.steps = steps;
                return Next::Sides(steps);
            }
        }
        let (bend, doubt) = match &self.bend {
            None => (0.0, BEND * length),
            Some(b) => (b.beside(p.0, chord, length.max(1e-9)), (b.hi - b.lo) / 12f64.sqrt()),
        };
        let e = self.contrast * (2.0 / 3.0) * length * doubt;
        let total = each[0] + each[1] + e * e;
        if total > limit && length > 1e-3 {
            match &mut self.bend {
                None => {
                    let middle = (p.0 + q.0) * 0.5;
                    let normal = DVec2::new(-chord.y, chord.x) * (1.0 / length);
                    let near = NEAR * length;
                    self.bend = Some(Bend { middle, normal, lo: -near, hi: near, checked: false, steps: 0 });
                    self.samples += 2;
                    return Next::Points(vec![middle - normal * near, middle + normal * near]);
                }
                Some(b) if b.steps < STEPS => {
                    self.samples += 1;
                    return Next::Points(vec![b.place()]);
                }
                Some(_) => {}
            }
        }
        // The boundary of the first corner's side.
        let mut polygon = Vec::with_capacity(6);
        for k in 0..4 {
            if self.like[k] == self.like[0] {
                polygon.push(corner(k));
            }
            if k == self.crossed[0] {
                polygon.push(p.0);
            } else if k == self.crossed[1] {
                polygon.push(q.0);
            }
        }
        let n = polygon.len();
        let area = 0.5 * (0..n).map(|i| cross(polygon[i], polygon[(i + 1) % n])).sum::<f64>();
        // From p to q the first corner is to the left, seen with y up; a bend to the right adds.
        let sign = self.first_side(p.0, chord);
        Next::Done((area + sign * (2.0 / 3.0) * length * bend).clamp(0.0, 1.0), total)
    }

    /// Whether a point is on the first corner's side; `None` next to the edge.
    pub(crate) fn side(&self, at: DVec2, sides: [&Side; 2]) -> Option<bool> {
        let (p, q) = (self.crossing(0, sides[0]).0, self.crossing(1, sides[1]).0);
        let chord = q - p;
        let length = chord.length().max(1e-9);
        let along = ((at - p).dot(chord) / (length * length)).clamp(0.0, 1.0);
        let bend = self.bend.as_ref().map_or(0.0, |b| b.beside(p, chord, length));
        let beyond = cross(chord, at - p) / length - 4.0 * bend * along * (1.0 - along);
        (beyond.abs() > UNSURE).then(|| (beyond < 0.0) == (self.first_side(p, chord) > 0.0))
    }

    /// Points close to both sides of the edge, a quarter of its way from either end, and whether they
    /// are on the first corner's side: if so, what is missed is worth less than `limit`.
    pub(crate) fn quarters(&self, sides: [&Side; 2], limit: f64) -> impl Iterator<Item = (DVec2, bool)> {
        let (p, q) = (self.crossing(0, sides[0]), self.crossing(1, sides[1]));
        let chord = q.0 - p.0;
        let length = chord.length().max(1e-9);
        let normal = DVec2::new(-chord.y, chord.x) * (1.0 / length);
        let (bend, unsure) = match &self.bend {
            None => (0.0, BEND * length),
            Some(b) => (b.beside(p.0, chord, length), 0.5 * (b.hi - b.lo)),
        };
        let worth = QUARTER * limit.sqrt() / (self.contrast * length).max(1e-9);
        let beside = (unsure + 0.5 * p.1.max(q.1)).max(worth).min(FAR * length.max(0.1));
        let below = self.first_side(p.0, chord) > 0.0;
        let places = [(0.25, -1.0), (0.25, 1.0), (0.75, -1.0), (0.75, 1.0)].into_iter().map(move |(t, side)| {
            let at = p.0 + chord * t + normal * (4.0 * bend * t * (1.0 - t) + side * beside);
            (at, (side < 0.0) == below)
        });
        // What is seen beyond the pixel is not its own.
        places.filter(|(at, _)| at.cmpge(DVec2::ZERO).all() && at.cmple(DVec2::ONE).all())
    }

    /// 1 where a bend along the normal adds to the first corner's side, else −1.
    fn first_side(&self, p: DVec2, chord: DVec2) -> f64 {
        let k = (0..4).find(|&k| self.like[k] == self.like[0] && cross(chord, corner(k) - p) != 0.0).unwrap_or(0);
        -cross(chord, corner(k) - p).signum()
    }

    /// Takes in whether the points asked for are on the first corner's side. False where that
    /// makes no edge.
    pub(crate) fn learn(&mut self, like_first: &[bool], sides: [&Side; 2]) -> bool {
        let (p, q) = (self.crossing(0, sides[0]).0, self.crossing(1, sides[1]).0);
        // The first corner's side is that of negative places along the normal, or not.
        let below = self.first_side(p, q - p) > 0.0;
        let Some(b) = &mut self.bend else { return false };
        b.steps += 1;
        match *like_first {
            [lo, hi] => {
                b.checked = true;
                match (lo == below, hi != below) {
                    (true, true) => {}
                    (false, true) => (b.lo, b.hi) = (b.lo / NEAR * FAR, b.lo),
                    (true, false) => (b.lo, b.hi) = (b.hi, b.hi / NEAR * FAR),
                    (false, false) => return false,
                }
            }
            [at] => {
                let middle = 0.5 * (b.lo + b.hi);
                if at == below {
                    b.lo = middle;
                } else {
                    b.hi = middle;
                }
            }
            _ => return false,
        }
        b.checked
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn something_third_ends_a_search_and_changes_nothing_that_was_found() {
        let mut side = Side::default();
        side.learn(Some(true));
        side.learn(Some(false));
        let found = (side.bracket(1), side.bracket(2));
        side.learn(None);
        assert_eq!((side.bracket(1), side.bracket(2)), found);
        assert_eq!((side.known, side.broken), (2, 2));
    }
}
