//! Vectors of AVX-512.
//!
//! Every method is inlined into a function that `dispatch` compiled with AVX-512 enabled and
//! calls only where the processor has it: that is the reason each `unsafe` here is sound.

use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{F32x8, F32x16, F64x8, Floats, LANES, Mask, Simd};
use crate::numeric::{Real, U};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx512;

impl Simd for Avx512 {
    type F32x16 = S16;
    type F32x8 = S8;
    type F64x8 = D8;
    #[inline(always)]
    fn narrow(low: D8, high: D8) -> S16 {
        // SAFETY: the processor has AVX-512, see the module.
        S16(unsafe {
            let low = _mm512_castps256_ps512(_mm512_cvtpd_ps(low.0));
            _mm512_insertf32x8::<1>(low, _mm512_cvtpd_ps(high.0))
        })
    }
    #[inline(always)]
    fn equal(x: &[u32; LANES], y: u32) -> Mask {
        // SAFETY: as above; the array holds sixteen u32.
        unsafe { _mm512_cmpeq_epi32_mask(_mm512_loadu_si512(x.as_ptr().cast()), _mm512_set1_epi32(y as i32)) }
    }
    #[inline(always)]
    fn compress(x: &[u32; 8], mask: u8) -> [u32; 8] {
        let mut to = [0; 8];
        // SAFETY: as above; both arrays hold eight u32.
        unsafe {
            let packed = _mm256_maskz_compress_epi32(mask, _mm256_loadu_si256(x.as_ptr().cast()));
            _mm256_storeu_si256(to.as_mut_ptr().cast(), packed);
        }
        to
    }
    #[inline(always)]
    fn put(x: &mut [u32; LANES], mask: Mask, y: u32) {
        // SAFETY: as above; the array has room for sixteen u32.
        unsafe { _mm512_mask_storeu_epi32(x.as_mut_ptr().cast(), mask, _mm512_set1_epi32(y as i32)) }
    }
}

#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct S16(__m512);

#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct S8(__m256);

#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct D8(__m512d);

macro_rules! binary {
    ($type:ident, $trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $method(self, b: Self) -> Self {
                // SAFETY: the processor has AVX-512, see the module.
                Self(unsafe { $intrinsic(self.0, b.0) })
            }
        }
    };
}

binary!(S16, Add, add, _mm512_add_ps);
binary!(S16, Sub, sub, _mm512_sub_ps);
binary!(S16, Mul, mul, _mm512_mul_ps);
binary!(S8, Add, add, _mm256_add_ps);
binary!(S8, Sub, sub, _mm256_sub_ps);
binary!(S8, Mul, mul, _mm256_mul_ps);
binary!(D8, Add, add, _mm512_add_pd);
binary!(D8, Sub, sub, _mm512_sub_pd);
binary!(D8, Mul, mul, _mm512_mul_pd);
binary!(D8, Div, div, _mm512_div_pd);

impl Neg for D8 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: the processor has AVX-512, see the module.
        Self(unsafe { _mm512_xor_pd(self.0, _mm512_set1_pd(-0.0)) })
    }
}

macro_rules! floats {
    (
        $type:ident, $mask:ty, $set1:ident, $xor:ident, $fmadd:ident, $div:ident, $sqrt:ident, $andnot:ident,
        $max:ident, $min:ident, $cmp:ident, $blend:ident
    ) => {
        impl Neg for $type {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                // SAFETY: the processor has AVX-512, see the module.
                Self(unsafe { $xor(self.0, $set1(-0.0)) })
            }
        }

        impl Floats for $type {
            type Mask = $mask;
            #[inline(always)]
            fn splat(x: f32) -> Self {
                // SAFETY: the processor has AVX-512, see the module.
                Self(unsafe { $set1(x) })
            }
            #[inline(always)]
            fn fma(self, b: Self, c: Self) -> Self {
                // SAFETY: the processor has AVX-512, see the module.
                Self(unsafe { $fmadd(self.0, b.0, c.0) })
            }
            #[inline(always)]
            fn recip(self) -> Self {
                // SAFETY: the processor has AVX-512, see the module.
                Self(unsafe { $div($set1(1.0), self.0) })
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                // SAFETY: the processor has AVX-512, see the module.
                Self(unsafe { $sqrt(self.0) })
            }
            #[inline(always)]
            fn abs(self) -> Self {
                // SAFETY: the processor has AVX-512, see the module.
                Self(unsafe { $andnot($set1(-0.0), self.0) })
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                // SAFETY: the processor has AVX-512, see the module.
                Self(unsafe { $max(self.0, other.0) })
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                // SAFETY: the processor has AVX-512, see the module.
                Self(unsafe { $min(self.0, other.0) })
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $mask {
                // SAFETY: the processor has AVX-512, see the module.
                unsafe { $cmp::<_CMP_LT_OQ>(self.0, other.0) }
            }
            #[inline(always)]
            fn le(self, other: Self) -> $mask {
                // SAFETY: the processor has AVX-512, see the module.
                unsafe { $cmp::<_CMP_LE_OQ>(self.0, other.0) }
            }
            #[inline(always)]
            fn select(self, mask: $mask, other: Self) -> Self {
                // SAFETY: the processor has AVX-512, see the module.
                Self(unsafe { $blend(mask, other.0, self.0) })
            }
        }
    };
}

