//! Scenes at the limits of numbers.

use glam::{DVec3, dvec3};

use tessera_core::scene::{Orientation, Texture};
use tessera_core::settings::{Sampling, Settings, Transfer, View};

use super::{Document, Item, Look, Random};

/// One of everything, with coordinates that are multiples of 2^-10: a mirror sphere on a
/// plane, a matte one, two triangles, two lights.
#[must_use]
pub fn basic() -> Document {
    Document::new(dvec3(0.5, 2.0, -6.0), dvec3(0.0, 0.75, 0.0))
        .with_background(0.1, 0.2, 0.4)
        .plane_at(DVec3::Y, DVec3::ZERO, Look::new(0.8, 0.7, 0.6, 0.7, 0.25))
        .sphere(dvec3(-1.25, 1.0, 0.5), 1.0, Look::new(0.9, 0.9, 0.9, 0.1, 0.8))
        .sphere(dvec3(1.25, 0.625, -0.5), 0.625, Look::matte(0.9, 0.3, 0.2))
        .triangle(
            [dvec3(-3.0, 0.0, 3.0), dvec3(3.5, 0.25, 3.5), dvec3(0.25, 4.0, 2.75)],
            Look::new(0.4, 0.8, 0.5, 0.6, 0.3),
        )
        .with(Item::TriangleSides(
            [dvec3(2.0, 0.125, 1.0), dvec3(1.0, 0.0, 0.5), dvec3(0.125, 2.0, 0.25)],
            Look::matte(0.3, 0.4, 0.9),
        ))
        .light(-4.0, 6.0, -5.0)
        .light(3.0, 5.0, -2.0)
}

fn pick<T: Copy>(random: &mut Random, all: &[T]) -> T {
    all[random.below(all.len() as u64) as usize]
}

fn look(random: &mut Random) -> Look {
    let [r, g, b] = [(); 3].map(|()| random.between(0.2, 1.0));
    match random.below(6) {
        0 => Look::picture(0, 0.7, 0.3),
        1 => Look::new(r, g, b, 0.1, 0.9),
        2 | 3 => Look::new(r, g, b, 0.6, 0.4),
        _ => Look::matte(r, g, b),
    }
}

/// How wide a gap is where things should touch.
fn gap(random: &mut Random) -> f64 {
    pick(random, &[0.0, 1e-6, 1e-9, 1e-12, 1e-14])
}

/// The ground: a plane, or a sphere that is one almost, or two triangles.
fn on_ground(r: &mut Random, mut d: Document) -> Document {
    let ground = look(r);
    d = match r.below(4) {
        0 => {
            let radius = 10f64.powi(2 + r.below(12) as i32);
            d.sphere(dvec3(0.0, -radius, 0.0), radius, ground)
        }
        1 => {
            let [a, b, c, e] = [(-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0)].map(|(x, z)| dvec3(x, 0.0, z));
            d.triangle([a, b, c], ground).triangle([a, c, e], ground)
        }
        _ => d.plane(DVec3::Y * 2f64.powi(r.below(40) as i32 - 20), 0.0, ground),
    };
    if r.one_in(4) {
        // The same ground again, or almost.
        d = d.plane(-DVec3::Y, pick(r, &[0.0, 1e-13, -1e-13, 1e-300]), look(r));
    }
    d
}

/// One more object on the ground, or close to it.
fn with_object(r: &mut Random, d: Document) -> Document {
    let (x, z) = (r.between(-1.2, 1.2), r.between(-1.2, 1.2));
    let look = look(r);
    match r.below(6) {
        // A sphere resting on the ground.
        0 | 1 => {
            let radius = pick(r, &[0.5, 0.3, 0.8, 1e-2, 1e-4]);
            d.sphere(dvec3(x, radius + gap(r), z), radius, look)
        }
        2 => {
            let orientation = Orientation { pole: r.direction(), equator: r.direction() };
            d.with(Item::Sphere(dvec3(x, 0.7, z), 0.4, Some(orientation), look))
        }
        // A leaf on the ground, or a hair above.
        3 => {
            let y = gap(r);
            d.triangle([dvec3(x - 0.5, y, z - 0.4), dvec3(x + 0.6, y, z - 0.3), dvec3(x, y, z + 0.5)], look)
        }
        // A sliver.
        4 => {
            let (a, u) = (dvec3(x - 0.5, 0.1, z), dvec3(1.0, r.between(0.0, 0.5), 0.2));
            let thin = 10f64.powi(-(r.below(12) as i32));
            d.with(Item::TriangleSides([a, u, u * 0.5 + DVec3::Y * thin], look))
        }
        // A wall.
        _ => {
            let at = dvec3(x, 0.0, z + 1.0);
            d.triangle([at - DVec3::X * 1.5, at + DVec3::X * 1.5, at + dvec3(r.between(-1.0, 1.0), 2.0, 0.3)], look)
        }
    }
}

/// A light as near to the ground as 1e-12, or as far as 1e30.
fn light(r: &mut Random) -> DVec3 {
    let over = dvec3(r.between(-1.0, 1.0), 0.0, r.between(-1.5, 0.5));
    match r.below(5) {
        0 => over + DVec3::Y * pick(r, &[1e-12, 1e-9, 1e-6, 1e-2]),
        1 => (r.direction() + DVec3::Y) * pick(r, &[1e6, 1e12, 1e30]),
        _ => over * 3.0 + DVec3::Y * r.between(1.0, 6.0),
    }
}

/// All of it at another scale, or elsewhere.
fn scaled_or_moved(r: &mut Random, d: Document) -> Document {
    match r.below(4) {
        0 => d.scaled(2f64.powi(r.below(1801) as i32 - 900)),
        1 => {
            // Near 2^40 where coordinates round, or where they do not.
            let offset = r.direction() * 2f64.powi(20 + r.below(21) as i32);
            d.moved(if r.one_in(2) { offset.round() } else { offset })
        }
        2 => d.scaled(10f64.powi(r.below(61) as i32 - 30)),
        _ => d,
    }
}

