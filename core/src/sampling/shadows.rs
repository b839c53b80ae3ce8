//! Which lights fall on all that a tile's pixels show of a surface, and which on none of it.

use glam::DVec3;

use crate::beam::cover::{Depth, Shape};
use crate::beam::gather::{Shaft, gather};
use crate::beam::lens::{MARGIN, Pixels, Tile, pixels_above, row};
use crate::shapes::ObjectId;
use crate::shapes::beam::{Blocker, Figure};
use crate::traverse::PreparedScene;

use super::coverage::Shapes;
use super::proof::{Doubt, MIDDLE, View, open};

/// Of a sheet of more triangles than this, the edges of shadows are not told apart.
pub(super) const APART: usize = 2;
/// Triangles are looked at together where their inverse distances differ by such factors at most.
const TOGETHER: f64 = 1.2;

/// A surface that is seen in all points of some pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Receiver {
    pub(super) id: u32,
    pub(super) pixels: Pixels,
    pub(super) depth: Depth,
    /// Whether the edges of shadows on it are worth telling apart.
    pub(super) apart: bool,
}

impl Receiver {
    /// Its least and greatest inverse distance.
    #[inline(always)]
    fn range(&self, tile: &Tile) -> (f64, f64) {
        let (mut lo, mut hi) = (f64::INFINITY, 0.0f64);
        for j in (0..8).filter(|j| self.pixels >> (8 * j) & 0xff != 0) {
            let (l, h) = self.depth.row(tile, j);
            for k in (0..8).filter(|k| self.pixels >> (8 * j + k) & 1 == 1) {
                (lo, hi) = (lo.min(l[k]), hi.max(h[k]));
            }
        }
        (lo, hi)
    }
}

/// Surfaces that are looked at together: one, or triangles about as far away.
pub(super) struct Group {
    pub(super) receivers: Vec<Receiver>,
    pub(super) pixels: Pixels,
    /// The least and greatest inverse distance of triangles; none where it is of another surface.
    pub(super) range: Option<(f64, f64)>,
}

impl Group {
    /// Adds a surface to the groups: to one of triangles, if it is one, or as a group of its own.
    #[inline(always)]
    pub(super) fn add(groups: &mut Vec<Self>, tile: &Tile, receiver: Receiver, triangle: bool) {
        let range = triangle.then(|| receiver.range(tile));
        if let Some((lo, hi)) = range {
            for group in groups.iter_mut() {
                let Some(so_far) = group.range else { continue };
                let both = (lo.min(so_far.0), hi.max(so_far.1));
                if both.1 < TOGETHER * both.0 {
                    group.receivers.push(receiver);
                    (group.pixels, group.range) = (group.pixels | receiver.pixels, Some(both));
                    return;
                }
            }
        }
        groups.push(Self { receivers: vec![receiver], pixels: receiver.pixels, range });
    }
}

/// A flat surface n · P = h, n of length 1 and towards the eye.
#[derive(Clone, Copy)]
struct Flat {
    n: DVec3,
    h: f64,
}

/// What stands, or may stand, between.
enum Between {
    Nothing,
    All,
    /// These objects.
    Some(Vec<u32>),
}

