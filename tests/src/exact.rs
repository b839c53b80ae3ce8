//! One ray against one object in exact arithmetic.
//!
//! Every f64 is a rational number whose denominator is a power of two, and so is every
//! sum and product of such; all questions below are signs of polynomials in them. A
//! distance is never computed: that a claimed one is right is shown by the signs at its
//! two neighbours, which proves it without a square root.

use std::cmp::Ordering::{self, Equal, Greater, Less};

use dashu_float::FBig;
use dashu_float::round::mode::HalfEven;
use glam::DVec3;
use tessera_core::scene::{PlanePosition, Scene, Triangle};

/// A dyadic rational, exact under addition and multiplication.
type Dyadic = FBig<HalfEven, 2>;

fn dyadic(x: f64) -> Dyadic {
    // −0 is 0; precision 0 means unlimited.
    Dyadic::try_from(x + 0.0).unwrap_or_else(|_| panic!("{x} is not finite")).with_precision(0).value()
}

fn sign(x: &Dyadic) -> Ordering {
    x.cmp(&Dyadic::ZERO)
}

type V = [Dyadic; 3];

fn vector(v: DVec3) -> V {
    v.to_array().map(dyadic)
}

fn sub(a: &V, b: &V) -> V {
    [0, 1, 2].map(|i| &a[i] - &b[i])
}

fn dot(a: &V, b: &V) -> Dyadic {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

fn cross(a: &V, b: &V) -> V {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| &a[i] * &b[j] - &a[j] * &b[i])
}

/// Where a ray first meets an object at t > 0, as a number that can only be compared with.
#[derive(Clone, Debug)]
pub enum Distance {
    /// top / bottom, bottom > 0.
    Quotient(Dyadic, Dyadic),
    /// (length · √square + top) / bottom, bottom > 0.
    WithLength(Dyadic, Dyadic, Dyadic, Dyadic),
    /// The lesser (or, where `far`, the greater) root of a·t² − 2b·t + c, a > 0.
    Root {
        /// Coefficient of t².
        a: Dyadic,
        /// Half the negative coefficient of t.
        b: Dyadic,
        /// Constant.
        c: Dyadic,
        /// Which root.
        far: bool,
    },
}

/// The sign of k·√s + x for s ≥ 0.
fn sign_with_root(k: &Dyadic, s: &Dyadic, x: &Dyadic) -> Ordering {
    let root = if sign(s) == Equal { Equal } else { sign(k) };
    match (root, sign(x)) {
        (Equal, x) => x,
        (r, Equal) => r,
        (r, o) if r == o => r,
        (r, _) => {
            // Opposite signs: the greater square wins.
            let order = (k * k * s).cmp(&(x * x));
            if r == Greater { order } else { order.reverse() }
        }
    }
}

impl Distance {
    /// How this compares with t.
    #[must_use]
    pub fn compare(&self, t: f64) -> Ordering {
        if t.is_infinite() {
            return if t > 0.0 { Less } else { Greater };
        }
        let t = dyadic(t);
        match self {
            Self::Quotient(top, bottom) => top.cmp(&(bottom * &t)),
            Self::WithLength(length, square, top, bottom) => sign_with_root(length, square, &(top - bottom * &t)),
            Self::Root { a, b, c, far } => {
                let slope = (a * &t).cmp(b);
                let value = sign(&((a * &t - dyadic(2.0) * b) * &t + c));
                match (far, slope, value) {
                    // Outside the roots on the left, or at or beyond the lesser.
                    (false, Less | Equal, v) => v,
                    (false, Greater, Equal) if sign(&(b * b - a * c)) == Equal => Equal,
                    (false, Greater, _) => Less,
                    (true, Greater | Equal, v) => v.reverse(),
                    (true, Less, _) => Greater,
                }
            }
        }
    }

    /// Whether t is one of the two f64 around the distance, or the distance itself:
    /// within one unit in the last place.
    #[must_use]
    pub fn within_an_ulp(&self, t: f64) -> bool {
        !t.is_nan() && self.compare(t.next_down()) != Less && self.compare(t.next_up()) != Greater
    }
}

/// Where the ray first meets object `order` of the scene.
#[must_use]
pub fn distance(scene: &Scene, order: u32, origin: DVec3, direction: DVec3) -> Option<Distance> {
    let (o, d) = (vector(origin), vector(direction));
    if let Some(p) = scene.planes().iter().find(|p| p.order == order) {
        let n = vector(p.normal);
        let rate = dot(&d, &n);
        let (length, through) = match p.position {
            PlanePosition::Point(q) => (Dyadic::ZERO.with_precision(0).value(), dot(&vector(q), &n)),
            PlanePosition::Distance(x) => (dyadic(x), dyadic(0.0)),
        };
        let square = dot(&n, &n);
        let rest = through - dot(&o, &n);
        let ahead = sign_with_root(&length, &square, &rest);
        return match sign(&rate) {
            Equal => None,
            towards if towards != ahead => None,
            Greater => Some(Distance::WithLength(length, square, rest, rate)),
            _ => Some(Distance::WithLength(-length, square, -rest, -rate)),
        };
    }
    if let Some(s) = scene.spheres().iter().find(|s| s.order == order) {
        let to = sub(&vector(s.center), &o);
        let r = dyadic(s.radius);
        let (a, b, c) = (dot(&d, &d), dot(&d, &to), dot(&to, &to) - &r * &r);
        if sign(&a) == Equal || sign(&(&b * &b - &a * &c)) == Less {
            return None;
        }
        return match (sign(&c), sign(&b)) {
            (Greater, Greater) => Some(Distance::Root { a, b, c, far: false }),
            (Greater, _) | (Equal, Less | Equal) => None,
            _ => Some(Distance::Root { a, b, c, far: true }),
        };
    }
    scene.triangles().iter().find(|t| t.order == order).and_then(|t| to_triangle(t, origin, direction))
}

