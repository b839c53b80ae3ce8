//! Adaptive sampling against what is known in closed form, and its estimates against the truth.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::f64::consts::PI;
use std::sync::Arc;

use glam::DVec3;
use tessera_core::film::Region;
use tessera_core::settings::{Sampling, Settings, Tolerance, Transfer, View};
use tessera_core::simd::Level;
use tessera_core::trace::{PreparedScene, RayCounts, Tracer};
use tessera_tests::generate::{self, Document, Look, Random};

const SIZE: (u32, u32) = (64, 48);

fn tracer(document: &Document, (w, h): (u32, u32), sampling: Sampling) -> Tracer {
    let prepared = Arc::new(PreparedScene::build(Arc::new(document.scene().unwrap())));
    let view = View::new(w, h, 1.0, 1.0).unwrap();
    Tracer::new(prepared, Settings { view, max_depth: 6, sampling, transfer: Transfer::Linear }).unwrap()
}

/// What a document looks like within so many 8-bit steps, pixels' standard deviations, and rays.
fn within(document: &Document, steps: f64, size: (u32, u32)) -> (Vec<[f32; 3]>, Vec<f32>, RayCounts) {
    by(document, steps, false, size)
}

/// The same, every pixel keeping to it or not.
fn by(document: &Document, steps: f64, every_pixel: bool, size: (u32, u32)) -> (Vec<[f32; 3]>, Vec<f32>, RayCounts) {
    let tolerance = Tolerance::new(steps / 255.0);
    let (tile, sigma, rays) = tracer(document, size, Sampling::Adaptive { tolerance, every_pixel })
        .render_estimated(Region::new(0, 0, size.0, size.1).unwrap(), tolerance);
    (tile.pixels, sigma, rays)
}

/// The same by `grid` × `grid` points in every pixel.
fn uniformly(document: &Document, grid: u32, (w, h): (u32, u32)) -> Vec<[f32; 3]> {
    tracer(document, (w, h), Sampling::Uniform { grid }).render(Region::new(0, 0, w, h).unwrap()).0.pixels
}

/// Sum of the first component.
fn sum(pixels: &[[f32; 3]]) -> f64 {
    pixels.iter().map(|p| f64::from(p[0])).sum()
}

fn rmse(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let square = |(x, y): (&f32, &f32)| f64::from(x - y) * f64::from(x - y);
    let (a, b) = (a.as_flattened(), b.as_flattened());
    (a.iter().zip(b).map(square).sum::<f64>() / a.len() as f64).sqrt()
}

/// A camera at the origin that looks along z at a white background.
fn white() -> Document {
    Document::new(DVec3::ZERO, DVec3::Z).with_background(1.0, 1.0, 1.0)
}

fn black() -> Look {
    Look::new(0.0, 0.0, 0.0, 0.0, 0.0)
}

fn matte(level: f64) -> Look {
    Look::new(level, level, level, 1.0, 0.0)
}

/// Pixels that a sphere covers whose centre is seen at angle φ from the axis: an ellipse.
fn disc(centre: DVec3, radius: f64, height: u32) -> f64 {
    let sine = radius / centre.length();
    let cosine = (1.0 - sine * sine).sqrt();
    let along = centre.z / centre.length();
    let rest = along * along - sine * sine;
    PI * (sine * cosine / rest) * (sine / rest.sqrt()) * f64::from(height * height)
}

/// Pixels that a polygon before the camera covers, if it is all in the picture.
fn polygon(corners: &[DVec3], height: u32) -> f64 {
    let at: Vec<(f64, f64)> = corners.iter().map(|c| (c.x / c.z, c.y / c.z)).collect();
    let twice: f64 = (0..at.len())
        .map(|i| {
            let (a, b) = (at[i], at[(i + 1) % at.len()]);
            a.0 * b.1 - a.1 * b.0
        })
        .sum();
    0.5 * twice.abs() * f64::from(height * height)
}

/// Pixels' worth of black on a white background.
fn covered(document: &Document, steps: f64) -> f64 {
    f64::from(SIZE.0 * SIZE.1) - sum(&within(document, steps, SIZE).0)
}

