//! Scenes where things touch, graze or differ by more than numbers like: one kind of trouble a seed.

use glam::{DVec3, dvec3};

use tessera_core::scene::{Orientation, Texture};
use tessera_core::settings::{Sampling, Settings, Transfer, View};

use super::{Document, Item, Look, Random};

/// How many kinds there are; seed % KINDS is a scene's kind.
pub const KINDS: u64 = 12;
/// The kind whose sizes are the furthest apart.
pub const SIZES: u64 = 10;

fn pick<T: Copy>(r: &mut Random, all: &[T]) -> T {
    all[r.below(all.len() as u64) as usize]
}

fn matte(r: &mut Random) -> Look {
    Look::matte(r.between(0.2, 1.0), r.between(0.2, 1.0), r.between(0.2, 1.0))
}

fn shiny(r: &mut Random) -> Look {
    let reflect = r.between(0.2, 0.9);
    Look::new(r.between(0.3, 1.0), r.between(0.3, 1.0), r.between(0.3, 1.0), 1.0 - reflect, reflect)
}

fn any(r: &mut Random) -> Look {
    if r.one_in(2) { matte(r) } else { shiny(r) }
}

/// 10^−k, k from `a` to `b`.
fn tiny(r: &mut Random, a: u32, b: u32) -> f64 {
    10f64.powi(-((a + r.below(u64::from(b - a + 1)) as u32) as i32))
}

/// Marbles at rest on a sphere so large that it is a plane almost.
fn marbles(r: &mut Random) -> Document {
    let radius = 10f64.powi(3 + r.below(9) as i32);
    let eye = dvec3(r.between(-1.0, 1.0), r.between(0.3, 1.5), -3.0);
    let mut d = Document::new(eye, DVec3::Y * 0.2).sphere(DVec3::NEG_Y * radius, radius, any(r));
    for k in 0..5 {
        let size = pick(r, &[0.3, 0.1, 0.02, 1e-3, 1e-6]);
        let (x, z) = if k == 0 { (0.0, 0.0) } else { (r.between(-1.0, 1.0), r.between(-1.0, 1.0)) };
        // Its centre on the line from the great one's, as near as f64 can write it.
        let up = dvec3(x, 0.0, z) - DVec3::NEG_Y * radius;
        let center = DVec3::NEG_Y * radius + up.normalize() * (radius + size);
        d = d.sphere(center, size, any(r));
    }
    d.light(r.between(-3.0, 3.0), 4.0, -3.0).light(0.0, tiny(r, 3, 12), -0.7)
}

/// Sheets above one another by gaps that hardly are.
fn sheets(r: &mut Random) -> Document {
    let mut d = Document::new(dvec3(0.2, 1.3, -2.5), DVec3::ZERO).plane(DVec3::Y, 0.0, any(r));
    let mut y = 0.0;
    for k in 0..5 {
        y += tiny(r, 4, 14);
        let at = dvec3(r.between(-0.6, 0.6), y, r.between(-0.5, 0.8));
        let [a, b, c, e] = [(-0.6, -0.5), (0.6, -0.4), (0.5, 0.5), (-0.5, 0.6)].map(|(x, z)| at + dvec3(x, 0.0, z));
        let look = any(r);
        d = d.triangle([a, b, c], look).triangle(if k % 2 == 0 { [a, c, e] } else { [e, c, a] }, look);
    }
    d.light(0.3, y * 0.5, 0.1).light(-1.0, 2.0, -1.5).light(0.0, y + tiny(r, 6, 13), 0.0)
}

/// Seen and lit along the ground.
fn grazing(r: &mut Random) -> Document {
    let h = tiny(r, 2, 13);
    let mut d = Document::new(dvec3(0.0, h, -2.0), dvec3(0.0, h * r.between(0.0, 2.0), 0.0)).plane_at(
        DVec3::Y,
        DVec3::ZERO,
        any(r),
    );
    for _ in 0..4 {
        let size = pick(r, &[0.5, 0.1, h]);
        d = d.sphere(dvec3(r.between(-1.0, 1.0), size * r.between(0.0, 1.0), r.between(-1.0, 2.0)), size, any(r));
    }
    let a = dvec3(r.between(-1.0, 0.0), 0.0, 1.0);
    d.triangle([a, a + DVec3::X, a + dvec3(0.3, h * 2.0, 1.0)], any(r))
        .light(-5.0, tiny(r, 1, 12), -1.0)
        .light(2.0, h, 3.0)
}

