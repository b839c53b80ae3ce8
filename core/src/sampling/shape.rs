//! How much of a pixel an object would cover that nothing hides, exactly.

use glam::{DVec2, DVec3};

use super::lattice::{UNIT, vector};
use crate::geometry::ObjectId;
use crate::geometry::local::{Kind, kind};
use crate::trace::{PlanePoint, Tracer};

/// What an object covers of the image plane around a pixel; coordinates in pixels from the pixel's
/// upper left corner, x to the right, y down.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Shape {
    /// Where all the first `count` lines (a, b, c) have a·x + b·y + c ≥ 0.
    Straight { lines: [DVec3; 3], count: usize },
    /// Where |m·(p − centre)| ≤ 1, m a triangular matrix \[m.x m.y; 0 m.z\].
    Round { centre: DVec2, m: DVec3 },
}

impl Shape {
    /// The shape of `object` for the pixel at `origin`, where it has one.
    pub(crate) fn of(tracer: &Tracer, object: u32, origin: PlanePoint) -> Option<Self> {
        let (prepared, f) = (tracer.prepared(), tracer.frame());
        let unit = f64::from(UNIT);
        let base = f.direction(origin);
        let (dx, dy) = (f.right * unit, f.up * -unit);
        let line = |n: DVec3| DVec3::new(n.dot(dx), n.dot(dy), n.dot(base));
        match kind(&prepared.scene, ObjectId(object)) {
            Kind::Plane(i) => {
                let plane = &prepared.local.planes[i];
                let n = line(vector(plane.n));
                let lines = [if plane.h > 0.0 { n } else { -n }; 3];
                Some(Self::Straight { lines, count: 1 })
            }
            Kind::Triangle(i) => {
                let v = prepared.local.triangle(&prepared.scene.triangles()[i]).v.map(vector);
                let sides = [v[1].cross(v[2]), v[2].cross(v[0]), v[0].cross(v[1])];
                let turn = sides[0].dot(v[0]);
                (turn != 0.0).then(|| Self::Straight { lines: sides.map(|n| line(n * turn.signum())), count: 3 })
            }
            Kind::Sphere(i) => {
                let sphere = &prepared.local.spheres[i];
                let (c, r) = (vector(sphere.c), sphere.r);
                let depth = c.dot(f.forward) / f.forward.dot(f.forward);
                if !(depth > 0.0 && c.dot(c) > r * r) {
                    return None;
                }
                // Relative to where the centre is seen: d = d0 + x·dx + y·dy is within the cone
                // where r²|d|² ≥ |d × c|², and d0 × c = 0.
                let d0 = c * (1.0 / depth);
                let (px, py) = (dx.cross(c), dy.cross(c));
                let rr = r * r;
                let a = px.dot(px) - rr * dx.dot(dx);
                let b = px.dot(py) - rr * dx.dot(dy);
                let d = py.dot(py) - rr * dy.dot(dy);
                let det = a * d - b * b;
                if !(a > 0.0 && det > 0.0) {
                    return None;
                }
                let g = DVec2::new(rr * d0.dot(dx), rr * d0.dot(dy));
                let shift = DVec2::new(d * g.x - b * g.y, a * g.y - b * g.x) * (1.0 / det);
                let k = rr * d0.dot(d0) + g.dot(shift);
                let (x, y) = tracer.project(c)?;
                let seen = DVec2::new(x - f64::from(origin.x), f64::from(origin.y) - y) * (1.0 / unit);
                let first = (a / k).sqrt();
                let m = DVec3::new(first, b / (k * first), (det / (a * k)).sqrt());
                m.is_finite().then_some(Self::Round { centre: seen + shift, m })
            }
        }
    }

    /// Whether it covers a point.
    pub(crate) fn contains(&self, p: DVec2) -> bool {
        match self {
            Self::Straight { lines, count } => lines[..*count].iter().all(|l| l.x * p.x + l.y * p.y + l.z >= 0.0),
            Self::Round { centre, m } => {
                let u = turn(*m, p - *centre);
                u.dot(u) <= 1.0
            }
        }
    }