#[test]
fn discs_cover_what_geometry_says() {
    for (x, y, r) in [(0.0, 0.0, 1.0), (0.37, -0.21, 0.6), (1.1, 0.4, 0.05), (-0.9, 0.33, 0.031), (0.2, 0.9, 0.3)] {
        let centre = DVec3::new(x, y, 4.0);
        let expected = disc(centre, r, SIZE.1);
        let got = covered(&white().sphere(centre, r, black()), 0.25);
        // A few thousandths of a pixel of its edge.
        assert!((got - expected).abs() < 4e-3 * (1.0 + expected.sqrt()), "{centre} {r}: {got} pixels, not {expected}");
    }
}

#[test]
fn straight_edges_and_slivers_cover_what_geometry_says() {
    let z = 2.0;
    let at = |x: f64, y: f64| DVec3::new(x * z, y * z, z);
    let pixel = 1.0 / f64::from(SIZE.1);
    let cases = [
        // Edges of all slopes, and triangles thinner than a sixteenth of a pixel.
        [at(-0.5, -0.4), at(0.52, -0.31), at(0.03, 0.43)],
        [at(-0.41, -0.2), at(0.43, 0.27), at(0.43, 0.27 + pixel / 16.0)],
        [at(-0.2, -0.41), at(0.11, 0.42), at(0.11 + pixel / 20.0, 0.42)],
        [at(-0.5, 0.1003), at(0.5, 0.1004), at(0.5, 0.1004 + pixel / 40.0)],
    ];
    for (i, corners) in cases.into_iter().enumerate() {
        let expected = polygon(&corners, SIZE.1);
        let got = covered(&white().triangle(corners, black()), 0.25);
        assert!((got - expected).abs() < 0.01 * expected.max(0.5), "triangle {i}: {got} pixels, not {expected}");
    }
}

/// A sphere's shadow on a plane, both seen from between: cos over the shadow, in pixels.
fn shadow() -> (Document, Document, f64) {
    let camera = DVec3::new(0.0, 0.0, 5.0);
    let lit = Document::new(camera, DVec3::ZERO).light(0.0, 0.0, 20.0).plane(DVec3::Z, 0.0, matte(1.0));
    let (light, height, r) = (20.0, 10.0, 0.53);
    let sine: f64 = r / (light - height);
    let radius = light * sine / (1.0 - sine * sine).sqrt();
    let scale = f64::from(SIZE.1) / camera.z;
    let expected = scale * scale * 2.0 * PI * light * ((light * light + radius * radius).sqrt() - light);
    (lit.clone().sphere(DVec3::new(0.0, 0.0, height), r, matte(1.0)), lit, expected)
}

#[test]
fn a_shadow_takes_the_light_that_geometry_says() {
    let (shadowed, lit, expected) = shadow();
    let take = |steps| sum(&within(&lit, steps, SIZE).0) - sum(&within(&shadowed, steps, SIZE).0);
    let got = take(0.25);
    assert!((got - expected).abs() < 1e-3 * expected, "{got} pixels, not {expected}");
}

/// A black sphere behind the camera, in a mirror before it.
fn mirrored() -> (Document, f64) {
    let mirror = Look::new(0.0, 0.0, 0.0, 0.0, 1.0);
    let document = white().plane(DVec3::Z, 3.0, mirror).sphere(DVec3::new(0.4, -0.3, -2.0), 1.1, black());
    (document, disc(DVec3::new(0.4, -0.3, 8.0), 1.1, SIZE.1))
}

#[test]
fn a_mirrored_disc_covers_what_geometry_says() {
    let (document, expected) = mirrored();
    let got = covered(&document, 0.25);
    assert!((got - expected).abs() < 1e-3 * expected, "{got} pixels, not {expected}");
}

