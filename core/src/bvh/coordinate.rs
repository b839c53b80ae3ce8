//! The numbers a box can be made of.

use std::fmt::Debug;
use std::ops::{Add, Mul, Sub};

use glam::{DVec4, Vec4};

/// f32 or f64.
pub(crate) trait Coordinate:
    Copy + PartialOrd + Debug + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + 'static
{
    type Quad: Quad<Self>;
    const INFINITY: Self;
    const NEG_INFINITY: Self;
    const ZERO: Self;
    /// Beside so large a number, the last bits of a sum count whole ones.
    const WHOLE: Self;
    /// The greatest number not above `x`.
    fn down(x: f64) -> Self;
    /// The least number not below `x`.
    fn up(x: f64) -> Self;
    /// The number nearest to `x`.
    fn near(x: f64) -> Self;
    fn to_f64(self) -> f64;
    /// The n of [`Coordinate::WHOLE`] + n, below 2¹⁶.
    fn whole(self) -> usize;
    /// A number that stands for `tag`, at most 2³⁰: of two, the greater tag has the greater number.
    /// Far from the denormals, sums and differences included, which take a hundred times as long.
    fn from_tag(tag: u32) -> Self;
    fn tag(self) -> u32;
}

macro_rules! coordinate {
    ($type:ident, $quad:ident, $bits:ident, $whole:expr, $tags:expr) => {
        impl Coordinate for $type {
            type Quad = $quad;
            const INFINITY: Self = Self::INFINITY;
            const NEG_INFINITY: Self = Self::NEG_INFINITY;
            const ZERO: Self = 0.0;
            const WHOLE: Self = $whole;
            fn down(x: f64) -> Self {
                let r = x as Self;
                if f64::from(r) > x { r.next_down() } else { r }
            }
            fn up(x: f64) -> Self {
                let r = x as Self;
                if f64::from(r) < x { r.next_up() } else { r }
            }
            fn near(x: f64) -> Self {
                x as Self
            }
            fn to_f64(self) -> f64 {
                self.into()
            }
            #[inline(always)]
            fn whole(self) -> usize {
                self.to_bits() as usize & 0xffff
            }
            fn from_tag(tag: u32) -> Self {
                Self::from_bits($bits::from(tag) + $tags)
            }
            fn tag(self) -> u32 {
                (self.to_bits() - $tags) as u32
            }
        }
    };
}

coordinate!(f32, Vec4, u32, 8_388_608.0, 0x2000_0000); // 2²³
coordinate!(f64, DVec4, u64, 4_503_599_627_370_496.0, 0x3ff0_0000_0000_0000); // 2⁵²

/// Four numbers in a register: x, y, z, and one more that there is room for.
pub(crate) trait Quad<T>:
    Copy + PartialEq + Debug + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + 'static
{
    fn new(lanes: [T; 4]) -> Self;
    fn splat(x: T) -> Self;
    fn lanes(&self) -> &[T; 4];
    /// The lesser; `b` where either is NaN.
    fn least(self, b: Self) -> Self;
    /// The greater; `b` where either is NaN.
    fn greatest(self, b: Self) -> Self;
    fn xyz(&self) -> [T; 3];
}

macro_rules! quad {
    ($quad:ident, $type:ident) => {
        impl Quad<$type> for $quad {
            #[inline(always)]
            fn new(lanes: [$type; 4]) -> Self {
                Self::from_array(lanes)
            }
            #[inline(always)]
            fn splat(x: $type) -> Self {
                Self::splat(x)
            }
            #[inline(always)]
            fn lanes(&self) -> &[$type; 4] {
                self.as_ref()
            }
            #[inline(always)]
            fn least(self, b: Self) -> Self {
                self.min(b)
            }
            #[inline(always)]
            fn greatest(self, b: Self) -> Self {
                self.max(b)
            }
            #[inline(always)]
            fn xyz(&self) -> [$type; 3] {
                [self.x, self.y, self.z]
            }
        }
    };
}

quad!(Vec4, f32);
quad!(DVec4, f64);
