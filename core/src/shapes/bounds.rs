//! Which objects are one.

use super::{Kind, ObjectId, kind, sphere, triangle};
use crate::scene::Scene;

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
