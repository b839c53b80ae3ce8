//! Parts of a pixel that points would seldom meet: what lies between two edges close together, and small balls.
//!
//! They are convex polygons. Each is sampled by points of its own, and its share of the pixel is its area, which is
//! known; so it does not matter how thin it is, nor what is seen there. Polygons may overlap: what lies in
//! several counts for the first.

use crate::beam::cover::Shape;
use crate::beam::lens::{HALF, Pixels};
use crate::film::UNIT;

/// Edges of a pixel that are looked at; where there are more, points meet them often enough.
const EDGES: usize = 10;
/// Parts of a pixel at most.
const PARTS: usize = 6;
/// Larger parts, in pixels, are met by points anyhow.
const LARGE: f64 = 0.12;
/// Smaller ones are no more than a point of the plane.
const SMALL: f64 = 1e-8;
/// Balls of a smaller area, in pixels, are sampled by points of their own where no others are near; among others,
/// where points might miss them.
const BALL: f64 = 4.0;
const BALL_AMONG_OTHERS: f64 = 0.5;
/// Balls in a tile at most that are alone.
const ALONE: usize = 2;

/// A place in a pixel: 0 to 1 from the left and from below.
pub(crate) type PixelPoint = [f64; 2];

/// The shapes of a tile, with the pixels that they pass.
pub(crate) type Shapes = Vec<(Pixels, Shape)>;

/// A convex polygon.
#[derive(Clone, Debug, Default)]
pub(crate) struct Polygon {
    corners: Vec<PixelPoint>,
    /// Areas of the triangles from the first corner, added up.
    areas: Vec<f64>,
    ball: Option<Ball>,
}

/// What a polygon is a part of that is around a ball.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ball {
    /// The area of all of it, in pixels.
    pub(crate) area: f64,
    /// Whether no others are near.
    pub(crate) alone: bool,
}

