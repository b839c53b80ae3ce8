//! Linear radiance to integer codes: clamp to [0, 1], encode, round to nearest.
//!
//! The result is that of exact arithmetic. A code is the number of thresholds at or
//! below a value, a threshold being the radiance at which a code begins; a table over
//! the leading bits of the number says how many thresholds lie below all of its kind,
//! and one comparison settles the rest. 16-bit sRGB has too many thresholds for such a
//! table: there a quadratic in every interval is near enough for all but a few values
//! in ten thousand, and those few are compared with their threshold.
//!
//! Not-a-number is taken as 0. The only ties there are (0.5, where the transfer is
//! linear) go up.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::transfer::{from_linear, to_linear};
use crate::settings::Transfer;

/// 8-bit codes of `pixels`. Large pictures are shared out over the calling rayon pool.
#[must_use]
pub fn to_bytes(transfer: Transfer, pixels: &[[f32; 3]]) -> Vec<[u8; 3]> {
    let pixels = pixels.par_iter().with_min_len(1 << 14);
    match transfer {
        // Exact: 24 + 8 bits, and the half, fit a double.
        Transfer::Linear => pixels.map(|p| p.map(|x| (f64::from(x) * 255.0 + 0.5) as u8)).collect(),
        Transfer::Srgb => {
            let table = Thresholds::get();
            pixels.map(|p| p.map(|x| table.code(x))).collect()
        }
    }
}

/// 16-bit codes of `pixels`. Large pictures are shared out over the calling rayon pool.
#[must_use]
pub fn to_words(transfer: Transfer, pixels: &[[f32; 3]]) -> Vec<[u16; 3]> {
    let pixels = pixels.par_iter().with_min_len(1 << 14);
    match transfer {
        Transfer::Linear => pixels.map(|p| p.map(|x| (f64::from(x) * 65535.0 + 0.5) as u16)).collect(),
        Transfer::Srgb => {
            let table = Quadratics::get();
            pixels.map(|p| p.map(|x| table.code(x))).collect()
        }
    }
}

/// The radiance at which `code` of 0..=`max` begins.
fn threshold(code: u32, max: u32) -> f64 {
    to_linear(Transfer::Srgb, (f64::from(code) - 0.5) / f64::from(max))
}

/// Leading mantissa bits by which numbers are sorted into intervals.
const MANTISSA: u32 = 7;
const SHIFT: u32 = 23 - MANTISSA;

/// The interval of a number, by its leading bits; `least` is the smallest exponent kept.
/// Everything smaller, negative or not a number is in the first, 1 and above in the last.
fn interval(x: f32, least: u32) -> usize {
    let floor = f32::from_bits(least << 23);
    // The comparison is false for NaN.
    let bounded = if x > floor { x.min(1.0) } else { floor };
    ((bounded.to_bits() - (least << 23)) >> SHIFT) as usize
}

/// Where interval `index` begins.
fn begin(index: usize, least: u32) -> f32 {
    f32::from_bits((least << 23) + ((index as u32) << SHIFT))
}

/// How many intervals there are from exponent `least` to 1, that of 1 included.
const fn intervals(least: u32) -> usize {
    (((127 - least) << MANTISSA) + 1) as usize
}

/// Exponent of 2^-13, below the first 8-bit threshold.
const LEAST_8: u32 = 127 - 13;

/// 8-bit sRGB: by interval, its threshold (NaN where it has none) and the code below that. An interval holds at most one threshold: it spans at most 1/128 of its
/// numbers, and no code spans less than 1/112 of its own.
struct Thresholds([(f32, u8); intervals(LEAST_8)]);