/// A random scene at the limits: contacts and gaps down to 1e-14, lights as near and as far as
/// 1e30, tiny things before huge ones, slivers, mirrors, telescopes, then all of it scaled by
/// up to 2^±900 or moved by up to 2^40. Equal seeds give equal scenes.
#[must_use]
pub fn random(seed: u64, width: u32, height: u32) -> (Document, Settings) {
    let r = &mut Random::new(seed);
    let mut noise = Random::new(9);
    let texels = (0..3 * 16 * 8).map(|_| noise.below(256) as u8).collect();
    let picture = Texture::from_bytes(16, 8, 255, texels).unwrap_or_else(|e| unreachable!("{e}"));

    // A telescope: so far away, and so much closer again by zoom.
    let away = if r.one_in(3) { 10f64.powi(r.below(10) as i32) } else { 1.0 };
    let target = dvec3(r.between(-0.3, 0.3), r.between(0.2, 0.9), r.between(-0.3, 0.3));
    let towards = dvec3(r.between(-1.0, 1.0), r.between(0.02, 0.8), -1.0).normalize();
    let mut eye = target + towards * 4.0 * away;
    if r.one_in(8) {
        // On the ground itself, or a hair above it.
        eye = dvec3(0.3, gap(r), -3.0);
    }
    let mut d = Document::new(eye, target).with_background(0.2, 0.3, 0.5);
    d.textures.push(("p.ppm".into(), picture));
    if r.one_in(3) {
        d.camera[1] = r.direction() + DVec3::Y;
    }

    d = on_ground(r, d);
    for _ in 0..2 + r.below(4) {
        d = with_object(r, d);
    }
    for _ in 0..1 + r.below(2) {
        d = d.with(Item::Light(light(r)));
    }
    d = scaled_or_moved(r, d);
    let settings = Settings {
        view: View::new(width, height, away, 1.0).unwrap_or_else(|e| unreachable!("{e}")),
        max_depth: pick(r, &[1, 3, 6, 12]),
        sampling: Sampling::Uniform { grid: 1 },
        transfer: if r.one_in(2) { Transfer::Linear } else { Transfer::Srgb },
    };
    (d, settings)
}

/// A random scene on a coarse grid, seen along an axis by a picture whose rays are dyadic:
/// tangents, edges, vertices, coplanar faces and grazed shadows are met exactly, over and over.
#[must_use]
pub fn snapped(seed: u64) -> (Document, Settings) {
    let r = &mut Random::new(seed ^ 0x5eed);
    let grid = |r: &mut Random, lo: i32, hi: i32| f64::from(lo + r.below((hi - lo + 1) as u64) as i32) / 4.0;
    let place = |r: &mut Random| dvec3(grid(r, -6, 6), grid(r, -6, 6), grid(r, -2, 8));
    let eye = dvec3(grid(r, -2, 2), grid(r, -2, 2), -4.0);
    let ahead = pick(r, &[DVec3::Z, DVec3::Z * 4.0, dvec3(0.0, -3.0, 4.0), dvec3(3.0, 0.0, 4.0)]);
    let mut d = Document::new(eye, eye + ahead).with_background(0.2, 0.3, 0.5);
    for _ in 0..3 + r.below(5) {
        let look = match look(r) {
            Look { paint: super::Paint::Texture(_), .. } => Look::new(0.7, 0.6, 0.5, 0.5, 0.5),
            look => look,
        };
        let p = place(r);
        d = match r.below(6) {
            0 | 1 => d.sphere(p, pick(r, &[0.25, 0.5, 1.0, 1.25]), look),
            2 => {
                let n =
                    pick(r, &[DVec3::X, DVec3::Y, DVec3::Z, -DVec3::Y, dvec3(0.0, 3.0, -4.0), dvec3(1.0, 1.0, 0.0)]);
                d.plane_at(n, p * 2.0, look)
            }
            3 => {
                // A square of two triangles, and perhaps the same again from the other side.
                let (u, v) = (
                    pick(r, &[DVec3::X, DVec3::Y, dvec3(1.0, 0.0, 1.0)]),
                    pick(r, &[DVec3::Z, DVec3::Y * 2.0, -DVec3::X]),
                );
                let [a, b, c, e] = [p, p + u, p + u + v, p + v];
                let d = d.triangle([a, b, c], look).triangle([a, c, e], look);
                if r.one_in(2) { d.triangle([c, b, a], Look::matte(0.9, 0.1, 0.1)) } else { d }
            }
            4 => d.triangle([p, place(r), place(r)], look),
            _ => {
                // A fan around a vertex.
                let rim = [DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y].map(|v| p + v + DVec3::Z * 0.25);
                (0..4).fold(d, |d, k| d.triangle([p, rim[k], rim[(k + 1) % 4]], look))
            }
        };
    }
    for _ in 0..1 + r.below(3) {
        let p = place(r) * 2.0;
        d = d.with(Item::Light(p));
    }
    let settings = Settings {
        view: View::new(32, 32, 1.0, pick(r, &[1.0, 2.0])).unwrap_or_else(|e| unreachable!("{e}")),
        max_depth: pick(r, &[2, 4, 8]),
        sampling: Sampling::Uniform { grid: 1 },
        transfer: Transfer::Linear,
    };
    // Odd sizes send rays along the axis itself.
    let odd = View::new(31, 31, 1.0, 31.0 / 32.0).unwrap_or_else(|e| unreachable!("{e}"));
    (d, if r.one_in(2) { settings } else { Settings { view: odd, ..settings } })
}
