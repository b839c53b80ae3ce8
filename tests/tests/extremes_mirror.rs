//! The extremes suite: mirrors and long paths.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec3, dvec3};
use rayon::prelude::*;
use tessera_core::film::Region;
use tessera_core::settings::{AuditRate, Detail, Pass, Sampling, Settings, Tolerance, View};
use tessera_core::trace::{PreparedScene, Tracer};
use tessera_tests::compare::{Image, assert_same_picture, difference};
use tessera_tests::generate::{Document, Item, Look, Random, globe};
use tessera_tests::oracle::Oracle;
use tessera_tests::subject::{Subject, assert_right, assert_right_under, settings};

fn deep(width: u32, height: u32, max_depth: u32) -> Settings {
    Settings { max_depth, ..settings(width, height) }
}

/// Two mirrors that face each other, the eye and a light between them on one axis.
fn facing(diffuse: f64, reflect: f64) -> Document {
    let look = Look::new(1.0, 1.0, 1.0, diffuse, reflect);
    Document::new(DVec3::ZERO, DVec3::Z).plane(DVec3::Z, 1.0, look).plane(DVec3::Z, -1.0, look).light(0.0, 0.0, 0.0)
}

fn single(document: &Document, depth: u32) -> f64 {
    Subject::new(document).render(&deep(1, 1, depth)).pixels[0][0]
}

#[test]
fn case_53_facing_mirrors() {
    for depth in [1, 2, 3, 10, 100, 1000] {
        assert_eq!(single(&facing(0.25, 1.0), depth), 0.25 * f64::from(depth));
    }
}

#[test]
fn case_54_facing_mirrors_that_absorb() {
    for reflect in [0.5, 0.75, 0.875] {
        let limit = 0.25 / (1.0 - reflect);
        for depth in 1..40 {
            let value = single(&facing(0.25, reflect), depth);
            let series = 0.25 * (1.0 - reflect.powi(depth as i32)) / (1.0 - reflect);
            assert!((value - series).abs() < 1e-6, "{reflect} {depth}: {value} is not {series}");
            assert!(limit - value <= reflect.powi(depth as i32) / (1.0 - reflect) * 0.25 + 1e-6);
        }
    }
}

#[test]
fn case_55_corner_of_mirrors() {
    let mirror = Look::mirror(1.0);
    let mut d = Document::new(dvec3(2.0, 1.5, 2.5), dvec3(0.3, 0.2, 0.25)).light(1.0, 3.0, 2.0);
    d.textures.push(("g.ppm".into(), globe(96)));
    let d = d
        .plane(DVec3::X, 0.0, mirror)
        .plane(DVec3::Y, 0.0, mirror)
        .plane(DVec3::Z, 0.0, mirror)
        .triangle([dvec3(9.0, -3.0, -1.0), dvec3(-3.0, 9.0, 1.0), dvec3(1.0, 1.0, 11.0)], Look::picture(0, 1.0, 0.0))
        .sphere(dvec3(0.5, 0.5, 0.5), 0.2, Look::new(0.9, 0.3, 0.2, 0.5, 0.5));
    assert_right_under("case_55", &d, &deep(64, 48, 12));
}

#[test]
fn case_56_square_orbit_in_a_mirrored_sphere() {
    // Along the sides of the square inscribed in the equator, seen through a narrow field.
    let d = Document::new(dvec3(0.5, 0.5, 0.0), dvec3(0.0, 1.0, 0.0))
        .sphere(DVec3::ZERO, 1.0, Look::new(1.0, 0.8, 0.6, 0.1, 0.95))
        .light(0.3, -0.2, 0.1);
    let mut d = d;
    d.camera[1] = DVec3::Z;
    for depth in [4, 16, 64] {
        let settings = Settings { view: View::new(12, 9, 1.0, 0.05).unwrap(), ..deep(12, 9, depth) };
        let scene = d.scene().unwrap();
        let expected = Oracle::new(&scene, 1024).render(&settings);
        let actual = Subject::new(&d).render(&settings);
        println!("depth {depth}: off by {:.1e}", difference(&expected.image, &actual).largest);
        assert_same_picture(&format!("case_56_{depth}"), &expected.image, &actual);
    }
}

