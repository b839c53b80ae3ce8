//! One ray against the whole scene in f64: what it surely meets, or the few objects among
//! which exact arithmetic must choose.

use super::coplanar::FlatPlane;
use super::prepared::PreparedScene;
use crate::bvh::{Boxes, Bvh, Coordinate, Link, WIDTH};
use crate::numeric::{Scalar, TINY, U};
use crate::scene::SurfaceId;
use crate::shapes::{Decision, ObjectId, Ray, Span, surface_and_order, test};

/// What is met first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Closest {
    /// Surely nothing.
    Nothing,
    /// Surely this.
    Sure(Decision),
    /// One of the candidates, or nothing: ask exact arithmetic.
    Doubt,
}

/// Whether a segment is blocked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Occluded {
    No,
    Yes,
    /// By one of the candidates, or not at all: ask exact arithmetic.
    Doubt,
}

/// Memory of a query, kept between queries of one thread.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    found: Vec<(ObjectId, Span)>,
    stack: Vec<(Link, f64)>,
}

impl Scratch {
    /// Candidates that there is room for.
    pub(crate) fn capacity(&self) -> usize {
        self.found.capacity()
    }

    /// After a [`Closest::Doubt`] or [`Occluded::Doubt`]: the objects it concerns.
    pub(crate) fn candidates(&self) -> impl Iterator<Item = ObjectId> + '_ {
        self.found.iter().map(|(id, _)| *id)
    }

    /// After a [`Closest::Doubt`]: what f64 makes of it by itself, the middle of each interval.
    pub(crate) fn likely_closest(&self) -> Option<Decision> {
        let nearest = self.found.iter().min_by(|(_, a), (_, b)| a.middle().total_cmp(&b.middle()));
        nearest.map(|&(id, Span { inside, .. })| Decision { id, inside })
    }

    /// After an [`Occluded::Doubt`]: as [`Self::likely_closest`].
    pub(crate) fn likely_occluded(&self) -> bool {
        self.found.iter().any(|(_, s)| s.middle() > 0.0 && s.middle() < 1.0)
    }
}

/// A ray made ready for boxes: starts moved outward by all that it may be misplaced anywhere
/// in the scene, so that a box is surely met where the real ray meets it.
struct Slabs {
    /// Subtracted from a box's upper ends, and lower ends, per axis.
    minus: [f64; 3],
    plus: [f64; 3],
    inv: [f64; 3],
}

impl Slabs {
    fn new(ray: &Ray, reach: f64) -> Self {
        let pad = 2.0 * (ray.eo + (ray.ed + 8.0 * U) * (reach + ray.o.norm1())) + TINY;
        let (o, d) = (ray.o.to_dvec3().to_array(), ray.d.to_dvec3().to_array());
        Self { minus: o.map(|x| x - pad), plus: o.map(|x| x + pad), inv: d.map(|x| 1.0 / x) }
    }

    /// Where the box [lo, hi] is entered, or `None` where it is surely not met in [0, bound].
    /// `f64::max` and `min` discard the NaN of 0 · ∞, which means "no limit from this side".
    fn enter(&self, lo: [f64; 3], hi: [f64; 3], bound: f64) -> Option<f64> {
        let (mut near, mut far) = (0.0f64, bound);
        for k in 0..3 {
            let (first, last) = if self.inv[k] >= 0.0 {
                ((lo[k] - self.plus[k]) * self.inv[k], (hi[k] - self.minus[k]) * self.inv[k])
            } else {
                ((hi[k] - self.minus[k]) * self.inv[k], (lo[k] - self.plus[k]) * self.inv[k])
            };
            near = near.max(first);
            far = far.min(last);
        }
        // Three roundings a side.
        (near <= far + 8.0 * U * far.abs()).then_some(near * (1.0 - 8.0 * U))
    }
}

