//! How a scene's numbers lie, and what the tracer makes of them.

use rayon::prelude::*;

use super::coplanar::SharedPlanes;
use super::prepared::PreparedScene;
use crate::bvh::Boxes;
use crate::scene::{Sphere, Triangle};
use crate::shapes::{Listed, column, triangle};

/// A prepared scene's numerical condition. Lengths are in scene units, to f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Condition {
    /// Distance from the camera within which all bounded objects lie; 0 without any.
    pub reach: f64,
    /// Distance of the camera from the origin of the scene's coordinates.
    pub offset: f64,
    /// Diameter of the smallest and of the largest bounded object.
    pub sizes: Option<(f64, f64)>,
    /// Triangles more than a million times longer than high.
    pub slivers: usize,
    /// Triangles of exactly no area, which nothing ever meets.
    pub flat: usize,
    /// Triangles with the same corners as an earlier one, which stands for them.
    pub coinciding: usize,
    /// Spheres equal to an earlier one, which stands for them.
    pub coinciding_spheres: usize,
    /// Objects that lie in one exact plane, with one another, a light or the eye.
    pub shared: SharedPlanes,
    /// Objects far larger than their distance from the eye, which are described around it.
    pub giants: usize,
    /// Planes that are the same surface as an earlier one, or within 1e-9 of the reach of it.
    pub near_planes: usize,
    /// Whether boxes are kept as f32, and what share of objects would outgrow such boxes.
    pub single_boxes: bool,
    /// Share of objects whose boxes f32 would enlarge by more than half.
    pub outgrown: f64,
    /// Whether rays are filtered in packets of f32 before f64 looks at them.
    pub packets: bool,
}

impl PreparedScene {
    /// How the scene's numbers lie, and which representation was chosen for them.
    #[must_use]
    pub fn condition(&self) -> Condition {
        let scene = self.scene();
        let world = |x: f64| crate::shapes::local::ldexp(x, self.local.power);
        let triangle = |t: &Triangle| {
            let (longest, sliver) = triangle::bounds::length(&self.local.triangle(t));
            (longest, longest, usize::from(sliver))
        };
        let merge = |a: (f64, f64, usize), b: (f64, f64, usize)| (a.0.min(b.0), a.1.max(b.1), a.2 + b.2);
        let none = (f64::INFINITY, 0.0, 0);
        let (least, most, slivers) = scene.triangles().par_iter().map(triangle).reduce(|| none, merge);
        let (least, most) = self
            .local
            .spheres
            .iter()
            .map(|s| 2.0 * s.r)
            .fold((least, most), |(least, most), d| (least.min(d), most.max(d)));
        let (reach, kept) = match &self.boxes {
            Boxes::F32(bvh) => (bvh.reach(), bvh.ids.each_ref().map(Vec::len)),
            Boxes::F64(bvh) => (bvh.reach(), bvh.ids.each_ref().map(Vec::len)),
        };
        let near_planes = self.near_planes(reach);
        let mut giants = 0;
        column!(self.local.giants, O, list => giants += list.len());
        Condition {
            reach: world(reach),
            offset: scene.camera().location().length(),
            sizes: (most > 0.0).then(|| (world(least), world(most))),
            slivers: slivers - self.flat.min(slivers),
            flat: self.flat,
            coinciding: scene.triangles().len() - self.flat - kept[usize::from(Triangle::LEAF)],
            coinciding_spheres: scene.spheres().len() - kept[usize::from(Sphere::LEAF)],
            shared: self.shared_planes(),
            giants,
            near_planes,
            single_boxes: matches!(self.boxes, Boxes::F32(_)),
            outgrown: self.outgrown,
            packets: self.filter.is_some(),
        }
    }

    fn near_planes(&self, reach: f64) -> usize {
        // Pairs are few in any scene that is looked at; a thousand planes would be a million pairs.
        let planes = &self.local.planes[..self.local.planes.len().min(1000)];
        let near = |i: usize| {
            let a = &planes[i];
            planes[..i].iter().any(|b| {
                let turn = a.n.cross(b.n);
                let side = a.n.dot(b.n).signum();
                turn.dot(turn) < 1e-18 && (a.h - side * b.h).abs() <= 1e-9 * reach.max(a.h.abs())
            })
        };
        (0..planes.len()).filter(|&i| near(i)).count()
    }
}
