//! The way of a packet down the hierarchy.
//!
//! Rays that stay together are tested against one box after another, sixteen rays at a time.
//! Where few of them are left, each goes on [alone](super::single), against eight boxes at a time (Benthin,
//! Wald, Woop, Ernst, *Combining single and packet-ray tracing for arbitrary ray
//! distributions on the Intel MIC architecture*, TVCG 18(9), 2012). In large hierarchies, what will be
//! visited is asked of memory when it is found, long before it is needed.

use super::beam::{Beam, LEAST_NODES};
use super::rays::{Apart, Rays};
use super::single::SingleRays;
use super::{Doubt, Packet, Spot, Visit};
use crate::bvh::{Bvh, Child, Coordinate, Link, Node, WIDTH};
use crate::shapes::filter::{InLeaves, One, OneOf};
use crate::shapes::{INSIDE, NONE, Shape, column, leaves, plane};
use crate::simd::{F32x16, Floats, LANES, Mask, Simd, prefetch};
use crate::traverse::filter::Filter;

/// Up to so many rays go on alone at a node, and at a leaf of more objects than that.
///
/// Rays that are alone wait less for memory. Where objects are many, they are also as small as what
/// lies between rays, which then have little more in common.
#[derive(Clone, Copy)]
struct Few {
    inner: u32,
    leaf: u32,
}

/// Hierarchies of more nodes, and their objects, are not at hand: so many nodes fill a second-level cache.
const AT_HAND: usize = 4096;

impl Few {
    fn of(bvh: &Bvh<f32>) -> Self {
        if bvh.nodes.len() > AT_HAND { Self { inner: 6, leaf: 2 } } else { Self { inner: 2, leaf: 0 } }
    }
}

#[derive(Clone, Copy)]
#[repr(align(64))]
struct Entry {
    near: [f32; LANES],
    link: Child,
    mask: Mask,
}

const EMPTY: Entry = Entry { near: [0.0; LANES], link: Child::NOTHING, mask: 0 };

/// What is still to be visited: by the packet, and by rays that left it.
pub(super) struct Stacks {
    packet: Vec<Entry>,
    alone: Box<SingleRays>,
    apart: Box<Apart>,
}

impl Default for Stacks {
    fn default() -> Self {
        Self { packet: vec![EMPTY; 64 * WIDTH], alone: Box::default(), apart: Box::default() }
    }
}

/// The scene and the packet's rays, as every step needs them.
pub(super) struct Journey<'a, S: Simd> {
    pub(super) filter: &'a Filter,
    pub(super) bvh: &'a Bvh<f32>,
    pub(super) packet: &'a Packet,
    pub(super) rays: Rays<S>,
    /// What all rays have in common; only in hierarchies where that pays.
    beam: Option<Beam>,
    /// −(o ± pad)/d where boxes are entered and left, if rays have one sign on each axis.
    ends: [[S::F32x16; 3]; 2],
    /// No ray goes farther.
    far: f32,
    pub(super) apart: &'a mut Apart,
}

#[inline(always)]
pub(super) fn walk<S: Simd, V: Visit<S>>(
    filter: &Filter,
    bvh: &Bvh<f32>,
    packet: &Packet,
    visitor: &mut V,
    stacks: &mut Stacks,
    doubts: &mut Vec<Doubt>,
) {
    let rays = Rays::<S>::new(packet);
    if !filter.planes.is_empty() {
        planes::<S, V>(filter, packet, &rays, visitor, doubts);
    }
    if filter.has_giants {
        giants::<S, V>(filter, packet, &rays, visitor, doubts);
    }
    if bvh.nodes.is_empty() || visitor.active() == 0 {
        return;
    }
    let mut journey =
        Journey::<S>::new((filter, bvh, packet), rays, &mut stacks.apart, visitor.active(), visitor.bound());
    if let Some(spot) = visitor.first() {
        journey.surely(spot, visitor, doubts);
        if visitor.active() == 0 {
            return;
        }
    }
    let mut top = 1;
    stacks.packet[0] = Entry { near: [0.0; LANES], link: Child::ROOT, mask: visitor.active() };
    let (alone, few) = (&mut *stacks.alone, Few::of(bvh));
    loop {
        let mut mask = 0;
        if top > 0 {
            top -= 1;
            let entry = &stacks.packet[top];
            mask = entry.mask & visitor.active();
            if V::NEARS {
                mask &= S::F32x16::load(&entry.near).le(visitor.bound());
            }
            if mask == 0 {
                continue;
            }
        }
        // Those that are alone go first where they are met again: they may need no more.
        if alone.lanes != 0 && (mask & alone.lanes != 0 || mask == 0) {
            journey.single(alone, visitor, doubts);
            if visitor.active() == 0 {
                return;
            }
            journey.shorten(visitor.bound());
            if mask != 0 {
                top += 1;
                continue;
            }
        }
        if mask == 0 {
            return;
        }
        let link = stacks.packet[top].link;
        match link.link() {
            Link::Nothing => {}
            Link::Inner(_) if mask.count_ones() <= few.inner => alone.leave(mask, link),
            Link::Leaf { count, .. } if mask.count_ones() <= few.leaf.min(count as u32 - 1) => alone.leave(mask, link),
            Link::Inner(index) => {
                top = journey.open::<V>(index, mask, visitor.bound(), &mut stacks.packet, top);
            }
            Link::Leaf { .. } => {
                journey.leaf(link, mask, visitor, doubts);
                if visitor.active() == 0 {
                    return;
                }
                journey.shorten(visitor.bound());
            }
        }
    }
}

