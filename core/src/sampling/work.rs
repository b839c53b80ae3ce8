//! What is known of a pixel that its corners do not settle.

use glam::{DVec2, DVec3};

use super::cells::Cells;
use super::corners::Seen;
use super::fit::Fit;
use super::lattice::{UNIT, extent, rms};
use super::shape::Shape;
use super::strata::{Part, Strata};
use crate::trace::PlanePoint;
use crate::trace::record::{Look, NONE, Probe, Records};

/// Standard deviation of the integral over an area whose corners alone are known to differ, as a
/// share of the largest difference.
const UNSEEN: f64 = 0.25;
/// Standard deviation of a part's mean, as a share of the range of its samples.
const SMOOTH: f64 = 0.15;
/// Standard deviation of a pixel's mean for a shadow's edge that is not where an object's is, as a
/// share of its contrast; most are.
const STRAY: f64 = 0.1;
/// The least contrast between places that other lights reach, as a share of the larger value.
const CHANCE: f64 = 0.3;
/// Standard deviation of the mean over a ball of radius 1 pixel or less that is seen in few
/// places, as a share of its value.
const BALL: f64 = 0.3;
/// Standard deviation of what is claimed twice or by none, as a share.
pub(super) const CLAIMED: f64 = 0.3;

/// A whole path through a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// In pixels from its upper left corner.
    pub(super) at: DVec2,
    pub(super) seen: Seen,
    /// The part of its value that is looked at.
    pub(super) open: DVec3,
    /// The area of what it was to show; 0 for corners.
    pub(super) area: f64,
    /// Whether it is no corner.
    pub(super) extra: bool,
}

/// What tells the sides of an edge apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Key {
    hash: u64,
    lit: bool,
}

impl From<&Probe> for Key {
    fn from(p: &Probe) -> Self {
        Self { hash: p.hash, lit: p.lit }
    }
}

impl Key {
    /// What a path would show at `look`.
    pub(super) fn of(records: &Records, seen: &Seen, look: &Look, lights: &[u64]) -> Self {
        let mut key = Self { hash: 0, lit: false };
        let (words, mut at) = (records.words(), look.lights as usize);
        for (i, m) in records.path(seen.path as usize).take(look.last as usize) {
            key.hash = m.hash;
            key.lit |= records.lights(i).iter().zip(&lights[at..at + words]).any(|(a, b)| a & b != 0);
            at += words;
        }
        key
    }
}

/// How a pixel's value is found.
pub(super) enum How {
    /// Not decided.
    Closed,
    /// By its only edge: how it is seen, what its sides are, where it crosses the pixel's, and
    /// the looks asked for. Once found it is tried: by points close to it and all over the pixel, of
    /// which it is known on which side they should be.
    Fit {
        fit: Fit,
        look: Look,
        keys: [Key; 2],
        sides: [usize; 2],
        asked: Option<(usize, usize)>,
        trial: Option<Vec<bool>>,
    },
    /// By its cells.
    Cells(Cells),
}

/// See the [module](self).
pub(super) struct Work {
    pub(super) pixel: usize,
    pub(super) at: (u32, u32),
    pub(super) origin: PlanePoint,
    /// The corners, then small things.
    pub(super) views: Vec<View>,
    pub(super) look: Look,
    /// Of what all paths meet up to `look.last`.
    pub(super) hash: u64,
    /// The value of what is not looked at, and its variance.
    pub(super) base: DVec3,
    pub(super) still: f64,
    /// Rays of a look.
    pub(super) rays: f64,
    pub(super) strata: Option<Strata>,
    /// Variance of what varies between where a part is and where it was seen.
    pub(super) slope: f64,
    /// Variance of what may hide between the corners.
    pub(super) hidden: f64,
    /// Variance of what light may pass between shadows.
    pub(super) gaps: f64,
    /// Whether these are too many to be looked at one by one.
    pub(super) crowded: bool,
    /// The share of neighbouring corners, around the pixel too, that differ beyond what they meet first.
    pub(super) busy: f64,
    /// Lights whose shadows' outlines pass.
    pub(super) edges: Vec<u32>,
    /// Whether light may pass between shadows in mirrors.
    pub(super) mirrored_gaps: bool,
    pub(super) how: How,
    /// Whether the pixel is to keep to the tolerance.
    pub(super) thorough: bool,
}

impl PlanePoint {
    /// The point so many pixels to the right and down.
    pub(super) fn at(self, p: DVec2) -> Self {
        let unit = f64::from(UNIT);
        Self { x: self.x + (p.x * unit).round() as i32, y: self.y - (p.y * unit).round() as i32 }
    }
}

impl Work {
    pub(super) fn new(pixel: usize, at: (u32, u32), origin: PlanePoint, seen: [Seen; 4], hidden: f64) -> Self {
        let places = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        let views = seen.into_iter().zip(places);
        Self {
            pixel,
            at,
            origin,
            views: views.map(|(seen, at)| View { at, seen, open: DVec3::ZERO, area: 0.0, extra: false }).collect(),
            look: Look::ALL,
            hash: 0,
            base: DVec3::ZERO,
            still: 0.0,
            slope: 0.0,
            rays: 0.0,
            strata: None,
            hidden,
            gaps: 0.0,
            crowded: false,
            busy: 0.0,
            edges: Vec::new(),
            mirrored_gaps: false,
            how: How::Closed,
            thorough: false,
        }
    }

