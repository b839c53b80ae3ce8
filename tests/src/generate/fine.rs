//! Scenes of detail at and below the size of a pixel: one kind of trouble for a sampler each.

use std::f64::consts::PI;

use glam::{DVec3, dvec3};

use super::{Document, Look, Random};

/// What a kind is called, and its scene of a seed for pictures so many pixels high.
pub type Kind = (&'static str, fn(u64, u32) -> Document);

/// Regular or thin things: nothing that a few looks at every pixel would find.
pub const FINE: [Kind; 17] = [
    ("plates", plates),
    ("slit", slit),
    ("fence", fence),
    ("grille", grille),
    ("paving", paving),
    ("ribbons", ribbons),
    ("threads", threads),
    ("threads under lights", threads_under_lights),
    ("dust", dust),
    ("powder", powder),
    ("ball", ball),
    ("shadows of ribbons", shadows_of_ribbons),
    ("boarded roof", boarded_roof),
    ("pinhole", pinhole),
    ("leaves", leaves),
    ("mirrored ribbons", mirrored_ribbons),
    ("lawn", lawn),
];

/// What people render.
pub const ORDINARY: [Kind; 4] = [("balls", balls), ("boxes", boxes), ("room", room), ("marbles", marbles)];

/// Edge of a pixel at distance 1.
fn pixel(height: u32) -> f64 {
    1.0 / f64::from(height)
}

/// A camera at the origin that looks along z.
fn front(level: f64) -> Document {
    Document::new(DVec3::ZERO, DVec3::Z).with_background(level, level, level)
}

fn floor(eye: DVec3) -> Document {
    Document::new(eye, DVec3::ZERO).plane(DVec3::Y, 0.0, Look::matte(0.75, 0.78, 0.72))
}

fn black() -> Look {
    Look::matte(0.0, 0.0, 0.0)
}

fn quad(d: Document, [a, b, c, e]: [DVec3; 4], look: Look) -> Document {
    d.triangle([a, b, c], look).triangle([a, c, e], look)
}

/// A strip of half width `w` at distance `z` before the camera, through `c` in direction `angle` of the image plane.
fn strip(d: Document, z: f64, (c, angle, w): ((f64, f64), f64, f64), look: Look) -> Document {
    let (s, t) = (libm::sin(angle), libm::cos(angle));
    let at = |a: f64, b: f64| dvec3((c.0 + a * t - b * s) * z, (c.1 + a * s + b * t) * z, z);
    quad(d, [at(-2.0, -w), at(2.0, -w), at(2.0, w), at(-2.0, w)], look)
}

/// Dark plates of one surface before a bright sky, with gaps of a thirtieth to a third of a pixel.
fn plates(seed: u64, height: u32) -> Document {
    let r = &mut Random::new(seed);
    let (gap, slope, z) = (pixel(height) * r.between(0.03, 0.3), r.between(-0.3, 0.3), r.between(2.0, 4.0));
    let step = r.between(0.27, 0.45);
    (0..9).fold(front(1.0), |d, i| {
        let (low, high) = (-1.6 + step * f64::from(i) + 0.5 * gap, -1.6 + step * f64::from(i + 1) - 0.5 * gap);
        let at = |x: f64, y: f64| dvec3(x * z, (y + slope * x) * z, z);
        quad(d, [at(-3.0, low), at(3.0, low), at(3.0, high), at(-3.0, high)], black())
    })
}

/// Two huge triangles of one surface with a slit between them.
fn slit(seed: u64, height: u32) -> Document {
    let r = &mut Random::new(seed);
    let (q, z) = (10.0 * pixel(height), 10.0);
    let (w, x) = (r.between(0.05, 0.25) * q, r.between(-3.0, 3.0) * q);
    front(1.0)
        .triangle([dvec3(-90.0, -90.0, z), dvec3(x - w, -90.0, z), dvec3(x - w, 180.0, z)], black())
        .triangle([dvec3(90.0, -90.0, z), dvec3(x + w, -90.0, z), dvec3(x + w, 180.0, z)], black())
}

fn bars(count: u32, slope: f64) -> Document {
    let (z, wide) = (4.0, 1.4);
    (0..count).fold(front(1.0), |d, i| {
        let (x, w) = (-0.7 + wide * f64::from(i) / f64::from(count), 0.5 * wide / f64::from(count));
        let at = |a: f64, y: f64| dvec3((a + slope * y) * z, y * z, z);
        quad(d, [at(x, -0.6), at(x + w, -0.6), at(x + w, 0.6), at(x, 0.6)], black())
    })
}

/// About two bars a pixel, nearly upright.
fn fence(seed: u64, height: u32) -> Document {
    let r = &mut Random::new(seed);
    bars((f64::from(height) * r.between(2.5, 3.3)) as u32, r.between(0.0, 0.12))
}

/// About nine.
fn grille(seed: u64, height: u32) -> Document {
    let r = &mut Random::new(seed);
    bars((f64::from(height) * r.between(10.0, 14.0)) as u32, r.between(0.0, 0.12))
}

/// A floor of dark tiles with bright joints, thin far off.
fn paving(seed: u64, _: u32) -> Document {
    let r = &mut Random::new(seed);
    let (edge, joint) = (r.between(0.9, 1.3), r.between(0.015, 0.04));
    let d = Document::new(dvec3(r.between(-0.5, 0.5), 2.4, -6.0), dvec3(0.2, 0.0, 2.0)).with_background(0.2, 0.35, 0.6);
    let d = d.plane(DVec3::Y, -0.01, Look::matte(0.9, 0.9, 0.85)).light(2.0, 9.0, -4.0);
    let look = Look::matte(0.2, 0.14, 0.13);
    (0..16 * 18).fold(d, |d, k| {
        let (x, z) = (f64::from(k % 16 - 8) * edge, f64::from(k / 16) * edge - 5.0);
        let at =
            |a: f64, b: f64| dvec3(x + joint + a * (edge - 2.0 * joint), 0.0, z + joint + b * (edge - 2.0 * joint));
        quad(d, [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)], look)
    })
}

