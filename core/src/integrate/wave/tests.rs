//! What the exact test accepts, no filter rejects; what it rejects, none is sure of.

use std::sync::Arc;

use glam::DVec3;
use proptest::prelude::*;

use super::{Stage, WaveScratch};
use crate::exact::closest_hit;
use crate::integrate::Tracer;
use crate::numeric::V3;
use crate::scene::{PlanePosition, Scene, SceneBuilder, Surface};
use crate::settings::{Sampling, Settings, Transfer, View};
use crate::shapes::local::ldexp;
use crate::shapes::{INSIDE, NONE, ObjectId, Ray};
use crate::simd::{Kernel, LANES, Level, Simd, dispatch};
use crate::traverse::{Closest, PreparedScene, Scratch};

/// One object.
#[derive(Clone, Copy, Debug)]
enum Shape {
    Plane(DVec3, DVec3),
    Sphere(DVec3, f64),
    Triangle([DVec3; 3]),
}

fn scene(shape: Shape) -> Option<Scene> {
    let mut b = SceneBuilder::new();
    b.camera(DVec3::ZERO, DVec3::Y, DVec3::Z).ok()?;
    let s = b.surface(Surface::default()).ok()?;
    match shape {
        Shape::Plane(n, p) => b.plane(n, PlanePosition::Point(p), s).ok()?,
        Shape::Sphere(c, r) => b.sphere(c, r, None, s).ok()?,
        Shape::Triangle(corners) => b.triangle(corners, s).ok()?,
    }
    // Something large, so that the object may be small in local space.
    b.sphere(DVec3::splat(50.0), 1.0, None, s).ok()?;
    b.finish().ok()
}

/// What the packets of a level make of rays: what each meets first, and what is in doubt.
struct Walked<'a> {
    tracer: &'a Tracer,
    rays: &'a [(DVec3, DVec3)],
    /// An object that none of the rays is aimed at.
    other: u32,
}

/// For each ray, what f32 says: nothing where it leaves the ray to f64.
type Said = Vec<Option<(u32, Vec<u32>)>>;

impl Kernel for Walked<'_> {
    type Output = Said;
    #[inline(always)]
    fn run<S: Simd>(self) -> Said {
        let stage = Stage::new(self.tracer);
        if stage.packets.is_none() {
            return vec![None; self.rays.len()];
        }
        let mut scratch = WaveScratch::default();
        let WaveScratch { rays, packet, walk, .. } = &mut scratch;
        let n = self.rays.len();
        for (i, (o, d)) in self.rays.iter().enumerate() {
            for k in 0..3 {
                (rays.o[k][i], rays.d[k][i]) = (o[k], d[k]);
            }
            // Only rays from the eye start on nothing.
            let own = if *o == DVec3::ZERO { NONE } else { self.other };
            (rays.eo[i], rays.ed[i], rays.own[i]) = (0.0, 0.0, own);
        }
        let mut said = Said::new();
        for at in (0..n).step_by(LANES) {
            let [_, near] = stage.nearest::<S>(rays, at, n, packet, walk);
            for lane in 0..LANES.min(n - at) {
                let doubts = walk.doubts_of(lane).collect();
                said.push((near >> lane & 1 == 1).then_some((walk.best[lane], doubts)));
            }
        }
        said
    }
}

/// Numbers as they are hardest on rounding: ordinary, on a lattice, next to nothing, none.
fn number() -> BoxedStrategy<f64> {
    prop_oneof![
        4 => -1.0..1.0f64,
        3 => (-4i32..=4).prop_map(|x| f64::from(x) * 0.25),
        1 => (-1.0..1.0f64, -320i32..0).prop_map(|(x, e)| x * 10f64.powi(e)),
        1 => Just(0.0),
        1 => prop_oneof![Just(5e-324), Just(-1e-310), Just(1e-45), Just(1.0f64.next_up())],
    ]
    .boxed()
}

fn vector() -> impl Strategy<Value = DVec3> {
    (number(), number(), number()).prop_map(|(x, y, z)| DVec3::new(x, y, z))
}

fn shape() -> impl Strategy<Value = Shape> {
    let small = (number(), -30i32..1).prop_map(|(x, e)| x * 10f64.powi(e)).boxed();
    prop_oneof![
        (vector(), vector()).prop_map(|(n, p)| Shape::Plane(n, p)),
        (vector(), small.clone()).prop_map(|(c, r)| Shape::Sphere(c, r.abs())),
        [vector(), vector(), vector()].prop_map(Shape::Triangle),
        // Slivers: the third corner hardly off the line of the others, in either order.
        (vector(), vector(), vector(), small, -2.0..3.0f64, any::<bool>()).prop_map(|(a, b, off, by, t, turned)| {
            let c = a + (b - a) * t + off * by;
            Shape::Triangle(if turned { [c, b, a] } else { [a, b, c] })
        }),
        // Far larger than what is aimed at: planets below the eye, skies around it, needles beside it.
        (vector(), 3i32..13, number(), any::<bool>()).prop_map(|(up, e, high, sky)| {
            let r = 10f64.powi(e);
            let away = if sky { r - high } else { r + high };
            Shape::Sphere(up.normalize_or(DVec3::Y) * -away, r)
        }),
        (vector(), vector(), vector(), 2i32..16, -2.0..2.0f64, any::<bool>()).prop_map(
            |(a, along, off, e, t, turned)| {
                let long = along * 10f64.powi(e);
                let corners = [a - long, a + long * t.abs(), a + long * t + off];
                Shape::Triangle(if turned { [corners[2], corners[1], corners[0]] } else { corners })
            }
        ),
    ]
}

