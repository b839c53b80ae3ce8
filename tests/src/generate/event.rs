//! Scenes of exact events, and of numbers so far apart that fixed widths lose them.

use glam::{DVec3, dvec3};
use tessera_core::scene::{Orientation, Texture};
use tessera_core::settings::{Settings, View};

use super::{Document, Item, Look, Placement, Random};

/// What a scene is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The eye lies on tilted planes, triangles' planes or spheres.
    Contact,
    /// Triangles that the eye sees from their edge, on whole numbers.
    EdgeOn,
    /// Triangles up to 1e15 long, in both orders of their corners.
    Needles,
    /// Sizes up to 1e120 apart, and what is hidden by what is far smaller.
    Scales,
    /// Numbers near the ends of f64.
    Ends,
    /// Pictures with poles, equators and origins near and far.
    Pictures,
    /// Flat and curved mirrors that stand exactly on one another.
    Mirrors,
    /// Everything at halves: rays through corners and edges, tangents, lights in planes, equal objects.
    Lattice,
    /// Planets, skies, needles and floors that are far larger than what is seen of them, with things on them.
    Giants,
    /// Planes and triangles one on another in one exact plane, which lights and the eye may lie in.
    Layers,
    /// Slanted boxes, with lights in the planes of their walls.
    Walls,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 11] = [
        Self::Contact,
        Self::EdgeOn,
        Self::Needles,
        Self::Scales,
        Self::Ends,
        Self::Pictures,
        Self::Mirrors,
        Self::Lattice,
        Self::Giants,
        Self::Layers,
        Self::Walls,
    ];

    /// Bits that an oracle needs to tell whatever differs in such a scene from what is equal.
    #[must_use]
    pub fn bits(self) -> usize {
        match self {
            Self::Contact | Self::EdgeOn | Self::Lattice | Self::Layers | Self::Mirrors | Self::Walls => 2048,
            Self::Giants | Self::Needles | Self::Pictures | Self::Scales => 4096,
            Self::Ends => 16384,
        }
    }
}

fn whole(r: &mut Random, most: u64) -> f64 {
    r.below(2 * most + 1) as f64 - most as f64
}

fn lattice(r: &mut Random, most: u64) -> DVec3 {
    dvec3(whole(r, most), whole(r, most), whole(r, most))
}

fn look(r: &mut Random) -> Look {
    let [a, b, c] = [0, 1, 2].map(|_| [0.25, 0.5, 1.0][r.below(3) as usize]);
    Look::new(a, b, c, 1.0, 0.0)
}

fn start(eye: DVec3, target: DVec3) -> Document {
    Document::new(eye, target).with_background(0.25, 0.5, 0.75)
}

/// A vector of whole numbers square to `n`, which are whole numbers as well.
fn across(r: &mut Random, n: DVec3) -> DVec3 {
    loop {
        let v = lattice(r, 3).cross(n);
        if v != DVec3::ZERO {
            return v;
        }
    }
}

fn contact(r: &mut Random) -> Document {
    // Pythagorean normals have whole lengths, others have not.
    let n =
        [dvec3(3.0, 4.0, 0.0), dvec3(2.0, 1.0, 2.0), dvec3(1.0, -5.0, 3.0), dvec3(2.0, 3.0, -6.0)][r.below(4) as usize];
    let eye = lattice(r, 5) * 0.5;
    let mut d = start(eye, eye + lattice(r, 3) + dvec3(0.5, 0.25, 9.0)).with(Item::Light(lattice(r, 9)));
    let through = eye + across(r, n);
    d = match r.below(4) {
        0 => d.plane_at(n, through, look(r)),
        1 => d.plane(n, eye.dot(n) / n.length(), look(r)),
        2 => {
            let (u, v) = (across(r, n), across(r, n));
            d.triangle([through, through + u * 2.0, through + v], look(r))
        }
        _ => d.sphere(eye + n, n.length(), look(r)),
    };
    d.sphere(eye + dvec3(0.5, 0.25, 12.0), 2.0, look(r)).plane(dvec3(0.0, 1.0, 0.0), -7.0, look(r))
}

fn edge_on(r: &mut Random) -> Document {
    let eye = lattice(r, 2);
    let target = eye + dvec3(whole(r, 1), whole(r, 1), 4.0);
    let mut d = start(eye, target).with(Item::Light(lattice(r, 6)));
    for _ in 0..3 {
        // Two corners before the eye and one a hair off the plane through them and the eye, or on it.
        let (a, b) = (eye + lattice(r, 2) + dvec3(0.0, 0.0, 5.0), eye + lattice(r, 2) + dvec3(0.0, 0.0, 3.0));
        let off = [0.0, 1e-17, -1e-300, 5e-324, 1e-9][r.below(5) as usize];
        let c = (a + b) * 0.5 + (b - eye) * whole(r, 2) + DVec3::X * off;
        let corners = if r.one_in(2) { [a, b, c] } else { [c, b, a] };
        d = d.triangle(corners, look(r));
    }
    d.sphere(eye + dvec3(0.0, 1.0, 9.0), 1.0, look(r))
}

