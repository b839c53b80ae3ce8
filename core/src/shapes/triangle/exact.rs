//! A triangle before a line in wide numbers.

use glam::DVec3;

use crate::numeric::{Unsure, Vector};
use crate::scene::Triangle;
use crate::shapes::Decision;
use crate::shapes::exact::{At, Crossing, Distance, Exact, ExactHit, ExactRay, Met, Slack, sign, size, times};

/// A triangle's first corner and its sides, as real numbers.
pub(crate) fn corner_and_sides<const N: usize>(t: &Triangle) -> [Vector<N>; 3] {
    let [a, b, c] = t.written.map(Vector::new);
    if t.by_sides() { [a, b, c] } else { [a, b - a, c - a] }
}

/// The line and the plane of a triangle, and that plane's normal.
fn cross<const N: usize>(ray: &ExactRay<N>, [a, e1, e2]: &[Vector<N>; 3]) -> (Crossing<N>, Vector<N>) {
    let n = e1.cross(e2);
    let length = size(e1) * size(e2);
    (Crossing::new(ray, n.dot(&(*a - ray.o)), n.dot(&ray.d), length, size(a) + size(&ray.o)), n)
}

impl Exact for Triangle {
    fn intersect<const N: usize>(&self, _: At, ray: &ExactRay<N>, _: Option<Decision>) -> Met<Distance<N>> {
        let corners = &corner_and_sides(self);
        let [a, e1, e2] = corners;
        let (crossing, _) = cross(ray, corners);
        let p0 = *a - ray.o;
        // Barycentric weights times N·d, by the moments relative to p0: a line through an edge
        // gives a weight of zero, which belongs to the triangle.
        let q = p0.cross(&ray.d);
        let b1 = e2.dot(&q);
        let b2 = -e1.dot(&q);
        let b0 = crossing.den - b1 - b2;
        let Slack { lateral, turn, rounding, .. } = ray.slack;
        let (speed, reach) = (size(&ray.d), size(a) + size(&ray.o));
        let error = times(speed * (times(lateral, 1) + size(&p0) * times(turn, 2) + reach * rounding), 2);
        let (l1, l2, reach) = (size(e1), size(e2), reach * speed);
        let s1 = sign(&b1, l2 * reach, l2 * error);
        let s2 = sign(&b2, l1 * reach, l1 * error);
        let s0 = sign(&b0, (l1 + l2) * reach, (l1 + l2) * error + crossing.den_error);
        // One weight surely against another settles it, whatever the rest.
        let sure = [&s0, &s1, &s2].map(|s| s.as_ref().copied().unwrap_or(0));
        if sure.contains(&1) && sure.contains(&-1) {
            return Ok(None);
        }
        let leans = crossing.leans()?;
        if leans == 0 || s0? * leans < 0 || s1? * leans < 0 || s2? * leans < 0 {
            return Ok(None);
        }
        Ok((crossing.ahead()? * leans > 0).then(|| (crossing.distance(rounding), false)))
    }

    fn hit<const N: usize>(&self, _: At, ray: &ExactRay<N>, met: Decision) -> Result<ExactHit<N>, Unsure> {
        let (crossing, n) = cross(ray, &corner_and_sides(self));
        Ok(crossing.hit(ray, n, crossing.den.scale(1).over(n.dot(&n)), met))
    }

    fn lengths(&self) -> ([DVec3; 3], f64) {
        (self.written, 0.0)
    }
}