#[test]
fn edges_without_a_formula_converge_faster_than_points() {
    for (name, document) in [("shadow", shadow().0), ("mirror", mirrored().0)] {
        let truth = within(&document, 0.01, SIZE).0;
        let corners = f64::from((SIZE.0 + 3) * (SIZE.1 + 3));
        let at = |steps| {
            let (pixels, _, rays) = within(&document, steps, SIZE);
            (rmse(&pixels, &truth), rays.camera as f64 - corners)
        };
        let (coarse, fine) = (at(24.0), at(0.75));
        let order = (coarse.0 / fine.0).ln() / (fine.1 / coarse.1).ln();
        // Points on a grid converge with a power of about 0.75.
        assert!(order > 1.2, "{name}: order {order:.2}, from {coarse:?} to {fine:?}");
    }
}

#[test]
fn no_object_of_a_64th_of_a_pixel_is_missed() {
    let mut random = Random::new(7);
    let (w, h) = SIZE;
    for round in 0..24 {
        // One small thing in each of many pixels, at any place in it.
        let z = 10.0;
        let unit = z / f64::from(h);
        let (mut document, mut spots) = (white(), Vec::new());
        for j in (3..h - 3).step_by(4) {
            for i in (3..w - 3).step_by(4) {
                let (x, y) = (f64::from(i) + random.unit(), f64::from(j) + random.unit());
                let centre = DVec3::new((x - 0.5 * f64::from(w)) * unit, (0.5 * f64::from(h) - y) * unit, z);
                let area: f64 = random.between(1.0 / 64.0, 1.0 / 8.0);
                document = if round % 2 == 0 {
                    document.sphere(centre, (area / PI).sqrt() * unit, black())
                } else {
                    let long = random.between(0.2, 1.5);
                    let turn = random.between(0.0, PI);
                    let a = DVec3::new(libm::cos(turn), libm::sin(turn), 0.0) * (long * unit);
                    let b = DVec3::new(-a.y, a.x, 0.0) * (2.0 * area / (long * long));
                    document.triangle([centre, centre + a, centre + b], black())
                };
                spots.push((i, j, area));
            }
        }
        let pixels = within(&document, 1.0, SIZE).0;
        for (i, j, area) in spots {
            let dark: f64 = (j - 2..=j + 2)
                .flat_map(|y| (i - 2..=i + 2).map(move |x| (x, y)))
                .map(|(x, y)| 1.0 - f64::from(pixels[(y * w + x) as usize][0]))
                .sum();
            assert!(dark > 0.5 * area, "round {round}, pixel {i},{j}: {dark} of {area} pixels seen");
        }
    }
}

#[test]
fn small_objects_of_the_same_surface_as_what_is_behind_are_not_missed() {
    let mut random = Random::new(11);
    let (w, h) = SIZE;
    let mut document = Document::new(DVec3::new(0.0, 0.0, 10.0), DVec3::ZERO)
        .light(3.0, 2.0, 9.0)
        .light(-9.0, 1.0, 1.0)
        .plane(DVec3::Z, 0.0, matte(0.4));
    let unit = 10.0 / f64::from(h);
    for j in (2..h - 2).step_by(5) {
        for i in (2..w - 2).step_by(5) {
            let (x, y) = (f64::from(i) + random.unit(), f64::from(j) + random.unit());
            let centre = DVec3::new((x - 0.5 * f64::from(w)) * unit, (0.5 * f64::from(h) - y) * unit, 0.0);
            document = document.sphere(centre, random.between(0.1, 0.5) * unit, matte(0.4));
        }
    }
    let (pixels, truth) = (within(&document, 1.0, SIZE).0, uniformly(&document, 16, SIZE));
    let plain = Document { items: document.items.iter().take(3).cloned().collect(), ..document.clone() };
    let plain = uniformly(&plain, 4, SIZE);
    let (mut seen, mut missed) = (0, 0);
    for ((p, t), q) in pixels.iter().zip(&truth).zip(&plain) {
        let (there, shown) = (t[0] - q[0], p[0] - q[0]);
        if there.abs() > 6.0 / 255.0 {
            seen += 1;
            missed += u32::from(shown / there < 0.25);
        }
    }
    assert!(seen > 10, "the scene shows little: {seen}");
    assert_eq!(missed, 0, "of {seen}");
}

