//! Differences as a picture: false colour, with its scale below.

use super::image::Image;

/// Height of the scale below the picture, in pixels.
const LEGEND: usize = 24;
/// Errors in 8-bit steps from which a pixel is no longer black, and at which it is white.
const LEAST: f32 = 1.0 / 16.0;
const MOST: f32 = 255.0;
/// Colours from small to large errors: dark blue, blue, green, yellow, red, white.
const COLOURS: [[f32; 3]; 6] = [
    [20.0, 20.0, 90.0],
    [30.0, 90.0, 230.0],
    [20.0, 170.0, 80.0],
    [240.0, 220.0, 40.0],
    [230.0, 40.0, 30.0],
    [255.0; 3],
];
/// Numbers below the scale, in 8-bit steps.
const MARKS: [(f32, &str); 7] =
    [(0.125, "1/8"), (0.5, "1/2"), (1.0, "1"), (4.0, "4"), (16.0, "16"), (64.0, "64"), (255.0, "255")];

/// Eight-bit sRGB codes of a difference picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FalseColour {
    /// Pixels across: as the pictures compared, at least 160.
    pub width: u32,
    /// Pixels down: as the pictures compared, and the scale.
    pub height: u32,
    /// Rows from the top.
    pub pixels: Vec<[u8; 3]>,
}

/// Paints every pixel's largest error, in 8-bit steps on a logarithmic scale: black where
/// the pictures are equal (to 1/16 step), white where they are 255 apart.
///
/// # Panics
/// When the pictures are not of the same size.
#[must_use]
pub fn differences(a: &Image, b: &Image) -> FalseColour {
    assert_eq!((a.width(), a.height()), (b.width(), b.height()), "pictures of different sizes were compared");
    let (w, h) = (a.width() as usize, a.height() as usize);
    let width = w.max(160);
    let mut pixels = vec![[0; 3]; width * (h + LEGEND)];
    for (row, (a, b)) in a.pixels().chunks_exact(w).zip(b.pixels().chunks_exact(w)).enumerate() {
        for (x, (a, b)) in a.iter().zip(b).enumerate() {
            let apart = [0, 1, 2].map(|c| (a[c] - b[c]).abs());
            // Not-a-number is as wrong as can be.
            let worst = apart.into_iter().fold(0.0, |m: f32, e| if e.is_nan() { MOST } else { m.max(e) });
            pixels[row * width + x] = colour(255.0 * worst);
        }
    }
    legend(&mut pixels[width * h..], width);
    FalseColour { width: width as u32, height: (h + LEGEND) as u32, pixels }
}

/// Where an error lies on the scale, 0 to 1; negative below it.
fn position(steps: f32) -> f32 {
    (steps / LEAST).log2() / (MOST / LEAST).log2()
}

fn colour(steps: f32) -> [u8; 3] {
    // Also where it is not a number.
    if steps.is_nan() || steps < LEAST {
        return [0; 3];
    }
    let at = position(steps).clamp(0.0, 1.0) * (COLOURS.len() - 1) as f32;
    let lower = (at as usize).min(COLOURS.len() - 2);
    let part = at - lower as f32;
    [0, 1, 2].map(|c| (COLOURS[lower][c] * (1.0 - part) + COLOURS[lower + 1][c] * part).round() as u8)
}

/// A strip of the colours with numbers below it.
fn legend(rows: &mut [[u8; 3]], width: usize) {
    let (left, right) = (4, width - 12);
    let x_of = |p: f32| left as f32 + p * (right - left) as f32;
    for x in left..=right {
        let p = (x - left) as f32 / (right - left) as f32;
        let c = colour(LEAST * (MOST / LEAST).powf(p) * 1.0001);
        for y in 4..12 {
            rows[y * width + x] = c;
        }
    }
    for (steps, text) in MARKS {
        let x = x_of(position(steps)).round() as usize;
        for y in 12..14 {
            rows[y * width + x] = [255; 3];
        }
        let begin = x.saturating_sub(2 * text.len()).min(width - 4 * text.len());
        for (i, c) in text.chars().enumerate() {
            for (y, bits) in glyph(c).into_iter().enumerate() {
                for bit in (0..3).filter(|b| bits & (4 >> b) != 0) {
                    rows[(16 + y) * width + begin + 4 * i + bit] = [220; 3];
                }
            }
        }
    }
}

/// A sign of 3 × 5 pixels, a number a row.
fn glyph(c: char) -> [u8; 5] {
    match c {
        '0' => [7, 5, 5, 5, 7],
        '1' => [2, 6, 2, 2, 7],
        '2' => [7, 1, 7, 4, 7],
        '4' => [5, 5, 7, 1, 1],
        '5' => [7, 4, 7, 1, 7],
        '6' => [7, 4, 7, 5, 7],
        '8' => [7, 5, 7, 5, 7],
        '/' => [1, 1, 2, 4, 4],
        _ => [0; 5],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_is_black_and_worse_is_brighter() {
        assert_eq!(colour(0.0), [0; 3]);
        assert_eq!(colour(255.0), [255; 3]);
        let order = [0.25, 1.0, 4.0, 16.0, 64.0].map(colour);
        for pair in order.windows(2) {
            assert_ne!(pair[0], pair[1]);
        }
        let a = Image::new(2, 1, vec![[0.0; 3], [0.5; 3]]).unwrap();
        let b = Image::new(2, 1, vec![[0.0; 3], [0.5, 0.5, f32::NAN]]).unwrap();
        let picture = differences(&a, &b);
        assert_eq!((picture.width, picture.height), (160, 25));
        assert_eq!(picture.pixels[..3], [[0; 3], [255; 3], [0; 3]]);
    }
}
