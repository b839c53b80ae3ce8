//! Sixteen rays at once through the f32 scene: a filter that never decides what it cannot prove.
//!
//! **Bound.** With u = 2⁻²⁴ and an object whose points are at most V from the origin, hence at most
//! |o| + V from the start: the ray's own bound and its rounding misplace it there by at most
//! eo + ed(|o| + V) + u|o| + u(|o| + V); of a plane's offset h − n·o, 2uV + 5u|o| is lost, of n·d
//! 4u|d|, of a point's weights 6u·slope·V, of a sphere's q 5u(|o| + V) + 2uV. All of it is less than
//! pos = eo + (1.1·ed + 12u)·|o| + (1.1·ed + 10u)·V. A plane met at cosine c is then met within
//! pos/c, and weights are off by at most slope·pos·(1.2 + 1/c). Boxes moved outward by pad =
//! 1.1·(eo + (1.1·ed + 10u)(|o| + reach)) are met wherever the real ray meets them: (lo − o)·(1/d)
//! carries four roundings, less than 4u·(|o| + reach) in lo.
//!
//! Rays that start far outside the scene, or whose squares f32 cannot hold, are left to f64 altogether.

use super::filter::Filter;
use crate::bvh::{Link, WIDTH, Wide};
use crate::simd::{LANES, Mask, Simd, Single};

/// The unit roundoff of f32.
pub(crate) const U32: f32 = f32::EPSILON / 2.0;

/// No object.
pub(crate) const NONE: u32 = u32::MAX;
/// Set in an object's id where a sphere's inner side is struck.
pub(crate) const INSIDE: u32 = 1 << 31;

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

#[derive(Clone, Copy)]
#[repr(align(64))]
struct Entry {
    near: [f32; LANES],
    link: u32,
    mask: Mask,
}

/// What a packet found, and the memory it walked with.
pub(crate) struct Walk {
    stack: Vec<Entry>,
    pub(crate) doubts: Vec<Doubt>,
    /// The nearest sure object of each lane.
    pub(crate) best: [u32; LANES],
    best_hi: [f32; LANES],
}

impl Default for Walk {
    fn default() -> Self {
        let empty = Entry { near: [0.0; LANES], link: 0, mask: 0 };
        Self { stack: vec![empty; 64 * WIDTH], doubts: Vec::new(), best: [NONE; LANES], best_hi: [0.0; LANES] }
    }
}

impl Walk {
    /// Forgets candidates that lie surely beyond their lane's nearest sure object.
    fn prune(&mut self) {
        let best_hi = &self.best_hi;
        self.doubts.retain(|d| !(d.lo > best_hi[usize::from(d.lane)]));
    }
}

/// [e(0), e(1), e(2)] without a closure, which would not be compiled for the level's instructions.
macro_rules! each {
    ($k:ident => $e:expr) => {
        [
            {
                let $k = 0;
                $e
            },
            {
                let $k = 1;
                $e
            },
            {
                let $k = 2;
                $e
            },
        ]
    };
}

#[inline(always)]
fn lanes(mut mask: Mask) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (mask != 0).then(|| {
            let k = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            k
        })
    })
}

/// The packet in registers.
#[derive(Clone, Copy)]
struct Rays<S: Simd> {
    o: [S::Single; 3],
    d: [S::Single; 3],
    inv: [S::Single; 3],
    /// −(o ± pad)/d: for lower and for upper ends of boxes.
    low: [S::Single; 3],
    high: [S::Single; 3],
    near: S::Single,
    per: S::Single,
    dd_inv: S::Single,
    len: S::Single,
    inv_len: S::Single,
}

