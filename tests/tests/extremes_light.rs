//! The extremes suite: lights and shadows.

use glam::{DVec3, dvec3};
use tessera_tests::compare::{assert_same_picture, difference};
use tessera_tests::generate::{Document, Item, Look, Random};
use tessera_tests::oracle::Oracle;
use tessera_tests::reference;
use tessera_tests::subject::{Subject, assert_right, settings, small};

const WHITE: Look = Look::default_matte();

fn black(pixels: &[[f32; 3]]) -> bool {
    pixels.iter().flatten().all(|c| *c == 0.0)
}

#[test]
fn case_44_light_on_a_surface() {
    let eye = Document::new(dvec3(0.3, 2.0, -5.0), DVec3::ZERO);
    let plane = eye.clone().plane(DVec3::Y, 0.0, WHITE).light(0.7, 0.0, 0.3).light(0.0, 0.0, 0.0);
    assert!(black(&small(&plane)), "a light in the plane does not light it");
    let slanted = eye.clone().plane(dvec3(3.0, 4.0, 0.0), -5.0, WHITE).light(-3.0, -4.0, 1.5);
    let brightest = small(&slanted).iter().flatten().fold(0f32, |m, c| m.max(c.abs()));
    assert!(brightest < 1e-12, "lit by {brightest:e}, which is no more than a rounding");
    let sphere = eye.clone().sphere(DVec3::ZERO, 5.0 / 4.0, WHITE).light(0.75, 1.0, 0.0).light(-1.25, 0.0, 0.0);
    assert!(black(&small(&sphere)), "a light on a sphere does not light its outside");
    let inside = Document::new(dvec3(0.1, 0.2, 0.3), dvec3(0.75, 1.0, 0.0))
        .sphere(DVec3::ZERO, 1.25, WHITE)
        .light(0.75, 1.0, 0.0);
    assert_right("case_44_inside", &inside);
    let triangle =
        eye.triangle([dvec3(-2.0, 0.0, -2.0), dvec3(2.0, 0.0, -2.0), dvec3(0.0, 0.0, 3.0)], WHITE).light(0.0, 0.0, 0.0);
    assert!(black(&small(&triangle)));
}

#[test]
fn case_45_light_at_a_spheres_centre() {
    let c = dvec3(0.3, -0.2, 0.7);
    let with_eye = |eye: DVec3| {
        Document::new(eye, eye + dvec3(0.1, 0.2, 1.0)).sphere(c, 1.7, Look::matte(0.5, 0.25, 1.0)).with(Item::Light(c))
    };
    assert!(black(&small(&with_eye(dvec3(0.0, 0.0, -9.0)))), "dark from outside");
    for p in small(&with_eye(c + dvec3(0.3, 0.9, -0.4))) {
        for (value, expected) in p.iter().zip([0.5, 0.25, 1.0]) {
            assert!((value / expected - 1.0).abs() < 2e-7, "{p:?}");
        }
    }
}

#[test]
fn case_46_occluder_near_the_light_and_near_the_receiver() {
    let scene = |y: f64| {
        Document::new(dvec3(0.0, 0.5, -3.0), dvec3(0.0, 0.0, 0.0))
            .plane(DVec3::Y, 0.0, WHITE)
            .triangle([dvec3(-0.4, y, -0.3), dvec3(0.5, y, -0.4), dvec3(0.1, y, 0.6)], Look::matte(0.9, 0.1, 0.1))
            .light(0.0, 1.0, 0.0)
    };
    for (name, y) in [
        ("light", 1.0 - 1e-9),
        ("light-near", 1.0 - 1e-15),
        ("receiver", 1e-9),
        ("receiver-near", 1e-15),
        ("nearest", 1e-100),
    ] {
        let d = scene(y);
        let subject = Subject::new(&d);
        assert!(subject.occluded(DVec3::ZERO, DVec3::Y), "{name}");
        assert!(subject.occluded(DVec3::Y, DVec3::ZERO), "{name}");
        assert!(subject.occluded(dvec3(0.01, 0.0, 0.02), DVec3::Y), "{name}");
        assert_right(&format!("case_46_{name}"), &d);
    }
    // A tiny sphere a hair from the light darkens its whole cone.
    let d = Document::new(dvec3(0.0, 2.0, -3.0), DVec3::ZERO)
        .plane(DVec3::Y, 0.0, WHITE)
        .sphere(dvec3(0.0, 1.0 - 1e-9, 0.0), 6e-10, WHITE)
        .light(0.0, 1.0, 0.0);
    assert_right("case_46_sphere", &d);
}

