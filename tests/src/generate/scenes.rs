//! Ordinary scenes, of any size: what benchmarks and demonstrations show.

use std::f64::consts::TAU;

use glam::{DVec3, dvec3};
use tessera_core::scene::{Orientation, Texture};

use super::{Document, Item, Look, Mesh, Random, knot};

/// A graticule over blobs of land, `width` × `width`/2 pixels.
#[must_use]
pub fn globe(width: u32) -> Texture {
    let height = width / 2;
    let mut random = Random::new(7);
    let blobs: Vec<(DVec3, f64)> = (0..60)
        .map(|_| {
            let (lon, lat, size) = (random.between(0.0, TAU), random.between(-1.2, 1.2), random.between(0.08, 0.36));
            (on_globe(lon, lat), libm::cos(size))
        })
        .collect();
    let mut samples = Vec::with_capacity(3 * (width * height) as usize);
    for j in 0..height {
        let lat = TAU / 2.0 * (0.5 - (f64::from(j) + 0.5) / f64::from(height));
        for i in 0..width {
            let p = on_globe(TAU * (f64::from(i) + 0.5) / f64::from(width), lat);
            let land = blobs.iter().any(|(centre, cosine)| p.dot(*centre) > *cosine);
            let grid = i % (width / 24).max(1) < 2 || j % (height / 12).max(1) < 2;
            samples.extend(match (grid, land) {
                (true, _) => [240, 240, 220],
                (false, true) => [70, 140, 60],
                (false, false) => [30, 60, 150],
            });
        }
    }
    // A width of 0 makes no picture; every caller's is above 1.
    Texture::from_bytes(width, height, 255, samples).unwrap_or_else(|e| unreachable!("{e}"))
}

fn on_globe(lon: f64, lat: f64) -> DVec3 {
    let c = libm::cos(lat);
    dvec3(c * libm::cos(lon), libm::sin(lat), c * libm::sin(lon))
}

/// What the format can do in one picture: a globe, mirrors, a ring of small spheres, a mirror wall.
#[must_use]
pub fn demo() -> Document {
    let mut d = Document::new(dvec3(1.2, 2.9, -8.4), dvec3(0.0, 1.35, 0.0)).with_background(0.45, 0.62, 0.85);
    d.textures.push(("globe.ppm".into(), globe(512)));
    d = d.plane(DVec3::Y, 0.0, Look::new(0.82, 0.8, 0.74, 0.7, 0.12)).with(Item::Sphere(
        dvec3(0.0, 1.5, 0.0),
        1.5,
        Some(Orientation { pole: dvec3(0.2, 1.0, 0.0), equator: dvec3(1.0, -0.2, 0.0) }),
        Look::picture(0, 0.8, 0.06),
    ));
    d = d.sphere(dvec3(-3.0, 1.0, 1.5), 1.0, Look::new(0.9, 0.9, 0.9, 0.08, 0.9)).sphere(
        dvec3(2.8, 0.8, -1.2),
        0.8,
        Look::new(0.9, 0.3, 0.22, 0.7, 0.2),
    );
    for k in 0..12 {
        let a = TAU * f64::from(k) / 12.0;
        let (c, s) = (libm::cos(a), libm::sin(a));
        d = d.sphere(dvec3(3.2 * c, 0.25, 3.2 * s), 0.25, Look::new(0.55 + 0.45 * c, 0.55 + 0.45 * s, 0.6, 0.8, 0.1));
    }
    let wall = Look::new(0.75, 0.78, 0.85, 0.12, 0.75);
    d.with(Item::TriangleSides([dvec3(-6.5, 0.0, 3.5), dvec3(11.0, 0.0, 2.0), dvec3(0.0, 4.5, 0.0)], wall))
        .triangle([dvec3(4.5, 0.0, 5.5), dvec3(4.5, 4.5, 5.5), dvec3(-6.5, 4.5, 3.5)], wall)
        .light(-6.0, 8.0, -6.0)
        .light(5.0, 10.0, -8.0)
}