    /// How much of the pixel it covers.
    pub(crate) fn area(&self) -> f64 {
        let square = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        match self {
            Self::Straight { lines, count } => {
                let mut polygon = Polygon { corners: [DVec2::ZERO; 8], count: 4 };
                polygon.corners[..4].copy_from_slice(&square);
                for l in &lines[..*count] {
                    polygon = polygon.cut(*l);
                }
                polygon.area()
            }
            Self::Round { centre, m } => {
                let u = square.map(|p| turn(*m, p - *centre));
                let swept: f64 = (0..4).map(|i| sweep(u[i], u[(i + 1) % 4])).sum();
                (swept / (m.x * m.z)).clamp(0.0, 1.0)
            }
        }
    }
}

fn turn(m: DVec3, d: DVec2) -> DVec2 {
    DVec2::new(m.x * d.x + m.y * d.y, m.z * d.y)
}

fn cross(a: DVec2, b: DVec2) -> f64 {
    a.x * b.y - a.y * b.x
}

/// The signed area of the part of triangle (0, p, q) that is in the unit circle.
fn sweep(p: DVec2, q: DVec2) -> f64 {
    let sector = |a: DVec2, b: DVec2| 0.5 * libm::atan2(cross(a, b), a.dot(b));
    let d = q - p;
    let (a, b, c) = (d.dot(d), p.dot(d), p.dot(p) - 1.0);
    let disc = b * b - a * c;
    if !(disc > 0.0 && a > 0.0) {
        return sector(p, q);
    }
    let root = disc.sqrt();
    let (t0, t1) = ((-b - root) / a, (-b + root) / a);
    if t1 <= 0.0 || t0 >= 1.0 {
        return sector(p, q);
    }
    let (enter, leave) = (p + d * t0.max(0.0), p + d * t1.min(1.0));
    let mut area = 0.5 * cross(enter, leave);
    if t0 > 0.0 {
        area += sector(p, enter);
    }
    if t1 < 1.0 {
        area += sector(leave, q);
    }
    area
}

/// A convex polygon; a square cut by three lines has seven corners at most.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [DVec2; 8],
    count: usize,
}

impl Polygon {
    /// The part of it where l.x·x + l.y·y + l.z ≥ 0.
    fn cut(&self, l: DVec3) -> Self {
        let mut out = Self { corners: [DVec2::ZERO; 8], count: 0 };
        let mut push = |p: DVec2| {
            if out.count < 8 {
                out.corners[out.count] = p;
                out.count += 1;
            }
        };
        let side = |p: DVec2| l.x * p.x + l.y * p.y + l.z;
        for i in 0..self.count {
            let (p, q) = (self.corners[i], self.corners[(i + 1) % self.count]);
            let (a, b) = (side(p), side(q));
            if a >= 0.0 {
                push(p);
            }
            if (a >= 0.0) != (b >= 0.0) {
                push(p + (q - p) * (a / (a - b)));
            }
        }
        out
    }

    fn area(&self) -> f64 {
        let o = self.corners[0];
        (2..self.count).map(|i| 0.5 * cross(self.corners[i - 1] - o, self.corners[i] - o)).sum::<f64>().max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn circles_cover_what_counting_says() {
        for (x, y, r) in [(0.5, 0.5, 0.2), (0.5, 0.5, 0.6), (0.1, 0.9, 0.4), (3.0, 4.0, 4.6), (-0.2, 0.5, 0.1)] {
            let shape = Shape::Round { centre: DVec2::new(x, y), m: DVec3::new(1.0 / r, 0.0, 1.0 / r) };
            let n = 1000;
            let inside = (0..n * n)
                .filter(|k| shape.contains(DVec2::new(f64::from(k % n) + 0.5, f64::from(k / n) + 0.5) / f64::from(n)))
                .count();
            let counted = inside as f64 / f64::from(n * n);
            assert!((shape.area() - counted).abs() < 1e-4, "{x} {y} {r}: {} {counted}", shape.area());
        }
    }

    #[test]
    fn lines_cut_squares() {
        let (diagonal, upper) = (DVec3::new(1.0, -1.0, 0.0), DVec3::new(0.0, -1.0, 0.5));
        let shape = |lines, count| Shape::Straight { lines, count };
        assert!((shape([diagonal; 3], 1).area() - 0.5).abs() < 1e-15);
        assert!((shape([diagonal, upper, upper], 3).area() - 0.375).abs() < 1e-15);
        assert_eq!(shape([diagonal, -diagonal, upper], 3).area(), 0.0);
    }
}
