//! The extremes suite: single rays at spheres, by exact arithmetic.

use std::f64::consts::TAU;

use glam::{DVec3, dvec3};
use tessera_tests::generate::{Document, Look, Random};
use tessera_tests::oracle::Oracle;
use tessera_tests::subject::Subject;

fn sphere(center: DVec3, radius: f64) -> Subject {
    Subject::new(&Document::new(DVec3::ZERO, DVec3::Z).sphere(center, radius, Look::default_matte()))
}

#[test]
fn case_09_exact_tangent() {
    let ball = sphere(dvec3(0.0, 0.0, 5.0), 3.0);
    assert_eq!(ball.hit(dvec3(0.0, 3.0, 0.0), DVec3::Z).map(|h| h.t), Some(5.0));
    assert_eq!(ball.hit(dvec3(-3.0, 0.0, -7.0), DVec3::Z * 4.0).map(|h| h.t), Some(3.0));
    // 3-4-5: the ray along (4, 3) past a centre at (0, 5) comes as near as 4.
    let slanted = sphere(dvec3(0.0, 5.0, 0.0), 4.0);
    assert_eq!(slanted.hit(DVec3::ZERO, dvec3(4.0, 3.0, 0.0)).map(|h| h.t), Some(0.6));
    assert_eq!(slanted.hit(DVec3::ZERO, dvec3(0.0, 3.0, -4.0)).map(|h| h.t), Some(0.6));
    slanted.assert_exact(DVec3::ZERO, dvec3(4.0, 3.0, 0.0) * 1e-200);
    slanted.assert_exact(DVec3::ZERO, dvec3(4.0, 3.0, 0.0) * 1e200);
}

#[test]
fn case_10_impact_an_ulp_from_tangent() {
    for scale in [1.0, 3.0, 1e-6, 1e6, 1e150, 1e-150] {
        let ball = sphere(dvec3(0.0, 0.0, 5.0 * scale), scale);
        for (factor, hit) in [(1.0 - 2f64.powi(-53), true), (1.0, true), (1.0 + 2f64.powi(-52), false)] {
            let origin = dvec3(0.0, scale * factor, 0.0);
            ball.assert_exact(origin, DVec3::Z);
            if scale == 1.0 {
                assert_eq!(ball.hit(origin, DVec3::Z).is_some(), hit);
            }
        }
    }
}

#[test]
fn case_11_near_tangent_from_far() {
    let mut random = Random::new(11);
    for exponent in 0..=9 {
        let d = if exponent == 0 { 2.0 } else { 10f64.powi(exponent) };
        for k in 0..200 {
            let ball = sphere(DVec3::ZERO, 1.0);
            let impact = [1.0 - 1e-12, 1.0 + 1e-12, 1.0 - 1e-15, 1.0 - 1e-9][k % 4];
            let a = random.between(0.0, TAU);
            let (u, v) = (dvec3(a.cos(), a.sin(), 0.0), random.direction());
            // A line at distance `impact` from the centre, rounded as it comes.
            let along = u.cross(v).normalize();
            let foot = u.cross(along).cross(along).normalize() * impact;
            let origin = foot - along * d;
            ball.assert_exact(origin, along * random.between(0.1, 10.0));
            ball.assert_exact(origin, foot - origin);
        }
    }
}

#[test]
fn case_12_camera_at_the_centre() {
    let mut random = Random::new(12);
    for radius in [1.0, 0.3, 1e-200, 1e200] {
        let center = dvec3(0.25, -3.0, 7.5) * radius;
        let ball = sphere(center, radius);
        for axis in [DVec3::X, -DVec3::Y, DVec3::Z] {
            assert_eq!(ball.hit(center, axis).map(|h| h.t), Some(radius));
            assert_eq!(ball.hit(center, axis * 4.0).map(|h| h.t), Some(radius / 4.0));
        }
        for _ in 0..500 {
            ball.assert_exact(center, random.cube());
        }
    }
}

#[test]
fn case_13_camera_on_the_sphere() {
    let ball = sphere(DVec3::ZERO, 5.0);
    let p = dvec3(3.0, 4.0, 0.0);
    assert_eq!(ball.hit(p, dvec3(1.0, 1.0, 0.3)), None, "outward");
    assert_eq!(ball.hit(p, dvec3(-4.0, 3.0, 0.0)), None, "tangent");
    assert_eq!(ball.hit(p, DVec3::Z), None, "tangent");
    // Inward: t = 2r·|n·d| for a unit d.
    assert_eq!(ball.hit(p, dvec3(-0.6, -0.8, 0.0)).map(|h| (h.t * 1e9).round() / 1e9), Some(10.0));
    assert_eq!(ball.hit(p, -DVec3::X).map(|h| h.t), Some(6.0));
    assert_eq!(ball.hit(p, -DVec3::Y).map(|h| h.t), Some(8.0));
    assert_eq!(ball.hit(dvec3(5.0, 0.0, 0.0), -DVec3::X).map(|h| h.t), Some(10.0));
    let mut random = Random::new(13);
    for _ in 0..2000 {
        let d = random.cube();
        ball.assert_exact(p, d);
        ball.assert_exact(p, dvec3(d.x, -0.75 * d.x, d.z));
    }
}

