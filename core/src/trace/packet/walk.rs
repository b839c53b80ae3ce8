//! The way of a packet down the hierarchy.
//!
//! Rays that stay together are tested against one box after another, sixteen rays at a time.
//! Where few of them are left, each goes on alone, against eight boxes at a time (Benthin,
//! Wald, Woop, Ernst, *Combining single and packet-ray tracing for arbitrary ray
//! distributions on the Intel MIC architecture*, TVCG 18(9), 2012). What will be visited is
//! asked of memory when it is found, long before it is needed.

use super::beam::{Beam, LEAST_NODES};
use super::meet::{Rays, meet_plane, meet_sphere, meet_triangle};
use super::{Doubt, INSIDE, Packet, Visit, lanes};
use crate::bvh::{Child, Link, Node, WIDTH, Wide};
use crate::simd::{LANES, Mask, Octet, Simd, Single, prefetch};
use crate::trace::filter::Filter;

/// Up to so many rays go on alone.
const ALONE: u32 = 2;

#[derive(Clone, Copy)]
#[repr(align(64))]
struct Entry {
    near: [f32; LANES],
    link: Child,
    mask: Mask,
}

const EMPTY: Entry = Entry { near: [0.0; LANES], link: Child::NOTHING, mask: 0 };

/// What is still to be visited: by the packet, and by the one ray that left it.
pub(super) struct Stacks {
    packet: Vec<Entry>,
    alone: Vec<(f32, Child)>,
    /// 1/d, and −(o ± pad)/d for lower and upper ends of boxes; of a packet that a ray has left.
    single: Box<[[[f32; LANES]; 3]; 3]>,
}

impl Default for Stacks {
    fn default() -> Self {
        Self {
            packet: vec![EMPTY; 64 * WIDTH],
            alone: vec![(0.0, Child::NOTHING); 64 * WIDTH],
            single: Box::new([[[0.0; LANES]; 3]; 3]),
        }
    }
}

/// The scene and the packet's rays, as every step needs them.
struct Journey<'a, S: Simd> {
    filter: &'a Filter,
    wide: &'a Wide<f32>,
    packet: &'a Packet,
    rays: Rays<S>,
    /// What all rays have in common; only in hierarchies where that pays.
    beam: Option<Beam>,
    /// −(o ± pad)/d where boxes are entered and left, if rays have one sign on each axis.
    ends: [[S::Single; 3]; 2],
    /// No ray goes farther.
    far: f32,
    single: &'a mut [[[f32; LANES]; 3]; 3],
    /// Whether `single` is this packet's.
    filled: bool,
}

#[inline(always)]
pub(super) fn walk<S: Simd, V: Visit<S>>(
    filter: &Filter,
    wide: &Wide<f32>,
    packet: &Packet,
    visitor: &mut V,
    stacks: &mut Stacks,
    doubts: &mut Vec<Doubt>,
) {
    let rays = Rays::<S>::new(packet);
    if !filter.planes.is_empty() {
        let ed = S::Single::load(&packet.ed);
        for (k, plane) in filter.planes.iter().enumerate() {
            let mask = visitor.active() & !S::equal(&packet.own, k as u32);
            let m = meet_plane(&rays, plane, ed, mask);
            if m.may != 0 {
                visitor.visit(k as u32, m, doubts);
            }
        }
    }
    if wide.nodes.is_empty() || visitor.active() == 0 {
        return;
    }
    let mut journey =
        Journey::<S>::new((filter, wide, packet), rays, &mut stacks.single, visitor.active(), visitor.bound());
    let mut top = 1;
    stacks.packet[0] = Entry { near: [0.0; LANES], link: Child::ROOT, mask: visitor.active() };
    while top > 0 {
        top -= 1;
        let entry = &stacks.packet[top];
        let near = S::Single::load(&entry.near);
        let mask = entry.mask & visitor.active() & near.le(visitor.bound());
        if mask == 0 {
            continue;
        }
        match entry.link.link() {
            Link::Nothing => {}
            Link::Inner(index) if mask.count_ones() <= ALONE => {
                for lane in lanes(mask) {
                    journey.alone(lane, index, visitor, &mut stacks.alone, doubts);
                }
                if visitor.active() == 0 {
                    return;
                }
                journey.shorten(visitor.bound());
            }
            Link::Inner(index) => top = journey.open(index, mask, visitor.bound(), &mut stacks.packet, top),
            Link::Leaf { kind, start, count } => {
                journey.leaf(kind, start, count, mask, visitor, doubts);
                if visitor.active() == 0 {
                    return;
                }
                journey.shorten(visitor.bound());
            }
        }
    }
}

