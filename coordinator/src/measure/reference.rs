//! What pictures are held against.

use std::path::{Path, PathBuf};

use tessera_core::film::Image;
use tessera_core::film::file::{self, Kind, ReadError};
use tessera_core::film::transfer::to_linear;
use tessera_core::settings::Transfer;

/// Grids that references are made of: cells along a pixel's edge. Primes have no sample row in
/// common and their edge errors are nearly independent, of each other and of the grids that are
/// judged: for an edge at a random place, those of n and m rows correlate by gcd(n, m)² / nm.
const PRIMES: [u32; 17] = [3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61];

/// Where a reference comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Rendered: uniform grids, of so many cells along a pixel's edge each.
    Rendered(Vec<u32>),
    /// A picture file; whether it holds codes.
    File(PathBuf, bool),
}

/// The picture that is taken as right.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// Linear radiance.
    pub image: Image,
    /// Where it comes from.
    pub source: Source,
    /// Its own RMSE as a fraction of full scale: measured between its parts, or by the rounding
    /// of a file's codes; `None` where nothing is known of it.
    pub own_error: Option<f64>,
}

/// Why a file is no reference.
#[derive(Debug, thiserror::Error)]
pub enum ReferenceError {
    /// It is no picture.
    #[error("'{path}' is no picture to measure against: {0}", path = .1.display())]
    Read(#[source] ReadError, PathBuf),
    /// It has another size.
    #[error(
        "'{path}' has {0}x{1} pixels, but {2}x{3} are rendered: give --size {0}x{1}, or another reference",
        path = .4.display()
    )]
    Size(u32, u32, u32, u32, PathBuf),
}

impl Reference {
    /// Reads a reference of `width` × `height` pixels. Codes are linearised as the file says, those of
    /// a pixmap (which does not say) as `transfer` does.
    ///
    /// # Errors
    /// When it is no picture, or not of that size.
    pub fn read(path: &Path, (width, height): (u32, u32), transfer: Transfer) -> Result<Self, ReferenceError> {
        let stored = file::read(path).map_err(|e| ReferenceError::Read(e, path.into()))?;
        let (w, h) = (stored.image.width(), stored.image.height());
        if (w, h) != (width, height) {
            return Err(ReferenceError::Size(w, h, width, height, path.into()));
        }
        let said = if Kind::of(path) == Some(Kind::Ppm) { Some(transfer) } else { stored.transfer };
        let source = Source::File(path.into(), said.is_some());
        Ok(match said {
            None => Self { image: stored.image, source, own_error: None },
            Some(meant) => {
                let own_error = Some(rounding(&stored.image, meant));
                let image = stored.image.map(|x| to_linear(meant, x.into()) as f32);
                Self { image, source, own_error }
            }
        })
    }

    /// Samples a pixel, where it was rendered.
    #[must_use]
    pub fn samples(&self) -> Option<u32> {
        match &self.source {
            Source::Rendered(grids) => Some(grids.iter().map(|n| n * n).sum()),
            Source::File(..) => None,
        }
    }

    /// Whether it can hold nothing beyond [0, 1].
    #[must_use]
    pub fn holds_codes(&self) -> bool {
        matches!(self.source, Source::File(_, true))
    }

    /// Whether an RMSE against it, a fraction of full scale, says little about the true one.
    pub(super) fn cannot_tell(&self, rmse: f64) -> bool {
        self.own_error.is_some_and(|own| rmse <= 3.0 * own)
    }
}

/// The RMSE, in linear numbers, that rounding to codes leaves in a picture: of 8 bits where all
/// of them are such codes, of 16 elsewhere.
fn rounding(image: &Image, meant: Transfer) -> f64 {
    let components = image.pixels().as_flattened();
    let eight = components.iter().all(|&x| ((255.0 * x).round() - 255.0 * x).abs() < 1e-3);
    let half = 0.5 / if eight { 255.0 } else { 65_535.0 };
    let width = |x: f32| {
        let linear = |code: f64| to_linear(meant, code.clamp(0.0, 1.0));
        linear(f64::from(x) + half) - linear(f64::from(x) - half)
    };
    // An error evenly spread over a step has a variance of a twelfth of its square.
    let squares: f64 = components.iter().map(|&x| width(x).powi(2) / 12.0).sum();
    (squares / components.len() as f64).sqrt()
}

/// The pair of neighbouring grids that has at least `samples` points a pixel together, or the finest.
pub(super) fn pair_of(samples: u32) -> [u32; 2] {
    let enough = |pair: &&[u32]| pair.iter().map(|n| n * n).sum::<u32>() >= samples;
    match PRIMES.windows(2).find(enough) {
        Some(&[a, b]) => [a, b],
        _ => [59, 61],
    }
}

/// The two grids after `grid`, if they make sense for a picture whose finest grid is that.
pub(super) fn pair_after(grid: u32) -> Option<[u32; 2]> {
    let next = PRIMES.iter().position(|&p| p > grid)?;
    match PRIMES.get(next..next + 2) {
        Some(&[a, b]) => Some([a, b]),
        _ => None,
    }
}

