//! Sixteen rays at once through the f32 scene: a filter that never decides what it cannot prove.
//!
//! **Bound.** With u = 2⁻²⁴ and an object whose points are at most V from the origin, hence at most
//! |o| + V from the start: the ray's own bound and its rounding misplace it there by at most
//! eo + ed(|o| + V) + u|o| + u(|o| + V); of a plane's offset h − n·o, 2uV + 5u|o| is lost, of n·d
//! 4u|d|, of a point's weights 6u·slope·V, of a sphere's q 5u(|o| + V) + 2uV. All of it is less than
//! pos = eo + (1.1·ed + 12u)·|o| + (1.1·ed + 10u)·V. A plane met at cosine c is then met within
//! pos/c, and weights are off by at most slope·pos·(1.2 + 1/c). Boxes that are wider than what is in them by 12u·V
//! ([`super::filter::SLACK`]) and then moved outward by pad = 1.1·(eo + (1.1·ed + 10u)|o| + 1.1·ed·reach) are met
//! wherever the real ray meets that: (lo − o)·(1/d) carries four roundings, less than 4u·(|o| + |lo|) in lo. That is
//! covered up to |lo| = 2V; and where a box that holds others reaches farther, its side is so far from what is met
//! that its rounding does not matter.
//!
//! Rays that start far outside the scene, or whose squares f32 cannot hold, are left to f64 altogether.

mod beam;
mod rays;
mod single;
#[cfg(test)]
mod tests;
mod ties;
mod walk;

use super::filter::Filter;
use crate::bvh::{Bvh, Child};
use crate::shapes::filter::Intersection;
use crate::shapes::{INSIDE, NONE};
use crate::simd::{F32x16, Floats, LANES, Mask, Simd};
pub(crate) use ties::Ties;
use walk::{Stacks, walk};

/// Sixteen rays, rounded to f32.
#[derive(Clone, Debug)]
#[repr(align(64))]
pub(crate) struct Packet {
    pub(crate) o: [[f32; LANES]; 3],
    pub(crate) d: [[f32; LANES]; 3],
    /// How far an object at distance V may be misplaced: `near` + `per` · V.
    pub(crate) near: [f32; LANES],
    pub(crate) per: [f32; LANES],
    /// How far boxes are moved outward.
    pub(crate) pad: [f32; LANES],
    /// Relative error of the direction.
    pub(crate) ed: [f32; LANES],
    /// Objects the rays start on, with [`INSIDE`]; [`NONE`] for camera rays.
    pub(crate) own: [u32; LANES],
    pub(crate) active: Mask,
}

impl Default for Packet {
    fn default() -> Self {
        let zero = [0.0; LANES];
        Self { o: [zero; 3], d: [zero; 3], near: zero, per: zero, pad: zero, ed: zero, own: [NONE; LANES], active: 0 }
    }
}

/// A lane's candidate that f32 cannot settle: not nearer than `lo`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Doubt {
    pub(crate) lane: u8,
    pub(crate) id: u32,
    lo: f32,
}

/// What a packet found, and the memory it walked with.
#[derive(Default)]
pub(crate) struct Walk {
    stacks: Stacks,
    pub(crate) doubts: Vec<Doubt>,
    /// The nearest sure object of each lane.
    pub(crate) best: [u32; LANES],
    best_hi: [f32; LANES],
}

impl Walk {
    /// Has found nothing.
    pub(crate) fn forget(&mut self) {
        self.doubts.clear();
        self.best = [NONE; LANES];
    }

    /// Lanes of `all` that are not settled: those that f32 cannot follow, and those in doubt.
    pub(crate) fn open(&self, all: Mask, near: Mask) -> Mask {
        self.doubts.iter().fold(all & !near, |open, d| open | 1 << d.lane)
    }

    /// What `lane` may meet beside its nearest sure object.
    pub(crate) fn doubts_of(&self, lane: usize) -> impl Iterator<Item = u32> {
        self.doubts.iter().filter(move |d| usize::from(d.lane) == lane).map(|d| d.id)
    }

    /// Forgets candidates that lie surely beyond their lane's nearest sure object, or do not matter beside it.
    fn prune(&mut self, ties: &Ties<'_>) {
        let (best, best_hi) = (&self.best, &self.best_hi);
        self.doubts.retain(|d| {
            let lane = usize::from(d.lane);
            !(d.lo > best_hi[lane] || ties.covers(best[lane], d.id))
        });
    }
}
/// The lanes of `mask`.
#[inline(always)]
pub(crate) fn lanes(mut mask: Mask) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (mask != 0).then(|| {
            let k = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            k
        })
    })
}
/// Where an object of a leaf is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    leaf: Child,
    place: usize,
}

/// What to do with meetings.
trait Visit<S: Simd> {
    /// Whether what is met brings the bounds nearer, so that it matters what is met first.
    const NEARS: bool;
    fn bound(&self) -> S::F32x16;
    fn active(&self) -> Mask;
    /// Object `id` is met, which is at `spot` if it is in a leaf.
    fn visit(&mut self, id: u32, spot: Option<Spot>, m: Intersection<S::F32x16>, doubts: &mut Vec<Doubt>);
    /// What to look at before all leaves.
    fn first(&self) -> Option<Spot> {
        None
    }
    /// Planes that are known not to matter.
    fn exempt(&self) -> &[u32] {
        &[]
    }
}

