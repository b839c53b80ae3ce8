//! A texture on a triangle, by the weights of its corners.

use glam::DVec2;

use super::{LocalTriangle, forms};
use crate::numeric::{Bound, Unsure, Vector};
use crate::scene::Triangle;
use crate::shapes::Ray;
use crate::shapes::exact::{ExactHit, largest, size};
use crate::shapes::texture::{check, rounding};

/// Whether the picture repeats along u and v.
pub(crate) const WRAPS: [bool; 2] = [false, false];

/// (u, v) where `ray` meets the triangle, and the bound on their error.
pub(crate) fn coordinates(ray: &Ray, triangle: &LocalTriangle) -> (DVec2, f64) {
    let f = forms(ray, triangle);
    let sum = f.w[0] + f.w[1] + f.w[2];
    let (b1, b2) = (f.w[0] / sum, f.w[1] / sum);
    (DVec2::new(b1.clamp(0.0, 1.0), b2.clamp(0.0, 1.0)), 6.0 * f.e / sum.abs())
}

/// (u, v) at `hit`, from wide arithmetic.
pub(crate) fn exact_coordinates<const N: usize>(t: &Triangle, hit: &ExactHit<N>) -> Result<DVec2, Unsure> {
    let [a, b, c] = t.written.map(Vector::<N>::new);
    let (e1, e2) = if t.by_sides() { (b, c) } else { (b - a, c - a) };
    let (n, at) = (e1.cross(&e2), hit.p - a);
    let nn = n.dot(&n);
    let b1 = at.cross(&e2).dot(&n).over(nn).to_f64();
    let b2 = e1.cross(&at).dot(&n).over(nn).to_f64();
    let misplaced = hit.misplaced();
    // Numbers that are taken as they are know nothing of errors.
    if misplaced != Bound::ZERO {
        let rounding = rounding::<N>();
        let sides = size(&e1) + size(&e2);
        // The normal is rounded by its sides, and turned by that over its length.
        let bend = (sides * sides * rounding).over(&n.0[largest(&n)]);
        let moved = misplaced + (size(&hit.p) + size(&a)) * rounding + size(&at) * bend;
        check((moved * sides * size(&n)).scale(4).over(&nn))?;
    }
    Ok(DVec2::new(b1.clamp(0.0, 1.0), b2.clamp(0.0, 1.0)))
}
