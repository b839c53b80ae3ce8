//! Scenes at the limits of numbers.

use glam::{DVec3, dvec3};

use super::{Document, Item, Look};

/// One of everything, with coordinates that are multiples of 2^-10: a mirror sphere on a
/// plane, a matte one, two triangles, two lights.
#[must_use]
pub fn basic() -> Document {
    Document::new(dvec3(0.5, 2.0, -6.0), dvec3(0.0, 0.75, 0.0))
        .with_background(0.1, 0.2, 0.4)
        .plane_at(DVec3::Y, DVec3::ZERO, Look::new(0.8, 0.7, 0.6, 0.7, 0.25))
        .sphere(dvec3(-1.25, 1.0, 0.5), 1.0, Look::new(0.9, 0.9, 0.9, 0.1, 0.8))
        .sphere(dvec3(1.25, 0.625, -0.5), 0.625, Look::matte(0.9, 0.3, 0.2))
        .triangle(
            [dvec3(-3.0, 0.0, 3.0), dvec3(3.5, 0.25, 3.5), dvec3(0.25, 4.0, 2.75)],
            Look::new(0.4, 0.8, 0.5, 0.6, 0.3),
        )
        .with(Item::TriangleSides(
            [dvec3(2.0, 0.125, 1.0), dvec3(1.0, 0.0, 0.5), dvec3(0.125, 2.0, 0.25)],
            Look::matte(0.3, 0.4, 0.9),
        ))
        .light(-4.0, 6.0, -5.0)
        .light(3.0, 5.0, -2.0)
}
