//! Pictures on surfaces.

use glam::{DVec2, DVec3};

use crate::numeric::{Big, Bound, U, Unsure, Vector};
use crate::scene::{Pigment, PlanePosition, Scene, Texture};
use crate::shapes::exact::{ExactHit, LAST, largest, size};
use crate::shapes::{Decision, Kind, Local, ObjectId, Ray, SurfaceInteraction, kind, triangle};

/// The largest misplacement of a picture, in texels, that f64 is trusted with.
pub(crate) const TEXEL: f64 = 1e-4;

/// Whether a picture repeats along u and v on objects of a kind, or ends at its edges.
pub(crate) fn wraps(kind: Kind) -> [bool; 2] {
    match kind {
        Kind::Sphere(_) => [true, false],
        Kind::Plane(_) => [true, true],
        Kind::Triangle(_) => [false, false],
    }
}

/// How a picture lies on an object that has one.
#[derive(Clone, Debug)]
pub(crate) struct Mapping {
    id: ObjectId,
    /// Sphere: unit equator, e × p, and pole. Plane: U, V, and the normal.
    axes: [DVec3; 3],
    exact: [Vector<LAST>; 3],
    /// Plane: the picture's origin in world space, and in local space.
    origin: Vector<LAST>,
    local_origin: DVec3,
}

/// Bvh enough that products of four f64s are exact.
type Exact = Vector<136>;

impl Mapping {
    /// From axes of any length, found exactly, and an origin.
    fn new(id: ObjectId, axes: [Exact; 3], origin: Vector<LAST>, local: &Local, scene: &Scene) -> Self {
        let exact = axes.map(|v| v.resize::<LAST>().normalize());
        let eye = Vector::new(scene.camera().location());
        let local_origin = (origin - eye).scale(-i64::from(local.power)).to_f64();
        Self { id, axes: exact.map(|v| v.to_f64()), exact, origin, local_origin }
    }
}

/// Mappings of a scene's pictured spheres and planes, by rising id.
pub(crate) fn mappings(scene: &Scene, local: &Local) -> Vec<Mapping> {
    let pictured = |s| matches!(scene.surface(s).pigment, Pigment::Texture(_));
    let planes = scene.planes().iter().enumerate().filter(|(_, p)| pictured(p.surface)).map(|(i, p)| {
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
        Mapping::new(ObjectId(i as u32), [u, v, n], origin, local, scene)
    });
    let first = scene.planes().len() as u32;
    let spheres = scene.orientations().iter().map(|&(i, o)| {
        let (p, e) = (Exact::new(o.pole), Exact::new(o.equator));
        let e = e * p.dot(&p) - p * e.dot(&p);
        let b = e.cross(&p);
        Mapping::new(ObjectId(first + i), [e, b, p], Vector::ZERO, local, scene)
    });
    planes.chain(spheres).collect()
}

