//! What is proven of a tile's pixels before any of them is sampled.
//!
//! A pixel is proven where all of its points see one surface, or one sheet of triangles, or nothing at all; where
//! every light falls on all of that or on none of it; and where flat mirrors show what is proven. There, one
//! point tells the mean. Everything else is open, as much as what is not known of it can weigh.

use glam::DVec3;

use crate::beam::cover::{Cover, Depth};
use crate::beam::gather::{Pyramid, gather};
use crate::beam::lens::{HALF, Lens, Linear, MARGIN, Pixels, Tile, greater, pixels_above, row};
use crate::film::PlanePoint;
use crate::integrate::Tracer;
use crate::scene::Pigment;
use crate::shapes::ObjectId;
use crate::shapes::beam::Figure;
use crate::shapes::triangle::beam::Outline;
use crate::simd::{Kernel, Simd};
use crate::traverse::PreparedScene;

use super::coverage::Shapes;
use super::shadows::{APART, Group, Receiver};
use super::sheet;

/// Flat mirrors that are looked into, one behind the other.
const MIRRORS: u32 = 4;
/// What weighs less than this is not worth a proof.
const FAINT: f64 = 1e-4;
/// A pixel's middle may be taken for its mean where that is off by less than this share of the tolerance.
pub(super) const MIDDLE: f64 = 0.25;
/// And where normals turn by less than this across it, whatever the tolerance.
const TURN: f64 = 0.06;

/// What is not proven of each pixel of a tile: how much may hide there, as a part of full scale.
pub(crate) type Doubt = [f32; 64];

/// An object before a tile.
pub(super) struct Candidate {
    pub(super) id: u32,
    pub(super) cover: Cover,
    /// Corners and outline of a triangle that is not seen edge-on.
    pub(super) triangle: Option<([DVec3; 3], Outline)>,
    /// Pixels in which nothing is known to hide it.
    pub(super) alive: Pixels,
}

/// What is in doubt in the pixels of the tile whose upper left pixel has its centre at `at`, under `tolerance`, a
/// part of full scale. Where more than `most` objects may be met, or stand between it and a light, it is left open.
pub(crate) fn prove(tracer: &Tracer, at: PlanePoint, tolerance: f64, most: usize) -> (Doubt, Shapes) {
    crate::simd::dispatch(tracer.level(), Prove { tracer, tile: Tile::new(at.x, at.y), tolerance, most })
}

struct Prove<'a> {
    tracer: &'a Tracer,
    tile: Tile,
    tolerance: f64,
    most: usize,
}

impl Kernel for Prove<'_> {
    type Output = (Doubt, Shapes);
    #[inline(always)]
    fn run<S: Simd>(self) -> (Doubt, Shapes) {
        let frame = self.tracer.frame();
        let lens = Lens { apex: DVec3::ZERO, forward: frame.forward, right: frame.right, up: frame.up };
        let (mut doubt, mut shapes) = ([0.0; 64], Vec::new());
        let eye = View {
            tracer: self.tracer,
            tile: &self.tile,
            tolerance: self.tolerance,
            most: self.most,
            lens,
            mirror: None,
            weight: 1.0,
            behind: 0,
        };
        let mut views = vec![(eye, Pixels::MAX)];
        while let Some((view, pixels)) = views.pop() {
            view.prove(pixels, &mut doubt, &mut shapes, &mut views);
        }
        (doubt, shapes)
    }
}

/// What is seen through one lens.
pub(super) struct View<'a> {
    pub(super) tracer: &'a Tracer,
    pub(super) tile: &'a Tile,
    pub(super) tolerance: f64,
    /// Objects that are looked at, at most.
    pub(super) most: usize,
    pub(super) lens: Lens,
    /// The flat mirror that is looked into: its object, normal, offset, and inverse distance.
    mirror: Option<(u32, DVec3, f64, Linear)>,
    /// The share of what is seen that arrives.
    pub(super) weight: f64,
    /// Mirrors looked into so far.
    behind: u32,
}

/// Adds `weight` to the doubt of some pixels.
pub(super) fn open(doubt: &mut Doubt, pixels: Pixels, weight: f64) {
    let mut rest = pixels;
    while rest != 0 {
        doubt[rest.trailing_zeros() as usize] += weight as f32;
        rest &= rest - 1;
    }
}

