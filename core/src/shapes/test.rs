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
        Kind::Sphere(i) => {
            let s = &local.spheres[i];
            match (own, giants.sphere(id.0)) {
                (Some(f), _) if !f.inside => None,
                (Some(_), Some(giant)) => sphere::giant::test_from_inside(ray, giant),
                (Some(_), None) => sphere::test_from_inside(ray, s),
                (None, Some(giant)) => sphere::giant::test(ray, giant)
                    .and_then(|span| if span.sure { Some(span) } else { sphere::test(ray, s) }),
                (None, None) => sphere::test(ray, s),
            }
        }
        Kind::Triangle(i) => {
            if let Some(giant) = giants.triangle(id.0)
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
    match (object, own) {
        (DoubleObject::Sphere(_, Some(giant)), Some(own)) if own.inside => sphere::giant::test_from_inside(ray, giant),
        (DoubleObject::Sphere(sphere, None), Some(own)) if own.inside => sphere::test_from_inside(ray, sphere),
        (_, Some(_)) => None,
        (DoubleObject::Plane(plane), _) => plane::test(ray, plane),
        (DoubleObject::Triangle(triangle), _) => triangle::test(ray, triangle),
        (DoubleObject::Sphere(sphere, Some(giant)), _) => sphere::giant::test(ray, giant)
            .and_then(|span| if span.sure { Some(span) } else { sphere::test(ray, sphere) }),
        (DoubleObject::Sphere(sphere, None), _) => sphere::test(ray, sphere),
    }
}
