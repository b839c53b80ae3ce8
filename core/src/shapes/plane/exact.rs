//! A plane before a line in wide numbers.

use std::sync::OnceLock;

use glam::DVec3;

use crate::numeric::{Big, Bound, Unsure, Vector};
use crate::scene::{Plane, PlanePosition};
use crate::shapes::Decision;
use crate::shapes::exact::{At, Crossing, Distance, Exact, ExactHit, ExactRay, FIRST, LAST, Met, size};

/// A plane in wide numbers: n · P = offset.
#[derive(Clone, Copy, Debug)]
struct ExactPlane<const N: usize> {
    n: Vector<N>,
    offset: Big<N>,
    /// 2 / n², what mirrors a ray.
    fold: Big<N>,
    /// The normal's size, and how far from the origin the point is that the offset was found by.
    length: Bound,
    reach: Bound,
}

/// A plane at both widths; at the last, which few scenes ask for, from when it is asked for.
#[derive(Debug)]
pub(crate) struct ExactPlanes {
    first: ExactPlane<FIRST>,
    last: OnceLock<Box<ExactPlane<LAST>>>,
}

impl ExactPlanes {
    pub(crate) fn new(plane: &Plane) -> Self {
        Self { first: ExactPlane::new(plane), last: OnceLock::new() }
    }
}

impl<const N: usize> ExactPlane<N> {
    fn new(plane: &Plane) -> Self {
        let n = Vector::new(plane.normal);
        let (offset, reach) = match plane.position {
            PlanePosition::Point(q) => {
                let q = Vector::new(q);
                (n.dot(&q), size(&q))
            }
            PlanePosition::Distance(d) => (Big::new(d) * n.length(), Bound::of(&Big::<N>::new(d)).scale(1)),
        };
        Self { n, offset, fold: Big::new(2.0).over(n.dot(&n)), length: size(&n), reach }
    }

    /// `plane` in this width.
    fn of(ExactPlanes { first, last }: &ExactPlanes, plane: &Plane) -> Self {
        if N == FIRST { first.resize() } else { last.get_or_init(|| Box::new(ExactPlane::new(plane))).resize() }
    }

    fn resize<const M: usize>(&self) -> ExactPlane<M> {
        let Self { n, offset, fold, length, reach } = self;
        ExactPlane { n: n.resize(), offset: offset.resize(), fold: fold.resize(), length: *length, reach: *reach }
    }

    fn cross(&self, ray: &ExactRay<N>) -> Crossing<N> {
        let reach = size(&ray.o) + self.reach;
        Crossing::new(ray, self.offset - self.n.dot(&ray.o), self.n.dot(&ray.d), self.length, reach)
    }
}

impl Exact for Plane {
    fn intersect<const N: usize>(&self, (i, local): At, ray: &ExactRay<N>, _: Option<Decision>) -> Met<Distance<N>> {
        let crossing = ExactPlane::of(&local.exact_planes[i], self).cross(ray);
        let leans = crossing.leans()?;
        Ok((leans != 0 && crossing.ahead()? * leans > 0).then(|| (crossing.distance(ray.slack.rounding), false)))
    }

    fn hit<const N: usize>(&self, (i, local): At, ray: &ExactRay<N>, met: Decision) -> Result<ExactHit<N>, Unsure> {
        let plane = ExactPlane::of(&local.exact_planes[i], self);
        let crossing = plane.cross(ray);
        Ok(crossing.hit(ray, plane.n, crossing.den * plane.fold, met))
    }

    fn lengths(&self) -> ([DVec3; 3], f64) {
        let none = DVec3::ZERO;
        match self.position {
            PlanePosition::Point(q) => ([q, none, none], 0.0),
            PlanePosition::Distance(d) => ([none; 3], d),
        }
    }
}