/// A fan of slivers around a hub, and its mirror image.
fn slivers(r: &mut Random) -> Document {
    let hub = dvec3(r.between(-0.2, 0.2), 0.6, 0.0);
    let mut d = Document::new(dvec3(0.1, 0.9, -2.4), hub).plane(DVec3::Y, 0.0, any(r));
    let thin = tiny(r, 1, 13);
    let rim = |a: f64| hub + dvec3(libm::cos(a), libm::sin(a), 0.1 * libm::sin(3.0 * a)) * 0.9;
    let mut a = 0.0;
    while a < 6.0 {
        let step = if r.one_in(2) { thin } else { r.between(0.2, 0.6) };
        d = d.triangle([hub, rim(a), rim(a + step)], any(r));
        a += step;
    }
    d.plane(DVec3::Z, 1.5, Look::mirror(0.8)).light(1.0, 2.5, -2.0).light(0.0, 0.6, -tiny(r, 2, 10))
}

/// Lights a hair above what they light.
fn lamps(r: &mut Random) -> Document {
    let mut d = Document::new(dvec3(0.3, 1.4, -2.6), dvec3(0.0, 0.3, 0.0)).plane(DVec3::Y, 0.0, any(r));
    for _ in 0..3 {
        let size = r.between(0.2, 0.5);
        let center = dvec3(r.between(-1.0, 1.0), size + tiny(r, 9, 15), r.between(-0.6, 1.0));
        d = d.sphere(center, size, any(r));
        let n = (r.direction() + dvec3(0.0, 0.6, -0.6)).normalize();
        d = d.with(Item::Light(center + n * (size + pick(r, &[1e-12, 1e-9, 1e-4, -1e-12, 0.0]))));
    }
    let wall = [dvec3(-1.4, 0.0, 1.2), dvec3(1.4, 0.0, 1.5), dvec3(0.0, 2.0, 1.3)];
    let n = (wall[1] - wall[0]).cross(wall[2] - wall[0]).normalize();
    let middle = (wall[0] + wall[1] + wall[2]) / 3.0;
    d.triangle(wall, any(r)).with(Item::Light(middle + n * pick(r, &[1e-12, -1e-12, 1e-8, -1e-8])))
}

/// Mirror balls that touch.
fn kissing(r: &mut Random) -> Document {
    let mut d = Document::new(dvec3(0.0, 0.7, -3.0), dvec3(0.0, 0.4, 0.0)).with_background(0.3, 0.4, 0.6);
    d = d.plane(DVec3::Y, 0.0, any(r));
    let mut last = (dvec3(-0.6, 0.4, 0.0), 0.4);
    for _ in 0..6 {
        d = d.sphere(last.0, last.1, Look::new(0.9, 0.8, 0.7, 0.2, 0.8));
        let size = pick(r, &[0.4, 0.25, 0.1, 0.01]);
        let n = (r.direction() + DVec3::X * 0.4).normalize();
        last = (last.0 + n * (last.1 + size) * pick(r, &[1.0, 1.0 + 1e-12, 1.0 - 1e-12]), size);
    }
    d.light(1.5, 3.0, -2.0)
}

