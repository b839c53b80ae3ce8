//! FLIP: the difference that a viewer sees when two pictures are flipped between.
//!
//! Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, *FLIP: A Difference
//! Evaluator for Alternating Images*, Proc. ACM Comput. Graph. Interact. Tech. 3 (2020),
//! for pictures of standard range; names and constants are the paper's.

use rayon::prelude::*;

use super::image::Image;
use super::metrics::in_range;
use super::transfer::to_linear;
use crate::settings::Transfer;

/// Pixels a degree of view: a display 0.7 m wide with 3840 pixels, seen from 0.7 m.
const PPD: f64 = 0.7 * (3840.0 / 0.7) * (std::f64::consts::PI / 180.0);

/// Linear sRGB to CIE XYZ, by rows.
const XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

/// The mean error over all pixels, in [0, 1]. The numbers are taken as sRGB-encoded and clamped.
pub(super) fn mean(reference: &Image, test: &Image) -> f64 {
    let (w, h) = (reference.width() as usize, reference.height() as usize);
    let (reference, test) = rayon::join(|| Seen::new(reference), || Seen::new(test));
    let largest = distance(hunt([0.0, 1.0, 0.0]), hunt([0.0, 0.0, 1.0])).powf(0.7);
    let total: f64 = (0..w * h)
        .into_par_iter()
        .with_min_len(1 << 12)
        .map(|i| {
            let colour = redistributed(distance(reference.colour[i], test.colour[i]).powf(0.7), largest);
            let edge = (reference.edge[i] - test.edge[i]).abs();
            let point = (reference.point[i] - test.point[i]).abs();
            let feature = (edge.max(point) / std::f64::consts::SQRT_2).sqrt();
            colour.powf(1.0 - feature)
        })
        .collect::<Vec<f64>>()
        .into_iter()
        .sum();
    total / (w * h) as f64
}

/// Maps a colour distance to [0, 1], small ones spread over most of it.
fn redistributed(distance: f64, largest: f64) -> f64 {
    let (pc, pt) = (0.4 * largest, 0.95);
    if distance < pc { distance * pt / pc } else { pt + (distance - pc) / (largest - pc) * (1.0 - pt) }
}

/// What an eye makes of a picture.
struct Seen {
    /// Filtered colours in Hunt-adjusted CIELAB.
    colour: Vec<[f64; 3]>,
    /// Strength of edges and of points in the achromatic channel.
    edge: Vec<f64>,
    point: Vec<f64>,
}

impl Seen {
    fn new(image: &Image) -> Self {
        let (w, h) = (image.width() as usize, image.height() as usize);
        let opponent: Vec<[f64; 3]> = image
            .pixels()
            .par_iter()
            .with_min_len(1 << 12)
            .map(|p| to_opponent(p.map(|x| to_linear(Transfer::Srgb, in_range(x).into()))))
            .collect();
        let channel = |c: usize| -> Vec<f64> { opponent.iter().map(|p| p[c]).collect() };
        let [y, x, z] = [channel(0), channel(1), channel(2)];
        // Contrast sensitivity of each channel: weights and widths of Gaussians.
        let filtered = [
            sensitivity(&y, w, h, &[(1.0, 0.0047)]),
            sensitivity(&x, w, h, &[(1.0, 0.0053)]),
            sensitivity(&z, w, h, &[(34.1, 0.04), (13.5, 0.025)]),
        ];
        let inverse = inverse(&XYZ);
        let colour = (0..w * h)
            .into_par_iter()
            .with_min_len(1 << 12)
            .map(|i| hunt(from_opponent([filtered[0][i], filtered[1][i], filtered[2][i]], &inverse)))
            .collect();
        let grey: Vec<f64> = y.iter().map(|y| (y + 16.0) / 116.0).collect();
        let (edge, point) =
            rayon::join(|| features(&grey, w, h, Feature::Edge), || features(&grey, w, h, Feature::Point));
        Self { colour, edge, point }
    }
}

fn times(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn inverse(m: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let cofactor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant: f64 = (0..3).map(|c| m[0][c] * cofactor(0, c)).sum();
    [0, 1, 2].map(|r| [0, 1, 2].map(|c| cofactor(c, r) / determinant))
}

/// XYZ over that of white.
fn relative_xyz(linear: [f64; 3]) -> [f64; 3] {
    let (xyz, white) = (times(&XYZ, linear), times(&XYZ, [1.0; 3]));
    [0, 1, 2].map(|i| xyz[i] / white[i])
}

/// Linear RGB to the opponent space YCxCz.
fn to_opponent(linear: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = relative_xyz(linear);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// YCxCz to linear RGB, clamped to [0, 1].
fn from_opponent([y, cx, cz]: [f64; 3], inverse: &[[f64; 3]; 3]) -> [f64; 3] {
    let y = (y + 16.0) / 116.0;
    let relative = [y + cx / 500.0, y, y - cz / 200.0];
    let white = times(&XYZ, [1.0; 3]);
    times(inverse, [0, 1, 2].map(|i| relative[i] * white[i])).map(|c| c.clamp(0.0, 1.0))
}

/// Linear RGB to CIELAB, its chroma scaled by lightness as Hunt found.
fn hunt(linear: [f64; 3]) -> [f64; 3] {
    const DELTA: f64 = 6.0 / 29.0;
    let [x, y, z] =
        relative_xyz(linear).map(|t| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 });
    let (l, a, b) = (116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z));
    [l, 0.01 * l * a, 0.01 * l * b]
}

/// The distance HyAB.
fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// `values` scaled to a sum of 1.
pub(super) fn normalised(mut values: Vec<f64>) -> Vec<f64> {
    let sum: f64 = values.iter().sum();
    values.iter_mut().for_each(|v| *v /= sum);
    values
}

