//! What blocks lights: asked only of recorded paths, after they were traced.

use super::lanes::eight_at;
use super::{PATHS, Stage, WaveScratch};
use crate::bvh::Boxes;
use crate::geometry::ObjectId;
use crate::simd::{Kernel, LANES, Simd};
use crate::trace::packet::{self, INSIDE, NONE};
use crate::trace::record::Dark;
use crate::trace::{PreparedScene, Tracer, query};

use super::paths::decision;

/// Finds for each segment what is in its way first, as far as f64 tells.
pub(crate) struct Blockers<'a> {
    pub(crate) tracer: &'a Tracer,
    pub(crate) dark: &'a [Dark],
    pub(crate) scratch: &'a mut WaveScratch,
    /// The object in the way of each segment; [`NONE`] for none.
    pub(crate) found: &'a mut Vec<u32>,
}

impl Kernel for Blockers<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self) {
        let (Some(filter), Boxes::Single(wide)) = (&self.tracer.prepared.filter, &self.tracer.prepared.boxes) else {
            return self.run_scalar();
        };
        let stage = Stage { tracer: self.tracer, filter, wide };
        let WaveScratch { rays, packet, walk, path, .. } = self.scratch;
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
                let near = stage.fill::<S>(packet, &rays.eight::<S>(at), &rays.eight::<S>(at + 8));
                let all = ((1u32 << LANES.min(dark.len() - at)) - 1) as u16;
                packet.own[..8].copy_from_slice(eight_at(&rays.own, at));
                packet.own[8..].copy_from_slice(eight_at(&rays.own, at + 8));
                packet.active = all & near;
                packet::closest::<S>(filter, wide, packet, walk);
                let open = walk.open(all, near);
                for lane in packet::lanes(all) {
                    let sure = (walk.best[lane] != NONE).then_some(walk.best[lane]);
                    if open >> lane & 1 == 0 {
                        self.found.push(sure.map_or(NONE, |id| id & !INSIDE));
                        continue;
                    }
                    let among = walk.doubts_of(lane).chain(sure);
                    let among = (near >> lane & 1 == 1).then_some(among);
                    self.found.push(first(&self.tracer.prepared, &dark[at + lane], among, &mut path.query));
                }
            }
        }
    }

    fn run_scalar(self) {
        let query = &mut self.scratch.path.query;
        let none = None::<std::iter::Empty<u32>>;
        self.found.extend(self.dark.iter().map(|d| first(&self.tracer.prepared, d, none.clone(), query)));
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
    let from = decision(dark.from);
    match among {
        Some(ids) => prepared.closest_among(&dark.ray, from, ids.map(|id| ObjectId(id & !INSIDE)), query),
        None => prepared.closest(&dark.ray, from, query),
    };
    query.seemingly_closest().unwrap_or(NONE)
}
