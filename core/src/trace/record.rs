//! Paths with all that adaptive sampling decides by: what was met, and which lights shine there.

use glam::DVec3;

pub(crate) use super::packet::{INSIDE, NONE};
use super::path::mix;
use crate::geometry::Ray;

/// What blocks lights is kept where they are no more than this: it takes four bytes for each of them at
/// every meeting.
const MOST_LIGHTS: usize = 256;

/// How much of a path is looked at; depths count from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Look {
    /// From this depth on everything counts: all lights, and the background.
    pub(crate) from: u32,
    /// What is met up to this depth is told by [`Probe::hash`]; paths end there that count
    /// nothing beyond.
    pub(crate) last: u32,
    /// Where, among the words that go with the looks, the lights that count at depths 1 to `last`
    /// begin, so many words a depth as the scene's lights take.
    pub(crate) lights: u32,
}

impl Look {
    /// At everything.
    pub(crate) const ALL: Self = Self { from: 1, last: 0, lights: 0 };
}

/// What came of a look.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Probe {
    /// What counts of the radiance.
    pub(crate) radiance: DVec3,
    /// The object met first, with [`INSIDE`]; [`NONE`] for the background.
    pub(crate) first: u32,
    /// A hash of the objects met up to [`Look::last`], that of [`Meeting::hash`].
    pub(crate) hash: u64,
    /// Whether any light that counts was seen.
    pub(crate) lit: bool,
}

/// One meeting of a path and a surface, or its end in the background.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Meeting {
    /// The next meeting of the path, [`NONE`] if it is the last.
    next: u32,
    /// The object, with [`INSIDE`]; [`NONE`] in the background.
    pub(crate) code: u32,
    /// A hash of the objects met so far.
    pub(crate) hash: u64,
    /// Where, in local space.
    pub(crate) p: DVec3,
    /// The unit normal on the side struck.
    pub(crate) n: DVec3,
    /// What one light that falls in vertically adds to the sample.
    pub(crate) weight: DVec3,
    /// What the lights looked for add to it; what the background adds.
    pub(crate) direct: DVec3,
    /// The share of what is mirrored here that is not followed: too deep, or too faint.
    pub(crate) lost: f64,
}

impl Meeting {
    /// The object met, `None` in the background.
    pub(crate) fn object(&self) -> Option<u32> {
        (self.code != NONE).then_some(self.code & !INSIDE)
    }

    /// What light from `light` adds, were nothing between.
    pub(crate) fn unshadowed(&self, light: DVec3) -> DVec3 {
        if self.code == NONE {
            return DVec3::ZERO;
        }
        let l = light - self.p;
        let cosine = self.n.dot(l) / l.dot(l).sqrt();
        if cosine > 0.0 { self.weight * cosine } else { DVec3::ZERO }
    }
}

/// A segment to a light that something blocks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dark {
    pub(crate) ray: Ray,
    /// The object it starts on, with [`INSIDE`].
    pub(crate) from: u32,
    /// Its place among the blockers.
    at: usize,
}

/// Recorded paths, in the order they were asked for.
#[derive(Clone, Debug)]
pub(crate) struct Records {
    /// Of how many lights it is kept what blocks them: of all, or of none.
    kept: usize,
    /// Words of a meeting's lights.
    words: usize,
    first: Vec<u32>,
    meetings: Vec<Meeting>,
    /// The lights seen, a bit each.
    lit: Vec<u64>,
    /// Of every light that is kept, the object that blocks it first; [`NONE`] where none does.
    blockers: Vec<u32>,
    /// Where these are yet to be found.
    dark: Vec<Dark>,
}

