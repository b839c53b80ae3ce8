//! How textures lie on objects.

use glam::{DVec2, DVec3};

use super::exact::{ExactHit, LAST};
use super::{Decision, Kind, Local, ObjectId, Ray, SurfaceInteraction, first_sphere, kind, plane, sphere, triangle};
use crate::numeric::{Bound, Unsure, Vector};
use crate::scene::{Pigment, Scene};

/// Whether a picture repeats along u and v on objects of a kind, or ends at its edges.
pub(crate) fn wraps(kind: Kind) -> [bool; 2] {
    match kind {
        Kind::Sphere(_) => sphere::texture::WRAPS,
        Kind::Plane(_) => plane::texture::WRAPS,
        Kind::Triangle(_) => triangle::texture::WRAPS,
    }
}

/// How a picture lies on an object that has one.
#[derive(Clone, Debug)]
pub(crate) struct Mapping {
    pub(super) id: ObjectId,
    /// Sphere: unit equator, e × p, and pole. Plane: U, V, and the normal.
    pub(super) axes: [DVec3; 3],
    pub(super) exact: [Vector<LAST>; 3],
    /// Plane: the picture's origin in world space, and in local space.
    pub(super) origin: Vector<LAST>,
    pub(super) local_origin: DVec3,
}

/// Wide enough that products of four f64s are exact.
pub(super) type Exact = Vector<136>;

impl Mapping {
    /// From axes of any length, found exactly, and an origin.
    pub(super) fn new(id: ObjectId, axes: [Exact; 3], origin: Vector<LAST>, local: &Local, scene: &Scene) -> Self {
        let exact = axes.map(|v| v.resize::<LAST>().normalize());
        let eye = Vector::new(scene.camera().location());
        let local_origin = (origin - eye).scale(-i64::from(local.power)).to_f64();
        Self { id, axes: exact.map(|v| v.to_f64()), exact, origin, local_origin }
    }
}

/// Mappings of a scene's pictured spheres and planes, by rising id.
pub(crate) fn mappings(scene: &Scene, local: &Local) -> Vec<Mapping> {
    let pictured = |s| matches!(scene.surface(s).pigment, Pigment::Texture(_));
    let planes = scene.planes().iter().enumerate().filter(|(_, p)| pictured(p.surface));
    let planes = planes.map(|(i, p)| plane::texture::mapping(ObjectId(i as u32), p, local, scene));
    let first = first_sphere(scene);
    let spheres = scene.orientations().iter();
    let spheres = spheres.map(|&(i, o)| sphere::texture::mapping(ObjectId(first + i), o, local, scene));
    planes.chain(spheres).collect()
}

fn find(mappings: &[Mapping], id: ObjectId) -> &Mapping {
    let at = mappings.partition_point(|m| m.id < id);
    &mappings[at]
}

/// x − ⌊x⌋ in [0, 1).
pub(super) fn fraction(x: f64) -> f64 {
    let f = x - x.floor();
    if f < 1.0 { f } else { 0.0 }
}

/// (u, v) at `interaction`, met by `ray`, and the bound on their error.
pub(crate) fn coordinates(
    scene: &Scene,
    local: &Local,
    mappings: &[Mapping],
    decision: Decision,
    interaction: &SurfaceInteraction,
    ray: &Ray,
) -> (DVec2, f64) {
    match kind(scene, decision.id) {
        Kind::Sphere(_) => sphere::texture::coordinates(find(mappings, decision.id), decision.inside, interaction),
        Kind::Plane(_) => plane::texture::coordinates(find(mappings, decision.id), local, interaction),
        Kind::Triangle(i) => triangle::texture::coordinates(ray, &local.triangle(&scene.triangles()[i])),
    }
}

/// u and v must be known to this, as a power of two: far below a texel of the largest picture.
const FINE: i64 = -45;

/// What axes and operations in N limbs are rounded by.
pub(super) fn rounding<const N: usize>() -> Bound {
    Bound::power(20 - 64 * N.min(LAST) as i64)
}

/// Whether a texture may be read where its place is known to `error`.
pub(super) fn check(error: Bound) -> Result<(), Unsure> {
    if error.exponent() <= FINE { Ok(()) } else { Err(Unsure) }
}

/// (u, v) at `hit`, from wide arithmetic.
pub(crate) fn exact_coordinates<const N: usize>(
    scene: &Scene,
    mappings: &[Mapping],
    hit: &ExactHit<N>,
) -> Result<DVec2, Unsure> {
    let id = hit.decision.id;
    match kind(scene, id) {
        Kind::Sphere(_) => sphere::texture::exact_coordinates(find(mappings, id), hit),
        Kind::Plane(_) => plane::texture::exact_coordinates(find(mappings, id), hit),
        Kind::Triangle(i) => triangle::texture::exact_coordinates(&scene.triangles()[i], hit),
    }
}
