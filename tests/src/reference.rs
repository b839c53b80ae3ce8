//! The image model in plain f64: slow, obvious, by brute force.
//!
//! Every ray tries every object. The surface a ray starts on is left out where a
//! line meets it once; of its own sphere only the other root counts. There is no
//! tolerance, so an ordinary scene comes out right but for rounding at contacts
//! and edges; for the extremes there is [`crate::oracle`].

use glam::DVec3;
use rayon::prelude::*;
use tessera_core::scene::{PlanePosition, Rgb, Scene, SurfaceId};
use tessera_core::settings::{Sampling, Settings};

use crate::compare::Image;
use crate::pigment::{Edge, color, linear_rgb};

/// An object, by its index among its kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Object {
    Plane(usize),
    Sphere(usize),
    Triangle(usize),
}

/// Renders the whole picture.
#[must_use]
pub fn render(scene: &Scene, settings: &Settings) -> Image {
    let reference = Reference { scene, settings };
    let (w, h) = (settings.view.width() as usize, settings.view.height() as usize);
    let pixels = (0..w * h).into_par_iter().map(|k| reference.pixel(k % w, k / w)).collect();
    Image { width: w, height: h, pixels }
}

struct Reference<'a> {
    scene: &'a Scene,
    settings: &'a Settings,
}

