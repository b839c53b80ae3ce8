//! Adaptive sampling by itself: what is known in closed form, and that pixels depend on nothing they should not.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::f64::consts::PI;
use std::sync::Arc;

use glam::DVec3;
use tessera_core::film::{ErrorEstimate, Region};
use tessera_core::settings::{AuditRate, Detail, Pass, Sampling, Settings, Tolerance, Transfer, View};
use tessera_core::simd::Level;
use tessera_core::trace::{PreparedScene, RayCounts, Tracer};
use tessera_tests::edges::{self, Seen};
use tessera_tests::generate::{self, Document, Look, fine};
use tessera_tests::truth::whole;

fn settings((width, height): (u32, u32), sampling: Sampling) -> Settings {
    let view = View::new(width, height, 1.0, 1.0).unwrap();
    Settings { view, max_depth: 6, sampling, transfer: Transfer::Linear }
}

fn tracer(document: &Document, size: (u32, u32)) -> Tracer {
    let prepared = Arc::new(PreparedScene::build(Arc::new(document.scene().unwrap())));
    Tracer::new(prepared, settings(size, Sampling::Adaptive)).unwrap()
}

/// Within so many 8-bit steps, every pixel audited.
fn within(steps: f64) -> Pass {
    Pass { detail: Detail::Within(Tolerance::new(steps / 255.0)), audit: AuditRate::ALL }
}

/// Sum of the first component.
fn light(document: &Document, size: (u32, u32), steps: f64) -> f64 {
    let tracer = tracer(document, size);
    let (tile, _) = tracer.render_pass(whole(tracer.settings()), within(steps));
    tile.pixels.iter().map(|p| f64::from(p[0])).sum()
}

/// What a white ball of radius 1 sends, seen from far off at angle `phase` between light and eye: its disc's integral
/// of n·l.
fn phase_integral(phase: f64) -> f64 {
    2.0 / 3.0 * (libm::sin(phase) + (PI - phase) * libm::cos(phase))
}