/// Where the ray meets the triangle.
#[must_use]
pub fn to_triangle(t: &Triangle, origin: DVec3, direction: DVec3) -> Option<Distance> {
    let (o, d) = (vector(origin), vector(direction));
    let [c0, p, q] = t.written.map(vector);
    let [e1, e2] = if t.by_sides() { [p, q] } else { [sub(&p, &c0), sub(&q, &c0)] };
    let n = cross(&e1, &e2);
    let w = sub(&o, &c0);
    let rate = dot(&d, &n);
    let turn = |x: Dyadic| if sign(&rate) == Less { -x } else { x };
    let across = cross(&d, &w);
    let (top, u, v) = (turn(-dot(&w, &n)), turn(dot(&across, &e2)), turn(-dot(&across, &e1)));
    let bottom = turn(rate.clone());
    let inside = sign(&bottom) == Greater && sign(&u) != Less && sign(&v) != Less && sign(&(&bottom - &u - &v)) != Less;
    (inside && sign(&top) == Greater).then_some(Distance::Quotient(top, bottom))
}

/// Judges what a tracer says of a ray in a scene of one object: hit or miss exactly, t within an ulp.
///
/// # Errors
/// What is wrong, in words.
pub fn judge(scene: &Scene, origin: DVec3, direction: DVec3, claimed: Option<f64>) -> Result<(), String> {
    let complaint = |what: &str| {
        let bits = |v: DVec3| v.to_array().map(|x| format!("{x:e}")).join(", ");
        Err(format!("{what}: ray ({}) + t ({}), claimed {claimed:?}", bits(origin), bits(direction)))
    };
    match (distance(scene, 0, origin, direction), claimed) {
        (None, None) => Ok(()),
        (Some(_), None) => complaint("missed a hit"),
        (None, Some(_)) => complaint("hit where there is nothing"),
        (Some(d), Some(t)) if d.within_an_ulp(t) => Ok(()),
        (Some(_), Some(_)) => complaint("distance off by more than an ulp"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Document, Look};
    use crate::oracle::Oracle;

    fn camera() -> Document {
        Document::new(DVec3::ZERO, DVec3::Z)
    }

    #[test]
    fn closed_forms() {
        let look = Look::matte(1.0, 1.0, 1.0);
        let scene = camera().sphere(DVec3::new(0.0, 0.0, 5.0), 3.0, look).scene().unwrap();
        let ray = |y: f64| distance(&scene, 0, DVec3::new(0.0, y, 0.0), DVec3::Z);
        assert_eq!(ray(0.0).unwrap().compare(2.0), Equal);
        assert_eq!(ray(0.0).unwrap().compare(2f64.next_up()), Less);
        assert_eq!(ray(3.0).unwrap().compare(5.0), Equal);
        assert_eq!(ray(3.0).unwrap().compare(6.0), Less);
        assert!(ray(3f64.next_up()).is_none());
        assert!(ray(3f64.next_down()).is_some());
        let inside = distance(&scene, 0, DVec3::new(0.0, 0.0, 5.0), DVec3::Z).unwrap();
        assert_eq!((inside.compare(3.0), inside.compare(2.0), inside.compare(4.0)), (Equal, Greater, Less));
        let plane = camera().plane(DVec3::new(0.0, 1.0, 1.0), 2f64.sqrt(), look).scene().unwrap();
        let d = distance(&plane, 0, DVec3::ZERO, DVec3::Z).unwrap();
        // The f64 nearest √2, times the real √2, is not 2 but rounds to it.
        assert!(d.within_an_ulp(2.0) && d.compare(2.0) != Equal);
    }

    #[test]
    fn agrees_with_the_wide_oracle() {
        let mut random = crate::generate::Random::new(5);
        let look = Look::matte(1.0, 1.0, 1.0);
        let mut hits = 0;
        for k in 0..2000 {
            let d = match k % 3 {
                0 => camera().sphere(random.cube(), random.between(0.1, 1.0), look),
                1 => camera().plane(random.cube(), random.between(-1.0, 1.0), look),
                _ => camera().triangle([random.cube(), random.cube(), random.cube()], look),
            };
            let scene = d.scene().unwrap();
            let (o, v) = (random.cube(), random.cube());
            let wide = Oracle::new(&scene, 512).closest_hit(o, v);
            let exact = distance(&scene, 0, o, v);
            assert_eq!(wide.is_some(), exact.is_some());
            if let (Some((_, t)), Some(d)) = (wide, exact) {
                hits += 1;
                assert!(d.within_an_ulp(t.to_f64()));
                assert!(!d.within_an_ulp(t.to_f64().next_up().next_up()));
            }
        }
        assert!(hits > 300, "{hits}");
    }
}
