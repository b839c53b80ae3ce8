//! How textures lie on objects.

use glam::{DVec2, DVec3};

use super::exact::{ExactHit, LAST};
use super::{Decision, Listed, Local, ObjectId, Ray, SurfaceInteraction, each_shape, of_shape};
use crate::numeric::{Bound, Unsure, Vector};
use crate::scene::Scene;

/// How textures lie on a shape.
pub(crate) trait Textured: Listed {
    /// Whether a picture repeats along u and v, or ends at its edges.
    const WRAPS: [bool; 2] = [false, false];

    /// The [`Mapping`]s of pictured objects, for shapes that need some, by rising id.
    fn mappings(_scene: &Scene, _local: &Local) -> Vec<Mapping> {
        Vec::new()
    }

    /// (u, v) where the object is met, and the bound on their error.
    fn coordinates(&self, mappings: &[Mapping], local: &Local, at: &Place) -> (DVec2, f64);

    /// (u, v) at `hit`, from wide arithmetic.
    fn exact_coordinates<const N: usize>(&self, mappings: &[Mapping], hit: &ExactHit<N>) -> Result<DVec2, Unsure>;
}

/// Where `ray` meets an object.
pub(crate) struct Place<'a> {
    pub(crate) met: Decision,
    pub(crate) interaction: &'a SurfaceInteraction,
    pub(crate) ray: &'a Ray,
}

/// Whether a picture repeats along u and v on object `id`.
pub(crate) fn wraps(scene: &Scene, id: ObjectId) -> [bool; 2] {
    of_shape!(scene, id, O, _ => O::WRAPS)
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

/// All mappings of a scene, by rising id.
pub(crate) fn mappings(scene: &Scene, local: &Local) -> Vec<Mapping> {
    each_shape!(O => O::mappings(scene, local)).concat()
}

/// The mapping of object `id`, which has one.
pub(super) fn find(mappings: &[Mapping], id: ObjectId) -> &Mapping {
    let at = mappings.partition_point(|m| m.id < id);
    &mappings[at]
}

/// x − ⌊x⌋ in [0, 1).
pub(super) fn fraction(x: f64) -> f64 {
    let f = x - x.floor();
    if f < 1.0 { f } else { 0.0 }
}

/// (u, v) where an object is met, and the bound on their error.
pub(crate) fn coordinates(scene: &Scene, local: &Local, mappings: &[Mapping], at: &Place) -> (DVec2, f64) {
    of_shape!(scene, at.met.id, O, i => O::all(scene)[i].coordinates(mappings, local, at))
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
    of_shape!(scene, hit.decision.id, O, i => O::all(scene)[i].exact_coordinates(mappings, hit))
}
