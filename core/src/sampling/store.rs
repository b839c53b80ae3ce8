//! The samples of a block, found by where they are and asked for in batches.

use std::collections::HashMap;

use glam::DVec3;

use super::outline::Line;
use super::part::Part;
use crate::film::Region;
use crate::trace::record::{Meeting, Records, Want};
use crate::trace::{PlanePoint, RayCounts, Tracer, WaveScratch};

/// Points along a pixel's edge; a power of two, so that halves of halves are points too.
pub(crate) const UNIT: i32 = 1024;
/// The [`crate::trace::PlanePoint`] grid of adaptive sampling: its unit is half a cell.
pub(crate) const GRID: u32 = UNIT as u32 / 2;

/// A sample of a [`Store`].
pub(crate) type SampleId = u32;
/// In place of a sample.
pub(crate) const NONE: SampleId = u32::MAX;

/// Root mean square of a colour's components.
pub(crate) fn rms(d: DVec3) -> f64 {
    (d.dot(d) / 3.0).sqrt()
}

/// The plane point of a region's upper left corner.
pub(crate) fn plane_origin(tracer: &Tracer, region: Region) -> (i32, i32) {
    let view = &tracer.settings().view;
    let g = GRID as i32;
    (UNIT * region.x0 as i32 - g * view.width() as i32, g * view.height() as i32 - UNIT * region.y0 as i32)
}

/// Samples at the pixel corners of a region and of one more pixel all around, and those that a
/// block of it asks for. Points are in [`UNIT`]s of a pixel, right and down from the block's
/// upper left corner. What a point shows depends on nothing but the point.
pub(crate) struct Store<'a> {
    pub(crate) tracer: &'a Tracer,
    shared: &'a Records,
    own: Records,
    origin: (i32, i32),
    known: HashMap<(i32, i32, Want), SampleId>,
    points: Vec<PlanePoint>,
    wants: Vec<Want>,
    least: f64,
    scratch: WaveScratch,
    pub(crate) counts: RayCounts,
    /// Sets of lights, for [`Part::Lights`].
    sets: Vec<Vec<u64>>,
}

impl<'a> Store<'a> {
    pub(crate) fn new(tracer: &'a Tracer, shared: &'a Records, block: Region, least: f64) -> Self {
        Self {
            tracer,
            shared,
            own: Records::new(tracer.lights().len()),
            origin: plane_origin(tracer, block),
            known: HashMap::new(),
            points: Vec::new(),
            wants: Vec::new(),
            least,
            scratch: WaveScratch::default(),
            counts: RayCounts::default(),
            sets: Vec::new(),
        }
    }

    /// Says that `sample` is at a point and followed to its end.
    pub(crate) fn know(&mut self, u: i32, v: i32, sample: SampleId) {
        self.known.insert((u, v, Want::From(1)), sample);
    }

    /// The sample at a point, there after the next [`Self::flush`].
    pub(crate) fn ask(&mut self, u: i32, v: i32, want: Want) -> SampleId {
        if let Some(&known) = self.known.get(&(u, v, Want::From(1))) {
            return known;
        }
        let next = (self.shared.len() + self.own.len() + self.points.len()) as SampleId;
        let sample = *self.known.entry((u, v, want)).or_insert(next);
        if sample == next {
            self.points.push(self.point(u, v));
            self.wants.push(want);
        }
        sample
    }

    /// Traces what was asked for. Whether there was anything.
    pub(crate) fn flush(&mut self) -> bool {
        if self.points.is_empty() {
            return false;
        }
        let Self { tracer, points, wants, own, scratch, counts, .. } = self;
        tracer.record(points, wants, self.least, own, scratch, counts);
        points.clear();
        wants.clear();
        true
    }

    pub(crate) fn point(&self, u: i32, v: i32) -> PlanePoint {
        PlanePoint { x: self.origin.0 + u, y: self.origin.1 - v }
    }

    /// The line through a point in steps of `step`.
    pub(crate) fn line(&self, u: f64, v: f64, step: (f64, f64)) -> Line {
        self.tracer.plane_line(f64::from(self.origin.0) + u, f64::from(self.origin.1) - v, (step.0, -step.1))
    }

