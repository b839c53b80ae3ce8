//! What a ray meets.

use std::cmp::Ordering::{Equal, Greater, Less};

use super::ball::{Ball, Vector};
use super::render::Decisions;
use tessera_core::scene::{PlanePosition, Scene, SurfaceId};

/// An object made ready.
#[derive(Debug)]
pub struct Object {
    /// Its place in the document.
    pub order: u32,
    /// What it does with light.
    pub surface: SurfaceId,
    /// Its index among its kind.
    pub index: usize,
    pub(super) shape: Shape,
}

#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a few objects, each looked at for every ray")]
pub(super) enum Shape {
    /// `through`·normal says where it lies, `origin` is where its picture starts.
    Plane {
        normal: Vector,
        through: Ball,
        origin: Vector,
    },
    Sphere {
        center: Vector,
        square: Ball,
    },
    Triangle {
        corner: Vector,
        sides: [Vector; 2],
        normal: Vector,
    },
}

/// A ray and an object meet.
#[derive(Clone, Debug)]
pub struct Hit {
    /// Index into [`super::Oracle::objects`].
    pub object: usize,
    /// How far along the ray, in its direction's lengths.
    pub t: Ball,
}

/// Every object of the scene, in document order; triangles of no area are left out.
pub(super) fn objects(scene: &Scene, bits: usize) -> Vec<Object> {
    let mut out = Vec::new();
    for (index, p) in scene.planes().iter().enumerate() {
        let normal = Vector::exact(p.normal, bits);
        let (through, origin) = match p.position {
            PlanePosition::Point(q) => (Vector::exact(q, bits).dot(&normal), Vector::exact(q, bits)),
            PlanePosition::Distance(d) => {
                let (d, length) = (Ball::exact(d, bits), normal.length());
                (&d * &length, normal.times(&d.over(&length)))
            }
        };
        out.push(Object { order: p.order, surface: p.surface, index, shape: Shape::Plane { normal, through, origin } });
    }
    for (index, s) in scene.spheres().iter().enumerate() {
        let r = Ball::exact(s.radius, bits);
        let shape = Shape::Sphere { center: Vector::exact(s.center, bits), square: &r * &r };
        out.push(Object { order: s.order, surface: s.surface, index, shape });
    }
    for (index, t) in scene.triangles().iter().enumerate() {
        let [corner, b, c] = t.written.map(|v| Vector::exact(v, bits));
        let sides = if t.by_sides() { [b, c] } else { [&b - &corner, &c - &corner] };
        let normal = sides[0].cross(&sides[1]);
        if normal.0.iter().all(|x| x.sign() == Equal) {
            continue;
        }
        let shape = Shape::Triangle { corner, sides, normal };
        out.push(Object { order: t.order, surface: t.surface(), index, shape });
    }
    out.sort_by_key(|o| o.order);
    out
}

/// A ray: where from, where to, and whether it starts on the object it is tried with.
pub(super) struct Ray<'a> {
    pub(super) origin: &'a Vector,
    pub(super) direction: &'a Vector,
    /// The direction's square.
    pub(super) square: &'a Ball,
}

impl Object {
    /// The least t > 0 at which the ray meets the object; `own` where it starts on it.
    pub(super) fn hit(&self, ray: &Ray<'_>, own: bool, decisions: &mut Decisions) -> Option<Ball> {
        match &self.shape {
            Shape::Plane { normal, through, .. } => {
                if own {
                    return None;
                }
                let distance = through - &ray.origin.dot(normal);
                let rate = ray.direction.dot(normal);
                let ahead = decisions.sign(&distance);
                let towards = decisions.sign(&rate);
                (towards != Equal && ahead == towards).then(|| distance.over(&rate))
            }
            Shape::Sphere { center, square } => {
                let to = center - ray.origin;
                let b = ray.direction.dot(&to);
                let c = &to.dot(&to) - square;
                let a = ray.square;
                let outside = if own { Equal } else { decisions.sign(&c) };
                match outside {
                    Equal => (decisions.sign(&b) == Greater).then(|| b.doubled().over(a)),
                    Less => Some((&b + &(&(&b * &b) - &(a * &c)).sqrt()).over(a)),
                    Greater => {
                        if decisions.sign(&b) != Greater {
                            return None;
                        }
                        let disc = &(&b * &b) - &(a * &c);
                        match decisions.sign(&disc) {
                            Less => None,
                            Equal => Some(b.over(a)),
                            // The near root (b − √)/a without its cancellation.
                            Greater => Some(c.over(&(&b + &disc.sqrt()))),
                        }
                    }
                }
            }
            Shape::Triangle { corner, sides: [e1, e2], normal } => {
                if own {
                    return None;
                }
                // o + t·d = c0 + u·e1 + v·e2 by Cramer's rule.
                let w = ray.origin - corner;
                let rate = ray.direction.dot(normal);
                let towards = decisions.sign(&rate);
                if towards == Equal {
                    return None;
                }
                let distance = -&w.dot(normal);
                if decisions.sign(&distance) != towards {
                    return None;
                }
                let turned = |x: Ball| if towards == Greater { x } else { -&x };
                let across = ray.direction.cross(&w);
                // u, v and 1, each times |rate|.
                let (u, v) = (turned(across.dot(e2)), turned(-&across.dot(e1)));
                let rest = &(&turned(rate.clone()) - &u) - &v;
                let inside = [&u, &v, &rest].into_iter().all(|x| decisions.sign(x) != Less);
                inside.then(|| distance.over(&rate))
            }
        }
    }

    /// Whether the object meets the open segment from the ray's origin to origin + direction.
    pub(super) fn blocks(&self, ray: &Ray<'_>, one: &Ball, own: bool, decisions: &mut Decisions) -> bool {
        self.hit(ray, own, decisions).is_some_and(|t| decisions.sign(&(&t - one)) == Less)
    }

    /// A normal at the point, of any length.
    pub(super) fn normal(&self, p: &Vector) -> Vector {
        match &self.shape {
            Shape::Plane { normal, .. } | Shape::Triangle { normal, .. } => normal.clone(),
            Shape::Sphere { center, .. } => p - center,
        }
    }
}