/// Bright strips `width` pixels wide, under so many lights.
fn strips(seed: u64, height: u32, width: f64, lights: u32) -> Document {
    let r = &mut Random::new(seed);
    let d = (0..11).fold(front(0.0), |d, i| {
        let place = (r.between(-0.5, 0.5), r.between(-0.4, 0.4));
        strip(
            d,
            5.0 + 0.1 * f64::from(i),
            (place, r.between(0.0, PI), 0.5 * width * pixel(height)),
            Look::matte(1.0, 1.0, 1.0),
        )
    });
    (0..lights).fold(d, |d, _| d.light(0.0, 0.0, 0.0))
}

fn ribbons(seed: u64, height: u32) -> Document {
    strips(seed, height, 0.2, 1)
}

fn threads(seed: u64, height: u32) -> Document {
    strips(seed, height, 0.03, 1)
}

fn threads_under_lights(seed: u64, height: u32) -> Document {
    strips(seed, height, 0.003, 40)
}

/// So many balls of `radius` pixels in front of darkness.
fn balls_of(seed: u64, height: u32, (count, radius): (u32, f64)) -> Document {
    let r = &mut Random::new(seed);
    let d = (0..count).fold(front(0.0), |d, _| {
        let z = r.between(40.0, 90.0);
        let look = Look::matte(r.between(0.3, 1.0), r.between(0.3, 1.0), r.between(0.3, 1.0));
        d.sphere(dvec3(r.between(-0.67, 0.67) * z, r.between(-0.5, 0.5) * z, z), radius * pixel(height) * z, look)
    });
    d.light(0.0, 0.0, 0.0)
}

fn dust(seed: u64, height: u32) -> Document {
    balls_of(seed, height, (1500, 0.08))
}

fn powder(seed: u64, height: u32) -> Document {
    balls_of(seed, height, (25_000, 0.02))
}

/// One ball of about a pixel, lit from anywhere.
fn ball(seed: u64, height: u32) -> Document {
    let r = &mut Random::new(seed);
    let light = 1e4 * r.direction();
    let (x, y, radius) = (r.between(-0.03, 0.03), r.between(-0.03, 0.03), r.between(0.2, 0.6) * pixel(height));
    front(0.0)
        .sphere(10.0 * dvec3(x, y, 1.0), 10.0 * radius, Look::matte(1.0, 1.0, 1.0))
        .light(light.x, light.y, light.z)
}