/// A reference in the making: the mean of uniform renders, each weighed by what it is worth.
///
/// Along edges the error of an n × n grid falls as n^-1.5, its variance as n^-3. The difference of
/// the two finest grids gives the factor, and so the error of the weighted mean: it is measured on
/// the very picture, not taken from a book.
#[derive(Debug)]
pub(super) struct Blend {
    size: (u32, u32),
    sum: Vec<[f64; 3]>,
    weight: f64,
    grids: Vec<u32>,
    last: Vec<[f32; 3]>,
    /// The variance of a 1 × 1 grid that the two finest ones speak for.
    factor: Option<f64>,
}

/// What a grid is worth.
fn worth(grid: u32) -> f64 {
    f64::from(grid).powi(3)
}

impl Blend {
    pub(super) fn new(size: (u32, u32)) -> Self {
        let count = size.0 as usize * size.1 as usize;
        Self { size, sum: vec![[0.0; 3]; count], weight: 0.0, grids: Vec::new(), last: Vec::new(), factor: None }
    }

    /// Adds the render of a grid, finer than those before.
    pub(super) fn add(&mut self, grid: u32, pixels: Vec<[f32; 3]>) {
        if let Some(&before) = self.grids.last() {
            let squares: f64 = self
                .last
                .as_flattened()
                .iter()
                .zip(pixels.as_flattened())
                .map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2))
                .sum();
            let apart = squares / (3 * pixels.len()) as f64;
            self.factor = Some(apart / (1.0 / worth(before) + 1.0 / worth(grid)));
        }
        for (sum, pixel) in self.sum.iter_mut().zip(&pixels) {
            for (s, x) in sum.iter_mut().zip(pixel) {
                *s += worth(grid) * f64::from(*x);
            }
        }
        self.weight += worth(grid);
        self.grids.push(grid);
        self.last = pixels;
    }

    /// Its RMSE as a fraction of full scale; `None` before there are two grids.
    pub(super) fn own_error(&self) -> Option<f64> {
        self.factor.map(|f| (f / self.weight).sqrt())
    }

    /// The finest grid so far.
    pub(super) fn finest(&self) -> Option<u32> {
        self.grids.last().copied()
    }

    /// The reference, if there are two grids at least.
    pub(super) fn finish(self) -> Option<Reference> {
        let own_error = Some(self.own_error()?);
        let pixels = self.sum.iter().map(|p| p.map(|s| (s / self.weight) as f32)).collect();
        let image = Image::new(self.size.0, self.size.1, pixels)?;
        Some(Reference { image, source: Source::Rendered(self.grids), own_error })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_have_samples_enough() {
        assert_eq!(pair_of(256), [11, 13]);
        assert_eq!(pair_of(1024), [23, 29]);
        assert_eq!((pair_of(1), pair_of(1_000_000)), ([3, 5], [59, 61]));
        assert_eq!((pair_after(13), pair_after(53), pair_after(59)), (Some([17, 19]), Some([59, 61]), None));
    }

    /// A picture of a disc by an n × n grid, and by exact areas in place of it (a very fine grid).
    fn disc(size: u32, grid: u32) -> Vec<[f32; 3]> {
        let (c, r) = (f64::from(size) * 0.491, f64::from(size) * 0.407);
        let inside = |x: f64, y: f64| f64::from((x - c).powi(2) + (y - c).powi(2) < r * r);
        (0..size * size)
            .map(|i| {
                let mut sum = 0.0;
                for k in 0..grid * grid {
                    let at = |p: u32, k: u32| f64::from(p) + (f64::from(k) + 0.5) / f64::from(grid);
                    sum += inside(at(i % size, k % grid), at(i / size, k / grid));
                }
                [(sum / f64::from(grid * grid)) as f32; 3]
            })
            .collect()
    }

    #[test]
    fn the_error_it_states_is_the_error_it_has() {
        let size = 64;
        let truth = Image::new(size, size, disc(size, 128)).expect("whole");
        let mut blend = Blend::new((size, size));
        for grid in [11, 13, 17, 19] {
            blend.add(grid, disc(size, grid));
            let Some(stated) = blend.own_error() else { continue };
            let pixels = blend.sum.iter().map(|p| p.map(|s| (s / blend.weight) as f32)).collect();
            let blended = Image::new(size, size, pixels).expect("whole");
            let actual = tessera_core::film::Metrics::measure(&truth, &blended).rmse;
            let ratio = actual / stated;
            assert!((0.5..1.6).contains(&ratio), "{grid}: {actual} is not about {stated}");
        }
        let reference = blend.finish().expect("four grids");
        assert_eq!(reference.samples(), Some(121 + 169 + 289 + 361));
    }

    #[test]
    fn one_grid_is_no_reference() {
        let mut blend = Blend::new((8, 8));
        blend.add(3, disc(8, 3));
        assert_eq!(blend.finish(), None);
    }
}
