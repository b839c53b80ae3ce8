//! The scene's objects in local space.

use glam::DVec3;
use rayon::prelude::*;

use super::bounds::Bounds;
use super::plane::exact::ExactPlanes;
use super::plane::{self, LocalPlane};
use super::sphere::LocalSphere;
use super::triangle::LocalTriangle;
use super::{Giants, Listed, each_shape};
use crate::numeric::{Big, DoubleDouble, V3};
use crate::scene::{Scene, Triangle};
use crate::simd::roomy;

/// The scene's objects in local space, as far as they are kept, and the way there.
#[derive(Debug, Default)]
pub(crate) struct Local {
    /// The camera's location in world space.
    origin: DVec3,
    /// Local = (world − origin) · 2^−power.
    pub(crate) power: i32,
    /// 2^−power as two factors, so that each is a normal number.
    factors: [f64; 2],
    /// Whether differences from the origin may overflow, so that quarters are taken.
    quarters: bool,
    pub(crate) planes: Vec<LocalPlane>,
    /// The same planes to twice the digits, and in wide numbers.
    pub(super) double_planes: Vec<LocalPlane<DoubleDouble>>,
    pub(super) exact_planes: Vec<ExactPlanes>,
    pub(crate) spheres: Vec<LocalSphere>,
    /// Objects far larger than what is seen of them; none before they are looked for.
    pub(crate) giants: Giants,
    pub(crate) lights: Vec<DVec3>,
    /// Whether a light is too far for its distance to be squared in f64.
    far_lights: bool,
}

/// Lengths above this are not for squares in f64.
pub(crate) const FAR: f64 = 1e140;

/// x · 2^k, rounded once unless it ends among the denormals.
pub(crate) fn ldexp(x: f64, k: i32) -> f64 {
    let half = k / 2;
    let rest = k - half;
    let p = |e: i32| f64::from_bits(((e.clamp(-1022, 1023) + 1023) as u64) << 52);
    // Two factors cover ±2044; coordinates and their powers stay within.
    x * p(half) * p(rest)
}

/// e with 2^(e−1) ≤ |x| < 2^e, for finite x ≠ 0.
fn exponent(x: f64) -> i32 {
    i32::try_from(Big::<1>::new(x).exponent()).unwrap_or(0)
}

impl Local {
    pub(crate) fn new(scene: &Scene) -> Self {
        let origin = scene.camera().location();
        // A quarter of everything, so that no difference overflows.
        let far = |v: DVec3| (v * 0.25 - origin * 0.25).abs().max_element();
        let reaches = each_shape!(O => O::all(scene).par_iter().map(|o| o.reach(far)).reduce(|| 0.0, f64::max));
        let mut reach = reaches.into_iter().fold(0.0, f64::max);
        if reach == 0.0 {
            let origin = origin.abs().max_element() * 0.25;
            reach = scene.planes().iter().map(|p| plane::bounds::reach(p, far, origin)).fold(0.0, f64::max);
        }
        let power = if reach > 0.0 { exponent(reach) + 2 } else { 0 };
        let (half, rest) = (-power / 2, -power - -power / 2);
        let factors = [ldexp(1.0, half), ldexp(1.0, rest)];
        // Far below the overflow limit the difference is taken as it is, so that denormals stay exact.
        let everything = scene.lights().iter().map(|&l| far(l)).fold(reach, f64::max);
        let points = scene.planes().iter().filter_map(|p| plane::bounds::point(p).map(far));
        let quarters = points.fold(everything, f64::max) > 1e299 || origin.abs().max_element() > 1e299;
        let mut local = Self { origin, power, factors, quarters, ..Self::default() };
        local.double_planes = scene.planes().iter().map(|p| LocalPlane::new(p, origin, power)).collect();
        local.planes = local.double_planes.iter().map(|p| p.to_f64()).collect();
        local.exact_planes = scene.planes().iter().map(ExactPlanes::new).collect();
        let mut spheres = roomy(scene.spheres().len());
        spheres.par_extend(scene.spheres().par_iter().map(|s| LocalSphere::new(s, &local)));
        local.spheres = spheres;
        local.lights = scene.lights().iter().map(|&l| local.point(l)).collect();
        local.far_lights = local.lights.iter().any(|l| !(l.abs().max_element() < FAR));
        local
    }

    /// The squared distance to the nearest light before any was looked at: of lights that f64 cannot hold, each
    /// may be anywhere.
    pub(crate) fn nearest_light_at_first(&self) -> f64 {
        if self.far_lights { 0.0 } else { f64::INFINITY }
    }

    /// A world point in local space, within u·|result| of the real one.
    #[inline]
    pub(crate) fn point(&self, v: DVec3) -> DVec3 {
        if self.quarters { self.scaled(v * 0.25 - self.origin * 0.25) * 4.0 } else { self.scaled(v - self.origin) }
    }

    /// A world vector in local space.
    #[inline]
    pub(super) fn scaled(&self, v: DVec3) -> DVec3 {
        v * self.factors[0] * self.factors[1]
    }

    /// A triangle in local space.
    #[inline]
    pub(crate) fn triangle(&self, t: &Triangle) -> LocalTriangle {
        LocalTriangle::new(t, self)
    }

    /// This, where objects are to be had to twice the digits: where differences do not overflow.
    pub(super) fn doubles(&self) -> Option<&Self> {
        (!self.quarters).then_some(self)
    }

    /// The `k`-th light to twice the digits; `None` where differences may overflow.
    pub(crate) fn double_light(&self, scene: &Scene, k: usize) -> Option<V3<DoubleDouble>> {
        self.doubles().map(|local| local.double_point(scene.lights()[k]))
    }

    /// A world point in local space to twice the digits, where differences do not overflow.
    pub(super) fn double_point(&self, v: DVec3) -> V3<DoubleDouble> {
        let of = |k: usize| {
            let d = DoubleDouble::difference(v[k], self.origin[k]);
            d.scaled(self.factors[0]).scaled(self.factors[1])
        };
        V3 { x: of(0), y: of(1), z: of(2) }
    }
}
