//! What names an object.

use super::{Listed, Shape, of_shape};
use crate::scene::{Order, Scene, SurfaceId};

/// An object: shape by shape in the order of their [list](super::list), each in document order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct ObjectId(pub(crate) u32);

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

/// An object's surface and place in the document.
pub(crate) fn surface_and_order(scene: &Scene, id: ObjectId) -> (SurfaceId, Order) {
    of_shape!(scene, id, O, i => O::all(scene)[i].surface_and_order())
}

/// Whether all of eight ids or places name one object.
#[inline(always)]
pub(crate) fn all_same<T: PartialEq>(ids: &[T; 8]) -> bool {
    ids[1..].iter().all(|id| *id == ids[0])
}