impl Records {
    /// No paths, in a scene of so many lights.
    pub(crate) fn new(lights: usize) -> Self {
        let words = lights.div_ceil(64);
        let kept = if lights <= MOST_LIGHTS { lights } else { 0 };
        Self {
            kept,
            words,
            first: Vec::new(),
            meetings: Vec::new(),
            lit: Vec::new(),
            blockers: Vec::new(),
            dark: Vec::new(),
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.first.len()
    }

    /// Meetings of all paths.
    pub(crate) fn meetings(&self) -> usize {
        self.meetings.len()
    }

    /// Makes room for so many paths and meetings.
    pub(crate) fn reserve(&mut self, paths: usize, meetings: usize) {
        self.first.reserve(paths);
        self.meetings.reserve(meetings);
        self.lit.reserve(meetings * self.words);
        self.blockers.reserve(meetings * self.kept);
    }

    /// The meetings of a path, with their places for [`Self::lights`].
    pub(crate) fn path(&self, path: usize) -> impl Iterator<Item = (usize, &Meeting)> {
        let mut at = self.first[path];
        std::iter::from_fn(move || {
            let i = at as usize;
            let meeting = self.meetings.get(i)?;
            at = meeting.next;
            Some((i, meeting))
        })
    }

    /// Words that the lights of a meeting take.
    pub(crate) fn words(&self) -> usize {
        self.words
    }

    /// The lights seen from a meeting, a bit each.
    pub(crate) fn lights(&self, meeting: usize) -> &[u64] {
        &self.lit[meeting * self.words..(meeting + 1) * self.words]
    }

    /// How many lights are seen from a meeting.
    pub(crate) fn lights_seen(&self, meeting: usize) -> u32 {
        self.lights(meeting).iter().map(|word| word.count_ones()).sum()
    }

    /// Of every light, the object that blocks it first at a meeting, [`NONE`] where none does; empty
    /// where lights are too many.
    pub(crate) fn blockers(&self, meeting: usize) -> &[u32] {
        &self.blockers[meeting * self.kept..(meeting + 1) * self.kept]
    }

    /// The blocked segments whose blockers are yet to be found.
    pub(crate) fn dark(&self) -> &[Dark] {
        &self.dark
    }

    /// Takes in what blocks each of them.
    pub(crate) fn blocked_by(&mut self, found: &[u32]) {
        for (dark, object) in self.dark.drain(..).zip(found) {
            self.blockers[dark.at] = *object;
        }
    }

    /// Adds the paths of `other`.
    pub(crate) fn append(&mut self, other: &Self) {
        let start = self.meetings.len() as u32;
        let shift = |i: u32| if i == NONE { NONE } else { i + start };
        self.first.extend(other.first.iter().map(|&i| shift(i)));
        self.meetings.extend(other.meetings.iter().map(|m| Meeting { next: shift(m.next), ..*m }));
        self.lit.extend_from_slice(&other.lit);
        self.blockers.extend_from_slice(&other.blockers);
    }
}

/// Where recordings go.
#[derive(Debug)]
enum Sink<'a> {
    Records {
        records: &'a mut Records,
        /// The first path's place in `records`.
        base: usize,
        /// The latest meeting of each path.
        latest: Vec<u32>,
    },
    Probes {
        looks: &'a [Look],
        lights: &'a [u64],
        words: usize,
        probes: &'a mut [Probe],
    },
}

/// Paths being recorded.
#[derive(Debug)]
pub(crate) struct Recording<'a> {
    sink: Sink<'a>,
}

impl<'a> Recording<'a> {
    /// Records `count` whole paths.
    pub(crate) fn new(count: usize, records: &'a mut Records) -> Self {
        let base = records.first.len();
        records.first.resize(base + count, NONE);
        Self { sink: Sink::Records { records, base, latest: vec![NONE; count] } }
    }

    /// Looks at paths in a scene whose lights take `words` words.
    pub(crate) fn probing(looks: &'a [Look], lights: &'a [u64], words: usize, probes: &'a mut [Probe]) -> Self {
        probes.fill(Probe::default());
        Self { sink: Sink::Probes { looks, lights, words, probes } }
    }

    /// Whether `path` goes on after its `depth`-th meeting.
    pub(crate) fn goes_beyond(&self, path: usize, depth: u32) -> bool {
        match &self.sink {
            Sink::Records { .. } => true,
            Sink::Probes { looks, .. } => {
                let look = &looks[path];
                look.from != u32::MAX || depth < look.last
            }
        }
    }

