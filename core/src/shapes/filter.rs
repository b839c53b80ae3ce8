//! What all shapes have in common before rays in f32: a filter that never decides what it cannot prove, see
//! `traverse::packet` for its bounds.

use crate::numeric::V3;
use crate::simd::Floats;

/// The unit roundoff of f32.
pub(crate) const U32: f32 = f32::EPSILON / 2.0;

/// [e(0), e(1), e(2)] without a closure, which would not be compiled for the level's instructions.
macro_rules! each {
    ($k:ident => $e:expr) => {
        [
            {
                let $k = 0;
                $e
            },
            {
                let $k = 1;
                $e
            },
            {
                let $k = 2;
                $e
            },
        ]
    };
}
pub(crate) use each;

/// Rays as objects meet them: a lane each, or one in all lanes.
#[derive(Clone, Copy)]
pub(crate) struct Ray<F> {
    pub(crate) o: [F; 3],
    pub(crate) d: [F; 3],
    pub(crate) near: F,
    pub(crate) per: F,
    pub(crate) dd_inv: F,
    pub(crate) len: F,
    pub(crate) inv_len: F,
}

impl<F: Floats> Ray<F> {
    /// How far an object within `reach` of the origin may be misplaced.
    #[inline(always)]
    pub(crate) fn pos(&self, reach: F) -> F {
        self.per.fma(reach, self.near)
    }

    #[inline(always)]
    pub(crate) fn dot(a: [F; 3], b: &[F; 3]) -> F {
        a[0].fma(b[0], a[1].fma(b[1], a[2] * b[2]))
    }
}

/// Lanes that may meet an object, those that surely do, and where.
pub(crate) struct Intersection<F: Floats> {
    pub(crate) may: F::Mask,
    pub(crate) sure: F::Mask,
    pub(crate) lo: F,
    pub(crate) hi: F,
    pub(crate) inside: F::Mask,
}

/// |x| + |y| + |z|.
#[inline(always)]
pub(crate) fn norm1<F: Floats>(v: &[F; 3]) -> F {
    v[0].abs() + v[1].abs() + v[2].abs()
}

/// Rounded to f32.
pub(crate) fn single(v: V3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// Whether `x` is well within what f32 holds.
pub(crate) fn is_normal(x: f32) -> bool {
    x.abs() > 1e-30 && x.abs() < 1e30
}
