//! What a region's pixel corners show, with one more pixel all around.

use rayon::prelude::*;

use super::part::Part;
use super::store::{SampleId, Store, UNIT, plane_origin, rms};
use crate::film::Region;
use crate::trace::record::{Records, Want};
use crate::trace::{PlanePoint, RayCounts, Tracer, WaveScratch};

/// Corners along the edge of the pieces that threads take.
const PIECE: u32 = 16;

pub(crate) struct Corners {
    region: Region,
    pub(crate) records: Records,
    /// Places in `records`, row by row.
    places: Vec<u32>,
    /// Squared contrasts of the edges between each corner and its neighbours right and below.
    edges: Vec<[f64; 2]>,
    pub(crate) least: f64,
    /// The largest radiance that the scene can send.
    brightest: f64,
    pub(crate) counts: RayCounts,
}

impl Corners {
    /// The corners of `region`; paths of less weight than `least` are not followed.
    pub(crate) fn new(tracer: &Tracer, region: Region, least: f64) -> Self {
        let (x, y) = plane_origin(tracer, region);
        let (w, h) = (region.width() + 3, region.height() + 3);
        let mut pieces = Vec::new();
        for j in (0..h).step_by(PIECE as usize) {
            for i in (0..w).step_by(PIECE as usize) {
                pieces.push((i, j, w.min(i + PIECE), h.min(j + PIECE)));
            }
        }
        let lights = tracer.lights().len();
        let done: Vec<_> = pieces
            .into_par_iter()
            .map_init(WaveScratch::default, |scratch, (i0, j0, i1, j1)| {
                let at = |i: u32, j: u32| PlanePoint { x: x + UNIT * (i as i32 - 1), y: y - UNIT * (j as i32 - 1) };
                let points: Vec<PlanePoint> = (j0..j1).flat_map(|j| (i0..i1).map(move |i| at(i, j))).collect();
                let wants = vec![Want::From(1); points.len()];
                let (mut records, mut counts) = (Records::new(lights), RayCounts::default());
                tracer.record(&points, &wants, least, &mut records, scratch, &mut counts);
                ((i0, j0, i1), records, counts)
            })
            .collect();
        let mut corners = Self {
            region,
            records: Records::new(lights),
            places: vec![0; (w * h) as usize],
            edges: Vec::new(),
            least,
            brightest: tracer.brightest(),
            counts: RayCounts::default(),
        };
        for ((i0, j0, i1), records, counts) in done {
            let start = corners.records.len() as u32;
            for k in 0..records.len() as u32 {
                let (i, j) = (i0 + k % (i1 - i0), j0 + k / (i1 - i0));
                corners.places[(j * w + i) as usize] = start + k;
            }
            corners.records.append(&records);
            corners.counts += counts;
        }
        corners.edges = corners.find_edges(tracer);
        corners
    }

    fn find_edges(&self, tracer: &Tracer) -> Vec<[f64; 2]> {
        let (w, h) = (self.region.width() as usize + 3, self.region.height() as usize + 3);
        let store = Store::new(tracer, &self.records, self.region, self.least);
        let all: Vec<_> =
            self.places.iter().map(|&s| (store.signature(s, Part::From(1)), store.value(s, Part::From(1)))).collect();
        let edge = |a: usize, b: usize| {
            if all[a].0 == all[b].0 { 0.0 } else { rms(all[a].1 - all[b].1) * rms(all[a].1 - all[b].1) }
        };
        (0..w * h)
            .map(|at| {
                let (i, j) = (at % w, at / w);
                [if i + 1 < w { edge(at, at + 1) } else { 0.0 }, if j + 1 < h { edge(at, at + w) } else { 0.0 }]
            })
            .collect()
    }

    /// Where the upper left corner of pixel (x, y) is among all.
    fn index(&self, x: u32, y: u32) -> usize {
        let (i, j) = (x + 1 - self.region.x0, y + 1 - self.region.y0);
        (j * (self.region.width() + 3) + i) as usize
    }

    /// The sample at the upper left corner of pixel (x, y).
    pub(crate) fn at(&self, x: u32, y: u32) -> SampleId {
        self.places[self.index(x, y)]
    }

    /// How much may hide in pixel (x, y): the contrast of the edges in and next to it, and how
    /// dense they are.
    pub(crate) fn busy(&self, (x, y): (u32, u32), tolerance: f64) -> f64 {
        let w = self.region.width() as usize + 3;
        let first = self.index(x, y) - w - 1;
        let (mut sum, mut count) = (0.0, 0.0);
        for j in 0..4 {
            for i in 0..4 {
                let edges = self.edges[first + j * w + i];
                for (e, inside) in [(edges[0], i < 3), (edges[1], j < 3)] {
                    if inside && e > tolerance * tolerance {
                        sum += e;
                        count += 1.0;
                    }
                }
            }
        }
        if count == 0.0 {
            return 0.0;
        }
        let density: f64 = count / 24.0;
        (sum / count).sqrt() * density * density * density
    }

    /// Bounds on what the path of a sample lost as too faint, and as too deep.
    pub(crate) fn lost(&self, s: SampleId) -> (f64, f64) {
        let Some((_, last)) = self.records.path(s as usize).last() else { return (0.0, 0.0) };
        if last.lost == 0.0 {
            return (0.0, 0.0);
        }
        let bound = last.lost * self.brightest;
        if last.lost < self.least { (bound, 0.0) } else { (0.0, bound) }
    }
}