#[test]
fn a_small_ball_sends_its_light_wherever_it_is_and_however_it_is_lit() {
    const PIXELS: u32 = 9;
    let pixel = 1.0 / f64::from(PIXELS);
    let mut wrong = Vec::new();
    for diameter in [0.1, 0.25, 0.5, 1.0, 2.0] {
        for offset in [(0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.21, 0.37), (0.43, -0.11), (-0.3, 0.08)] {
            for (phase, around) in [(0.0, 0.0), (0.5, 1.0), (1.0, 2.0), (1.6, 0.3), (2.0, 4.0), (2.6, 5.2)] {
                // So far off, and so enlarged by zoom, that all its rays are parallel almost.
                let z = 1e4;
                let scale = z * pixel * 1e-3;
                let centre = DVec3::new(offset.0 * scale, offset.1 * scale, z);
                let (s, c) = (libm::sin(phase), libm::cos(phase));
                let towards = DVec3::new(s * libm::cos(around), s * libm::sin(around), -c);
                let from = centre + 1e9 * towards;
                let document = Document::new(DVec3::ZERO, DVec3::Z)
                    .sphere(centre, 0.5 * diameter * scale, Look::matte(1.0, 1.0, 1.0))
                    .light(from.x, from.y, from.z);
                let view = View::new(PIXELS, PIXELS, 1e3, 1.0).unwrap();
                let scene = Arc::new(PreparedScene::build(Arc::new(document.scene().unwrap())));
                let settings = Settings { view, ..settings((PIXELS, PIXELS), Sampling::Adaptive) };
                let tracer = Tracer::new(scene, settings).unwrap();
                let (tile, _) = tracer.render_pass(whole(&settings), within(0.2));
                let got: f64 = tile.pixels.iter().map(|p| f64::from(p[0])).sum();
                let right = 0.25 * diameter * diameter * phase_integral(phase);
                if (got / right - 1.0).abs() > 0.02 {
                    wrong.push(format!("{diameter} pixels at {offset:?}, phase {phase}: {got:.6}, not {right:.6}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} of 180 wrong:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn discs_and_polygons_cover_what_geometry_says() {
    let size = (64, 48);
    let white = || Document::new(DVec3::ZERO, DVec3::Z).with_background(1.0, 1.0, 1.0);
    let black = Look::matte(0.0, 0.0, 0.0);
    let covered = |document: &Document| f64::from(size.0 * size.1) - light(document, size, 0.25);
    for (x, y, radius) in [(0.0, 0.0, 1.0), (0.37, -0.21, 0.6), (1.1, 0.4, 0.3), (0.2, 0.9, 0.3)] {
        let centre = DVec3::new(x, y, 4.0);
        // A sphere off the axis is seen as an ellipse.
        let sine = radius / centre.length();
        let along = centre.z / centre.length();
        let rest = along * along - sine * sine;
        let area = PI * (sine * (1.0 - sine * sine).sqrt() / rest) * (sine / rest.sqrt()) * f64::from(size.1 * size.1);
        let got = covered(&white().sphere(centre, radius, black));
        // A few hundredths of a pixel of its edge.
        assert!((got - area).abs() < 0.02 * (1.0 + area.sqrt()), "{centre} {radius}: {got} pixels, not {area}");
    }
    let at = |x: f64, y: f64| DVec3::new(2.0 * x, 2.0 * y, 2.0);
    let corners = [(-0.5, -0.4), (0.52, -0.31), (0.03, 0.43)];
    let twice: f64 =
        (0..3).map(|i| corners[i].0 * corners[(i + 1) % 3].1 - corners[(i + 1) % 3].0 * corners[i].1).sum();
    let area = 0.5 * twice.abs() * f64::from(size.1 * size.1);
    let got = covered(&white().triangle(corners.map(|(x, y)| at(x, y)), black));
    assert!((got - area).abs() < 0.02 * (1.0 + area.sqrt()), "{got} pixels, not {area}");
}

/// An edge just inside a column of pixels is missed by the first points of most of them, and shows in none beside it: that
/// these differ tells of it.
#[test]
fn an_edge_along_a_column_of_pixels_is_looked_for_where_neighbours_differ() {
    let (width, height) = (64, 48);
    // A shadow's, of which nothing but samples tells.
    const DARK: f64 = 0.06;
    let edge = 4.0 * DARK / f64::from(height);
    let lamp = DVec3::new(-10.0, 0.0, 0.0);
    // A tenth of the way to the wall, far out of sight.
    let screen = lamp.lerp(DVec3::new(edge, 0.0, 4.0), 0.1);
    let document = Document::new(DVec3::ZERO, DVec3::Z)
        .triangle(
            [(-90.0, -90.0), (90.0, -90.0), (0.0, 180.0)].map(|(x, y)| DVec3::new(x, y, 4.0)),
            Look::matte(1.0, 1.0, 1.0),
        )
        .triangle(
            [(0.0, -50.0), (0.0, 50.0), (-30.0, 0.0)].map(|(x, y)| screen + DVec3::new(x, y, 0.0)),
            Look::matte(1.0, 1.0, 1.0),
        )
        .light(lamp.x, lamp.y, lamp.z);
    let tracer = tracer(&document, (width, height));
    let (tile, _) = tracer.render_pass(whole(tracer.settings()), within(2.0));
    let column = |x: u32| tile.pixels.chunks_exact(width as usize).map(move |row| f64::from(row[x as usize][0]));
    assert_eq!(column(31).fold(0.0, f64::max), 0.0, "all of it is in the shadow");
    let squares = column(32).zip(column(33)).map(|(here, lit)| (255.0 * (here - (1.0 - DARK) * lit)).powi(2));
    let error = (squares.sum::<f64>() / f64::from(height)).sqrt();
    // Missed everywhere, it would be 5.5.
    assert!(error < 1.0, "{error} steps along the column");
    let told = 255.0 * tile.error.expected_rmse() * f64::from(width).sqrt();
    assert!((0.4..2.5).contains(&(told / error)), "{told} steps expected along it, not {error}");
}

/// What decides how many points a pixel is worth is what pixels on edges show. That κ is in proportion to the variance
/// holds on average alone: of pixels that a line clips at a corner it is more of their small variance.
#[test]
fn means_on_edges_err_as_the_model_says() {
    const POINTS: [u32; 2] = [16, 64];
    let (model, seen) = (Tolerance::MODEL, edges::measure(1000..1120, &POINTS));
    let [few, many] = [0, 1].map(|k| seen.iter().map(|edge| edge[k]).collect::<Vec<Seen>>());
    for (seen, points) in [(&few, 16), (&many, 64)] {
        let variance = seen.iter().map(|s| s.variance).sum::<f64>() / seen.iter().map(|s| s.pixels).sum::<f64>();
        let typical = edges::kappa(seen, points) * variance;
        let off = typical / model.typical;
        assert!((off - 1.0).abs() < 0.1, "a typical edge's κ is {typical} by {points} points, not {}", model.typical);
    }
}

fn scenes() -> Vec<Document> {
    let mut scenes = vec![generate::mirrors(), generate::lights(30, 12)];
    scenes.extend([3, 4].map(fine::everything));
    scenes.push(fine::FINE[4].1(1, 44));
    scenes
}

#[test]
fn any_division_of_a_picture_gives_the_same_pixels_and_errors() {
    let (w, h) = (70, 53);
    let glance = Detail::Glance(Tolerance::new(3.0 / 255.0));
    let passes = [within(2.0), Pass { audit: AuditRate(9000), ..within(0.5) }, Pass { detail: glance, ..within(3.0) }];
    let coarse = [3, 8].map(|step| Pass { detail: Detail::Coarse { step }, audit: AuditRate(60_000) });
    for document in scenes() {
        let tracer = tracer(&document, (w, h));
        for pass in passes.into_iter().chain(coarse) {
            let (all, rays) = tracer.render_pass(whole(tracer.settings()), pass);
            for edge in [7, 16, 33] {
                let (mut error, mut traced) = (ErrorEstimate::default(), RayCounts::default());
                for region in whole(tracer.settings()).blocks(edge) {
                    let (tile, rays) = tracer.render_pass(region, pass);
                    error += tile.error;
                    traced += rays;
                    for (k, pixel) in tile.pixels.iter().enumerate() {
                        let (x, y) = (region.x0 + k as u32 % region.width(), region.y0 + k as u32 / region.width());
                        let at = (y * w + x) as usize;
                        assert_eq!(pixel.map(f32::to_bits), all.pixels[at].map(f32::to_bits), "{x},{y} by {edge}");
                    }
                }
                assert_eq!(error, all.error, "{pass:?} by {edge}");
                if pass.detail == glance && edge % 8 == 0 {
                    assert_eq!(traced.camera, rays.camera, "nothing around a square is sampled for it");
                }
            }
        }
    }
}

/// Pieces of a region are worked on one after the other: what lies around each is another one's.
#[test]
fn a_region_of_several_pieces_is_that_of_its_tiles() {
    let (w, h) = (290, 261);
    let tracer = tracer(&fine::everything(3), (w, h));
    let (all, _) = tracer.render_pass(whole(tracer.settings()), within(4.0));
    let mut error = ErrorEstimate::default();
    for region in whole(tracer.settings()).blocks(100) {
        let (tile, _) = tracer.render_pass(region, within(4.0));
        error += tile.error;
        for (row, y) in tile.pixels.chunks_exact(region.width() as usize).zip(region.y0..) {
            let at = (y * w + region.x0) as usize;
            assert_eq!(row, &all.pixels[at..at + row.len()], "row {y} from {}", region.x0);
        }
    }
    assert_eq!(error, all.error);
}

#[test]
fn every_instruction_set_gives_the_same_pixels_and_errors() {
    for document in scenes() {
        let region = Region::new(0, 0, 60, 44).unwrap();
        type Bits = (Vec<[u32; 3]>, ErrorEstimate, RayCounts);
        let mut first: Option<Bits> = None;
        for level in Level::all() {
            let (tile, rays) = tracer(&document, (60, 44)).with_level(level).render_pass(region, within(1.0));
            let bits = tile.pixels.iter().map(|p| p.map(f32::to_bits)).collect();
            match &first {
                None => first = Some((bits, tile.error, rays)),
                Some((expected, error, counts)) => {
                    assert!(bits == *expected, "{level:?}");
                    assert_eq!(tile.error, *error, "{level:?}");
                    assert_eq!((rays.camera, rays.mirror, rays.shadow), (counts.camera, counts.mirror, counts.shadow));
                }
            }
        }
    }
}
