//! The bounded objects that a pyramid or a shaft may meet.

use glam::DVec3;

use super::lens::{Lens, Tile};
use crate::bvh::{Boxes, Bvh, Coordinate, Link, Node, WIDTH};

/// A convex region of space.
pub(crate) trait Volume {
    /// Which of eight boxes may reach into it, given lower and upper ends by axis.
    fn meets(&self, lo: &[[f64; WIDTH]; 3], hi: &[[f64; WIDTH]; 3]) -> u8;
}

/// What a tile sees through a lens: half spaces n · P ≥ h.
pub(crate) struct Pyramid {
    sides: [(DVec3, f64); 6],
    count: usize,
}

/// Roundings of a box's distance from a side, relative to what is added up.
const SLACK: f64 = 1e-12;

impl Pyramid {
    pub(crate) fn new(lens: &Lens, tile: &Tile) -> Self {
        let corners = tile.corners().map(|(x, y)| lens.direction(x, y));
        let middle = corners.iter().sum::<DVec3>();
        let mut sides = [(DVec3::ZERO, 0.0); 6];
        for k in 0..4 {
            let n = corners[k].cross(corners[(k + 1) % 4]);
            let n = if n.dot(middle) < 0.0 { -n } else { n };
            sides[k] = (n, n.dot(lens.apex));
        }
        Self { sides, count: 4 }
    }

    /// The part of it where n · P ≥ h.
    pub(crate) fn cut(mut self, n: DVec3, h: f64) -> Self {
        self.sides[self.count] = (n, h);
        self.count += 1;
        self
    }
}

impl Volume for Pyramid {
    #[inline(always)]
    fn meets(&self, lo: &[[f64; WIDTH]; 3], hi: &[[f64; WIDTH]; 3]) -> u8 {
        let mut out = [false; WIDTH];
        for (n, h) in &self.sides[..self.count] {
            let ends = [0, 1, 2].map(|k| if n[k] >= 0.0 { &hi[k] } else { &lo[k] });
            for s in 0..WIDTH {
                let (x, y, z) = (n.x * ends[0][s], n.y * ends[1][s], n.z * ends[2][s]);
                let slack = SLACK * (x.abs() + y.abs() + z.abs() + h.abs());
                out[s] |= x + y + z + slack < *h;
            }
        }
        mask(&out)
    }
}

/// The hull of a ball and a point.
pub(crate) struct Shaft {
    tip: DVec3,
    axis: DVec3,
    radius: f64,
    /// 1 / |axis|² and 1 / |axis|.
    inverse: [f64; 2],
    /// Ends of its box.
    lo: DVec3,
    hi: DVec3,
}

impl Shaft {
    pub(crate) fn new(tip: DVec3, center: DVec3, radius: f64) -> Self {
        let axis = center - tip;
        let square = axis.dot(axis);
        Self {
            tip,
            axis,
            radius,
            inverse: [1.0 / square, 1.0 / square.sqrt()],
            lo: tip.min(center - radius),
            hi: tip.max(center + radius),
        }
    }

    /// Whether a ball may reach into it.
    #[inline(always)]
    pub(crate) fn meets_ball(&self, center: DVec3, radius: f64) -> bool {
        let to = center - self.tip;
        let along = to.dot(self.axis) * self.inverse[0];
        let beside = to - self.axis * along.clamp(0.0, 1.0);
        // A point of the hull that is s along the axis is at most s·radius beside it.
        let widest = (along + (radius + self.radius) * self.inverse[1]).clamp(0.0, 1.0) * self.radius;
        let reach = (widest + radius) * (1.0 + 1e-9);
        !(beside.dot(beside) > reach * reach)
    }
}

impl Volume for Shaft {
    #[inline(always)]
    fn meets(&self, lo: &[[f64; WIDTH]; 3], hi: &[[f64; WIDTH]; 3]) -> u8 {
        let mut out = [false; WIDTH];
        for k in 0..3 {
            for s in 0..WIDTH {
                out[s] |= !(lo[k][s] <= self.hi[k] && hi[k][s] >= self.lo[k]);
            }
        }
        let mut may = mask(&out);
        let mut rest = may;
        while rest != 0 {
            let s = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let (l, h) = (DVec3::new(lo[0][s], lo[1][s], lo[2][s]), DVec3::new(hi[0][s], hi[1][s], hi[2][s]));
            let half = (h - l) * 0.5;
            if !self.meets_ball(l + half, half.dot(half).sqrt() * (1.0 + 1e-12)) {
                may &= !(1 << s);
            }
        }
        may
    }
}

#[inline(always)]
fn mask(out: &[bool; WIDTH]) -> u8 {
    out.iter().enumerate().fold(0, |mask, (k, out)| mask | u8::from(!out) << k)
}

/// Puts the ids of the objects that may reach into `volume` behind `found`, as long as those are at most `most`;
/// whether these are all.
#[inline(always)]
pub(crate) fn gather(boxes: &Boxes, volume: &impl Volume, most: usize, found: &mut Vec<u32>) -> bool {
    match boxes {
        Boxes::F32(bvh) => gather_among(bvh, volume, most, found),
        Boxes::F64(bvh) => gather_among(bvh, volume, most, found),
    }
}

#[inline(always)]
fn gather_among<T: Coordinate>(bvh: &Bvh<T>, volume: &impl Volume, most: usize, found: &mut Vec<u32>) -> bool {
    if bvh.nodes.is_empty() {
        return true;
    }
    let mut stack = [0u32; 512];
    let mut top = 1;
    while top > 0 {
        top -= 1;
        let node: &Node<T> = &bvh.nodes[stack[top] as usize];
        let (mut lo, mut hi) = ([[0.0; WIDTH]; 3], [[0.0; WIDTH]; 3]);
        for k in 0..3 {
            for s in 0..WIDTH {
                (lo[k][s], hi[k][s]) = (node.lo[k][s].to_f64(), node.hi[k][s].to_f64());
            }
        }
        let mut met = volume.meets(&lo, &hi);
        while met != 0 {
            let slot = met.trailing_zeros() as usize;
            met &= met - 1;
            match node.child[slot].link() {
                Link::Nothing => {}
                Link::Inner(_) if top == stack.len() => return false,
                Link::Inner(index) => {
                    stack[top] = index as u32;
                    top += 1;
                }
                Link::Leaf { kind, start, count } => {
                    if found.len() + count > most {
                        return false;
                    }
                    found.extend_from_slice(&bvh.ids[usize::from(kind)][start..start + count]);
                }
            }
        }
    }
    true
}
