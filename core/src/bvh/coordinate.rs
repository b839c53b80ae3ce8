//! The numbers a box can be made of.

use std::fmt::Debug;

/// f32 or f64.
pub(crate) trait Coordinate: Copy + PartialOrd + Debug + Send + Sync + 'static {
    const INFINITY: Self;
    const NEG_INFINITY: Self;
    /// The greatest number not above `x`.
    fn down(x: f64) -> Self;
    /// The least number not below `x`.
    fn up(x: f64) -> Self;
    fn to_f64(self) -> f64;
    fn least(self, b: Self) -> Self;
    fn greatest(self, b: Self) -> Self;
}

impl Coordinate for f32 {
    const INFINITY: Self = Self::INFINITY;
    const NEG_INFINITY: Self = Self::NEG_INFINITY;
    fn down(x: f64) -> Self {
        let r = x as Self;
        if f64::from(r) > x { r.next_down() } else { r }
    }
    fn up(x: f64) -> Self {
        let r = x as Self;
        if f64::from(r) < x { r.next_up() } else { r }
    }
    fn to_f64(self) -> f64 {
        self.into()
    }
    fn least(self, b: Self) -> Self {
        if b < self { b } else { self }
    }
    fn greatest(self, b: Self) -> Self {
        if b > self { b } else { self }
    }
}

impl Coordinate for f64 {
    const INFINITY: Self = Self::INFINITY;
    const NEG_INFINITY: Self = Self::NEG_INFINITY;
    fn down(x: f64) -> Self {
        x
    }
    fn up(x: f64) -> Self {
        x
    }
    fn to_f64(self) -> f64 {
        self
    }
    fn least(self, b: Self) -> Self {
        if b < self { b } else { self }
    }
    fn greatest(self, b: Self) -> Self {
        if b > self { b } else { self }
    }
}
