//! A sphere in local space.

use super::LocalSphere;
use crate::numeric::{DoubleDouble, V3};
use crate::scene::Sphere;
use crate::shapes::Local;
use crate::shapes::local::ldexp;

impl LocalSphere {
    pub(crate) fn new(s: &Sphere, local: &Local) -> Self {
        Self { c: V3::splat(local.point(s.center)), r: ldexp(s.radius, -local.power) }
    }
}

impl LocalSphere<DoubleDouble> {
    /// The sphere to twice the digits; `r` is its radius, which is exact.
    pub(crate) fn double(s: &Sphere, r: f64, local: &Local) -> Self {
        Self { c: local.double_point(s.center), r: DoubleDouble { hi: r, lo: 0.0 } }
    }
}
