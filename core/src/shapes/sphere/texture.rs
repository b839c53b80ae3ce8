//! A texture around a sphere, from pole to pole.

use glam::{DVec2, DVec3};

use crate::numeric::{Bound, U, Unsure, Vector};
use crate::scene::{Orientation, Scene, Sphere};
use crate::shapes::exact::ExactHit;
use crate::shapes::texture::{Exact, Mapping, Place, Textured, check, find, rounding};
use crate::shapes::{Listed, Local, ObjectId};

impl Textured for Sphere {
    const WRAPS: [bool; 2] = [true, false];

    fn mappings(scene: &Scene, local: &Local) -> Vec<Mapping> {
        let first = Self::first(scene);
        scene.orientations().iter().map(|&(i, o)| mapping(ObjectId(first + i), o, local, scene)).collect()
    }

    fn coordinates(&self, mappings: &[Mapping], _: &Local, at: &Place) -> (DVec2, f64) {
        let Place { met, interaction, .. } = at;
        let map = find(mappings, met.id);
        let m = if met.inside { -interaction.n } else { interaction.n };
        let (uv, sine) = on_sphere(map, m.to_dvec3());
        // Near a pole, u turns by en over the sine.
        (uv, (interaction.en + 8.0 * U) * (0.5 + 0.5 / sine.max(1e-300)))
    }

    fn exact_coordinates<const N: usize>(&self, mappings: &[Mapping], hit: &ExactHit<N>) -> Result<DVec2, Unsure> {
        let map = find(mappings, hit.decision.id);
        let (n, bend) = hit.raw_normal();
        let m = n.normalize();
        let [x, y, z] = map.exact.each_ref().map(|axis| m.dot(&axis.resize()));
        let sine = (x * x + y * y).sqrt();
        // Numbers that are taken as they are know nothing of errors.
        if hit.misplaced() != Bound::ZERO {
            check((bend + rounding::<N>()).over(&sine))?;
        }
        Ok(globe(x.to_f64(), y.to_f64(), z.to_f64(), sine.to_f64()))
    }
}

/// How a picture lies on the sphere `id`.
fn mapping(id: ObjectId, o: Orientation, local: &Local, scene: &Scene) -> Mapping {
    let (p, e) = (Exact::new(o.pole), Exact::new(o.equator));
    let e = e * p.dot(&p) - p * e.dot(&p);
    let b = e.cross(&p);
    Mapping::new(id, [e, b, p], Vector::ZERO, local, scene)
}

/// (u, v) of the outward unit normal `m` of a sphere, and the sine of its angle to the poles.
fn on_sphere(map: &Mapping, m: DVec3) -> (DVec2, f64) {
    let [e, b, p] = map.axes;
    let (x, y, z) = (m.dot(e), m.dot(b), m.dot(p));
    let sine = (x * x + y * y).sqrt();
    (globe(x, y, z, sine), sine)
}

/// (u, v) where the normal is x of the equator, y of e × p and z of the pole; `sine` is √(x² + y²).
fn globe(x: f64, y: f64, z: f64, sine: f64) -> DVec2 {
    // atan2 of sine and cosine keeps its accuracy at the poles, where acos loses half of it.
    let angle = libm::atan2(sine, z);
    let turn = libm::atan2(y, x) / std::f64::consts::TAU;
    let u = if turn < 0.0 { turn + 1.0 } else { turn };
    DVec2::new(u, 1.0 - angle / std::f64::consts::PI)
}

/// (u, v) at a pole of a sphere: the one that `pole` names, or the other where that is negative.
pub(crate) fn pole(pole: i32) -> DVec2 {
    globe(0.0, 0.0, f64::from(pole), 0.0)
}
