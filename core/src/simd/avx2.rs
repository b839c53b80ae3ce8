//! Vectors of AVX2 and FMA, sixteen and eight lanes in two registers.
//!
//! What the compiler makes of arrays is as quick where only arithmetic is done; but from comparisons it may take lanes
//! apart and put them together again, as it happens to see them.
//!
//! Every method is inlined into a function that `dispatch` compiled with AVX2 and FMA enabled and
//! calls only where the processor has them: that is the reason each `unsafe` here is sound.

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::arrays::packed;
use super::{F32x8, F32x16, F64x8, Floats, LANES, Mask, Simd};
use crate::numeric::{Real, U};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2;

impl Simd for Avx2 {
    type F32x16 = S16;
    type F32x8 = S8;
    type F64x8 = D8;
    #[inline(always)]
    fn narrow(low: D8, high: D8) -> S16 {
        let (D8([a, b]), D8([c, d])) = (low, high);
        // SAFETY: the processor has AVX2, see the module.
        S16(unsafe {
            [
                _mm256_set_m128(_mm256_cvtpd_ps(b), _mm256_cvtpd_ps(a)),
                _mm256_set_m128(_mm256_cvtpd_ps(d), _mm256_cvtpd_ps(c)),
            ]
        })
    }
    #[inline(always)]
    fn equal(x: &[u32; LANES], y: u32) -> Mask {
        let mut mask = 0;
        for k in [0, 8] {
            // SAFETY: as above; the array holds eight u32 from the k-th on.
            mask |= unsafe {
                let x = _mm256_loadu_si256(x.as_ptr().add(k).cast());
                let equal = _mm256_cmpeq_epi32(x, _mm256_set1_epi32(y as i32));
                (_mm256_movemask_ps(_mm256_castsi256_ps(equal)) as Mask) << k
            };
        }
        mask
    }
    #[inline(always)]
    fn compress(x: &[u32; 8], mask: u8) -> [u32; 8] {
        packed(x, mask)
    }
    #[inline(always)]
    fn put(x: &mut [u32; LANES], mask: Mask, y: u32) {
        for k in [0, 8] {
            // SAFETY: as above; the array has room for eight u32 from the k-th on.
            unsafe {
                let lanes = lanes((mask >> k) as u8);
                _mm256_maskstore_epi32(x.as_mut_ptr().add(k).cast(), lanes, _mm256_set1_epi32(y as i32));
            }
        }
    }
}

/// All bits of the lanes in `mask`.
#[inline(always)]
fn lanes(mask: u8) -> __m256i {
    // SAFETY: the processor has AVX2, see the module.
    unsafe {
        let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(mask.into()), bits), bits)
    }
}

#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct S16([__m256; 2]);

#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct S8([__m256; 1]);

#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct D8([__m256d; 2]);

/// An expression of each register of a value, or of each two of two. (Closures and iterators are not surely compiled for
/// AVX2.)
macro_rules! registers {
    ($x:ident = $a:expr => $e:expr) => {{
        let mut of = $a.0;
        for k in 0..of.len() {
            let $x = of[k];
            // SAFETY: the processor has AVX2 and FMA, see the module.
            of[k] = unsafe { $e };
        }
        Self(of)
    }};
    ($intrinsic:ident, $a:expr, $b:expr) => {{
        let mut of = $a.0;
        for k in 0..of.len() {
            // SAFETY: as above.
            of[k] = unsafe { $intrinsic(of[k], $b.0[k]) };
        }
        Self(of)
    }};
}

/// The lanes, as bits, in which the comparison `$compare` of `$a` with `$b` holds, `$lanes` in a register.
macro_rules! mask {
    ($mask:ty, $lanes:expr, $movemask:ident, $compare:expr, $a:expr, $b:expr) => {{
        let mut mask = 0;
        let (a, b) = ($a.0, $b.0);
        for k in 0..a.len() {
            // SAFETY: the processor has AVX2, see the module.
            mask |= unsafe { ($movemask($compare(a[k], b[k])) as $mask) << ($lanes * k) };
        }
        mask
    }};
}

macro_rules! binary {
    ($type:ident, $trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, b: Self) -> Self {
                registers!($intrinsic, self, b)
            }
        }
    };
}

binary!(S16, Add, add, _mm256_add_ps);
binary!(S16, Sub, sub, _mm256_sub_ps);
binary!(S16, Mul, mul, _mm256_mul_ps);
binary!(S8, Add, add, _mm256_add_ps);
binary!(S8, Sub, sub, _mm256_sub_ps);
binary!(S8, Mul, mul, _mm256_mul_ps);
binary!(D8, Add, add, _mm256_add_pd);
binary!(D8, Sub, sub, _mm256_sub_pd);
binary!(D8, Mul, mul, _mm256_mul_pd);
binary!(D8, Div, div, _mm256_div_pd);