impl PreparedScene {
    /// Where `ray`, which starts on `from`, may meet object `id`.
    fn test(&self, ray: &Ray, id: ObjectId, from: Option<Decision>) -> Option<Span> {
        let own = from.filter(|f| f.id == id);
        let span = test(&self.scene, &self.local, ray, id, own)?;
        let known = !span.sure && self.starts_in_plane(from, ray.starts_at_origin(), id);
        (!known).then_some(span)
    }

    /// Calls `visit` for every object that may be met before `bound`, which it may lower.
    /// Ends when `visit` says so by `true`.
    fn walk(
        &self,
        ray: &Ray,
        from: Option<Decision>,
        bound: &mut f64,
        stack: &mut Vec<(Link, f64)>,
        visit: &mut impl FnMut(ObjectId, Span, &mut f64) -> bool,
    ) -> bool {
        for i in 0..self.local.planes.len() {
            let id = ObjectId(i as u32);
            if let Some(span) = self.test(ray, id, from)
                && span.lo <= *bound
                && visit(id, span, bound)
            {
                return true;
            }
        }
        match &self.boxes {
            Boxes::F32(bvh) => self.walk_boxes(bvh, ray, from, bound, stack, visit),
            Boxes::F64(bvh) => self.walk_boxes(bvh, ray, from, bound, stack, visit),
        }
    }

    fn walk_boxes<T: Coordinate>(
        &self,
        bvh: &Bvh<T>,
        ray: &Ray,
        from: Option<Decision>,
        bound: &mut f64,
        stack: &mut Vec<(Link, f64)>,
        visit: &mut impl FnMut(ObjectId, Span, &mut f64) -> bool,
    ) -> bool {
        if bvh.nodes.is_empty() {
            return false;
        }
        let slabs = Slabs::new(ray, bvh.reach());
        stack.clear();
        stack.push((Link::Inner(0), 0.0));
        while let Some((link, near)) = stack.pop() {
            if near > *bound {
                continue;
            }
            match link {
                Link::Nothing => {}
                Link::Inner(index) => {
                    let node = &bvh.nodes[index];
                    let mark = stack.len();
                    for slot in 0..WIDTH {
                        let link = node.child[slot].link();
                        if link == Link::Nothing {
                            break;
                        }
                        let lo = [0, 1, 2].map(|k| node.lo[k][slot].to_f64());
                        let hi = [0, 1, 2].map(|k| node.hi[k][slot].to_f64());
                        if let Some(enter) = slabs.enter(lo, hi, *bound) {
                            stack.push((link, enter));
                        }
                    }
                    // The nearest is taken first.
                    stack[mark..].sort_unstable_by(|a, b| b.1.total_cmp(&a.1));
                }
                Link::Leaf { kind, start, count } => {
                    for &id in &bvh.ids[usize::from(kind)][start..start + count] {
                        let id = ObjectId(id);
                        if let Some(span) = self.test(ray, id, from)
                            && span.lo <= *bound
                            && visit(id, span, bound)
                        {
                            return true;
                        }
                    }
                }
            }
        }
        false
    }

    /// What `ray`, which starts on `from`, meets first.
    pub(crate) fn closest(&self, ray: &Ray, from: Option<Decision>, scratch: &mut Scratch) -> Closest {
        let Scratch { found, stack } = scratch;
        found.clear();
        let mut bound = f64::INFINITY;
        self.walk(ray, from, &mut bound, stack, &mut |id, span, bound| {
            if span.sure && span.hi < *bound {
                *bound = span.hi;
            }
            found.push((id, span));
            false
        });
        self.nearest(found, bound)
    }

    /// As [`Self::closest`], among `ids` alone.
    pub(crate) fn closest_among(
        &self,
        ray: &Ray,
        from: Option<Decision>,
        ids: impl Iterator<Item = ObjectId>,
        scratch: &mut Scratch,
    ) -> Closest {
        let found = &mut scratch.found;
        found.clear();
        found.extend(ids.filter_map(|id| Some((id, self.test(ray, id, from)?))));
        let bound = found.iter().filter(|(_, s)| s.sure).map(|(_, s)| s.hi).fold(f64::INFINITY, f64::min);
        self.nearest(found, bound)
    }

