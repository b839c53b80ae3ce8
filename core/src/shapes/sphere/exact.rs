//! A sphere before a line in wide numbers.

use glam::DVec3;

use crate::numeric::{Big, Bound, Unsure, Vector};
use crate::scene::Sphere;
use crate::shapes::Decision;
use crate::shapes::exact::{
    At, Distance, Exact, ExactHit, ExactRay, LAST, Met, Slack, VALUE, largest, sign, size, times, travelled,
};

/// A line and a sphere.
struct Chord<const N: usize> {
    /// a·t² + 2b·t + c = 0, and b² − a·c.
    a: Big<N>,
    b: Big<N>,
    c: Big<N>,
    disc: Big<N>,
    b_terms: Bound,
    c_terms: Bound,
    disc_terms: Bound,
    b_error: Bound,
    c_error: Bound,
    disc_error: Bound,
    /// How far the line may be misplaced at the sphere.
    delta: Bound,
}

impl<const N: usize> Chord<N> {
    fn new(ray: &ExactRay<N>, center: &Vector<N>, r: Big<N>) -> Self {
        let Slack { lateral, position, turn, rounding } = ray.slack;
        let oc = ray.o - *center;
        let (a, b, rr) = (ray.d.dot(&ray.d), oc.dot(&ray.d), r * r);
        let oc2 = oc.dot(&oc);
        let c = oc2 - rr;
        let (away, speed, radius) = (size(&oc), size(&ray.d), Bound::of(&r));
        let delta = times(lateral, 1) + away * (times(turn, 2) + rounding);
        // disc = |d|²(r² − s²), s the line's distance from the centre. Where s > 2r its sign is
        // beyond doubt if delta is far below r; else s ≤ 2r.
        let lever =
            if delta.exponent().saturating_add(4) < radius.exponent() { radius } else { radius + times(away, 1) };
        let c_terms = Bound::of(&oc2) + Bound::of(&rr);
        let (disc, disc_terms) = if N < LAST {
            (b * b - a * c, Bound::of(&a) * c_terms)
        } else {
            // Dearer, but what it subtracts is no more than the sphere's size: spheres however small
            // beside their distance are told from points.
            let (arm, reach) = (oc.cross(&ray.d), a * rr);
            let square = arm.dot(&arm);
            (reach - square, Bound::of(&reach) + Bound::of(&square))
        };
        Self {
            disc,
            disc_error: Bound::of(&a) * (times(lever * delta, 3) + times(delta * delta, 2)) + rounding * disc_terms,
            disc_terms,
            b_terms: away * speed,
            b_error: times(speed * (position + away * (times(turn, 2) + rounding)), 2),
            c_error: times(away * position, 3) + times(position * position, 2) + rounding * c_terms,
            c_terms,
            a,
            b,
            c,
            delta,
        }
    }

    /// √disc and its error; both 0 where the line is a tangent.
    fn root(&self) -> Result<Option<(Big<N>, Bound)>, Unsure> {
        Ok(match sign(&self.disc, self.disc_terms, self.disc_error)? {
            -1 => None,
            0 => Some((Big::ZERO, Bound::ZERO)),
            _ => {
                let root = self.disc.sqrt();
                Some((root, self.disc_error.over(&root)))
            }
        })
    }

    /// √disc of a line that is known to meet the sphere, and its error.
    fn root_of_a_hit(&self) -> (Big<N>, Bound) {
        let root = self.disc.sqrt();
        if self.disc_error == Bound::ZERO {
            return (root, Bound::ZERO);
        }
        // |√a − √b| is at most |a − b|/√a, and √|a − b|.
        let (far, near) = (self.disc_error.over(&root), Bound::power((self.disc_error.exponent() + 3).div_euclid(2)));
        (root, if far.exponent() < near.exponent() { far } else { near })
    }

    /// Where the line enters, or leaves, the sphere: of the two forms of each root, the one that
    /// subtracts nothing.
    fn distance(&self, (root, root_error): (Big<N>, Bound), far: bool, rounding: Bound) -> Distance<N> {
        let sum = if self.b.signum() < 0 { root - self.b } else { root + self.b };
        let (b_error, c_error) = (self.b_error + root_error, self.c_error);
        if far == (self.b.signum() < 0) {
            let t = sum.over(self.a);
            let t = if far { t } else { -t };
            return Distance { t, error: b_error.over(&self.a) + rounding * Bound::of(&t) };
        }
        let t = self.c.over(sum);
        let t = if far { -t } else { t };
        let size = Bound::of(&t);
        Distance { t, error: times((c_error + size * b_error).over(&sum), 1) + rounding * size }
    }

    /// Where the line through a point of the sphere meets it again.
    fn other(&self, rounding: Bound) -> Distance<N> {
        let t = -self.b.scale(1).over(self.a);
        Distance { t, error: times(self.b_error, 1).over(&self.a) + rounding * Bound::of(&t) }
    }
}

impl Exact for Sphere {
    fn intersect<const N: usize>(&self, _: At, ray: &ExactRay<N>, own: Option<Decision>) -> Met<Distance<N>> {
        let rounding = ray.slack.rounding;
        let chord = Chord::new(ray, &Vector::new(self.center), Big::new(self.radius));
        if let Some(own) = own {
            return Ok(own.inside.then(|| (chord.other(rounding), true)));
        }
        let Some(root) = chord.root()? else { return Ok(None) };
        Ok(match sign(&chord.c, chord.c_terms, chord.c_error)? {
            // Outside: both roots lie on one side of the start.
            1 => (chord.b.signum() < 0).then(|| (chord.distance(root, false, rounding), false)),
            -1 => Some((chord.distance(root, true, rounding), true)),
            // On the sphere: 0 is one root, the other counts if it lies ahead.
            _ => (sign(&chord.b, chord.b_terms, chord.b_error)? < 0).then(|| (chord.other(rounding), true)),
        })
    }

    fn hit<const N: usize>(&self, _: At, ray: &ExactRay<N>, met: Decision) -> Result<ExactHit<N>, Unsure> {
        let Slack { turn, rounding, .. } = ray.slack;
        let (c, r) = (Vector::new(self.center), Big::new(self.radius));
        let chord = Chord::new(ray, &c, r);
        let (t, sway) = if ray.from.is_some_and(|f| f.id == met.id) {
            (chord.other(rounding).t, times(chord.b_error, 1).over(&ray.d.0[largest(&ray.d)]) + ray.slack.position)
        } else {
            let root = chord.root_of_a_hit();
            let sway = times(chord.delta, 1) + root.1.over(&ray.d.0[largest(&ray.d)]);
            (chord.distance(root, met.inside, rounding).t, sway)
        };
        let p = ray.o + ray.d * t;
        let (way, start) = travelled(ray, &t);
        let position = sway + rounding * (way + start + size(&c));
        let bend = times(position, 1).over(&r);
        // The normal is a difference of places: it must keep digits beside them.
        if bend != Bound::ZERO && bend.exponent() > -VALUE {
            return Err(Unsure);
        }
        let slack = Slack { lateral: position, position, turn: turn + times(bend, 2) + rounding, rounding };
        let normal = p - c;
        let back = normal.dot(&ray.d).scale(1).over(r * r);
        Ok(ExactHit { p, normal, back, turned: met.inside, decision: met, slack, bend })
    }

    fn lengths(&self) -> ([DVec3; 3], f64) {
        ([self.center, DVec3::ZERO, DVec3::ZERO], self.radius)
    }
}
