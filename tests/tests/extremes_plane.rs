//! The extremes suite: planes.

use glam::{DVec3, dvec3};
use tessera_tests::generate::extreme::basic;
use tessera_tests::generate::{Document, Item, Look, Random};
use tessera_tests::oracle::Oracle;
use tessera_tests::subject::{Subject, assert_right, small};

const WHITE: Look = Look::default_matte();

fn world() -> Document {
    Document::new(DVec3::ZERO, DVec3::Z)
}

#[test]
fn case_28_length_of_the_normal() {
    let scaled = |k: i32| {
        let mut d = basic().plane(dvec3(0.5, 0.25, -2.0), -9.5, Look::new(0.3, 0.4, 0.5, 0.5, 0.5));
        for item in &mut d.items {
            if let Item::Plane(n, ..) = item {
                *n *= 2f64.powi(k);
            }
        }
        d
    };
    let unit = small(&scaled(0));
    for k in [-900, -450, -1, 1, 17, 450, 900] {
        assert!(small(&scaled(k)) == unit, "2^{k}");
    }
}

#[test]
fn case_30_distance_1e300() {
    let plane = Subject::new(&world().plane(dvec3(1.0, 2.0, 2.0), 1e300, WHITE));
    let hit = plane.hit(DVec3::ZERO, dvec3(1.0, 2.0, 2.0)).unwrap();
    assert_eq!(hit.t, 1e300 / 3.0);
    let mut random = Random::new(30);
    for _ in 0..500 {
        let d = random.cube();
        plane.assert_exact(random.cube(), d);
        plane.assert_exact(random.cube() * 1e300, d * 1e-8);
        plane.assert_exact(random.cube() * 1e300, d * 1e290);
    }
    let d = Document::new(dvec3(0.0, 1.0, 0.0), dvec3(0.0, 1.0, 5.0))
        .with_background(0.1, 0.2, 0.3)
        .plane(DVec3::Y, -1e300, Look::new(0.9, 0.8, 0.7, 0.5, 0.5))
        .light(0.0, 5.0, 0.0);
    let expected = assert_right("case_30", &d);
    assert!(expected.pixels.iter().flatten().all(|c| c.is_finite()));
}

#[test]
fn case_31_horizon() {
    let floor = Subject::new(&world().plane(DVec3::Y, 0.0, WHITE));
    let above = dvec3(0.0, 1e-20, 0.0);
    for flat in [0.0, -0.0] {
        assert!(floor.hit(above, dvec3(1.0, flat, 1.0)).is_none());
        assert!(floor.hit(dvec3(0.0, flat, 0.0), dvec3(1.0, flat, 1.0)).is_none());
        assert!(floor.hit(dvec3(0.0, flat, 0.0), dvec3(1.0, -1.0, 1.0)).is_none());
    }
    let tiny = f64::from_bits(1);
    assert!(floor.hit(above, dvec3(1.0, tiny, 1.0)).is_none());
    for (origin, y) in
        [(above, -tiny), (DVec3::Y, -tiny), (dvec3(0.0, tiny, 0.0), -tiny), (dvec3(0.0, tiny, 0.0), -1.0)]
    {
        assert!(floor.hit(origin, dvec3(1.0, y, 1.0)).is_some_and(|h| !h.t.is_nan()), "{origin} {y:e}");
        floor.assert_exact(origin, dvec3(1.0, y, 1.0));
    }
}

