//! Vectors of the machine, the choice among them, and its large pages.
//!
//! The only room with `unsafe`. Code above is written once over `Simd` and compiled for
//! each [`Level`] by `dispatch`; the level is found once, when the process first asks.
//! No result depends on it: 64-bit operations are IEEE's in every lane, and 32-bit ones
//! only filter, behind bounds that hold for any rounding and any fusing.

#![expect(unsafe_code, reason = "vector instructions and advice on pages are behind unsafe")]

mod arrays;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod pages;
mod rows;
#[cfg(test)]
mod tests;

use std::ops::{Add, BitAnd, BitOr, Mul, Neg, Not, Sub};
use std::sync::OnceLock;

pub(crate) use pages::roomy;
pub(crate) use rows::{MOST, Rows};

use crate::numeric::{Real, V3};

/// Lanes of an f32 vector: the rays of a packet.
pub(crate) const LANES: usize = 16;

/// A set of lanes, bit k for lane k.
pub(crate) type Mask = u16;

/// Lanes of f32.
pub(crate) trait Floats:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// A bit for each lane.
    type Mask: Copy
        + Eq
        + From<u8>
        + BitAnd<Output = Self::Mask>
        + BitOr<Output = Self::Mask>
        + Not<Output = Self::Mask>;
    fn splat(x: f32) -> Self;
    /// self · b + c, with one rounding or two.
    fn fma(self, b: Self, c: Self) -> Self;
    /// 1 / self, rounded.
    fn recip(self) -> Self;
    fn sqrt(self) -> Self;
    fn abs(self) -> Self;
    /// The greater; `other` where either is NaN.
    fn max(self, other: Self) -> Self;
    /// The lesser; `other` where either is NaN.
    fn min(self, other: Self) -> Self;
    /// Lanes where self < other; not where either is NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// Lanes where self ≤ other; not where either is NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `self` in the lanes of `mask`, `other` elsewhere.
    fn select(self, mask: Self::Mask, other: Self) -> Self;
}

/// Sixteen f32: the rays of a packet before one box or object.
pub(crate) trait F32x16: Floats<Mask = Mask> {
    fn load(x: &[f32; LANES]) -> Self;
    fn store(self, to: &mut [f32; LANES]);
    /// The least lane; no lane may be NaN.
    fn least(self) -> f32;
    /// The greatest lane; no lane may be NaN.
    fn greatest(self) -> f32;
}

/// Eight f32: the boxes of a node or the objects of a leaf before one ray.
pub(crate) trait F32x8: Floats<Mask = u8> {
    fn load(x: &[f32; 8]) -> Self;
    fn store(self, to: &mut [f32; 8]);
}

/// Eight f64.
pub(crate) trait F64x8: Real {
    fn load(x: &[f64; 8]) -> Self;
    fn store(self, to: &mut [f64; 8]);
    /// Lanes where self > 0.
    fn positive(self) -> u8;
    /// Lanes where self ≤ other; not where either is NaN.
    fn le(self, other: Self) -> u8;
    /// The lanes of `mask`, moved to the front; zeros follow.
    fn compress(self, mask: u8) -> Self;
}

/// A set of vector types that one level offers.
pub(crate) trait Simd: Copy + Send + Sync + 'static {
    type F32x16: F32x16;
    type F32x8: F32x8;
    type F64x8: F64x8;
    /// Sixteen f64 rounded to f32.
    fn narrow(low: Self::F64x8, high: Self::F64x8) -> Self::F32x16;
    /// Lanes of `x` that equal `y`.
    fn equal(x: &[u32; LANES], y: u32) -> Mask;
    /// The elements of `x` in `mask`, moved to the front; zeros follow.
    fn compress(x: &[u32; 8], mask: u8) -> [u32; 8];
    /// `y` into the lanes of `mask`.
    fn put(x: &mut [u32; LANES], mask: Mask, y: u32);
}

/// Three rows of eight, from row `at` on.
#[inline(always)]
pub(crate) fn three<S: Simd>(lanes: &[[f64; 8]], at: usize) -> V3<S::F64x8> {
    V3 { x: S::F64x8::load(&lanes[at]), y: S::F64x8::load(&lanes[at + 1]), z: S::F64x8::load(&lanes[at + 2]) }
}

/// Which instructions are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// What every processor of the architecture has, on any architecture.
    Baseline,
    /// AVX2 and FMA.
    Avx2,
    /// AVX-512 F, BW, DQ and VL.
    Avx512,
}

impl Level {
    /// The best this machine offers.
    #[must_use]
    pub fn best() -> Self {
        static BEST: OnceLock<Level> = OnceLock::new();
        *BEST.get_or_init(|| Self::all().into_iter().next_back().unwrap_or(Self::Baseline))
    }

    /// All that this machine offers, the plainest first.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let mut all = vec![Self::Baseline];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                all.push(Self::Avx2);
                if is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                {
                    all.push(Self::Avx512);
                }
            }
        }
        all
    }
}

/// Asks memory for `count` elements of `of` from `start` on; places outside do no harm.
#[inline(always)]
pub(crate) fn prefetch<T>(of: &[T], start: usize, count: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let first = of.as_ptr().wrapping_add(start).cast::<i8>();
        // Where lines may begin within elements, the last byte's line is one more.
        let bytes = count * size_of::<T>() + if align_of::<T>() < 64 { first.addr() % 64 } else { 0 };
        for at in (0..bytes).step_by(64) {
            // SAFETY: a prefetch has no effect on any value and faults nowhere.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(first.wrapping_add(at)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (of, start, count);
}

/// Work that can be done at every level.
pub(crate) trait Kernel {
    type Output;
    /// Must be `#[inline(always)]`, to be compiled for the level's instructions.
    fn run<S: Simd>(self) -> Self::Output;
}

/// Runs `kernel` with the instructions of `level`, which must be one of [`Level::all`].
pub(crate) fn dispatch<K: Kernel>(level: Level, kernel: K) -> K::Output {
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => {
            #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
            fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
                kernel.run::<avx2::Avx2>()
            }
            // SAFETY: `Level` values come from `Level::all`, which asked the processor.
            unsafe { with_avx2(kernel) }
        }
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => {
            #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
            fn with_avx512<K: Kernel>(kernel: K) -> K::Output {
                kernel.run::<avx512::Avx512>()
            }
            // SAFETY: as above.
            unsafe { with_avx512(kernel) }
        }
        _ => kernel.run::<arrays::Arrays>(),
    }
}
