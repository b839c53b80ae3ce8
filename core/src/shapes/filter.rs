//! What all shapes have in common before rays in f32: a filter that never decides what it cannot prove, see
//! `traverse::packet` for its bounds.

use std::fmt::Debug;

use super::giants::{List, MayBeGiant};
use super::leaves::Leaves;
use super::{Local, Shape};
use crate::bvh::{Bvh, Coordinate};
use crate::numeric::V3;
use crate::scene::Scene;
use crate::simd::{F32x8, Floats, MOST, Rows};

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

/// A shape that leaves hold, each object as `N` numbers.
pub(crate) trait InLeaves<const N: usize>: Shape + MayBeGiant {
    /// Those numbers in lanes, all of one object or each of its own.
    type Lanes<F: Floats>;

    /// A giant in f32.
    type Giant32: Debug + Sync;

    /// The numbers of what no ray meets; the last stands for the id.
    const NEVER: [f32; N];

    /// The numbers of the object, which is the `i`-th of its shape; the last is `id`, its id as a number.
    fn row(&self, i: usize, local: &Local, id: f32) -> [f32; N];

    fn load<F: Floats>(numbers: &impl Numbers<F>) -> Self::Lanes<F>;

    /// What rays of `mask` meet of objects that they do not start on.
    fn intersect<F: Floats>(r: &Ray<F>, object: &Self::Lanes<F>, mask: F::Mask) -> Intersection<F>;

    /// What was found of an object, where rays `within` start on its inner side; asked only of what has an inside.
    #[inline(always)]
    fn from_inside<F: Floats>(
        _: &Ray<F>,
        _: &Self::Lanes<F>,
        _within: F::Mask,
        found: Intersection<F>,
    ) -> Intersection<F> {
        found
    }

    /// The giant, where f32 holds its numbers.
    fn single(giant: &Self::Giant) -> Option<Self::Giant32>;

    /// What rays, whose directions are off by `ed`, meet of a giant.
    fn intersect_giant<F: Floats>(r: &Ray<F>, giant: &Self::Giant32, ed: F, mask: F::Mask) -> Intersection<F>;
}

/// Numbers of objects, as lanes read them.
pub(crate) trait Numbers<F> {
    /// The `k`-th.
    fn number(&self, k: usize) -> F;
}

/// Of one object of a leaf, in all lanes.
pub(crate) struct One<'a, const N: usize>(pub(crate) &'a Rows<'a, N>, pub(crate) usize);

impl<F: Floats, const N: usize> Numbers<F> for One<'_, N> {
    #[inline(always)]
    fn number(&self, k: usize) -> F {
        F::splat(self.0.at(k, self.1))
    }
}

/// The same, out of rows that are spread.
pub(crate) struct OneOf<'a, const N: usize>(pub(crate) &'a [[f32; MOST]; N], pub(crate) usize);

impl<F: Floats, const N: usize> Numbers<F> for OneOf<'_, N> {
    #[inline(always)]
    fn number(&self, k: usize) -> F {
        F::splat(self.0[k][self.1 % MOST])
    }
}

/// Of all objects of a leaf, one in each lane.
impl<F: F32x8, const N: usize> Numbers<F> for Rows<'_, N> {
    #[inline(always)]
    fn number(&self, k: usize) -> F {
        F::load(self.row(k))
    }
}

/// The objects of a shape in leaves, and those of them that are far larger than what is seen of them.
#[derive(Debug)]
pub(crate) struct Column<O: InLeaves<N>, const N: usize> {
    pub(crate) leaves: Leaves<N>,
    /// With their ids. What stands for them in leaves is never met.
    pub(crate) giants: Vec<(u32, O::Giant32)>,
}

impl<O: InLeaves<N>, const N: usize> Column<O, N> {
    pub(super) fn new(scene: &Scene, local: &Local, bvh: &Bvh<f32>, giants: &List<O::Giant>) -> Self {
        let first = O::first(scene);
        // Of giants that f32 does not hold, nothing is sure in leaves.
        let giants: Vec<_> = giants.iter().filter_map(|(i, giant)| Some((first + i, O::single(giant)?))).collect();
        let row = |id: u32| {
            if giants.iter().any(|(giant, _)| *giant == id) {
                let mut never = O::NEVER;
                never[N - 1] = f32::from_tag(id);
                return never;
            }
            let i = (id - first) as usize;
            O::all(scene)[i].row(i, local, f32::from_tag(id))
        };
        Self { leaves: Leaves::new(bvh, O::LEAF, row), giants }
    }
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