/// Strips close to the light that throw thin shadows.
fn shadows_of_ribbons(seed: u64, height: u32) -> Document {
    let r = &mut Random::new(seed);
    let light = dvec3(r.between(-1.5, 1.5), 8.0, -2.5);
    let w = 0.5 * r.between(0.1, 0.35) * pixel(height) * 4.5;
    let d = floor(dvec3(0.0, 2.0, -4.0)).light(light.x, light.y, light.z);
    (0..9).fold(d, |d, i| {
        let (angle, x, z) = (r.between(0.0, PI), r.between(-1.5, 1.5), r.between(-1.0, 1.5));
        let (s, t) = (libm::sin(angle), libm::cos(angle));
        // Half way up to the light: twice as large on the floor.
        let at =
            |a: f64, b: f64| light + 0.5 * (dvec3(x + a * t - b * s, 0.01 * f64::from(i), z + a * s + b * t) - light);
        quad(d, [at(-3.0, -w), at(3.0, -w), at(3.0, w), at(-3.0, w)], Look::matte(1.0, 0.4, 0.3))
    })
}

/// Light through slits between boards.
fn boarded_roof(seed: u64, height: u32) -> Document {
    let r = &mut Random::new(seed);
    let (w, slope) = (r.between(0.2, 0.5) * pixel(height) * 4.5, r.between(-0.4, 0.4));
    let d = floor(dvec3(0.0, 2.0, -4.0)).light(0.2, 9.0, -1.0);
    (0..12).fold(d, |d, i| {
        let (a, b) = (-6.0 + f64::from(i), -5.0 + f64::from(i));
        let at = |x: f64, z: f64| dvec3(x + slope * z, 5.0, z);
        let corners = [at(a + 0.5 * w, -6.0), at(b - 0.5 * w, -6.0), at(b - 0.5 * w, 6.0), at(a + 0.5 * w, 6.0)];
        quad(d, corners, Look::matte(0.6, 0.5, 0.4))
    })
}

/// A spot of light through a hole between four plates.
fn pinhole(seed: u64, height: u32) -> Document {
    let r = &mut Random::new(seed);
    let (h, x, z) = (r.between(0.4, 1.2) * pixel(height) * 2.0, r.between(-0.5, 0.5), r.between(-0.5, 0.5));
    let at = |a: f64, b: f64| dvec3(a, 4.0, b);
    let d = floor(dvec3(0.0, 2.0, -4.0)).light(0.0, 8.0, 0.0);
    [
        [at(-9.0, -9.0), at(x - h, -9.0), at(x - h, 9.0), at(-9.0, 9.0)],
        [at(x + h, -9.0), at(9.0, -9.0), at(9.0, 9.0), at(x + h, 9.0)],
        [at(x - h, -9.0), at(x + h, -9.0), at(x + h, z - h), at(x - h, z - h)],
        [at(x - h, z + h), at(x + h, z + h), at(x + h, 9.0), at(x - h, 9.0)],
    ]
    .into_iter()
    .fold(d, |d, plate| quad(d, plate, Look::matte(0.5, 0.5, 0.5)))
}

/// Single triangles in the light.
fn leaves(seed: u64, _: u32) -> Document {
    let r = &mut Random::new(seed);
    let d = floor(dvec3(0.0, 2.0, -4.0)).light(0.4, 9.0, -1.0);
    (0..220).fold(d, |d, _| {
        let c = dvec3(r.between(-3.5, 3.5), r.between(4.0, 5.5), r.between(-3.0, 3.0));
        let corner = |r: &mut Random| c + 0.4 * r.cube();
        let corners = [corner(r), corner(r), corner(r)];
        d.triangle(corners, Look::matte(0.3, 0.7, 0.2))
    })
}

/// Strips and small balls, seen in a mirror ball and a mirror floor.
fn mirrored_ribbons(seed: u64, _: u32) -> Document {
    let r = &mut Random::new(seed);
    let w = r.between(0.02, 0.05);
    let d = Document::new(dvec3(0.0, 1.1, -4.0), dvec3(0.0, 0.8, 0.0)).light(0.0, 3.0, -4.5);
    let d = d.sphere(dvec3(0.0, 1.0, 0.0), 1.0, Look::mirror(1.0)).plane(DVec3::Y, 0.0, Look::mirror(0.8));
    let d = (0..12).fold(d, |d, _| {
        let (x, z, lean) = (r.between(-6.0, 6.0), -6.0 - r.between(0.0, 3.0), 8.0 * r.between(-0.5, 0.5));
        let at = |a: f64, y: f64| dvec3(x + a + lean * y / 8.0, y, z);
        quad(d, [at(-w, -3.0), at(w, -3.0), at(w, 8.0), at(-w, 8.0)], Look::matte(1.0, 1.0, 1.0))
    });
    (0..120).fold(d, |d, _| {
        let c = dvec3(r.between(-6.0, 6.0), r.between(0.0, 6.0), -6.0 - r.between(0.0, 3.0));
        d.sphere(c, w, Look::matte(0.5, 1.0, 0.5))
    })
}

