//! Spots of light that shadows leave between them.
//!
//! Where one convex object keeps a light from all corners of a pixel, it keeps it from the whole
//! pixel, as far as that is flat. Where different ones do, light may pass between.

use glam::DVec3;

use super::corners::Seen;
use super::lattice::{rms, vector};
use crate::geometry::ObjectId;
use crate::geometry::local::{Kind, kind};
use crate::trace::Tracer;
use crate::trace::record::{NONE, Records};

/// Standard deviation of a pixel's mean for light that may pass, as a share of it.
const SPOT: f64 = 0.1;

/// What light may pass between shadows.
#[derive(Debug, Default)]
pub(super) struct Gaps {
    /// Variance of what that does to a pixel's mean.
    pub(super) variance: f64,
    /// The lights, where paths meet something first.
    pub(super) lights: Vec<u32>,
    /// Whether that may be in a mirror, too.
    pub(super) mirrored: bool,
}

impl Gaps {
    /// Those of a pixel whose corners see this.
    pub(super) fn new(tracer: &Tracer, records: &Records, corners: [&Seen; 4]) -> Self {
        let mut gaps = Self::default();
        let one = corners[0];
        if corners[1..].iter().all(|s| (s.signature, s.shadows) == (one.signature, one.shadows)) {
            return gaps;
        }
        for (k, one) in corners.iter().enumerate() {
            let alike = |s: &&&Seen| s.signature == one.signature;
            if corners[..k].iter().any(|s| alike(&s)) || corners.iter().filter(alike).all(|s| s.shadows == one.shadows)
            {
                continue;
            }
            let group: Vec<&Seen> = corners.iter().filter(alike).copied().collect();
            gaps.add(tracer, records, &group);
        }
        gaps
    }

    /// Adds those between the shadows that corners alike are in.
    fn add(&mut self, tracer: &Tracer, records: &Records, alike: &[&Seen]) {
        let mut paths: Vec<_> = alike.iter().map(|s| records.path(s.path as usize)).collect();
        let share = alike.len() as f64 / 4.0;
        for depth in 1usize.. {
            let places: Vec<_> = paths.iter_mut().filter_map(Iterator::next).collect();
            if places.len() < alike.len() {
                return;
            }
            let blockers: Vec<_> = places.iter().map(|(i, _)| records.blockers(*i)).collect();
            for (light, &from) in tracer.lights().iter().enumerate().take(blockers[0].len()) {
                let blocker = |k: usize| blockers[k][light];
                let first = blocker(0);
                if (1..places.len()).all(|k| blocker(k) == first) || (0..places.len()).any(|k| blocker(k) == NONE) {
                    continue;
                }
                let covered = |k: usize| places.iter().all(|(_, m)| covers(tracer, blocker(k), m.p, from));
                if (0..places.len()).any(covered) {
                    continue;
                }
                let e = SPOT * share * rms(places[0].1.unshadowed(from));
                self.variance += e * e;
                if depth > 1 {
                    self.mirrored = true;
                } else if !self.lights.contains(&(light as u32)) {
                    self.lights.push(light as u32);
                }
            }
        }
    }
}

/// Whether an object is between two points. Triangles are taken to be of meshes without gaps.
fn covers(tracer: &Tracer, object: u32, p: DVec3, light: DVec3) -> bool {
    let prepared = tracer.prepared();
    let Kind::Sphere(i) = kind(&prepared.scene, ObjectId(object)) else { return true };
    let s = &prepared.local.spheres[i];
    let (d, to) = (light - p, vector(s.c) - p);
    let t = (to.dot(d) / d.dot(d)).clamp(0.0, 1.0);
    (d * t - to).length_squared() <= s.r * s.r
}