/// One channel as the eye resolves it: a sum of Gaussians a·√(π/b)·exp(−π²r²/b), r in
/// degrees, scaled together to a sum of 1 over the widest one's square.
fn sensitivity(plane: &[f64], w: usize, h: usize, parts: &[(f64, f64)]) -> Vec<f64> {
    use std::f64::consts::PI;
    let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * PPD).ceil() as i32;
    let gaussians: Vec<(f64, Vec<f64>)> = parts
        .iter()
        .map(|&(a, b)| {
            let line: Vec<f64> =
                (-radius..=radius).map(|i| (-PI * PI * (f64::from(i) / PPD).powi(2) / b).exp()).collect();
            let sum: f64 = line.iter().sum();
            (a * (PI / b).sqrt() * sum * sum, normalised(line))
        })
        .collect();
    let weight: f64 = gaussians.iter().map(|(w, _)| w).sum();
    let mut out = vec![0.0; plane.len()];
    for (share, line) in gaussians {
        let blurred = convolve(plane, w, h, &line, &line);
        out.iter_mut().zip(blurred).for_each(|(o, b)| *o += share / weight * b);
    }
    out
}

#[derive(Clone, Copy)]
enum Feature {
    Edge,
    Point,
}

/// Strength of a feature: the length of the responses across and down to a Gaussian's
/// first (edges) or second (points) derivative as wide as the eye's detectors.
fn features(grey: &[f64], w: usize, h: usize, feature: Feature) -> Vec<f64> {
    let sd = 0.5 * 0.082 * PPD;
    let radius = (3.0 * sd).ceil() as i32;
    let gauss = |i: i32| (-f64::from(i * i) / (2.0 * sd * sd)).exp();
    let smooth: Vec<f64> = (-radius..=radius).map(gauss).collect();
    let mut across: Vec<f64> = (-radius..=radius)
        .map(|i| {
            let x = f64::from(i);
            match feature {
                Feature::Edge => -x * gauss(i),
                Feature::Point => (x * x / (sd * sd) - 1.0) * gauss(i),
            }
        })
        .collect();
    // Positive weights sum to 1 over the square, negative ones to −1.
    let sum: f64 = smooth.iter().sum();
    let (mut up, mut down) = (0.0, 0.0);
    across.iter().for_each(|&v| if v > 0.0 { up += v } else { down -= v });
    across.iter_mut().for_each(|v| *v /= sum * if *v > 0.0 { up } else { down });
    let (dx, dy) = rayon::join(|| convolve(grey, w, h, &across, &smooth), || convolve(grey, w, h, &smooth, &across));
    dx.iter().zip(&dy).map(|(x, y)| x.hypot(*y)).collect()
}

/// Convolution by `across` × `down`, both of odd length; beyond the border its pixels continue.
pub(super) fn convolve(plane: &[f64], w: usize, h: usize, across: &[f64], down: &[f64]) -> Vec<f64> {
    // Correlation with the kernel as given; every kernel here is symmetric or used by magnitude.
    let (rx, ry) = (across.len() / 2, down.len() / 2);
    let mut rows = vec![0.0; w * h];
    rows.par_chunks_exact_mut(w).zip(plane.par_chunks_exact(w)).for_each(|(out, row)| {
        let mut padded = Vec::with_capacity(w + 2 * rx);
        padded.resize(rx, row[0]);
        padded.extend_from_slice(row);
        padded.resize(w + 2 * rx, row[w - 1]);
        for (k, weight) in across.iter().enumerate() {
            out.iter_mut().zip(&padded[k..]).for_each(|(o, v)| *o += weight * v);
        }
    });
    let mut out = vec![0.0; w * h];
    out.par_chunks_exact_mut(w).enumerate().for_each(|(y, out)| {
        for (k, weight) in down.iter().enumerate() {
            let from = (y + k).saturating_sub(ry).min(h - 1);
            out.iter_mut().zip(&rows[from * w..][..w]).for_each(|(o, v)| *o += weight * v);
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(colour: [f32; 3]) -> Image {
        Image::new(32, 32, vec![colour; 32 * 32]).unwrap()
    }

    #[test]
    fn green_against_blue_is_the_largest_error() {
        let error = mean(&flat([0.0, 1.0, 0.0]), &flat([0.0, 0.0, 1.0]));
        assert!((error - 1.0).abs() < 1e-9, "{error}");
    }

    /// The paper's authors' own program gives 0.394207686 for these two, in f32.
    #[test]
    fn it_agrees_with_its_authors() {
        let image = |f: &dyn Fn(u32, u32) -> [u32; 3]| {
            let codes = (0..64).flat_map(|y| (0..96).map(move |x| (x, y)));
            let pixels = codes.map(|(x, y)| f(x, y).map(|c| (c % 256) as f32 / 255.0)).collect();
            Image::new(96, 64, pixels).unwrap()
        };
        let a = image(&|x, y| [x * 7 + y * 3, x * y, (x / 8 + y / 8) % 2 * 200]);
        let b = image(&|x, y| [x * 7 + y * 3 + x / 20 * 9, x * y, (x / 8 + y / 9) % 2 * 200]);
        let error = mean(&a, &b);
        assert!((error - 0.394_207_686).abs() < 2e-6, "{error}");
    }

    #[test]
    fn an_inverse_undoes() {
        let back = from_opponent(to_opponent([0.2, 0.5, 0.9]), &inverse(&XYZ));
        for (a, b) in back.iter().zip([0.2, 0.5, 0.9]) {
            assert!((a - b).abs() < 1e-12);
        }
    }
}
