//! The extremes suite: the camera.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use glam::{DVec3, dvec3};
use tessera_core::scene::Invalid;
use tessera_core::settings::{Settings, View};
use tessera_tests::generate::extreme::basic;
use tessera_tests::generate::{Document, Item, Look, globe};
use tessera_tests::subject::{Subject, assert_right, assert_right_under, colors, settings};

#[test]
fn case_36_sky_almost_parallel_to_the_view() {
    let with_sky = |sky: DVec3| {
        let mut d = basic();
        d.camera[1] = sky;
        d
    };
    let view = basic().camera[2] - basic().camera[0];
    for parallel in [view, -view, view * 2f64.powi(-700), view * 3.0] {
        assert_eq!(with_sky(parallel).scene().unwrap_err(), Invalid::SkyParallel);
    }
    // At about 1e-15 of the view direction there is a frame, and it is the real one.
    for sky in [view + DVec3::X * 8e-15, view * 1e200 + DVec3::Y * 6e185, dvec3(view.x, view.y.next_up(), view.z)] {
        assert!(colors(&assert_right("case_36", &with_sky(sky))) > 100);
    }
}

#[test]
fn case_37_camera_without_a_direction() {
    let with = |location: DVec3, sky: DVec3, look_at: DVec3| {
        let mut d = basic();
        d.camera = [location, sky, look_at];
        d.scene().map(|_| ())
    };
    assert_eq!(with(DVec3::ONE, DVec3::Y, DVec3::ONE), Err(Invalid::NoView));
    assert_eq!(with(dvec3(0.0, 1.0, 1.0), DVec3::Y, dvec3(-0.0, 1.0, 1.0)), Err(Invalid::NoView));
    assert_eq!(with(DVec3::ONE, DVec3::ZERO, DVec3::ZERO), Err(Invalid::ZeroSky));
    assert_eq!(with(DVec3::ONE, dvec3(0.0, f64::NAN, 0.0), DVec3::ZERO), Err(Invalid::NotFinite));
    assert_eq!(with(DVec3::ONE, DVec3::Y, DVec3::ONE.map(f64::next_up)), Ok(()));
}

fn with_view(width: u32, height: u32, zoom: f64, plane_height: f64) -> Settings {
    Settings { view: View::new(width, height, zoom, plane_height).unwrap(), ..settings(width, height) }
}

#[test]
fn case_40_field_of_view_of_1e_12() {
    // A picture on a plane of which the whole view spans 1e-12: neighbours see different texels.
    let mut d = Document::new(dvec3(0.3, 0.4, -5.0), dvec3(0.3, 0.4, 0.0)).light(0.3, 0.4, -4.0);
    d.textures.push(("g.ppm".into(), globe(96)));
    let h = 3e-12;
    let d = d
        .triangle(
            [dvec3(0.3 - h, 0.4 - h, 0.0), dvec3(0.3 + 2.0 * h, 0.4 - h, 0.0), dvec3(0.3 - h, 0.4 + 2.0 * h, 0.0)],
            Look::picture(0, 1.0, 0.0),
        )
        .sphere(dvec3(0.3, 0.4, 1.0), 1e-12, Look::matte(1.0, 0.0, 0.0));
    for view in [with_view(64, 48, 1e12, 1.0), with_view(64, 48, 1.0, 1e-12)] {
        assert!(colors(&assert_right_under("case_40", &d, &view)) > 50);
    }
    // Rays that neighbour each other sweep a slanted plane monotonically: brightness falls with distance.
    let sweep = Document::new(dvec3(0.0, 0.0, -5.0), DVec3::ZERO)
        .plane(dvec3(0.0, 1.0, -1.0), 0.0, Look::matte(1.0, 1.0, 1.0))
        .with(Item::Light(dvec3(0.0, 1e-12, -1e-12)));
    assert_right_under("case_40_sweep", &sweep, &with_view(64, 48, 1e12, 1.0));
}

#[test]
fn case_41_zoom() {
    for zoom in [1e-12, 1e-300, 1e300] {
        assert_right_under(&format!("case_41_{zoom:e}"), &basic(), &with_view(64, 48, zoom, 1.0));
    }
    for bad in [0.0, -0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(View::new(64, 48, bad, 1.0).is_err(), "zoom {bad}");
        assert!(View::new(64, 48, 1.0, bad).is_err(), "plane height {bad}");
    }
}

#[test]
fn case_42_symmetric_scene() {
    let mut d = Document::new(dvec3(0.0, 1.7, -6.0), dvec3(0.0, 0.9, 0.0))
        .with_background(0.1, 0.2, 0.4)
        .plane(DVec3::Y, 0.0, Look::new(0.8, 0.7, 0.6, 0.7, 0.3))
        .sphere(dvec3(0.0, 2.3, 1.1), 0.7, Look::new(0.9, 0.9, 0.9, 0.2, 0.8));
    for sign in [1.0, -1.0] {
        d = d
            .sphere(dvec3(1.3 * sign, 1.1, 0.4), 1.1, Look::new(0.9, 0.5, 0.3, 0.5, 0.5))
            .triangle(
                [dvec3(0.3 * sign, 0.1, -1.0), dvec3(2.7 * sign, 0.2, -0.4), dvec3(1.9 * sign, 1.3, -0.7)],
                Look::new(0.3, 0.8, 0.4, 0.6, 0.4),
            )
            .light(3.7 * sign, 5.3, -4.1);
    }
    for (w, h) in [(64, 48), (63, 31)] {
        let picture = Subject::new(&d).render(&settings(w, h));
        for y in 0..picture.height {
            for x in 0..picture.width / 2 {
                let (a, b) = (picture.pixels[y * picture.width + x], picture.pixels[(y + 1) * picture.width - 1 - x]);
                assert_eq!(a, b, "({x}, {y}) of {w}x{h}");
            }
        }
    }
}

#[test]
fn case_43_odd_sizes() {
    for (w, h) in [(1, 1), (1, 40), (40, 1), (3, 2)] {
        assert_right_under(&format!("case_43_{w}x{h}"), &basic(), &settings(w, h));
    }
    let max = View::MAX_EDGE;
    for (w, h) in [(0, 1), (1, 0), (max + 1, 1), (1, u32::MAX), (u32::MAX, u32::MAX)] {
        assert!(View::new(w, h, 1.0, 1.0).is_err(), "{w}x{h}");
    }
}

#[test]
fn seen_from_inside_everything() {
    // The eye in a sphere in a sphere, all mirrors, over its own shadow.
    let d = Document::new(dvec3(0.1, 0.2, 0.3), dvec3(0.3, 0.1, 2.0))
        .sphere(DVec3::ZERO, 2.0, Look::new(0.9, 0.6, 0.3, 0.5, 0.5))
        .sphere(DVec3::ZERO, 3.0, Look::new(0.3, 0.6, 0.9, 0.5, 0.5))
        .sphere(dvec3(0.5, 0.5, 1.0), 0.4, Look::new(0.5, 0.9, 0.5, 0.5, 0.5))
        .light(-0.5, 1.0, 0.0)
        .light(0.0, 2.5, 0.0);
    assert_right("inside", &d);
}
