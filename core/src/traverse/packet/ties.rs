//! Objects of one exact plane before a packet: which of them matters is known without distances.
//!
//! Only what was asked about before is known here, so that scenes without such planes pay nothing.

use super::{Packet, lanes};
use crate::shapes::{INSIDE, NONE, ObjectId, surface_and_order};
use crate::simd::{LANES, Mask};
use crate::traverse::PreparedScene;

/// The planes that a packet's rays start in, and the light they go to.
pub(crate) struct Ties<'a> {
    prepared: &'a PreparedScene,
    own: &'a [u32; LANES],
    /// By ray, the number of the plane it starts in, 0 where that is not known; once it was asked for.
    starts: Option<[u32; LANES]>,
    light: Option<usize>,
}

impl<'a> Ties<'a> {
    pub(crate) fn new(prepared: &'a PreparedScene, packet: &'a Packet, light: Option<usize>) -> Self {
        Self { prepared, own: &packet.own, starts: None, light }
    }

    /// The lanes of `mask` that may meet `id` for all that is known of where they start and end.
    #[inline(always)]
    pub(super) fn left(&mut self, id: u32, mask: Mask) -> Mask {
        if self.prepared.coplanar.matters() { self.left_of(id, mask) } else { mask }
    }

    #[inline(never)]
    fn left_of(&mut self, id: u32, mut mask: Mask) -> Mask {
        let coplanar = &self.prepared.coplanar;
        let Some(plane) = coplanar.known(ObjectId(id)) else { return mask };
        if self.light.is_some_and(|light| coplanar.holds_light(plane, light)) {
            return 0;
        }
        let own = self.own;
        let starts = self.starts.get_or_insert_with(|| {
            own.map(
                |own| if own == NONE { 0 } else { coplanar.known(ObjectId(own & !INSIDE)).map_or(0, |p| p.number()) },
            )
        });
        for k in 0..LANES {
            let starts_there = starts[k] == plane.number() || own[k] == NONE && plane.holds_eye();
            mask &= !(Mask::from(starts_there) << k);
        }
        mask
    }

    /// Puts `id` in the place of what is nearest in lanes of `mask` where both are `sure`, in one plane, and it comes
    /// first in the document; gives the lanes in which that does not settle it.
    #[inline(always)]
    pub(super) fn nearest(&self, id: u32, mask: Mask, sure: Mask, best: &mut [u32; LANES]) -> Mask {
        if mask != 0 && self.prepared.coplanar.matters() { self.nearest_of(id, mask, sure, best) } else { mask }
    }

    #[inline(never)]
    fn nearest_of(&self, id: u32, mask: Mask, sure: Mask, best: &mut [u32; LANES]) -> Mask {
        let coplanar = &self.prepared.coplanar;
        let Some(plane) = coplanar.known(ObjectId(id)) else { return mask };
        let (mut left, mut open) = (mask, mask);
        // Lanes that have the same object are settled together.
        while left != 0 {
            let other = best[left.trailing_zeros() as usize];
            let mut same = 0;
            for lane in lanes(left) {
                same |= Mask::from(best[lane] == other) << lane;
            }
            left &= !same;
            if coplanar.known(ObjectId(other & !INSIDE)).is_none_or(|p| p.number() != plane.number()) {
                continue;
            }
            if self.comes_first(other, id) {
                open &= !same;
            } else {
                for lane in lanes(same & sure) {
                    best[lane] = id;
                }
                open &= !(same & sure);
            }
        }
        open
    }

    /// Whether nothing but `best`, surely met, matters of the two: they lie in one plane, and it comes first.
    pub(super) fn covers(&self, best: u32, id: u32) -> bool {
        let coplanar = &self.prepared.coplanar;
        if best == NONE || best & INSIDE != 0 || !coplanar.matters() {
            return false;
        }
        let number = |id| coplanar.known(ObjectId(id)).map(|plane| plane.number());
        number(best).is_some_and(|n| number(id) == Some(n)) && self.comes_first(best, id)
    }

    fn comes_first(&self, a: u32, b: u32) -> bool {
        let order = |id| surface_and_order(&self.prepared.scene, ObjectId(id)).1;
        order(a) < order(b)
    }
}