#[test]
fn case_32_camera_on_the_plane() {
    let d = Document::new(dvec3(0.3, 0.0, -0.7), dvec3(0.3, 0.2, 1.0))
        .with_background(0.1, 0.2, 0.3)
        .plane(DVec3::Y, 0.0, WHITE)
        .light(0.0, 5.0, 0.0);
    for p in small(&d) {
        assert_eq!(p, [0.1f32, 0.2, 0.3]);
    }
    // A plane by distance through a point that is on it in real arithmetic alone.
    let slanted = Subject::new(&world().plane(dvec3(3.0, 4.0, 0.0), 5.0, WHITE));
    assert!(slanted.hit(dvec3(3.0, 4.0, 7.0), dvec3(-1.0, -1.0, 0.0)).is_none());
    assert!(slanted.hit(dvec3(3f64.next_up(), 4.0, 7.0), dvec3(-1.0, -1.0, 0.0)).is_some());
    assert!(slanted.hit(dvec3(3f64.next_down(), 4.0, 7.0), dvec3(-1.0, -1.0, 0.0)).is_none());
}

#[test]
fn case_33_coincident_planes() {
    let mut random = Random::new(33);
    for _ in 0..30 {
        let n = random.cube();
        let p = random.cube();
        let point = |n: DVec3| Item::Plane(n, tessera_core::scene::PlanePosition::Point(p), WHITE);
        let d = world().with(point(n)).with(point(-n)).with(point(n * 2.0)).with(point(n * -0.25));
        let distance = random.between(-2.0, 2.0);
        let by_distance = world().plane(n, distance, WHITE).plane(-n, -distance, WHITE).plane(n * 2.0, distance, WHITE);
        for subject in [Subject::new(&d), Subject::new(&by_distance)] {
            for _ in 0..50 {
                let (o, v) = (random.cube() * 3.0, random.cube());
                assert!(subject.hit(o, v).is_none_or(|h| h.order == 0));
            }
        }
    }
}

#[test]
fn case_34_planes_an_ulp_apart() {
    let mut random = Random::new(34);
    for _ in 0..30 {
        let (n, distance) = (random.cube(), random.between(0.5, 2.0));
        let d =
            world().plane(n, distance, WHITE).plane(n, distance.next_up(), WHITE).plane(n, distance.next_down(), WHITE);
        let (subject, scene) = (Subject::new(&d), d.scene().unwrap());
        let oracle = Oracle::new(&scene, 512);
        for _ in 0..50 {
            let (o, v) = (random.cube() * 3.0, random.cube());
            subject.assert_as_oracle(&oracle, o, v);
        }
        let up = subject.hit(n.normalize() * 5.0, -n).unwrap();
        let down = subject.hit(DVec3::ZERO, n).unwrap();
        assert_eq!((up.order, down.order), (1, 2));
    }
}

#[test]
fn case_35_camera_and_plane_far_away() {
    let mut random = Random::new(35);
    let plane = Subject::new(&world().plane(dvec3(0.1, 1.0, 0.3), 1e12, WHITE));
    let foot = dvec3(0.1, 1.0, 0.3) * (1e12 / (1.0f64 + 0.01 + 0.09).sqrt());
    for _ in 0..2000 {
        let origin = foot + random.cube() * [1.0, 1e-3, 1e6][random.below(3) as usize];
        plane.assert_exact(origin, random.cube());
        plane.assert_exact(origin, foot + random.cube() - origin);
        // Grazing, down to 1e-12.
        let tilt = 10f64.powf(-random.between(3.0, 12.0));
        let flat = dvec3(0.1, 1.0, 0.3).cross(random.direction()).normalize();
        plane.assert_exact(origin, flat + dvec3(0.1, 1.0, 0.3) * tilt);
    }
    let d = Document::new(dvec3(0.0, 1e12 + 2.0, 0.0), dvec3(0.0, 1e12 + 1.0, 5.0))
        .with_background(0.1, 0.2, 0.3)
        .plane(DVec3::Y, 1e12, Look::new(0.9, 0.8, 0.7, 0.5, 0.5))
        .sphere(dvec3(0.0, 1e12 + 1.0, 6.0), 1.0, Look::new(0.9, 0.2, 0.2, 0.5, 0.3))
        .light(4.0, 1e12 + 5.0, 0.0);
    assert_right("case_35", &d);
}