#[test]
fn case_14_camera_an_ulp_from_the_sphere() {
    let mut random = Random::new(14);
    let ball = sphere(DVec3::ZERO, 5.0);
    for _ in 0..2000 {
        let mut p = dvec3(3.0, 4.0, 0.0);
        if random.one_in(2) {
            p = random.direction() * 5.0;
        }
        for step in [f64::next_up, f64::next_down] {
            let mut q = p;
            match random.below(3) {
                0 => q.x = step(q.x),
                1 => q.y = step(q.y),
                _ => q = p.map(step),
            }
            ball.assert_exact(q, random.cube());
            ball.assert_exact(q, q.cross(random.cube()));
            ball.assert_exact(q, -q);
            ball.assert_exact(q, q);
        }
    }
}

#[test]
fn case_15_concentric_spheres_an_ulp_apart() {
    let document = |first: f64, second: f64| {
        Document::new(DVec3::ZERO, DVec3::Z).sphere(dvec3(1.0, 2.0, 3.0), first, Look::matte(1.0, 0.0, 0.0)).sphere(
            dvec3(1.0, 2.0, 3.0),
            second,
            Look::matte(0.0, 1.0, 0.0),
        )
    };
    let (outer, inner) = (0.7, 0.7 * (1.0 - 2f64.powi(-52)));
    let mut random = Random::new(15);
    for (first, second) in [(outer, inner), (inner, outer), (outer, outer)] {
        let d = document(first, second);
        let (subject, scene) = (Subject::new(&d), d.scene().unwrap());
        let oracle = Oracle::new(&scene, 512);
        for _ in 0..500 {
            let c = dvec3(1.0, 2.0, 3.0);
            let from = c + random.direction() * 4.0;
            let target = c + random.cube() * 0.3;
            subject.assert_as_oracle(&oracle, from, target - from);
            subject.assert_as_oracle(&oracle, target, random.direction());
            let expected = if first >= second { 0 } else { 1 };
            assert_eq!(subject.hit(from, target - from).map(|h| h.order), Some(expected), "from outside");
            let expected = if first <= second { 0 } else { 1 };
            assert_eq!(subject.hit(target, random.cube()).map(|h| h.order), Some(expected), "from inside");
        }
    }
}

#[test]
fn case_67_axis_aligned_rays_on_faces_of_boxes() {
    // The box of a sphere touches it at six points; rays along its faces graze it there.
    let ball = sphere(dvec3(1.0, 2.0, 3.0), 0.5);
    for (origin, direction) in [
        (dvec3(1.5, 2.0, 0.0), DVec3::Z),
        (dvec3(0.5, 2.0, 0.0), DVec3::Z),
        (dvec3(1.0, 2.5, 0.0), DVec3::Z),
        (dvec3(1.0, 1.5, 9.0), -DVec3::Z),
        (dvec3(0.0, 2.0, 3.5), DVec3::X),
        (dvec3(0.0, 2.5, 3.0), DVec3::X),
        (dvec3(1.0, 0.0, 2.5), DVec3::Y),
        (dvec3(1.5, 2.0, 0.0), dvec3(-0.0, -0.0, 1.0)),
    ] {
        assert!(ball.hit(origin, direction).is_some(), "{origin} {direction}");
        ball.assert_exact(origin, direction);
    }
    // A flat box: an axis-aligned square of two triangles among enough others for a hierarchy.
    let mut d = Document::new(DVec3::ZERO, DVec3::Z);
    for i in 0..8 {
        for j in 0..8 {
            let (x, y) = (f64::from(i), f64::from(j));
            let [a, b, c, e] = [(x, y), (x + 1.0, y), (x + 1.0, y + 1.0), (x, y + 1.0)].map(|(x, y)| dvec3(x, y, 2.0));
            d = d.triangle([a, b, c], Look::matte(1.0, 1.0, 1.0)).triangle([a, c, e], Look::matte(1.0, 1.0, 1.0));
        }
    }
    let (subject, scene) = (Subject::new(&d), d.scene().unwrap());
    let oracle = Oracle::new(&scene, 512);
    for i in 0..=16 {
        for j in 0..=16 {
            let (x, y) = (f64::from(i) / 2.0, f64::from(j) / 2.0);
            subject.assert_as_oracle(&oracle, dvec3(x, y, 0.0), DVec3::Z);
            subject.assert_as_oracle(&oracle, dvec3(x, y, 2.0), DVec3::Z);
            subject.assert_as_oracle(&oracle, dvec3(x, y, 3.0), dvec3(-0.0, 0.0, -2.0));
            subject.assert_as_oracle(&oracle, dvec3(x, y, 0.0), DVec3::X);
            subject.assert_as_oracle(&oracle, dvec3(x, -1.0, 2.0), DVec3::Y);
        }
    }
}
