//! What holds for all rays of a packet.

use super::rays::Rays;
use crate::bvh::Node;
use crate::simd::{F32x8, F32x16, Floats, Mask, Simd};

/// Hierarchies of so few nodes are walked before a beam has paid for itself.
pub(super) const LEAST_NODES: usize = 8;

/// The intervals that starts and inverse directions of a packet's rays lie in: eight boxes at a
/// time are tested against all rays at once, and those that none can meet are left out (Wald,
/// Boulos, Shirley, *Ray tracing deformable scenes using dynamic bounding volume hierarchies*,
/// TOG 26(1), 2007).
///
/// Ends of intervals are moved outward by the rays' pads, and carry no more roundings than the
/// boxes before single rays, see the [packet's bound](super).
#[derive(Clone, Copy, Default)]
pub(super) struct Beam {
    /// Per axis: whether all directions are negative, so that boxes are entered at their upper ends.
    pub(super) flip: [bool; 3],
    /// Whether on each axis all directions have one sign.
    pub(super) one_sign: bool,
    /// Per axis: least and greatest 1/d, and with each −(o ± pad)/d for the end that is entered
    /// and for the one that is left. An axis with directions of both signs tells nothing.
    axes: [[f32; 6]; 3],
}

impl Beam {
    #[inline(always)]
    pub(super) fn new<S: Simd>(rays: &Rays<S>, active: Mask) -> Self {
        let s = S::F32x16::splat;
        let mut beam = Self { one_sign: true, ..Self::default() };
        for k in 0..3 {
            let negative = rays.inv[k].lt(s(0.0)) & active;
            let flip = negative == active;
            if negative != 0 && !flip {
                beam.one_sign = false;
                beam.axes[k] = [0.0, 0.0, -f32::MAX, -f32::MAX, f32::MAX, f32::MAX];
                continue;
            }
            beam.flip[k] = flip;
            let (inf, inv) = (s(f32::INFINITY), rays.inv[k]);
            let (i0, i1) = (inv.select(active, inf).least(), inv.select(active, -inf).greatest());
            let upper = (rays.ray.o[k] + rays.pad).select(active, -inf).greatest();
            let lower = (rays.ray.o[k] - rays.pad).select(active, inf).least();
            let (enter, leave) = if flip { (lower, upper) } else { (upper, lower) };
            beam.axes[k] = [i0, i1, -(enter * i0), -(enter * i1), -(leave * i0), -(leave * i1)];
        }
        beam
    }

    /// The boxes of `node` that some ray may meet before `far`.
    #[inline(always)]
    pub(super) fn meets<S: Simd>(&self, node: &Node<f32>, far: f32) -> u8 {
        let s = S::F32x8::splat;
        let (mut near, mut far) = (s(0.0), s(far));
        for k in 0..3 {
            // One by one: what a closure does is not surely compiled for the level's instructions.
            let [i0, i1, e0, e1, l0, l1] = self.axes[k];
            let (i0, i1, e0, e1, l0, l1) = (s(i0), s(i1), s(e0), s(e1), s(l0), s(l1));
            let (lo, hi) = (&node.lo[k], &node.hi[k]);
            let (enter, leave) = if self.flip[k] { (hi, lo) } else { (lo, hi) };
            let (enter, leave) = (S::F32x8::load(enter), S::F32x8::load(leave));
            near = near.max(enter.fma(i0, e0).min(enter.fma(i1, e1)));
            far = far.min(leave.fma(i0, l0).max(leave.fma(i1, l1)));
        }
        near.le(far)
    }
}
