//! What of a pixel the objects seen first cover, as far as their outlines tell.

use glam::DVec2;

use super::shape::Shape;
use crate::trace::record::{INSIDE, NONE};
use crate::trace::{PlanePoint, Tracer};

/// Objects whose outlines are looked at in one pixel, at most.
const MOST: usize = 6;
/// Areas that differ by less are taken for equal.
const SLACK: f64 = 1e-7;

/// An object that is seen wherever its outline covers a sample, and nowhere else.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part {
    /// As [`crate::trace::record::Meeting::code`].
    pub(crate) code: u32,
    pub(crate) shape: Shape,
    pub(crate) area: f64,
}

/// A pixel cut into parts of known area, and the rest.
#[derive(Clone, Debug, Default)]
pub(crate) struct Strata {
    pub(crate) parts: Vec<Part>,
    /// Area of what is no part.
    pub(crate) rest: f64,
    /// How many different things were seen there.
    pub(crate) kinds: usize,
    /// An area that is claimed twice, or by none.
    pub(crate) doubt: f64,
}

impl Strata {
    /// The strata of the pixel at `origin` that samples at places in it, and what they see first, tell.
    pub(crate) fn new(tracer: &Tracer, origin: PlanePoint, samples: &[(DVec2, u32)]) -> Self {
        let mut codes: Vec<u32> = samples.iter().map(|s| s.1).collect();
        codes.sort_unstable();
        codes.dedup();
        let mut strata = Self { kinds: codes.len(), ..Self::default() };
        if codes.len() > MOST {
            strata.rest = 1.0;
            return strata;
        }
        for code in codes {
            if code == NONE {
                continue;
            }
            let Some(shape) = Shape::of(tracer, code & !INSIDE, origin) else { continue };
            if samples.iter().all(|&(at, first)| shape.contains(at) == (first == code)) {
                strata.parts.push(Part { code, shape, area: shape.area() });
                strata.kinds -= 1;
            }
        }
        let claimed: f64 = strata.parts.iter().map(|p| p.area).sum();
        strata.rest = (1.0 - claimed).max(0.0);
        let mut doubt = (claimed - 1.0).max(0.0);
        if strata.kinds == 0 {
            doubt = (claimed - 1.0).abs();
        } else if strata.parts.len() > 1 {
            let twice = (0..16).filter(|k| {
                let at = DVec2::new(f64::from(k % 4) * 0.25 + 0.125, f64::from(k / 4) * 0.25 + 0.125);
                strata.parts.iter().filter(|p| p.shape.contains(at)).count() > 1
            });
            doubt = doubt.max(twice.count() as f64 / 16.0);
        }
        if doubt > SLACK {
            strata.doubt = doubt;
        } else if strata.kinds == 0 {
            strata.rest = 0.0;
        }
        strata
    }

    /// The part that a point is in; the number of parts for the rest.
    pub(crate) fn of(&self, at: DVec2) -> usize {
        self.parts.iter().position(|p| p.shape.contains(at)).unwrap_or(self.parts.len())
    }

    /// The area of a part, or of the rest; all together are 1.
    pub(crate) fn area(&self, part: usize) -> f64 {
        let claimed: f64 = self.parts.iter().map(|p| p.area).sum::<f64>() + self.rest;
        self.parts.get(part).map_or(self.rest, |p| p.area) / claimed
    }
}
