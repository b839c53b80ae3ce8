//! Exact yes-or-no questions about f64 vectors.

use glam::DVec3;

/// Whether `a` and `b`, both not zero, are exactly parallel or antiparallel.
#[must_use]
pub fn parallel(a: DVec3, b: DVec3) -> bool {
    a.normalize().cross(b.normalize()) == DVec3::ZERO
}

/// Whether `sky` is exactly parallel to `look_at` − `location`, that difference taken exactly.
#[must_use]
pub fn parallel_to_view(location: DVec3, look_at: DVec3, sky: DVec3) -> bool {
    parallel(look_at - location, sky)
}