    /// Variance of what no point shows yet.
    pub(super) fn unseen(&self) -> f64 {
        self.hidden + self.gaps
    }

    /// Whether plain paths tell all that is looked for.
    pub(super) fn wants_whole_paths(&self) -> bool {
        self.look == Look::ALL && self.strata.is_none()
    }

    /// Variance of the mean over the corners of what varies smoothly between them.
    pub(super) fn spread_of(&self, value: impl Fn(&View) -> DVec3) -> f64 {
        let e = SMOOTH * extent(self.views.iter().map(value));
        e * e
    }

    /// Variance of what a shadow's edge that seems to be an object's may do beside it.
    pub(super) fn strayed(&self) -> f64 {
        let mut objects = self.views.iter().filter(|v| v.seen.first != NONE);
        let Some(one) = objects.next() else { return 0.0 };
        // Equal values of different lights are chance.
        let apart = |v: &View| rms(v.open - one.open).max(CHANCE * rms(v.open.max(one.open)));
        let far = |v: &View| if v.seen.rest == one.seen.rest { 0.0 } else { apart(v) };
        let e = STRAY * objects.map(far).fold(0.0, f64::max);
        e * e
    }

    /// The square of the largest difference between views.
    pub(super) fn jump(&self) -> f64 {
        self.spread_of(|v| v.open) / (SMOOTH * SMOOTH)
    }

    /// The views in each part of the strata, and in the rest.
    fn groups(&self, strata: &Strata) -> Vec<Vec<&View>> {
        let mut groups = vec![Vec::new(); strata.parts.len() + 1];
        for v in &self.views {
            groups[strata.of(v.at)].push(v);
        }
        groups
    }

    /// For every part of which all views show the same, what a look would show.
    pub(super) fn settled_parts(&self) -> Vec<Option<Probe>> {
        let Some(strata) = &self.strata else { return Vec::new() };
        if strata.doubt > 0.0 {
            return Vec::new();
        }
        let small = |p: &Part| matches!(p.shape, Shape::Round { m, .. } if m.x > 0.1);
        let groups = self.groups(strata);
        let part = |(k, p): (usize, &Part)| {
            let group = &groups[k];
            let alike = group.iter().all(|v| v.seen.signature == group[0].seen.signature);
            let radiance = group.iter().map(|v| v.open).sum::<DVec3>() * (1.0 / group.len() as f64);
            (alike && !group.is_empty() && !small(p)).then_some(Probe { radiance, first: p.code, hash: 0, lit: false })
        };
        strata.parts.iter().enumerate().map(part).collect()
    }

    /// The value as far as whole paths tell, and the variance of its error.
    pub(super) fn first_guess(&self) -> (DVec3, f64) {
        let extent = |views: &[&View]| extent(views.iter().map(|v| v.open));
        let mean = |views: &[&View]| views.iter().fold(DVec3::ZERO, |sum, v| sum + v.open) * (1.0 / views.len() as f64);
        let all: Vec<&View> = self.views.iter().collect();
        let Some(strata) = &self.strata else {
            let e = UNSEEN * extent(&all);
            return (self.base + mean(&all[..4]), e * e + self.still);
        };
        let (mut value, mut variance) = (DVec3::ZERO, self.still + self.slope);
        for (k, group) in self.groups(strata).iter().enumerate() {
            let area = strata.area(k);
            if group.is_empty() {
                value += mean(&all) * area;
                continue;
            }
            let alike = group.iter().all(|v| v.seen.signature == group[0].seen.signature);
            let e = if alike { SMOOTH } else { UNSEEN } * extent(group) * area;
            value += mean(group) * area;
            variance += e * e;
            if group.len() < 6
                && let Some(Part { shape: Shape::Round { m, .. }, .. }) = strata.parts.get(k)
            {
                // What one look says little of: how a small ball is shaded.
                let e = BALL * rms(mean(group)) * m.x.min(1.0) * area;
                variance += e * e;
            }
        }
        let e = CLAIMED * strata.doubt * extent(&all);
        (value, variance + e * e)
    }

    /// Mean and range of the corners on one side of an edge.
    pub(super) fn open_of(&self, like: &[bool; 4], side: bool) -> (DVec3, f64) {
        let of_side = || self.views.iter().zip(like).filter(|(_, l)| **l == side).map(|(v, _)| v.open);
        (of_side().sum::<DVec3>() * (1.0 / of_side().count() as f64), extent(of_side()))
    }

    /// The value where the first corner's side of the only edge has this area, and the variance
    /// due to what varies on both sides.
    pub(super) fn two_sided(&self, area: f64) -> (DVec3, f64) {
        let first = self.views[0].seen.signature;
        let like = std::array::from_fn(|k| self.views[k].seen.signature == first);
        let (a, b) = (self.open_of(&like, true), self.open_of(&like, false));
        let e = [SMOOTH * a.1 * area, SMOOTH * b.1 * (1.0 - area)];
        (self.base + a.0 * area + b.0 * (1.0 - area), e[0] * e[0] + e[1] * e[1] + self.still)
    }
}
