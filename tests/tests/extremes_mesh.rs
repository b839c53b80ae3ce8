//! The extremes suite: triangles.

use std::f64::consts::TAU;

use glam::{DVec3, dvec3};
use tessera_tests::generate::extreme::basic;
use tessera_tests::generate::{Document, Item, Look, Random};
use tessera_tests::oracle::Oracle;
use tessera_tests::subject::{Subject, assert_right, small};

const WHITE: Look = Look::default_matte();

fn world() -> Document {
    Document::new(DVec3::ZERO, DVec3::Z)
}

fn triangle(corners: [DVec3; 3]) -> Subject {
    Subject::new(&world().triangle(corners, WHITE))
}

/// Rays from `origin` at random points of the triangle and about its edges.
fn shoot(subject: &Subject, corners: [DVec3; 3], origin: DVec3, random: &mut Random, count: usize) {
    let [a, b, c] = corners;
    for k in 0..count {
        let (mut u, mut v) = (random.unit(), random.unit());
        match k % 4 {
            0 => u = 0.0,
            1 => v = 1.0 - u,
            2 => v = 0.0,
            _ => {}
        }
        let target = a + (b - a) * u + (c - a) * v;
        subject.assert_exact(origin, target - origin);
    }
    for corner in corners {
        subject.assert_exact(origin, corner - origin);
    }
}

#[test]
fn case_17_zero_area_triangle() {
    let (p, q) = (dvec3(0.1, 0.2, 3.0), dvec3(0.7, -0.3, 2.5));
    // The last two are collinear in real arithmetic too.
    for corners in
        [[p, p, p], [p, p, q], [p, q, q], [p, q, p], [p, p * 0.5, p * 0.25], [-DVec3::X, DVec3::X, DVec3::X * 3.0]]
    {
        let subject = triangle(corners);
        for target in corners {
            assert!(subject.hit(DVec3::ZERO, target).is_none());
            subject.assert_exact(DVec3::ZERO, target);
            subject.assert_exact(dvec3(1.0, 1.0, -1.0), target - dvec3(1.0, 1.0, -1.0));
        }
    }
    let flat = basic()
        .triangle([dvec3(0.0, 1.0, -2.0), dvec3(1.0, 1.0, -2.0), dvec3(3.0, 1.0, -2.0)], Look::mirror(1.0))
        .triangle([dvec3(0.0, 1.0, -2.0); 3], Look::mirror(1.0))
        .with(Item::TriangleSides([dvec3(0.0, 1.0, -2.0), DVec3::ZERO, DVec3::Y], Look::mirror(1.0)));
    assert!(small(&flat) == small(&basic()), "what has no area is not seen");
}

#[test]
fn case_18_slivers() {
    let mut random = Random::new(18);
    for exponent in 6..=15 {
        for _ in 0..20 {
            let (a, along) = (random.cube() + DVec3::Z * 3.0, random.direction());
            let thin = along.cross(random.direction()).normalize() * 10f64.powi(-exponent);
            let corners = [a, a + along, a + along * random.unit() + thin];
            shoot(&triangle(corners), corners, random.cube() * 0.5, &mut random, 40);
        }
    }
}

#[test]
fn case_20_vertex_of_valence_1000() {
    let apex = dvec3(0.0, 0.0, 4.0);
    let rim = |k: usize| {
        let a = TAU * k as f64 / 1000.0;
        dvec3(libm::cos(a), libm::sin(a), 6.0)
    };
    let mut d = world();
    for k in 0..1000 {
        // Documents in a scrambled order: the lowest index is anywhere around the vertex.
        let k = k * 383 % 1000;
        d = d.triangle([rim(k), apex, rim(k + 1)], WHITE);
    }
    let (subject, scene) = (Subject::new(&d), d.scene().unwrap());
    let oracle = Oracle::new(&scene, 512);
    assert_eq!(subject.hit(DVec3::ZERO, DVec3::Z).map(|h| (h.order, h.t)), Some((0, 4.0)), "the vertex itself");
    let mut random = Random::new(20);
    for _ in 0..100 {
        let from = dvec3(random.between(-0.25, 0.25), random.between(-0.25, 0.25), 0.0);
        subject.assert_as_oracle(&oracle, from, apex - from);
    }
    for k in 0..40 {
        let from = dvec3(0.125, -0.0625, 0.5);
        let target = apex + (rim(25 * k) - apex) * random.unit();
        subject.assert_as_oracle(&oracle, from, target - from);
        subject.assert_as_oracle(&oracle, DVec3::ZERO, dvec3(1e-16, 1e-17 * f64::from(k as u32), 4.0));
    }
}