impl<'a, S: Simd> Journey<'a, S> {
    #[inline(always)]
    fn new(
        (filter, wide, packet): (&'a Filter, &'a Wide<f32>, &'a Packet),
        rays: Rays<S>,
        single: &'a mut [[[f32; LANES]; 3]; 3],
        active: Mask,
        bound: S::Single,
    ) -> Self {
        let beam = (wide.nodes.len() > LEAST_NODES).then(|| Beam::new::<S>(&rays, active));
        let mut ends = [rays.low, rays.high];
        if let Some(beam) = &beam {
            for k in 0..3 {
                if beam.flip[k] {
                    (ends[0][k], ends[1][k]) = (rays.high[k], rays.low[k]);
                }
            }
        }
        let mut journey = Self { filter, wide, packet, rays, beam, ends, far: f32::INFINITY, single, filled: false };
        journey.shorten(bound);
        journey
    }

    /// Notes how far rays may still go.
    #[inline(always)]
    fn shorten(&mut self, bound: S::Single) {
        if self.beam.is_some() {
            self.far = bound.greatest();
        }
    }

    /// Pushes the children of node `index` that rays of `mask` meet, the nearest last.
    #[inline(always)]
    fn open(&self, index: usize, mask: Mask, bound: S::Single, stack: &mut Vec<Entry>, top: usize) -> usize {
        let node = &self.wide.nodes[index];
        let Some(beam) = &self.beam else {
            return self.open_boxes::<false>(u8::MAX, node, [false; 3], mask, bound, stack, top);
        };
        let may = beam.meets::<S>(node, self.far);
        if beam.one_sign {
            self.open_boxes::<true>(may, node, beam.flip, mask, bound, stack, top)
        } else {
            self.open_boxes::<false>(may, node, [false; 3], mask, bound, stack, top)
        }
    }

    /// The same for the boxes of `may`; with `ONE_SIGN` of directions, they are entered at their
    /// upper ends where `flip` says so.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one step of a walk, cut out to be compiled twice")]
    fn open_boxes<const ONE_SIGN: bool>(
        &self,
        mut may: u8,
        node: &Node<f32>,
        flip: [bool; 3],
        mask: Mask,
        bound: S::Single,
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
                near.store(&mut entry.near);
                entry.link = child;
                entry.mask = hit;
                if entry.near[lead] < nearest {
                    nearest = entry.near[lead];
                    nearest_at = top;
                }
                top += 1;
            }
        }
        if top > first + 1 {
            stack.swap(nearest_at, top - 1);
        }
        top
    }

    /// Asks memory for what `child` names.
    #[inline(always)]
    fn expect(&self, child: Child) {
        match child.link() {
            Link::Inner(index) => prefetch(&self.wide.nodes, index, 1),
            Link::Leaf { kind: 0, start, count } => prefetch(&self.filter.triangles, start, count),
            Link::Leaf { start, count, .. } => prefetch(&self.filter.spheres, start, count),
            Link::Nothing => {}
        }
    }

    /// Takes the ray of one lane through all that is below node `index`.
    #[inline(always)]
    fn alone<V: Visit<S>>(
        &mut self,
        lane: usize,
        index: usize,
        visitor: &mut V,
        stack: &mut Vec<(f32, Child)>,
        doubts: &mut Vec<Doubt>,
    ) {
        if !self.filled {
            self.filled = true;
            for k in 0..3 {
                self.rays.inv[k].store(&mut self.single[0][k]);
                self.rays.low[k].store(&mut self.single[1][k]);
                self.rays.high[k].store(&mut self.single[2][k]);
            }
        }
        let lane = lane & (LANES - 1);
        let one = |a: &[[f32; LANES]; 3]| [a[0][lane], a[1][lane], a[2][lane]];
        let (inv, low, high) = (one(&self.single[0]), one(&self.single[1]), one(&self.single[2]));
        let splat = S::Octet::splat;
        let inv8 = [splat(inv[0]), splat(inv[1]), splat(inv[2])];
        let low8 = [splat(low[0]), splat(low[1]), splat(low[2])];
        let high8 = [splat(high[0]), splat(high[1]), splat(high[2])];
        let zero = splat(0.0);
        let mut bound = Self::of(visitor.bound(), lane);
        let mut at = Child::inner(index);
        let mut top = 0;
        loop {
            match at.link() {
                Link::Nothing => {}
                Link::Inner(index) => {
                    let node = &self.wide.nodes[index];
                    let (mut near, mut far) = (zero, splat(bound));
                    for k in 0..3 {
                        // Entered at the lower end and left at the upper, or the reverse.
                        let a = S::Octet::load(&node.lo[k]).fma(inv8[k], low8[k]);
                        let b = S::Octet::load(&node.hi[k]).fma(inv8[k], high8[k]);
                        let (enter, leave) = if inv[k] >= 0.0 { (a, b) } else { (b, a) };
                        near = near.max(enter);
                        far = far.min(leave);
                    }
                    let mut hit = near.le(far);
                    if hit != 0 {
                        if top + WIDTH > stack.len() {
                            stack.resize(stack.len() * 2, (0.0, Child::NOTHING));
                        }
                        let mut enters = [0.0; WIDTH];
                        near.store(&mut enters);
                        // The nearest is kept in hand, the others pushed.
                        let mut slot = hit.trailing_zeros() as usize & (WIDTH - 1);
                        hit &= hit - 1;
                        let mut best = (enters[slot], node.child[slot]);
                        self.expect(best.1);
                        while hit != 0 {
                            slot = hit.trailing_zeros() as usize & (WIDTH - 1);
                            hit &= hit - 1;
                            let mut other = (enters[slot], node.child[slot]);
                            self.expect(other.1);
                            if other.0 < best.0 {
                                std::mem::swap(&mut other, &mut best);
                            }
                            stack[top] = other;
                            top += 1;
                        }
                        at = best.1;
                        continue;
                    }
                }
                Link::Leaf { kind, start, count } => {
                    self.leaf(kind, start, count, 1 << lane, visitor, doubts);
                    if visitor.active() >> lane & 1 == 0 {
                        return;
                    }
                    bound = Self::of(visitor.bound(), lane);
                }
            }
            loop {
                if top == 0 {
                    return;
                }
                top -= 1;
                if stack[top].0 <= bound {
                    break;
                }
            }
            at = stack[top].1;
        }
    }

    #[inline(always)]
    fn of(x: S::Single, lane: usize) -> f32 {
        let mut all = [0.0; LANES];
        x.store(&mut all);
        all[lane]
    }

    /// Shows the visitor what rays of `mask` meet in a leaf.
    #[inline(always)]
    fn leaf<V: Visit<S>>(
        &self,
        kind: u8,
        start: usize,
        count: usize,
        mask: Mask,
        visitor: &mut V,
        doubts: &mut Vec<Doubt>,
    ) {
        if kind == 0 {
            for t in &self.filter.triangles[start..start + count] {
                let mask = mask & !S::equal(&self.packet.own, t.id);
                let m = meet_triangle(&self.rays, t, mask);
                if m.may != 0 {
                    visitor.visit(t.id, m, doubts);
                }
            }
            return;
        }
        for sphere in &self.filter.spheres[start..start + count] {
            // A ray does not meet the sphere it left outward.
            let outside = S::equal(&self.packet.own, sphere.id);
            let within = S::equal(&self.packet.own, sphere.id | INSIDE);
            let mask = mask & !outside;
            let mut m = meet_sphere(&self.rays, sphere, mask);
            if within & mask != 0 {
                m.may |= within & mask;
                m.sure &= !within;
                m.lo = S::Single::splat(0.0).select(within, m.lo);
            }
            if m.may != 0 {
                visitor.visit(sphere.id, m, doubts);
            }
        }
    }
}
