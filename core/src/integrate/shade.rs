//! How light falls where a ray meets a surface: in f64, the same operations for one lane or many, each value with a
//! bound on its error.

use crate::numeric::{Real, V3};
use crate::shapes::local::FAR;
use crate::shapes::{LEAST_SQUARE, Ray, SurfaceInteraction};

/// Bounds above this, as a share of one light's full effect on the pixel, ask for wide arithmetic:
/// a thirtieth of an 8-bit step, and errors are several times below their bounds.
pub(crate) const VALUE: f64 = 1.0 / (1u64 << 13) as f64;

/// Normals less sure than this ask for wide arithmetic whatever they contribute: rays mirrored there
/// would be in doubt about much of what they pass, and far beyond it the bounds' first-order terms
/// would no longer dominate.
pub(crate) const NORMAL: f64 = 1.0 / (1u64 << 11) as f64;

/// Surface interactions less sure than this, beside the scene's size and their distance, ask for it too: rays
/// that leave them would be in doubt about everything within that reach.
pub(crate) const PLACE: f64 = 1.0 / (1u64 << 14) as f64;

/// Cosines below this may be the rounding of 0: a light in the plane of a flat surface does not light it, and segments
/// to it would run along all edges in that plane.
pub(crate) const GRAZING: f64 = 1e-6;

/// n · l towards `light`; not above 0 where the light is behind the surface.
#[inline(always)]
pub(crate) fn cosine<R: Real>(interaction: &SurfaceInteraction<R>, light: V3<R>) -> R {
    let l = light - interaction.p;
    interaction.n.dot(l) / l.dot(l).sqrt()
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
