//! Scenes that people make exactly, each beside one that differs by a hair: what being exact costs.

use glam::{DVec3, dvec3};

use super::{Document, Item, Look, Placement, Random};

/// A scene of exact events, and what its time is held against.
#[derive(Clone, Debug)]
pub struct Cliff {
    /// What it is called.
    pub name: String,
    /// The scene as people make it.
    pub exact: Document,
    /// The same a hair apart, or without its copies; `None`: the same scene, what is in doubt left to f64.
    pub apart: Option<Document>,
    /// Rays in a path at most.
    pub depth: u32,
    /// How many times as long the exact one may take at most.
    pub limit: f64,
}

fn color(r: &mut Random, diffuse: f64, reflect: f64) -> Look {
    Look::new(r.unit(), r.unit(), r.unit(), diffuse, reflect)
}

fn quad(d: Document, [a, b, c, e]: [DVec3; 4], look: Look) -> Document {
    d.triangle([a, b, c], look).triangle([a, c, e], look)
}

fn floor() -> Document {
    Document::new(dvec3(0.0, 2.0, -4.0), DVec3::ZERO).plane(DVec3::Y, 0.0, Look::matte(0.8, 0.8, 0.8))
}

/// A room, its walls planes or triangles, with two boxes in it and a light at this height.
fn room(triangles: bool, light: f64) -> Document {
    let wall = |r, g, b| Look::new(r, g, b, 0.8, 0.0);
    let mut d = Document::new(dvec3(0.2, 2.3, -4.8), dvec3(0.0, 2.2, 0.0));
    let (white, red, green) = (wall(0.8, 0.8, 0.8), wall(0.8, 0.2, 0.2), wall(0.2, 0.8, 0.2));
    if triangles {
        let v = |x: f64, y: f64, z: f64| dvec3(6.0 * x - 3.0, 5.0 * y, 10.0 * z - 5.0);
        let at = |c: [[f64; 3]; 4]| c.map(|[x, y, z]| v(x, y, z));
        d = quad(d, at([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]]), white);
        d = quad(d, at([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]]), white);
        d = quad(d, at([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]]), white);
        d = quad(d, at([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 1.0, 0.0]]), red);
        d = quad(d, at([[1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 0.0]]), green);
    } else {
        d = d.plane(DVec3::Y, 0.0, white).plane(-DVec3::Y, -5.0, white).plane(-DVec3::Z, -5.0, white);
        d = d.plane(DVec3::X, -3.0, red).plane(-DVec3::X, -3.0, green);
    }
    for (x, z, h) in [(-1.4, 1.0, 2.4), (0.6, -0.5, 1.2)] {
        let v = |a: u8, b: u8, c: u8| dvec3(x + 1.2 * f64::from(a), h * f64::from(b), z + 1.2 * f64::from(c));
        for face in [
            [v(0, 0, 0), v(1, 0, 0), v(1, 1, 0), v(0, 1, 0)],
            [v(0, 0, 0), v(0, 0, 1), v(0, 1, 1), v(0, 1, 0)],
            [v(1, 0, 0), v(1, 0, 1), v(1, 1, 1), v(1, 1, 0)],
            [v(0, 1, 0), v(1, 1, 0), v(1, 1, 1), v(0, 1, 1)],
        ] {
            d = quad(d, face, wall(0.7, 0.7, 0.75));
        }
    }
    d.light(0.0, light, 0.5)
}

/// A floor and balls, one light high and one at this height.
fn lamp(height: f64) -> Document {
    let mut r = Random::new(31);
    let mut d = floor().light(2.0, height, -1.0).light(3.0, 8.0, -4.0);
    for _ in 0..20 {
        let radius = r.between(0.1, 0.4);
        d = d.sphere(dvec3(r.between(-2.0, 2.0), radius + 0.01, r.between(-1.0, 3.0)), radius, color(&mut r, 0.8, 0.0));
    }
    d
}