/// Many balls on a plane, far off ones below a pixel.
fn lawn(seed: u64, _: u32) -> Document {
    let r = &mut Random::new(seed);
    let d = Document::new(dvec3(0.0, 1.2, -8.0), dvec3(0.0, 0.2, 4.0)).with_background(0.4, 0.6, 0.9);
    let d = d.plane(DVec3::Y, 0.0, Look::matte(0.3, 0.5, 0.2)).light(-9.0, 14.0, -9.0);
    (0..450).fold(d, |d, _| {
        let (x, z, k) = (r.between(-12.0, 12.0), r.between(-5.0, 40.0), r.between(0.03, 0.2));
        d.sphere(dvec3(x, k, z), k, Look::matte(r.between(0.3, 1.0), r.between(0.3, 1.0), 0.3))
    })
}

/// A cloud of balls under two lights.
fn balls(seed: u64, _: u32) -> Document {
    let r = &mut Random::new(seed);
    let d = Document::new(dvec3(0.02, 2.0, -6.0), DVec3::ZERO).with_background(0.1, 0.2, 0.4);
    let d = (0..300).fold(d, |d, _| d.sphere(2.0 * r.cube(), 0.2, Look::matte(0.3, 0.6, 0.5)));
    d.light(5.0, 8.0, -9.0).light(-4.0, 7.5, -3.0)
}

/// A box that stands at (x, z), `size` wide and `high`.
fn upright(d: Document, (x, z): (f64, f64), (size, high): (f64, f64), look: Look) -> Document {
    let at = |a: u8, b: u8, c: u8| dvec3(x + size * f64::from(a), high * f64::from(b), z + size * f64::from(c));
    [
        [at(0, 0, 0), at(1, 0, 0), at(1, 1, 0), at(0, 1, 0)],
        [at(0, 0, 1), at(1, 0, 1), at(1, 1, 1), at(0, 1, 1)],
        [at(0, 0, 0), at(0, 0, 1), at(0, 1, 1), at(0, 1, 0)],
        [at(1, 0, 0), at(1, 0, 1), at(1, 1, 1), at(1, 1, 0)],
        [at(0, 1, 0), at(1, 1, 0), at(1, 1, 1), at(0, 1, 1)],
    ]
    .into_iter()
    .fold(d, |d, side| quad(d, side, look))
}

/// A town of boxes on the ground.
fn boxes(seed: u64, _: u32) -> Document {
    let r = &mut Random::new(seed);
    let d = Document::new(dvec3(0.3, 5.0, -10.0), dvec3(0.0, 0.5, 0.0)).with_background(0.1, 0.2, 0.4);
    let d = d.plane(DVec3::Y, 0.0, Look::matte(0.4, 0.4, 0.4)).light(5.0, 8.0, -9.0).light(-4.3, 7.7, -3.1);
    (0..12 * 15).fold(d, |d, k| {
        let place = (f64::from(k % 12) - 6.0, f64::from(k / 12) - 4.0);
        upright(d, place, (0.8, r.between(0.3, 2.2)), Look::matte(0.7, 0.6, 0.5))
    })
}

/// A room with two blocks, its light below the ceiling.
fn room(seed: u64, _: u32) -> Document {
    let r = &mut Random::new(seed);
    let d = Document::new(dvec3(0.2, 2.3, -4.8), dvec3(0.0, 2.2, 0.0));
    let d = d.plane(DVec3::Y, 0.0, Look::matte(0.7, 0.7, 0.7)).plane(-DVec3::Y, -5.0, Look::matte(0.7, 0.7, 0.7));
    let d = d.plane(-DVec3::Z, -5.0, Look::matte(0.7, 0.7, 0.6)).plane(DVec3::X, -3.0, Look::matte(0.7, 0.2, 0.2));
    let d = d.plane(-DVec3::X, -3.0, Look::matte(0.2, 0.7, 0.2)).light(r.between(-1.0, 1.0), 4.6, r.between(-0.5, 1.0));
    let d = upright(d, (r.between(-1.8, -1.0), 1.0), (1.2, 2.4), Look::matte(0.7, 0.7, 0.75));
    upright(d, (r.between(0.2, 1.0), -0.5), (1.2, 1.2), Look::matte(0.75, 0.7, 0.7))
}

