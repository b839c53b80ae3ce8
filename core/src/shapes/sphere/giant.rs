//! Spheres far larger than what is seen of them, described around the eye.
//!
//! A planet's centre is so far below the eye that its rounding alone is more than what lies on the planet. What
//! matters of such a sphere is near the origin of local space, the eye. There it is F(P) = q·P² + m·P + k = 0, with
//! q = 1/2r, m = −c/r and k = (c² − r²)/2r, and F's gradient 2q·P + m is its unit normal. These numbers are found
//! exactly and rounded once each, so that what they misplace is a share of the distance from the eye, and not of the
//! sphere's size.
//!
//! **Bound.** Every number here is within u of itself. With G = |m| + 2q(|o| + eo), which bounds the gradient at
//! the start: C = F(o) is off by at most eo·G + 10u(q·o² + |m||o| + |k|), B = d·(2q·o + m) by
//! |d|((ed + 8u)·G + 2q·eo), A = q·d² by 2.2·ed + 8u of itself.

use glam::DVec3;

use crate::numeric::{Big, DoubleDouble, Real, Scalar, TINY, V3, Vector};
use crate::scene::Sphere;
use crate::shapes::giants::{LOST, MayBeGiant, WIDE, known, vector};
use crate::shapes::interaction::point;
use crate::shapes::{Ray, Span, SurfaceInteraction};

/// A sphere around the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GiantSphere<R = f64> {
    pub(crate) m: V3<R>,
    pub(crate) q: R,
    pub(crate) k: R,
}

impl MayBeGiant for Sphere {
    /// And the same to twice the digits.
    type Giant = (GiantSphere, GiantSphere<DoubleDouble>);

    fn giant(&self, eye: DVec3, power: i32) -> Option<Self::Giant> {
        let eye = Vector::<WIDE>::new(eye);
        let (c, r) = (Vector::<WIDE>::new(self.center) - eye, Big::<WIDE>::new(self.radius));
        let (cc, rr, power) = (c.dot(&c), r * r, i64::from(power));
        let twice = r.scale(1);
        let k = (cc - rr).over(twice);
        // The eye is as near as a giant's has to be.
        let near = known(&k, rr.exponent() - r.exponent())?;
        if k.exponent() > r.exponent() - 9 || near == 0.0 {
            return None;
        }
        let (m, q, k) = (-(c * r.reciprocal()), twice.reciprocal().scale(power), k.scale(-power));
        let all = i64::MIN + LOST;
        let giant = GiantSphere { m: vector(&m), q: known(&q, all)?, k: known(&k, all)? };
        let nearest = DoubleDouble::nearest::<WIDE>;
        // What is next to nothing may be beyond f64's normal numbers, and is 0 as in f64.
        let part = |x: &Big<WIDE>, rounded: f64| if rounded == 0.0 { DoubleDouble::splat(0.0) } else { nearest(x) };
        let [x, y, z] = &m.0;
        let m = V3 { x: part(x, giant.m.x), y: part(y, giant.m.y), z: part(z, giant.m.z) };
        Some((giant, GiantSphere { m, q: nearest(&q), k: nearest(&k) }))
    }
}

/// A line and a sphere: A·t² + 2B·t + C with B halved, and bounds.
struct Chord<R> {
    a: R,
    /// Relative error of `a`.
    ea: R,
    b: R,
    eb: R,
    c: R,
    ec: R,
    disc: R,
    edisc: R,
    root: R,
    eroot: R,
}

impl<R: Real> Chord<R> {
    #[inline(always)]
    fn new(ray: &Ray<R>, s: &GiantSphere<R>) -> Self {
        let k = |x: f64| R::splat(x);
        let (o, twice, far) = (ray.o, s.q + s.q, ray.o.norm1());
        // Half the linear term is b/2; with b halved, A·t² + 2·(b/2)·t + C.
        let gradient = o * twice + s.m;
        let steep = s.m.norm1() + twice * (far + ray.eo);
        let c = o.dot(o) * s.q + o.dot(s.m) + s.k;
        let ec = ray.eo * steep + k(10.0 * R::U) * (far * (far * s.q + s.m.norm1()) + s.k.abs()) + k(TINY);
        let b = ray.d.dot(gradient) * k(0.5);
        let eb = ray.len * ((ray.ed + k(8.0 * R::U)) * steep + twice * ray.eo) * k(0.5) + k(TINY);
        let a = ray.dd * s.q;
        let ea = k(2.2) * ray.ed + k(8.0 * R::U);
        let disc = b * b - a * c;
        let edisc = k(2.0) * b.abs() * eb
            + eb * eb
            + a * (ec * (k(1.0) + ea) + c.abs() * ea)
            + k(4.0 * R::U) * (b * b + a * c.abs())
            + k(TINY);
        let root = disc.max(k(0.0)).sqrt();
        let eroot = (edisc / root).min(edisc.sqrt()) + k(2.0 * R::U) * root;
        Self { a, ea, b, eb, c, ec, disc, edisc, root, eroot }
    }

