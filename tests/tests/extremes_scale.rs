//! The extremes suite: scales, offsets, signed zeros.

use glam::{DVec3, dvec3};
use tessera_tests::generate::extreme::basic;
use tessera_tests::generate::{Document, Item, Look};
use tessera_tests::subject::{assert_right, colors, small};

fn power(k: i32) -> f64 {
    2f64.powi(k)
}

#[test]
fn case_01_whole_scene_times_a_power_of_two() {
    let unit = small(&basic());
    for k in (-900..=900).step_by(50).chain([-1, 1, -899, 899, -37, 511, 513, -511, -513]) {
        assert!(small(&basic().scaled(power(k))) == unit, "2^{k}");
    }
}

#[test]
fn case_02_whole_scene_times_a_power_of_ten() {
    for (name, factor) in [("1e30", 1e30), ("1e-30", 1e-30), ("1e300", 1e300), ("1e-300", 1e-300)] {
        let expected = assert_right(&format!("case_02_{name}"), &basic().scaled(factor));
        assert!(colors(&expected) > 500);
    }
}

#[test]
fn case_03_moved_by_two_to_the_forty() {
    let unit = small(&basic());
    for offset in [dvec3(1.0, 0.0, 0.0), dvec3(-1.0, 1.0, 1.0), dvec3(0.0, -1.0, -1.0), DVec3::ONE] {
        assert!(small(&basic().moved(offset * power(40))) == unit, "{offset}");
        assert!(small(&basic().moved(offset * power(20))) == unit, "{offset}");
    }
}

#[test]
fn case_04_moved_where_coordinates_round() {
    for offset in [1e6, 1e9, 1e12, 1e15] {
        let document = basic().scaled(1.1).moved(dvec3(offset, -0.7 * offset, 1.3 * offset));
        assert_right(&format!("case_04_{offset:e}"), &document);
    }
}

#[test]
fn case_05_small_sphere_resting_on_large() {
    let look = Look::matte(0.9, 0.9, 0.9);
    let document = Document::new(dvec3(0.0, 1e6 + 3e-6, -8e-6), dvec3(0.0, 1e6 + 1e-6, 0.0))
        .with_background(0.0, 0.0, 0.5)
        .sphere(dvec3(0.0, 0.0, 0.0), 1e6, Look::matte(0.2, 0.9, 0.2))
        .sphere(dvec3(0.0, 1e6 + 1e-6, 0.0), 1e-6, look)
        .light(3.0, 1e6 + 4.0, -5.0);
    let expected = assert_right("case_05", &document);
    let (middle, corner) = (expected.pixels[24 * 64 + 32], expected.pixels[47 * 64]);
    assert!(middle[0] == middle[1] && corner[0] < corner[1], "{middle:?} {corner:?}: both are to be seen");
}

#[test]
fn case_06_tiny_and_huge_spheres() {
    for (name, k) in [("tiny", 1e-30), ("huge", 1e30)] {
        let document = Document::new(dvec3(0.0, 0.0, -10.0 * k), DVec3::ZERO)
            .sphere(DVec3::ZERO, k, Look::new(0.9, 0.5, 0.1, 0.8, 0.2))
            .sphere(dvec3(0.8 * k, 0.9 * k, -k), 0.5 * k, Look::new(0.1, 0.5, 0.9, 0.8, 0.2))
            .light(20.0 * k, 20.0 * k, -30.0 * k);
        assert!(colors(&assert_right(&format!("case_06_{name}"), &document)) > 20);
    }
}

#[test]
fn case_07_squares_leave_the_range() {
    for (name, k) in [("under", 1e-160), ("over", 1e160)] {
        assert!(colors(&assert_right(&format!("case_07_{name}"), &basic().scaled(k))) > 500);
        // And beside objects of ordinary size.
        let document = Document::new(dvec3(0.0, 0.0, -4.0), DVec3::ZERO)
            .sphere(dvec3(0.0, -k - 1.0, 0.0), k, Look::matte(0.2, 0.9, 0.2))
            .sphere(DVec3::ZERO, 1.0, Look::new(0.9, 0.5, 0.1, 0.8, 0.2))
            .light(2.0, 2.0, -3.0);
        assert_right(&format!("case_07_mixed_{name}"), &document);
    }
}