/// Spheres and triangles at random, some of them mirrors, over a plane.
fn random_scene(seed: u64) -> Document {
    let mut random = Random::new(seed);
    let mut document = Document::new(DVec3::new(0.0, 2.0, -9.0), DVec3::new(0.0, 0.5, 0.0))
        .with_background(0.2, 0.3, 0.5)
        .light(4.0, 7.0, -5.0)
        .light(-6.0, 5.0, -2.0)
        .plane(DVec3::Y, 0.0, matte(0.6));
    for k in 0..30 {
        let [r, g, b] = [(); 3].map(|()| random.unit());
        let reflect = if random.one_in(3) { 0.4 } else { 0.0 };
        let look = Look::new(r, g, b, 0.7 * (1.0 - reflect), reflect);
        let at = DVec3::new(random.between(-4.0, 4.0), random.between(0.1, 2.5), random.between(-3.0, 5.0));
        document = if k % 3 == 0 {
            document.triangle([at, at + random.cube(), at + random.cube()], look)
        } else {
            document.sphere(at, random.between(0.03, 0.6), look)
        };
    }
    document
}

/// A plane, and a triangle before it, under a canopy of spheres that let through spots of light
/// smaller than a pixel; under the plane lie so many more that outlines of shadows are not followed
/// one by one.
fn canopy() -> Document {
    let mut random = Random::new(11);
    let mut document = Document::new(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO)
        .light(0.0, 0.0, 20.0)
        .plane(DVec3::Z, 0.0, matte(1.0))
        .triangle([DVec3::new(-3.0, -2.0, 1.0), DVec3::new(2.0, 2.5, 1.0), DVec3::new(1.0, -2.0, 1.0)], matte(0.3));
    let spacing = 0.1;
    for row in -20..=20 {
        for column in -22..=22 {
            let x = f64::from(column) + if row % 2 == 0 { 0.0 } else { 0.5 };
            let at = DVec3::new(x, f64::from(row) * 0.75f64.sqrt(), 0.0) * spacing;
            let r = random.between(0.53, 0.57) * spacing;
            document = document.sphere(at + DVec3::new(0.0, 0.0, 10.0), r, matte(1.0));
        }
    }
    for k in 0..4000 {
        document = document.sphere(DVec3::new(f64::from(k % 64), f64::from(k / 64), -9.0), 0.3, matte(1.0));
    }
    document
}

#[test]
fn estimates_are_honest() {
    let mut scenes = vec![
        ("demo", generate::demo()),
        ("mirrors", generate::mirrors()),
        ("lights", generate::lights(40, 8)),
        ("terrain", generate::terrain(16)),
        ("sphereflake", generate::sphereflake(2)),
        ("canopy", canopy()),
    ];
    scenes.extend((0..10).map(|seed| ("random", random_scene(seed))));
    let size = (96, 72);
    for (i, (name, document)) in scenes.iter().enumerate() {
        let truth = uniformly(document, 24, size);
        for steps in [4.0, 0.5] {
            let (pixels, sigma, _) = within(document, steps, size);
            let real = 255.0 * rmse(&pixels, &truth);
            let squares: f64 = sigma.iter().map(|&s| f64::from(s) * f64::from(s)).sum();
            let expected = 255.0 * (squares / sigma.len() as f64).sqrt();
            let beyond = pixels
                .iter()
                .zip(&truth)
                .zip(&sigma)
                // The truth itself is no better than a tenth of a step.
                .filter(|((p, t), s)| (0..3).any(|k| (p[k] - t[k]).abs() > 4.0 * **s + 0.1 / 255.0))
                .count();
            let share = beyond as f64 / sigma.len() as f64;
            let case = format!("{name} {i}, {steps} steps: {real:.3} for {expected:.3}, {:.2} % beyond", 100.0 * share);
            println!("{case}");
            assert!(real < 1.5 * expected + 0.05 && real + 0.05 > expected / 3.0, "{case}");
            assert!(share < 0.01, "{case}");
        }
    }
}

