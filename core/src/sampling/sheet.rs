//! Sheets of triangles that share edges: in a pixel that no end of them passes, they hide what is behind as one
//! object does.

use glam::DVec3;

use crate::beam::cover::Shape;
use crate::beam::lens::{Pixels, pixels_above};

use super::coverage::Shapes;
use super::proof::{Candidate, View};

/// Pixels that are covered by exactly one layer of triangles that turn one way, by the way they turn.
pub(super) struct Sheets {
    layers: [Pixels; 2],
}

impl Sheets {
    /// Pixels in which nothing is seen but one sheet.
    pub(super) fn proven(&self, candidates: &[Candidate]) -> Pixels {
        let mut seen = [0, 0, 0];
        for c in candidates {
            let kind = c.triangle.as_ref().map_or(2, |(_, o)| usize::from(o.turned));
            seen[kind] |= c.alive;
        }
        (self.layers[0] & !seen[1] & !seen[2]) | (self.layers[1] & !seen[0] & !seen[2])
    }
}

/// Finds the sheets among `candidates`, and notes how near they are.
#[inline(always)]
pub(super) fn sheets(
    view: &View<'_>,
    candidates: &mut Vec<Candidate>,
    nearest: &mut [f64; 64],
    shapes: &mut Shapes,
) -> Sheets {
    view.hide(candidates, nearest);
    let mut sheets = Sheets { layers: [0; 2] };
    let mut keys: Vec<u64> = Vec::new();
    for turned in [false, true] {
        let layer: Vec<&Candidate> =
            candidates.iter().filter(|c| c.triangle.as_ref().is_some_and(|(_, o)| o.turned == turned)).collect();
        if layer.is_empty() {
            continue;
        }
        let (mut ends, mut once, mut twice) = (0, 0, 0);
        keys.clear();
        for c in &layer {
            let Some((v, _)) = &c.triangle else { continue };
            keys.extend((0..3).map(|k| key(v[k], v[(k + 1) % 3])));
        }
        for (i, c) in layer.iter().enumerate() {
            let Some((v, outline)) = &c.triangle else { continue };
            let mut inside = c.alive;
            for (k, edge) in outline.edges.iter().enumerate() {
                inside &= pixels_above(edge, view.tile, 0.0);
                let spread = edge.spread();
                let passes = c.alive & !pixels_above(edge, view.tile, spread);
                if passes != 0 {
                    let own = keys[3 * i + k];
                    let shared = keys.iter().enumerate().any(|(at, key)| {
                        *key == own
                            && at / 3 != i
                            && layer[at / 3].triangle.as_ref().is_some_and(|(other, _)| goes_on(view, v, k, other))
                    });
                    if !shared {
                        ends |= passes;
                        shapes.push((passes, Shape::Edge(*edge)));
                    }
                }
            }
            twice |= once & inside;
            once |= inside;
        }
        let whole = once & !twice & !ends;
        if whole == 0 {
            continue;
        }
        sheets.layers[usize::from(turned)] = whole;
        // A sheet is as near as the farthest of its triangles.
        let mut least = [f64::INFINITY; 64];
        for c in &layer {
            let rest = c.alive & whole;
            for j in 0..8 {
                if rest >> (8 * j) & 0xff == 0 {
                    continue;
                }
                let (lo, _) = c.cover.depth.row(view.tile, j);
                for k in 0..8 {
                    if rest >> (8 * j + k) & 1 == 1 {
                        least[8 * j + k] = least[8 * j + k].min(lo[k]);
                    }
                }
            }
        }
        for at in 0..64 {
            if whole >> at & 1 == 1 && least[at] > nearest[at] {
                nearest[at] = least[at];
            }
        }
    }
    sheets
}

/// A number that the edge between two points has in every triangle that it is of, and others hardly ever.
#[inline(always)]
fn key(a: DVec3, b: DVec3) -> u64 {
    let word = |p: DVec3| {
        let [x, y, z] = p.to_array().map(f64::to_bits);
        (x.rotate_left(21) ^ y.rotate_left(42) ^ z).wrapping_mul(0x9e37_79b9_7f4a_7c15)
    };
    word(a).wrapping_add(word(b))
}

/// Whether the triangle that has edge `k` of `v` too goes on beyond it, as seen from the apex.
#[inline(always)]
fn goes_on(view: &View<'_>, v: &[DVec3; 3], k: usize, other: &[DVec3; 3]) -> bool {
    let (a, b, inner) = (v[k], v[(k + 1) % 3], v[(k + 2) % 3]);
    let apex = view.lens.apex;
    let side = (a - apex).cross(b - apex);
    let (mut has, mut outer) = (0, DVec3::NAN);
    for corner in other {
        if *corner == a || *corner == b {
            has += 1;
        } else {
            outer = *corner;
        }
    }
    has == 2 && side.dot(outer - apex) * side.dot(inner - apex) < 0.0
}