#[test]
fn case_08_tiny_sphere_before_huge() {
    let document = Document::new(dvec3(0.0, 0.0, -4e-9), DVec3::ZERO)
        .sphere(dvec3(0.0, 0.0, 1e9 + 1.0), 1e9, Look::matte(0.9, 0.2, 0.2))
        .sphere(DVec3::ZERO, 1e-9, Look::matte(0.2, 0.2, 0.9))
        .light(1.0, 2.0, -3.0);
    let expected = assert_right("case_08", &document);
    let middle = expected.pixels[24 * 64 + 32];
    assert!(middle[2] > middle[0], "the small one is there: {middle:?}");
}

#[test]
fn case_38_distance_to_look_at() {
    let unit = small(&straight());
    for k in [-600, -300, -52, 1, 300, 600] {
        let mut d = straight();
        d.camera[2] = d.camera[0] + (d.camera[2] - d.camera[0]) * power(k);
        assert!(small(&d) == unit, "2^{k}");
    }
}

/// The basic scene from a camera at the origin, so that a point ahead scales without rounding.
fn straight() -> Document {
    let eye = basic().camera[0];
    basic().moved(-eye)
}

#[test]
fn case_39_length_of_sky() {
    let unit = small(&basic());
    for k in [-900, -500, 3, 500, 900] {
        let mut d = basic();
        d.camera[1] *= power(k);
        assert!(small(&d) == unit, "2^{k}");
    }
}

#[test]
fn case_66_negative_zeros() {
    let negative = |v: DVec3| DVec3::from_array(v.to_array().map(|x| if x == 0.0 { -0.0 } else { x }));
    let mut d = basic();
    d.camera = d.camera.map(negative);
    d.background = [0.1, 0.2, 0.4];
    for item in &mut d.items {
        match item {
            Item::Light(p) | Item::Sphere(p, ..) => *p = negative(*p),
            Item::Plane(n, place, look) => {
                *n = negative(*n);
                if let tessera_core::scene::PlanePosition::Point(p) = place {
                    *p = negative(*p);
                }
                look.reflect += -0.0;
            }
            Item::Triangle(c, look) | Item::TriangleSides(c, look) => {
                *c = c.map(negative);
                if look.reflect == 0.0 {
                    look.reflect = -0.0;
                }
            }
        }
    }
    assert!(small(&d) == small(&basic()));
    // Zeros that matter: axis-aligned rays from the origin.
    let axis = |zero: f64| {
        Document::new(dvec3(zero, zero, -3.0), dvec3(zero, zero, zero))
            .plane(dvec3(zero, 1.0, zero), zero, Look::matte(0.5, 0.5, 0.5))
            .sphere(dvec3(zero, zero, zero), 1.0, Look::new(0.5, 0.5, 0.5, 0.5, 0.5))
            .light(zero, 3.0, zero)
    };
    assert!(small(&axis(0.0)) == small(&axis(-0.0)));
}

#[test]
fn scenes_of_mixed_scales_are_right() {
    // A lit room of size 1 with a camera a universe away looking through a telescope of a narrow field.
    let document = Document::new(dvec3(0.0, 0.0, -1e18), DVec3::ZERO)
        .sphere(DVec3::ZERO, 1e17, Look::matte(0.9, 0.5, 0.1))
        .sphere(dvec3(0.0, 0.0, -1.2e17), 1e16, Look::new(0.1, 0.5, 0.9, 0.5, 0.5))
        .plane(DVec3::Y, -1e17, Look::matte(0.4, 0.4, 0.4))
        .light(1e18, 1e18, -1e18);
    assert_right("mixed_scales", &document);
}