macro_rules! floats {
    ($type:ident, $mask:ty, $registers:expr) => {
        impl Neg for $type {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                registers!(x = self => _mm256_xor_ps(x, _mm256_set1_ps(-0.0)))
            }
        }

        impl Floats for $type {
            type Mask = $mask;
            #[inline(always)]
            fn splat(x: f32) -> Self {
                // SAFETY: the processor has AVX2, see the module.
                Self([unsafe { _mm256_set1_ps(x) }; $registers])
            }
            #[inline(always)]
            fn fma(self, b: Self, c: Self) -> Self {
                let mut sum = c.0;
                for k in 0..$registers {
                    // SAFETY: the processor has FMA, see the module.
                    sum[k] = unsafe { _mm256_fmadd_ps(self.0[k], b.0[k], sum[k]) };
                }
                Self(sum)
            }
            #[inline(always)]
            fn recip(self) -> Self {
                registers!(x = self => _mm256_div_ps(_mm256_set1_ps(1.0), x))
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                registers!(x = self => _mm256_sqrt_ps(x))
            }
            #[inline(always)]
            fn abs(self) -> Self {
                registers!(x = self => _mm256_andnot_ps(_mm256_set1_ps(-0.0), x))
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                registers!(_mm256_max_ps, self, other)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                registers!(_mm256_min_ps, self, other)
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $mask {
                mask!($mask, 8, _mm256_movemask_ps, _mm256_cmp_ps::<_CMP_LT_OQ>, self, other)
            }
            #[inline(always)]
            fn le(self, other: Self) -> $mask {
                mask!($mask, 8, _mm256_movemask_ps, _mm256_cmp_ps::<_CMP_LE_OQ>, self, other)
            }
            #[inline(always)]
            fn select(self, mask: $mask, other: Self) -> Self {
                let mut of = other.0;
                for k in 0..$registers {
                    let lanes = lanes((mask >> (8 * k)) as u8);
                    // SAFETY: the processor has AVX2, see the module.
                    of[k] = unsafe { _mm256_blendv_ps(of[k], self.0[k], _mm256_castsi256_ps(lanes)) };
                }
                Self(of)
            }
        }
    };
}

floats!(S16, Mask, 2);
floats!(S8, u8, 1);

/// What `$choose` leaves of the lanes of a register.
macro_rules! chosen {
    ($choose:ident, $ss:ident, $x:expr) => {{
        // SAFETY: the processor has AVX2, see the module.
        unsafe {
            let x = $x;
            let x = $choose(_mm256_castps256_ps128(x), _mm256_extractf128_ps::<1>(x));
            let x = $choose(x, _mm_movehl_ps(x, x));
            _mm_cvtss_f32($ss(x, _mm_movehdup_ps(x)))
        }
    }};
}

impl F32x16 for S16 {
    #[inline(always)]
    fn load(x: &[f32; LANES]) -> Self {
        // SAFETY: the processor has AVX2, see the module; the array holds sixteen f32.
        Self(unsafe { [_mm256_loadu_ps(x.as_ptr()), _mm256_loadu_ps(x.as_ptr().add(8))] })
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; LANES]) {
        // SAFETY: as above; the array has room for sixteen f32.
        unsafe {
            _mm256_storeu_ps(to.as_mut_ptr(), self.0[0]);
            _mm256_storeu_ps(to.as_mut_ptr().add(8), self.0[1]);
        }
    }
    #[inline(always)]
    fn least(self) -> f32 {
        chosen!(_mm_min_ps, _mm_min_ss, _mm256_min_ps(self.0[0], self.0[1]))
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        chosen!(_mm_max_ps, _mm_max_ss, _mm256_max_ps(self.0[0], self.0[1]))
    }
}

impl F32x8 for S8 {
    #[inline(always)]
    fn load(x: &[f32; 8]) -> Self {
        // SAFETY: the processor has AVX2, see the module; the array holds eight f32.
        Self(unsafe { [_mm256_loadu_ps(x.as_ptr())] })
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; 8]) {
        // SAFETY: as above; the array has room for eight f32.
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0[0]) }
    }
}

impl Neg for D8 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        registers!(x = self => _mm256_xor_pd(x, _mm256_set1_pd(-0.0)))
    }
}

impl Real for D8 {
    const U: f64 = U;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        // SAFETY: the processor has AVX2, see the module.
        Self([unsafe { _mm256_set1_pd(x) }; 2])
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        registers!(x = self => _mm256_sqrt_pd(x))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        registers!(x = self => _mm256_andnot_pd(_mm256_set1_pd(-0.0), x))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        registers!(_mm256_max_pd, self, other)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        registers!(_mm256_min_pd, self, other)
    }
    #[inline(always)]
    fn if_positive(self, a: Self, b: Self) -> Self {
        let mut of = b.0;
        for k in 0..2 {
            // SAFETY: the processor has AVX2, see the module.
            of[k] = unsafe {
                let positive = _mm256_cmp_pd::<_CMP_GT_OQ>(self.0[k], _mm256_setzero_pd());
                _mm256_blendv_pd(of[k], a.0[k], positive)
            };
        }
        Self(of)
    }
}

impl F64x8 for D8 {
    #[inline(always)]
    fn load(x: &[f64; 8]) -> Self {
        // SAFETY: the processor has AVX2, see the module; the array holds eight f64.
        Self(unsafe { [_mm256_loadu_pd(x.as_ptr()), _mm256_loadu_pd(x.as_ptr().add(4))] })
    }
    #[inline(always)]
    fn store(self, to: &mut [f64; 8]) {
        // SAFETY: as above; the array has room for eight f64.
        unsafe {
            _mm256_storeu_pd(to.as_mut_ptr(), self.0[0]);
            _mm256_storeu_pd(to.as_mut_ptr().add(4), self.0[1]);
        }
    }
    #[inline(always)]
    fn positive(self) -> u8 {
        mask!(u8, 4, _mm256_movemask_pd, _mm256_cmp_pd::<_CMP_GT_OQ>, self, Self::splat(0.0))
    }
    #[inline(always)]
    fn le(self, other: Self) -> u8 {
        mask!(u8, 4, _mm256_movemask_pd, _mm256_cmp_pd::<_CMP_LE_OQ>, self, other)
    }
    #[inline(always)]
    fn compress(self, mask: u8) -> Self {
        let mut lanes = [0.0; 8];
        self.store(&mut lanes);
        Self::load(&packed(&lanes, mask))
    }
}
