//! What a region's pixel corners show, with one more pixel all around.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::lattice::{UNIT, extent, plane_origin, rms};
use crate::film::Region;
use crate::trace::record::{INSIDE, NONE, Records};
use crate::trace::{PlanePoint, RayCounts, Tracer, WaveScratch, mix, packets};

/// Corners along the edge of the pieces that threads take.
const PIECE: u32 = 16;
/// Pixels that are looked at all around.
const BORDER: u32 = 1;

/// Standard deviation of the mean of four corners that show the same, as a share of their range:
/// with others around them that do not, and corrected by others that do.
const ROUGH: f64 = 0.15;
const FINE: f64 = 0.01;

/// Standard deviation of a pixel's mean over a picture, as a share of the range around.
const TEXTURE: f64 = 0.12;
/// The chance that a pixel next to one edge, or to more of them, hides something.
const LIKELY: [f64; 2] = [0.01, 0.8];
/// The area of that.
const HIDDEN: f64 = 0.3;

/// The corners of a pixel and of its neighbours, row by row.
pub(crate) type Around<'a> = [&'a Seen; 16];

/// The pairs of corners that are side by side, or one above the other.
fn neighbours<'a>(around: &'a Around<'a>) -> impl Iterator<Item = (&'a Seen, &'a Seen)> {
    (0..16).flat_map(move |k| {
        let pairs = [(k + 1, k % 4 < 3), (k + 4, k < 12)].into_iter().filter(|(_, inside)| *inside);
        pairs.map(move |(next, _)| (around[k], around[next]))
    })
}

/// A path followed to its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    /// Its place among the records.
    pub(crate) path: u32,
    /// The object met first, as [`crate::trace::record::Meeting::code`].
    pub(crate) first: u32,
    /// A hash of all that is discrete about it.
    pub(crate) signature: u64,
    /// The same without the object met first.
    pub(crate) rest: u64,
    /// A hash of what keeps lights from it.
    pub(crate) shadows: u64,
    /// Whether it met a surface with a picture.
    pub(crate) pictured: bool,
    pub(crate) value: DVec3,
    /// The weight of what it mirrors last and is not followed.
    lost: f64,
}

impl Seen {
    /// A recorded path in short.
    pub(crate) fn new(tracer: &Tracer, records: &Records, path: usize) -> Self {
        let mut shadows = 0;
        let (mut first, mut rest, mut value, mut pictured, mut lost) = (None, 0, DVec3::ZERO, false, 0.0);
        for (i, m) in records.path(path) {
            if first.is_some() {
                rest = mix(rest, u64::from(m.code));
            }
            first.get_or_insert(m.code);
            for &word in records.lights(i) {
                rest = mix(rest, word);
            }
            for &blocker in records.blockers(i) {
                shadows = mix(shadows, u64::from(blocker));
            }
            value += m.direct;
            lost = m.lost;
            pictured |= m.object().is_some_and(|o| tracer.is_pictured(o));
        }
        let first = first.unwrap_or(NONE);
        Self { path: path as u32, first, signature: mix(rest, u64::from(first)), rest, shadows, pictured, value, lost }
    }
}

pub(crate) struct Corners {
    region: Region,
    pub(crate) records: Records,
    /// Row by row.
    seen: Vec<Seen>,
    /// Where each sees the picture of what it meets first; of no matter where that has none, and empty where
    /// the scene has none.
    on_pictures: Vec<DVec2>,
    pub(crate) least: f64,
    /// The largest radiance that the scene can send.
    brightest: f64,
    pub(crate) counts: RayCounts,
}