/// Shows the visitor what rays meet of the planes.
#[inline(always)]
fn planes<S: Simd, V: Visit<S>>(
    filter: &Filter,
    packet: &Packet,
    rays: &Rays<S>,
    visitor: &mut V,
    doubts: &mut Vec<Doubt>,
) {
    let ed = S::F32x16::load(&packet.ed);
    for (k, plane) in filter.planes.iter().enumerate() {
        let mut mask = visitor.active() & !S::equal(&packet.own, k as u32);
        if plane.through_eye {
            mask &= !S::equal(&packet.own, NONE);
        }
        if visitor.exempt().contains(&(k as u32)) {
            continue;
        }
        let m = plane::filter::intersect(&rays.ray, plane, ed, mask);
        if m.may != 0 {
            visitor.visit(k as u32, None, m, doubts);
        }
    }
}

/// Shows the visitor what rays meet of the giants.
#[inline(always)]
fn giants<S: Simd, V: Visit<S>>(
    filter: &Filter,
    packet: &Packet,
    rays: &Rays<S>,
    visitor: &mut V,
    doubts: &mut Vec<Doubt>,
) {
    let ed = S::F32x16::load(&packet.ed);
    column!(filter.columns, O, column => for (id, giant) in &column.giants {
        let mask = visitor.active() & !S::equal(&packet.own, *id);
        let mut m = O::intersect_giant(&rays.ray, giant, ed, mask);
        if O::HAS_INSIDE {
            let within = S::equal(&packet.own, id | INSIDE) & mask;
            if within != 0 {
                m.may |= within;
                m.sure &= !within;
                m.lo = S::F32x16::splat(0.0).select(within, m.lo);
            }
        }
        if m.may != 0 {
            visitor.visit(*id, None, m, doubts);
        }
    });
}