fn needles(r: &mut Random) -> Document {
    let eye = r.cube();
    let mut d = start(eye, eye + DVec3::Z + r.cube() * 0.2).with(Item::Light(eye + r.cube() * 4.0));
    for _ in 0..5 {
        let long = 10f64.powf(r.between(0.0, 15.0));
        let wide = 10f64.powf(r.between(-9.0, 0.0));
        let a = eye + r.cube() + DVec3::Z * 2.0;
        let along = (r.cube() + DVec3::Z) * long;
        let corners = [a, a + along, a + r.cube() * wide + if r.one_in(2) { along } else { DVec3::ZERO }];
        let turn = r.below(3) as usize;
        let corners = [corners[turn], corners[(turn + 1) % 3], corners[(turn + 2) % 3]];
        d = d.triangle(if r.one_in(2) { corners } else { [corners[0], corners[2], corners[1]] }, look(r));
    }
    d.plane(dvec3(0.1, 1.0, 0.0), -3.0, look(r))
}

fn scales(r: &mut Random) -> Document {
    let mut d = start(DVec3::ZERO, DVec3::Z).with(Item::Light(r.cube()));
    for _ in 0..5 {
        let size = 10f64.powf(r.between(-60.0, 60.0));
        let at = (r.cube() * 0.5 + DVec3::Z * 3.0) * size;
        d = match r.below(4) {
            0 => d.sphere(at, size * r.between(0.2, 5.0), look(r)),
            1 => d.plane_at(r.direction(), at, look(r)),
            2 => d.triangle([at, at + r.cube() * size, at + r.cube() * size], look(r)),
            _ => d.triangle([at, at + r.cube() * 1e3, at + r.cube() * size], look(r)),
        };
        if r.one_in(2) {
            d = d.with(Item::Light(r.cube() * size * 4.0));
        }
    }
    d
}

fn ends(r: &mut Random) -> Document {
    let power = [155.0, -155.0, 290.0, -290.0, 77.0, -80.0, -170.0][r.below(7) as usize];
    let size = 10f64.powf(power);
    let eye = if r.one_in(2) { DVec3::ZERO } else { lattice(r, 1) * size };
    let mut d = start(eye, eye + DVec3::Z * size).with(Item::Light(eye + r.cube() * size));
    d = d.with(Item::Light(eye + r.cube() * size * 1e3));
    for _ in 0..3 {
        let at = eye + (r.cube() + DVec3::Z * 3.0) * size;
        d = match r.below(5) {
            0 => d.sphere(at, size, look(r)),
            1 => d.plane_at(r.direction(), at, look(r)),
            2 => d.triangle([at, at + r.cube() * size, at + r.cube() * size], look(r)),
            3 => d.sphere(at / size, 1.0, look(r)),
            // Through a point that is far beside the rest: its terms cancel.
            _ => d.plane_at(dvec3(0.0, 1.0, 1.0), dvec3(1.0, size, -size), look(r)),
        };
    }
    d
}

fn pictures(r: &mut Random) -> Document {
    let eye = lattice(r, 2);
    let mut d = start(eye, eye + dvec3(whole(r, 1) * 0.25, whole(r, 1) * 0.25, 2.0)).with(Item::Light(eye));
    let samples = (0..3 * 9 * 7).map(|_| r.below(256) as u8).collect();
    if let Ok(picture) = Texture::from_bytes(9, 7, 255, samples) {
        d.textures.push(("noise.ppm".into(), picture));
    }
    let paint = Look::picture(0, 1.0, 0.0);
    let far = 10f64.powf(r.between(0.0, 30.0));
    match r.below(4) {
        0 => {
            let pole = lattice(r, 2) + dvec3(0.0, 0.0, 5.0);
            let equator = if r.one_in(2) { DVec3::X } else { pole + dvec3(1e-80, 0.0, 0.0) + DVec3::Y };
            d.with(Item::Sphere(eye + DVec3::Z * 4.0, 1.5, Some(Orientation { pole, equator }), paint))
        }
        1 => {
            // Close to the pole of a great ball.
            let pole = dvec3(0.1, 0.2, -1.0);
            let center = eye + dvec3(0.0, 0.0, far.min(1e14) + 1.0);
            d.with(Item::Sphere(center, far.min(1e14), Some(Orientation { pole, equator: DVec3::X }), paint))
        }
        2 => d.plane_at(dvec3(0.0, 1.0, 1.0), dvec3(whole(r, 3), far, -far), paint),
        _ => {
            let a = eye + dvec3(-2.0, -2.0, 3.0);
            d.triangle([a, a + dvec3(4.0, 0.0, 0.0), a + dvec3(0.0, 4.0, 1.0)], paint)
        }
    }
}

