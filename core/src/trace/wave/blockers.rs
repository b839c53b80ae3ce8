//! What blocks lights: asked only of recorded paths, after they were traced.

use super::{PATHS, Stage, WaveScratch};
use crate::bvh::Boxes;
use crate::geometry::ObjectId;
use crate::simd::{Kernel, LANES, Simd};
use crate::trace::arbiter::Decision;
use crate::trace::packet::{self, INSIDE, NONE};
use crate::trace::record::Dark;
use crate::trace::{PreparedScene, Tracer, query};

/// Finds for each segment what is in its way first, as far as f64 tells; [`NONE`] for nothing.
pub(crate) struct Blockers<'a> {
    pub(crate) tracer: &'a Tracer,
    pub(crate) dark: &'a [Dark],
    pub(crate) scratch: &'a mut WaveScratch,
}

impl Kernel for Blockers<'_> {
    type Output = Vec<u32>;
    #[inline(always)]
    fn run<S: Simd>(self) -> Vec<u32> {
        let (Some(filter), Boxes::Single(wide)) = (&self.tracer.prepared.filter, &self.tracer.prepared.boxes) else {
            return self.run_scalar();
        };
        let stage = Stage { tracer: self.tracer, filter, wide };
        let WaveScratch { rays, packet, walk, path, .. } = self.scratch;
        let mut found = Vec::with_capacity(self.dark.len());
        for dark in self.dark.chunks(PATHS) {
            for (i, d) in dark.iter().enumerate() {
                for (k, (o, to)) in
                    [d.ray.o.x, d.ray.o.y, d.ray.o.z].into_iter().zip([d.ray.d.x, d.ray.d.y, d.ray.d.z]).enumerate()
                {
                    (rays.o[k][i], rays.d[k][i]) = (o, to);
                }
                (rays.eo[i], rays.ed[i], rays.own[i]) = (d.ray.eo, d.ray.ed, d.from);
            }
            for at in (0..dark.len()).step_by(LANES) {
                let [all, near] = stage.nearest::<S>(rays, at, dark.len(), packet, walk);
                let open = walk.open(all, near);
                for lane in packet::lanes(all) {
                    let sure = (walk.best[lane] != NONE).then_some(walk.best[lane]);
                    if open >> lane & 1 == 0 {
                        found.push(sure.map_or(NONE, |id| id & !INSIDE));
                        continue;
                    }
                    let among = walk.doubts_of(lane).chain(sure);
                    let among = (near >> lane & 1 == 1).then_some(among);
                    found.push(first(&self.tracer.prepared, &dark[at + lane], among, &mut path.query));
                }
            }
        }
        found
    }

    fn run_scalar(self) -> Vec<u32> {
        let query = &mut self.scratch.path.query;
        let none = None::<std::iter::Empty<u32>>;
        self.dark.iter().map(|d| first(&self.tracer.prepared, d, none.clone(), query)).collect()
    }
}

/// What is first `among` these objects, or all.
#[inline(never)]
fn first(
    prepared: &PreparedScene,
    dark: &Dark,
    among: Option<impl Iterator<Item = u32>>,
    query: &mut query::Scratch,
) -> u32 {
    let from = Decision::of(dark.from);
    match among {
        Some(ids) => prepared.closest_among(&dark.ray, from, ids.map(|id| ObjectId(id & !INSIDE)), query),
        None => prepared.closest(&dark.ray, from, query),
    };
    query.seemingly_closest().unwrap_or(NONE)
}