impl Corners {
    /// The corners of `region`; paths of less weight than `least` are not followed.
    pub(crate) fn new(tracer: &Tracer, region: Region, least: f64) -> Self {
        let origin = plane_origin(tracer, region);
        let (w, h) = (region.width() + 2 * BORDER + 1, region.height() + 2 * BORDER + 1);
        let mut pieces = Vec::new();
        for j in (0..h).step_by(PIECE as usize) {
            for i in (0..w).step_by(PIECE as usize) {
                pieces.push((i, j, w.min(i + PIECE), h.min(j + PIECE)));
            }
        }
        let lights = tracer.lights().len();
        let pictures = !tracer.prepared().scene.pictures().is_empty();
        // Traces a piece; gives the places of its corners, what they see, and where on pictures.
        let trace = |(i0, j0, i1, j1), records: &mut Records, counts: &mut RayCounts| {
            let mut points = Vec::with_capacity(((i1 - i0) * (j1 - j0)) as usize);
            let mut places = Vec::with_capacity(points.capacity());
            packets(i1 - i0, j1 - j0, |i, j| {
                let (i, j) = (i0 + i, j0 + j);
                places.push((j * w + i) as usize);
                points.push(PlanePoint {
                    x: origin.x + UNIT * (i as i32 - BORDER as i32),
                    y: origin.y - UNIT * (j as i32 - BORDER as i32),
                });
            });
            let start = records.len();
            WaveScratch::with(|scratch| tracer.record(&points, least, records, scratch, counts));
            let seen: Vec<Seen> = (start..records.len()).map(|k| Seen::new(tracer, records, k)).collect();
            let on_picture = |(s, p): (&Seen, &PlanePoint)| {
                let pictured = s.pictured && s.first != NONE && tracer.is_pictured(s.first & !INSIDE);
                if pictured { tracer.picture_coordinates(s.first & !INSIDE, *p) } else { DVec2::ZERO }
            };
            let on_pictures: Vec<DVec2> =
                if pictures { seen.iter().zip(&points).map(on_picture).collect() } else { Vec::new() };
            (places, seen, on_pictures)
        };
        let blank = Seen {
            path: 0,
            first: NONE,
            signature: 0,
            rest: 0,
            shadows: 0,
            pictured: false,
            value: DVec3::ZERO,
            lost: 0.0,
        };
        let count = (w * h) as usize;
        let mut corners = Self {
            region,
            records: Records::new(lights),
            seen: vec![blank; count],
            on_pictures: vec![DVec2::ZERO; if pictures { count } else { 0 }],
            least,
            brightest: tracer.brightest(),
            counts: RayCounts::default(),
        };
        let mut put = |(places, seen, on_pictures): (Vec<usize>, Vec<Seen>, Vec<DVec2>), start: u32| {
            for (place, uv) in places.iter().zip(on_pictures) {
                corners.on_pictures[*place] = uv;
            }
            for (place, s) in places.into_iter().zip(seen) {
                corners.seen[place] = Seen { path: start + s.path, ..s };
            }
        };
        if rayon::current_num_threads() == 1 {
            corners.records.reserve(count, count + count / 2);
            for piece in pieces {
                let found = trace(piece, &mut corners.records, &mut corners.counts);
                put(found, 0);
            }
            return corners;
        }
        let done: Vec<_> = pieces
            .into_par_iter()
            .map(|piece| {
                let (mut records, mut counts) = (Records::new(lights), RayCounts::default());
                let found = trace(piece, &mut records, &mut counts);
                (found, records, counts)
            })
            .collect();
        corners.records.reserve(count, done.iter().map(|(_, records, _)| records.meetings()).sum());
        for (found, records, counts) in done {
            put(found, corners.records.len() as u32);
            corners.records.append(&records);
            corners.counts += counts;
        }
        corners
    }

    /// Corners of a row.
    fn width(&self) -> usize {
        (self.region.width() + 2 * BORDER + 1) as usize
    }

    /// Where the upper left corner of pixel (x, y) is among all.
    fn index(&self, x: u32, y: u32) -> usize {
        let (i, j) = (x + BORDER - self.region.x0, y + BORDER - self.region.y0);
        j as usize * self.width() + i as usize
    }

