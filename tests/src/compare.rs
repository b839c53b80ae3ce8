//! Pictures side by side.

use std::path::PathBuf;

/// Linear radiance, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `width` · `height` pixels.
    pub pixels: Vec<[f64; 3]>,
}

impl Image {
    /// The same, every component brought into [0, 1].
    #[must_use]
    pub fn clamped(mut self) -> Self {
        self.pixels.iter_mut().flatten().for_each(|c| *c = c.clamp(0.0, 1.0));
        self
    }

    /// Writes a 16-bit linear PPM, values clamped to [0, 1].
    #[must_use]
    pub fn to_ppm(&self) -> Vec<u8> {
        let mut out = format!("P6\n{} {}\n255\n", self.width, self.height).into_bytes();
        let encode = |c: f64| if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * libm::pow(c, 1.0 / 2.4) - 0.055 };
        out.extend(self.pixels.iter().flatten().map(|c| (encode(c.clamp(0.0, 1.0)) * 255.0).round() as u8));
        out
    }
}

/// How far apart two pictures of equal size are.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Root of the mean square over all components.
    pub rmse: f64,
    /// The largest difference of one component.
    pub largest: f64,
    /// Pixels with a component off by more than 1/255, as a share.
    pub share_off: f64,
    /// Pixels (x, y) with a component off by more than 2/255 or not a finite number.
    pub wrong: Vec<(usize, usize)>,
}

/// Measures how far `actual` is from `expected`.
///
/// # Panics
/// When the sizes differ.
#[must_use]
pub fn difference(expected: &Image, actual: &Image) -> Difference {
    assert_eq!((expected.width, expected.height), (actual.width, actual.height), "sizes differ");
    let mut out = Difference { rmse: 0.0, largest: 0.0, share_off: 0.0, wrong: Vec::new() };
    for (i, (e, a)) in expected.pixels.iter().zip(&actual.pixels).enumerate() {
        let worst = (0..3)
            .map(|k| (e[k] - a[k]).abs())
            .fold(0.0, |m: f64, d| if d.is_nan() { f64::INFINITY } else { m.max(d) });
        out.rmse += (0..3).map(|k| (e[k] - a[k]).powi(2)).sum::<f64>();
        out.largest = out.largest.max(worst);
        out.share_off += f64::from(worst > 1.0 / 255.0);
        // Large radiances (many lights) are compared in relation to their size.
        let scale = e.iter().fold(1.0, |m: f64, c| m.max(c.abs()));
        if worst > scale * 2.0 / 255.0 {
            out.wrong.push((i % expected.width, i / expected.width));
        }
    }
    let n = expected.pixels.len() as f64;
    out.rmse = (out.rmse / (3.0 * n)).sqrt();
    out.share_off /= n;
    out
}

/// Demands that no pixel is wrong; else writes expected, actual and difference pictures
/// into `target/` and says where.
///
/// # Panics
/// When a pixel is wrong.
#[track_caller]
pub fn assert_same_picture(name: &str, expected: &Image, actual: &Image) {
    let d = difference(expected, actual);
    if d.wrong.is_empty() {
        return;
    }
    let at = write_failure(name, expected, actual);
    let shown: Vec<String> = d
        .wrong
        .iter()
        .take(5)
        .map(|&(x, y)| {
            let i = y * expected.width + x;
            format!("({x}, {y}): {:?} is not {:?}", actual.pixels[i], expected.pixels[i])
        })
        .collect();
    panic!(
        "{name}: {} wrong pixels of {}; pictures in {at:?}\n{}",
        d.wrong.len(),
        expected.pixels.len(),
        shown.join("\n")
    );
}

/// Writes the three pictures of a failed comparison and returns their folder.
#[must_use]
pub fn write_failure(name: &str, expected: &Image, actual: &Image) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../target/failures");
    let pixels = expected.pixels.iter().zip(&actual.pixels).map(|(e, a)| [0, 1, 2].map(|k| (e[k] - a[k]).abs()));
    let difference = Image { pixels: pixels.collect(), ..expected.clone() };
    // A picture that cannot be written must not hide the failure itself.
    let _ = std::fs::create_dir_all(&folder);
    for (kind, image) in [("expected", expected), ("actual", actual), ("difference", &difference)] {
        let _ = std::fs::write(folder.join(format!("{name}-{kind}.ppm")), image.to_ppm());
    }
    folder
}
