//! Rays that have left their packet.
//!
//! A step of one ray waits for memory and for its own arithmetic, and then for what the processor
//! guessed wrongly of its outcome. So rays that are alone go on side by side: all take one step,
//! then it is seen where each of them stands.

use super::walk::Journey;
use super::{Doubt, Spot, Visit};
use crate::bvh::{Child, Link, WIDTH};
use crate::shapes::filter::{InLeaves, Intersection};
use crate::shapes::leaves::id;
use crate::shapes::{INSIDE, NONE, Shape, column};
use crate::simd::{F32x8, F32x16, Floats, LANES, Mask, Simd};

/// Where rays that are alone stand, a lane each.
#[derive(Default)]
pub(super) struct SingleRays {
    /// The lanes that are under way.
    pub(super) lanes: Mask,
    /// Those at leaves.
    leaves: Mask,
    at: [Child; LANES],
    /// What is still to be visited, and from where on.
    rest: [Vec<(f32, Child)>; LANES],
    /// Of a step: where boxes are entered and which are met, or which objects.
    nears: [[f32; WIDTH]; LANES],
    hits: [u8; LANES],
    met: [Met; LANES],
}

/// Eight meetings in memory.
#[derive(Clone, Copy, Default)]
struct Met {
    may: u8,
    sure: u8,
    inside: u8,
    lo: [f32; WIDTH],
    hi: [f32; WIDTH],
}

#[inline(always)]
fn next(mask: &mut Mask) -> usize {
    let lane = mask.trailing_zeros() as usize & (LANES - 1);
    *mask &= *mask - 1;
    lane
}

impl SingleRays {
    /// Lets the rays of `mask`, none of them alone yet, go on alone from `child`.
    #[inline(always)]
    pub(super) fn leave(&mut self, mut mask: Mask, child: Child) {
        self.lanes |= mask;
        while mask != 0 {
            let lane = next(&mut mask);
            self.rest[lane].clear();
            self.stand(lane, child);
        }
    }

    #[inline(always)]
    fn stand(&mut self, lane: usize, child: Child) {
        self.at[lane] = child;
        let leaf = matches!(child.link(), Link::Leaf { .. });
        self.leaves = self.leaves & !(1 << lane) | Mask::from(leaf) << lane;
    }

    /// Takes the ray of `lane` to what it is to visit next.
    #[inline(always)]
    fn back(&mut self, lane: usize, bound: f32) {
        while let Some((near, child)) = self.rest[lane].pop() {
            if near <= bound {
                return self.stand(lane, child);
            }
        }
        self.lanes &= !(1 << lane);
        self.leaves &= !(1 << lane);
    }
}

