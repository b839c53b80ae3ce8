//! What is rendered: what pixels cost, and that each is done once, by whoever said so.

use tessera_core::film::Region;

/// What is wrong with one pixel of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Curse {
    /// Whoever renders it reports failure.
    Fails,
    /// Whoever renders it is killed by it.
    Kills,
}

/// Edge of the blocks within which pixels cost the same.
const BLOCK: u32 = 32;

#[derive(Debug)]
pub(super) struct Picture {
    pub(super) width: u32,
    pub(super) height: u32,
    costs: Vec<f64>,
    curse: Option<Curse>,
    cursed: (u32, u32),
    done: Vec<bool>,
    /// Pixels that are not what they should be.
    lies: Vec<bool>,
}

impl Picture {
    pub(super) fn new(rng: &mut fastrand::Rng, curse: Option<Curse>) -> Self {
        let (width, height) = (rng.u32(40..400), rng.u32(40..300));
        let blocks = (width.div_ceil(BLOCK) * height.div_ceil(BLOCK)) as usize;
        let spread = [1.0, 3.0, 20.0][rng.usize(0..3)];
        let costs = (0..blocks).map(|_| f64::powf(spread, 2.0 * rng.f64() - 1.0)).collect();
        let cursed = (rng.u32(0..width), rng.u32(0..height));
        let none = vec![false; (width * height) as usize];
        Self { width, height, costs, curse, cursed, done: none.clone(), lies: none }
    }

    pub(super) fn region(&self) -> Region {
        Region { x0: 0, y0: 0, x1: self.width, y1: self.height }
    }

    /// Pixels of usual cost that cost as much.
    pub(super) fn cost(&self, r: &Region) -> f64 {
        let overlap = |a: u32, b: u32, block: u32| f64::from((block + BLOCK).min(b) - block.max(a));
        let mut sum = 0.0;
        for y in (r.y0 / BLOCK * BLOCK..r.y1).step_by(BLOCK as usize) {
            for x in (r.x0 / BLOCK * BLOCK..r.x1).step_by(BLOCK as usize) {
                let cost = self.costs[(y / BLOCK * self.width.div_ceil(BLOCK) + x / BLOCK) as usize];
                sum += cost * overlap(r.x0, r.x1, x) * overlap(r.y0, r.y1, y);
            }
        }
        sum
    }

    /// The pixel that is cursed where one is.
    pub(super) fn cursed(&self) -> (u32, u32) {
        self.cursed
    }

    /// What happens to whoever renders `r`.
    pub(super) fn curse(&self, r: &Region) -> Option<Curse> {
        let (x, y) = self.cursed;
        self.curse.filter(|_| r.contains(&Region { x0: x, y0: y, x1: x + 1, y1: y + 1 }))
    }

    /// Puts a tile into it.
    pub(super) fn put(&mut self, r: &Region, lies: bool) {
        for y in r.y0..r.y1 {
            for x in r.x0..r.x1 {
                let at = (y * self.width + x) as usize;
                assert!(!std::mem::replace(&mut self.done[at], true), "pixel {x},{y} is done twice");
                self.lies[at] = lies;
            }
        }
    }

    /// Takes a tile out of it.
    pub(super) fn take(&mut self, r: &Region) {
        for y in r.y0..r.y1 {
            for x in r.x0..r.x1 {
                let at = (y * self.width + x) as usize;
                assert!(std::mem::replace(&mut self.done[at], false), "pixel {x},{y} was not done");
                self.lies[at] = false;
            }
        }
    }

    /// Whether all of it is what it should be.
    pub(super) fn is_true(&self) -> bool {
        self.lies.iter().all(|lie| !lie)
    }

    pub(super) fn is_whole(&self) -> bool {
        self.done.iter().all(|p| *p)
    }

    /// Begins the next pass.
    pub(super) fn clear(&mut self) {
        self.done.fill(false);
        self.lies.fill(false);
    }
}