fn mirrors(r: &mut Random) -> Document {
    let mirror = |r: &mut Random| Look::new(0.5, 1.0, 0.5, 0.5, [0.5, 0.25][r.below(2) as usize]);
    let eye = dvec3(whole(r, 2), 1.0, -6.0);
    let mut d = start(eye, dvec3(0.0, 1.0, 0.0)).with(Item::Light(dvec3(2.0, 5.0, -4.0)));
    d = d.plane(DVec3::Y, 0.0, mirror(r)).plane(dvec3(3.0, 0.0, 4.0), 5.0, mirror(r));
    for _ in 0..2 {
        let radius = 0.5 + r.below(3) as f64 * 0.5;
        d = d.sphere(dvec3(whole(r, 3), radius, whole(r, 2)), radius, mirror(r));
    }
    let a = dvec3(whole(r, 2), 0.0, whole(r, 2));
    d.triangle([a, a + dvec3(2.0, 0.0, 0.0), a + dvec3(0.0, 2.0, 1.0)], mirror(r))
}

fn halves(r: &mut Random) -> Document {
    let half = |r: &mut Random, most: u64| lattice(r, most) * 0.5;
    let eye = half(r, 3) + dvec3(0.0, 0.0, -5.0);
    let mut d = start(eye, eye + DVec3::Z * 2.0 + if r.one_in(2) { half(r, 1) } else { DVec3::ZERO });
    let lights: Vec<_> = (0..2).map(|_| half(r, 5)).collect();
    for &light in &lights {
        d = d.with(Item::Light(light));
    }
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    for _ in 0..4 {
        let axis = axes[r.below(3) as usize];
        d = match r.below(6) {
            0 => d.sphere(half(r, 4), 0.5 + r.below(3) as f64 * 0.5, look(r)),
            1 => d.plane_at(axis, lights[0], look(r)),
            2 => {
                // In the plane of a light, and once more in another form and colour.
                let (u, v) = (axes[r.below(3) as usize] * 2.0, half(r, 4));
                let at = lights[1] - u;
                let again = Item::TriangleSides([at, u, v], look(r));
                d.triangle([at, at + u, at + v], look(r)).with(again)
            }
            3 => {
                let (center, radius) = (half(r, 4), 1.0);
                d.sphere(center, radius, look(r)).sphere(center, radius, look(r))
            }
            4 => d.with(Item::Plane(axis, Placement::Distance(whole(r, 6) * 0.5), look(r))),
            _ => d.triangle([half(r, 4), half(r, 4), half(r, 4)], look(r)),
        };
    }
    d
}

fn giants(r: &mut Random) -> Document {
    let shiny = |r: &mut Random| {
        let Look { paint, .. } = look(r);
        Look { paint, diffuse: 0.75, reflect: [0.0, 0.25][r.below(2) as usize] }
    };
    let eye = if r.one_in(2) { DVec3::ZERO } else { r.cube() * 100.0 };
    let up = if r.one_in(2) { DVec3::Y } else { (DVec3::Y + r.cube() * 0.5).normalize() };
    let high = 10f64.powf(r.between(-3.0, 0.5));
    let mut d = start(eye, eye + DVec3::Z * 2.0 - up * high).with(Item::Light(eye + r.cube() * 3.0 + up * 4.0));
    if r.one_in(3) {
        d = d.with(Item::Light(eye + up * 10f64.powf(r.between(1.0, 12.0)) + r.cube()));
    }
    for _ in 0..2 {
        let large = 10f64.powf(r.between(3.0, 15.0));
        d = match r.below(5) {
            0 => d.sphere(eye - up * (large + high), large, shiny(r)),
            1 => d.sphere(eye + up * (large - high * 3.0), large, shiny(r)),
            2 => {
                let (u, v) = (up.cross(r.direction()).normalize(), up.cross(r.direction()).normalize());
                let a = eye - up * high;
                d.triangle([a + u * large, a + v * large, a - (u + v) * large], shiny(r))
            }
            3 => {
                let (a, along, off) = (eye + r.cube() + DVec3::Z * 3.0, r.direction() * large, r.cube());
                let corners = [a - along, a + along, a + along * r.between(-1.0, 1.0) + off];
                let turned = [corners[1], corners[0], corners[2]];
                d.triangle(if r.one_in(2) { corners } else { turned }, shiny(r))
            }
            _ => {
                // On whole numbers, so that much is met exactly.
                let (a, long) = (eye - up * high, large.round());
                let (u, v) = (dvec3(long, 0.0, whole(r, 3)), dvec3(whole(r, 3), 0.0, long));
                d.with(Item::TriangleSides([a - u - v, u * 4.0, v * 4.0], shiny(r)))
            }
        };
    }
    for _ in 0..4 {
        let radius = r.between(0.1, 0.5);
        let at = eye + dvec3(r.between(-1.5, 1.5), 0.0, r.between(1.0, 5.0)) - up * (high - radius);
        d = d.sphere(at, radius, shiny(r));
    }
    d
}

