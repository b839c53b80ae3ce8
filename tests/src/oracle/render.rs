//! From objects to pixels.

use std::cmp::Ordering::{self, Equal, Greater, Less};

use glam::DVec3;
use rayon::prelude::*;
use tessera_core::scene::{Orientation, Rgb, Scene};
use tessera_core::settings::{Sampling, Settings};

use super::ball::{Ball, Vector};
use super::object::{Hit, Object, Ray, Shape, objects};
use crate::compare::Image;
use crate::pigment::{Edge, color, linear_rgb};

/// What deciding has met so far.
#[derive(Clone, Copy, Debug)]
pub struct Decisions {
    /// Decisions that came out as equality.
    pub ties: u64,
    /// The fewest bits by which a decided value stood above its error; near the precision
    /// where everything was clear, small where it hardly was.
    pub margin: f64,
}

impl Default for Decisions {
    fn default() -> Self {
        Self { ties: 0, margin: f64::INFINITY }
    }
}

impl Decisions {
    pub(super) fn sign(&mut self, x: &Ball) -> Ordering {
        let sign = x.sign();
        if sign == Equal {
            self.ties += 1;
        } else {
            self.margin = self.margin.min(x.margin());
        }
        sign
    }

    fn merge(&mut self, o: Self) {
        self.ties += o.ties;
        self.margin = self.margin.min(o.margin);
    }
}

/// A rendered picture and how clear its decisions were.
#[derive(Clone, Debug)]
pub struct Picture {
    /// The pixels.
    pub image: Image,
    /// Over all pixels.
    pub decisions: Decisions,
}

/// A scene ready for rays of wide numbers.
#[derive(Debug)]
pub struct Oracle<'a> {
    scene: &'a Scene,
    bits: usize,
    objects: Vec<Object>,
    lights: Vec<Vector>,
    one: Ball,
}

impl<'a> Oracle<'a> {
    /// An oracle of `bits` bits: 512 unless sizes more than 2^400 apart meet in the scene.
    #[must_use]
    pub fn new(scene: &'a Scene, bits: usize) -> Self {
        Self {
            scene,
            bits,
            objects: objects(scene, bits),
            lights: scene.lights().iter().map(|&l| Vector::exact(l, bits)).collect(),
            one: Ball::exact(1.0, bits),
        }
    }

    /// The objects, in document order.
    #[must_use]
    pub fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// The nearest hit with t > 0 of the ray as given: its object's place in the document, and t.
    #[must_use]
    pub fn closest_hit(&self, origin: DVec3, direction: DVec3) -> Option<(u32, Ball)> {
        let (o, d) = (Vector::exact(origin, self.bits), Vector::exact(direction, self.bits));
        let hit = self.nearest(&o, &d, None, &mut Decisions::default())?;
        Some((self.objects[hit.object].order, hit.t))
    }

    /// Whether anything meets the open segment.
    #[must_use]
    pub fn occluded(&self, from: DVec3, to: DVec3) -> bool {
        let o = Vector::exact(from, self.bits);
        let d = &Vector::exact(to, self.bits) - &o;
        self.blocked(&o, &d, None, &mut Decisions::default())
    }

    /// Renders the whole picture.
    #[must_use]
    pub fn render(&self, settings: &Settings) -> Picture {
        let (w, h) = (settings.view.width() as usize, settings.view.height() as usize);
        let frame = Frame::new(self.scene, settings, self.bits);
        let pixels: Vec<(Rgb, Decisions)> =
            (0..w * h).into_par_iter().map(|k| self.pixel(&frame, settings, k % w, k / w)).collect();
        let mut decisions = Decisions::default();
        pixels.iter().for_each(|(_, d)| decisions.merge(*d));
        Picture {
            image: Image { width: w, height: h, pixels: pixels.into_iter().map(|(p, _)| p).collect() },
            decisions,
        }
    }

