//! How far two pictures are apart.

use super::flip;
use super::image::Image;
use super::transfer::from_linear;
use crate::settings::Transfer;

/// Distances between two pictures of one size, over their numbers as given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metrics {
    /// Root of the mean squared difference of all components, as a fraction of full scale.
    pub rmse: f64,
    /// 20 · log10(1 / RMSE), in dB; infinite where the pictures are equal.
    pub psnr: f64,
    /// The largest difference of a component.
    pub largest: f64,
    /// Column and row of the first pixel with the largest difference.
    pub largest_at: (u32, u32),
    /// Share of pixels with a component off by more than 1/255.
    pub beyond_255th: f64,
    /// Share of pixels with a component off by more than 1/510.
    pub beyond_510th: f64,
    /// Mean structural similarity of luma: 1 where equal.
    pub ssim: f64,
    /// Mean FLIP error as seen at 67 pixels a degree: 0 where equal, 1 at most.
    pub flip: f64,
}

impl Metrics {
    /// The RMSE in 8-bit steps.
    #[must_use]
    pub fn rmse_steps(&self) -> f64 {
        255.0 * self.rmse
    }

    /// Measures `test` against `reference`. SSIM and FLIP take the numbers as sRGB-encoded
    /// and clamp them; every other figure takes them as they are. A component that is not
    /// a number in one picture only counts as off by 1.
    ///
    /// # Panics
    /// When the pictures are not of the same size.
    #[must_use]
    pub fn measure(reference: &Image, test: &Image) -> Self {
        let errors = Self::errors(reference, test);
        Self { ssim: ssim(reference, test), flip: flip::mean(reference, test), ..errors }
    }

    /// Measures `test` against `reference`, both linear radiance: SSIM and FLIP see them clamped
    /// and sRGB-encoded, as an eye does; every other figure takes them as they are.
    ///
    /// # Panics
    /// When the pictures are not of the same size.
    #[must_use]
    pub fn of_radiance(reference: &Image, test: &Image) -> Self {
        let errors = Self::errors(reference, test);
        let seen = |image: &Image| image.clone().map(|x| from_linear(Transfer::Srgb, in_range(x).into()) as f32);
        let (reference, test) = rayon::join(|| seen(reference), || seen(test));
        Self { ssim: ssim(&reference, &test), flip: flip::mean(&reference, &test), ..errors }
    }

    /// Every figure but SSIM and FLIP, which are those of equal pictures.
    fn errors(reference: &Image, test: &Image) -> Self {
        assert_eq!(
            (reference.width(), reference.height()),
            (test.width(), test.height()),
            "pictures of different sizes were compared"
        );
        let count = reference.pixels().len();
        let (mut squares, mut largest, mut at) = (0.0, 0.0, 0);
        let (mut beyond_255th, mut beyond_510th) = (0_u64, 0_u64);
        for (i, (a, b)) in reference.pixels().iter().zip(test.pixels()).enumerate() {
            let mut worst = 0.0_f64;
            for (&a, &b) in a.iter().zip(b) {
                let apart = difference(a, b);
                squares += apart * apart;
                worst = worst.max(apart);
            }
            if worst > largest {
                (largest, at) = (worst, i);
            }
            // The differences are of f32 numbers: a code's exact step must not count as beyond it.
            beyond_255th += u64::from(worst > 1.0 / 255.0 + 1e-6);
            beyond_510th += u64::from(worst > 1.0 / 510.0 + 1e-6);
        }
        let rmse = (squares / (3 * count) as f64).sqrt();
        let width = reference.width() as usize;
        Self {
            rmse,
            psnr: -20.0 * rmse.log10(),
            largest,
            largest_at: ((at % width) as u32, (at / width) as u32),
            beyond_255th: beyond_255th as f64 / count as f64,
            beyond_510th: beyond_510th as f64 / count as f64,
            ssim: 1.0,
            flip: 0.0,
        }
    }
}

fn difference(a: f32, b: f32) -> f64 {
    // Bit-equal ones include the infinite, whose difference is not a number.
    if a == b || (a.is_nan() && b.is_nan()) {
        return 0.0;
    }
    let apart = (f64::from(a) - f64::from(b)).abs();
    if apart.is_nan() { 1.0 } else { apart }
}