impl View<'_> {
    /// Adds the lights that fall on a part of what is seen of `group`, or may.
    #[inline(always)]
    pub(super) fn shadows(&self, group: &Group, doubt: &mut Doubt, shapes: &mut Shapes) {
        let lights = &self.tracer.prepared().local.lights;
        if lights.is_empty() {
            return;
        }
        let Some((hull, ball)) = self.hull(group) else {
            let all: f64 = group.receivers.iter().map(|r| self.albedo(r)).fold(0.0, f64::max);
            return open(doubt, group.pixels, all * lights.len() as f64);
        };
        let mut found = Vec::new();
        let mut blockers = Vec::new();
        let surfaces: Vec<Surface> = group.receivers.iter().map(|r| self.surface(r)).collect();
        for &light in lights {
            found.clear();
            let facing = |s: &Surface| !s.flat.is_some_and(|f| f.n.dot(light) < f.h);
            if !surfaces.iter().any(facing) {
                // The light is on the other side of all.
                continue;
            }
            let shaft = Shaft::new(light, ball.0, ball.1);
            // A light so near that its cosine bends within a pixel, an eighth of the tile.
            let (near, wide) = ((light - ball.0).length() - ball.1, 0.5 * ball.1);
            let bends = surfaces.iter().map(|s| s.albedo).fold(0.0, f64::max) * 0.125;
            if !(near > 0.0 && bends * wide * wide < MIDDLE * self.tolerance * near * near) {
                open(doubt, group.pixels, bends);
            }
            if !gather(&self.tracer.prepared().boxes, &shaft, self.most, &mut found) {
                for s in surfaces.iter().filter(|s| facing(s)) {
                    open(doubt, s.receiver.pixels, s.albedo);
                }
                continue;
            }
            blockers.clear();
            for &id in &found {
                if let Some(blocker) = self.blocker(id, &hull, light, &shaft) {
                    blockers.push(blocker);
                }
            }
            for s in surfaces.iter().filter(|s| facing(s)) {
                if let Between::Some(ids) = self.between(s, &hull, light, &blockers) {
                    let pixels = match s.flat {
                        Some(flat) if s.receiver.apart => self.edges(&s.receiver, flat, light, &ids, shapes),
                        _ => s.receiver.pixels,
                    };
                    open(doubt, pixels, s.albedo);
                }
            }
        }
    }

    #[inline(always)]
    fn surface(&self, receiver: &Receiver) -> Surface {
        let PreparedScene { scene, local, .. } = self.tracer.prepared();
        let corners = Figure::of(scene, local, ObjectId(receiver.id)).corners();
        Surface { receiver: *receiver, flat: self.flat(receiver.id), corners, albedo: self.albedo(receiver) }
    }

    /// Object `id` as what may stand between `light` and points of the hull; none where it surely does not.
    #[inline(always)]
    fn blocker(&self, id: u32, hull: &[DVec3; 8], light: DVec3, shaft: &Shaft) -> Option<(u32, Blocker)> {
        let PreparedScene { scene, local, .. } = self.tracer.prepared();
        Some((id, Figure::of(scene, local, ObjectId(id)).blocker(hull, light, shaft)?))
    }

    /// What a light that falls in vertically makes of it.
    #[inline(always)]
    fn albedo(&self, receiver: &Receiver) -> f64 {
        self.weight * self.tracer.material(ObjectId(receiver.id)).albedo.max_element()
    }

    #[inline(always)]
    fn flat(&self, id: u32) -> Option<Flat> {
        let PreparedScene { scene, local, .. } = self.tracer.prepared();
        let (n, h) = Figure::of(scene, local, ObjectId(id)).supporting_plane()?;
        Some(if n.dot(self.lens.apex) < h { Flat { n: -n, h: -h } } else { Flat { n, h } })
    }

    /// Points whose hull has all that is seen of the group in it, and a ball around them; none where that may be
    /// infinitely large.
    #[inline(always)]
    fn hull(&self, group: &Group) -> Option<([DVec3; 8], (DVec3, f64))> {
        let (mut lo, mut hi) = (f64::INFINITY, 0.0f64);
        let (mut x, mut y) = ((7, 0), (7, 0));
        for receiver in &group.receivers {
            let (l, h) = receiver.range(self.tile);
            (lo, hi) = (lo.min(l), hi.max(h));
            for at in (0..64).filter(|at| receiver.pixels >> at & 1 == 1) {
                (x, y) = ((x.0.min(at % 8), x.1.max(at % 8)), (y.0.min(at / 8), y.1.max(at / 8)));
            }
        }
        if !(lo > 0.0 && hi < f64::INFINITY) {
            return None;
        }
        let half = crate::beam::lens::HALF;
        let (left, right) = (self.tile.x[x.0] - half, self.tile.x[x.1] + half);
        let (top, bottom) = (self.tile.y[y.0] + half, self.tile.y[y.1] - half);
        let mut hull = [DVec3::ZERO; 8];
        for (k, (x, y)) in [(left, top), (right, top), (right, bottom), (left, bottom)].into_iter().enumerate() {
            let d = self.lens.direction(x, y);
            (hull[k], hull[k + 4]) = (self.lens.apex + d * (1.0 / lo), self.lens.apex + d * (1.0 / hi));
        }
        let center = hull.iter().sum::<DVec3>() * 0.125;
        let radius = hull.iter().map(|p| (*p - center).length()).fold(0.0, f64::max) * (1.0 + 1e-9);
        radius.is_finite().then_some((hull, (center, radius)))
    }

    /// What may stand between `light` and any point of the surface that is seen.
    #[inline(always)]
    fn between(&self, surface: &Surface, hull: &[DVec3; 8], light: DVec3, blockers: &[(u32, Blocker)]) -> Between {
        let prepared = self.tracer.prepared();
        let receiver = &surface.receiver;
        for (i, plane) in prepared.local.planes.iter().enumerate() {
            if i as u32 == receiver.id {
                continue;
            }
            let (n, h) = (plane.n.to_dvec3(), plane.h);
            let side = |p: DVec3| n.dot(p) - h;
            let size = MARGIN * (h.abs() + light.length() + hull[0].length() + hull[6].length());
            let (of_light, slack) = (side(light), 1e3 * size);
            let (least, most) = hull
                .iter()
                .map(|p| side(*p))
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), s| (a.min(s), b.max(s)));
            if (of_light >= -slack && least >= -slack) || (of_light <= slack && most <= slack) {
                continue;
            }
            if (of_light > slack && most < -slack) || (of_light < -slack && least > slack) {
                return Between::All;
            }
            return Between::Some(std::iter::once(i as u32).chain(blockers.iter().map(|(id, _)| *id)).collect());
        }
        let mut ids = Vec::new();
        for (id, blocker) in blockers {
            let flat = surface.flat.map(|f| (f.n, f.h));
            if *id != receiver.id && !blocker.is_harmless(flat, surface.corners.as_ref()) {
                ids.push(*id);
            }
        }
        if ids.is_empty() { Between::Nothing } else { Between::Some(ids) }
    }

    /// Pixels of a flat receiver that the shadow of one of `blockers` touches and none covers.
    #[inline(always)]
    fn edges(&self, receiver: &Receiver, flat: Flat, light: DVec3, blockers: &[u32], shapes: &mut Shapes) -> Pixels {
        let lens = self.lens.lit_from(light, flat.n, flat.h);
        let own = self.lens.along(flat.n, self.tile);
        let PreparedScene { scene, local, .. } = self.tracer.prepared();
        let (mut touched, mut covered) = (0, 0);
        for &id in blockers {
            let (cover, triangle) = Figure::of(scene, local, ObjectId(id)).cover(&lens, self.tile);
            let (mut before, mut beyond) = (0, 0);
            for j in 0..8 {
                if (cover.touched & receiver.pixels) >> (8 * j) & 0xff == 0 {
                    continue;
                }
                let (at, spread) = (row(&own, self.tile, j), own.spread());
                let (lo, hi) = cover.depth.row(self.tile, j);
                for k in 0..8 {
                    let bit = 1u64 << (8 * j + k);
                    // What is nearer to the light than the surface is between.
                    beyond |= if hi[k] < at[k].abs() - spread { bit } else { 0 };
                    before |= if lo[k] > at[k].abs() + spread { bit } else { 0 };
                }
            }
            touched |= cover.touched & !beyond;
            covered |= cover.covered & before;
            let may = receiver.pixels & cover.touched & !beyond & !cover.covered;
            if let Some((_, outline)) = triangle {
                for edge in &outline.edges {
                    shapes.push((may & !pixels_above(edge, self.tile, edge.spread()), Shape::Edge(*edge)));
                }
            } else if let Some(oval) = cover.depth.outline() {
                shapes.push((may, oval));
            }
        }
        receiver.pixels & touched & !covered
    }
}

/// A receiver with what is asked about it.
struct Surface {
    receiver: Receiver,
    flat: Option<Flat>,
    corners: Option<[DVec3; 3]>,
    /// What a light that falls in vertically makes of it.
    albedo: f64,
}