    fn pixel(&self, frame: &Frame, settings: &Settings, i: usize, j: usize) -> (Rgb, Decisions) {
        let Sampling::Uniform { grid } = settings.sampling else { unimplemented!("samples uniformly only") };
        let n = grid as usize;
        let mut decisions = Decisions::default();
        let mut sum = [0.0; 3];
        for b in 0..n {
            for a in 0..n {
                let direction = frame.direction(i * n + a, j * n + b);
                let c = self.radiance(frame.location.clone(), direction, settings, &mut decisions);
                sum = [0, 1, 2].map(|k| sum[k] + c[k]);
            }
        }
        (sum.map(|s| s / (n * n) as f64), decisions)
    }

    fn radiance(
        &self,
        mut origin: Vector,
        mut direction: Vector,
        settings: &Settings,
        decisions: &mut Decisions,
    ) -> Rgb {
        let transfer = settings.transfer;
        let (mut sum, mut weight, mut from) = ([0.0; 3], 1.0, None);
        for depth in 1..=settings.max_depth {
            let Some(Hit { object, t }) = self.nearest(&origin, &direction, from, decisions) else {
                let c = linear_rgb(self.scene.background(), transfer);
                return [0, 1, 2].map(|k| sum[k] + weight * c[k]);
            };
            let p = &origin + &direction.times(&t);
            let normal = self.objects[object].normal(&p);
            let along = normal.dot(&direction);
            let faced = if decisions.sign(&along) == Greater { normal.times(&-&self.one) } else { normal.clone() };
            let surface = self.scene.surface(self.objects[object].surface);
            if surface.diffuse > 0.0 {
                let light = self.light(&p, &faced, object, decisions);
                if light > 0.0 {
                    let pigment = color(self.scene, &surface.pigment, transfer, || self.uv(object, &p, &normal));
                    sum = [0, 1, 2].map(|k| sum[k] + weight * surface.diffuse * light * pigment[k]);
                }
            }
            weight *= surface.reflect;
            if weight == 0.0 || depth == settings.max_depth {
                break;
            }
            let factor = along.doubled().over(&normal.dot(&normal));
            direction = &direction - &normal.times(&factor);
            origin = p;
            from = Some(object);
        }
        sum
    }

    fn light(&self, p: &Vector, normal: &Vector, object: usize, decisions: &mut Decisions) -> f64 {
        let mut sum = 0.0;
        for light in &self.lights {
            let to = light - p;
            let cosine = normal.dot(&to);
            if decisions.sign(&cosine) == Greater && !self.blocked(p, &to, Some(object), decisions) {
                sum += cosine.over(&(&normal.dot(normal) * &to.dot(&to)).sqrt()).to_f64();
            }
        }
        sum
    }

    fn nearest(&self, o: &Vector, d: &Vector, from: Option<usize>, decisions: &mut Decisions) -> Option<Hit> {
        let ray = Ray { origin: o, direction: d, square: &d.dot(d) };
        let mut best: Option<Hit> = None;
        for (object, it) in self.objects.iter().enumerate() {
            if let Some(t) = it.hit(&ray, from == Some(object), decisions) {
                // Objects come in document order: of equals the first stays.
                if best.as_ref().is_none_or(|b| decisions.sign(&(&t - &b.t)) == Less) {
                    best = Some(Hit { object, t });
                }
            }
        }
        best
    }

    fn blocked(&self, o: &Vector, d: &Vector, from: Option<usize>, decisions: &mut Decisions) -> bool {
        let ray = Ray { origin: o, direction: d, square: &d.dot(d) };
        self.objects.iter().enumerate().any(|(k, object)| object.blocks(&ray, &self.one, from == Some(k), decisions))
    }

