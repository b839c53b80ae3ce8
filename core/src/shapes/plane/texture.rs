//! A texture on a plane, in squares of one unit.

use glam::{DVec2, DVec3};

use crate::numeric::{Big, Bound, U, Unsure, Vector};
use crate::scene::{Pigment, Plane, PlanePosition, Scene};
use crate::shapes::exact::{ExactHit, LAST, size};
use crate::shapes::local::ldexp;
use crate::shapes::texture::{Exact, Mapping, Place, Textured, check, find, fraction, rounding};
use crate::shapes::{Listed, Local, ObjectId};

impl Textured for Plane {
    const WRAPS: [bool; 2] = [true, true];

    fn mappings(scene: &Scene, local: &Local) -> Vec<Mapping> {
        let pictured = |p: &Plane| matches!(scene.surface(p.surface).pigment, Pigment::Texture(_));
        let planes = scene.planes().iter().enumerate().filter(|(_, p)| pictured(p));
        planes.map(|(i, p)| mapping(ObjectId(Self::first(scene) + i as u32), p, local, scene)).collect()
    }

    fn coordinates(&self, mappings: &[Mapping], local: &Local, at: &Place) -> (DVec2, f64) {
        let (map, interaction) = (find(mappings, at.met.id), at.interaction);
        let at = interaction.p.to_dvec3() - map.local_origin;
        let world = |x: f64| ldexp(x, local.power);
        let e = world(interaction.ep + 8.0 * U * (interaction.p.norm1() + map.local_origin.abs().element_sum()));
        (DVec2::new(fraction(world(at.dot(map.axes[0]))), fraction(world(at.dot(map.axes[1])))), e)
    }

    fn exact_coordinates<const N: usize>(&self, mappings: &[Mapping], hit: &ExactHit<N>) -> Result<DVec2, Unsure> {
        let map = find(mappings, hit.decision.id);
        let at = hit.p - map.origin.resize();
        let misplaced = hit.misplaced();
        // Numbers that are taken as they are know nothing of errors.
        if misplaced != Bound::ZERO {
            let reach = size(&hit.p) + size(&map.origin);
            check(misplaced + reach * rounding::<N>())?;
        }
        let part = |axis: &Vector<LAST>| fraction(at.dot(&axis.resize()).fraction().to_f64());
        Ok(DVec2::new(part(&map.exact[0]), part(&map.exact[1])))
    }
}

/// How a picture lies on the plane `id`.
fn mapping(id: ObjectId, p: &Plane, local: &Local, scene: &Scene) -> Mapping {
    let n = Exact::new(p.normal);
    let size = p.normal.abs();
    // The axis with the least |n·axis|, x before y before z.
    let t = if size.x <= size.y && size.x <= size.z {
        DVec3::X
    } else if size.y <= size.z {
        DVec3::Y
    } else {
        DVec3::Z
    };
    let u = Exact::new(t).cross(&n);
    let v = n.cross(&u);
    let origin = match p.position {
        PlanePosition::Point(q) => Vector::new(q),
        PlanePosition::Distance(d) => Vector::new(p.normal).normalize() * Big::new(d),
    };
    Mapping::new(id, [u, v, n], origin, local, scene)
}