/// Balls near the eye that mirror one another and `around`.
fn balls(around: Item, reflect: f64) -> Document {
    let mut r = Random::new(41);
    let mut d = Document::new(dvec3(0.1, 1.7, -6.0), dvec3(0.0, 1.2, 0.0)).with_background(0.5, 0.7, 0.9).with(around);
    for _ in 0..25 {
        let (at, radius) =
            (dvec3(r.between(-3.0, 3.0), r.between(0.4, 2.5), r.between(-3.0, 5.0)), r.between(0.1, 0.5));
        d = d.sphere(at, radius, Look::new(r.unit(), r.unit(), r.unit(), 0.9 - reflect, reflect));
    }
    d.light(2.0, 4.0, -3.0).light(-3.0, 3.5, -4.0)
}

/// What is too faint to show is not decided in wide numbers, and does not show.
#[test]
fn faint_light_is_off_by_no_more_than_values_may_be() {
    let planet = |reflect| Item::Sphere(dvec3(0.0, -6e6, 0.0), 6e6, None, Look::new(0.5, 0.6, 0.4, 0.9, reflect));
    let dome = |reflect| Item::Sphere(dvec3(0.0, 1.0, 0.0), 8.0, None, Look::new(0.8, 0.7, 0.6, 0.5, reflect));
    // The last sends out more than it takes in.
    for (name, around, reflect) in
        [("planet", planet(0.1), 0.2), ("dome", dome(0.3), 0.4), ("bright", planet(0.8), 0.6), ("room", dome(0.5), 0.8)]
    {
        let (document, settings) = (balls(around, reflect), deep(20, 15, 12));
        let expected = Oracle::new(&document.scene().unwrap(), 2048).render(&settings);
        let off = difference(&expected.image, &Subject::new(&document).render(&settings)).largest;
        println!("{name}: off by {off:.1e}");
        assert!(off < 1.0 / 4096.0, "{name}: off by {off:.1e}");
    }
}

/// What is faint is taken as it is, and yet does not meet what lies in the plane that it leaves: every level agrees with
/// f64 alone (which [`Subject::trace`] demands) where mirrors lie over one another in exact planes.
#[test]
fn faint_light_leaves_the_plane_it_starts_in() {
    (0..400u64).into_par_iter().for_each(|seed| {
        let mut r = Random::new(1000 + seed);
        let mut pick = |from: &[f64]| from[(r.unit() * from.len() as f64) as usize % from.len()];
        let reflect = pick(&[0.01, 0.02, 0.1]);
        let look = Look::new(0.9, 0.7, 0.5, 0.9, reflect);
        let mut d = Document::new(dvec3(0.3, 2.2, -4.5), dvec3(0.0, 1.5, 0.0)).with_background(0.3, 0.5, 0.7);
        for _ in 0..3 {
            let [a, e1, e2] = [0, 1, 2].map(|_| {
                let of = &[0.0, 0.0, 1.0, 2.0, -1.0, 3.0, -2.0];
                dvec3(pick(of), pick(of), pick(of))
            });
            for _ in 0..8 {
                let steps = &[-3.0, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 3.0];
                d = d.triangle([0, 1, 2].map(|_| a + e1 * pick(steps) + e2 * pick(steps)), look);
            }
        }
        for _ in 0..6 {
            let halves = &[-2.0, -1.5, -1.0, 0.5, 1.0, 1.5, 2.0, 3.0];
            d = d.sphere(dvec3(pick(halves), pick(halves), pick(halves)), pick(&[0.25, 0.4, 0.5, 1.0]), look);
        }
        let d = d.plane(DVec3::Y, 0.0, look).light(1.0, 4.5, -3.0);
        if d.scene().is_ok() {
            let _ = Subject::new(&d).trace(&deep(24, 18, 8));
        }
    });
}

