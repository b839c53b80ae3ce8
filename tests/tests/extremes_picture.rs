//! The extremes suite: pictures as pigments.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use glam::{DVec3, dvec3};
use tessera_core::scene::{Invalid, Orientation, Texture};
use tessera_core::settings::{Settings, View};
use tessera_tests::generate::{Document, Item, Look, Random, globe};
use tessera_tests::subject::{assert_right_under, colors, settings};

fn zoomed(plane_height: f64) -> Settings {
    Settings { view: View::new(63, 47, 1.0, plane_height).unwrap(), ..settings(63, 47) }
}

fn noise(width: u32, height: u32) -> Texture {
    let mut random = Random::new(63);
    let samples = (0..3 * width * height).map(|_| random.below(256) as u8).collect();
    Texture::from_bytes(width, height, 255, samples).unwrap()
}

fn pictured(eye: DVec3, target: DVec3, picture: Texture) -> Document {
    let mut d = Document::new(eye, target).with(Item::Light(eye)).with_background(0.5, 0.0, 0.5);
    d.textures.push(("p.ppm".into(), picture));
    d
}

fn ball(d: Document, center: DVec3, radius: f64, pole: DVec3, equator: DVec3) -> Document {
    d.with(Item::Sphere(center, radius, Some(Orientation { pole, equator }), Look::picture(0, 1.0, 0.0)))
}

#[test]
fn case_59_poles_and_seam() {
    // The middle pixel's ray strikes the pole itself; one row of texels is one colour there.
    for (eye, sky) in [(DVec3::Y * 4.0, DVec3::Z), (-DVec3::Y * 4.0, DVec3::X)] {
        let mut d = ball(pictured(eye, DVec3::ZERO, globe(96)), DVec3::ZERO, 1.0, DVec3::Y, DVec3::X);
        d.camera[1] = sky;
        for height in [1.0, 1e-3, 1e-14] {
            assert_right_under(&format!("case_59_pole_{height:e}"), &d, &zoomed(height));
        }
    }
    // The middle column runs along the seam; its neighbours are an ulp beside it.
    let d = ball(pictured(DVec3::X * 4.0, DVec3::ZERO, noise(16, 8)), DVec3::ZERO, 1.0, DVec3::Y, DVec3::X);
    for height in [1.0, 1e-6, 1e-15, 1e-17, 1e-300] {
        assert_right_under(&format!("case_59_seam_{height:e}"), &d, &zoomed(height));
    }
    let slanted = ball(
        pictured(dvec3(2.0, 1.0, 3.0), DVec3::ZERO, noise(16, 8)),
        DVec3::ZERO,
        1.0,
        dvec3(0.3, 1.0, -0.2) * 1e200,
        dvec3(2.0, 1.0, 3.0) * 1e-200,
    );
    for height in [1.0, 1e-9, 1e-16] {
        assert_right_under(&format!("case_59_slanted_{height:e}"), &slanted, &zoomed(height));
    }
}

#[test]
fn case_60_colatitude_1e_9() {
    // Around the pole every longitude within 4e-9 of it: acos would see one texel, atan2 sees all.
    let mut d = ball(pictured(DVec3::Y * 2.0, DVec3::ZERO, noise(16, 8)), DVec3::ZERO, 1.0, DVec3::Y, DVec3::X);
    d.camera[1] = DVec3::Z;
    // An even size: no ray strikes the pole itself, where longitude has no meaning.
    let view = Settings { view: View::new(64, 48, 1.0, 4e-9).unwrap(), ..settings(64, 48) };
    assert!(colors(&assert_right_under("case_60", &d, &view)) > 300);
}

#[test]
fn case_61_sphere_at_1e12() {
    let center = dvec3(1e12, -2e12, 5e12);
    for (radius, height) in [(1e11, 0.1), (1.0, 1e-12), (1e-3, 1e-15)] {
        let d = ball(pictured(DVec3::ZERO, center, noise(16, 8)), center, radius, dvec3(0.1, 1.0, 0.2), DVec3::X);
        assert!(colors(&assert_right_under(&format!("case_61_{radius:e}"), &d, &zoomed(height))) > 200);
    }
}

