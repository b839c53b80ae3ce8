//! Where the outlines of objects run in the image plane.

use glam::DVec3;

use crate::geometry::ObjectId;
use crate::geometry::local::{Kind, kind};
use crate::geometry::real::V3;
use crate::trace::{PreparedScene, Tracer};

/// A crossing of an outline and a line of the image plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Crossing {
    /// Along the line, in the line's units.
    pub(crate) t: f64,
    pub(crate) object: u32,
    /// Which of the object's curves: a triangle's side by the corner opposite, else 0.
    pub(crate) curve: u8,
}

/// A line of the image plane: directions base + t·step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line {
    pub(crate) base: DVec3,
    pub(crate) step: DVec3,
}

pub(crate) fn vector(v: V3<f64>) -> DVec3 {
    DVec3::new(v.x, v.y, v.z)
}

/// Calls `found` for every place in (lo, hi) where the outline of `object` crosses `line`.
pub(crate) fn crossings(
    prepared: &PreparedScene,
    object: u32,
    line: &Line,
    (lo, hi): (f64, f64),
    found: &mut Vec<Crossing>,
) {
    let mut push = |t: f64, curve: u8| {
        if t > lo && t < hi {
            found.push(Crossing { t, object, curve });
        }
    };
    let (p, s) = (line.base, line.step);
    match kind(&prepared.scene, ObjectId(object)) {
        Kind::Plane(i) => {
            let n = vector(prepared.local.planes[i].n);
            push(-n.dot(p) / n.dot(s), 0);
        }
        Kind::Triangle(i) => {
            let v = prepared.local.triangle(&prepared.scene.triangles()[i]).v.map(vector);
            let sides = [v[1].cross(v[2]), v[2].cross(v[0]), v[0].cross(v[1])];
            for k in 0..3 {
                let t = -sides[k].dot(p) / sides[k].dot(s);
                if !(t > lo && t < hi) {
                    continue;
                }
                let d = p + s * t;
                let (a, b) = (sides[(k + 1) % 3].dot(d), sides[(k + 2) % 3].dot(d));
                if (a >= 0.0) == (b >= 0.0) {
                    push(t, k as u8);
                }
            }
        }
        Kind::Sphere(i) => {
            let sphere = &prepared.local.spheres[i];
            // (d·c)² = |d|²·(|c|² − r²)
            let (c, m) = (vector(sphere.c), sphere.c.dot(sphere.c) - sphere.r * sphere.r);
            if !(m > 0.0) {
                return;
            }
            let (pc, sc) = (p.dot(c), s.dot(c));
            let (qa, qb, qc) = (sc * sc - s.dot(s) * m, pc * sc - p.dot(s) * m, pc * pc - p.dot(p) * m);
            let disc = qb * qb - qa * qc;
            if !(disc > 0.0) {
                return;
            }
            let q = -(qb + disc.sqrt().copysign(qb));
            for t in [q / qa, qc / q] {
                if (p + s * t).dot(c) > 0.0 {
                    push(t, 0);
                }
            }
        }
    }
}

/// The corner shared by two sides of a triangle, as a direction; sides named by the corners opposite.
pub(crate) fn corner(prepared: &PreparedScene, object: u32, sides: (u8, u8)) -> Option<DVec3> {
    match kind(&prepared.scene, ObjectId(object)) {
        Kind::Triangle(i) => {
            let v = prepared.local.triangle(&prepared.scene.triangles()[i]).v.map(vector);
            Some(v[3 - usize::from(sides.0) - usize::from(sides.1)])
        }
        _ => None,
    }
}

/// Whether an object's outline is made of straight lines.
pub(crate) fn is_straight(prepared: &PreparedScene, object: u32) -> bool {
    !matches!(kind(&prepared.scene, ObjectId(object)), Kind::Sphere(_))
}

impl PreparedScene {
    /// Whether two objects are triangles of one surface.
    pub(crate) fn same_mesh(&self, a: u32, b: u32) -> bool {
        let triangle = |id| matches!(kind(&self.scene, ObjectId(id)), Kind::Triangle(_));
        triangle(a) && triangle(b) && self.surface_of(ObjectId(a)) == self.surface_of(ObjectId(b))
    }
}

impl Tracer {
    /// The line through plane point (x, y) in steps of one unit to the right, or up.
    pub(crate) fn plane_line(&self, x: f64, y: f64, step: (f64, f64)) -> Line {
        let f = self.frame();
        Line { base: f.forward + f.right * x + f.up * y, step: f.right * step.0 + f.up * step.1 }
    }

    /// Where a direction of local space meets the image plane, in plane units, if it does.
    pub(crate) fn project(&self, d: DVec3) -> Option<(f64, f64)> {
        let f = self.frame();
        let depth = d.dot(f.forward) / f.forward.dot(f.forward);
        (depth > 0.0).then(|| (d.dot(f.right) / f.right.dot(f.right) / depth, d.dot(f.up) / f.up.dot(f.up) / depth))
    }
}
