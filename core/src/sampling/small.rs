//! Objects that could fall between pixel corners, found from their projected outlines.
//!
//! A convex outline that covers a part of a pixel but none of its corners either pokes in
//! through a side or lies inside: only objects that are small or thin, the corners of larger
//! triangles and the extremes of middling spheres can. All such overlaps of at least
//! [`LEAST`] of a pixel are listed with a point to look at.

use glam::DVec3;
use rayon::prelude::*;

use super::lattice::vector;
use super::shadow;
use crate::geometry::ObjectId;
use crate::geometry::local::{Kind, kind};
use crate::trace::Tracer;

/// The least overlap that is looked for, in pixels; a small part of what is promised, since
/// things reach into several.
pub(crate) const LEAST: f64 = 1.0 / 1024.0;
/// Outlines of spheres are taken as polygons of so many corners.
pub(crate) const ROUND: usize = 16;
/// Outlines wider and higher than this many pixels are looked at only where they end.
const WIDE: f64 = 6.0;

/// Sides of outlines that are longer than half of this, in pixels, are not followed.
const LONG: f64 = 200.0;
/// What is wider cannot pass between a pixel's corners.
const NARROW: f64 = 1.5;

/// A convex polygon of the image plane in pixels, x to the right, y down.
pub(crate) type Polygon = Vec<[f64; 2]>;

/// What could be overlooked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum What {
    /// The outline of a shadow in the light of this number; no overlap.
    Edge(u32),
    /// An object.
    Object(u32),
    /// A shadow in the light of this number.
    Shadow(u32),
}

impl What {
    /// The light, of shadows.
    pub(crate) fn light(self) -> Option<u32> {
        match self {
            Self::Edge(light) | Self::Shadow(light) => Some(light),
            Self::Object(_) => None,
        }
    }
}

/// The overlap of an object or a shadow with a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mark {
    /// Row and column, packed for sorting.
    pub(crate) pixel: u64,
    pub(crate) what: What,
    /// Overlap in pixels.
    pub(crate) area: f32,
    /// A point of the overlap, relative to the pixel.
    pub(crate) at: [f32; 2],
}

/// Marks of a picture, by pixel.
#[derive(Debug, Default)]
pub(crate) struct Marks(Vec<Mark>);

pub(crate) fn pack(x: u32, y: u32) -> u64 {
    u64::from(y) << 32 | u64::from(x)
}

impl Marks {
    /// The marks of `tracer`'s picture.
    pub(crate) fn new(tracer: &Tracer) -> Self {
        let scene = &tracer.prepared().scene;
        let planes = scene.planes().len();
        let mut marks: Vec<Mark> = (planes..scene.object_count())
            .into_par_iter()
            .flat_map_iter(|id| {
                let mut found = Vec::new();
                if let Some(p) = outline(tracer, id as u32) {
                    mark(tracer, &p, What::Object(id as u32), &mut found);
                }
                found
            })
            .collect();
        marks.extend(shadow::marks(tracer));
        marks.par_sort_unstable_by(|a, b| {
            (a.pixel, a.what).cmp(&(b.pixel, b.what)).then(a.area.total_cmp(&b.area)).then(a.at[0].total_cmp(&b.at[0]))
        });
        marks.dedup_by(|a, b| matches!(a.what, What::Edge(_)) && (a.pixel, a.what) == (b.pixel, b.what));
        Self(marks)
    }

    /// The marks of the pixels from (x0, y) on, up to (x1, y).
    pub(crate) fn of_row(&self, x0: u32, x1: u32, y: u32) -> &[Mark] {
        let start = self.0.partition_point(|m| m.pixel < pack(x0, y));
        let end = self.0.partition_point(|m| m.pixel < pack(x1, y));
        &self.0[start..end]
    }

    /// Those of pixel (x, y), among those of its row.
    pub(crate) fn among(row: &[Mark], x: u32, y: u32) -> &[Mark] {
        let key = pack(x, y);
        let start = row.partition_point(|m| m.pixel < key);
        let length = row[start..].partition_point(|m| m.pixel == key);
        &row[start..start + length]
    }
}

/// Where a direction of local space is seen, in pixels.
pub(crate) fn to_pixels(tracer: &Tracer, d: DVec3) -> Option<[f64; 2]> {
    let view = &tracer.settings().view;
    let unit = f64::from(super::lattice::UNIT);
    let (w, h) = (f64::from(view.width()), f64::from(view.height()));
    tracer.project(d).map(|(x, y)| [x / unit + 0.5 * w, 0.5 * h - y / unit])
}

