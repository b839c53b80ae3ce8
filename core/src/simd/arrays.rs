//! Vectors as arrays, of which the compiler makes what there is.
//!
//! With loops, not `from_fn`: that is not surely compiled into the code of the level that calls it,
//! and then for none.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{F32x8, F32x16, F64x8, Floats, LANES, Mask, Simd};
use crate::numeric::{Real, U};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Arrays;

impl Simd for Arrays {
    type F32x16 = S16;
    type F32x8 = S8;
    type F64x8 = D8;
    #[inline(always)]
    fn narrow(low: D8, high: D8) -> S16 {
        let mut to = [0.0; LANES];
        for k in 0..8 {
            to[k] = low.0[k] as f32;
            to[k + 8] = high.0[k] as f32;
        }
        S16(to)
    }
    #[inline(always)]
    fn equal(x: &[u32; LANES], y: u32) -> Mask {
        mask16(|k| x[k] == y)
    }
    #[inline(always)]
    fn compress(x: &[u32; 8], mask: u8) -> [u32; 8] {
        packed(x, mask)
    }
    #[inline(always)]
    fn put(x: &mut [u32; LANES], mask: Mask, y: u32) {
        for (k, x) in x.iter_mut().enumerate() {
            if mask >> k & 1 == 1 {
                *x = y;
            }
        }
    }
}

#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct S16([f32; LANES]);

#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
pub(crate) struct S8([f32; 8]);

#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct D8([f64; 8]);

macro_rules! lanewise {
    ($type:ident, $trait:ident, $method:ident, $op:tt) => {
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(mut self, b: Self) -> Self {
                for (x, y) in self.0.iter_mut().zip(b.0) {
                    *x $op y;
                }
                self
            }
        }
    };
}

lanewise!(S16, Add, add, +=);
lanewise!(S16, Sub, sub, -=);
lanewise!(S16, Mul, mul, *=);
lanewise!(S8, Add, add, +=);
lanewise!(S8, Sub, sub, -=);
lanewise!(S8, Mul, mul, *=);
lanewise!(D8, Add, add, +=);
lanewise!(D8, Sub, sub, -=);
lanewise!(D8, Mul, mul, *=);
lanewise!(D8, Div, div, /=);

impl Neg for D8 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

#[inline(always)]
fn mask16(f: impl Fn(usize) -> bool) -> Mask {
    let mut m = 0;
    for k in 0..LANES {
        m |= Mask::from(f(k)) << k;
    }
    m
}

#[inline(always)]
fn mask8(f: impl Fn(usize) -> bool) -> u8 {
    let mut m = 0;
    for k in 0..8 {
        m |= u8::from(f(k)) << k;
    }
    m
}

/// The elements of `x` in `mask`, moved to the front; zeros follow.
#[inline(always)]
pub(super) fn packed<T: Copy + Default>(x: &[T; 8], mask: u8) -> [T; 8] {
    let (mut to, mut at) = ([T::default(); 8], 0);
    for k in 0..8 {
        // What is not in the mask is overwritten by the next, or by zero.
        to[at] = if mask >> k & 1 == 1 { x[k] } else { T::default() };
        at = (at + usize::from(mask >> k & 1)).min(7);
    }
    to
}

/// What `choose` leaves of sixteen, by halves as vectors do it.
#[inline(always)]
fn choose(x: [f32; LANES], choose: impl Fn(f32, f32) -> f32) -> f32 {
    let (mut eight, mut four) = ([0.0; 8], [0.0; 4]);
    for k in 0..8 {
        eight[k] = choose(x[k], x[k + 8]);
    }
    for k in 0..4 {
        four[k] = choose(eight[k], eight[k + 4]);
    }
    choose(choose(four[0], four[2]), choose(four[1], four[3]))
}

/// The greater in each lane; `b` where either is NaN.
#[inline(always)]
fn greater<T: Copy + PartialOrd, const N: usize>(mut a: [T; N], b: [T; N]) -> [T; N] {
    for k in 0..N {
        a[k] = if a[k] > b[k] { a[k] } else { b[k] };
    }
    a
}

/// The lesser in each lane; `b` where either is NaN.
#[inline(always)]
fn lesser<T: Copy + PartialOrd, const N: usize>(mut a: [T; N], b: [T; N]) -> [T; N] {
    for k in 0..N {
        a[k] = if a[k] < b[k] { a[k] } else { b[k] };
    }
    a
}

macro_rules! floats {
    ($type:ident, $lanes:expr, $mask:ty, $bits:ident) => {
        impl Neg for $type {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self(self.0.map(|x| -x))
            }
        }

        impl Floats for $type {
            type Mask = $mask;
            #[inline(always)]
            fn splat(x: f32) -> Self {
                Self([x; $lanes])
            }
            #[inline(always)]
            fn fma(self, b: Self, c: Self) -> Self {
                self * b + c
            }
            #[inline(always)]
            fn recip(self) -> Self {
                Self(self.0.map(|x| 1.0 / x))
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                Self(self.0.map(f32::sqrt))
            }
            #[inline(always)]
            fn abs(self) -> Self {
                Self(self.0.map(f32::abs))
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                Self(greater(self.0, other.0))
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                Self(lesser(self.0, other.0))
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $mask {
                $bits(|k| self.0[k] < other.0[k])
            }
            #[inline(always)]
            fn le(self, other: Self) -> $mask {
                $bits(|k| self.0[k] <= other.0[k])
            }
            #[inline(always)]
            fn select(mut self, mask: $mask, other: Self) -> Self {
                for k in 0..$lanes {
                    self.0[k] = if mask >> k & 1 == 1 { self.0[k] } else { other.0[k] };
                }
                self
            }
        }
    };
}

floats!(S16, LANES, Mask, mask16);
floats!(S8, 8, u8, mask8);

impl F32x16 for S16 {
    #[inline(always)]
    fn load(x: &[f32; LANES]) -> Self {
        Self(*x)
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; LANES]) {
        *to = self.0;
    }
    #[inline(always)]
    fn least(self) -> f32 {
        choose(self.0, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        choose(self.0, |a, b| if a > b { a } else { b })
    }
}

impl F32x8 for S8 {
    #[inline(always)]
    fn load(x: &[f32; 8]) -> Self {
        Self(*x)
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; 8]) {
        *to = self.0;
    }
}

impl Real for D8 {
    const U: f64 = U;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([x; 8])
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f64::sqrt))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(f64::abs))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(greater(self.0, other.0))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(lesser(self.0, other.0))
    }
    #[inline(always)]
    fn if_positive(self, mut a: Self, b: Self) -> Self {
        for k in 0..8 {
            a.0[k] = if self.0[k] > 0.0 { a.0[k] } else { b.0[k] };
        }
        a
    }
}

impl F64x8 for D8 {
    #[inline(always)]
    fn load(x: &[f64; 8]) -> Self {
        Self(*x)
    }
    #[inline(always)]
    fn store(self, to: &mut [f64; 8]) {
        *to = self.0;
    }
    #[inline(always)]
    fn positive(self) -> u8 {
        mask8(|k| self.0[k] > 0.0)
    }
    #[inline(always)]
    fn le(self, other: Self) -> u8 {
        mask8(|k| self.0[k] <= other.0[k])
    }
    #[inline(always)]
    fn compress(self, mask: u8) -> Self {
        Self(packed(&self.0, mask))
    }
}