/// Rays at the object: at its points, its edges and beside them, from anywhere.
fn aimed(shape: Shape) -> impl Strategy<Value = (DVec3, DVec3)> {
    let at = move |(u, v): (f64, f64)| match shape {
        Shape::Plane(_, p) => p + DVec3::new(u, v, 0.0),
        Shape::Sphere(c, r) if r < 1e3 => c + DVec3::new(u, v, 1.0).normalize() * r,
        // On the sphere below the eye, to within its rounding.
        Shape::Sphere(c, r) => c + (DVec3::new(u, v, u * v) - c).normalize_or(DVec3::Y) * r,
        Shape::Triangle([a, b, c]) if (b - a).length() < 1e3 => a + (b - a) * u + (c - a) * v,
        // Beside the middle of a side.
        Shape::Triangle([a, b, c]) => {
            let along = (b - a).normalize_or(DVec3::X);
            let to = |p: DVec3| p - along * along.dot(p);
            let (on, other) = (to(a), to(c));
            on + (other - on) * v + along * u
        }
    };
    (vector(), (number(), number()), 0.25..3.0f64, any::<bool>()).prop_map(move |(o, uv, far, plain)| {
        let d = at(uv) - o;
        (o, if plain { d } else { d * far })
    })
}

fn holds(shape: Shape, rays: &[(DVec3, DVec3)]) -> Result<(), TestCaseError> {
    let Some(scene) = scene(shape) else { return Ok(()) };
    let prepared = Arc::new(PreparedScene::build(Arc::new(scene)));
    let view = View::new(1, 1, 1.0, 1.0).map_err(|e| TestCaseError::fail(e.to_string()))?;
    let settings = Settings { view, max_depth: 1, sampling: Sampling::Uniform { grid: 1 }, transfer: Transfer::Linear };
    let tracer = Tracer::new(Arc::clone(&prepared), settings).map_err(|e| TestCaseError::fail(e.to_string()))?;
    // The other object is not aimed at.
    let id = ObjectId(u32::from(matches!(shape, Shape::Triangle(_))));
    let power = prepared.local.power;
    let rays: Vec<_> = rays.iter().copied().filter(|(_, d)| *d != DVec3::ZERO).collect();
    let local = |v: DVec3| DVec3::from_array(v.to_array().map(|x| ldexp(x, -power)));
    // What is lost by scaling is not for this test.
    let kept = |v: DVec3| v.to_array().into_iter().all(|x| ldexp(ldexp(x, -power), power) == x);
    let rays: Vec<_> = rays.into_iter().filter(|(o, d)| kept(*o) && kept(*d)).collect();
    let scaled: Vec<_> = rays.iter().map(|&(o, d)| (local(o), local(d))).collect();
    let exact: Vec<_> = rays.iter().map(|&(o, d)| closest_hit(&prepared.scene, o, d, &[id])).collect();
    for level in Level::all() {
        let said = dispatch(level, Walked { tracer: &tracer, rays: &scaled, other: 1 - id.0 });
        for ((ray, said), exact) in rays.iter().zip(said).zip(&exact) {
            let (Some((best, doubts)), Some(exact)) = (said, exact) else { continue };
            let (met, named) = (best & !INSIDE == id.0, doubts.contains(&id.0));
            if exact.is_some() {
                prop_assert!(met || named || best != NONE, "{level:?} misses {ray:?}");
            } else {
                prop_assert!(!met || named, "{level:?} is sure of what is not met by {ray:?}");
            }
        }
    }
    let mut scratch = Scratch::default();
    for ((ray, &(o, d)), exact) in rays.iter().zip(&scaled).zip(&exact) {
        let Some(exact) = exact else { continue };
        let ray64 = Ray::new(V3::splat(o), V3::splat(d), 1e-300, 0.0);
        match prepared.closest_among(&ray64, None, std::iter::once(id), &mut scratch) {
            Closest::Nothing => prop_assert!(exact.is_none(), "f64 misses {ray:?}"),
            Closest::Sure(_) => prop_assert!(exact.is_some(), "f64 is sure of what is not met by {ray:?}"),
            Closest::Doubt => {}
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn filters_reject_nothing_that_is_met(
        (shape, rays) in shape().prop_flat_map(|s| (Just(s), prop::collection::vec(aimed(s), 16)))
    ) {
        holds(shape, &rays)?;
    }
}
