//! Where a ray meets what it is known to meet, and how light falls there: in f64, the same
//! operations for one lane or many, each value with a bound on its error.

use crate::numeric::{Real, U, V3};
use crate::shapes::local::FAR;
use crate::shapes::plane::LocalPlane;
use crate::shapes::sphere::LocalSphere;
use crate::shapes::sphere::giant::GiantSphere;
use crate::shapes::triangle::LocalTriangle;
use crate::shapes::{LEAST_SQUARE, Ray, plane, sphere, triangle};

/// Bounds above this, as a share of one light's full effect on the pixel, ask for wide arithmetic:
/// a thirtieth of an 8-bit step, and errors are several times below their bounds.
pub(crate) const VALUE: f64 = 1.0 / (1u64 << 13) as f64;

/// Normals less sure than this ask for wide arithmetic whatever they contribute: rays mirrored there
/// would be in doubt about much of what they pass, and far beyond it the bounds' first-order terms
/// would no longer dominate.
pub(crate) const NORMAL: f64 = 1.0 / (1u64 << 11) as f64;

/// SurfaceInteractions less sure than this, beside the scene's size and their distance, ask for it too: rays
/// that leave them would be in doubt about everything within that reach.
pub(crate) const PLACE: f64 = 1.0 / (1u64 << 14) as f64;

/// A point of a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfaceInteraction<R = f64> {
    pub(crate) p: V3<R>,
    /// Bound on |p − p*|.
    pub(crate) ep: R,
    /// Unit normal on the side the ray strikes.
    pub(crate) n: V3<R>,
    /// Bound on |n − n*|.
    pub(crate) en: R,
}

/// The normal's bound of a [rounded](SurfaceInteraction::rounded) place; others are greater.
pub(crate) const TAKEN: f64 = 2.0 * U;

impl SurfaceInteraction {
    /// The rounded place, and the rounded normal there.
    pub(crate) fn rounded(p: V3<f64>, n: V3<f64>) -> Self {
        Self { p, ep: 2.0 * U * p.norm1(), n, en: TAKEN }
    }

    /// The same, taken to be as right as a rounded place can be; whether it is or not.
    pub(crate) fn taken_as_it_is(self) -> Self {
        Self::rounded(self.p, self.n)
    }
}

#[inline(always)]
fn point<R: Real>(ray: &Ray<R>, t: R, et: R) -> (V3<R>, R) {
    let p = ray.o + ray.d * t;
    let travel = t.abs() * ray.len;
    let ep = et * ray.len + ray.eo + travel * ray.ed + R::splat(8.0 * R::U) * (ray.o.norm1() + travel);
    (p, ep)
}

/// `n`, turned against the ray.
#[inline(always)]
fn against<R: Real>(ray: &Ray<R>, n: V3<R>) -> V3<R> {
    V3::if_positive(n.dot(ray.d), -n, n)
}

#[inline(always)]
pub(crate) fn on_plane<R: Real>(ray: &Ray<R>, plane: &LocalPlane<R>) -> SurfaceInteraction<R> {
    let (t, et) = plane::distance(ray, plane);
    let (p, ep) = point(ray, t, et);
    SurfaceInteraction { p, ep, n: against(ray, plane.n), en: R::splat(4.0 * R::U) }
}

#[inline(always)]
pub(crate) fn on_triangle<R: Real>(ray: &Ray<R>, tri: &LocalTriangle<R>) -> SurfaceInteraction<R> {
    let f = triangle::forms(ray, tri);
    let nn = f.n.dot(f.n);
    let length = nn.sqrt();
    let (p, ep) = point(ray, f.t, f.et);
    // A corner moved turns the normal by as much over the triangle's height.
    let en = (f.corner_error * f.longest * R::splat(4.0) + R::splat(16.0 * R::U) * f.longest * f.longest) / length;
    // A square that is next to nothing has lost its digits.
    let en = (nn - R::splat(LEAST_SQUARE)).if_positive(en, R::splat(f64::INFINITY));
    SurfaceInteraction { p, ep, n: against(ray, f.n * (R::splat(1.0) / length)), en }
}

