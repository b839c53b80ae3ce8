//! In what the paths through a pixel differ.

use glam::DVec3;

use super::corners::Seen;
use super::work::View;
use crate::trace::Tracer;
use crate::trace::record::{Look, Records};

/// What differs between paths; depths count from 1.
#[derive(Debug, Default)]
pub(super) struct Difference {
    /// The depth at which they meet different objects; `u32::MAX` for none.
    from: u32,
    /// The lights that only some see, at depths 1 to `last`, below `from`.
    lights: Vec<u64>,
    last: u32,
    /// Words of a depth.
    words: usize,
    /// Of what all meet at depth 1, if all meet the same.
    first: Option<u64>,
    /// Of what all meet up to `last`.
    pub(super) hash: u64,
}

fn records<'a>(view: &View, corners: &'a Records, extra: &'a Records) -> &'a Records {
    if view.extra { extra } else { corners }
}

impl Difference {
    /// Everything.
    pub(super) fn everything(words: usize) -> Self {
        Self { from: 1, words, ..Self::default() }
    }

    /// In what `views` differ, and those of `around` that meet the same first: an edge there may
    /// well go on here.
    pub(super) fn new(views: &[View], around: &[&Seen], corners: &Records, extra: &Records) -> Self {
        let words = corners.words();
        let mut found = Self { from: u32::MAX, words, ..Self::default() };
        let own: Vec<_> = views.iter().map(|v| (records(v, corners, extra), v.seen.path)).collect();
        let mut paths: Vec<_> = own.iter().map(|(r, path)| r.path(*path as usize)).collect();
        let mut others: Vec<_> = around.iter().map(|s| corners.path(s.path as usize)).collect();
        let mut hashes = Vec::new();
        let (mut all, mut any) = (vec![0; words], vec![0; words]);
        for depth in 1.. {
            let Some((i, one)) = paths[0].next() else { break };
            all.copy_from_slice(own[0].0.lights(i));
            any.copy_from_slice(own[0].0.lights(i));
            let mut add = |lights: &[u64]| {
                for (k, &word) in lights.iter().enumerate() {
                    all[k] &= word;
                    any[k] |= word;
                }
            };
            for (path, (r, _)) in paths.iter_mut().zip(&own).skip(1) {
                match path.next() {
                    Some((i, m)) if m.hash == one.hash => add(r.lights(i)),
                    _ => {
                        (found.from, found.last) = (depth, depth - 1);
                        break;
                    }
                }
            }
            if found.from != u32::MAX {
                break;
            }
            others.retain_mut(|path| match path.next() {
                Some((i, m)) if m.hash == one.hash => {
                    add(corners.lights(i));
                    true
                }
                _ => {
                    if depth > 1 {
                        (found.from, found.last) = (depth, depth - 1);
                    }
                    false
                }
            });
            if found.from != u32::MAX {
                break;
            }
            if all != any {
                found.last = depth;
            }
            found.lights.extend(all.iter().zip(&any).map(|(a, b)| a ^ b));
            hashes.push(one.hash);
        }
        found.first = hashes.first().copied();
        found.lights.truncate(found.last as usize * words);
        found.hash = found.last.checked_sub(1).map_or(0, |i| hashes[i as usize]);
        found
    }

    /// Looks for these lights at what is met first, too.
    pub(super) fn watch(&mut self, lights: &[u32]) {
        if self.from == 1 || lights.is_empty() {
            return;
        }
        if self.last == 0 {
            let Some(first) = self.first else { return };
            (self.last, self.hash) = (1, first);
            self.lights.resize(self.words, 0);
        }
        for &light in lights {
            self.lights[light as usize / 64] |= 1 << (light % 64);
        }
    }

    /// A look at all that differs.
    pub(super) fn look(&self, lights: &mut Vec<u64>) -> Look {
        let at = lights.len() as u32;
        lights.extend_from_slice(&self.lights);
        Look { from: self.from, last: self.last, lights: at }
    }

    /// A look at the only thing that differs: what is met at one depth, or a light.
    pub(super) fn single(&self, lights: &mut Vec<u64>) -> Option<Look> {
        let differ: u32 = self.lights.iter().map(|w| w.count_ones()).sum();
        if self.from == u32::MAX {
            return (differ == 1).then(|| self.look(lights));
        }
        (differ == 0).then(|| {
            let at = lights.len() as u32;
            lights.extend(std::iter::repeat_n(0, self.from as usize * self.words));
            Look { from: u32::MAX, last: self.from, lights: at }
        })
    }

    /// Splits the views' values into what differs and what does not.
    pub(super) fn open(&self, views: &mut [View], corners: &Records, extra: &Records, tracer: &Tracer) {
        let words = corners.words();
        for v in views {
            let r = records(v, corners, extra);
            v.open = DVec3::ZERO;
            for (depth, (i, m)) in (1..).zip(r.path(v.seen.path as usize)) {
                if depth >= self.from {
                    v.open += m.direct;
                } else if depth <= self.last {
                    let at = (depth as usize - 1) * words;
                    for (k, (&seen, &open)) in r.lights(i).iter().zip(&self.lights[at..at + words]).enumerate() {
                        let mut both = seen & open;
                        while both != 0 {
                            let light = 64 * k + both.trailing_zeros() as usize;
                            v.open += m.unshadowed(tracer.lights()[light]);
                            both &= both - 1;
                        }
                    }
                }
            }
        }
    }

    /// About how many rays a look takes: the mean over the corners.
    pub(super) fn rays(&self, views: &[View], corners: &Records) -> f64 {
        let mut rays = 0;
        for view in &views[..4] {
            for (depth, (i, _)) in (1..).zip(corners.path(view.seen.path as usize)) {
                if depth >= self.from {
                    rays += 1 + corners.lights_seen(i);
                } else if depth <= self.last {
                    let at = (depth as usize - 1) * corners.words();
                    rays += 1 + self.lights[at..at + corners.words()].iter().map(|w| w.count_ones()).sum::<u32>();
                }
            }
        }
        (0.25 * f64::from(rays)).max(1.0)
    }
}