/// Pictures seen at their poles and seams, on far spheres and thin triangles.
fn poles(r: &mut Random) -> Document {
    let pole = pick(r, &[DVec3::NEG_Z, DVec3::Z, dvec3(0.0, 1e-9, -1.0), dvec3(1.0, 1.0, -1.0)]);
    let equator = pick(r, &[DVec3::X, DVec3::Y, dvec3(1.0, 1e-12, -1.0)]);
    let away = pick(r, &[1.0, 1.0, 1e6, 1e12]);
    let mut d = Document::new(dvec3(0.0, 0.0, -2.0 * away), DVec3::ZERO);
    d.textures.push(("p.ppm".into(), noise()));
    d = d.with(Item::Sphere(DVec3::ZERO, 0.7 * away, Some(Orientation { pole, equator }), Look::picture(0, 0.8, 0.2)));
    let leaf = [dvec3(-0.9, -0.8, -0.6), dvec3(0.9, -0.8, -0.6), dvec3(0.0, -0.8 + tiny(r, 1, 8), 0.4)];
    d = d.triangle(leaf.map(|v| v * away), Look::picture(0, 1.0, 0.0));
    d.plane_at(dvec3(0.0, 1.0, -1.0) * 1e3, dvec3(0.0, -1.0, 2.0) * away, Look::picture(0, 0.7, 0.0))
        .with(Item::Light(dvec3(-1.0, 2.0, -3.0) * away))
}

/// From inside: the eye and a light at the centre or at the skin.
fn inside(r: &mut Random) -> Document {
    let size = pick(r, &[1.0, 3.0]);
    let eye =
        pick(r, &[DVec3::ZERO, DVec3::NEG_Z * size, dvec3(0.0, 0.0, -size * (1.0 - 1e-12)), dvec3(0.3, 0.2, 0.1)]);
    let mut d = Document::new(eye, dvec3(0.1, 0.05, size * 0.9)).sphere(DVec3::ZERO, size, shiny(r));
    for _ in 0..3 {
        let n = r.direction();
        let small = pick(r, &[0.2, 0.05]) * size;
        // Touching the skin from inside.
        d = d.sphere(n * (size - small), small, any(r));
    }
    d.with(Item::Light(pick(r, &[DVec3::ZERO, dvec3(0.1, 0.3, -0.2), dvec3(0.0, size * (1.0 - 1e-12), 0.0)])))
}

/// Everything twice, exactly or almost.
fn doubles(r: &mut Random) -> Document {
    let mut d = Document::new(dvec3(0.2, 1.0, -3.0), dvec3(0.0, 0.4, 0.0));
    for (n, k) in [(DVec3::Y, 1.0), (DVec3::NEG_Y, 3.0), (DVec3::Y, 7.0)] {
        d = d.plane_at(n * k, dvec3(r.between(-1.0, 1.0), 0.0, 0.0), any(r));
    }
    let center = dvec3(-0.5, 0.5, 0.0);
    for size in [0.5, 0.5f64.next_down(), 0.5, 0.5f64.next_up()] {
        d = d.sphere(center, size, if r.one_in(3) { Look::mirror(0.7) } else { any(r) });
    }
    let leaf = [dvec3(0.1, 0.0, 0.4), dvec3(1.2, 0.1, -0.2), dvec3(0.6, 1.2, 0.3)];
    for k in 0..3 {
        d = d.triangle([leaf[k], leaf[(k + 1) % 3], leaf[(k + 2) % 3]], any(r));
    }
    d.triangle(leaf.map(|v| v + DVec3::Z * tiny(r, 12, 16)), any(r)).light(-1.0, 3.0, -2.0).light(0.5, 0.5, -1.0)
}

/// A room of triangles that share edges, mirrored or not, its corners in sight.
fn room(r: &mut Random) -> Document {
    let mut d = Document::new(dvec3(-0.4, 0.1, -0.7), dvec3(0.9, 0.8, 0.9));
    let corner = |k: usize| {
        let sign = |b: usize| if k >> b & 1 == 1 { 1.0 } else { -1.0 };
        dvec3(sign(0), sign(1), sign(2))
    };
    for face in [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]] {
        let look = if r.one_in(2) { Look::new(0.9, 0.9, 0.8, 0.4, 0.6) } else { matte(r) };
        let [a, b, c, e] = face.map(corner);
        d = d.triangle([a, b, c], look).triangle([a, c, e], look);
    }
    d.sphere(dvec3(0.5, 0.5, 0.5), 0.5, Look::new(0.9, 0.5, 0.4, 0.3, 0.7)).light(-0.2, 0.3, -0.4).light(
        0.0,
        1.0 - tiny(r, 3, 12),
        0.0,
    )
}

