//! Rectangles of pixels.

/// A half-open, non-empty rectangle of pixels, x to the right, y down: [x0, x1) × [y0, y1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Region {
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// One past the last column; above `x0`.
    pub x1: u32,
    /// One past the last row; above `y0`.
    pub y1: u32,
}

impl Region {
    /// The rectangle, or `None` where it would be empty.
    #[must_use]
    pub fn new(x0: u32, y0: u32, x1: u32, y1: u32) -> Option<Self> {
        (x0 < x1 && y0 < y1).then_some(Self { x0, y0, x1, y1 })
    }
    /// Columns.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.x1 - self.x0
    }
    /// Rows.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.y1 - self.y0
    }
    /// Pixels.
    #[must_use]
    pub fn area(&self) -> u64 {
        u64::from(self.width()) * u64::from(self.height())
    }
    /// Whether every pixel of `other` is in this one.
    #[must_use]
    pub fn contains(&self, other: &Self) -> bool {
        self.x0 <= other.x0 && self.y0 <= other.y0 && other.x1 <= self.x1 && other.y1 <= self.y1
    }

    /// This rectangle cut into blocks of at most `edge` × `edge` pixels, row by row.
    #[must_use]
    pub fn blocks(&self, edge: u32) -> Vec<Self> {
        let edge = edge.max(1) as usize;
        let mut blocks = Vec::new();
        for y0 in (self.y0..self.y1).step_by(edge) {
            for x0 in (self.x0..self.x1).step_by(edge) {
                let end = |start: u32, limit: u32| start.saturating_add(edge as u32).min(limit);
                blocks.push(Self { x0, y0, x1: end(x0, self.x1), y1: end(y0, self.y1) });
            }
        }
        blocks
    }
}
