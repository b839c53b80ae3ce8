//! Where a ray may meet an object, by tests that know their own error.

use super::giants::Giants;
use super::local::DoubleObject;
use super::{Decision, Kind, Local, ObjectId, Ray, Span, kind, plane, sphere, triangle};
use crate::numeric::DoubleDouble;
use crate::scene::Scene;

/// Where `ray`, which starts on this object as `own` says, if it does, may meet object `id`.
pub(crate) fn test(
    scene: &Scene,
    local: &Local,
    giants: &Giants,
    ray: &Ray,
    id: ObjectId,
    own: Option<Decision>,
) -> Option<Span> {
    match kind(scene, id) {
        Kind::Plane(_) | Kind::Triangle(_) if own.is_some() => None,
        Kind::Plane(i) => plane::test(ray, &local.planes[i]),
        Kind::Sphere(i) => sphere::test(ray, &local.spheres[i], giants.sphere(id).map(|(giant, _)| giant), own),
        Kind::Triangle(i) => {
            if let Some(giant) = giants.triangle(id)
                && let Ok(span) = triangle::giant::test(ray, giant)
            {
                return span;
            }
            triangle::test(ray, &local.triangle(&scene.triangles()[i]))
        }
    }
}

/// The same to twice the digits.
pub(crate) fn test_double(
    ray: &Ray<DoubleDouble>,
    object: &DoubleObject,
    own: Option<Decision>,
) -> Option<Span<DoubleDouble>> {
    match object {
        DoubleObject::Sphere(s, giant) => sphere::test(ray, s, giant.as_ref(), own),
        _ if own.is_some() => None,
        DoubleObject::Plane(plane) => plane::test(ray, plane),
        DoubleObject::Triangle(triangle) => triangle::test(ray, triangle),
    }
}