impl<S: Simd> Journey<'_, S> {
    /// Takes all rays that are alone through all that is left to them.
    #[inline(always)]
    pub(super) fn single<V: Visit<S>>(&mut self, alone: &mut SingleRays, visitor: &mut V, doubts: &mut Vec<Doubt>) {
        self.apart.fill(&self.rays);
        let mut bounds = [0.0; LANES];
        visitor.bound().store(&mut bounds);
        while alone.lanes != 0 {
            let inner = alone.lanes & !alone.leaves;
            let mut left = inner;
            while left != 0 {
                let lane = next(&mut left);
                let (near, hit) = self.boxes(lane, alone.at[lane], bounds[lane]);
                near.store(&mut alone.nears[lane]);
                alone.hits[lane] = hit;
            }
            left = inner;
            while left != 0 {
                let lane = next(&mut left);
                let mut hit = alone.hits[lane];
                if hit == 0 {
                    alone.back(lane, bounds[lane]);
                    continue;
                }
                let Link::Inner(index) = alone.at[lane].link() else { continue };
                let (children, near) = (&self.bvh.nodes[index].child, &alone.nears[lane]);
                // The nearest is kept in hand, the others wait.
                let mut slot = hit.trailing_zeros() as usize & (WIDTH - 1);
                let mut best = (near[slot], children[slot]);
                self.expect(best.1);
                hit &= hit - 1;
                while hit != 0 {
                    slot = hit.trailing_zeros() as usize & (WIDTH - 1);
                    hit &= hit - 1;
                    let mut other = (near[slot], children[slot]);
                    self.expect(other.1);
                    if other.0 < best.0 {
                        std::mem::swap(&mut other, &mut best);
                    }
                    alone.rest[lane].push(other);
                }
                alone.stand(lane, best.1);
            }
            // Leaves wait until all are at one.
            if alone.lanes != alone.leaves {
                continue;
            }
            let leaves = alone.leaves;
            left = leaves;
            while left != 0 {
                let lane = next(&mut left);
                self.objects(lane, alone.at[lane], &mut alone.met[lane]);
            }
            left = leaves;
            while left != 0 {
                let lane = next(&mut left);
                if alone.met[lane].may != 0 {
                    self.show(lane, alone.at[lane], &alone.met[lane], visitor, doubts);
                    visitor.bound().store(&mut bounds);
                }
                if visitor.active() >> lane & 1 == 0 {
                    bounds[lane] = -1.0;
                }
                alone.back(lane, bounds[lane]);
            }
        }
    }

    /// Where the ray of `lane` enters the boxes of an inner node, and which of them it meets.
    #[inline(always)]
    fn boxes(&self, lane: usize, node: Child, bound: f32) -> (S::F32x8, u8) {
        let splat = S::F32x8::splat;
        let (mut near, mut far) = (splat(0.0), splat(bound));
        let Link::Inner(index) = node.link() else { return (near, 0) };
        let node = &self.bvh.nodes[index];
        let [inv, low, high] = self.apart.slabs(lane);
        for k in 0..3 {
            // Entered at the lower end and left at the upper, or the reverse.
            let a = S::F32x8::load(&node.lo[k]).fma(splat(inv[k]), splat(low[k]));
            let b = S::F32x8::load(&node.hi[k]).fma(splat(inv[k]), splat(high[k]));
            let (enter, leave) = if inv[k] >= 0.0 { (a, b) } else { (b, a) };
            near = near.max(enter);
            far = far.min(leave);
        }
        (near, near.le(far))
    }

    /// What the ray of `lane` meets of the objects of a leaf.
    #[inline(always)]
    fn objects(&self, lane: usize, leaf: Child, met: &mut Met) {
        let Link::Leaf { kind, start, count } = leaf.link() else { return };
        let all = u8::MAX >> (WIDTH - count);
        let ray = self.apart.ray::<S>(self.packet, lane);
        let m = column!(self.filter.columns, kind, O, column => {
            let leaf = column.leaves.leaf(start, count);
            let objects = O::load(&leaf);
            let mut m = O::intersect(&ray, &objects, all);
            let own = self.packet.own[lane];
            if O::HAS_INSIDE && own & INSIDE != 0 && own != NONE {
                let mut within = 0;
                for i in 0..count {
                    within |= u8::from(id(&leaf, i) | INSIDE == own) << i;
                }
                if within != 0 {
                    m = O::from_inside(&ray, &objects, within, m);
                }
            }
            m
        });
        m.lo.store(&mut met.lo);
        m.hi.store(&mut met.hi);
        (met.may, met.sure, met.inside) = (m.may, m.sure, m.inside);
    }

    /// Shows the visitor what the ray of `lane` meets of a leaf. It does not meet what it left outward.
    #[inline(always)]
    fn show<V: Visit<S>>(&self, lane: usize, leaf: Child, met: &Met, visitor: &mut V, doubts: &mut Vec<Doubt>) {
        let Link::Leaf { kind, start, count } = leaf.link() else { return };
        let mut may = met.may;
        while may != 0 {
            let i = may.trailing_zeros() as usize & (WIDTH - 1);
            may &= may - 1;
            let id = column!(self.filter.columns, kind, O, column => id(&column.leaves.leaf(start, count), i));
            if id == self.packet.own[lane] {
                continue;
            }
            let (sure, inside) = (Mask::from(met.sure >> i & 1) << lane, Mask::from(met.inside >> i & 1) << lane);
            let (lo, hi) = (S::F32x16::splat(met.lo[i]), S::F32x16::splat(met.hi[i]));
            let spot = Some(Spot { leaf, place: i });
            visitor.visit(id, spot, Intersection { may: 1 << lane, sure, lo, hi, inside }, doubts);
        }
    }
}
