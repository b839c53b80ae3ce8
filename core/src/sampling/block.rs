//! A block of pixels: what of each is known from its corners, and what more is looked at.
//!
//! Pixels whose corners differ are cut into the parts that objects' outlines leave (see
//! [`super::strata`]). What is not known then is looked at: a single edge by its crossings
//! (see [`super::fit`]), everything else by cells (see [`super::cells`]),
//! and of the paths only that which differs between corners. All that the block's pixels want is
//! traced together, round after round. Every decision is a function of what is seen in the
//! pixel and at the corners of its neighbours, so that blocks and regions may be cut anyhow.

use glam::{DVec2, DVec3};

use super::cells::{Cells, Cut, Index};
use super::corners::{Corners, Seen};
use super::difference::Difference;
use super::fit::Side;
use super::gaps::Gaps;
use super::lattice::{UNIT, plane_origin, rms};
use super::small::{Mark, Marks, What};
use super::strata::Strata;
use super::work::{Key, View, Work};
use crate::film::{PixelError, Region};
use crate::trace::record::{Look, NONE, Probe, Records};
use crate::trace::{PlanePoint, RayCounts, Sample, Tracer, WaveScratch, packets};

/// New pixels are begun with while fewer points than this are asked for: waves of them are full, and the cells of
/// those begun with stay at hand.
const FULL: usize = 1024;
/// Small things are looked at one by one, where a pixel has no more of them.
const FEATURES: usize = 6;
/// Rays that are worth an error of one tolerance in a pixel.
pub(super) const WORTH: f64 = 12.0;
/// Only a part of a path is looked at where that takes no more than this share of its rays.
const SAVING: f64 = 0.6;
/// How far a part's middle is from where it was seen.
const SLOPE: f64 = 0.3;
/// Standard deviation of a pixel's mean that a shadow's outline passes unseen by corners, as a
/// share of the light it takes.
const EXPECTED: f64 = 0.15;
/// What hides beside a single edge at most, as a share of its contrast's square.
const CLEAN: f64 = 0.003;
/// A look at what is met first.
const FIRST: Look = Look { from: NONE, last: 1, lights: 0 };

/// A pixel's value and what is thought of its error.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pixel {
    pub(crate) value: DVec3,
    pub(crate) error: PixelError,
}

/// A side of a pixel whose edge is being looked for.
pub(super) struct Search {
    pub(super) side: Side,
    pub(super) start: PlanePoint,
    pub(super) horizontal: bool,
    pub(super) look: Look,
    /// What is seen at its start, and at its end.
    pub(super) ends: [Key; 2],
    /// Steps asked for.
    pub(super) wanted: u32,
    pub(super) asked: u32,
}

pub(super) struct Block<'a> {
    pub(super) tracer: &'a Tracer,
    pub(super) corners: &'a Corners,
    pub(super) region: Region,
    pub(super) tolerance: f64,
    pub(super) every_pixel: bool,
    pub(super) pixels: Vec<Pixel>,
    /// Paths through small things.
    pub(super) extra: Records,
    pub(super) searches: Vec<Search>,
    /// Of the upper and of the left side of each pixel, places in `searches`.
    pub(super) places: Vec<[u32; 2]>,
    pub(super) active: Vec<u32>,
    pub(super) points: Vec<PlanePoint>,
    pub(super) looks: Vec<Look>,
    pub(super) lights: Vec<u64>,
    pub(super) probes: Vec<Probe>,
    /// Whole paths to be followed, and what those before them showed.
    pub(super) whole: Vec<PlanePoint>,
    pub(super) found: Vec<Sample>,
    /// Places among both of points that pixels share.
    pub(super) shared: Index<u64>,
    /// Cells of pixels that are settled, for their memory, and cuts of the pixel at hand.
    pub(super) spare: Vec<Cells>,
    pub(super) cuts: Vec<(usize, Cut)>,
    pub(super) scratch: &'a mut WaveScratch,
    pub(super) counts: RayCounts,
}

