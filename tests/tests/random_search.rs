//! Random search beyond the table: rays aimed at the boundaries of one object, each judged
//! in exact arithmetic, and at objects almost equally far, judged in 512 bits.
//!
//! `TESSERA_RAYS` sets the number of rays a primitive (default 1,000,000).

use glam::{DVec3, dvec3};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};
use tessera_tests::generate::{Document, Item, Look, Random};
use tessera_tests::oracle::Oracle;
use tessera_tests::subject::Subject;

/// Rays shot at each object.
const RAYS_A_CASE: u32 = 64;

fn cases() -> u32 {
    let rays = std::env::var("TESSERA_RAYS").ok().and_then(|s| s.parse().ok()).unwrap_or(1_000_000);
    (rays / RAYS_A_CASE).max(1)
}

/// What a case is made from: small numbers that shrink, and a seed that does not.
#[derive(Clone, Copy, Debug)]
struct Recipe {
    /// Which boundary.
    kind: u32,
    /// Everything is scaled by 2^scale.
    scale: i32,
    /// Distances over sizes, a power of two.
    ratio: u32,
    /// How many units in the last place to stray from the boundary, at most.
    stray: u32,
    seed: u64,
}

fn recipe(kinds: u32) -> impl Strategy<Value = Recipe> {
    let scale = prop_oneof![4 => Just(0), 2 => -40..40, 1 => -900..900, 1 => -1010..-950];
    let ratio = prop_oneof![2 => Just(0u32), 2 => 0..12u32, 1 => 0..60u32];
    (0..kinds, scale, ratio, prop_oneof![Just(0u32), Just(1), 0..20u32, 0..100_000u32], any::<u64>())
        .prop_map(|(kind, scale, ratio, stray, seed)| Recipe { kind, scale, ratio, stray, seed })
}

/// Runs `check` over recipes of a fixed seed, the same in every run.
fn search(kinds: u32, cases: u32, check: impl Fn(Recipe) -> Result<(), String>) {
    let config = Config { cases, failure_persistence: None, max_shrink_iters: 2000, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]));
    let result = runner.run(&recipe(kinds), |r| check(r).map_err(TestCaseError::fail));
    if let Err(e) = result {
        panic!("{e}");
    }
}

fn power(k: i32) -> f64 {
    // In two steps, since 2^-1010 times a mantissa may be subnormal and must round once.
    libm::scalbn(1.0, k)
}

fn nudge(random: &mut Random, v: DVec3, stray: u32) -> DVec3 {
    DVec3::from_array(v.to_array().map(|x| {
        let steps = random.below(2 * u64::from(stray) + 1) as i64 - i64::from(stray);
        let moved = f64::from_bits(x.to_bits().wrapping_add_signed(steps));
        if moved.is_finite() { moved } else { x }
    }))
}

fn stretched(random: &mut Random, d: DVec3) -> DVec3 {
    match random.below(4) {
        0 => d * power(random.below(200) as i32 - 100),
        1 => d * 3.0,
        _ => d,
    }
}

fn world() -> Document {
    Document::new(DVec3::ZERO, DVec3::Z)
}

#[test]
fn spheres() {
    search(6, cases(), |r| {
        let random = &mut Random::new(r.seed);
        let unit = power(r.scale);
        let far = power(r.ratio as i32);
        let (center, radius) = (random.cube() * [0.0, 1.0, far][random.below(3) as usize], random.between(0.1, 1.0));
        let subject = Subject::new(&world().sphere(center * unit, radius * unit, Look::default_matte()));
        for _ in 0..RAYS_A_CASE {
            let n = random.direction();
            let side = n.cross(random.direction()).normalize();
            let (o, d) = match r.kind {
                // Anywhere.
                0 => (center + random.cube() * 2.0 * far, random.cube()),
                // Towards the centre, from far.
                1 => (center + n * far * 2.0, -n + side * random.unit() * 1.2 * radius / far),
                // Tangent.
                2 => (center + n * radius - side * far * random.between(0.5, 2.0), side),
                // From the surface, and tangent to it there.
                3 => (center + n * radius, random.cube()),
                4 => (center + n * radius, side),
                // From a hair off the surface inward and outward.
                _ => (center + n * radius * (1.0 + random.between(-1.0, 1.0) * 1e-13), n * random.between(-1.0, 1.0)),
            };
            let d = nudge(random, d, r.stray);
            let d = stretched(random, d);
            subject.judge(nudge(random, o, r.stray) * unit, d)?;
        }
        Ok(())
    });
}