impl<'a> View<'a> {
    /// Adds what is not proven of the pixels `of`, and what is seen in mirrors to `views`.
    #[inline(always)]
    fn prove(&self, of: Pixels, doubt: &mut Doubt, shapes: &mut Shapes, views: &mut Vec<(View<'a>, Pixels)>) {
        let Some(mut candidates) = self.candidates(of) else { return open(doubt, of, self.weight) };
        let mut nearest = [0.0; 64];
        for c in &candidates {
            self.raise(&mut nearest, c.alive & c.cover.covered, &c.cover.depth);
        }
        let sheets = sheet::sheets(self, &mut candidates, &mut nearest, shapes);
        self.hide(&mut candidates, &nearest);
        for c in &candidates {
            if let Some(oval) = c.cover.depth.outline() {
                shapes.push((c.alive, oval));
            }
        }
        let (mut once, mut twice) = (0, 0);
        for c in &candidates {
            twice |= once & c.alive;
            once |= c.alive;
        }
        let whole = sheets.proven(&candidates);
        let mut groups: Vec<Group> = Vec::new();
        let mut proven = of & !once;
        for c in &candidates {
            let pixels = of & c.alive & c.cover.covered & !twice;
            if pixels != 0 {
                proven |= pixels;
                let receiver = Receiver { id: c.id, pixels, depth: c.cover.depth, apart: true };
                Group::add(&mut groups, self.tile, receiver, c.triangle.is_some());
            }
        }
        let sheet = of & whole & !proven;
        if sheet != 0 {
            proven |= sheet;
            let parts = candidates.iter().filter(|c| c.alive & sheet != 0);
            let apart = parts.clone().count() <= APART;
            for c in parts {
                let receiver = Receiver { id: c.id, pixels: c.alive & sheet, depth: c.cover.depth, apart };
                Group::add(&mut groups, self.tile, receiver, true);
            }
            self.facets(&candidates, sheet, doubt);
        }
        open(doubt, of & !proven, self.weight);
        for group in &groups {
            self.shade(group, doubt, shapes, views);
        }
    }

    /// The objects that may be met in the pixels `of`; none where they are too many.
    #[inline(always)]
    fn candidates(&self, of: Pixels) -> Option<Vec<Candidate>> {
        let prepared = self.tracer.prepared();
        let mut pyramid = Pyramid::new(&self.lens, self.tile);
        if let Some((_, n, h, _)) = self.mirror {
            // Behind the mirror, as the lens sees it, is before it.
            let side = if n.dot(self.lens.apex) > h { -1.0 } else { 1.0 };
            pyramid = pyramid.cut(n * side, h * side - 1e-9 * (h.abs() + 1.0));
        }
        let mut ids: Vec<u32> = (0..prepared.local.planes.len() as u32).collect();
        if ids.len() > self.most || !gather(&prepared.boxes, &pyramid, self.most, &mut ids) {
            return None;
        }
        let own = self.mirror.map(|m| m.0);
        let mut candidates = Vec::with_capacity(ids.len());
        for id in ids.into_iter().filter(|id| Some(*id) != own) {
            let mut candidate = self.candidate(id);
            if let Some((_, _, _, start)) = &self.mirror {
                let spread = start.spread();
                let (mut touched, mut covered) = (0, 0);
                for j in 0..8 {
                    let (from, (lo, hi)) = (row(start, self.tile, j), candidate.cover.depth.row(self.tile, j));
                    for k in 0..8 {
                        let bit = 1 << (8 * j + k);
                        touched |= if lo[k] > from[k] + spread { 0 } else { bit };
                        covered |= if hi[k] < from[k] - spread { bit } else { 0 };
                    }
                }
                candidate.cover.touched &= touched;
                candidate.cover.covered &= covered;
            }
            candidate.alive = candidate.cover.touched & of;
            if candidate.alive != 0 {
                candidates.push(candidate);
            }
        }
        Some(candidates)
    }

    #[inline(always)]
    fn candidate(&self, id: u32) -> Candidate {
        let PreparedScene { scene, local, .. } = self.tracer.prepared();
        let (cover, triangle) = Figure::of(scene, local, ObjectId(id)).cover(&self.lens, self.tile);
        Candidate { id, cover, triangle, alive: 0 }
    }

    /// Notes that something with this depth is met in all points of `pixels`.
    #[inline(always)]
    pub(super) fn raise(&self, nearest: &mut [f64; 64], pixels: Pixels, depth: &Depth) {
        if pixels == 0 {
            return;
        }
        for j in 0..8 {
            let mask = pixels >> (8 * j) & 0xff;
            if mask != 0 {
                let (lo, _) = depth.row(self.tile, j);
                for k in 0..8 {
                    if mask >> k & 1 == 1 && lo[k] > nearest[8 * j + k] {
                        nearest[8 * j + k] = lo[k];
                    }
                }
            }
        }
    }

    /// Takes away pixels in which candidates are behind what is met in all of their points.
    #[inline(always)]
    pub(super) fn hide(&self, candidates: &mut Vec<Candidate>, nearest: &[f64; 64]) {
        for c in candidates.iter_mut() {
            let mut hidden = 0;
            for j in 0..8 {
                if c.alive >> (8 * j) & 0xff == 0 {
                    continue;
                }
                let (_, hi) = c.cover.depth.row(self.tile, j);
                let mut bound = [0.0; 8];
                for k in 0..8 {
                    bound[k] = nearest[8 * j + k] * (1.0 - MARGIN);
                }
                hidden |= u64::from(greater(&bound, &hi)) << (8 * j);
            }
            c.alive &= !hidden;
        }
        candidates.retain(|c| c.alive != 0);
    }

    /// What facets of one sheet may differ by in the pixels that several of them share.
    #[inline(always)]
    fn facets(&self, candidates: &[Candidate], sheet: Pixels, doubt: &mut Doubt) {
        let (mut least, mut most) = ([f32::INFINITY; 64], [0.0f32; 64]);
        for c in candidates.iter().filter(|c| c.alive & sheet != 0) {
            let light = self.unshadowed(c) as f32;
            let mut rest = c.alive & sheet;
            while rest != 0 {
                let at = rest.trailing_zeros() as usize;
                rest &= rest - 1;
                (least[at], most[at]) = (least[at].min(light), most[at].max(light));
            }
        }
        for at in 0..64 {
            if sheet >> at & 1 == 1 {
                doubt[at] += 0.5 * (most[at] - least[at]) * self.weight as f32;
            }
        }
    }

    /// What lights make of a triangle's middle, were nothing between.
    #[inline(always)]
    fn unshadowed(&self, c: &Candidate) -> f64 {
        let Some((v, _)) = &c.triangle else { return 1.0 };
        let middle = (v[0] + v[1] + v[2]) * (1.0 / 3.0);
        let n = (v[1] - v[0]).cross(v[2] - v[0]);
        let n = n * (1.0 / n.length());
        let n = if n.dot(self.lens.apex - v[0]) < 0.0 { -n } else { n };
        let albedo = self.tracer.material(ObjectId(c.id)).albedo.max_element();
        let lights = self.tracer.prepared().local.lights.iter();
        albedo
            * lights
                .map(|l| *l - middle)
                .map(|l| (n.dot(l) / l.length()).max(0.0))
                .filter(|c| c.is_finite())
                .sum::<f64>()
    }

    /// Adds what is not proven of the light that a group of surfaces sends on.
    #[inline(always)]
    fn shade(&self, group: &Group, doubt: &mut Doubt, shapes: &mut Shapes, views: &mut Vec<(View<'a>, Pixels)>) {
        let mut matte = Vec::new();
        for receiver in &group.receivers {
            let id = ObjectId(receiver.id);
            let material = self.tracer.material(id);
            let albedo = material.albedo.max_element();
            if let Pigment::Texture(_) = material.pigment
                && albedo > 0.0
            {
                open(doubt, receiver.pixels, self.weight * albedo);
            }
            let curved = self.curved(receiver);
            open(doubt, curved, 0.25 * self.weight * (albedo + material.reflect()));
            let reflected = self.weight * material.reflect();
            if reflected > FAINT && self.tracer.settings().max_depth > self.behind + 1 {
                self.reflect(receiver, reflected, doubt, views);
            }
            if albedo * self.weight > FAINT {
                matte.push(*receiver);
            }
        }
        if !matte.is_empty() {
            let pixels = matte.iter().fold(0, |all, r| all | r.pixels);
            self.shadows(&Group { receivers: matte, pixels, ..*group }, doubt, shapes);
        }
    }

    /// Pixels in which a surface turns, or its distance changes, so much that their middle is not their mean.
    #[inline(always)]
    fn curved(&self, receiver: &Receiver) -> Pixels {
        let scale = 2.0 * HALF * self.lens.right.length();
        match receiver.depth {
            Depth::Flat(w) => {
                let spread = w.spread();
                receiver.pixels & !pixels_above(&w, self.tile, 8.0 * spread)
            }
            Depth::Ball { r, .. } => {
                // Over a width in which normals turn by so much, cosines bend by a twenty-fourth of its square.
                let material = self.tracer.material(ObjectId(receiver.id));
                let light = self.tracer.prepared().local.lights.len() as f64 * material.albedo.max_element();
                let turn = (24.0 * MIDDLE * self.tolerance / (self.weight * light).max(1e-9)).sqrt().min(TURN);
                let mut curved = 0;
                for j in (0..8).filter(|j| receiver.pixels >> (8 * j) & 0xff != 0) {
                    let (lo, hi) = receiver.depth.row(self.tile, j);
                    for k in 0..8 {
                        // A pixel's width on the sphere, were it seen from above; and how far away it slopes.
                        let wide = scale / lo[k];
                        let deep =
                            (1.0 / lo[k] - 1.0 / hi[k]) * self.lens.direction(self.tile.x[k], self.tile.y[j]).length();
                        curved |= u64::from(!(wide + deep < turn * r)) << (8 * j + k);
                    }
                }
                receiver.pixels & curved
            }
            Depth::Unknown => receiver.pixels,
        }
    }

    /// Looks into a mirror.
    fn reflect(&self, receiver: &Receiver, weight: f64, doubt: &mut Doubt, views: &mut Vec<(View<'a>, Pixels)>) {
        let PreparedScene { scene, local, .. } = self.tracer.prepared();
        let plane = Figure::of(scene, local, ObjectId(receiver.id)).supporting_plane();
        match (plane, receiver.depth) {
            (Some((n, h)), Depth::Flat(w)) if self.behind < MIRRORS => {
                let lens = self.lens.mirrored(n, h);
                let mirror = Some((receiver.id, n, h, w));
                views.push((View { lens, mirror, weight, behind: self.behind + 1, ..*self }, receiver.pixels));
            }
            _ => open(doubt, receiver.pixels, weight),
        }
    }
}