/// The outline of `object` in pixels, `None` where a part of it is not before the camera.
pub(crate) fn outline(tracer: &Tracer, object: u32) -> Option<Polygon> {
    let prepared = tracer.prepared();
    let to_pixels = |d: DVec3| to_pixels(tracer, d);
    match kind(&prepared.scene, ObjectId(object)) {
        Kind::Plane(_) => None,
        Kind::Triangle(i) => {
            let v = prepared.local.triangle(&prepared.scene.triangles()[i]).v.map(vector);
            v.into_iter().map(to_pixels).collect()
        }
        Kind::Sphere(i) => {
            let s = &prepared.local.spheres[i];
            let c = vector(s.c);
            rim(c, s.r)?.into_iter().map(to_pixels).collect()
        }
    }
}

/// Points of the circle where tangents from the origin touch a sphere; none from inside.
pub(crate) fn rim(c: DVec3, r: f64) -> Option<[DVec3; ROUND]> {
    let cc = c.dot(c);
    let rest = 1.0 - r * r / cc;
    if !(rest > 0.0) {
        return None;
    }
    let (middle, radius) = (c * rest, r * rest.sqrt());
    let axis = if c.x.abs() <= c.y.abs() && c.x.abs() <= c.z.abs() {
        DVec3::X
    } else if c.y.abs() <= c.z.abs() {
        DVec3::Y
    } else {
        DVec3::Z
    };
    let a = c.cross(axis);
    let a = a * (radius / a.dot(a).sqrt());
    let b = c.cross(a) * (1.0 / cc.sqrt());
    Some(std::array::from_fn(|k| {
        let angle = std::f64::consts::TAU * (k as f64 + 0.5) / ROUND as f64;
        middle + a * libm::cos(angle) + b * libm::sin(angle)
    }))
}

/// The part of a convex polygon on the side of a line where sign · (p\[axis\] − at) ≥ 0.
fn cut(p: &Polygon, axis: usize, at: f64, sign: f64, out: &mut Polygon) {
    out.clear();
    for (i, a) in p.iter().enumerate() {
        let b = &p[(i + 1) % p.len()];
        let (da, db) = (sign * (a[axis] - at), sign * (b[axis] - at));
        if da >= 0.0 {
            out.push(*a);
        }
        if (da >= 0.0) != (db >= 0.0) {
            let t = da / (da - db);
            let mut c = [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t];
            c[axis] = at;
            out.push(c);
        }
    }
}

/// The part of a convex polygon in a rectangle.
pub(crate) fn clip(p: &Polygon, [x0, y0, x1, y1]: [f64; 4]) -> Polygon {
    let (mut a, mut b) = (Vec::with_capacity(p.len() + 4), Vec::with_capacity(p.len() + 4));
    cut(p, 0, x0, 1.0, &mut a);
    cut(&a, 0, x1, -1.0, &mut b);
    cut(&b, 1, y0, 1.0, &mut a);
    cut(&a, 1, y1, -1.0, &mut b);
    b
}

/// Area and centroid of a convex polygon; the area is 0 where there is none.
pub(crate) fn area(p: &Polygon) -> (f64, [f64; 2]) {
    let Some(o) = p.first() else { return (0.0, [0.0; 2]) };
    let (mut twice, mut x, mut y) = (0.0, 0.0, 0.0);
    for (a, b) in p[1..].iter().zip(p.iter().skip(2)) {
        let s = (a[0] - o[0]) * (b[1] - o[1]) - (b[0] - o[0]) * (a[1] - o[1]);
        twice += s;
        x += s * (a[0] + b[0] + o[0]);
        y += s * (a[1] + b[1] + o[1]);
    }
    if twice == 0.0 {
        return (0.0, *o);
    }
    (0.5 * twice.abs(), [x / (3.0 * twice), y / (3.0 * twice)])
}

/// Whether a convex polygon contains a point.
pub(crate) fn contains(p: &Polygon, at: [f64; 2]) -> bool {
    let (mut left, mut right) = (false, false);
    for (i, a) in p.iter().enumerate() {
        let b = &p[(i + 1) % p.len()];
        let s = (b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0]);
        left |= s < 0.0;
        right |= s > 0.0;
    }
    !(left && right)
}