impl Polygon {
    fn pixel() -> Self {
        Self { corners: vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], areas: Vec::new(), ball: None }
    }

    /// The part of it where a + b·x + c·y ≥ 0.
    fn clip(&self, [a, b, c]: [f64; 3]) -> Self {
        let n = self.corners.len();
        let value = |p: &PixelPoint| a + b * p[0] + c * p[1];
        let mut corners = Vec::with_capacity(n + 1);
        for k in 0..n {
            let (p, q) = (self.corners[k], self.corners[(k + 1) % n]);
            let (u, v) = (value(&p), value(&q));
            if u >= 0.0 {
                corners.push(p);
            }
            if (u > 0.0 && v < 0.0) || (u < 0.0 && v > 0.0) {
                let t = u / (u - v);
                corners.push([p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
            }
        }
        Self { corners, areas: Vec::new(), ball: self.ball }
    }

    /// The ball that it is around, if it is around one.
    pub(crate) fn ball(&self) -> Option<Ball> {
        self.ball
    }

    /// Adds up its areas.
    fn measured(mut self) -> Self {
        let Some(&o) = self.corners.first() else { return self };
        let mut sum = 0.0;
        for k in 1..self.corners.len().saturating_sub(1) {
            let (p, q) = (self.corners[k], self.corners[k + 1]);
            sum += 0.5 * ((p[0] - o[0]) * (q[1] - o[1]) - (q[0] - o[0]) * (p[1] - o[1])).abs();
            self.areas.push(sum);
        }
        self
    }

    pub(crate) fn area(&self) -> f64 {
        self.areas.last().copied().unwrap_or(0.0)
    }

    /// Where (u, v) of the unit square is, were it spread evenly over the polygon.
    pub(crate) fn place(&self, [u, v]: PixelPoint) -> PixelPoint {
        let at = u * self.area();
        let k = self.areas.partition_point(|a| *a < at).min(self.areas.len().saturating_sub(1));
        let before = if k == 0 { 0.0 } else { self.areas[k - 1] };
        let u = ((at - before) / (self.areas[k] - before).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let (o, p, q) = (self.corners[0], self.corners[k + 1], self.corners[k + 2]);
        // Evenly over a triangle.
        let (root, side) = (u.sqrt(), v);
        let (s, t) = (root * (1.0 - side), root * side);
        [o[0] + s * (p[0] - o[0]) + t * (q[0] - o[0]), o[1] + s * (p[1] - o[1]) + t * (q[1] - o[1])]
    }

    pub(crate) fn contains(&self, p: PixelPoint) -> bool {
        let n = self.corners.len();
        let mut turn = 0.0;
        for k in 0..n {
            let (a, b) = (self.corners[k], self.corners[(k + 1) % n]);
            let side = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
            if side * turn < 0.0 {
                return false;
            }
            if side != 0.0 {
                turn = side;
            }
        }
        n > 2
    }
}

/// The parts of the pixel with this index in its tile, whose centre is at (x, y); none where it has none, or too
/// many edges pass.
pub(crate) fn parts(shapes: &Shapes, index: u32, (x, y): (f64, f64)) -> Vec<Polygon> {
    let mut edges: Vec<[f64; 3]> = Vec::new();
    let mut parts: Vec<Polygon> = Vec::new();
    let alone = shapes.iter().filter(|(_, shape)| matches!(shape, Shape::Oval(..))).count() <= ALONE;
    let most = if alone { BALL } else { BALL_AMONG_OTHERS };
    for (_, shape) in shapes.iter().filter(|(pixels, _)| pixels >> index & 1 == 1) {
        match shape {
            Shape::Edge(e) => {
                // The system's own differs with what its processor can.
                let length = libm::hypot(e.b, e.c);
                let unit = f64::from(UNIT);
                // Distances in pixels, of places in the pixel.
                let line = [(e.a + e.b * (x - HALF) + e.c * (y - HALF)) / (length * unit), e.b / length, e.c / length];
                let twin = |o: &[f64; 3]| {
                    let turn = (o[1] * line[1] + o[2] * line[2]).signum();
                    (0..3).all(|k| (o[k] - turn * line[k]).abs() < 1e-9)
                };
                if line.iter().all(|c| c.is_finite()) && !edges.iter().any(twin) {
                    if edges.len() == EDGES {
                        return Vec::new();
                    }
                    edges.push(line);
                }
            }
            Shape::Oval(middle, p, q) => {
                let unit = f64::from(UNIT);
                let area = std::f64::consts::PI * (p[0] * q[1] - p[1] * q[0]).abs() / (unit * unit);
                if area < most && area > SMALL {
                    let polygon = oval(*middle, *p, *q, (x, y), alone).measured();
                    if polygon.area() > SMALL {
                        parts.push(polygon);
                    }
                }
            }
        }
        if parts.len() > PARTS {
            return Vec::new();
        }
    }
    for (k, a) in edges.iter().enumerate() {
        for b in &edges[..k] {
            let along = a[1] * b[1] + a[2] * b[2];
            if along.abs() < 0.9 {
                continue;
            }
            // Between the two: on unlike sides of them, once they are turned alike.
            let b = b.map(|c| c * along.signum());
            for side in [1.0, -1.0] {
                let between = Polygon::pixel().clip(a.map(|c| c * side)).clip(b.map(|c| -c * side)).measured();
                if between.area() > SMALL && between.area() < LARGE {
                    parts.push(between);
                }
            }
        }
    }
    parts.sort_by(|a, b| a.area().total_cmp(&b.area()));
    parts.truncate(PARTS);
    parts
}

/// An octagon around a ball's outline, as far as it lies in the pixel.
fn oval(middle: [f64; 2], p: [f64; 2], q: [f64; 2], (x, y): (f64, f64), alone: bool) -> Polygon {
    let unit = f64::from(UNIT);
    let long = 1.0 / libm::cos(std::f64::consts::PI / 8.0) * (1.0 + 1e-9);
    let corners: Vec<PixelPoint> = (0..8)
        .map(|k| {
            // Eighths of a turn, without sines that differ between platforms.
            let h = std::f64::consts::FRAC_1_SQRT_2;
            let (c, s) = [(1.0, 0.0), (h, h), (0.0, 1.0), (-h, h), (-1.0, 0.0), (-h, -h), (0.0, -1.0), (h, -h)][k];
            let at = |k: usize| middle[k] + (p[k] * c + q[k] * s) * long;
            [(at(0) - (x - HALF)) / unit, (at(1) - (y - HALF)) / unit]
        })
        .collect();
    let mut all = Polygon { corners, ..Polygon::default() }.measured();
    all.ball = Some(Ball { area: all.area(), alone });
    all.clip([0.0, 1.0, 0.0]).clip([1.0, -1.0, 0.0]).clip([0.0, 0.0, 1.0]).clip([1.0, 0.0, -1.0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beam::lens::Linear;

    fn edge(a: f64, b: f64, c: f64) -> Shape {
        let unit = f64::from(UNIT);
        Shape::Edge(Linear { a, b: b / unit, c: c / unit, size: 1.0 })
    }

    #[test]
    fn the_zone_between_two_near_edges_is_a_part_with_its_area() {
        // x = 0.3 and x = 0.301, of a pixel whose centre is the origin: turned alike and against each other.
        for turn in [1.0, -1.0] {
            let shapes = vec![(1, edge(-0.3 + 0.5, 1.0, 0.0)), (1, edge((-0.301 + 0.5) * turn, turn, 0.0))];
            let parts = parts(&shapes, 0, (0.0, 0.0));
            assert_eq!(parts.len(), 1, "{parts:?}");
            assert!((parts[0].area() - 0.001).abs() < 1e-9);
            for (u, v) in [(0.01, 0.9), (0.5, 0.5), (0.99, 0.02)] {
                let p = parts[0].place([u, v]);
                assert!(p[0] >= 0.3 - 1e-12 && p[0] <= 0.301 + 1e-12 && (0.0..=1.0).contains(&p[1]));
                assert!(parts[0].contains(p));
            }
            assert!(!parts[0].contains([0.302, 0.5]));
        }
    }

    #[test]
    fn a_ball_s_octagon_is_around_it() {
        let r = 0.2 * f64::from(UNIT);
        let shapes = vec![(1, Shape::Oval([0.0, 0.0], [r, 0.0], [0.0, r]))];
        let parts = parts(&shapes, 0, (0.0, 0.0));
        let disc = std::f64::consts::PI * 0.04;
        assert!(parts.len() == 1 && parts[0].area() > disc && parts[0].area() < 1.25 * disc, "{parts:?}");
    }

    #[test]
    fn places_fill_a_polygon_evenly() {
        let polygon = Polygon::pixel().clip([0.7, -1.0, 0.3]).clip([0.9, 0.2, -1.0]).measured();
        let (mut inside, n) = (0, 400);
        for i in 0..n {
            for j in 0..n {
                let p = polygon.place([(f64::from(i) + 0.5) / f64::from(n), (f64::from(j) + 0.5) / f64::from(n)]);
                assert!(polygon.contains([p[0] * (1.0 - 1e-12) + 1e-13, p[1]]) || p[1] > 0.0);
                inside += u32::from(p[0] < 0.3);
            }
        }
        let part = polygon.clip([0.3, -1.0, 0.0]).measured().area() / polygon.area();
        assert!((f64::from(inside) / f64::from(n * n) - part).abs() < 0.01);
    }
}