/// Mirroring balls on a floor.
fn marbles(seed: u64, _: u32) -> Document {
    let r = &mut Random::new(seed);
    let d = Document::new(dvec3(0.0, 3.0, -7.0), dvec3(0.0, 0.4, 0.0)).with_background(0.5, 0.65, 0.85);
    let d = d.plane(DVec3::Y, 0.0, Look::new(0.6, 0.6, 0.55, 0.9, 0.1)).light(-6.0, 8.0, -5.0).light(4.0, 9.0, -2.0);
    (0..25).fold(d, |d, _| {
        let k = r.between(0.2, 0.6);
        let look = Look::new(r.between(0.3, 1.0), r.between(0.3, 1.0), r.between(0.3, 1.0), 0.6, 0.4);
        d.sphere(dvec3(r.between(-3.5, 3.5), k, r.between(-3.0, 4.0)), k, look)
    })
}

/// Some of everything: ground, balls, boxes, leaves, strips and dust of all sizes down to far below a pixel, mirrors,
/// and one to three lights.
#[must_use]
pub fn everything(seed: u64) -> Document {
    let r = &mut Random::new(seed);
    let look = |r: &mut Random| {
        let [red, green, blue] = [(); 3].map(|()| r.between(0.1, 1.0));
        let reflect = if r.one_in(4) { r.between(0.1, 0.9) } else { 0.0 };
        Look::new(red, green, blue, 0.9 * (1.0 - reflect), reflect)
    };
    let eye = dvec3(r.between(-2.0, 2.0), r.between(0.8, 4.0), -7.0);
    let sky = [(); 3].map(|()| r.unit());
    let mut d = Document::new(eye, dvec3(0.0, 0.6, 0.0)).with_background(sky[0], sky[1], sky[2]);
    if !r.one_in(5) {
        d = d.plane(DVec3::Y, 0.0, look(r));
    }
    for _ in 0..1 + r.below(6) {
        let (place, size, look) =
            (dvec3(r.between(-3.0, 3.0), 0.0, r.between(-3.0, 5.0)), r.between(0.1, 0.8), look(r));
        let many = 1 + r.below(30);
        d = match r.below(6) {
            0 => d.sphere(place + DVec3::Y * size, size, look),
            1 => upright(d, (place.x, place.z), (size, 2.0 * size), look),
            // Leaves.
            2 => (0..many).fold(d, |d, _| {
                let c = dvec3(r.between(-3.0, 3.0), r.between(0.0, 4.0), r.between(-3.0, 3.0));
                d.triangle([c + size * r.cube(), c + size * r.cube(), c + size * r.cube()], look)
            }),
            // Strips that stand upright or lean.
            3 => (0..many).fold(d, |d, _| {
                let w = size * libm::exp(r.between(-6.0, -1.0));
                let (x, lean) = (place.x + r.between(-2.0, 2.0), r.between(-1.0, 1.0));
                let at = |a: f64, y: f64| dvec3(x + a + lean * y, y, place.z);
                quad(d, [at(-w, 0.0), at(w, 0.0), at(w, 3.0), at(-w, 3.0)], look)
            }),
            // Dust.
            4 => (0..10 * many).fold(d, |d, _| {
                let c = dvec3(r.between(-3.0, 3.0), r.between(0.0, 3.0), r.between(-3.0, 6.0));
                d.sphere(c, size * libm::exp(r.between(-5.0, -1.5)), look)
            }),
            // A fence.
            _ => (0..many).fold(d, |d, k| {
                let (x, w) = (place.x + 2.0 * k as f64 / many as f64, 0.6 / many as f64);
                let at = |a: f64, y: f64| dvec3(x + a, y, place.z);
                quad(d, [at(0.0, 0.0), at(w, 0.0), at(w, size), at(0.0, size)], look)
            }),
        };
    }
    (0..1 + r.below(3)).fold(d, |d, _| d.light(r.between(-8.0, 8.0), r.between(3.0, 12.0), r.between(-9.0, 4.0)))
}