impl<'a, S: Simd> Journey<'a, S> {
    #[inline(always)]
    fn new(
        (filter, bvh, packet): (&'a Filter, &'a Bvh<f32>, &'a Packet),
        rays: Rays<S>,
        apart: &'a mut Apart,
        active: Mask,
        bound: S::F32x16,
    ) -> Self {
        let beam = (bvh.nodes.len() > LEAST_NODES).then(|| Beam::new::<S>(&rays, active));
        let mut ends = [rays.low, rays.high];
        if let Some(beam) = &beam {
            for k in 0..3 {
                if beam.flip[k] {
                    (ends[0][k], ends[1][k]) = (rays.high[k], rays.low[k]);
                }
            }
        }
        apart.forget();
        let mut journey = Self { filter, bvh, packet, rays, beam, ends, far: f32::INFINITY, apart };
        journey.shorten(bound);
        journey
    }

    /// Notes how far rays may still go.
    #[inline(always)]
    fn shorten(&mut self, bound: S::F32x16) {
        if self.beam.is_some() {
            self.far = bound.greatest();
        }
    }

    /// Pushes the children of node `index` that rays of `mask` meet, the nearest last where it matters.
    #[inline(always)]
    fn open<V: Visit<S>>(
        &self,
        index: usize,
        mask: Mask,
        bound: S::F32x16,
        stack: &mut Vec<Entry>,
        top: usize,
    ) -> usize {
        let node = &self.bvh.nodes[index];
        let Some(beam) = &self.beam else {
            return self.open_boxes::<V, false>(u8::MAX, node, [false; 3], mask, bound, stack, top);
        };
        let may = beam.meets::<S>(node, self.far);
        if beam.one_sign {
            self.open_boxes::<V, true>(may, node, beam.flip, mask, bound, stack, top)
        } else {
            self.open_boxes::<V, false>(may, node, [false; 3], mask, bound, stack, top)
        }
    }

    /// The same for the boxes of `may`; with `ONE_SIGN` of directions, they are entered at their
    /// upper ends where `flip` says so.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one step of a walk, cut out to be compiled twice")]
    fn open_boxes<V: Visit<S>, const ONE_SIGN: bool>(
        &self,
        mut may: u8,
        node: &Node<f32>,
        flip: [bool; 3],
        mask: Mask,
        bound: S::F32x16,
        stack: &mut Vec<Entry>,
        mut top: usize,
    ) -> usize {
        let mut ends = [&node.lo, &node.hi].map(|e| [&e[0], &e[1], &e[2]]);
        for k in 0..3 {
            if flip[k] {
                (ends[0][k], ends[1][k]) = (&node.hi[k], &node.lo[k]);
            }
        }
        if top + WIDTH > stack.len() {
            stack.resize(stack.len() * 2, EMPTY);
        }
        let lead = mask.trailing_zeros() as usize & (LANES - 1);
        let first = top;
        let mut nearest = f32::INFINITY;
        let mut nearest_at = top;
        while may != 0 {
            let slot = may.trailing_zeros() as usize & (WIDTH - 1);
            may &= may - 1;
            let child = node.child[slot];
            if child == Child::NOTHING {
                break;
            }
            let enter = [ends[0][0][slot], ends[0][1][slot], ends[0][2][slot]];
            let leave = [ends[1][0][slot], ends[1][1][slot], ends[1][2][slot]];
            let (near, far) = if ONE_SIGN {
                self.rays.one_sign(enter, leave, &self.ends, bound)
            } else {
                self.rays.slabs(enter, leave, bound)
            };
            let hit = near.le(far) & mask;
            if hit != 0 {
                self.expect(child);
                let entry = &mut stack[top];
                entry.link = child;
                entry.mask = hit;
                if V::NEARS {
                    near.store(&mut entry.near);
                    if entry.near[lead] < nearest {
                        nearest = entry.near[lead];
                        nearest_at = top;
                    }
                }
                top += 1;
            }
        }
        if V::NEARS && top > first + 1 {
            stack.swap(nearest_at, top - 1);
        }
        top
    }

    /// Asks memory for what `child` names, where that may be far.
    #[inline(always)]
    pub(super) fn expect(&self, child: Child) {
        if self.bvh.nodes.len() <= AT_HAND {
            return;
        }
        match child.link() {
            Link::Inner(index) => prefetch(&self.bvh.nodes, index, 1),
            Link::Leaf { kind, start, count } => {
                column!(self.filter.columns, kind, O, column => column.leaves.expect(start, count));
            }
            Link::Nothing => {}
        }
    }

    /// Shows the visitor which rays surely meet this object before their bounds.
    #[inline(always)]
    fn surely<V: Visit<S>>(&self, spot: Spot, visitor: &mut V, doubts: &mut Vec<Doubt>) {
        let Link::Leaf { kind, start, count } = spot.leaf.link() else { return };
        let (id, mut m) = column!(self.filter.columns, kind, O, column => {
            let leaf = column.leaves.leaf(start, count);
            let id = leaves::id(&leaf, spot.place);
            let mut mask = visitor.active() & !S::equal(&self.packet.own, id);
            if O::HAS_INSIDE {
                mask &= !S::equal(&self.packet.own, id | INSIDE);
            }
            (id, O::intersect(&self.rays.ray, &O::load(&One(&leaf, spot.place)), mask))
        });
        m.may &= m.sure & m.hi.lt(visitor.bound());
        if m.may != 0 {
            visitor.visit(id, Some(spot), m, doubts);
        }
    }

    /// Shows the visitor what rays of `mask` meet in a leaf.
    #[inline(always)]
    fn leaf<V: Visit<S>>(&self, link: Child, mask: Mask, visitor: &mut V, doubts: &mut Vec<Doubt>) {
        let Link::Leaf { kind, start, count } = link.link() else { return };
        column!(self.filter.columns, kind, O, column => {
            let leaf = column.leaves.leaf(start, count).spread();
            for i in 0..count {
                // A ray does not meet what it left outward.
                let id = leaf[leaf.len() - 1][i % WIDTH].tag();
                let mask = mask & !S::equal(&self.packet.own, id);
                let object = O::load(&OneOf(&leaf, i));
                let mut m = O::intersect(&self.rays.ray, &object, mask);
                if O::HAS_INSIDE {
                    let within = S::equal(&self.packet.own, id | INSIDE) & mask;
                    if within != 0 {
                        m = O::from_inside(&self.rays.ray, &object, within, m);
                    }
                }
                if m.may != 0 {
                    visitor.visit(id, Some(Spot { leaf: link, place: i }), m, doubts);
                }
            }
        });
    }
}
