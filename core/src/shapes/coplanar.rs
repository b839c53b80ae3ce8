//! Objects that lie in a plane, as exact ones: whether two lie in the same, and what else does.

use glam::DVec3;

use super::exact::Exact;
use super::plane::LocalPlane;
use super::{Listed, Local, ObjectId, Shape, of_shape, plane, triangle};
use crate::numeric::{Ball, Balls, Residue, Unsure, V3};
use crate::scene::{Plane, Scene, Triangle};

/// An object that lies in a plane.
pub(crate) enum FlatObject<'a> {
    Plane(&'a Plane, &'a LocalPlane),
    Triangle(&'a Triangle),
}

impl<'a> FlatObject<'a> {
    /// Object `id`, if it lies in a plane.
    pub(crate) fn of(scene: &'a Scene, local: &'a Local, id: ObjectId) -> Option<Self> {
        of_shape!(scene, id, O, i => O::all(scene)[i].in_plane(i, local))
    }

    /// Which axis its plane is square to, and where it crosses that.
    pub(crate) fn square_to_axis(&self) -> Option<(usize, f64)> {
        match self {
            Self::Plane(p, _) => plane::coplanar::square_to_axis(p),
            Self::Triangle(t) => triangle::coplanar::square_to_axis(t),
        }
    }

    /// The normal's ratios and the offset's square over the normal's, which may be irrational itself.
    pub(crate) fn residues(&self) -> [u64; 4] {
        let (n, square) = match self {
            Self::Plane(p, _) => plane::coplanar::residues(p),
            Self::Triangle(t) => triangle::coplanar::residues(t),
        };
        let pivot = n.into_iter().find(|x| x.0 != 0).unwrap_or(Residue(0)).inverse();
        [n[0] * pivot, n[1] * pivot, n[2] * pivot, square * pivot * pivot].map(|r| r.0)
    }

    /// How far `p` is from its plane, times some length, and the size of what that is the sum of; in local space.
    pub(crate) fn distance(&self, local: &Local, p: V3<f64>) -> (f64, f64) {
        match self {
            Self::Plane(_, plane) => plane::coplanar::distance(plane, p),
            Self::Triangle(t) => triangle::coplanar::distance(&local.triangle(t), p),
        }
    }

    /// The lengths that it is given by.
    pub(crate) fn lengths(&self) -> impl Iterator<Item = f64> {
        let (vectors, x) = match self {
            Self::Plane(p, _) => p.lengths(),
            Self::Triangle(t) => t.lengths(),
        };
        vectors.into_iter().flat_map(|v| v.to_array()).chain([x])
    }

    /// Its plane in integers; lengths times 2^scale are some.
    pub(crate) fn in_integers<const N: usize>(&self, scale: i64) -> IntegerPlane<N> {
        match self {
            Self::Plane(p, _) => plane::coplanar::in_integers(p, scale),
            Self::Triangle(t) => triangle::coplanar::in_integers(t, scale),
        }
    }
}

/// A vector modulo a prime.
pub(super) fn residue(v: DVec3) -> [Residue; 3] {
    v.to_array().map(Residue::of)
}

/// a · b.
pub(super) fn dot(a: [Residue; 3], b: [Residue; 3]) -> Residue {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A plane n · P = offset in integers: the offset's sign and square.
pub(crate) struct IntegerPlane<const N: usize> {
    pub(super) n: Balls<N>,
    pub(super) offset: Offset<N>,
}

pub(super) enum Offset<const N: usize> {
    Rational(Ball<N>),
    /// Sign and square.
    Root(i32, Ball<N>),
}

impl<const N: usize> IntegerPlane<N> {
    fn square(&self) -> Result<(i32, Ball<N>), Unsure> {
        Ok(match &self.offset {
            Offset::Rational(x) => (x.sign()?, *x * *x),
            Offset::Root(sign, square) => (*sign, *square),
        })
    }

    /// Whether two are the same plane.
    pub(crate) fn is(&self, o: &Self) -> Result<bool, Unsure> {
        for c in self.n.cross(&o.n).0 {
            if c.sign()? != 0 {
                return Ok(false);
            }
        }
        // A component that is not zero.
        let Some(k) = (0..3).find(|&k| !matches!(self.n.0[k].sign(), Ok(0))) else { return Ok(false) };
        let (a, b) = (self.n.0[k], o.n.0[k]);
        if let (Offset::Rational(x), Offset::Rational(y)) = (&self.offset, &o.offset) {
            return Ok((*x * b - *y * a).sign()? == 0);
        }
        let ((sign, square), (other_sign, other)) = (self.square()?, o.square()?);
        Ok(sign * b.sign()? == other_sign * a.sign()? && (square * b * b - other * a * a).sign()? == 0)
    }

    /// Whether the point is in it.
    pub(crate) fn holds(&self, p: &Balls<N>) -> Result<bool, Unsure> {
        let at = self.n.dot(p);
        if let Offset::Rational(x) = &self.offset {
            return Ok((at - *x).sign()? == 0);
        }
        let (sign, square) = self.square()?;
        Ok(at.sign()? == sign && (at * at - square).sign()? == 0)
    }
}