    fn nearest(&self, found: &mut Vec<(ObjectId, Span)>, bound: f64) -> Closest {
        found.retain(|(_, s)| s.lo <= bound);
        if found.len() > 1 {
            self.drop_covered(found);
        }
        match found[..] {
            [] => Closest::Nothing,
            [(id, Span { sure: true, inside, .. })] => Closest::Sure(Decision { id, inside }),
            _ => Closest::Doubt,
        }
    }

    /// Drops what lies in one plane with something that is surely met and comes first in the document: both are
    /// met at one distance, if they are.
    pub(crate) fn drop_covered<R: Scalar>(&self, found: &mut Vec<(ObjectId, Span<R>)>) {
        if found.len() < 2 || !found.iter().any(|(_, span)| span.sure) {
            return;
        }
        found.sort_unstable_by_key(|(id, _)| surface_and_order(&self.scene, *id).1);
        // What comes before all that is sure is not covered.
        let first = found.iter().position(|(_, span)| span.sure).unwrap_or(0);
        let mut planes: Vec<u32> = Vec::new();
        let mut at = 0;
        found.retain(|&(id, span)| {
            at += 1;
            if at <= first {
                return true;
            }
            let Some(plane) = self.plane_of(id).map(FlatPlane::number) else { return true };
            let covered = planes.contains(&plane);
            if span.sure && !covered {
                planes.push(plane);
            }
            !covered
        });
    }

    /// Whether anything meets the open segment from `ray.o`, on `from`, to `ray.o + ray.d`, the place of the
    /// `light`-th light if it is one.
    pub(crate) fn occluded(
        &self,
        ray: &Ray,
        from: Option<Decision>,
        light: Option<usize>,
        scratch: &mut Scratch,
    ) -> Occluded {
        let Scratch { found, stack } = scratch;
        found.clear();
        let mut bound = 1.0;
        let blocked = self.walk(ray, from, &mut bound, stack, &mut |id, span, _| blocks(id, span, found));
        self.occlusion(blocked, light, found)
    }

    /// As [`Self::occluded`], among `ids` alone.
    pub(crate) fn occluded_among(
        &self,
        ray: &Ray,
        from: Option<Decision>,
        light: Option<usize>,
        ids: impl Iterator<Item = ObjectId>,
        scratch: &mut Scratch,
    ) -> Occluded {
        let found = &mut scratch.found;
        found.clear();
        let mut ids = ids;
        let blocked = ids.any(|id| self.test(ray, id, from).is_some_and(|span| blocks(id, span, found)));
        self.occlusion(blocked, light, found)
    }

    /// What was found of a segment, less what is known of the planes that hold its light.
    fn occlusion(&self, blocked: bool, light: Option<usize>, found: &mut Vec<(ObjectId, Span)>) -> Occluded {
        if blocked {
            return Occluded::Yes;
        }
        if let Some(light) = light
            && !found.is_empty()
        {
            // Such a plane is met where the segment ends.
            found.retain(|&(id, _)| !self.has_light_in_plane(id, light));
        }
        if found.is_empty() { Occluded::No } else { Occluded::Doubt }
    }

    /// The object's surface.
    pub(crate) fn surface_of(&self, id: ObjectId) -> SurfaceId {
        surface_and_order(&self.scene, id).0
    }
}

/// Whether what is met at `span` surely blocks a segment of length 1; where it may, it is noted.
fn blocks(id: ObjectId, span: Span, found: &mut Vec<(ObjectId, Span)>) -> bool {
    if span.sure && span.hi < 1.0 {
        return true;
    }
    if span.lo < 1.0 {
        found.push((id, span));
    }
    false
}
