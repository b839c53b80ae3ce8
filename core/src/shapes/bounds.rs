//! Where objects are, and which are one.

use super::{Aabb, Kind, Local, ObjectId, kind, sphere, triangle};
use crate::scene::Scene;

/// The box of object `id`, its rounding included; empty where nothing ever meets it, and of planes.
pub(crate) fn bounds(scene: &Scene, local: &Local, id: ObjectId) -> Aabb {
    match kind(scene, id) {
        Kind::Plane(_) => Aabb::EMPTY,
        Kind::Sphere(i) => sphere::bounds::bounds(&local.spheres[i]),
        Kind::Triangle(i) => triangle::bounds::bounds(&scene.triangles()[i], local),
    }
}

/// Whether two objects are the same sphere, or triangles with the same corners: the first of them in the
/// document is what is met where either is, at the very same distance, so that the other never matters.
pub(crate) fn coincide(scene: &Scene, a: ObjectId, b: ObjectId) -> bool {
    match (kind(scene, a), kind(scene, b)) {
        (Kind::Sphere(i), Kind::Sphere(j)) => sphere::bounds::coincide(&scene.spheres()[i], &scene.spheres()[j]),
        (Kind::Triangle(i), Kind::Triangle(j)) => {
            triangle::bounds::coincide(&scene.triangles()[i], &scene.triangles()[j])
        }
        _ => false,
    }
}