/// Mean structural similarity of luma (Rec. 709), under a Gaussian window of 11 × 11 with
/// σ = 1.5: Wang, Bovik, Sheikh, Simoncelli, *Image Quality Assessment* (2004).
/// Windows that reach outside see the border's pixels continued.
fn ssim(a: &Image, b: &Image) -> f64 {
    let luma = |image: &Image| -> Vec<f64> {
        let weights = [0.2126, 0.7152, 0.0722];
        image.pixels().iter().map(|p| (0..3).map(|c| weights[c] * f64::from(in_range(p[c]))).sum()).collect()
    };
    let (w, h) = (a.width() as usize, a.height() as usize);
    let (a, b) = (luma(a), luma(b));
    let product = |x: &[f64], y: &[f64]| -> Vec<f64> { x.iter().zip(y).map(|(x, y)| x * y).collect() };
    let kernel = flip::normalised((-5..=5).map(|i| (-f64::from(i * i) / (2.0 * 1.5 * 1.5)).exp()).collect());
    let blur = |plane: &[f64]| flip::convolve(plane, w, h, &kernel, &kernel);
    let (mean_a, mean_b) = (blur(&a), blur(&b));
    let (square_a, square_b, both) = (blur(&product(&a, &a)), blur(&product(&b, &b)), blur(&product(&a, &b)));
    let (c1, c2) = (0.01_f64.powi(2), 0.03_f64.powi(2));
    let total: f64 = (0..w * h)
        .map(|i| {
            let (ma, mb) = (mean_a[i], mean_b[i]);
            let (va, vb, cov) = (square_a[i] - ma * ma, square_b[i] - mb * mb, both[i] - ma * mb);
            (2.0 * ma * mb + c1) * (2.0 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
        })
        .sum();
    total / (w * h) as f64
}

/// Clamped to [0, 1], 0 where it is not a number.
pub(super) fn in_range(x: f32) -> f32 {
    if x > 0.0 { x.min(1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, height: u32, f: impl Fn(u32, u32) -> [f32; 3]) -> Image {
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| f(x, y)).collect();
        Image::new(width, height, pixels).unwrap()
    }

    fn some(x: u32, y: u32) -> [f32; 3] {
        [(x * 7 % 32) as f32 / 31.0, (y * 5 % 32) as f32 / 31.0, ((x ^ y) % 16) as f32 / 15.0]
    }

    #[test]
    fn equal_pictures_are_perfect() {
        let a = image(40, 30, some);
        let m = Metrics::measure(&a, &a);
        assert_eq!((m.rmse, m.psnr, m.largest, m.beyond_510th, m.flip), (0.0, f64::INFINITY, 0.0, 0.0, 0.0));
        assert!((m.ssim - 1.0).abs() < 1e-12);
    }

    #[test]
    fn errors_are_what_their_definitions_say() {
        let a = image(20, 10, |_, _| [0.5; 3]);
        let b = image(20, 10, |x, y| if (x, y) == (3, 7) { [0.5, 0.5 + 3.0 / 255.0, 0.5] } else { [0.5; 3] });
        let m = Metrics::measure(&a, &b);
        let rmse = 3.0 / 600.0_f64.sqrt();
        assert!((m.rmse_steps() - rmse).abs() < 1e-5);
        assert!((m.psnr - 20.0 * (255.0 / rmse).log10()).abs() < 1e-4);
        assert_eq!((m.largest_at, m.beyond_255th, m.beyond_510th), ((3, 7), 1.0 / 200.0, 1.0 / 200.0));
        assert!((m.largest * 255.0 - 3.0).abs() < 1e-5);
        assert!(m.ssim < 1.0 && m.flip > 0.0);
    }

    #[test]
    fn radiance_is_seen_encoded_and_measured_as_it_is() {
        let a = image(32, 32, |x, y| some(x, y).map(|c| 0.1 * c));
        let b = image(32, 32, |x, y| some(x, y).map(|c| 0.1 * c + if x == y { 0.02 } else { 0.0 }));
        let encoded = |image: &Image| image.clone().map(|x| from_linear(Transfer::Srgb, x.into()) as f32);
        let (plain, seen) = (Metrics::measure(&a, &b), Metrics::measure(&encoded(&a), &encoded(&b)));
        let m = Metrics::of_radiance(&a, &b);
        assert_eq!((m.rmse, m.largest, m.beyond_255th), (plain.rmse, plain.largest, plain.beyond_255th));
        assert_eq!((m.ssim, m.flip), (seen.ssim, seen.flip));
        // Dark pictures look further apart than their light is.
        assert!(m.flip > plain.flip && m.ssim < plain.ssim);
    }

    #[test]
    fn one_step_is_not_beyond_one_step() {
        for code in 0..255_u8 {
            let a = image(1, 1, |_, _| [f32::from(code) / 255.0; 3]);
            let b = image(1, 1, |_, _| [f32::from(code + 1) / 255.0; 3]);
            let m = Metrics::measure(&a, &b);
            assert_eq!((m.beyond_255th, m.beyond_510th), (0.0, 1.0));
        }
    }

    #[test]
    fn what_is_not_a_number_is_off_by_all() {
        let a = image(2, 1, |_, _| [0.5, f32::INFINITY, f32::NAN]);
        let b = image(2, 1, |x, _| if x == 0 { [0.5, f32::INFINITY, f32::NAN] } else { [f32::NAN, 0.0, f32::NAN] });
        assert_eq!(Metrics::measure(&a, &a).rmse, 0.0);
        assert_eq!(Metrics::measure(&a, &b).largest_at, (1, 0));
    }
}
