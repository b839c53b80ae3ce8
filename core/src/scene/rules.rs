//! What values of a scene must be, each rule once: the builder holds scenes to it, wherever they come from, and the
//! reader says where it is broken.

use glam::DVec3;

use super::{Invalid, Orientation};
use crate::numeric::predicates::{parallel, parallel_to_view};

pub(super) fn finite(v: DVec3) -> Result<DVec3, Invalid> {
    if v.is_finite() { Ok(v) } else { Err(Invalid::NotFinite) }
}

/// A number in [0, 1], −0 as +0.
#[inline]
pub(crate) fn share(x: f64) -> Result<f64, Invalid> {
    if (0.0..=1.0).contains(&x) { Ok(x + 0.0) } else { Err(Invalid::NotAShare(x)) }
}

/// A number above 0.
#[inline]
pub(crate) fn radius(r: f64) -> Result<f64, Invalid> {
    match r {
        r if !r.is_finite() => Err(Invalid::NotFinite),
        r if r > 0.0 => Ok(r),
        r => Err(Invalid::Radius(r)),
    }
}

/// A vector that points somewhere; `zero` is what one is that does not.
pub(crate) fn direction(v: DVec3, zero: Invalid) -> Result<DVec3, Invalid> {
    if finite(v)? == DVec3::ZERO { Err(zero) } else { Ok(v) }
}

/// An eye sees something, and knows which way is up; decided exactly.
pub(crate) fn view(location: DVec3, sky: DVec3, look_at: DVec3) -> Result<(), Invalid> {
    for v in [location, sky, look_at] {
        finite(v)?;
    }
    if location == look_at {
        return Err(Invalid::NoView);
    }
    direction(sky, Invalid::ZeroSky)?;
    if parallel_to_view(location, look_at, sky) { Err(Invalid::SkyParallel) } else { Ok(()) }
}

/// How a sphere is turned: by pole and equator, or by one of them and +x or +y, or +z where those are parallel to it.
pub(crate) fn orientation(pole: Option<DVec3>, equator: Option<DVec3>) -> Result<Option<Orientation>, Invalid> {
    let other = |given: DVec3, default: DVec3| if parallel(given, default) { DVec3::Z } else { default };
    let (pole, equator) = match (pole, equator) {
        (None, None) => return Ok(None),
        (Some(pole), None) => (pole, other(pole, DVec3::X)),
        (None, Some(equator)) => (other(equator, DVec3::Y), equator),
        (Some(pole), Some(equator)) => (pole, equator),
    };
    for v in [pole, equator] {
        direction(v, Invalid::ZeroOrientation)?;
    }
    if parallel(pole, equator) { Err(Invalid::OrientationParallel) } else { Ok(Some(Orientation { pole, equator })) }
}