    /// The corners of pixel (x, y) and of its neighbours, row by row.
    pub(crate) fn around(&self, (x, y): (u32, u32)) -> Around<'_> {
        let w = self.width();
        let first = self.index(x, y) - w - 1;
        std::array::from_fn(|k| &self.seen[first + k / 4 * w + k % 4])
    }

    /// Variance of what may hide in pixel (x, y) between its corners, from what is around it:
    /// shadows and mirrored things, of which small ones are more likely the more edges there
    /// are, and pictures. Edges of objects seen directly are found by their outlines.
    pub(crate) fn hidden(&self, tracer: &Tracer, at: (u32, u32), around: &Around<'_>) -> f64 {
        let mut hidden = 0.0;
        if [5, 6, 9, 10].iter().any(|&k| around[k].pictured) {
            let first = around[5].first;
            if [6, 9, 10].iter().all(|&k| around[k].first == first) && first != NONE {
                let from = self.index(at.0, at.1);
                let uv = [from, from + 1, from + self.width() + 1, from + self.width()].map(|k| self.on_pictures[k]);
                if let Some(spread) = tracer.picture_spread(first & !INSIDE, uv) {
                    let e = 0.5 * spread * tracer.lights().len().min(2) as f64;
                    hidden += e * e;
                }
            }
            let e = TEXTURE * extent(around.iter().filter(|s| s.pictured).map(|s| s.value));
            hidden += e * e;
        }
        if around[1..].iter().all(|s| s.rest == around[0].rest) {
            return hidden;
        }
        let (mut sum, mut count) = (0.0, 0.0);
        for (a, b) in neighbours(around).filter(|(a, b)| a.rest != b.rest) {
            let e = rms(a.value - b.value);
            sum += e * e;
            count += 1.0;
        }
        let chance = if Self::clean(around) { LIKELY[0] } else { LIKELY[1] * count / 24.0 };
        hidden + chance * HIDDEN * HIDDEN * sum / count
    }

    /// The share of neighbours around a pixel that do not show the same beyond what they meet first.
    pub(crate) fn busy(around: &Around<'_>) -> f64 {
        neighbours(around).filter(|(a, b)| a.rest != b.rest).count() as f64 / 24.0
    }

    /// The largest difference between neighbours around a pixel that show the same.
    pub(crate) fn slope(around: &Around<'_>) -> f64 {
        let alike = neighbours(around).filter(|(a, b)| a.signature == b.signature);
        alike.map(|(a, b)| rms(a.value - b.value)).fold(0.0, f64::max)
    }

    /// Whether one straight edge could be all there is between corners.
    fn clean(around: &Around<'_>) -> bool {
        let one = around[0].rest;
        let Some(other) = around.iter().map(|s| s.rest).find(|&r| r != one) else { return true };
        if around.iter().any(|s| s.rest != one && s.rest != other) {
            return false;
        }
        let ones = around.iter().filter(|s| s.rest == one).count();
        let few = if ones < 8 { one } else { other };
        if ones.min(16 - ones) < 4 && [5, 6, 9, 10].iter().any(|&k| around[k].rest == few) {
            // Rather something small.
            return false;
        }
        let place = |k: usize| ((k % 4) as f64 - 1.5, (k / 4) as f64 - 1.5);
        let (mut sum, mut count) = ((0.0, 0.0), 0.0);
        for k in (0..16).filter(|&k| around[k].rest == one) {
            (sum.0, sum.1, count) = (sum.0 + place(k).0, sum.1 + place(k).1, count + 1.0);
        }
        // Along the line from the others' middle to theirs.
        let along = |k: usize| (place(k).0 * sum.0 + place(k).1 * sum.1) / count;
        let least = (0..16).filter(|&k| around[k].rest == one).map(along).fold(f64::INFINITY, f64::min);
        let most = (0..16).filter(|&k| around[k].rest != one).map(along).fold(f64::NEG_INFINITY, f64::max);
        least > most - 0.5
    }

    /// About how many rays a path takes.
    pub(crate) fn rays(&self, s: &Seen) -> f64 {
        let meetings = self.records.path(s.path as usize);
        f64::from(meetings.map(|(i, _)| 1 + self.records.lights_seen(i)).sum::<u32>().max(1))
    }

    /// The value of a pixel all whose corners show the same, and the variance of its error.
    pub(crate) fn smooth(around: &Around<'_>) -> (DVec3, f64) {
        let at = |i: usize, j: usize| around[4 * j + i];
        let inner = [at(1, 1), at(2, 1), at(1, 2), at(2, 2)].map(|s| s.value);
        let mean = (inner[0] + inner[1] + inner[2] + inner[3]) * 0.25;
        let extent = extent(inner.into_iter());
        if (0..16).any(|k| at(k % 4, k / 4).signature != at(1, 1).signature) {
            let e = ROUGH * extent;
            return (mean, e * e);
        }
        // The trapezoid rule is off by a twelfth of the second derivative, and four values in a
        // row show twice that.
        let row = |j| at(0, j).value + at(3, j).value - at(1, j).value - at(2, j).value;
        let column = |i| at(i, 0).value + at(i, 3).value - at(i, 1).value - at(i, 2).value;
        let bend = (row(1) + row(2) + column(1) + column(2)) * (1.0 / 48.0);
        let e = 0.5 * rms(bend) + FINE * extent;
        (mean - bend, e * e)
    }

    /// Bounds on what a path lost as too faint, and as too deep.
    pub(crate) fn lost(&self, s: &Seen) -> (f64, f64) {
        if s.lost == 0.0 {
            // However bright what it does not follow could be.
            return (0.0, 0.0);
        }
        let bound = s.lost * self.brightest;
        if s.lost <= self.least { (bound, 0.0) } else { (0.0, bound) }
    }
}