#[test]
fn case_21_t_junction() {
    // The long edge runs from a to b; on its other side two triangles meet at m, the rounded middle.
    let mut random = Random::new(21);
    let mut leaks = 0;
    for _ in 0..60 {
        let (a, b) = (random.cube() + DVec3::Z * 4.0, random.cube() + DVec3::Z * 4.0);
        let m = a + (b - a) * random.unit();
        let side = (b - a).cross(DVec3::Z).normalize();
        let d = world()
            .triangle([a, b, m + side], WHITE)
            .triangle([a, m, m - side], WHITE)
            .triangle([m, b, m - side], WHITE);
        let (subject, scene) = (Subject::new(&d), d.scene().unwrap());
        let oracle = Oracle::new(&scene, 512);
        for _ in 0..60 {
            let target = if random.one_in(2) { a + (m - a) * random.unit() } else { m + (b - m) * random.unit() };
            let from = random.cube() * 0.25;
            leaks += u32::from(subject.hit(from, target - from).is_none());
            subject.assert_as_oracle(&oracle, from, target - from);
        }
    }
    println!("{leaks} of 3600 rays go through the cracks, as they should");
    assert!(leaks > 0, "rounded middles leave cracks");
}

#[test]
fn case_22_edge_on() {
    let corners = [dvec3(0.0, -1.0, 2.0), dvec3(0.0, 1.0, 2.0), dvec3(0.0, 0.5, 5.0)];
    let subject = triangle(corners);
    for target in [dvec3(0.0, 0.0, 3.0), corners[0], corners[1], corners[2], dvec3(0.0, 0.25, 2.0)] {
        assert!(subject.hit(DVec3::ZERO, target).is_none(), "{target}");
        assert!(!subject.occluded(DVec3::ZERO, target * 4.0));
    }
    // A plane through the origin that no rounding spares: rays at the corners lie in it exactly.
    let (p, q) = (dvec3(0.1, 0.7, 1.3), dvec3(-0.4, 0.3, 2.1));
    let oblique = triangle([p, q, p * 2.0]);
    for target in [p, q, p + q] {
        oblique.assert_exact(DVec3::ZERO, target);
    }
    assert!(oblique.hit(DVec3::ZERO, p).is_none() && oblique.hit(DVec3::ZERO, q).is_none());
}

#[test]
fn case_23_grazing() {
    let mut random = Random::new(23);
    for exponent in 3..=12 {
        let tilt = 10f64.powi(-exponent);
        for _ in 0..50 {
            let corners = [dvec3(-1.0, 0.0, 1.0), dvec3(1.0, 0.0, 1.0), dvec3(random.between(-1.0, 1.0), tilt, 2.0)];
            let subject = triangle(corners);
            shoot(
                &subject,
                corners,
                dvec3(random.between(-0.5, 0.5), random.between(-tilt, tilt), -1.0),
                &mut random,
                20,
            );
            shoot(&subject, corners, dvec3(0.0, -2.0 * tilt, 0.0), &mut random, 20);
        }
    }
}

