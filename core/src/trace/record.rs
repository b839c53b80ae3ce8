//! Paths with all that adaptive sampling decides by: what was met, and which lights shine there.

use glam::DVec3;

use super::packet::{INSIDE, NONE};
use super::path::mix;

/// How much of a path is followed; depths count from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Want {
    /// What is met up to this depth, and no lights.
    Objects(u32),
    /// What is met up to this depth, and one light there.
    Light(u32, u32),
    /// The whole path, with the lights from this depth on.
    From(u32),
}

impl Want {
    /// Whether the path goes on after its `depth`-th meeting.
    pub(crate) fn goes_beyond(self, depth: u32) -> bool {
        match self {
            Self::Objects(last) | Self::Light(last, _) => depth < last,
            Self::From(_) => true,
        }
    }

    /// Whether `light` is looked for at the `depth`-th meeting.
    pub(crate) fn looks_for(self, depth: u32, light: u32) -> bool {
        match self {
            Self::Objects(_) => false,
            Self::Light(at, one) => depth == at && light == one,
            Self::From(first) => depth >= first,
        }
    }
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

/// Recorded paths, in the order they were asked for.
#[derive(Clone, Debug)]
pub(crate) struct Records {
    /// Words of a meeting's lights.
    words: usize,
    first: Vec<u32>,
    meetings: Vec<Meeting>,
    /// The lights seen, a bit each.
    lit: Vec<u64>,
}

impl Records {
    /// No paths, in a scene of so many lights.
    pub(crate) fn new(lights: usize) -> Self {
        Self { words: lights.div_ceil(64), first: Vec::new(), meetings: Vec::new(), lit: Vec::new() }
    }

    pub(crate) fn len(&self) -> usize {
        self.first.len()
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

    /// The lights seen from a meeting, a bit each.
    pub(crate) fn lights(&self, meeting: usize) -> &[u64] {
        &self.lit[meeting * self.words..(meeting + 1) * self.words]
    }

    /// Adds the paths of `other`.
    pub(crate) fn append(&mut self, other: &Self) {
        let start = self.meetings.len() as u32;
        let shift = |i: u32| if i == NONE { NONE } else { i + start };
        self.first.extend(other.first.iter().map(|&i| shift(i)));
        self.meetings.extend(other.meetings.iter().map(|m| Meeting { next: shift(m.next), ..*m }));
        self.lit.extend_from_slice(&other.lit);
    }
}

/// Paths being recorded.
#[derive(Debug)]
pub(crate) struct Recording<'a> {
    wants: &'a [Want],
    records: &'a mut Records,
    /// The first path's place in `records`.
    base: usize,
    /// The latest meeting of each path.
    latest: Vec<u32>,
    /// Mirrored rays of less weight are not followed.
    pub(crate) least: f64,
}

impl<'a> Recording<'a> {
    /// Records one path for each of `wants`.
    pub(crate) fn new(wants: &'a [Want], records: &'a mut Records, least: f64) -> Self {
        let base = records.first.len();
        records.first.resize(base + wants.len(), NONE);
        Self { wants, records, base, latest: vec![NONE; wants.len()], least }
    }

    pub(crate) fn want(&self, path: usize) -> Want {
        self.wants[path]
    }

    /// Forgets what was recorded of `path`.
    pub(crate) fn restart(&mut self, path: usize) {
        self.records.first[self.base + path] = NONE;
        self.latest[path] = NONE;
    }

    pub(crate) fn meet(&mut self, path: usize, code: u32, (p, n): (DVec3, DVec3), weight: DVec3) {
        let at = self.records.meetings.len() as u32;
        let before = match self.latest[path] {
            NONE => {
                self.records.first[self.base + path] = at;
                0
            }
            i => {
                let last = &mut self.records.meetings[i as usize];
                last.next = at;
                last.hash
            }
        };
        self.latest[path] = at;
        let direct = if code == NONE { weight } else { DVec3::ZERO };
        let hash = mix(before, u64::from(code) + 1);
        self.records.meetings.push(Meeting { next: NONE, code, hash, p, n, weight, direct, lost: 0.0 });
        self.records.lit.resize(self.records.lit.len() + self.records.words, 0);
    }

    fn last(&mut self, path: usize) -> &mut Meeting {
        &mut self.records.meetings[self.latest[path] as usize]
    }

    pub(crate) fn see(&mut self, path: usize, light: usize) {
        let at = self.latest[path] as usize * self.records.words + light / 64;
        self.records.lit[at] |= 1 << (light % 64);
    }

    pub(crate) fn add(&mut self, path: usize, direct: DVec3) {
        self.last(path).direct += direct;
    }

    pub(crate) fn lose(&mut self, path: usize, share: f64) {
        self.last(path).lost = share;
    }
}
