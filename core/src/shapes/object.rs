//! How objects are numbered, and what names one.

use crate::scene::{Order, Scene, SurfaceId};

/// An object: planes first, then spheres, then triangles, each in document order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct ObjectId(pub(crate) u32);

/// What an [`ObjectId`] names, with its index among its kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Plane(usize),
    Sphere(usize),
    Triangle(usize),
}

/// The kinds of leaves that bounded objects are in, by falling ids.
pub(crate) const TRIANGLES: u8 = 0;
pub(crate) const SPHERES: u8 = 1;

/// What a ray meets: which object, and for a sphere from which side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Decision {
    pub(crate) id: ObjectId,
    /// Whether the inner side of a sphere is struck; false for other objects.
    pub(crate) inside: bool,
}

impl Decision {
    /// The decision that a code stands for.
    pub(crate) fn of(code: u32) -> Option<Self> {
        (code != NONE).then_some(Self { id: ObjectId(code & !INSIDE), inside: code & INSIDE != 0 })
    }

    /// The code for it: its id, and [`INSIDE`].
    pub(crate) fn code(self) -> u32 {
        self.id.0 | if self.inside { INSIDE } else { 0 }
    }
}

/// No object.
pub(crate) const NONE: u32 = u32::MAX;
/// Set in an object's id where a sphere's inner side is struck.
pub(crate) const INSIDE: u32 = 1 << 31;

/// The id of the first sphere; those of planes are less.
#[inline(always)]
pub(crate) fn first_sphere(scene: &Scene) -> u32 {
    scene.planes().len() as u32
}

/// The id of the first triangle; those of planes and spheres are less.
#[inline(always)]
pub(crate) fn first_triangle(scene: &Scene) -> u32 {
    (scene.planes().len() + scene.spheres().len()) as u32
}

/// What [`ObjectId`] `id` names in `scene`.
pub(crate) fn kind(scene: &Scene, id: ObjectId) -> Kind {
    let i = id.0 as usize;
    let (planes, spheres) = (scene.planes().len(), scene.spheres().len());
    if i < planes {
        Kind::Plane(i)
    } else if i < planes + spheres {
        Kind::Sphere(i - planes)
    } else {
        Kind::Triangle(i - planes - spheres)
    }
}

/// An object's surface and place in the document.
pub(crate) fn surface_and_order(scene: &Scene, id: ObjectId) -> (SurfaceId, Order) {
    match kind(scene, id) {
        Kind::Plane(i) => (scene.planes()[i].surface, scene.planes()[i].order),
        Kind::Sphere(i) => (scene.spheres()[i].surface, scene.spheres()[i].order),
        Kind::Triangle(i) => (scene.triangles()[i].surface(), scene.triangles()[i].order),
    }
}

/// Whether all of eight ids name one object.
#[inline(always)]
pub(crate) fn all_same(ids: &[u32; 8]) -> bool {
    ids[1..].iter().all(|id| *id == ids[0])
}