/// `inner` > 0 where the inner side is struck, `own` > 0 where the ray starts on this sphere.
#[inline(always)]
pub(crate) fn on_sphere<R: Real>(ray: &Ray<R>, s: &LocalSphere<R>, inner: R, own: R) -> SurfaceInteraction<R> {
    let (near, far, e) = sphere::distances(ray, s);
    let (other, e_other) = sphere::other_root(ray, s);
    let t = own.if_positive(other, inner.if_positive(far, near));
    let (p, ep) = point(ray, t, own.if_positive(e_other, e));
    let n = (p - s.c) * (R::splat(1.0) / s.r);
    let en = (ep + R::splat(2.0 * R::U) * s.c.norm1()) / s.r + R::splat(8.0 * R::U);
    SurfaceInteraction { p, ep, n: V3::if_positive(inner, -n, n), en }
}

/// The same on a sphere described around the eye.
#[inline(always)]
pub(crate) fn on_giant_sphere<R: Real>(ray: &Ray<R>, s: &GiantSphere<R>, inner: R, own: R) -> SurfaceInteraction<R> {
    let (t, et) = sphere::giant::distance(ray, s, inner, own);
    let (p, ep) = point(ray, t, et);
    let (n, en) = sphere::giant::normal(s, p, ep);
    SurfaceInteraction { p, ep, n: V3::if_positive(inner, -n, n), en }
}

/// Light from `light` at `place`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Incidence<R> {
    /// n · l; not above 0 where the light is behind the surface.
    pub(crate) cosine: R,
    /// From the place to the light.
    pub(crate) l: V3<R>,
}

#[inline(always)]
pub(crate) fn incidence<R: Real>(interaction: &SurfaceInteraction<R>, light: V3<R>) -> Incidence<R> {
    let l = light - interaction.p;
    Incidence { cosine: interaction.n.dot(l) / l.dot(l).sqrt(), l }
}

/// The squared distance to `light`, or `least` where that is less.
#[inline(always)]
pub(crate) fn nearer<R: Real>(least: R, interaction: &SurfaceInteraction<R>, light: V3<R>) -> R {
    let l = light - interaction.p;
    l.dot(l).min(least)
}

/// Above 0, or NaN, where the values at `place` may be too far from the real ones: the cosine
/// towards a light is off by at most en + ep/distance, which matters as far as `throughput`, what
/// the path has left of the light, lets it. `nearest` is the squared distance to the nearest light.
#[inline(always)]
pub(crate) fn excess<R: Real>(interaction: &SurfaceInteraction<R>, nearest: R, throughput: R) -> R {
    // Where there is no light, any distance will do.
    let distance = nearest.min(R::splat(f64::MAX)).sqrt();
    let effect = throughput * (interaction.ep + interaction.en * distance) - R::splat(VALUE) * distance;
    let stray = interaction.ep - R::splat(PLACE) * (R::splat(1.0) + interaction.p.norm1());
    let (bent, near) = (interaction.en - R::splat(NORMAL), R::splat(LEAST_SQUARE) - nearest);
    // In this order, a maximum keeps what is not a number, and so does a sum.
    let zero = R::splat(0.0);
    zero.max(effect)
        + zero.max(stray)
        + (zero.max(bent) + zero.max(near))
        + zero.max(interaction.p.norm1() - R::splat(FAR))
}

/// The segment from `place` to `light` as a ray of length 1.
#[inline(always)]
pub(crate) fn towards<R: Real>(interaction: &SurfaceInteraction<R>, light: V3<R>, l: V3<R>) -> Ray<R> {
    let el = R::splat(2.0 * R::U) * (light.norm1() + l.norm1()) / l.dot(l).sqrt();
    Ray::new(interaction.p, l, interaction.ep, el)
}

/// The mirrored ray.
///
/// Of two unit normals Δ apart, Δ is square to them but for Δ²/2. So −2(n·d)Δ and −2(Δ·d)n, the two
/// changes of d', are square to each other, and together 2|Δ||d|(1 + |Δ|): with |Δ| below
/// [`NORMAL`], beyond which places are refined, less than 2.01·en. A direction's own error is turned,
/// not enlarged.
#[inline(always)]
pub(crate) fn reflect<R: Real>(ray: &Ray<R>, interaction: &SurfaceInteraction<R>) -> Ray<R> {
    let d = ray.d - interaction.n * (R::splat(2.0) * ray.d.dot(interaction.n));
    let ed = (ray.ed + R::splat(2.01) * interaction.en) * R::splat(1.0 + 1e-6) + R::splat(24.0 * R::U);
    Ray::new(interaction.p, d, interaction.ep, ed)
}
