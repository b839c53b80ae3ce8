//! Spheres and triangles far larger than what is seen of them, described around the eye.
//!
//! A planet's centre is so far below the eye that its rounding alone is more than what lies on the planet; so are the
//! corners of a needle beside its width. What matters of such objects is near the origin of local space, the eye.
//! There a sphere is F(P) = q·P² + m·P + k = 0, with q = 1/2r, m = −c/r and k = (c² − r²)/2r, and F's gradient
//! 2q·P + m is its unit normal; a triangle is n·P = h with linear functions u·P + u0 and v·P + v0 for the weights of
//! its second and third corner. These numbers are found exactly and rounded once each, so that what they
//! misplace is a share of the distance from the eye, and not of the object's size.
//!
//! **Bound.** Every number here is within u of itself. With G = |m| + 2q(|o| + eo), which bounds the gradient at
//! the start: the sphere's C = F(o) is off by at most eo·G + 10u(q·o² + |m||o| + |k|), B = d·(2q·o + m) by
//! |d|((ed + 8u)·G + 2q·eo), A = q·d² by 2.2·ed + 8u of itself. The triangle's plane is one of
//! [`super::plane`]; a point that is off by ep has weights that are off by
//! (|u| + |v|)·ep + 8u((|u| + |v|)|P| + |u0| + |v0| + 1).

use super::plane::{self, LocalPlane};
use super::real::{Real, Scalar, V3};
use super::{Ray, Span, TINY};

/// A sphere around the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GiantSphere<R = f64> {
    pub(crate) m: V3<R>,
    pub(crate) q: R,
    pub(crate) k: R,
}

/// A triangle around the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GiantTriangle {
    pub(crate) plane: LocalPlane,
    pub(crate) u: V3<f64>,
    pub(crate) u0: f64,
    pub(crate) v: V3<f64>,
    pub(crate) v0: f64,
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
pub(crate) fn test_sphere<R: Scalar>(ray: &Ray<R>, s: &GiantSphere<R>) -> Option<Span<R>> {
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
pub(crate) fn test_sphere_from_inside<R: Scalar>(ray: &Ray<R>, s: &GiantSphere<R>) -> Option<Span<R>> {
    let zero = R::splat(0.0);
    let (t, e) = Chord::new(ray, s).other();
    let known = ray.ed < R::splat(TURNED) && e < R::splat(f64::INFINITY);
    let (lo, hi) = if known { ((t - e).max(zero), t + e) } else { (zero, R::splat(f64::INFINITY)) };
    Some(Span { lo, hi, sure: known, inside: true })
}

/// The distance at which the sphere is known to be met, and its bound: of the near root, or of the far one where
/// `inner` > 0, or of the one that is not the start where `own` > 0.
#[inline(always)]
pub(crate) fn distance<R: Real>(ray: &Ray<R>, s: &GiantSphere<R>, inner: R, own: R) -> (R, R) {
    let chord = Chord::new(ray, s);
    let (product, sum, other) = (chord.by_product(), chord.by_sum(), chord.other());
    let pick = |product: R, sum: R, other: R| {
        // From outside b is below zero, and the near root the one by the product.
        let far = chord.b.if_positive(product, sum);
        own.if_positive(other, inner.if_positive(far, product))
    };
    let (t, e) = (pick(product.0, sum.0, other.0), pick(product.1, sum.1, other.1));
    (t, (R::splat(TURNED) - ray.ed).if_positive(e, R::splat(f64::INFINITY)))
}

/// The unit normal at `p`, which may be misplaced by `ep`, and the normal's bound.
#[inline(always)]
pub(crate) fn normal<R: Real>(s: &GiantSphere<R>, p: V3<R>, ep: R) -> (V3<R>, R) {
    let twice = s.q + s.q;
    let n = p * twice + s.m;
    (n, twice * ep + R::splat(8.0 * R::U) * (twice * p.norm1() + s.m.norm1()))
}

/// Where the ray surely meets the triangle or surely does not; `Err` where these numbers do not tell.
pub(crate) fn test_triangle(ray: &Ray, tri: &GiantTriangle) -> Result<Option<Span>, Unsure> {
    let (t, et) = plane::distance(ray, &tri.plane);
    if !(et < f64::INFINITY) {
        return Err(Unsure);
    }
    let p = ray.o + ray.d * t;
    let travel = t.abs() * ray.len;
    let ep = et * ray.len + ray.eo + travel * ray.ed + 8.0 * f64::U * (ray.o.norm1() + travel);
    let (u, v) = (tri.u.dot(p) + tri.u0, tri.v.dot(p) + tri.v0);
    let slope = tri.u.norm1() + tri.v.norm1();
    let e = slope * ep + 8.0 * f64::U * (slope * p.norm1() + tri.u0.abs() + tri.v0.abs() + 1.0) + TINY;
    let least = u.min(v).min(1.0 - u - v);
    if least < -e {
        return Ok(None);
    }
    let span = Span::around(t, et, false);
    match span {
        Some(span) if span.sure && !(least > e) => Err(Unsure),
        Some(span) if !span.sure => Err(Unsure),
        span => Ok(span),
    }
}

/// These numbers do not tell.
pub(crate) struct Unsure;