    /// Where the picture is read at p.
    fn uv(&self, object: usize, p: &Vector, normal: &Vector) -> ([f64; 2], [Edge; 2]) {
        let object = &self.objects[object];
        match &object.shape {
            Shape::Sphere { .. } => {
                let index = u32::try_from(object.index).unwrap_or(u32::MAX);
                let default = Orientation { pole: DVec3::Y, equator: DVec3::X };
                let o = self.scene.orientation(index).unwrap_or(&default);
                let pole = Vector::exact(o.pole, self.bits);
                let pole = pole.over(&pole.length());
                let equator = Vector::exact(o.equator, self.bits);
                let equator = &equator - &pole.times(&equator.dot(&pole));
                let equator = equator.over(&equator.length());
                let m = normal.over(&normal.length());
                let value = |x: Ball| if x.sign() == Equal { 0.0 } else { x.to_f64() };
                let angle = libm::atan2(value(m.cross(&pole).length()), value(m.dot(&pole)));
                let turn = libm::atan2(value(m.dot(&equator.cross(&pole))), value(m.dot(&equator)));
                let u = turn / std::f64::consts::TAU;
                ([u - u.floor(), 1.0 - angle / std::f64::consts::PI], [Edge::Wrap, Edge::Clamp])
            }
            Shape::Triangle { corner, sides: [e1, e2], normal } => {
                let (s, square) = (p - corner, normal.dot(normal));
                let u = s.cross(e2).dot(normal).over(&square).to_f64();
                let v = e1.cross(&s).dot(normal).over(&square).to_f64();
                ([u, v], [Edge::Clamp, Edge::Clamp])
            }
            Shape::Plane { normal, origin, .. } => {
                let n = self.scene.planes()[object.index].normal.abs();
                let axis = if n.x <= n.y && n.x <= n.z {
                    DVec3::X
                } else if n.y <= n.z {
                    DVec3::Y
                } else {
                    DVec3::Z
                };
                let normal = normal.over(&normal.length());
                let across = Vector::exact(axis, self.bits).cross(&normal);
                let across = across.over(&across.length());
                let s = p - origin;
                let (u, v) = (s.dot(&across), s.dot(&normal.cross(&across)));
                ([u.fraction(), v.fraction()], [Edge::Wrap, Edge::Wrap])
            }
        }
    }
}

/// The camera's frame, times the lengths that would be divided by.
struct Frame {
    location: Vector,
    /// Towards the plane's middle, for half a sample's width to the right, and for half of one up.
    parts: [Vector; 3],
    /// Samples across and down.
    samples: [usize; 2],
    bits: usize,
}

impl Frame {
    fn new(scene: &Scene, settings: &Settings, bits: usize) -> Self {
        let Sampling::Uniform { grid } = settings.sampling else { unimplemented!("samples uniformly only") };
        let (view, camera) = (&settings.view, scene.camera());
        let [location, sky, look_at] =
            [camera.location(), camera.sky(), camera.look_at()].map(|v| Vector::exact(v, bits));
        let number = |x: f64| Ball::exact(x, bits);
        let forward = &look_at - &location;
        let right = sky.cross(&forward);
        let up = forward.cross(&right);
        let (f, r) = (forward.length(), right.length());
        let samples = [view.width() * grid, view.height() * grid].map(|n| n as usize);
        // zoom·f + x·r + y·u, with x = (2i + 1 − w)·plane_height/2h and y alike, times 2h·|F||S × F|.
        let ahead = &number(view.zoom()) * &(&number(2.0 * samples[1] as f64) * &r);
        let height = number(view.plane_height());
        let parts = [forward.times(&ahead), right.times(&(&height * &f)), up.times(&height)];
        Self { location, parts, samples, bits }
    }

    fn direction(&self, i: usize, j: usize) -> Vector {
        let [w, h] = self.samples.map(|n| n as f64);
        let x = Ball::exact(2.0 * i as f64 + 1.0 - w, self.bits);
        let y = Ball::exact(h - 1.0 - 2.0 * j as f64, self.bits);
        let [ahead, right, up] = &self.parts;
        &(ahead + &right.times(&x)) + &up.times(&y)
    }
}