impl Thresholds {
    fn get() -> &'static Self {
        static TABLE: OnceLock<Thresholds> = OnceLock::new();
        TABLE.get_or_init(|| {
            // The first f32 at or above each threshold.
            let starts: Vec<f32> = (1..=255)
                .map(|code| {
                    let t = threshold(code, 255);
                    let near = t as f32;
                    if f64::from(near) < t { near.next_up() } else { near }
                })
                .collect();
            Self(std::array::from_fn(|i| {
                let below = starts.partition_point(|&t| t <= begin(i, LEAST_8));
                (starts.get(below).copied().unwrap_or(f32::NAN), below as u8)
            }))
        })
    }

    fn code(&self, x: f32) -> u8 {
        let (next, below) = self.0[interval(x, LEAST_8)];
        below + u8::from(x >= next)
    }
}

/// Exponent of 2^-21, below the first 16-bit threshold.
const LEAST_16: u32 = 127 - 21;

/// 16-bit sRGB: by interval, 65535 · encoded(x) as a quadratic around the interval's middle.
struct Quadratics(Vec<[f64; 4]>);

/// What the quadratics may be wrong by, in codes.
const DOUBT: f64 = 4e-4;

impl Quadratics {
    fn get() -> &'static Self {
        static TABLE: OnceLock<Quadratics> = OnceLock::new();
        TABLE.get_or_init(|| {
            let exact = |x: f64| 65535.0 * from_linear(Transfer::Srgb, x.min(1.0));
            Self(
                (0..intervals(LEAST_16))
                    .map(|i| {
                        let (a, b) = (f64::from(begin(i, LEAST_16)), f64::from(begin(i + 1, LEAST_16)));
                        let (middle, half) = ((a + b) / 2.0, (b - a) / 2.0);
                        // Where the curve's two parts meet, no quadratic will do: all is in doubt.
                        if a <= 0.0031308 && 0.0031308 <= b {
                            return [f64::NAN; 4];
                        }
                        // Through the Chebyshev nodes, where the error of a quadratic is least.
                        let node = half * 0.75_f64.sqrt();
                        let [l, m, r] = [exact(middle - node), exact(middle), exact(middle + node)];
                        [middle, m, (r - l) / (2.0 * node), (l + r - 2.0 * m) / (2.0 * node * node)]
                    })
                    .collect(),
            )
        })
    }

    fn code(&self, x: f32) -> u16 {
        let index = interval(x, LEAST_16);
        if index == 0 || index == self.0.len() - 1 {
            return if index == 0 { 0 } else { u16::MAX };
        }
        let [middle, c0, c1, c2] = self.0[index];
        let d = f64::from(x) - middle;
        let rounded = c0 + d * (c1 + d * c2) + 0.5;
        let code = rounded as u32;
        let part = rounded - f64::from(code);
        if part > DOUBT && part < 1.0 - DOUBT { code as u16 } else { settle(x.into()) }
    }
}

/// The 16-bit code of `x` in (0, 1), by the thresholds themselves.
#[cold]
fn settle(x: f64) -> u16 {
    let code = (65535.0 * from_linear(Transfer::Srgb, x) + 0.5) as u16;
    if code > 0 && x < threshold(code.into(), 65535) {
        code - 1
    } else if code < u16::MAX && x >= threshold(u32::from(code) + 1, 65535) {
        code + 1
    } else {
        code
    }
}

#[cfg(test)]
mod tests {
    use dashu_int::UBig;

    use super::*;

    /// Whether `x` in (0, 1] reaches `code`, in exact integers: beyond the straight part,
    /// x ≥ c^2.4 is x⁵ ≥ c¹² for the rational c = (e + 0.055)/1.055, e = (code − ½)/max.
    fn reaches(x: f32, code: u32, max: u32) -> bool {
        let mantissa = UBig::from((x.to_bits() & 0x7f_ffff) | 0x80_0000);
        let exponent = 150 - (x.to_bits() >> 23); // x = mantissa / 2^exponent
        let (e, e_over) = (u64::from(2 * code - 1), u64::from(2 * max));
        // 12.92 × 0.0031308 = 0.040449936
        if u128::from(e) * 1_000_000_000 <= u128::from(e_over) * 40_449_936 {
            return mantissa * UBig::from(1292 * e_over) >= UBig::from(100 * e) << exponent as usize;
        }
        let (c, c_over) = (UBig::from(1000 * e + 55 * e_over), UBig::from(1055 * e_over));
        mantissa.pow(5) * c_over.pow(12) >= c.pow(12) << (5 * exponent) as usize
    }