#[test]
fn case_62_pole_parallel_to_equator() {
    for (pole, equator) in
        [(DVec3::Y, DVec3::Y), (DVec3::Y, -DVec3::Y * 1e-200), (dvec3(0.1, 0.2, 0.3), dvec3(0.1, 0.2, 0.3) * 4.0)]
    {
        let d = ball(pictured(DVec3::X * 4.0, DVec3::ZERO, noise(4, 2)), DVec3::ZERO, 1.0, pole, equator);
        assert_eq!(d.scene().unwrap_err(), Invalid::OrientationParallel);
    }
    let d = ball(pictured(DVec3::X * 4.0, DVec3::ZERO, noise(4, 2)), DVec3::ZERO, 1.0, DVec3::ZERO, DVec3::X);
    assert_eq!(d.scene().unwrap_err(), Invalid::ZeroOrientation);
    // An equator an ulp from the pole is one.
    let d = ball(
        pictured(dvec3(1.0, 2.0, 4.0), DVec3::ZERO, noise(4, 2)),
        DVec3::ZERO,
        1.0,
        DVec3::Y,
        dvec3(1e-16, 1.0, 1e-300),
    );
    assert_right_under("case_62_nearly", &d, &zoomed(1.0));
}

#[test]
fn case_63_smallest_and_deepest_pictures() {
    let one = Texture::from_bytes(1, 1, 1, vec![1, 0, 1]).unwrap();
    let deep = Texture::from_words(2, 2, 65535, (0..12).map(|k| k * 5461).collect()).unwrap();
    let odd = Texture::from_words(3, 1, 1000, vec![0, 500, 1000, 1000, 500, 0, 250, 750, 10]).unwrap();
    for (name, picture) in [("one", one), ("deep", deep), ("odd", odd)] {
        let d = ball(pictured(dvec3(1.0, 2.0, -4.0), DVec3::ZERO, picture), DVec3::ZERO, 1.0, DVec3::Y, DVec3::X)
            .plane(dvec3(0.1, 1.0, 0.2), -1.5, Look::picture(0, 0.7, 0.3))
            .triangle(
                [dvec3(-3.0, -1.0, 1.0), dvec3(3.0, -1.0, 2.0), dvec3(0.0, 3.0, 1.5)],
                Look::picture(0, 0.8, 0.0),
            );
        assert_right_under(&format!("case_63_{name}"), &d, &zoomed(1.0));
    }
}

#[test]
fn pictures_on_planes_far_from_their_origin() {
    for offset in [1e6, 1e12, 1e15] {
        let d = pictured(dvec3(offset, 2.0, -offset), dvec3(offset + 1.0, 0.0, 4.0 - offset), noise(8, 8))
            .plane(DVec3::Y, 0.0, Look::picture(0, 1.0, 0.0))
            .light(offset, 50.0, -offset);
        assert_right_under(&format!("far_plane_{offset:e}"), &d, &zoomed(1.0));
    }
    let diagonal = pictured(dvec3(3.0, 4.0, -5.0), DVec3::ZERO, noise(8, 8))
        .plane(DVec3::ONE, -1.0, Look::picture(0, 0.5, 0.5))
        .plane_at(dvec3(-1.0, 1.0, 0.0), dvec3(4.0, -4.0, 0.3), Look::picture(0, 1.0, 0.0));
    assert_right_under("diagonal_plane", &diagonal, &zoomed(2.0));
}

#[test]
fn pictures_on_slivers_and_by_sides() {
    let d = pictured(dvec3(0.2, 0.3, -2.0), DVec3::ZERO, noise(8, 8))
        .triangle([dvec3(-1.0, 0.0, 0.0), dvec3(1.0, 0.0, 0.0), dvec3(0.3, 1e-9, 0.0)], Look::picture(0, 1.0, 0.0))
        .with(Item::TriangleSides(
            [dvec3(-1e15, 0.1, 0.2), dvec3(2e15, 0.0, 0.0), dvec3(1e15, 1.0, 0.3)],
            Look::picture(0, 1.0, 0.0),
        ));
    assert_right_under("slivers", &d, &zoomed(1.0));
    assert_right_under(
        "slivers_near",
        &d,
        &Settings { view: View::new(63, 47, 1.0, 1e-9).unwrap(), ..settings(63, 47) },
    );
}