#[test]
fn case_57_plane_mirror_or_mirrored_camera() {
    let objects = |d: Document| {
        d.sphere(dvec3(0.4, 0.3, -2.0), 0.5, Look::new(0.9, 0.3, 0.2, 0.7, 0.2))
            .triangle(
                [dvec3(-1.5, -0.5, -1.0), dvec3(-0.2, -0.6, -1.5), dvec3(-0.7, 0.9, -2.5)],
                Look::matte(0.3, 0.9, 0.3),
            )
            .light(1.0, 2.0, -4.0)
    };
    let by_mirror =
        objects(Document::new(dvec3(0.2, 0.5, -4.0), dvec3(0.1, 0.0, 0.0)).plane(DVec3::Z, 0.0, Look::mirror(1.0)));
    let by_camera = objects(Document::new(dvec3(0.2, 0.5, 4.0), dvec3(0.1, 0.0, 0.0)));
    // Objects before the mirror hide their own reflections: only what is seen in it is compared.
    let mirrored = Subject::new(&by_camera).render(&deep(64, 48, 5));
    let seen = Subject::new(&by_mirror).render(&deep(64, 48, 6));
    let direct = Subject::new(&by_mirror).render(&deep(64, 48, 1));
    let (mut compared, mut flipped) = (0, seen.clone());
    for y in 0..48 {
        for x in 0..64 {
            let i = y * 64 + x;
            flipped.pixels[i] = mirrored.pixels[y * 64 + 63 - x];
            if direct.pixels[i] != [0.0; 3] {
                flipped.pixels[i] = seen.pixels[i];
            } else {
                compared += usize::from(seen.pixels[i] != [0.0; 3]);
            }
        }
    }
    assert!(compared > 50, "{compared}");
    // In shadow or not lit, an object before the mirror is black to `direct` too; few pixels are.
    let wrong = difference(&flipped, &seen).wrong.len();
    assert!(wrong < 150, "{wrong} of {compared}");
    assert_right("case_57", &by_mirror);
}

#[test]
fn case_58_depth_100000_on_a_small_stack() {
    let scene = Arc::new(facing(0.25, 1.0).scene().unwrap());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).stack_size(2 << 20).build().unwrap();
    let value = pool.install(|| {
        let tracer = Tracer::new(Arc::new(PreparedScene::build(scene)), deep(1, 1, 100_000)).unwrap();
        tracer.render(Region::new(0, 0, 1, 1).unwrap()).0.pixels[0][0]
    });
    assert_eq!(value, 25_000.0);
}

#[test]
fn case_58_long_path_that_is_not_a_line() {
    // A slanted ray between the mirrors: every bounce is elsewhere, every n·l another.
    let d = facing(0.25, 1.0);
    for (w, h, depth) in [(3i32, 3i32, 2000), (7, 5, 500)] {
        let settings = deep(w as u32, h as u32, depth);
        let actual = Subject::new(&d).render(&settings);
        let mut expected = Image { width: w as usize, height: h as usize, pixels: Vec::new() };
        for j in 0..h {
            for i in 0..w {
                let unit = settings.view.plane_height() / f64::from(2 * h);
                let (x, y) = (f64::from(2 * i + 1 - w) * unit, f64::from(h - 1 - 2 * j) * unit);
                // At bounce k the path is (2k + 1)·(x, y) off the axis, and the light is 1 away along it.
                let slope = x.hypot(y);
                let at = |k: u32| 0.25 / (1.0 + (f64::from(2 * k + 1) * slope).powi(2)).sqrt();
                let sum: f64 = (0..depth).map(at).sum();
                expected.pixels.push([sum; 3]);
            }
        }
        assert_same_picture(&format!("case_58_slanted_{w}x{h}"), &expected, &actual);
    }
}

#[test]
fn long_paths_beside_others_are_those_of_pixels_alone() {
    // More paths go on for long than do so at a time, and others end among them.
    let mut d = facing(0.1, 1.0).sphere(dvec3(0.3, 0.1, 0.4), 0.3, Look::matte(0.9, 0.3, 0.2));
    d = d.sphere(dvec3(-0.4, -0.2, 0.5), 0.2, Look::new(0.2, 0.3, 0.9, 0.3, 0.6));
    for depth in [64, 65, 200] {
        let scene = Arc::new(PreparedScene::build(Arc::new(d.scene().unwrap())));
        let tracer = Tracer::new(scene, deep(12, 9, depth)).unwrap();
        let (whole, counts) = tracer.render(Region::new(0, 0, 12, 9).unwrap());
        assert!(counts.mirror > 50 * u64::from(depth), "{counts:?}");
        let mut rays = 0;
        for (k, pixel) in (0u32..).zip(&whole.pixels) {
            let (x, y) = (k % 12, k / 12);
            let (alone, more) = tracer.render(Region::new(x, y, x + 1, y + 1).unwrap());
            assert_eq!(alone.pixels[0].map(f32::to_bits), pixel.map(f32::to_bits), "({x}, {y}) at {depth}");
            rays += more.total();
        }
        assert_eq!(rays, counts.total(), "at {depth}");
    }
}