/// So many posters on a wall, each so far before the last.
fn posters(count: u32, gap: f64) -> Document {
    let mut r = Random::new(37);
    let mut d = Document::new(dvec3(0.0, 2.0, -6.0), dvec3(0.0, 2.0, 0.0)).with_background(0.1, 0.2, 0.4).plane(
        -DVec3::Z,
        0.0,
        Look::new(0.8, 0.8, 0.7, 0.8, 0.0),
    );
    for i in 0..count {
        let (x, y, w) = (r.between(-4.0, 3.0), r.between(0.0, 3.5), r.between(0.2, 1.2));
        let z = -gap * f64::from(i + 1);
        let corners = [dvec3(x, y, z), dvec3(x + w, y, z), dvec3(x + w, y + w, z), dvec3(x, y + w, z)];
        d = quad(d, corners, color(&mut r, 1.0, 0.0));
    }
    d.light(2.0, 5.0, -6.0)
}

/// Five hundred balls, each written so often.
fn balls(times: usize) -> Document {
    let mut r = Random::new(29);
    let at: Vec<_> = (0..500).map(|_| r.cube() * 2.0).collect();
    let mut d = Document::new(dvec3(0.01, 2.0, -6.0), DVec3::ZERO).with_background(0.1, 0.2, 0.4);
    for _ in 0..times {
        for &center in &at {
            d = d.sphere(center, 0.2, Look::matte(0.3, 0.6, 0.5));
        }
    }
    d.light(5.0, 8.0, -9.0).light(-4.3, 7.7, -3.1)
}

/// So many times the same ball.
fn spheres(count: u32) -> Document {
    let ball = Item::Sphere(DVec3::Y, 1.0, None, Look::new(0.3, 0.6, 0.5, 0.7, 0.3));
    (0..count).fold(floor(), |d, _| d.with(ball)).light(1.0, 9.0, -3.0)
}

/// So many times the same triangle.
fn equal_triangles(count: u32) -> Document {
    let corners = [dvec3(-2.0, 0.1, 0.0), dvec3(2.0, 0.3, 0.2), dvec3(0.1, 2.0, 1.0)];
    let item = Item::Triangle(corners, Look::new(0.3, 0.6, 0.5, 0.7, 0.3));
    (0..count).fold(floor(), |d, _| d.with(item)).light(1.0, 9.0, -3.0)
}

/// So many triangles in the floor's plane, or each so far above the last, as large as they are.
fn rug(count: u32, size: f64, gap: f64) -> Document {
    let mut r = Random::new(33);
    let mut d = floor();
    for i in 0..count {
        let (x, z) = (r.between(-3.0, 3.0), r.between(-3.0, 3.0));
        let y = gap * f64::from(i + 1);
        let corners = [0, 1, 2].map(|_| dvec3(x + r.between(-size, size), y, z + r.between(-size, size)));
        d = d.triangle(corners, color(&mut r, 1.0, 0.0));
    }
    d.light(1.0, 9.0, -3.0)
}

/// Thin strips that are so long.
fn strips(long: f64) -> Document {
    let mut r = Random::new(21);
    let mut d = Document::new(DVec3::ZERO, DVec3::Z);
    for i in 0..12 {
        let turn = r.between(0.0, std::f64::consts::PI);
        let (x, y) = (r.between(-0.5, 0.5), r.between(-0.4, 0.4));
        let (along, across) = ((libm::cos(turn), libm::sin(turn)), (-libm::sin(turn), libm::cos(turn)));
        let (z, w) = (5.0 + 0.1 * f64::from(i), 0.01);
        let p = |t: f64, u: f64| dvec3((x + t * along.0 + u * across.0) * z, (y + t * along.1 + u * across.1) * z, z);
        d = quad(d, [p(-long, -w), p(long, -w), p(long, w), p(-long, w)], Look::matte(1.0, 1.0, 1.0));
    }
    d.light(0.0, 0.0, 0.0)
}

