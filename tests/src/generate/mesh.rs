//! Closed triangle meshes of any size.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::DVec3;

/// Vertices and the triangles over them; every edge has exactly two triangles.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Places.
    pub vertices: Vec<DVec3>,
    /// Indices of corners, counter-clockwise from outside in a right-handed world.
    pub faces: Vec<[usize; 3]>,
}

impl Mesh {
    /// The corners of face `index`.
    #[must_use]
    pub fn corners(&self, index: usize) -> [DVec3; 3] {
        self.faces[index].map(|i| self.vertices[i])
    }

    /// Every edge once, as indices of its ends.
    #[must_use]
    pub fn edges(&self) -> Vec<[usize; 2]> {
        let mut out: Vec<[usize; 2]> = Vec::new();
        for f in &self.faces {
            for k in 0..3 {
                let (a, b) = (f[k], f[(k + 1) % 3]);
                if a < b {
                    out.push([a, b]);
                }
            }
        }
        out
    }

    /// Moves every vertex.
    #[must_use]
    pub fn map(mut self, f: impl Fn(DVec3) -> DVec3) -> Self {
        self.vertices.iter_mut().for_each(|v| *v = f(*v));
        self
    }
}

/// An icosahedron with every face split into four, `levels` times, on the unit sphere: 20 · 4^levels faces.
#[must_use]
pub fn icosphere(levels: u32) -> Mesh {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut vertices: Vec<DVec3> = Vec::new();
    for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
        vertices.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
    }
    let mut faces = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                let near = |p: usize, q: usize| (vertices[p] - vertices[q]).length() < 2.1;
                if near(i, j) && near(j, k) && near(i, k) {
                    let outward = (vertices[j] - vertices[i]).cross(vertices[k] - vertices[i]).dot(vertices[i]) > 0.0;
                    faces.push(if outward { [i, j, k] } else { [i, k, j] });
                }
            }
        }
    }
    for _ in 0..levels {
        let mut middle: HashMap<(usize, usize), usize> = HashMap::new();
        let mut split = Vec::with_capacity(4 * faces.len());
        for [a, b, c] in faces {
            let mut mid = |p: usize, q: usize| {
                *middle.entry((p.min(q), p.max(q))).or_insert_with(|| {
                    vertices.push(((vertices[p] + vertices[q]) / 2.0).normalize() * vertices[0].length());
                    vertices.len() - 1
                })
            };
            let (ab, bc, ca) = (mid(a, b), mid(b, c), mid(c, a));
            split.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        faces = split;
    }
    Mesh { vertices, faces }.map(DVec3::normalize)
}

/// A grid of `n` × `m` places that closes both ways.
fn closed_grid(n: usize, m: usize, place: impl Fn(f64, f64) -> DVec3) -> Mesh {
    let at = |i: usize, j: usize| (i % n) * m + j % m;
    let mut vertices = Vec::with_capacity(n * m);
    let mut faces = Vec::with_capacity(2 * n * m);
    for i in 0..n {
        for j in 0..m {
            vertices.push(place(TAU * i as f64 / n as f64, TAU * j as f64 / m as f64));
            faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    Mesh { vertices, faces }
}

/// A torus about the y axis: 2·n·m faces.
#[must_use]
pub fn torus(n: usize, m: usize, ring: f64, tube: f64) -> Mesh {
    closed_grid(n, m, |a, b| {
        let r = ring + tube * libm::cos(b);
        DVec3::new(r * libm::cos(a), tube * libm::sin(b), r * libm::sin(a))
    })
}

/// A trefoil knot of a scaled, ridged tube: 2·n·m faces, many silhouettes, much self-shadowing.
#[must_use]
pub fn knot(n: usize, m: usize) -> Mesh {
    let centre = |a: f64| {
        DVec3::new(
            libm::sin(a) + 2.0 * libm::sin(2.0 * a),
            libm::cos(a) - 2.0 * libm::cos(2.0 * a),
            -1.15 * libm::sin(3.0 * a),
        )
    };
    closed_grid(n, m, |a, b| {
        let along = (centre(a + 1e-4) - centre(a - 1e-4)).normalize();
        // The direction away from the knot's middle never runs along the knot.
        let side = (centre(a) - along * along.dot(centre(a))).normalize();
        let up = along.cross(side);
        let r = 0.55 + 0.06 * libm::sin(24.0 * a) * libm::cos(3.0 * b) + 0.08 * libm::sin(4.0 * b + 9.0 * a);
        centre(a) + (side * libm::cos(b) + up * libm::sin(b)) * r
    })
}