/// Renders a block whose pixels' corners are in `corners`.
pub(crate) fn render(
    tracer: &Tracer,
    corners: &Corners,
    region: Region,
    (tolerance, every_pixel): (f64, bool),
    scratch: &mut WaveScratch,
) -> (Vec<Pixel>, RayCounts) {
    let mut block = Block {
        tracer,
        corners,
        region,
        tolerance,
        every_pixel,
        pixels: vec![Pixel::default(); region.area() as usize],
        extra: Records::new(tracer.lights().len()),
        searches: Vec::new(),
        places: vec![[NONE; 2]; ((region.width() + 1) * (region.height() + 1)) as usize],
        active: Vec::new(),
        points: Vec::new(),
        looks: Vec::new(),
        // For looks at no light.
        lights: vec![0; tracer.lights().len().div_ceil(64)],
        probes: Vec::new(),
        whole: Vec::new(),
        found: Vec::new(),
        shared: Index::default(),
        spare: Vec::new(),
        cuts: Vec::new(),
        scratch,
        counts: RayCounts::default(),
    };
    let mut waiting = block.roots().into_iter();
    let mut works = Vec::new();
    loop {
        while block.points.len() + block.whole.len() < FULL
            && let Some(mut work) = waiting.next()
        {
            if !block.open(&mut work) {
                works.push(work);
            }
        }
        if works.is_empty() {
            return (block.pixels, block.counts);
        }
        block.trace();
        works.retain_mut(|w| !block.advance(w));
    }
}