struct Nearest<'a, S: Simd> {
    active: Mask,
    lo: S::F32x16,
    hi: S::F32x16,
    best: [u32; LANES],
    ties: Ties<'a>,
}

impl<S: Simd> Visit<S> for Nearest<'_, S> {
    const NEARS: bool = true;
    #[inline(always)]
    fn bound(&self) -> S::F32x16 {
        self.hi
    }
    #[inline(always)]
    fn active(&self) -> Mask {
        self.active
    }
    #[inline(always)]
    fn visit(&mut self, id: u32, _: Option<Spot>, m: Intersection<S::F32x16>, doubts: &mut Vec<Doubt>) {
        let may = m.may & !self.hi.lt(m.lo);
        if may == 0 {
            return;
        }
        let nearest = may & m.sure & m.hi.lt(self.lo);
        self.lo = m.lo.select(nearest, self.lo);
        self.hi = m.hi.select(nearest, self.hi);
        S::put(&mut self.best, nearest & !m.inside, id);
        if m.inside != 0 {
            S::put(&mut self.best, nearest & m.inside, id | INSIDE);
        }
        let rest = may & !nearest;
        if rest != 0 {
            let rest = self.ties.left(id, rest);
            self.hi = m.hi.min(self.hi).select(rest & m.sure, self.hi);
            let rest = self.ties.nearest(id, rest, m.sure, &mut self.best);
            push_doubts::<S>(id, rest, m.lo, doubts);
        }
    }
}

#[inline(never)]
fn push(id: u32, mask: Mask, lo: &[f32; LANES], doubts: &mut Vec<Doubt>) {
    for lane in lanes(mask) {
        doubts.push(Doubt { lane: lane as u8, id, lo: lo[lane] });
    }
}

#[inline(always)]
fn push_doubts<S: Simd>(id: u32, mask: Mask, lo: S::F32x16, doubts: &mut Vec<Doubt>) {
    let mut out = [0.0; LANES];
    lo.store(&mut out);
    push(id, mask, &out, doubts);
}

struct Blocked<'a, S: Simd> {
    active: Mask,
    one: S::F32x16,
    last: &'a mut Option<Spot>,
    exempt: &'a [u32],
    ties: Ties<'a>,
}

impl<S: Simd> Visit<S> for Blocked<'_, S> {
    const NEARS: bool = false;
    #[inline(always)]
    fn bound(&self) -> S::F32x16 {
        self.one
    }
    #[inline(always)]
    fn active(&self) -> Mask {
        self.active
    }
    #[inline(always)]
    fn visit(&mut self, id: u32, spot: Option<Spot>, m: Intersection<S::F32x16>, doubts: &mut Vec<Doubt>) {
        let may = m.may & self.active & !self.one.lt(m.lo);
        if may == 0 {
            return;
        }
        let blocked = may & m.sure & m.hi.lt(self.one);
        self.active &= !blocked;
        if blocked != 0 && spot.is_some() {
            *self.last = spot;
        }
        let rest = may & !blocked;
        if rest != 0 {
            push_doubts::<S>(id, self.ties.left(id, rest), m.lo, doubts);
        }
    }
    #[inline(always)]
    fn first(&self) -> Option<Spot> {
        *self.last
    }
    #[inline(always)]
    fn exempt(&self) -> &[u32] {
        self.exempt
    }
}

/// Finds what the packet's rays meet first: `out.best` where `out.doubts` names no candidate of the lane,
/// else among both.
#[inline(always)]
pub(crate) fn closest<S: Simd>(filter: &Filter, bvh: &Bvh<f32>, packet: &Packet, ties: Ties<'_>, out: &mut Walk) {
    let far = S::F32x16::splat(f32::INFINITY);
    // Of lanes that are not active nothing is near enough.
    let hi = far.select(packet.active, S::F32x16::splat(-1.0));
    let mut visitor = Nearest::<S> { active: packet.active, lo: far, hi, best: [NONE; LANES], ties };
    out.doubts.clear();
    walk::<S, _>(filter, bvh, packet, &mut visitor, &mut out.stacks, &mut out.doubts);
    out.best = visitor.best;
    visitor.hi.store(&mut out.best_hi);
    if !out.doubts.is_empty() {
        out.prune(&visitor.ties);
    }
}

/// Finds which of the packet's segments [0, 1] are surely blocked; of the others, `out.doubts` names what may block.
/// What blocked segments `last` is tried first, and is then what did now: neighbours are often in one shadow. Planes
/// `exempt` hold the segments' ends.
#[inline(always)]
pub(crate) fn blocked<S: Simd>(
    filter: &Filter,
    bvh: &Bvh<f32>,
    packet: &Packet,
    last: &mut Option<Spot>,
    exempt: &[u32],
    ties: Ties<'_>,
    out: &mut Walk,
) -> Mask {
    let mut visitor = Blocked::<S> { active: packet.active, one: S::F32x16::splat(1.0), last, exempt, ties };
    out.doubts.clear();
    walk::<S, _>(filter, bvh, packet, &mut visitor, &mut out.stacks, &mut out.doubts);
    let blocked = packet.active & !visitor.active;
    out.doubts.retain(|d| blocked >> d.lane & 1 == 0);
    blocked
}