/// A box of facing mirrors: long paths, few objects.
#[must_use]
pub fn mirrors() -> Document {
    let mut d = Document::new(dvec3(0.3, 1.4, -3.6), dvec3(0.0, 1.2, 0.0));
    for (n, distance, c) in [
        (DVec3::Y, 0.0, [0.7, 0.7, 0.7]),
        (-DVec3::Y, -4.0, [0.8, 0.8, 0.8]),
        (DVec3::X, -4.0, [0.9, 0.6, 0.6]),
        (-DVec3::X, -4.0, [0.6, 0.6, 0.9]),
        (DVec3::Z, -4.0, [0.6, 0.9, 0.6]),
        (-DVec3::Z, -4.0, [0.8, 0.8, 0.6]),
    ] {
        let (diffuse, reflect) = if distance == 0.0 { (0.6, 0.3) } else { (0.15, 0.85) };
        d = d.plane(n, distance, Look::new(c[0], c[1], c[2], diffuse, reflect));
    }
    let mut random = Random::new(3);
    for _ in 0..24 {
        let r = random.between(0.1, 0.45);
        let c = dvec3(random.between(-2.5, 2.5), random.between(r, 2.6), random.between(-1.5, 3.0));
        let [red, green, blue] = [(); 3].map(|()| random.between(0.3, 1.0));
        d = d.sphere(c, r, Look::new(red, green, blue, 0.5, 0.5));
    }
    d.light(-2.0, 3.5, -2.0).light(2.0, 3.7, 1.0)
}

/// `lights` lights over `spheres` small spheres: shadow rays dominate.
#[must_use]
pub fn lights(spheres: usize, lights: usize) -> Document {
    let mut random = Random::new(11);
    let mut d = Document::new(dvec3(0.0, 7.0, -11.0), dvec3(0.0, 0.5, 0.0)).with_background(0.02, 0.02, 0.05);
    let share = 1.2 / lights.max(1) as f64;
    d = d.plane_at(DVec3::Y, DVec3::ZERO, Look::new(0.8, 0.8, 0.8, share.min(1.0), 0.1));
    for _ in 0..spheres {
        let r = random.between(0.05, 0.3);
        let c = dvec3(random.between(-8.0, 8.0), r, random.between(-8.0, 8.0));
        let [red, green, blue] = [(); 3].map(|()| random.between(0.2, 1.0));
        d = d.sphere(c, r, Look::new(red, green, blue, (1.6 * share).min(1.0), 0.2));
    }
    for _ in 0..lights {
        d = d.light(random.between(-9.0, 9.0), random.between(3.0, 9.0), random.between(-9.0, 9.0));
    }
    d
}

/// Eric Haines' "balls": nine children a sphere, (9^(depth+1) − 1)/8 spheres over a plane.
#[must_use]
pub fn sphereflake(depth: u32) -> Document {
    let mut d = Document::new(dvec3(2.1, 1.3, 1.7), DVec3::ZERO).with_background(0.078, 0.361, 0.753);
    d.camera[1] = DVec3::Z;
    d = d.plane(DVec3::Z, -0.5, Look::new(1.0, 0.75, 0.33, 0.8, 0.0));
    let mut children = Vec::new();
    for k in 0..6 {
        let a = TAU / 6.0 * f64::from(k);
        children.push(dvec3(libm::cos(a), libm::sin(a), 0.0));
    }
    for k in 0..3 {
        let (a, tilt) = (TAU / 12.0 + TAU / 3.0 * f64::from(k), 55f64.to_radians());
        children.push(dvec3(libm::cos(a) * libm::cos(tilt), libm::sin(a) * libm::cos(tilt), libm::sin(tilt)));
    }
    grow(&mut d, &children, DVec3::ZERO, 0.5, DVec3::Z, depth);
    d.light(4.0, 3.0, 2.0).light(1.0, -4.0, 4.0).light(-3.0, 1.0, 5.0)
}

fn grow(d: &mut Document, children: &[DVec3], centre: DVec3, radius: f64, up: DVec3, depth: u32) {
    d.items.push(Item::Sphere(centre, radius, None, Look::new(1.0, 0.9, 0.7, 0.5, 0.3)));
    if depth == 0 {
        return;
    }
    let t = if up.x.abs() < 0.9 { DVec3::X } else { DVec3::Y };
    let u = up.cross(t).normalize();
    let v = up.cross(u);
    for k in children {
        let out = (u * k.x + v * k.y + up * k.z).normalize();
        let r = radius / 3.0;
        grow(d, children, centre + out * (radius + r), r, out, depth - 1);
    }
}