    /// Whether `light` counts at the `depth`-th meeting of `path`.
    pub(crate) fn looks_for(&self, path: usize, depth: u32, light: u32) -> bool {
        match &self.sink {
            Sink::Records { .. } => true,
            Sink::Probes { looks, lights, words, .. } => {
                let look = &looks[path];
                depth >= look.from
                    || depth <= look.last && {
                        let at = look.lights as usize + (depth as usize - 1) * words + light as usize / 64;
                        lights[at] >> (light % 64) & 1 == 1
                    }
            }
        }
    }

    /// The lights that count at the `depth`-th meetings of any of `paths`; all where `None`.
    pub(crate) fn any_lights(&self, paths: &[u32], depth: u32) -> Option<Vec<u64>> {
        let Sink::Probes { looks, lights, words, .. } = &self.sink else { return None };
        let mut any = vec![0; *words];
        for &path in paths {
            let look = &looks[path as usize];
            if depth >= look.from {
                return None;
            }
            if depth <= look.last {
                let at = look.lights as usize + (depth as usize - 1) * words;
                for (any, &word) in any.iter_mut().zip(&lights[at..at + words]) {
                    *any |= word;
                }
            }
        }
        Some(any)
    }

    /// Forgets what was recorded of `path`.
    pub(crate) fn restart(&mut self, path: usize) {
        match &mut self.sink {
            Sink::Records { records, base, latest } => {
                records.first[*base + path] = NONE;
                latest[path] = NONE;
            }
            Sink::Probes { probes, .. } => probes[path] = Probe::default(),
        }
    }

    /// The `depth`-th meeting of `path`; the background's `weight` is what it adds.
    pub(crate) fn meet(
        &mut self,
        path: usize,
        depth: u32,
        code: u32,
        place: impl FnOnce() -> (DVec3, DVec3),
        weight: DVec3,
    ) {
        match &mut self.sink {
            Sink::Probes { looks, probes, .. } => {
                let (look, probe) = (&looks[path], &mut probes[path]);
                if depth == 1 {
                    probe.first = code;
                }
                if depth <= look.last {
                    probe.hash = mix(probe.hash, u64::from(code) + 1);
                }
                if code == NONE && depth >= look.from {
                    probe.radiance += weight;
                }
            }
            Sink::Records { records, base, latest } => {
                let at = records.meetings.len() as u32;
                let before = match latest[path] {
                    NONE => {
                        records.first[*base + path] = at;
                        0
                    }
                    i => {
                        let last = &mut records.meetings[i as usize];
                        last.next = at;
                        last.hash
                    }
                };
                latest[path] = at;
                let (p, n) = place();
                let direct = if code == NONE { weight } else { DVec3::ZERO };
                let hash = mix(before, u64::from(code) + 1);
                records.meetings.push(Meeting { next: NONE, code, hash, p, n, weight, direct, lost: 0.0 });
                records.lit.resize(records.lit.len() + records.words, 0);
                records.blockers.resize(records.blockers.len() + records.kept, NONE);
            }
        }
    }

    pub(crate) fn see(&mut self, path: usize, light: usize) {
        match &mut self.sink {
            Sink::Records { records, latest, .. } => {
                let at = latest[path] as usize * records.words + light / 64;
                records.lit[at] |= 1 << (light % 64);
            }
            Sink::Probes { probes, .. } => probes[path].lit = true,
        }
    }

    /// The `segment` to `light` from the latest meeting of `path`, on `from`, is blocked: by what, is
    /// to be found where it is kept.
    pub(crate) fn block(&mut self, path: usize, light: usize, segment: impl FnOnce() -> Ray, from: u32) {
        if let Sink::Records { records, latest, .. } = &mut self.sink
            && records.kept > 0
        {
            let at = latest[path] as usize * records.kept + light;
            records.dark.push(Dark { at, from, ray: segment() });
        }
    }

    /// The lights add `direct` at the latest meeting of `path`.
    pub(crate) fn add(&mut self, path: usize, direct: DVec3) {
        match &mut self.sink {
            Sink::Records { records, latest, .. } => records.meetings[latest[path] as usize].direct += direct,
            Sink::Probes { probes, .. } => probes[path].radiance += direct,
        }
    }

    pub(crate) fn lose(&mut self, path: usize, share: f64) {
        if let Sink::Records { records, latest, .. } = &mut self.sink {
            records.meetings[latest[path] as usize].lost = share;
        }
    }
}
