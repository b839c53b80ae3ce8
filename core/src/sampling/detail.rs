//! How much a picture on a surface varies between a pixel's corners.

use glam::{DVec2, DVec3};

use crate::geometry::ObjectId;
use crate::geometry::local::kind;
use crate::scene::Pigment;
use crate::trace::Tracer;

/// Texels looked at along an edge of a footprint at most.
const EDGE: i64 = 5;

impl Tracer {
    /// Root mean square distance from their mean of the texels between four places of `object`'s picture;
    /// `None` where it has none.
    pub(crate) fn picture_spread(&self, object: u32, uv: [DVec2; 4]) -> Option<f64> {
        let material = self.material(ObjectId(object));
        let Pigment::Picture(id) = material.pigment else { return None };
        let scene = &self.prepared().scene;
        let data = &scene.pictures()[id.0 as usize];
        let size = DVec2::new(f64::from(data.width()), f64::from(data.height()));
        let wraps = crate::trace::texture::wraps(kind(scene, ObjectId(object)));
        let (mut lo, mut hi) = (DVec2::ZERO, DVec2::ZERO);
        for c in &uv[1..] {
            let mut d = *c - uv[0];
            if wraps[0] {
                d.x -= (d.x + 0.5).floor();
            }
            if wraps[1] {
                d.y -= (d.y + 0.5).floor();
            }
            lo = lo.min(d);
            hi = hi.max(d);
        }
        let span = (hi - lo) * size;
        let steps = |x: f64| ((x.ceil() as i64) + 1).clamp(2, EDGE);
        let (nx, ny) = (steps(span.x), steps(span.y));
        let (mut sum, mut squares) = (DVec3::ZERO, 0.0);
        for j in 0..ny {
            for i in 0..nx {
                let t = DVec2::new((i as f64 + 0.5) / nx as f64, (j as f64 + 0.5) / ny as f64);
                let at = uv[0] + lo + (hi - lo) * t;
                let fraction = |x: f64, wrap: bool| if wrap { x - x.floor() } else { x.clamp(0.0, 1.0) };
                let at = DVec2::new(fraction(at.x, wraps[0]), fraction(at.y, wraps[1]));
                let c = self.picture_color(id, at, ObjectId(object));
                sum += c;
                squares += c.dot(c);
            }
        }
        let n = (nx * ny) as f64;
        let variance = (squares / n - (sum / n).dot(sum / n)).max(0.0) / 3.0;
        Some(variance.sqrt() * material.albedo.max_element())
    }
}
