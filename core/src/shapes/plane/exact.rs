//! A plane before a line in wide numbers.

use std::sync::OnceLock;

use glam::DVec3;

use crate::numeric::{Big, Bound, Unsure, Vector};
use crate::scene::{Plane, PlanePosition};
use crate::shapes::Decision;
use crate::shapes::exact::{Crossing, Distance, ExactHit, ExactRay, FIRST, LAST, size};

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

/// Where `ray`, which starts elsewhere, meets the plane.
pub(crate) fn intersect<const N: usize>(
    ray: &ExactRay<N>,
    planes: &ExactPlanes,
    plane: &Plane,
) -> Result<Option<(Distance<N>, bool)>, Unsure> {
    let crossing = ExactPlane::of(planes, plane).cross(ray);
    let leans = crossing.leans()?;
    Ok((leans != 0 && crossing.ahead()? * leans > 0).then(|| (crossing.distance(ray.slack.rounding), false)))
}

/// The point where `ray` meets this plane, which `decision` is known to be.
pub(crate) fn hit<const N: usize>(
    ray: &ExactRay<N>,
    planes: &ExactPlanes,
    plane: &Plane,
    decision: Decision,
) -> ExactHit<N> {
    let plane = ExactPlane::of(planes, plane);
    let crossing = plane.cross(ray);
    crossing.hit(ray, plane.n, crossing.den * plane.fold, decision)
}

/// The lengths that the plane is given by.
pub(crate) fn lengths(plane: &Plane) -> ([DVec3; 3], f64) {
    let none = DVec3::ZERO;
    match plane.position {
        PlanePosition::Point(q) => ([q, none, none], 0.0),
        PlanePosition::Distance(d) => ([none; 3], d),
    }
}