#[test]
fn case_47_occluder_beyond_the_light() {
    for y in [1.0 + 1e-12, 1f64.next_up(), 1.0, 0.0, -1e-300] {
        let d = Document::new(dvec3(0.0, 0.5, -3.0), DVec3::ZERO)
            .plane(DVec3::Y, 0.0, WHITE)
            .triangle([dvec3(-0.4, y, -0.3), dvec3(0.5, y, -0.4), dvec3(0.1, y, 0.6)], Look::matte(0.9, 0.1, 0.1))
            .light(0.0, 1.0, 0.0);
        assert!(!Subject::new(&d).occluded(DVec3::ZERO, DVec3::Y), "{y:e}");
        if y >= 0.0 {
            assert_right(&format!("case_47_{y:e}"), &d);
        }
    }
    // A sphere that touches the light's place from beyond, and one that reaches an ulp over it.
    for (radius, blocked) in [(0.5, false), (0.5f64.next_up(), true), (0.5f64.next_down(), false)] {
        let d = Document::new(DVec3::ZERO, DVec3::Z).sphere(dvec3(0.0, 1.5, 0.0), radius, WHITE);
        assert_eq!(Subject::new(&d).occluded(DVec3::ZERO, DVec3::Y), blocked, "{radius}");
    }
}

#[test]
fn case_48_light_very_far_and_very_near() {
    let objects = || {
        Document::new(dvec3(0.0, 2.0, -5.0), DVec3::ZERO)
            .plane(DVec3::Y, 0.0, Look::new(0.8, 0.8, 0.8, 0.8, 0.2))
            .sphere(dvec3(0.3, 0.8, 0.4), 0.8, Look::matte(0.9, 0.4, 0.2))
    };
    let far = assert_right("case_48_far", &objects().light(2e30, 3e30, -1e30));
    // The limit: a light so far that its directions differ by 1e-9.
    let limit = assert_right("case_48_limit", &objects().light(2e9, 3e9, -1e9));
    assert!(difference(&far, &limit).largest < 1e-6);
    assert_right("case_48_farther", &objects().light(2e60, 3e60, -1e60));
    assert_right("case_48_near", &objects().light(0.3, 1e-30, -1.2).light(0.3, 1.6 + 1e-12, 0.4));
    let close =
        Document::new(dvec3(0.0, 2e-30, -4e-30), DVec3::ZERO).plane(DVec3::Y, 0.0, WHITE).light(0.0, 1e-30, 0.0);
    let expected = assert_right("case_48_close", &close);
    assert!(expected.pixels[24 * 64 + 32][0] > 0.9);
}

#[test]
fn case_49_terminator_of_a_sphere() {
    // Many lights: terminators everywhere. A lone sphere never shadows its own lit side.
    let mut random = Random::new(49);
    for radius in [1.0, 1e-8, 1e12] {
        let mut d = Document::new(dvec3(0.2, 0.1, -3.0) * radius, DVec3::ZERO).sphere(
            dvec3(0.01, 0.02, 0.03) * radius,
            radius,
            Look::new(0.6, 0.6, 0.6, 0.1, 0.0),
        );
        for _ in 0..12 {
            d = d.with(Item::Light(random.direction() * random.between(1.2, 30.0) * radius));
        }
        let scene = d.scene().unwrap();
        let settings = settings(320, 240);
        let (expected, actual) = (reference::render(&scene, &settings), Subject::new(&d).render(&settings));
        let worst = difference(&expected, &actual).largest;
        assert!(worst < 1e-6, "a false shadow on radius {radius:e}: {worst}");
    }
}