#[test]
fn mirrored_spheres_magnify_every_error() {
    // Rays between three spheres that nearly touch grow apart by a factor of tens a bounce.
    let look = |r: f64, g: f64, b: f64| Look::new(r, g, b, 0.3, 0.9);
    let h = 3f64.sqrt();
    let d = Document::new(dvec3(0.0, 0.2, -4.0), DVec3::ZERO)
        .with_background(0.1, 0.3, 0.6)
        .sphere(dvec3(-1.01, -h / 3.0, 0.0), 1.0, look(0.9, 0.2, 0.2))
        .sphere(dvec3(1.01, -h / 3.0, 0.0), 1.0, look(0.2, 0.9, 0.2))
        .sphere(dvec3(0.0, 2.0 * h / 3.0, 0.0), 1.0, look(0.2, 0.2, 0.9))
        .light(0.5, 1.0, -6.0);
    for depth in [6, 16, 40] {
        assert_right_under(&format!("chaos_{depth}"), &d, &deep(64, 48, depth));
    }
    let zoomed = Settings { view: View::new(64, 48, 1.0, 0.01).unwrap(), ..deep(64, 48, 24) };
    assert_right_under("chaos_zoomed", &d, &zoomed);
}

#[test]
fn mirrors_that_touch() {
    let m = Look::new(0.8, 0.8, 0.8, 0.2, 0.8);
    let d = Document::new(dvec3(0.0, 1.0, -4.0), dvec3(0.0, 0.5, 0.0))
        .with_background(0.1, 0.3, 0.6)
        .plane(DVec3::Y, 0.0, m)
        .sphere(dvec3(-1.0, 1.0, 0.0), 1.0, m)
        .sphere(dvec3(1.0, 1.0, 0.0), 1.0, m)
        .with(Item::TriangleSides([dvec3(-3.0, 0.0, 2.0), dvec3(6.0, 0.0, 0.0), dvec3(0.0, 3.0, 0.0)], m))
        .light(0.0, 4.0, -3.0);
    assert_right_under("touching", &d, &deep(64, 48, 20));
}

#[test]
fn what_stays_open_is_counted() {
    // Within a mirrored sphere full of mirrored balls, every meeting takes digits off a path.
    let mut d = Document::new(dvec3(0.1, 0.2, -0.8), dvec3(0.0, 0.1, 0.3))
        .sphere(DVec3::ZERO, 1.0, Look::new(1.0, 0.9, 0.8, 0.1, 0.99))
        .light(0.3, 0.5, -0.5);
    for k in 0..8 {
        let corner = |b: i32| if k >> b & 1 == 1 { 0.4 } else { -0.4 };
        d = d.sphere(dvec3(corner(0), corner(1), corner(2)), 0.25, Look::new(0.8, 0.9, 1.0, 0.1, 0.99));
    }
    let subject = Subject::new(&d);
    let samples = |depth| subject.trace(&deep(8, 6, depth)).1;
    assert_eq!(samples(8).unresolved, 0, "a few mirrors leave digits enough");
    let counts = samples(600);
    assert!(counts.unresolved > 36, "{counts:?}");
    assert!(counts.unresolved <= counts.camera);
    // Flat mirrors take no digits, however many.
    let flat = Subject::new(&facing(0.25, 1.0)).trace(&deep(16, 12, 1000)).1;
    assert_eq!(flat.unresolved, 0, "{flat:?}");
}

#[test]
fn what_nobody_wants_any_more_is_stopped_however_long_its_paths() {
    let unwanted = Arc::new(AtomicBool::new(false));
    let scene = Arc::new(facing(0.25, 1.0).scene().unwrap());
    for sampling in [Sampling::Uniform { grid: Sampling::MAX_GRID }, Sampling::Adaptive] {
        unwanted.store(false, Ordering::Relaxed);
        let settings = Settings { sampling, ..deep(64, 64, Settings::MAX_DEPTH) };
        let prepared = Arc::new(PreparedScene::build(Arc::clone(&scene)));
        let tracer = Tracer::new(prepared, settings).unwrap().until(Arc::clone(&unwanted));
        let (began, has_begun) = std::sync::mpsc::channel();
        let tile = std::thread::spawn(move || {
            began.send(()).unwrap();
            tracer.render_pass(
                Region { x0: 0, y0: 0, x1: 64, y1: 64 },
                Pass { detail: Detail::Within(Tolerance::MIN), audit: AuditRate::ALL },
            )
        });
        has_begun.recv().unwrap();
        // Left alone it would take days.
        unwanted.store(true, Ordering::Relaxed);
        tile.join().unwrap();
    }
}