/// The smallest before the largest.
fn sizes(r: &mut Random) -> Document {
    let s = 10f64.powi(-(r.below(150) as i32));
    let huge = 10f64.powi(r.below(150) as i32);
    let mut d = Document::new(DVec3::ZERO, DVec3::Z * s).with_background(0.1, 0.1, 0.2);
    for _ in 0..3 {
        d = d.sphere(dvec3(r.between(-3.0, 3.0), r.between(-2.0, 2.0), 8.0) * s, s, shiny(r));
    }
    let far = dvec3(r.between(-3.0, 3.0), r.between(-2.0, 2.0), 10.0) * huge;
    d.sphere(far, 3.0 * huge, any(r))
        .triangle([dvec3(-1.0, -1.0, 20.0) * s, dvec3(1.0, -1.0, 20.0) * huge, dvec3(-s, huge, 20.0 * huge)], any(r))
        .with(Item::Light(dvec3(-1.0, 1.0, -1.0) * pick(r, &[s, 1.0, huge])))
        .with(Item::Light(dvec3(1.0, 2.0, 7.0) * s))
}

/// A box on a slab, shadows meeting at the edges where they stand.
fn steps(r: &mut Random) -> Document {
    let mut d = Document::new(dvec3(1.5, 1.6, -2.5), dvec3(0.0, 0.4, 0.0)).plane_at(DVec3::Y, DVec3::ZERO, any(r));
    let mut y = 0.0;
    for _ in 0..3 {
        let (w, h) = (r.between(0.2, 0.9), pick(r, &[0.4, 0.1, 1e-3, 1e-9]));
        let corner = |k: usize| {
            let on = |b: usize| if k >> b & 1 == 1 { 1.0 } else { 0.0 };
            dvec3(w * (2.0 * on(0) - 1.0), y + h * on(1), w * (2.0 * on(2) - 1.0))
        };
        let look = any(r);
        for face in [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]] {
            let [a, b, c, e] = face.map(corner);
            d = d.triangle([a, b, c], look).triangle([a, c, e], look);
        }
        y += h;
    }
    d.sphere(dvec3(0.0, y + 0.3, 0.0), 0.3, shiny(r)).light(-2.0, 3.0, -1.0).light(0.5, y, -3.0)
}

fn noise() -> Texture {
    let mut noise = Random::new(5);
    let texels = (0..3 * 32 * 16).map(|_| noise.below(256) as u8).collect();
    Texture::from_bytes(32, 16, 255, texels).unwrap_or_else(|e| unreachable!("{e}"))
}

/// The scene of a seed and its settings. Every other scene is as it was thought of; the others are
/// scaled by up to 2^±900 or moved by up to 2^40.
#[must_use]
pub fn contact(seed: u64, width: u32, height: u32) -> (Document, Settings) {
    let r = &mut Random::new(seed ^ 0xc0_17ac);
    let kind = seed % KINDS;
    let makers = [marbles, sheets, grazing, slivers, lamps, kissing, poles, inside, doubles, room, sizes, steps];
    let mut d = makers[kind as usize](r);
    // 10^100 by 2^900 would overflow.
    let most = if kind == SIZES { 300 } else { 900 };
    match r.below(6) {
        0 => d = d.scaled(2f64.powi(r.below(2 * most + 1) as i32 - most as i32)),
        1 if most == 900 => d = d.moved(r.direction() * 2f64.powi(r.below(41) as i32)),
        2 => d = d.scaled(pick(r, &[1e-30, 1e30, 0.1, 3.0])),
        _ => {}
    }
    let settings = Settings {
        view: View::new(width, height, 1.0, 1.0).unwrap_or_else(|e| unreachable!("{e}")),
        max_depth: pick(r, &[2, 4, 8]),
        sampling: Sampling::Uniform { grid: 1 },
        transfer: Transfer::Linear,
    };
    (d, settings)
}