fn find(mappings: &[Mapping], id: ObjectId) -> &Mapping {
    let at = mappings.partition_point(|m| m.id < id);
    &mappings[at]
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

/// x − ⌊x⌋ in [0, 1).
fn fraction(x: f64) -> f64 {
    let f = x - x.floor();
    if f < 1.0 { f } else { 0.0 }
}

/// (u, v) at `place`, met by `ray`, and the bound on their error.
pub(crate) fn coordinates(
    scene: &Scene,
    local: &Local,
    mappings: &[Mapping],
    decision: Decision,
    interaction: &SurfaceInteraction,
    ray: &Ray,
) -> (DVec2, f64) {
    match kind(scene, decision.id) {
        Kind::Sphere(_) => {
            let map = find(mappings, decision.id);
            let m = if decision.inside { -interaction.n } else { interaction.n };
            let (uv, sine) = on_sphere(map, m.to_dvec3());
            // Near a pole, u turns by en over the sine.
            (uv, (interaction.en + 8.0 * U) * (0.5 + 0.5 / sine.max(1e-300)))
        }
        Kind::Plane(_) => {
            let map = find(mappings, decision.id);
            let at = interaction.p.to_dvec3() - map.local_origin;
            let world = |x: f64| crate::shapes::local::ldexp(x, local.power);
            let e = world(interaction.ep + 8.0 * U * (interaction.p.norm1() + map.local_origin.abs().element_sum()));
            (DVec2::new(fraction(world(at.dot(map.axes[0]))), fraction(world(at.dot(map.axes[1])))), e)
        }
        Kind::Triangle(i) => {
            let f = triangle::forms(ray, &local.triangle(&scene.triangles()[i]));
            let sum = f.w[0] + f.w[1] + f.w[2];
            let (b1, b2) = (f.w[0] / sum, f.w[1] / sum);
            (DVec2::new(b1.clamp(0.0, 1.0), b2.clamp(0.0, 1.0)), 6.0 * f.e / sum.abs())
        }
    }
}

/// u and v must be known to this, as a power of two: far below a texel of the largest picture.
const FINE: i64 = -45;

/// (u, v) at `hit`, from wide arithmetic.
pub(crate) fn exact_coordinates<const N: usize>(
    scene: &Scene,
    mappings: &[Mapping],
    hit: &ExactHit<N>,
) -> Result<DVec2, Unsure> {
    // What the axes and operations are rounded by.
    let rounding = Bound::power(20 - 64 * N.min(LAST) as i64);
    let check = |error: Bound| if error.exponent() <= FINE { Ok(()) } else { Err(Unsure) };
    let misplaced = hit.misplaced();
    // Numbers that are taken as they are know nothing of errors.
    let taken = misplaced == Bound::ZERO;
    match kind(scene, hit.decision.id) {
        Kind::Sphere(_) => {
            let (n, bend) = hit.raw_normal();
            let m = n.normalize();
            let [x, y, z] = find(mappings, hit.decision.id).exact.each_ref().map(|axis| m.dot(&axis.resize()));
            let sine = (x * x + y * y).sqrt();
            if !taken {
                check((bend + rounding).over(&sine))?;
            }
            Ok(globe(x.to_f64(), y.to_f64(), z.to_f64(), sine.to_f64()))
        }
        Kind::Plane(_) => {
            let map = find(mappings, hit.decision.id);
            let at = hit.p - map.origin.resize();
            if !taken {
                let reach = size(&hit.p) + size(&map.origin);
                check(misplaced + reach * rounding)?;
            }
            let part = |axis: &Vector<LAST>| fraction(at.dot(&axis.resize()).fraction().to_f64());
            Ok(DVec2::new(part(&map.exact[0]), part(&map.exact[1])))
        }
        Kind::Triangle(i) => {
            let t = &scene.triangles()[i];
            let [a, b, c] = t.written.map(Vector::<N>::new);
            let (e1, e2) = if t.by_sides() { (b, c) } else { (b - a, c - a) };
            let (n, at) = (e1.cross(&e2), hit.p - a);
            let nn = n.dot(&n);
            let b1 = at.cross(&e2).dot(&n).over(nn).to_f64();
            let b2 = e1.cross(&at).dot(&n).over(nn).to_f64();
            if !taken {
                let sides = size(&e1) + size(&e2);
                // The normal is rounded by its sides, and turned by that over its length.
                let bend = (sides * sides * rounding).over(&n.0[largest(&n)]);
                let moved = misplaced + (size(&hit.p) + size(&a)) * rounding + size(&at) * bend;
                check((moved * sides * size(&n)).scale(4).over(&nn))?;
            }
            Ok(DVec2::new(b1.clamp(0.0, 1.0), b2.clamp(0.0, 1.0)))
        }
    }
}

/// A picture decoded to linear components under some transfer.
#[derive(Clone, Debug)]
pub(crate) struct Texels {
    /// Linear value of each stored sample value.
    linear: Vec<f64>,
}

impl Texels {
    pub(crate) fn new(picture: &Texture, to_linear: impl Fn(f64) -> f64) -> Self {
        let max = f64::from(picture.maxval());
        Self { linear: (0..=picture.maxval()).map(|s| to_linear(f64::from(s) / max)).collect() }
    }

    /// The bilinear value at (u, v); `wrap` says whether u and v repeat or are clamped.
    pub(crate) fn sample(&self, picture: &Texture, uv: DVec2, wrap: [bool; 2]) -> DVec3 {
        let (w, h) = (i64::from(picture.width()), i64::from(picture.height()));
        let x = uv.x * picture.width() as f64 - 0.5;
        let y = (1.0 - uv.y) * picture.height() as f64 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        // (u, v) is in [0, 1], so that no texel is farther outside than one.
        let interaction = |i: i64, n: i64, wrap: bool| match wrap {
            true if i < 0 => i + n,
            true if i >= n => i - n,
            true => i,
            false => i.clamp(0, n - 1),
        };
        let columns = [0, 1].map(|dx| interaction(x0 as i64 + dx, w, wrap[0]));
        let rows = [0, 1].map(|dy| interaction(y0 as i64 + dy, h, wrap[1]) * w);
        let texel = |i: usize, j: usize| {
            let [r, g, b] = picture.texel((rows[j] + columns[i]) as usize).map(|c| self.linear[usize::from(c)]);
            DVec3::new(r, g, b)
        };
        let top = texel(0, 0) * (1.0 - fx) + texel(1, 0) * fx;
        let bottom = texel(0, 1) * (1.0 - fx) + texel(1, 1) * fx;
        top * (1.0 - fy) + bottom * fy
    }
}