impl Reference<'_> {
    fn pixel(&self, i: usize, j: usize) -> Rgb {
        let Sampling::Uniform { grid: n } = self.settings.sampling else { unimplemented!("samples uniformly only") };
        let view = &self.settings.view;
        let (w, h) = (f64::from(view.width()), f64::from(view.height()));
        let (plane_w, plane_h) = (view.plane_height() * w / h, view.plane_height());
        let camera = self.scene.camera();
        let forward = (camera.look_at() - camera.location()).normalize();
        let right = camera.sky().cross(forward).normalize();
        let up = forward.cross(right);
        let mut sum = [0.0; 3];
        for b in 0..n {
            for a in 0..n {
                let x = ((i as f64 + (f64::from(a) + 0.5) / f64::from(n)) / w - 0.5) * plane_w;
                let y = (0.5 - (j as f64 + (f64::from(b) + 0.5) / f64::from(n)) / h) * plane_h;
                let c = self.radiance(camera.location(), forward * view.zoom() + right * x + up * y);
                sum = [0, 1, 2].map(|k| sum[k] + c[k]);
            }
        }
        sum.map(|s| s / f64::from(n * n))
    }

    fn radiance(&self, mut origin: DVec3, mut direction: DVec3) -> Rgb {
        let transfer = self.settings.transfer;
        let (mut sum, mut weight, mut from) = ([0.0; 3], 1.0, None);
        for depth in 1..=self.settings.max_depth {
            let Some((t, object)) = self.nearest(origin, direction, from) else {
                let c = linear_rgb(self.scene.background(), transfer);
                return [0, 1, 2].map(|k| sum[k] + weight * c[k]);
            };
            let p = origin + direction * t;
            let mut n = self.normal(object, p);
            if n.dot(direction) > 0.0 {
                n = -n;
            }
            let surface = self.scene.surface(self.surface(object));
            let pigment = color(self.scene, &surface.pigment, transfer, || self.uv(object, p));
            let light = self.light(p, n, object);
            sum = [0, 1, 2].map(|k| sum[k] + weight * surface.diffuse * light * pigment[k]);
            weight *= surface.reflect;
            if weight == 0.0 || depth == self.settings.max_depth {
                break;
            }
            direction -= n * (2.0 * direction.dot(n));
            origin = p;
            from = Some(object);
        }
        sum
    }

    /// Σ max(0, n·l) over the lights that p sees.
    fn light(&self, p: DVec3, n: DVec3, object: Object) -> f64 {
        let mut sum = 0.0;
        for &light in self.scene.lights() {
            let to = light - p;
            let cosine = n.dot(to);
            if cosine > 0.0 && !self.blocked(p, to, object) {
                sum += cosine / to.length();
            }
        }
        sum
    }

    fn objects(&self) -> impl Iterator<Item = Object> {
        (0..self.scene.planes().len())
            .map(Object::Plane)
            .chain((0..self.scene.spheres().len()).map(Object::Sphere))
            .chain((0..self.scene.triangles().len()).map(Object::Triangle))
    }

    fn nearest(&self, o: DVec3, d: DVec3, from: Option<Object>) -> Option<(f64, Object)> {
        let mut best: Option<(f64, u32, Object)> = None;
        for object in self.objects() {
            if let Some(t) = self.hit(object, o, d, from == Some(object)) {
                let order = self.order(object);
                if best.is_none_or(|(bt, bo, _)| (t, order) < (bt, bo)) {
                    best = Some((t, order, object));
                }
            }
        }
        best.map(|(t, _, object)| (t, object))
    }

    fn blocked(&self, o: DVec3, d: DVec3, from: Object) -> bool {
        self.objects().any(|object| self.hit(object, o, d, from == object).is_some_and(|t| t < 1.0))
    }

    /// The least t > 0 at which the ray meets the object.
    fn hit(&self, object: Object, o: DVec3, d: DVec3, own: bool) -> Option<f64> {
        match object {
            Object::Sphere(i) => {
                let s = &self.scene.spheres()[i];
                let to = s.center - o;
                let (a, b) = (d.length_squared(), d.dot(to));
                if own {
                    return Some(2.0 * b / a).filter(|&t| t > 0.0);
                }
                let c = to.length_squared() - s.radius * s.radius;
                // Distance of centre and line, squared: steadier than b² − ac.
                let miss = (to - d * (b / a)).length_squared();
                let disc = s.radius * s.radius - miss;
                if disc < 0.0 {
                    return None;
                }
                let q = b + (disc * a).sqrt().copysign(b);
                let (t0, t1) = (c / q, q / a);
                let (near, far) = if t0 < t1 { (t0, t1) } else { (t1, t0) };
                if near > 0.0 { Some(near) } else { Some(far).filter(|&t| t > 0.0) }
            }
            _ if own => None,
            Object::Plane(i) => {
                let (n, point) = self.plane(i);
                let t = (point - o).dot(n) / d.dot(n);
                Some(t).filter(|&t| t > 0.0 && t.is_finite())
            }
            Object::Triangle(i) => {
                // Möller, Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997.
                let [a, b, c] = self.scene.triangles()[i].corners();
                let (e1, e2) = (b - a, c - a);
                let p = d.cross(e2);
                let det = e1.dot(p);
                if det == 0.0 {
                    return None;
                }
                let s = o - a;
                let u = s.dot(p) / det;
                let q = s.cross(e1);
                let v = d.dot(q) / det;
                let t = e2.dot(q) / det;
                (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
            }
        }
    }

    /// Unit normal and a point of plane i.
    fn plane(&self, i: usize) -> (DVec3, DVec3) {
        let p = &self.scene.planes()[i];
        let n = p.normal.normalize();
        match p.position {
            PlanePosition::Point(q) => (n, q),
            PlanePosition::Distance(d) => (n, n * d),
        }
    }

    fn normal(&self, object: Object, p: DVec3) -> DVec3 {
        match object {
            Object::Plane(i) => self.plane(i).0,
            Object::Sphere(i) => (p - self.scene.spheres()[i].center).normalize(),
            Object::Triangle(i) => {
                let [a, b, c] = self.scene.triangles()[i].corners();
                (b - a).cross(c - a).normalize()
            }
        }
    }

    fn surface(&self, object: Object) -> SurfaceId {
        match object {
            Object::Plane(i) => self.scene.planes()[i].surface,
            Object::Sphere(i) => self.scene.spheres()[i].surface,
            Object::Triangle(i) => self.scene.triangles()[i].surface(),
        }
    }

    fn order(&self, object: Object) -> u32 {
        match object {
            Object::Plane(i) => self.scene.planes()[i].order,
            Object::Sphere(i) => self.scene.spheres()[i].order,
            Object::Triangle(i) => self.scene.triangles()[i].order,
        }
    }

    fn uv(&self, object: Object, p: DVec3) -> ([f64; 2], [Edge; 2]) {
        match object {
            Object::Sphere(i) => {
                let m = self.normal(object, p);
                let index = u32::try_from(i).unwrap_or(u32::MAX);
                let (pole, equator) =
                    self.scene.orientation(index).map_or((DVec3::Y, DVec3::X), |o| (o.pole, o.equator));
                let pole = pole.normalize();
                let e = (equator - pole * equator.dot(pole)).normalize();
                let b = e.cross(pole);
                let v = 1.0 - libm::atan2(m.cross(pole).length(), m.dot(pole)) / std::f64::consts::PI;
                let u = libm::atan2(m.dot(b), m.dot(e)) / std::f64::consts::TAU;
                ([u - u.floor(), v], [Edge::Wrap, Edge::Clamp])
            }
            Object::Triangle(i) => {
                let [a, b, c] = self.scene.triangles()[i].corners();
                let (e1, e2, s) = (b - a, c - a, p - a);
                let n = e1.cross(e2);
                let u = s.cross(e2).dot(n) / n.length_squared();
                let v = e1.cross(s).dot(n) / n.length_squared();
                ([u, v], [Edge::Clamp, Edge::Clamp])
            }
            Object::Plane(i) => {
                let (n, origin) = self.plane(i);
                let a = n.abs();
                let axis = if a.x <= a.y && a.x <= a.z {
                    DVec3::X
                } else if a.y <= a.z {
                    DVec3::Y
                } else {
                    DVec3::Z
                };
                let u_axis = axis.cross(n).normalize();
                let v_axis = n.cross(u_axis);
                let (u, v) = ((p - origin).dot(u_axis), (p - origin).dot(v_axis));
                ([u - u.floor(), v - v.floor()], [Edge::Wrap, Edge::Wrap])
            }
        }
    }
}
