//! A plane in local space.

use glam::DVec3;

use super::LocalPlane;
use crate::numeric::predicates::Exact;
use crate::numeric::{Big, DoubleDouble, V3, Vector};
use crate::scene::{Plane, PlanePosition};

impl LocalPlane<DoubleDouble> {
    /// The plane around `origin`, in local space of this power.
    pub(crate) fn new(p: &Plane, origin: DVec3, power: i32) -> Self {
        let n = Vector::<8>::new(p.normal);
        let length = n.length();
        let [x, y, z] = (n * length.reciprocal()).0.each_ref().map(DoubleDouble::nearest);
        let offset = offset(p, origin, length).over(length);
        let mut h = DoubleDouble::nearest(&offset.scale(-i64::from(power)));
        if h.hi == 0.0 && !offset.is_zero() {
            // 0 is kept for planes through the eye; bounds allow for as little as this.
            h = DoubleDouble { hi: f64::MIN_POSITIVE * f64::from(offset.signum()), lo: 0.0 };
        }
        Self { n: V3 { x, y, z }, h }
    }

    /// Rounded.
    pub(crate) fn to_f64(self) -> LocalPlane {
        LocalPlane { n: self.n.to_f64(), h: self.h.hi }
    }
}

/// n · (q − origin) for points q of the plane, n of this `length`: zero where it is zero, else to nearly
/// all of its digits.
fn offset(p: &Plane, origin: DVec3, length: Big<8>) -> Big<8> {
    let through = Exact::new(p.normal).dot(&Exact::new(origin));
    match p.position {
        PlanePosition::Point(q) => Exact::new(p.normal).dot(&(Exact::new(q) - Exact::new(origin))).resize(),
        PlanePosition::Distance(d) => {
            let (far, near) = (Big::new(d) * length, through.resize::<8>());
            let offset = far - near;
            if offset.is_zero() || offset.exponent() < far.exponent().saturating_sub(256) {
                // far² − near² is exact, and far + near subtracts nothing.
                let (n, d) = (Vector::<136>::new(p.normal), Big::<136>::new(d));
                let through = through.resize::<136>();
                return (d * d * n.dot(&n) - through * through).resize::<8>().over(far + near);
            }
            offset
        }
    }
}