    /// The first f32 of every code from 1, each proven to be the first.
    fn starts(max: u32) -> Vec<f32> {
        (1..=max)
            .map(|code| {
                let mut x = threshold(code, max) as f32;
                while !reaches(x, code, max) {
                    x = x.next_up();
                }
                while reaches(x.next_down(), code, max) {
                    x = x.next_down();
                }
                x
            })
            .collect()
    }

    fn check_all(max: u32, code: impl Fn(f32) -> u32) {
        let starts = starts(max);
        let mut expected = 0;
        // Every f32 from below the first threshold to beyond 1.
        for bits in (100 << 23)..=(128_u32 << 23) {
            let x = f32::from_bits(bits);
            while (expected as usize) < starts.len() && x >= starts[expected as usize] {
                expected += 1;
            }
            if code(x) != expected {
                panic!("{x:e} gives {}, not {expected}", code(x));
            }
        }
    }

    #[test]
    fn every_f32_gets_its_8_bit_code() {
        let table = Thresholds::get();
        check_all(255, |x| table.code(x).into());
    }

    #[test]
    fn every_f32_gets_its_16_bit_code() {
        let table = Quadratics::get();
        check_all(65535, |x| table.code(x).into());
    }

    #[test]
    fn what_is_not_in_range_is_clamped() {
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.0, 1e-45, 1e30, -1.0, 1.0, 0.0];
        let pixels: Vec<[f32; 3]> = odd.iter().map(|&x| [x; 3]).collect();
        for transfer in [Transfer::Srgb, Transfer::Linear] {
            let bytes: Vec<u8> = to_bytes(transfer, &pixels).iter().map(|p| p[1]).collect();
            assert_eq!(bytes, [0, 255, 0, 0, 0, 255, 0, 255, 0]);
            let words: Vec<u16> = to_words(transfer, &pixels).iter().map(|p| p[1]).collect();
            assert_eq!(words, [0, 65535, 0, 0, 0, 65535, 0, 65535, 0]);
        }
    }

    #[test]
    fn linear_codes_round_to_nearest() {
        assert_eq!(to_bytes(Transfer::Linear, &[[0.5, 0.1, 0.5_f32.next_down()]]), [[128, 26, 127]]);
        assert_eq!(to_words(Transfer::Linear, &[[0.5, 0.1, 1.0_f32.next_down()]]), [[32768, 6554, 65535]]);
    }

    #[test]
    fn codes_return_to_themselves() {
        for max in [255_u16, 65535] {
            let pixels: Vec<[f32; 3]> =
                super::super::transfer::table(Transfer::Srgb, max).iter().map(|&x| [x as f32; 3]).collect();
            for code in 0..=max {
                let pixel = &pixels[code as usize..][..1];
                let back = if max == 255 {
                    to_bytes(Transfer::Srgb, pixel)[0][0].into()
                } else {
                    to_words(Transfer::Srgb, pixel)[0][0]
                };
                assert_eq!(back, code);
            }
        }
    }

    #[test]
    #[ignore = "prints times"]
    fn times() {
        let pixels: Vec<[f32; 3]> = (0..1280 * 960)
            .map(|i: u32| [0, 1, 2].map(|c| ((i * 3 + c).wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0))
            .collect();
        for _ in 0..3 {
            let now = std::time::Instant::now();
            std::hint::black_box(to_bytes(Transfer::Srgb, &pixels));
            let a = now.elapsed();
            std::hint::black_box(to_words(Transfer::Srgb, &pixels));
            let b = now.elapsed() - a;
            std::hint::black_box(to_bytes(Transfer::Linear, &pixels));
            println!("8: {a:?} 16: {b:?} linear: {:?}", now.elapsed() - a - b);
        }
    }
}
