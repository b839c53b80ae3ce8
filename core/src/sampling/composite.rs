//! A pixel with parts that are sampled by points of their own.

use glam::DVec3;

use super::coverage::{PixelPoint, Polygon};
use super::pixel::{Pixel, Rule};
use super::points::Sequence;
use crate::film::PlanePoint;
use crate::integrate::Sample;
use crate::settings::View;

/// Points that a zone between edges begins with, a ball among others at most, and what is in no part.
const ZONE: u32 = 8;
const BALL: u32 = 64;
const REST: u32 = 16;
/// κ of a ball among others, as long as nothing else is known.
const SHADED: f64 = 0.05;
/// Where the samples of a part are alike, they are thought to vary by this share of what they do around the pixel.
const ALIKE: f64 = 0.1;
/// Between the sets of two parts.
const SETS: u64 = 16;

/// What is known of the parts of one pixel, and of the rest of it.
#[derive(Clone, Debug)]
pub(crate) struct Composite {
    pub(crate) at: (u32, u32),
    set: u64,
    parts: Vec<Part>,
    rest: Pixel,
    /// The variance of samples here and around.
    around: f64,
}

#[derive(Clone, Debug)]
struct Part {
    polygon: Polygon,
    mean: Pixel,
    /// Points of it that are in no part before it.
    own: u32,
}

impl Part {
    fn area(&self) -> f64 {
        self.polygon.area() * f64::from(self.own) / f64::from(self.mean.points.max(1))
    }
}

impl Composite {
    pub(crate) fn new(at: (u32, u32), set: u64, polygons: Vec<Polygon>, doubt: f64) -> Self {
        // What may hide in the pixel may hide in its parts, too.
        let part = |polygon| Part { polygon, mean: Pixel::doubted(doubt), own: 0 };
        let parts = polygons.into_iter().map(part).collect();
        Self { at, set, parts, rest: Pixel::doubted(doubt), around: 0.0 }
    }

    /// Notes the variance of samples here and around.
    pub(crate) fn among(&mut self, variance: f64) {
        self.around = variance;
    }

    /// The same parts, to be sampled as often by the points of another set.
    pub(crate) fn afresh(&self, set: u64) -> Self {
        let part = |p: &Part| Part { polygon: p.polygon.clone(), mean: Pixel::default(), own: 0 };
        Self { at: self.at, set, parts: self.parts.iter().map(part).collect(), rest: Pixel::default(), ..*self }
    }

    fn sequence(&self, view: &View, part: usize) -> Sequence {
        Sequence::new(view, self.at, self.set + SETS * part as u64)
    }

    /// How many points of each part, and last of the rest, are to be traced next; 0 where it is done.
    pub(crate) fn wanted(&self, rule: &Rule) -> Vec<u32> {
        let more = |p: &Pixel, area: f64, first: u32| {
            if p.next == 0 { first } else { (p.next << p.doublings(rule, area)) - p.next }
        };
        let first = |p: &Part| match p.polygon.ball() {
            Some(ball) if ball.alone => {
                // Its share of the points of all of it.
                let share = rule.lone_ball() as f64 * p.polygon.area() / ball.area;
                (share as u32).max(BALL / 4).next_power_of_two()
            }
            Some(_) => {
                let worth = rule.points(SHADED * p.polygon.area() * p.polygon.area());
                (worth as u32).clamp(ZONE, BALL).next_power_of_two()
            }
            None => ZONE,
        };
        let mut wanted: Vec<u32> = self.parts.iter().map(|p| more(&p.mean, p.polygon.area(), first(p))).collect();
        wanted.push(more(&self.rest, 1.0, REST));
        wanted
    }

    /// As many as `other` has taken.
    pub(crate) fn taken(&self) -> Vec<u32> {
        self.parts.iter().map(|p| p.mean.next).chain([self.rest.next]).collect()
    }

    /// The points that are wanted.
    pub(crate) fn ask(&self, view: &View, wanted: &[u32], points: &mut Vec<PlanePoint>) {
        for (k, part) in self.parts.iter().enumerate() {
            let sequence = self.sequence(view, k + 1);
            let from = part.mean.next;
            points.extend((from..from + wanted[k]).map(|i| sequence.at(part.polygon.place(sequence.unit(i)))));
        }
        let (sequence, from) = (self.sequence(view, 0), self.rest.next);
        points.extend((from..from + wanted[self.parts.len()]).map(|i| sequence.point(i)));
    }

    /// Takes in what these points show.
    pub(crate) fn take(&mut self, view: &View, wanted: &[u32], mut samples: &[Sample]) {
        let polygons: Vec<Polygon> = self.parts.iter().map(|p| p.polygon.clone()).collect();
        let before = |k: usize, place: PixelPoint| polygons[..k].iter().any(|p| p.contains(place));
        for k in 0..self.parts.len() {
            let sequence = self.sequence(view, k + 1);
            let part = &mut self.parts[k];
            let (these, behind) = samples.split_at(wanted[k] as usize);
            samples = behind;
            let first = part.mean.next == 0;
            let mut from = part.mean.next as usize;
            for these in halves(these, from) {
                let own: Vec<DVec3> = these
                    .iter()
                    .enumerate()
                    .map(|(i, s)| {
                        let place = part.polygon.place(sequence.unit((from + i) as u32));
                        let own = !before(k, place);
                        part.own += u32::from(own);
                        if own { s.radiance } else { DVec3::ZERO }
                    })
                    .collect();
                from += these.len();
                part.mean.add(these.len() as u32, own.into_iter());
            }
            if first {
                // Few samples may be alike by chance.
                part.mean.expect(part.mean.variance().max(ALIKE * self.around), 0.0);
            }
        }
        let sequence = self.sequence(view, 0);
        let first = self.rest.next == 0;
        let mut from = self.rest.next as usize;
        for these in halves(samples, from) {
            let outside = these.iter().enumerate().filter(|(i, _)| {
                let place = sequence.place(sequence.point((from + i) as u32));
                !before(polygons.len(), place)
            });
            let outside: Vec<DVec3> = outside.map(|(_, s)| s.radiance).collect();
            from += these.len();
            self.rest.add(these.len() as u32, outside.into_iter());
        }
        if first {
            // Few samples may be alike by chance.
            self.rest.expect(self.rest.variance().max(self.around), 0.0);
        }
    }

    /// The share of the pixel that is in no part.
    fn rest_area(&self) -> f64 {
        (1.0 - self.parts.iter().map(Part::area).sum::<f64>()).max(0.0)
    }

    pub(crate) fn mean(&self) -> DVec3 {
        let parts: DVec3 = self.parts.iter().map(|p| p.mean.mean() * p.polygon.area()).sum();
        parts + self.rest.mean() * self.rest_area()
    }

    pub(crate) fn error(&self) -> f64 {
        let rest = self.rest_area();
        let part = |p: &Part| p.mean.error() * p.polygon.area() * p.polygon.area();
        self.parts.iter().map(part).sum::<f64>() + self.rest.error() * rest * rest
    }
}

/// Samples that double a number of points, perhaps twice, cut into those that double it once.
fn halves(mut samples: &[Sample], have: usize) -> Vec<&[Sample]> {
    let mut halves = Vec::new();
    let mut size = if have == 0 { samples.len() } else { have };
    while !samples.is_empty() {
        let (half, behind) = samples.split_at(size.min(samples.len()));
        halves.push(half);
        samples = behind;
        size *= 2;
    }
    halves
}
