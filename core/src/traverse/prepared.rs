//! A scene made ready for rays.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::coplanar::Coplanar;
use super::filter::{self, Filter};
use crate::bvh::{Boxes, Builder, Bvh, Coordinate, Item, KINDS};
use crate::scene::Scene;
use crate::shapes::giants::Candidates;
use crate::shapes::{Aabb, Giants, Local, ObjectId, SHAPES, bounds, coincide, firsts, leaf_ends};
use crate::simd::roomy;

/// A scene made ready for rays: independent of settings, shared by every render of it.
#[derive(Debug)]
pub struct PreparedScene {
    pub(crate) scene: Arc<Scene>,
    pub(crate) local: Local,
    pub(crate) boxes: Boxes,
    /// The scene for packets of f32 rays, where its numbers allow that.
    pub(crate) filter: Option<Filter>,
    /// Which objects lie in one plane.
    pub(crate) coplanar: Coplanar,
    /// Share of objects whose boxes f32 would enlarge noticeably.
    pub(crate) outgrown: f64,
    /// Triangles of exactly no area, which nothing can meet.
    pub(crate) flat: usize,
}

/// Share of objects whose boxes may grow noticeably before boxes are kept in f64.
const BLOATED: f64 = 0.05;

impl PreparedScene {
    /// Builds what rays meet. Uses the calling rayon pool; the result is the same for any pool.
    #[must_use]
    pub fn build(scene: Arc<Scene>) -> Self {
        let mut local = Local::new(&scene);
        let candidates = Candidates::default();
        let (boxes, outgrown, flat) = Self::boxes(&scene, &local, &candidates);
        let kept = match &boxes {
            Boxes::F32(bvh) => &bvh.ids,
            Boxes::F64(bvh) => &bvh.ids,
        };
        local.giants = Giants::new(&scene, &local, candidates, kept);
        let filter = Filter::new(&scene, &local, &boxes);
        let coplanar = Coplanar::new(&scene, &local);
        Self { scene, local, boxes, filter, coplanar, outgrown, flat }
    }

    /// The hierarchy, the share of objects that outgrow f32 boxes, and how many triangles have no area.
    fn boxes(scene: &Scene, local: &Local, candidates: &Candidates) -> (Boxes, f64, usize) {
        let outgrown = AtomicUsize::new(0);
        let (singles, flat) = items::<f32>(scene, local, filter::SLACK, &|id, b| {
            candidates.see(id, b);
            if grows(b) {
                outgrown.fetch_add(1, Ordering::Relaxed);
            }
        });
        let hidden = |a: u32, b: u32| b < a && coincide(scene, ObjectId(a), ObjectId(b));
        let builder = Builder::new(leaf_ends(scene), singles.len(), &hidden);
        let outgrown = outgrown.into_inner() as f64 / singles.len().max(1) as f64;
        let boxes = if outgrown > BLOATED {
            Boxes::F64(hierarchy(items::<f64>(scene, local, 0.0, &|_, _| ()).0, &builder))
        } else {
            Boxes::F32(hierarchy(singles, &builder))
        };
        (boxes, outgrown, flat)
    }

    /// The scene this was built from.
    #[must_use]
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }
}

/// Whether outward rounding to f32 enlarges `b` by more than half.
fn grows(b: &Aabb) -> bool {
    let perimeter = |lo: DVec3, hi: DVec3| (hi - lo).element_sum();
    let lo = DVec3::from_array(b.lo.to_array().map(|x| f32::down(x).to_f64()));
    let hi = DVec3::from_array(b.hi.to_array().map(|x| f32::up(x).to_f64()));
    !(perimeter(lo, hi) <= 1.5 * perimeter(b.lo, b.hi))
}

/// The boxes of all objects that leaves hold and something can meet, wider by `slack` of their distance from the
/// origin, and how many nothing can meet. `see` is called with each id and its box before that is widened and rounded.
fn items<T: Coordinate>(
    scene: &Scene,
    local: &Local,
    slack: f64,
    see: &(dyn Fn(u32, &Aabb) + Sync),
) -> (Vec<Item<T>>, usize) {
    let first = firsts(scene)[SHAPES - KINDS];
    let item = |i: u32| {
        let id = first + i;
        let mut b = bounds(scene, local, ObjectId(id));
        if b != Aabb::EMPTY {
            see(id, &b);
            b = b.padded(slack * b.farthest());
        }
        Item::new(b.lo.to_array().map(T::down), b.hi.to_array().map(T::up), id)
    };
    // Every one in its place first: that needs no second copy.
    let all = scene.object_count() - first as usize;
    let mut items = roomy(all);
    items.par_extend((0..all as u32).into_par_iter().map(item));
    if items.par_iter().any(Item::is_empty) {
        items.retain(|i| !i.is_empty());
    }
    let flat = all - items.len();
    (items, flat)
}

fn hierarchy<T: Coordinate>(mut items: Vec<Item<T>>, builder: &Builder<'_>) -> Bvh<T> {
    let bvh = builder.build(&mut items);
    // Many items take a while to be given back, and nobody waits for that.
    if rayon::current_num_threads() > 1 {
        rayon::spawn(move || drop(items));
    }
    bvh
}