/// A fractal height field of 2·n² triangles, n a power of two, under four mirror spheres.
#[must_use]
pub fn terrain(n: usize) -> Document {
    let mut random = Random::new(1);
    let mut h = vec![vec![0.0; n + 1]; n + 1];
    let (mut step, mut amplitude) = (n, 1.6);
    while step > 1 {
        let half = step / 2;
        for y in (half..n).step_by(step) {
            for x in (half..n).step_by(step) {
                let sum = h[y - half][x - half] + h[y - half][x + half] + h[y + half][x - half] + h[y + half][x + half];
                h[y][x] = sum / 4.0 + random.between(-amplitude, amplitude);
            }
        }
        for y in (0..=n).step_by(half) {
            for x in ((y + half) % step..=n).step_by(step) {
                let (mut sum, mut count) = (0.0, 0.0);
                for (yy, xx) in [
                    (y.checked_sub(half), Some(x)),
                    (Some(y + half), Some(x)),
                    (Some(y), x.checked_sub(half)),
                    (Some(y), Some(x + half)),
                ] {
                    if let (Some(yy), Some(xx)) = (yy, xx)
                        && yy <= n
                        && xx <= n
                    {
                        sum += h[yy][xx];
                        count += 1.0;
                    }
                }
                h[y][x] = sum / count + random.between(-amplitude, amplitude) * 0.7;
            }
        }
        step = half;
        amplitude *= 0.52;
    }
    let mut d = Document::new(dvec3(-7.5, 6.0, -9.0), dvec3(0.0, 0.3, 0.0)).with_background(0.5, 0.65, 0.85);
    let k = 12.0 / n as f64;
    let place = |x: usize, y: usize| dvec3((x as f64 - n as f64 / 2.0) * k, h[y][x], (y as f64 - n as f64 / 2.0) * k);
    for y in 0..n {
        for x in 0..n {
            let look = Look::new((0.45 + 0.03 * h[y][x]).clamp(0.0, 1.0), 0.5, 0.3, 0.95, 0.0);
            let [a, b, c, e] = [place(x, y), place(x + 1, y), place(x + 1, y + 1), place(x, y + 1)];
            d = d.triangle([a, b, c], look).triangle([a, c, e], look);
        }
    }
    for c in [dvec3(-2.5, 3.2, -2.0), dvec3(2.0, 3.0, -2.5), dvec3(2.4, 3.4, 2.0), dvec3(-2.0, 3.8, 2.3)] {
        d = d.sphere(c, 1.1, Look::new(0.9, 0.9, 0.9, 0.1, 0.85));
    }
    d.light(-8.0, 12.0, -6.0).light(7.0, 9.0, -9.0)
}

/// A knot of 2·n·m triangles standing on a mirroring floor: a closed, curved, self-shadowing mesh.
#[must_use]
pub fn knot_scene(n: usize, m: usize) -> Document {
    mesh_scene(knot(n, m))
}

/// A mesh, brought to a width of 4, standing on a mirroring floor.
#[must_use]
pub fn mesh_scene(mesh: Mesh) -> Document {
    let low = mesh.vertices.iter().fold(DVec3::INFINITY, |a, v| a.min(*v));
    let high = mesh.vertices.iter().fold(DVec3::NEG_INFINITY, |a, v| a.max(*v));
    let foot = dvec3((low.x + high.x) / 2.0, low.y, (low.z + high.z) / 2.0);
    let mesh = mesh.map(|v| (v - foot) * (4.0 / (high.x - low.x)));
    let mut d = Document::new(dvec3(-1.5, 3.0, 6.0), dvec3(0.0, 1.3, 0.0)).with_background(0.2, 0.25, 0.35);
    d = d.plane(DVec3::Y, 0.0, Look::new(0.6, 0.6, 0.62, 0.7, 0.3));
    let look = Look::new(0.35, 0.75, 0.45, 0.8, 0.15);
    d.items.extend((0..mesh.faces.len()).map(|i| Item::Triangle(mesh.corners(i), look)));
    d.light(-5.0, 8.0, 6.0).light(6.0, 6.0, 4.0)
}
