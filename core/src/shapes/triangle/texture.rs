//! A texture on a triangle, by the weights of its corners.

use glam::DVec2;

use super::forms;
use crate::numeric::{Bound, Unsure, Vector};
use crate::scene::Triangle;
use crate::shapes::Local;
use crate::shapes::exact::{ExactHit, largest, size};
use crate::shapes::texture::{Mapping, Place, Textured, check, rounding};

impl Textured for Triangle {
    fn coordinates(&self, _: &[Mapping], local: &Local, at: &Place) -> (DVec2, f64) {
        let f = forms(at.ray, &local.triangle(self));
        let sum = f.w[0] + f.w[1] + f.w[2];
        let (b1, b2) = (f.w[0] / sum, f.w[1] / sum);
        (DVec2::new(b1.clamp(0.0, 1.0), b2.clamp(0.0, 1.0)), 6.0 * f.e / sum.abs())
    }

    fn exact_coordinates<const N: usize>(&self, _: &[Mapping], hit: &ExactHit<N>) -> Result<DVec2, Unsure> {
        let [a, b, c] = self.written.map(Vector::<N>::new);
        let (e1, e2) = if self.by_sides() { (b, c) } else { (b - a, c - a) };
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
}