    /// Where a direction of local space is seen, if it is before the camera.
    pub(crate) fn project(&self, d: DVec3) -> Option<(f64, f64)> {
        let (x, y) = self.tracer.project(d)?;
        Some((x - f64::from(self.origin.0), f64::from(self.origin.1) - y))
    }

    fn find(&self, s: SampleId) -> (&Records, usize) {
        let s = s as usize;
        match s.checked_sub(self.shared.len()) {
            None => (self.shared, s),
            Some(own) => (&self.own, own),
        }
    }

    /// The meetings of a sample from the `depth`-th on, with the lights seen there.
    pub(crate) fn meetings(&self, s: SampleId, depth: u32) -> impl Iterator<Item = (&Meeting, &[u64])> {
        let (records, path) = self.find(s);
        records.path(path).skip(depth as usize - 1).map(|(i, m)| (m, records.lights(i)))
    }

    /// The `depth`-th meeting of a sample, with the lights seen there.
    pub(crate) fn meeting(&self, s: SampleId, depth: u32) -> Option<(&Meeting, &[u64])> {
        self.meetings(s, depth).next()
    }

    /// The object that a sample meets first.
    pub(crate) fn object(&self, s: SampleId) -> Option<u32> {
        self.meeting(s, 1).and_then(|(m, _)| m.object())
    }

    /// Samples of equal key show the same objects up to a part's meeting, and the same light of it.
    pub(crate) fn key(&self, s: SampleId, part: Part) -> u64 {
        let mut last = 0;
        let (records, path) = self.find(s);
        for (depth, (i, m)) in (1..).zip(records.path(path)) {
            last = m.hash;
            if depth == part.depth() {
                return match part {
                    Part::Light(_, light) => last ^ u64::from(bit(records.lights(i), light)),
                    _ => last,
                };
            }
        }
        // Over before.
        !last
    }

    /// What a sample contributes to a part.
    pub(crate) fn value(&self, s: SampleId, part: Part) -> DVec3 {
        if let Part::From(depth) = part {
            return self.meetings(s, depth).fold(DVec3::ZERO, |sum, (m, _)| sum + m.direct);
        }
        let Some((m, lit)) = self.meeting(s, part.depth()) else { return DVec3::ZERO };
        match part {
            Part::Light(_, light) if bit(lit, light) => m.unshadowed(self.tracer.lights()[light as usize]),
            Part::Lights(_, set) => lights_of(&self.sets[set as usize])
                .fold(DVec3::ZERO, |sum, l| sum + m.unshadowed(self.tracer.lights()[l])),
            _ => DVec3::ZERO,
        }
    }

    /// How much a part differs between two samples of different keys.
    pub(crate) fn contrast(&self, a: SampleId, b: SampleId, part: Part) -> f64 {
        if let Part::Light(depth, light) = part {
            let whole = |s| {
                let light = self.tracer.lights()[light as usize];
                self.meeting(s, depth).map_or(0.0, |(m, _)| rms(m.unshadowed(light)))
            };
            return whole(a).max(whole(b));
        }
        rms(self.value(a, part) - self.value(b, part))
    }

    /// A hash of all that is discrete about a sample from a part's meeting on.
    pub(crate) fn signature(&self, s: SampleId, part: Part) -> u64 {
        match part {
            Part::From(depth) => self.meetings(s, depth).fold(0, |hash, (m, lit)| {
                lit.iter().fold(crate::trace::mix(hash, m.hash), |hash, &word| crate::trace::mix(hash, word))
            }),
            _ => self.key(s, part),
        }
    }

    /// Whether two samples see the same lights at what they meet first.
    pub(crate) fn same_lights(&self, a: SampleId, b: SampleId) -> bool {
        self.meeting(a, 1).map(|(_, lit)| lit) == self.meeting(b, 1).map(|(_, lit)| lit)
    }

    /// Keeps a set of lights.
    pub(crate) fn keep(&mut self, set: Vec<u64>) -> u32 {
        self.sets.push(set);
        self.sets.len() as u32 - 1
    }
}

fn bit(words: &[u64], light: u32) -> bool {
    words[light as usize / 64] >> (light % 64) & 1 == 1
}

/// The lights of a set.
pub(crate) fn lights_of(words: &[u64]) -> impl Iterator<Item = usize> {
    words.iter().enumerate().flat_map(|(i, &word)| (0..64).filter(move |b| word >> b & 1 == 1).map(move |b| 64 * i + b))
}