floats!(
    S16,
    Mask,
    _mm512_set1_ps,
    _mm512_xor_ps,
    _mm512_fmadd_ps,
    _mm512_div_ps,
    _mm512_sqrt_ps,
    _mm512_andnot_ps,
    _mm512_max_ps,
    _mm512_min_ps,
    _mm512_cmp_ps_mask,
    _mm512_mask_blend_ps
);
floats!(
    S8,
    u8,
    _mm256_set1_ps,
    _mm256_xor_ps,
    _mm256_fmadd_ps,
    _mm256_div_ps,
    _mm256_sqrt_ps,
    _mm256_andnot_ps,
    _mm256_max_ps,
    _mm256_min_ps,
    _mm256_cmp_ps_mask,
    _mm256_mask_blend_ps
);

impl F32x16 for S16 {
    #[inline(always)]
    fn load(x: &[f32; LANES]) -> Self {
        // SAFETY: the processor has AVX-512, see the module; the array holds sixteen f32.
        Self(unsafe { _mm512_loadu_ps(x.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; LANES]) {
        // SAFETY: as above; the array has room for sixteen f32.
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn least(self) -> f32 {
        // SAFETY: the processor has AVX-512, see the module.
        unsafe { _mm512_reduce_min_ps(self.0) }
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        // SAFETY: the processor has AVX-512, see the module.
        unsafe { _mm512_reduce_max_ps(self.0) }
    }
}

impl F32x8 for S8 {
    #[inline(always)]
    fn load(x: &[f32; 8]) -> Self {
        // SAFETY: the processor has AVX-512, see the module; the array holds eight f32.
        Self(unsafe { _mm256_loadu_ps(x.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; 8]) {
        // SAFETY: as above; the array has room for eight f32.
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
    }
}

impl Real for D8 {
    const U: f64 = U;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        // SAFETY: the processor has AVX-512, see the module.
        Self(unsafe { _mm512_set1_pd(x) })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: the processor has AVX-512, see the module.
        Self(unsafe { _mm512_sqrt_pd(self.0) })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: the processor has AVX-512, see the module.
        Self(unsafe { _mm512_abs_pd(self.0) })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: the processor has AVX-512, see the module.
        Self(unsafe { _mm512_max_pd(self.0, other.0) })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: the processor has AVX-512, see the module.
        Self(unsafe { _mm512_min_pd(self.0, other.0) })
    }
    #[inline(always)]
    fn if_positive(self, a: Self, b: Self) -> Self {
        // SAFETY: the processor has AVX-512, see the module.
        Self(unsafe {
            let m = _mm512_cmp_pd_mask::<_CMP_GT_OQ>(self.0, _mm512_setzero_pd());
            _mm512_mask_blend_pd(m, b.0, a.0)
        })
    }
}

impl F64x8 for D8 {
    #[inline(always)]
    fn load(x: &[f64; 8]) -> Self {
        // SAFETY: the processor has AVX-512, see the module; the array holds eight f64.
        Self(unsafe { _mm512_loadu_pd(x.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, to: &mut [f64; 8]) {
        // SAFETY: as above; the array has room for eight f64.
        unsafe { _mm512_storeu_pd(to.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn positive(self) -> u8 {
        // SAFETY: the processor has AVX-512, see the module.
        unsafe { _mm512_cmp_pd_mask::<_CMP_GT_OQ>(self.0, _mm512_setzero_pd()) }
    }
    #[inline(always)]
    fn le(self, other: Self) -> u8 {
        // SAFETY: the processor has AVX-512, see the module.
        unsafe { _mm512_cmp_pd_mask::<_CMP_LE_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    fn compress(self, mask: u8) -> Self {
        // SAFETY: the processor has AVX-512, see the module.
        Self(unsafe { _mm512_maskz_compress_pd(mask, self.0) })
    }
}
