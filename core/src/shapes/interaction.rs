//! Where a ray meets what it is known to meet: in f64, the same operations for one lane or many, each value with a
//! bound on its error.

use super::Ray;
use crate::numeric::{Real, U, V3};
use crate::simd::{F64x8, Simd};

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

impl<R: Real> SurfaceInteraction<R> {
    /// In each lane the one of two that is less misplaced; `b` where that cannot be told.
    #[inline(always)]
    pub(crate) fn better(a: Self, b: Self) -> Self {
        let better = b.ep - a.ep;
        Self {
            p: V3::if_positive(better, a.p, b.p),
            ep: better.if_positive(a.ep, b.ep),
            n: V3::if_positive(better, a.n, b.n),
            en: better.if_positive(a.en, b.en),
        }
    }
}

/// The point of the ray at `t`, which is off by `et`, and the bound on how far it is misplaced.
#[inline(always)]
pub(super) fn point<R: Real>(ray: &Ray<R>, t: R, et: R) -> (V3<R>, R) {
    let p = ray.o + ray.d * t;
    let travel = t.abs() * ray.len;
    let ep = et * ray.len + ray.eo + travel * ray.ed + R::splat(8.0 * R::U) * (ray.o.norm1() + travel);
    (p, ep)
}

/// `n`, turned against the ray.
#[inline(always)]
pub(super) fn against<R: Real>(ray: &Ray<R>, n: V3<R>) -> V3<R> {
    V3::if_positive(n.dot(ray.d), -n, n)
}

/// `N` numbers of each of eight objects, in lanes; `numbers` gives those of the object at one of `places`.
#[inline(always)]
pub(super) fn lanes<S: Simd, const N: usize>(
    places: &[usize; 8],
    numbers: impl Fn(usize) -> [f64; N],
) -> [S::F64x8; N] {
    let mut rows = [[0.0; 8]; N];
    for k in 0..8 {
        let of_one = numbers(places[k]);
        for row in 0..N {
            rows[row][k] = of_one[row];
        }
    }
    let mut lanes = [S::F64x8::splat(0.0); N];
    for k in 0..N {
        lanes[k] = S::F64x8::load(&rows[k]);
    }
    lanes
}