/// A planet with balls that stand on it, seen from eye height.
fn planet() -> Document {
    let radius: f64 = 6e6;
    let mut r = Random::new(35);
    let mut d = Document::new(dvec3(0.0, 1.7, -20.0), dvec3(0.0, 1.5, 0.0)).with_background(0.5, 0.7, 0.9).sphere(
        dvec3(0.0, -radius, 0.0),
        radius,
        Look::new(0.5, 0.6, 0.4, 0.9, 0.1),
    );
    for _ in 0..2000 {
        let (x, z, k) = (r.between(-30.0, 30.0), r.between(-15.0, 60.0), r.between(0.1, 0.6));
        let y = -radius + ((radius + k) * (radius + k) - x * x - z * z).sqrt();
        d = d.sphere(dvec3(x, y, z), k, color(&mut r, 0.8, 0.2));
    }
    d.light(-30.0, 50.0, -30.0).light(1e5, 2e5, -1e5)
}

/// The same under a moon.
fn moon(d: Document) -> Document {
    d.sphere(dvec3(1e8, 1e8, 3.6e8), 1.7e6, Look::matte(0.9, 0.9, 0.9))
}

/// A town of boxes on the ground, or a hair above it.
fn town(gap: f64) -> Document {
    let mut r = Random::new(31);
    let mut d = Document::new(dvec3(0.3, 5.0, -10.0), dvec3(0.0, 0.5, 0.0))
        .with_background(0.1, 0.2, 0.4)
        .with(Item::Plane(DVec3::Y, Placement::Distance(0.0), Look::new(0.5, 0.5, 0.5, 0.8, 0.0)));
    let faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 4, 6, 2], [1, 5, 7, 3], [2, 3, 7, 6], [0, 1, 5, 4]];
    for i in -6..6 {
        for j in -4..12 {
            let h = r.between(0.3, 2.2);
            let v = |k: i32| {
                let bit = |b: i32| f64::from(k >> b & 1);
                dvec3(f64::from(i) + 0.8 * bit(0), gap + h * bit(1), f64::from(j) + 0.8 * bit(2))
            };
            for face in faces {
                d = quad(d, face.map(v), Look::new(0.8, 0.7, 0.6, 0.9, 0.0));
            }
        }
    }
    d.light(5.0, 8.0, -9.0).light(-4.3, 7.7, -3.1)
}

/// All of them.
#[must_use]
pub fn cliffs() -> Vec<Cliff> {
    let cliff = |name: &str, exact: Document, apart: Document, limit: f64| Cliff {
        name: name.to_owned(),
        exact,
        apart: Some(apart),
        depth: 6,
        limit,
    };
    let mut all = vec![
        cliff("room-planes", room(false, 5.0), room(false, 4.9999), 3.0),
        cliff("room-triangles", room(true, 5.0), room(true, 4.9999), 3.0),
        cliff("lamp-on-floor", lamp(0.0), lamp(1e-4), 3.0),
        cliff("town", town(0.0), town(1e-5), 3.0),
    ];
    all.extend([10, 80, 1000].map(|n| cliff(&format!("posters-{n}"), posters(n, 0.0), posters(n, 1e-5), 3.0)));
    all.push(cliff("balls-twice", balls(2), balls(1), 1.1));
    all.extend([10, 100, 1000].map(|n| cliff(&format!("spheres-{n}"), spheres(n), spheres(1), 1.1)));
    all.extend([10, 1000].map(|n| cliff(&format!("triangles-{n}"), equal_triangles(n), equal_triangles(1), 1.1)));
    all.extend([10, 1000].map(|n| cliff(&format!("coplanar-{n}"), rug(n, 1.0, 0.0), rug(n, 1.0, 1e-5), 3.0)));
    all.push(cliff("strips-1e6", strips(1e6), strips(2.0), 3.0));
    all.push(cliff("strips-1e15", strips(1e15), strips(2.0), 3.0));
    all.push(cliff("rug-20000", rug(20_000, 0.3, 0.0), rug(20_000, 0.3, 1e-6), 3.0));
    // By default, what is mirrored is followed that far.
    for (name, depth) in [("planet", 6), ("planet-deep", 16)] {
        all.push(Cliff { name: name.into(), exact: planet(), apart: None, depth, limit: 1.3 });
    }
    all.push(cliff("moon", moon(balls(1)), balls(1), 1.5));
    all.push(cliff("planet-and-moon", moon(planet()), planet(), 3.0));
    all
}