#[test]
fn case_50_coplanar_quad_lit_at_a_grazing_angle() {
    // Corners of small integers: the two halves are coplanar in real arithmetic, and oblique.
    let [a, u, v] = [dvec3(-7.0, -3.0, 2.0), dvec3(11.0, 2.0, 5.0), dvec3(3.0, 9.0, -1.0)];
    let quad = [a, a + u, a + u + v, a + v];
    let n = u.cross(v);
    for angle in [1e-6, 1e-9, 1e-12] {
        let light = a + (u + v) * 0.5 - u * 40.0 + n * (angle * 40.0 * u.length() / n.length());
        let d = Document::new(a + (u + v) * 0.5 + n * 0.15, a + (u + v) * 0.5)
            .triangle([quad[0], quad[1], quad[2]], WHITE)
            .triangle([quad[0], quad[2], quad[3]], WHITE)
            .with(Item::Light(light));
        let expected = assert_right(&format!("case_50_{angle:e}"), &d);
        let actual = Subject::new(&d).render(&settings(64, 48));
        for (e, a) in expected.pixels.iter().zip(&actual.pixels) {
            assert!(e[0] == 0.0 || (a[0] / e[0] - 1.0).abs() < 1e-3, "{e:?} {a:?}: a false shadow");
        }
        assert!(expected.pixels.iter().filter(|p| p[0] > 0.0).count() > 500);
    }
}

#[test]
fn case_51_shadow_of_a_sphere_is_a_conic() {
    let mut random = Random::new(51);
    let (c, r, light) = (dvec3(0.3, 1.2, -0.2), 0.7, dvec3(1.1, 3.3, 0.4));
    let d = Document::new(DVec3::ZERO, DVec3::Z).sphere(c, r, WHITE);
    let (subject, scene) = (Subject::new(&d), d.scene().unwrap());
    let oracle = Oracle::new(&scene, 512);
    // The cone of the shadow meets the floor where ((p − l)·(c − l))² = |p − l|²(|c − l|² − r²).
    let to = c - light;
    let conic = |p: DVec3| (p - light).dot(to).powi(2) - (p - light).length_squared() * (to.length_squared() - r * r);
    let mut near = 0;
    for _ in 0..4000 {
        let mut p = dvec3(random.between(-4.0, 4.0), 0.0, random.between(-4.0, 4.0));
        if random.one_in(2) {
            // Bisect towards the conic itself.
            let (mut inside, mut outside) = (dvec3(-0.3, 0.0, -0.6), p * 9.0);
            for _ in 0..60 {
                let middle = (inside + outside) / 2.0;
                if conic(middle) > 0.0 { inside = middle } else { outside = middle }
            }
            p = inside;
            near += 1;
        } else if conic(p).abs() > 1e-9 {
            assert_eq!(subject.occluded(p, light), conic(p) > 0.0, "{p}");
        }
        assert_eq!(subject.occluded(p, light), oracle.occluded(p, light), "{p:?}");
        assert_eq!(subject.occluded(light, p), oracle.occluded(light, p), "{p:?}");
    }
    assert!(near > 1000);
}

#[test]
fn case_52_a_hundred_thousand_lights() {
    let objects = Document::new(dvec3(0.0, 1.0, -4.0), DVec3::ZERO)
        .plane(DVec3::Y, -1.0, Look::new(0.8, 0.8, 0.8, 1.0, 0.5))
        .sphere(DVec3::ZERO, 1.0, Look::new(0.9, 0.4, 0.2, 1.0, 0.3));
    let mut many = objects.clone();
    many.items.extend((0..100_000).map(|_| Item::Light(dvec3(3.0, 4.0, -2.0))));
    let settings = settings(16, 12);
    let mut one = Subject::new(&objects.light(3.0, 4.0, -2.0)).render(&settings);
    one.pixels.iter_mut().flatten().for_each(|c| *c *= 100_000.0);
    assert_same_picture("case_52", &one, &Subject::new(&many).render(&settings));
}

#[test]
fn shadows_touch_what_casts_them() {
    // Spheres that rest on a plane, on each other, and sink into it.
    let d = Document::new(dvec3(0.0, 1.5, -4.0), dvec3(0.0, 0.5, 0.0))
        .plane(DVec3::Y, 0.0, WHITE)
        .sphere(dvec3(-1.0, 0.5, 0.0), 0.5, Look::matte(0.9, 0.2, 0.2))
        .sphere(dvec3(0.0, 0.5, 0.0), 0.5, Look::matte(0.2, 0.9, 0.2))
        .sphere(dvec3(1.0, 0.0, 0.0), 0.5, Look::matte(0.2, 0.2, 0.9))
        .sphere(dvec3(-0.5, 1.3660254037844386, 0.0), 0.5, Look::matte(0.9, 0.9, 0.2))
        .light(-2.0, 4.0, -1.0)
        .light(3.0, 0.5, -1.0);
    assert_right("contacts", &d);
}
