//! What pixels cost.

use tessera_core::film::Region;

/// What the parts of a picture cost: a grid of equal cells, as a render was measured, stretched over a picture of any
/// size. Only ratios count: the mean is one pixel of usual cost.
#[derive(Clone, Debug, PartialEq)]
pub struct CostMap {
    columns: usize,
    rows: usize,
    /// Sums over all cells left of a corner and above it, row by row of the (`columns` + 1) × (`rows` + 1) corners, where
    /// the sum over all is 1.
    sums: Vec<f64>,
    dearest: f64,
}

impl CostMap {
    /// Of cells row by row, each `costs` as much as others; `None` where they are no whole rows, or one of them costs
    /// nothing, less, or no finite amount.
    #[must_use]
    pub fn new(columns: usize, costs: &[f64]) -> Option<Self> {
        let rows = costs.len().checked_div(columns)?;
        if rows == 0 || rows * columns != costs.len() || !costs.iter().all(|c| c.is_finite() && *c > 0.0) {
            return None;
        }
        let whole: f64 = costs.iter().sum();
        let mut sums = vec![0.0; (columns + 1) * (rows + 1)];
        for (row, cells) in costs.chunks_exact(columns).enumerate() {
            let mut line = 0.0;
            for (column, cell) in cells.iter().enumerate() {
                line += cell / whole;
                sums[(row + 1) * (columns + 1) + column + 1] = sums[row * (columns + 1) + column + 1] + line;
            }
        }
        let dearest = costs.iter().copied().fold(0.0, f64::max) * costs.len() as f64 / whole;
        Some(Self { columns, rows, sums, dearest })
    }

    /// One cost everywhere.
    #[must_use]
    pub fn even() -> Self {
        Self { columns: 1, rows: 1, sums: vec![0.0, 0.0, 0.0, 1.0], dearest: 1.0 }
    }

    /// How many times as dear as the mean the dearest cell is.
    #[must_use]
    pub fn dearest(&self) -> f64 {
        self.dearest
    }

    /// Pixels of usual cost that `region` of a picture of `width` × `height` costs as much as.
    #[must_use]
    pub fn of(&self, region: &Region, (width, height): (u32, u32)) -> f64 {
        let x = |x: u32| f64::from(x) / f64::from(width) * self.columns as f64;
        let y = |y: u32| f64::from(y) / f64::from(height) * self.rows as f64;
        let ((x0, x1), (y0, y1)) = ((x(region.x0), x(region.x1)), (y(region.y0), y(region.y1)));
        let share = self.sum(x1, y1) - self.sum(x0, y1) - self.sum(x1, y0) + self.sum(x0, y0);
        share.max(0.0) * f64::from(width) * f64::from(height)
    }

    /// The sum left of x and above y, in cells: within one it grows evenly, so that bilinear interpolation is exact.
    fn sum(&self, x: f64, y: f64) -> f64 {
        let (column, row) = ((x as usize).min(self.columns - 1), (y as usize).min(self.rows - 1));
        let (u, v) = (x - column as f64, y - row as f64);
        let corner = |c: usize, r: usize| self.sums[r * (self.columns + 1) + c];
        let upper = corner(column, row) * (1.0 - u) + corner(column + 1, row) * u;
        let lower = corner(column, row + 1) * (1.0 - u) + corner(column + 1, row + 1) * u;
        upper * (1.0 - v) + lower * v
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_add_up_to_the_whole() {
        let map = CostMap::new(3, &[1.0, 2.0, 3.0, 4.0, 5.0, 9.0]).unwrap();
        let size = (300, 100);
        let of = |x0, y0, x1, y1| map.of(&Region { x0, y0, x1, y1 }, size);
        assert!((of(0, 0, 300, 100) - 30_000.0).abs() < 1e-6);
        assert!((of(0, 0, 100, 50) - 30_000.0 / 24.0).abs() < 1e-6);
        assert!((of(200, 50, 300, 100) - 30_000.0 * 9.0 / 24.0).abs() < 1e-6);
        assert!((of(10, 20, 170, 64) + of(10, 64, 170, 91) - of(10, 20, 170, 91)).abs() < 1e-6);
        assert_eq!(map.dearest(), 9.0 * 6.0 / 24.0);
        assert_eq!(CostMap::even().of(&Region { x0: 1, y0: 2, x1: 4, y1: 4 }, (7, 5)).round(), 6.0);
    }

    #[test]
    fn what_is_no_grid_is_none() {
        assert_eq!(CostMap::new(0, &[1.0]), None);
        assert_eq!(CostMap::new(3, &[1.0, 2.0]), None);
        assert_eq!(CostMap::new(1, &[1.0, 0.0]), None);
        assert_eq!(CostMap::new(1, &[f64::INFINITY]), None);
    }
}