impl Block<'_> {
    pub(super) fn origin(&self) -> PlanePoint {
        plane_origin(self.tracer, self.region)
    }

    /// The square of the standard deviation that is as dear as so many looks of so many rays.
    pub(super) fn limit(&self, looks: u32, rays: f64) -> f64 {
        let more = if self.every_pixel { 1.0 } else { (f64::from(looks.max(4)) * rays / WORTH).max(1.0) };
        self.tolerance * self.tolerance * more
    }

    pub(super) fn finish(&mut self, pixel: usize, value: DVec3, variance: f64) {
        self.pixels[pixel].value = value;
        self.pixels[pixel].error.samples = variance;
    }

    pub(super) fn ask(&mut self, point: PlanePoint, look: Look) -> usize {
        self.points.push(point);
        self.looks.push(look);
        self.points.len() - 1
    }

    /// Asks for points of the pixel at `origin`; gives where their answers begin, and how many they are.
    pub(super) fn ask_all(&mut self, origin: PlanePoint, points: Vec<DVec2>, look: Look) -> (usize, usize) {
        let asked = (self.points.len(), points.len());
        for p in points {
            self.ask(origin.at(p), look);
        }
        asked
    }

    /// Variance of what shadows whose outlines pass do to a pixel whose corners do not show them.
    fn expected(&self, corner: &Seen, edges: &[Mark]) -> f64 {
        if edges.is_empty() {
            return 0.0;
        }
        let Some((_, m)) = self.corners.records.path(corner.path as usize).next() else { return 0.0 };
        let light =
            |mark: &Mark| mark.what.light().map_or(0.0, |l| rms(m.unshadowed(self.tracer.lights()[l as usize])));
        edges.iter().map(|e| EXPECTED * EXPECTED * light(e) * light(e)).sum()
    }

    /// What may need more than its corners; the rest is settled.
    #[expect(clippy::vec_box, reason = "those settled leave the list, and the rest would be moved")]
    fn roots(&mut self) -> Vec<Box<Work>> {
        let (w, h, from) = (self.region.width(), self.region.height(), self.origin());
        let mut works = Vec::new();
        let mut marked = Vec::new();
        let mut order = Vec::with_capacity(self.pixels.len());
        packets(w, h, |i, j| order.push((i, j)));
        let (x0, x1) = (self.region.x0, self.region.x1);
        let rows: Vec<&[Mark]> =
            (self.region.y0..self.region.y1).map(|y| self.tracer.marks().of_row(x0, x1, y)).collect();
        for (i, j) in order {
            let pixel = (j * w + i) as usize;
            let at = (self.region.x0 + i, self.region.y0 + j);
            let around = self.corners.around(at);
            // Clockwise from the upper left one.
            let seen = [5, 6, 10, 9].map(|k| around[k]);
            for s in seen {
                let (faint, deep) = self.corners.lost(s);
                self.pixels[pixel].error.weight += 0.25 * faint;
                self.pixels[pixel].error.depth += 0.25 * deep;
            }
            let marks = Marks::among(rows[j as usize], at.0, at.1);
            let alike = seen[1..].iter().all(|s| s.signature == seen[0].signature);
            let hidden = self.corners.hidden(self.tracer, at, &around);
            let (edges, marks) = marks.split_at(marks.partition_point(|m| matches!(m.what, What::Edge(_))));
            let hidden = hidden + if alike { self.expected(seen[0], edges) } else { 0.0 };
            let gaps = Gaps::new(self.tracer, &self.corners.records, seen);
            if alike && marks.is_empty() {
                let (value, variance) = Corners::smooth(&around);
                let variance = variance + hidden + gaps.variance;
                let limit = self.tolerance * self.tolerance;
                if variance <= limit || variance <= self.limit(0, self.corners.rays(seen[0])) {
                    self.finish(pixel, value, variance);
                    continue;
                }
            }
            let origin = PlanePoint { x: from.x + UNIT * i as i32, y: from.y - UNIT * j as i32 };
            let mut work = Box::new(Work::new(pixel, at, origin, seen.map(|s| *s), hidden));
            let few = marks.len() <= FEATURES;
            for m in if few { marks } else { &[] } {
                let p = m.at.map(|x| (f64::from(x) * f64::from(UNIT)).round() as i32);
                marked.push((works.len(), p, m));
                self.ask(PlanePoint { x: origin.x + p[0], y: origin.y - p[1] }, FIRST);
            }
            work.crowded = !few;
            work.thorough = self.every_pixel;
            work.busy = Corners::busy(&around);
            work.gaps = gaps.variance;
            work.edges = gaps.lights;
            work.edges.extend(edges.iter().filter_map(|m| m.what.light()));
            work.mirrored_gaps = gaps.mirrored;
            works.push(work);
        }
        self.trace();
        // Of objects only those that are there and in no corner are followed further.
        let probes = std::mem::take(&mut self.probes);
        let mut firsts = probes.iter().map(|p| p.first);
        marked.retain(|(work, _, m)| {
            let first = firsts.next();
            matches!(m.what, What::Shadow(_)) || works[*work].views.iter().all(|v| Some(v.seen.first) != first)
        });
        for (work, p, _) in &marked {
            let origin = works[*work].origin;
            self.points.push(PlanePoint { x: origin.x + p[0], y: origin.y - p[1] });
        }
        self.tracer.record(&self.points, self.corners.least, &mut self.extra, self.scratch, &mut self.counts);
        self.points.clear();
        for (k, (work, p, m)) in marked.into_iter().enumerate() {
            let at = DVec2::new(f64::from(p[0]), f64::from(p[1])) * (1.0 / f64::from(UNIT));
            let seen = Seen::new(self.tracer, &self.extra, k);
            works[work].views.push(View { at, seen, open: DVec3::ZERO, area: f64::from(m.area), extra: true });
        }
        works
    }

    /// Decides how to go on with a pixel. Whether that is settled.
    fn open(&mut self, work: &mut Work) -> bool {
        let around = self.corners.around(work.at);
        if work.views.iter().all(|v| v.seen.signature == work.views[0].seen.signature) && !work.crowded {
            let (value, variance) = Corners::smooth(&around);
            let variance = variance + work.unseen();
            let rays = self.corners.rays(&work.views[0].seen);
            if variance <= self.limit(0, rays) {
                self.finish(work.pixel, value, variance);
                return true;
            }
            self.look_at_what_differs(work, &around);
            self.begin(work);
            return false;
        }
        let own = Difference::new(&work.views, &[], &self.corners.records, &self.extra);
        self.look_at_what_differs(work, &around);
        let pictured = work.views.iter().any(|v| v.seen.pictured);
        if work.look.from == 1 && !pictured && work.views.iter().any(|v| v.seen.first != work.views[0].seen.first) {
            let samples: Vec<_> = work.views.iter().map(|v| (v.at, v.seen.first)).collect();
            work.strata = Some(Strata::new(self.tracer, work.origin, &samples));
            work.hidden += work.strayed();
        }
        let e = SLOPE * Corners::slope(&around);
        work.slope = e * e;
        let (value, variance) = work.first_guess();
        if !work.crowded && variance + work.unseen() <= self.limit(0, work.rays) {
            self.finish(work.pixel, value, variance + work.unseen());
            return true;
        }
        if work.views.len() == 4
            && work.hidden <= self.limit(0, work.rays).max(CLEAN * work.jump())
            && work.gaps <= self.limit(0, work.rays)
            && work.slope <= self.limit(0, work.rays)
            // An edge says nothing of a picture beside it.
            && !pictured
            && work.strata.as_ref().is_none_or(|s| s.parts.is_empty())
            && let Some(look) = own.single(&mut self.lights)
            && self.fit(work, look)
        {
            return false;
        }
        self.begin(work);
        false
    }

    /// Looks at what differs, from now on; at everything where that is not much dearer.
    fn look_at_what_differs(&mut self, work: &mut Work, around: &[&Seen]) {
        let all = self.all_rays(work);
        if work.crowded || work.mirrored_gaps || work.views.iter().any(|v| v.seen.pictured) {
            self.look_at_all(work, all);
            return;
        }
        let mut difference = Difference::new(&work.views, around, &self.corners.records, &self.extra);
        difference.watch(&work.edges);
        work.rays = difference.rays(&work.views, &self.corners.records);
        if work.rays > SAVING * all {
            self.look_at_all(work, all);
            return;
        }
        work.look = difference.look(&mut self.lights);
        work.hash = difference.hash;
        difference.open(&mut work.views, &self.corners.records, &self.extra, self.tracer);
        work.base = work.views[..4].iter().fold(DVec3::ZERO, |sum, v| sum + (v.seen.value - v.open)) * 0.25;
        work.still = work.spread_of(|v| v.seen.value - v.open);
        if work.still > self.limit(0, work.rays) {
            // Smooth as the rest may be, it is not flat.
            self.look_at_all(work, all);
        }
    }

    /// Rays of a look at everything.
    pub(super) fn all_rays(&self, work: &Work) -> f64 {
        Difference::everything(self.corners.records.words()).rays(&work.views, &self.corners.records)
    }

    /// Looks at everything, for so many rays, from now on.
    pub(super) fn look_at_all(&self, work: &mut Work, rays: f64) {
        work.look = Look::ALL;
        (work.hash, work.base, work.still, work.strata, work.rays) = (0, DVec3::ZERO, 0.0, None, rays);
        let all = Difference::everything(self.corners.records.words());
        all.open(&mut work.views, &self.corners.records, &self.extra, self.tracer);
    }

    /// Traces all that was asked for.
    fn trace(&mut self) {
        let mut searched = Vec::new();
        for s in std::mem::take(&mut self.active) {
            let search = &mut self.searches[s as usize];
            if search.asked > search.side.known || search.side.broken != u32::MAX {
                continue;
            }
            let t = search.side.next();
            let (dx, dy) = if search.horizontal { (t, 0) } else { (0, t) };
            let point = PlanePoint { x: search.start.x + dx, y: search.start.y - dy };
            search.asked = search.side.known + 1;
            let look = search.look;
            searched.push((s, self.ask(point, look)));
        }
        self.probes.resize(self.points.len(), Probe::default());
        self.tracer.probe(
            &self.points,
            (&self.looks, &self.lights),
            self.corners.least,
            &mut self.probes,
            self.scratch,
            &mut self.counts,
        );
        self.points.clear();
        self.looks.clear();
        let start = self.found.len();
        self.found.resize(start + self.whole.len(), Sample::BLANK);
        let found = &mut self.found[start..];
        self.tracer.trace(&self.whole, self.corners.least, found, self.scratch, &mut self.counts);
        self.whole.clear();
        for (s, i) in searched {
            let search = &mut self.searches[s as usize];
            let key = Key::from(&self.probes[i]);
            search.side.learn(search.ends.contains(&key).then_some(key == search.ends[0]));
        }
    }
}