/// Lists the pixels that a convex outline overlaps without covering a corner of theirs.
pub(crate) fn mark(tracer: &Tracer, p: &Polygon, what: What, found: &mut Vec<Mark>) {
    let view = &tracer.settings().view;
    let (w, h) = (f64::from(view.width()), f64::from(view.height()));
    let (mut lo, mut hi) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for c in p {
        for k in 0..2 {
            lo[k] = lo[k].min(c[k]);
            hi[k] = hi[k].max(c[k]);
        }
    }
    if !(hi[0] > 0.0 && hi[1] > 0.0 && lo[0] < w && lo[1] < h) {
        return;
    }
    let size = [hi[0] - lo[0], hi[1] - lo[1]];
    let whole = area(p).0;
    if !(whole >= LEAST) {
        return;
    }
    let range = |lo: f64, hi: f64, n: f64| (lo.max(0.0).floor() as u32, hi.min(n).ceil() as u32);
    let apart = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]);
    let longest = p.iter().flat_map(|a| p.iter().map(move |b| apart(a, b))).fold(0.0, f64::max).sqrt();
    // That of a triangle, and no less than that of anything rounder.
    let width = 2.0 * whole / longest;
    // An object's area is known; of a shadow, a corner tells little of what else of it there is.
    let anywhere = matches!(what, What::Shadow(_)) && width < NARROW;
    let look = |x: u32, y: u32, found: &mut Vec<Mark>| {
        let (x0, y0) = (f64::from(x), f64::from(y));
        let corners = [[x0, y0], [x0 + 1.0, y0], [x0, y0 + 1.0], [x0 + 1.0, y0 + 1.0]];
        if !anywhere && corners.iter().any(|&c| contains(p, c)) {
            return;
        }
        let (overlap, at) = area(&clip(p, [x0, y0, x0 + 1.0, y0 + 1.0]));
        if overlap >= LEAST {
            let at = [(at[0] - x0) as f32, (at[1] - y0) as f32];
            found.push(Mark { pixel: pack(x, y), what, area: overlap as f32, at });
        }
    };
    if size[0] <= WIDE && size[1] <= WIDE {
        let ((x0, x1), (y0, y1)) = (range(lo[0], hi[0], w), range(lo[1], hi[1], h));
        for y in y0..y1 {
            for x in x0..x1 {
                look(x, y, found);
            }
        }
        return;
    }
    if p.len() != 3 && width > NARROW {
        // It pokes through a side by less than 1/(12·radius).
        return;
    }
    if width > NARROW {
        for k in 0..3 {
            // The tip, as far as it is narrower than a pixel's diagonal.
            let (tip, a, b) = (p[k], p[(k + 1) % 3], p[(k + 2) % 3]);
            let away = |c: [f64; 2]| {
                let d = [c[0] - tip[0], c[1] - tip[1]];
                let length = (d[0] * d[0] + d[1] * d[1]).sqrt();
                (d.map(|x| x / length), length)
            };
            let ((u, long), (v, wide)) = (away(a), away(b));
            let sine = (u[0] * v[1] - u[1] * v[0]).abs();
            let far = (NARROW / sine).min(long).min(wide);
            let at = |d: [f64; 2]| [tip[0] + d[0] * far, tip[1] + d[1] * far];
            strip(&vec![tip, at(u), at(v)], (w, h), &mut |x, y| look(x, y, found));
        }
        return;
    }
    strip(p, (w, h), &mut |x, y| look(x, y, found));
}

/// Lists the pixels that an outline passes.
pub(crate) fn mark_edges(tracer: &Tracer, p: &Polygon, light: u32, found: &mut Vec<Mark>) {
    let view = &tracer.settings().view;
    let inside = |c: f64, size: u32| c >= 0.0 && c < f64::from(size);
    for (i, a) in p.iter().enumerate() {
        let b = &p[(i + 1) % p.len()];
        let d = [b[0] - a[0], b[1] - a[1]];
        let steps = (2.0 * d[0].abs().max(d[1].abs())).ceil();
        if !(steps <= LONG) {
            continue;
        }
        for k in 0..=steps as u32 {
            let t = f64::from(k) / steps.max(1.0);
            let at = [a[0] + d[0] * t, a[1] + d[1] * t];
            if inside(at[0], view.width()) && inside(at[1], view.height()) {
                let pixel = pack(at[0] as u32, at[1] as u32);
                let mark = Mark { pixel, what: What::Edge(light), area: 0.0, at: [0.5; 2] };
                if found.last().is_none_or(|m| (m.pixel, m.what) != (mark.pixel, mark.what)) {
                    found.push(mark);
                }
            }
        }
    }
}

/// Visits the pixels that a narrow polygon overlaps, column by column or row by row.
fn strip(p: &Polygon, (w, h): (f64, f64), look: &mut impl FnMut(u32, u32)) {
    let extent = |axis: usize| {
        let values = p.iter().map(|c| c[axis]);
        (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
    };
    let (lo, hi) = (extent(0), extent(1));
    let (lo, hi) = ([lo.0, hi.0], [lo.1, hi.1]);
    let range = |lo: f64, hi: f64, n: f64| (lo.max(0.0).floor() as u32, hi.min(n).ceil() as u32);
    let along = usize::from(hi[1] - lo[1] > hi[0] - lo[0]);
    let (first, last) = range(lo[along], hi[along], if along == 0 { w } else { h });
    for i in first..last {
        let (mut a, mut b) = (Vec::new(), Vec::new());
        cut(p, along, f64::from(i), 1.0, &mut a);
        cut(&a, along, f64::from(i) + 1.0, -1.0, &mut b);
        let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
        for c in &b {
            lo = lo.min(c[1 - along]);
            hi = hi.max(c[1 - along]);
        }
        if !(lo <= hi) {
            continue;
        }
        let (j0, j1) = range(lo, hi, if along == 0 { h } else { w });
        for j in j0..j1 {
            if along == 0 { look(i, j) } else { look(j, i) }
        }
    }
}