#[test]
fn triangles() {
    search(7, cases(), |r| {
        let random = &mut Random::new(r.seed);
        let unit = power(r.scale);
        let far = power(r.ratio as i32);
        let a = random.cube() * [1.0, far][random.below(2) as usize];
        let (u, v) = match random.below(3) {
            0 => (random.cube(), random.cube()),
            // Axis-aligned, so that boxes are flat.
            1 => (DVec3::X * random.between(0.1, 1.0), DVec3::Y * random.between(0.1, 1.0)),
            // A sliver.
            _ => {
                let u = random.cube();
                (u, u * random.unit() + random.cube() / power(random.below(50) as i32))
            }
        };
        let corners = [a * unit, (a + u) * unit, (a + v) * unit];
        let document = if random.one_in(2) {
            world().triangle(corners, Look::default_matte())
        } else {
            world().with(Item::TriangleSides([a * unit, u * unit, v * unit], Look::default_matte()))
        };
        let subject = Subject::new(&document);
        for _ in 0..RAYS_A_CASE {
            let (s, t) = (random.unit(), random.unit());
            let n = u.cross(v).normalize();
            let from = a + random.cube() * 2.0 * far;
            let (o, target) = match r.kind {
                0 => (from, a + u * s + v * t),
                // Edges and corners.
                1 => (from, a + u * s),
                2 => (from, a + u * s + v * (1.0 - s)),
                3 => (from, [a, a + u, a + v][random.below(3) as usize]),
                // Nearly in the plane.
                4 => (a + u * 3.0 * far + v * 2.0 * (t - 0.5) + n * 1e-9 * (s - 0.5), a + (u + v) * s * 0.5),
                // From the plane itself.
                5 => (a + u * s + v * t, a + random.cube()),
                // Along an edge.
                _ => (a + u * 3.0 * far, a + u * s),
            };
            let o = nudge(random, o, r.stray) * unit;
            let d = nudge(random, target * unit - o, r.stray);
            let d = stretched(random, d);
            // What overflows is no ray.
            if d != DVec3::ZERO && d.is_finite() {
                subject.judge(o, d)?;
            }
        }
        Ok(())
    });
}

#[test]
fn planes() {
    search(4, cases(), |r| {
        let random = &mut Random::new(r.seed);
        let unit = power(r.scale);
        let far = power(r.ratio as i32);
        let n = if random.one_in(3) {
            [DVec3::X, DVec3::Y, dvec3(3.0, 4.0, 0.0)][random.below(3) as usize]
        } else {
            random.cube()
        };
        let distance = random.between(-2.0, 2.0) * far;
        let foot = n.normalize() * distance;
        let document = if random.one_in(2) {
            world().plane(n * power(random.below(600) as i32 - 300), distance * unit, Look::default_matte())
        } else {
            world().plane_at(n, foot * unit, Look::default_matte())
        };
        let subject = Subject::new(&document);
        for _ in 0..RAYS_A_CASE {
            let flat = n.normalize().cross(random.cube());
            let (o, d) = match r.kind {
                0 => (random.cube() * 2.0 * far, random.cube()),
                // From the plane, or almost.
                1 => (foot + flat * far, random.cube()),
                // Grazing.
                2 => (foot + flat + n * random.between(-1.0, 1.0), flat + n / power(random.below(60) as i32)),
                _ => (foot + flat * far + n * 1e-12 * random.between(-1.0, 1.0), nudge(random, flat, 3)),
            };
            let d = nudge(random, d, r.stray.min(1000));
            if d != DVec3::ZERO {
                subject.judge(nudge(random, o, r.stray) * unit, stretched(random, d))?;
            }
        }
        Ok(())
    });
}

#[test]
fn nearly_equal_distances() {
    search(5, cases() / 20, |r| {
        let random = &mut Random::new(r.seed);
        let unit = power(r.scale.clamp(-200, 200));
        let close = |random: &mut Random, x: f64, stray: u32| {
            x * (1.0 + random.between(-1.0, 1.0) * f64::EPSILON * f64::from(stray))
        };
        let look = Look::default_matte();
        let p = random.cube() + DVec3::Z * 3.0;
        let n = random.direction();
        let mut d = world();
        for _ in 0..4 {
            d = match r.kind {
                // Spheres that touch at p, from either side.
                0 => {
                    let size = random.between(0.1, 2.0) * if random.one_in(2) { 1.0 } else { -1.0 };
                    d.sphere((p + n * size) * unit, close(random, size.abs(), r.stray.min(20)) * unit, look)
                }
                // Concentric ones.
                1 => d.sphere(p * unit, close(random, 0.5, r.stray.min(20)) * unit, look),
                // Planes through p.
                2 => d.plane_at(random.cube(), p * unit, look),
                // Almost coplanar triangles around p.
                3 => {
                    let flat = |random: &mut Random| p + n.cross(random.cube());
                    let corners =
                        [flat(random), flat(random), flat(random)].map(|c| nudge(random, c, r.stray.min(20)) * unit);
                    d.triangle(corners, look)
                }
                // Of every kind.
                _ => match random.below(3) {
                    0 => d.sphere((p + n) * unit, unit, look),
                    1 => d.plane(n, p.dot(n) * unit, look),
                    _ => {
                        d.triangle([p, p + n.cross(random.cube()), p + n.cross(random.cube())].map(|c| c * unit), look)
                    }
                },
            };
        }
        let (subject, scene) = (Subject::new(&d), d.scene().map_err(|e| e.to_string())?);
        let oracle = Oracle::new(&scene, 768);
        for k in 0..RAYS_A_CASE {
            let o = random.cube() * unit;
            let target = p + random.direction() * [0.0, 1e-15, 1e-8, 0.1][k as usize % 4];
            let target = nudge(random, target, 2) * unit;
            let (actual, expected) = (subject.hit(o, target - o), oracle.closest_hit(o, target - o));
            let expected = expected.map(|(order, t)| (order, t.to_f64()));
            let right = match (&actual, &expected) {
                (None, None) => true,
                (Some(a), Some((order, t))) => a.order == *order && (t.next_down()..=t.next_up()).contains(&a.t),
                _ => false,
            };
            if !right {
                return Err(format!("ray {o:?} + t {:?}: {actual:?}, not {expected:?}; {d:?}", target - o));
            }
            let to = o + (target - o) * [1.0, 0.5, 1.5, 2.0][random.below(4) as usize];
            if subject.occluded(o, to) != oracle.occluded(o, to) {
                return Err(format!("segment {o:?} to {to:?}; {d:?}"));
            }
        }
        Ok(())
    });
}
