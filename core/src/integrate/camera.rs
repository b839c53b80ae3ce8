//! From points of the image plane to rays.

use glam::DVec3;

use crate::film::PlanePoint;
use crate::numeric::{Big, DoubleDouble, Real, U, V3, Vector};
use crate::scene::Camera;
use crate::settings::View;
use crate::shapes::Ray;
use crate::shapes::exact::{ExactRay, LAST};

/// Wide enough for products of the sky and two differences of points.
type Exact = Vector<104>;

/// Bound on a camera ray's direction, relative: each of its three orthogonal parts is within u of the real one, its
/// product with a coordinate within another u, and two sums follow: |d − d*| ≤ (2√3 + 2)u·|d|.
pub(crate) const TURN: f64 = 6.0 * U;

/// The camera's frame under a view, for points on a grid of `grid` cells along a pixel's edge.
///
/// The direction through (x, y) is zoom·f + x·r·s + y·u·s, s the height of a unit. Only its
/// direction counts, so it is divided by s and by a power of two: forward + x·right + y·up
/// with integers x and y. The three vectors are found in wide arithmetic and rounded once.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    grid: u32,
    width: u32,
    height: u32,
    location: DVec3,
    exact: [Vector<LAST>; 3],
    double: [V3<DoubleDouble>; 3],
    pub(crate) forward: DVec3,
    pub(crate) right: DVec3,
    pub(crate) up: DVec3,
}

impl Frame {
    pub(crate) fn new(camera: &Camera, view: &View, grid: u32) -> Self {
        let location = camera.location();
        // Exactly, as the sky may be almost the view's direction, and only then rounded.
        let f = Exact::new(camera.look_at()) - Exact::new(location);
        let r = Exact::new(camera.sky()).cross(&f);
        let u = f.cross(&r);
        let [f, r, u] = [f, r, u].map(|v| v.resize::<LAST>().normalize());
        let units = 2.0 * f64::from(grid) * f64::from(view.height());
        let distance = (Big::new(view.zoom()) * Big::new(units)).over(Big::new(view.plane_height()));
        // The longest of the three parts of a direction becomes about 1.
        let widest = Big::<LAST>::new(f64::from(grid) * f64::from(view.width().max(view.height())));
        let scale = -distance.exponent().max(widest.exponent());
        let exact = [(f * distance).scale(scale), r.scale(scale), u.scale(scale)];
        let [forward, right, up] = exact.map(|v| v.to_f64());
        let double = exact.each_ref().map(|v| {
            let [x, y, z] = v.0.each_ref().map(DoubleDouble::nearest);
            V3 { x, y, z }
        });
        Self { grid, width: view.width(), height: view.height(), location, exact, double, forward, right, up }
    }

    /// The centre of cell (x, y) of the picture's grid, x to the right, y down.
    pub(crate) fn cell(&self, x: u32, y: u32) -> PlanePoint {
        let n = i64::from(self.grid);
        // At most 2 · 64 · 65536 in magnitude: cells are of uniform grids.
        PlanePoint {
            x: (2 * i64::from(x) + 1 - n * i64::from(self.width)) as i32,
            y: (n * i64::from(self.height) - 2 * i64::from(y) - 1) as i32,
        }
    }

    /// The ray through `p`, in local space and to twice the digits; the bound as for [`TURN`].
    pub(crate) fn double_ray(&self, p: PlanePoint) -> Ray<DoubleDouble> {
        let [f, r, u] = self.double;
        let k = DoubleDouble::splat;
        let d = f + r * k(f64::from(p.x)) + u * k(f64::from(p.y));
        Ray::new(V3::splat(DVec3::ZERO), d, k(0.0), k(TURN / U * DoubleDouble::U))
    }

    /// The ray through `p`, in world space and wide arithmetic.
    pub(crate) fn exact_ray<const N: usize>(&self, p: PlanePoint) -> ExactRay<N> {
        let [f, r, u] = &self.exact;
        let (f, r, u) = (f.resize(), r.resize(), u.resize());
        let d = f + r * Big::new(f64::from(p.x)) + u * Big::new(f64::from(p.y));
        ExactRay::new(self.location, d)
    }
}