#[test]
fn case_24_coplanar_duplicates() {
    let corners = [dvec3(-1.0, -1.0, 2.0), dvec3(1.0, -1.0, 2.0), dvec3(0.0, 1.0, 2.0)];
    let oblique = [dvec3(-1.1, -0.9, 2.3), dvec3(0.7, -1.2, 1.9), dvec3(0.2, 1.3, 2.7)];
    let mut random = Random::new(24);
    for filler in [0, 1, 5, 40, 300] {
        for corners in [corners, oblique] {
            let [a, b, c] = corners;
            let mut d = world();
            for _ in 0..filler {
                let at = random.cube() * 3.0 - DVec3::Z * 4.0;
                d = d.triangle([at, at + random.cube(), at + random.cube()], WHITE);
            }
            // The same triangle under every name it has.
            for twin in [[a, b, c], [b, c, a], [c, b, a], [a, b, c]] {
                d = d.triangle(twin, WHITE);
            }
            let subject = Subject::new(&d);
            for _ in 0..200 {
                let (u, v) = (random.between(0.0, 0.5), random.between(0.0, 0.5));
                let from = dvec3(random.between(-0.5, 0.5), random.between(-0.5, 0.5), 0.0);
                let target = a + (b - a) * u + (c - a) * v;
                assert_eq!(subject.hit(from, target - from).map(|h| h.order), Some(filler), "{from} {target}");
            }
        }
    }
}

#[test]
fn case_25_huge_and_tiny_vertices_mixed() {
    let mut random = Random::new(25);
    for _ in 0..200 {
        let pick = |random: &mut Random| random.cube() * [1e30, 1e-30, 1.0][random.below(3) as usize];
        let corners = [pick(&mut random), pick(&mut random), pick(&mut random)];
        let subject = triangle(corners);
        let origin = pick(&mut random);
        shoot(&subject, corners, origin, &mut random, 20);
        for scale in [1e-30, 1.0, 1e30] {
            subject.assert_exact(origin, random.cube() * scale);
        }
    }
}

#[test]
fn case_26_tiny_edges() {
    let mut random = Random::new(26);
    for size in [1e-13, 1e-160, 1e-300] {
        for _ in 0..50 {
            let corners = [random.cube() * size, random.cube() * size, random.cube() * size];
            let subject = triangle(corners);
            shoot(&subject, corners, random.cube() * size * 3.0, &mut random, 20);
            shoot(&subject, corners, random.cube() * 3.0, &mut random, 20);
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            assert!(subject.hit(middle + random.direction() * size, -random.direction()).is_none_or(|h| h.t >= 0.0));
        }
        // And it is still there to be seen.
        let d = Document::new(dvec3(0.0, 0.0, -3.0 * size), DVec3::ZERO)
            .triangle([dvec3(-size, -size, 0.0), dvec3(size, -size, 0.0), dvec3(0.0, size, 0.0)], WHITE)
            .light(0.0, 0.0, -4.0 * size);
        let expected = assert_right(&format!("case_26_{size:e}"), &d);
        assert!(expected.pixels[24 * 64 + 32][0] > 0.5);
    }
}

#[test]
fn case_27_camera_in_a_triangle() {
    let corners = [dvec3(-1.0, -1.0, 0.0), dvec3(1.0, -1.0, 0.0), dvec3(0.0, 1.0, 0.0)];
    let subject = triangle(corners);
    let mut random = Random::new(27);
    for origin in
        [DVec3::ZERO, dvec3(0.25, -0.5, 0.0), corners[0], corners[2], dvec3(0.0, -1.0, 0.0), dvec3(5.0, 5.0, 0.0)]
    {
        for _ in 0..50 {
            assert!(subject.hit(origin, random.cube()).is_none(), "t = 0 does not count");
            let flat = random.cube() * dvec3(1.0, 1.0, 0.0);
            assert!(subject.hit(origin, flat).is_none(), "nor does the plane's own direction");
        }
    }
    let d = Document::new(DVec3::ZERO, dvec3(0.1, 0.2, 1.0))
        .with_background(0.3, 0.3, 0.3)
        .triangle(corners, WHITE)
        .sphere(dvec3(0.0, 0.0, 3.0), 1.0, Look::new(0.9, 0.2, 0.2, 0.6, 0.4))
        .light(2.0, 2.0, 1.0);
    assert_right("case_27", &d);
}