#[test]
fn every_pixel_of_a_final_picture_keeps_to_its_tolerance() {
    let scenes = [("demo", generate::demo()), ("mirrors", generate::mirrors()), ("random", random_scene(3))];
    let size = (80, 60);
    for (name, document) in scenes {
        let truth = uniformly(&document, 64, size);
        let (pixels, sigma, _) = by(&document, 0.25, true, size);
        // Cells end at 1/1024 of a pixel, and where there are 2,048 of them.
        let kept = sigma.iter().filter(|s| **s <= 0.2501 / 255.0).count() as f64 / sigma.len() as f64;
        let close = |(p, t): (&[f32; 3], &[f32; 3])| (0..3).all(|k| (p[k] - t[k]).abs() <= 1.0 / 255.0);
        let within = pixels.iter().zip(&truth).filter(|pair| close(*pair)).count() as f64 / sigma.len() as f64;
        assert!(kept > 0.99 && within > 0.99, "{name}: {kept} keep to it, {within} are within 1/255");
    }
}

#[test]
fn perfect_mirrors_and_darkness_have_estimates() {
    let mirror = Look::new(0.0, 0.0, 0.0, 0.0, 1.0);
    let bright = white().plane(DVec3::Z, 3.0, mirror).sphere(DVec3::new(0.4, -0.3, -2.0), 1.1, black());
    let dark = Document::new(DVec3::ZERO, DVec3::Z).plane(DVec3::Z, 3.0, mirror);
    for document in [bright, dark] {
        let (_, sigma, _) = within(&document, 0.5, SIZE);
        let mean = sigma.iter().sum::<f32>() / sigma.len() as f32;
        assert!(mean < 2.0 / 255.0, "{mean}");
    }
}

#[test]
fn any_division_of_a_picture_gives_the_same_pixels_and_estimates() {
    let (w, h) = (70, 53);
    let scenes = [generate::mirrors(), generate::lights(30, 70), random_scene(5), canopy()];
    for (document, every_pixel) in scenes.iter().flat_map(|d| [(d, false), (d, true)]) {
        let tolerance = Tolerance::new(2.0 / 255.0);
        let tracer = tracer(document, (w, h), Sampling::Adaptive { tolerance, every_pixel });
        let whole = tracer.render_estimated(Region::new(0, 0, w, h).unwrap(), tolerance);
        for edge in [7, 16, 33] {
            let mut error = tessera_core::film::ErrorEstimate::default();
            for region in Region::new(0, 0, w, h).unwrap().blocks(edge) {
                let (tile, sigma, _) = tracer.render_estimated(region, tolerance);
                error += tile.error;
                for (k, (pixel, sigma)) in tile.pixels.iter().zip(&sigma).enumerate() {
                    let (x, y) = (region.x0 + k as u32 % region.width(), region.y0 + k as u32 / region.width());
                    let at = (y * w + x) as usize;
                    assert_eq!(pixel.map(f32::to_bits), whole.0.pixels[at].map(f32::to_bits), "{x},{y} by {edge}");
                    assert_eq!(sigma.to_bits(), whole.1[at].to_bits(), "{x},{y} by {edge}");
                }
            }
            assert_eq!(error, whole.0.error);
        }
    }
}

#[test]
fn every_instruction_set_gives_the_same_pixels() {
    let tolerance = Tolerance::new(1.0 / 255.0);
    let scenes = [(generate::mirrors(), false), (random_scene(6), false), (random_scene(6), true), (canopy(), false)];
    for (document, every_pixel) in scenes {
        let region = Region::new(0, 0, 60, 44).unwrap();
        let mut first: Option<(Vec<[u32; 3]>, RayCounts)> = None;
        for level in Level::all() {
            let tracer = tracer(&document, (60, 44), Sampling::Adaptive { tolerance, every_pixel }).with_level(level);
            let (tile, _, rays) = tracer.render_estimated(region, tolerance);
            let bits = tile.pixels.iter().map(|p| p.map(f32::to_bits)).collect();
            match &first {
                None => first = Some((bits, rays)),
                Some((expected, counts)) => {
                    assert!(bits == *expected, "{level:?}");
                    assert_eq!((rays.camera, rays.mirror, rays.shadow), (counts.camera, counts.mirror, counts.shadow));
                }
            }
        }
    }
}