fn layers(r: &mut Random) -> Document {
    let n =
        [DVec3::Y, DVec3::Z, dvec3(3.0, 4.0, 0.0), dvec3(1.0, 2.0, -2.0), dvec3(1.0, 1.0, 1.0)][r.below(5) as usize];
    let at = lattice(r, 2);
    let inside = |r: &mut Random| at + across(r, n) * 0.5 + across(r, n) * 0.25;
    let eye = if r.one_in(6) { inside(r) } else { at + dvec3(0.5, 3.0, -6.0) };
    let mut d = start(eye, if r.one_in(2) { at } else { at + dvec3(0.25, 0.5, 0.0) });
    d = d.with(Item::Light(if r.one_in(3) { inside(r) } else { eye + lattice(r, 3) }));
    d = d.with(Item::Light(at + lattice(r, 5)));
    let shiny = |r: &mut Random| Look { reflect: [0.0, 0.0, 0.5][r.below(3) as usize], ..look(r) };
    for _ in 0..12 {
        let (a, u, v) = (inside(r), across(r, n), across(r, n));
        d = match r.below(12) {
            0 => d.plane_at(n * -2.0, a, shiny(r)),
            1 => d.plane_at(n, a, shiny(r)),
            2 => d.sphere(at + lattice(r, 3), 1.0, shiny(r)),
            3 => d.triangle([a, a + u, a + v + n], shiny(r)),
            4..7 => d.with(Item::TriangleSides([a, u, v], shiny(r))),
            _ => d.triangle([a, a + u, a + v], shiny(r)),
        };
    }
    d
}

/// Slanted boxes whose faces share edges, two of them with a light in the plane of a face.
fn walls(r: &mut Random) -> Document {
    let one = |r: &mut Random, k: usize| {
        let mut edge = lattice(r, 1);
        edge[k] = 1.0 + r.below(3) as f64;
        edge
    };
    let [u, v, w] = [0, 1, 2].map(|k| one(r, k));
    let mut d = Document::new(dvec3(whole(r, 9) + 0.3, 8.1, -20.2), DVec3::ZERO).with_background(0.1, 0.2, 0.4);
    if r.one_in(2) {
        d = d.plane_at(DVec3::Y, DVec3::ZERO, Look::default_matte());
    }
    for n in 0..14 {
        let o = dvec3(whole(r, 6), r.below(4) as f64, whole(r, 6));
        if n < 2 {
            let (up, near) = (4.0 + r.below(4) as f64, 1.0 + r.below(4) as f64);
            d = d.with(Item::Light(o + up * v - near * w));
        }
        for (at, a, b) in [(o, u, v), (o + w, u, v), (o, v, w), (o + u, v, w), (o, u, w), (o + v, u, w)] {
            d = d.triangle([at, at + a, at + a + b], look(r)).triangle([at, at + a + b, at + b], look(r));
        }
    }
    d
}

/// The scene of a kind that belongs to `seed`, and how it is seen: a small picture of odd size, so that a
/// ray goes through its middle.
///
/// # Panics
/// Never: the settings are in range.
#[must_use]
pub fn event(kind: Kind, seed: u64) -> (Document, Settings) {
    let mut random = Random::new(seed ^ (kind as u64) << 32);
    let r = &mut random;
    let document = match kind {
        Kind::Contact => contact(r),
        Kind::EdgeOn => edge_on(r),
        Kind::Needles => needles(r),
        Kind::Scales => scales(r),
        Kind::Ends => ends(r),
        Kind::Pictures => pictures(r),
        Kind::Mirrors => mirrors(r),
        Kind::Lattice => halves(r),
        Kind::Giants => giants(r),
        Kind::Layers => layers(r),
        Kind::Walls => walls(r),
    };
    let view = View::new(13, 9, 1.0, if kind == Kind::Lattice { 2.25 } else { 1.0 });
    let view = view.unwrap_or_else(|e| unreachable!("a view in range: {e}"));
    (document, Settings { view, max_depth: 4, ..crate::subject::settings(13, 9) })
}