impl<S: Simd> Rays<S> {
    #[inline(always)]
    fn new(p: &Packet) -> Self {
        let o = each!(k => S::Single::load(&p.o[k]));
        let d = each!(k => S::Single::load(&p.d[k]));
        let near = S::Single::load(&p.near);
        let per = S::Single::load(&p.per);
        let pad = S::Single::load(&p.pad);
        // A component of 0 becomes tiny: a turn far below `ed`, and no 0 · ∞.
        let tiny = S::Single::splat(1e-30);
        let inv = each!(k => tiny.select(d[k].abs().lt(tiny), d[k]).recip());
        let low = each!(k => -((o[k] + pad) * inv[k]));
        let high = each!(k => -((o[k] - pad) * inv[k]));
        let dd = d[0].fma(d[0], d[1].fma(d[1], d[2] * d[2]));
        let dd_inv = dd.recip();
        let len = dd.sqrt() * S::Single::splat(1.0 + 16.0 * U32);
        let inv_len = len.recip() * S::Single::splat(1.0 + 32.0 * U32);
        Self { o, d, inv, low, high, near, per, dd_inv, len, inv_len }
    }

    /// Where the box is entered and left, `from` 0 `to` the bound.
    #[inline(always)]
    fn slabs(&self, lo: [f32; 3], hi: [f32; 3], bound: S::Single) -> (S::Single, S::Single) {
        let (mut near, mut far) = (S::Single::splat(0.0), bound);
        for k in 0..3 {
            let a = S::Single::splat(lo[k]).fma(self.inv[k], self.low[k]);
            let b = S::Single::splat(hi[k]).fma(self.inv[k], self.high[k]);
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        (near, far)
    }

    /// How far an object within `reach` of the origin may be misplaced.
    #[inline(always)]
    fn pos(&self, reach: f32) -> S::Single {
        self.per.fma(S::Single::splat(reach), self.near)
    }

    #[inline(always)]
    fn dot(a: [f32; 3], b: &[S::Single; 3]) -> S::Single {
        let s = S::Single::splat;
        s(a[0]).fma(b[0], s(a[1]).fma(b[1], s(a[2]) * b[2]))
    }
}

/// Lanes that may meet an object, those that surely do, and where.
struct Meeting<S: Simd> {
    may: Mask,
    sure: Mask,
    lo: S::Single,
    hi: S::Single,
    inside: Mask,
}

#[inline(always)]
fn meet_triangle<S: Simd>(r: &Rays<S>, t: &super::filter::FlatTriangle, mask: Mask) -> Meeting<S> {
    let s = S::Single::splat;
    let den = Rays::<S>::dot(t.n, &r.d);
    let num = s(t.h) - Rays::<S>::dot(t.n, &r.o);
    let inv = den.recip();
    let at = num * inv;
    let p = each!(k => r.d[k].fma(at, r.o[k]));
    let u = Rays::<S>::dot(t.u, &p) + s(t.u0);
    let v = Rays::<S>::dot(t.v, &p) + s(t.v0);
    let steep = inv.abs();
    let pos = r.pos(t.reach);
    let e = s(t.slope) * pos * r.len.fma(steep, s(1.2));
    let w = s(1.0) - u - v;
    let least = u.min(v).min(w);
    let et = s(1.2) * pos * steep;
    let (lo, hi) = (at - et, at + et);
    let zero = s(0.0);
    // Written so that NaN may be met and is never sure.
    let may = mask & !least.lt(-e) & !hi.lt(zero);
    let sure = e.lt(least) & zero.lt(lo);
    Meeting { may, sure, lo, hi, inside: 0 }
}

#[inline(always)]
fn meet_sphere<S: Simd>(r: &Rays<S>, sphere: &super::filter::FlatSphere, mask: Mask) -> Meeting<S> {
    let s = S::Single::splat;
    let oc = each!(k => r.o[k] - s(sphere.c[k]));
    let b = oc[0].fma(r.d[0], oc[1].fma(r.d[1], oc[2] * r.d[2]));
    let mid = -(b * r.dd_inv);
    let q = each!(k => r.d[k].fma(mid, oc[k]));
    let qq = q[0].fma(q[0], q[1].fma(q[1], q[2] * q[2]));
    let radius = s(sphere.r);
    let pos = r.pos(sphere.reach);
    let outer = radius + pos;
    let zero = s(0.0);
    let may = mask & !(outer * outer * s(1.0 + 16.0 * U32)).lt(qq);
    if may == 0 {
        return Meeting { may, sure: 0, lo: zero, hi: zero, inside: 0 };
    }
    let rr = radius * radius;
    let hh = rr - qq;
    let dhh = pos * (s(2.0) * radius + s(3.0) * pos) + s(16.0 * U32) * rr;
    let h = hh.max(zero).sqrt();
    let half = h * r.inv_len;
    let dh = (dhh * h.recip()).min(dhh.sqrt());
    let e = (pos + dh) * r.inv_len + s(32.0 * U32) * (mid.abs() + half);
    let inner = radius - pos;
    let cut = zero.lt(inner) & qq.lt(inner * inner * s(1.0 - 16.0 * U32));
    let (near, far) = (mid - half, mid + half);
    let ahead = zero.lt(near - e);
    let within = (near + e).lt(zero) & zero.lt(far - e);
    let sure = cut & (ahead | within);
    let inside = within & !ahead;
    // Where neither root is sure, anything from the near one on.
    let lo = (far - e).select(cut & inside, near - e);
    let hi = (near + e).select(cut & ahead, far + e);
    Meeting { may: may & !hi.lt(zero), sure, lo, hi, inside }
}

#[inline(always)]
fn meet_plane<S: Simd>(r: &Rays<S>, p: &super::filter::FlatPlane, ed: S::Single, mask: Mask) -> Meeting<S> {
    let s = S::Single::splat;
    let den = Rays::<S>::dot(p.n, &r.d);
    let num = s(p.h) - Rays::<S>::dot(p.n, &r.o);
    let inv = den.recip();
    let at = num * inv;
    let steep = inv.abs();
    let turn = (ed + s(16.0 * U32)) * r.len * steep;
    let et = (r.near + s(16.0 * U32 * p.h.abs())) * steep + at.abs() * turn;
    let et = et * s(2.0);
    let (lo, hi) = (at - et, at + et);
    let zero = s(0.0);
    // The direction surely leans towards one side of the plane.
    let leans = turn.lt(s(0.25));
    let may = mask & !(leans & hi.lt(zero));
    let sure = leans & zero.lt(lo);
    Meeting { may, sure, lo: lo.select(leans, s(0.0)), hi: hi.select(leans, s(f32::INFINITY)), inside: 0 }
}

/// What to do with meetings; `true` ends the walk.
trait Visit<S: Simd> {
    fn bound(&self) -> S::Single;
    fn active(&self) -> Mask;
    fn visit(&mut self, id: u32, m: Meeting<S>, walk: &mut Vec<Doubt>);
}

struct Nearest<S: Simd> {
    active: Mask,
    lo: S::Single,
    hi: S::Single,
    best: [u32; LANES],
}

impl<S: Simd> Visit<S> for Nearest<S> {
    #[inline(always)]
    fn bound(&self) -> S::Single {
        self.hi
    }
    #[inline(always)]
    fn active(&self) -> Mask {
        self.active
    }
    #[inline(always)]
    fn visit(&mut self, id: u32, m: Meeting<S>, doubts: &mut Vec<Doubt>) {
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
            self.hi = m.hi.min(self.hi).select(rest & m.sure, self.hi);
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
fn push_doubts<S: Simd>(id: u32, mask: Mask, lo: S::Single, doubts: &mut Vec<Doubt>) {
    let mut out = [0.0; LANES];
    lo.store(&mut out);
    push(id, mask, &out, doubts);
}

struct Blocked<S: Simd> {
    active: Mask,
    one: S::Single,
}

impl<S: Simd> Visit<S> for Blocked<S> {
    #[inline(always)]
    fn bound(&self) -> S::Single {
        self.one
    }
    #[inline(always)]
    fn active(&self) -> Mask {
        self.active
    }
    #[inline(always)]
    fn visit(&mut self, id: u32, m: Meeting<S>, doubts: &mut Vec<Doubt>) {
        let may = m.may & self.active & !self.one.lt(m.lo);
        if may == 0 {
            return;
        }
        let blocked = may & m.sure & m.hi.lt(self.one);
        self.active &= !blocked;
        let rest = may & !blocked;
        if rest != 0 {
            push_doubts::<S>(id, rest, m.lo, doubts);
        }
    }
}

#[inline(always)]
fn walk<S: Simd, V: Visit<S>>(
    filter: &Filter,
    wide: &Wide<f32>,
    packet: &Packet,
    visitor: &mut V,
    stack: &mut Vec<Entry>,
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
    let mut top = 0;
    stack[0] = Entry { near: [0.0; LANES], link: 0, mask: visitor.active() };
    top += 1;
    while top > 0 {
        top -= 1;
        let entry = &stack[top];
        let near = S::Single::load(&entry.near);
        let mask = entry.mask & visitor.active() & near.le(visitor.bound());
        if mask == 0 {
            continue;
        }
        match crate::bvh::Child(entry.link).link() {
            Link::Nothing => {}
            Link::Inner(index) => {
                let node = &wide.nodes[index];
                if top + WIDTH > stack.len() {
                    stack.resize(stack.len() * 2, Entry { near: [0.0; LANES], link: 0, mask: 0 });
                }
                let bound = visitor.bound();
                let lead = mask.trailing_zeros() as usize & (LANES - 1);
                let first = top;
                let mut nearest = f32::INFINITY;
                let mut nearest_at = top;
                for slot in 0..WIDTH {
                    let child = node.child[slot];
                    if child == crate::bvh::Child::NOTHING {
                        break;
                    }
                    let lo = each!(k => node.lo[k][slot]);
                    let hi = each!(k => node.hi[k][slot]);
                    let (near, far) = rays.slabs(lo, hi, bound);
                    let hit = near.le(far) & mask;
                    if hit != 0 {
                        let entry = &mut stack[top];
                        near.store(&mut entry.near);
                        entry.link = child.0;
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
            }
            Link::Leaf { kind: 0, start, count } => {
                for t in &filter.triangles[start..start + count] {
                    let mask = mask & !S::equal(&packet.own, t.id);
                    let m = meet_triangle(&rays, t, mask);
                    if m.may != 0 {
                        visitor.visit(t.id, m, doubts);
                    }
                }
                if visitor.active() == 0 {
                    return;
                }
            }
            Link::Leaf { start, count, .. } => {
                for sphere in &filter.spheres[start..start + count] {
                    // A ray does not meet the sphere it left outward.
                    let outside = S::equal(&packet.own, sphere.id);
                    let within = S::equal(&packet.own, sphere.id | INSIDE);
                    let mask = mask & !outside;
                    let mut m = meet_sphere(&rays, sphere, mask);
                    if within & mask != 0 {
                        m.may |= within & mask;
                        m.sure &= !within;
                        m.lo = S::Single::splat(0.0).select(within, m.lo);
                    }
                    if m.may != 0 {
                        visitor.visit(sphere.id, m, doubts);
                    }
                }
                if visitor.active() == 0 {
                    return;
                }
            }
        }
    }
}

/// Finds what the packet's rays meet first: `out.best` where `out.doubts` names no candidate of the lane,
/// else among both.
#[inline(always)]
pub(crate) fn closest<S: Simd>(filter: &Filter, wide: &Wide<f32>, packet: &Packet, out: &mut Walk) {
    let far = S::Single::splat(f32::INFINITY);
    let mut visitor = Nearest::<S> { active: packet.active, lo: far, hi: far, best: [NONE; LANES] };
    out.doubts.clear();
    walk::<S, _>(filter, wide, packet, &mut visitor, &mut out.stack, &mut out.doubts);
    out.best = visitor.best;
    visitor.hi.store(&mut out.best_hi);
    if !out.doubts.is_empty() {
        out.prune();
    }
}

/// Finds which of the packet's segments [0, 1] are surely blocked; of the others, `out.doubts` names what may block.
#[inline(always)]
pub(crate) fn blocked<S: Simd>(filter: &Filter, wide: &Wide<f32>, packet: &Packet, out: &mut Walk) -> Mask {
    let mut visitor = Blocked::<S> { active: packet.active, one: S::Single::splat(1.0) };
    out.doubts.clear();
    walk::<S, _>(filter, wide, packet, &mut visitor, &mut out.stack, &mut out.doubts);
    let blocked = packet.active & !visitor.active;
    out.doubts.retain(|d| blocked >> d.lane & 1 == 0);
    blocked
}