    /// The distance that subtracts nothing: of the root on the side of `b`, whose product with the other is c/a.
    #[inline(always)]
    fn by_product(&self) -> (R, R) {
        let k = |x: f64| R::splat(x);
        let (sum, esum) = self.sum();
        let t = self.c.abs() / sum;
        let rest = (sum - esum).max(k(0.0));
        (t, (self.ec + t * esum) / rest + k(8.0 * R::U) * t)
    }

    /// The distance of the other root.
    #[inline(always)]
    fn by_sum(&self) -> (R, R) {
        let k = |x: f64| R::splat(x);
        let (sum, esum) = self.sum();
        let t = sum / self.a;
        (t, k(1.2) * (esum / self.a + t * self.ea) + k(8.0 * R::U) * t)
    }

    #[inline(always)]
    fn sum(&self) -> (R, R) {
        let sum = self.root + self.b.abs();
        (sum, self.eroot + self.eb + R::splat(2.0 * R::U) * sum)
    }

    /// Where a line through a point of the sphere meets it again.
    #[inline(always)]
    fn other(&self) -> (R, R) {
        let k = |x: f64| R::splat(x);
        let t = k(-2.0) * self.b / self.a;
        (t, k(1.2) * (k(2.0) * self.eb / self.a + t.abs() * self.ea) + k(8.0 * R::U) * t.abs())
    }
}

/// The greatest error of a direction that bounds here allow for.
const TURNED: f64 = 0.05;

/// Where `ray` meets the sphere first.
pub(crate) fn test<R: Scalar>(ray: &Ray<R>, s: &GiantSphere<R>) -> Option<Span<R>> {
    let zero = R::splat(0.0);
    let anything = Span::unsure(zero, R::splat(f64::INFINITY), false);
    if !(ray.ed < R::splat(TURNED)) {
        return anything;
    }
    let chord = Chord::new(ray, s);
    if chord.disc < -chord.edisc {
        return None;
    }
    if chord.c > chord.ec {
        if chord.b > chord.eb {
            return None;
        }
        if !(chord.b < -chord.eb && chord.disc > chord.edisc) {
            return anything;
        }
        let (t, e) = chord.by_product();
        return if e < R::splat(f64::INFINITY) { Span::around(t, e, false) } else { anything };
    }
    if chord.c < -chord.ec {
        let (t, e) = if chord.b > zero { chord.by_product() } else { chord.by_sum() };
        return if e < R::splat(f64::INFINITY) { Span::around(t, e, true) } else { anything };
    }
    anything
}

/// Where a ray that starts on the sphere's inner side meets it again.
pub(crate) fn test_from_inside<R: Scalar>(ray: &Ray<R>, s: &GiantSphere<R>) -> Option<Span<R>> {
    let zero = R::splat(0.0);
    let (t, e) = Chord::new(ray, s).other();
    let known = ray.ed < R::splat(TURNED) && e < R::splat(f64::INFINITY);
    let (lo, hi) = if known { ((t - e).max(zero), t + e) } else { (zero, R::splat(f64::INFINITY)) };
    Some(Span { lo, hi, sure: known, inside: true })
}

/// Where `ray` meets the sphere it is known to meet, see [`Shape::interaction`](crate::shapes::Shape::interaction).
#[inline(always)]
pub(super) fn interaction<R: Real>(ray: &Ray<R>, s: &GiantSphere<R>, inner: R, own: R) -> SurfaceInteraction<R> {
    let chord = Chord::new(ray, s);
    let (product, sum, other) = (chord.by_product(), chord.by_sum(), chord.other());
    let pick = |product: R, sum: R, other: R| {
        // From outside b is below zero, and the near root the one by the product.
        let far = chord.b.if_positive(product, sum);
        own.if_positive(other, inner.if_positive(far, product))
    };
    let (t, e) = (pick(product.0, sum.0, other.0), pick(product.1, sum.1, other.1));
    let (p, ep) = point(ray, t, (R::splat(TURNED) - ray.ed).if_positive(e, R::splat(f64::INFINITY)));
    // The gradient is of length 1 on the sphere.
    let twice = s.q + s.q;
    let n = p * twice + s.m;
    let en = twice * ep + R::splat(8.0 * R::U) * (twice * p.norm1() + s.m.norm1());
    SurfaceInteraction { p, ep, n: V3::if_positive(inner, -n, n), en }
}
