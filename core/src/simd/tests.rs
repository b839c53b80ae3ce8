//! Every operation of every level against the same on plain numbers.

use proptest::prelude::*;

use super::*;

/// What is in lanes, and a set of these.
#[derive(Debug)]
struct Case {
    singles: [[f32; LANES]; 3],
    doubles: [[f64; 8]; 3],
    ids: [u32; LANES],
    mask: Mask,
}

/// What operations give, by their names, as bits.
type Results = Vec<(&'static str, Vec<u64>)>;

/// All that are not a number are alike.
fn bits32(x: &[f32]) -> Vec<u64> {
    x.iter().map(|x| if x.is_nan() { u64::MAX } else { x.to_bits().into() }).collect()
}

fn bits64(x: &[f64]) -> Vec<u64> {
    x.iter().map(|x| if x.is_nan() { u64::MAX } else { x.to_bits() }).collect()
}

/// What `$value` is stored as, in bits. (Macros, for what a closure does is not surely compiled for the level.)
macro_rules! stored {
    ($bits:ident, $zero:expr, $value:expr) => {{
        let mut to = $zero;
        $value.store(&mut to);
        $bits(&to)
    }};
}

/// Adding zero makes one of both zeros, of which either may be the greater.
macro_rules! floats {
    ($F:ty, $lanes:expr, $a:expr, $b:expr, $c:expr, $mask:expr) => {{
        let (zero, none) = ([0.0; $lanes], <$F>::splat(0.0));
        let (a, b, c) = (<$F>::load($a), <$F>::load($b), <$F>::load($c));
        vec![
            ("add", stored!(bits32, zero, a + b)),
            ("sub", stored!(bits32, zero, a - b)),
            ("mul", stored!(bits32, zero, a * b)),
            ("neg", stored!(bits32, zero, -a)),
            ("splat", stored!(bits32, zero, <$F>::splat($a[1]))),
            ("fma", stored!(bits32, zero, a.fma(b, c))),
            ("recip", stored!(bits32, zero, a.recip())),
            ("sqrt", stored!(bits32, zero, a.sqrt())),
            ("abs", stored!(bits32, zero, a.abs())),
            ("max", stored!(bits32, zero, a.max(b) + none)),
            ("min", stored!(bits32, zero, a.min(b) + none)),
            ("select", stored!(bits32, zero, a.select($mask, b))),
            ("lt", vec![a.lt(b).into()]),
            ("le", vec![a.le(b).into()]),
        ]
    }};
}

impl Kernel for &Case {
    type Output = [Results; 4];
    #[inline(always)]
    fn run<S: Simd>(self) -> [Results; 4] {
        let Case { singles: [a, b, c], doubles: [x, y, z], ids, mask } = self;
        let low = *mask as u8;
        let sixteen = floats!(S::F32x16, LANES, a, b, c, *mask);
        let eight = floats!(S::F32x8, 8, eight(a), eight(b), eight(c), low);
        let (zero, none) = ([0.0; 8], S::F64x8::splat(0.0));
        let (x, y, z, second) = (S::F64x8::load(x), S::F64x8::load(y), S::F64x8::load(z), x[1]);
        let double = vec![
            ("add", stored!(bits64, zero, x + y)),
            ("sub", stored!(bits64, zero, x - y)),
            ("mul", stored!(bits64, zero, x * y)),
            ("div", stored!(bits64, zero, x / y)),
            ("neg", stored!(bits64, zero, -x)),
            ("splat", stored!(bits64, zero, S::F64x8::splat(second))),
            ("sqrt", stored!(bits64, zero, x.sqrt())),
            ("abs", stored!(bits64, zero, x.abs())),
            ("max", stored!(bits64, zero, x.max(y) + none)),
            ("min", stored!(bits64, zero, x.min(y) + none)),
            ("if_positive", stored!(bits64, zero, x.if_positive(y, z))),
            ("compress", stored!(bits64, zero, x.compress(low))),
            ("positive", vec![x.positive().into()]),
            ("le", vec![x.le(y).into()]),
        ];
        let numbers = S::F32x16::load(&numbers(a));
        let mut put = *ids;
        S::put(&mut put, *mask, 77);
        let whole = vec![
            ("narrow", stored!(bits32, [0.0; LANES], S::narrow(x, y))),
            ("least", bits32(&[numbers.least() + 0.0])),
            ("greatest", bits32(&[numbers.greatest() + 0.0])),
            ("equal", vec![S::equal(ids, ids[3]).into()]),
            ("put", put.map(u64::from).to_vec()),
            ("compress", S::compress(eight_ids(ids), low).map(u64::from).to_vec()),
        ];
        [sixteen, eight, double, whole]
    }
}

fn eight(x: &[f32; LANES]) -> &[f32; 8] {
    x.first_chunk().expect("sixteen")
}

fn eight_ids(x: &[u32; LANES]) -> &[u32; 8] {
    x.first_chunk().expect("sixteen")
}

/// Without what is none.
fn numbers(x: &[f32; LANES]) -> [f32; LANES] {
    x.map(|x| if x.is_nan() { 0.5 } else { x })
}

/// Lanes, as bits, in which something holds.
fn mask(lanes: usize, holds: impl Fn(usize) -> bool) -> Vec<u64> {
    vec![(0..lanes).map(|k| u64::from(holds(k)) << k).sum()]
}

/// The elements in `mask`, then zeros.
fn packed<T: Copy + Default>(x: &[T; 8], mask: u8) -> [T; 8] {
    let mut left = (0..8).filter(|k| mask >> k & 1 == 1).map(|k| x[k]);
    std::array::from_fn(|_| left.next().unwrap_or_default())
}

impl Case {
    fn plain_floats<const N: usize>(&self) -> Results {
        let [a, b, c] = self.singles;
        let of = |f: &dyn Fn(usize) -> f32| bits32(&std::array::from_fn::<f32, N, _>(f));
        vec![
            ("add", of(&|k| a[k] + b[k])),
            ("sub", of(&|k| a[k] - b[k])),
            ("mul", of(&|k| a[k] * b[k])),
            ("neg", of(&|k| -a[k])),
            ("splat", of(&|_| a[1])),
            ("fma", of(&|k| a[k] * b[k] + c[k])),
            ("recip", of(&|k| 1.0 / a[k])),
            ("sqrt", of(&|k| a[k].sqrt())),
            ("abs", of(&|k| a[k].abs())),
            ("max", of(&|k| 0.0 + if a[k] > b[k] { a[k] } else { b[k] })),
            ("min", of(&|k| 0.0 + if a[k] < b[k] { a[k] } else { b[k] })),
            ("select", of(&|k| if self.mask >> k & 1 == 1 { a[k] } else { b[k] })),
            ("lt", mask(N, |k| a[k] < b[k])),
            ("le", mask(N, |k| a[k] <= b[k])),
        ]
    }

    fn plain(&self) -> [Results; 4] {
        let ([x, y, z], low) = (self.doubles, self.mask as u8);
        let of = |f: &dyn Fn(usize) -> f64| bits64(&std::array::from_fn::<f64, 8, _>(f));
        let double = vec![
            ("add", of(&|k| x[k] + y[k])),
            ("sub", of(&|k| x[k] - y[k])),
            ("mul", of(&|k| x[k] * y[k])),
            ("div", of(&|k| x[k] / y[k])),
            ("neg", of(&|k| -x[k])),
            ("splat", of(&|_| x[1])),
            ("sqrt", of(&|k| x[k].sqrt())),
            ("abs", of(&|k| x[k].abs())),
            ("max", of(&|k| 0.0 + if x[k] > y[k] { x[k] } else { y[k] })),
            ("min", of(&|k| 0.0 + if x[k] < y[k] { x[k] } else { y[k] })),
            ("if_positive", of(&|k| if x[k] > 0.0 { y[k] } else { z[k] })),
            ("compress", bits64(&packed(&x, low))),
            ("positive", mask(8, |k| x[k] > 0.0)),
            ("le", mask(8, |k| x[k] <= y[k])),
        ];
        let (a, ids) = (numbers(&self.singles[0]), self.ids);
        let narrow: Vec<f32> = x.into_iter().chain(y).map(|x| x as f32).collect();
        let put: Vec<u64> = (0..LANES).map(|k| if self.mask >> k & 1 == 1 { 77 } else { ids[k].into() }).collect();
        let whole = vec![
            ("narrow", bits32(&narrow)),
            ("least", bits32(&[0.0 + a.into_iter().fold(f32::INFINITY, f32::min)])),
            ("greatest", bits32(&[0.0 + a.into_iter().fold(f32::NEG_INFINITY, f32::max)])),
            ("equal", mask(LANES, |k| ids[k] == ids[3])),
            ("put", put),
            ("compress", packed(eight_ids(&ids), low).map(u64::from).to_vec()),
        ];
        [self.plain_floats::<LANES>(), self.plain_floats::<8>(), double, whole]
    }

    /// a · b + c with one rounding.
    fn fused<const N: usize>(&self) -> Vec<u64> {
        let [a, b, c] = self.singles;
        bits32(&std::array::from_fn::<f32, N, _>(|k| a[k].mul_add(b[k], c[k])))
    }
}

/// Any bits, and often small whole numbers, which are equal, zero and of both signs.
fn any_f32() -> impl Strategy<Value = f32> {
    prop_oneof![any::<u32>().prop_map(f32::from_bits), (-2i8..3).prop_map(f32::from)]
}

fn any_f64() -> impl Strategy<Value = f64> {
    prop_oneof![any::<u64>().prop_map(f64::from_bits), (-2i8..3).prop_map(f64::from), any_f32().prop_map(f64::from)]
}

fn case() -> impl Strategy<Value = Case> {
    let singles = prop::array::uniform3(prop::array::uniform16(any_f32()));
    let doubles = prop::array::uniform3(prop::array::uniform8(any_f64()));
    (singles, doubles, prop::array::uniform16(0u32..4), any::<Mask>()).prop_map(|(singles, doubles, ids, mask)| Case {
        singles,
        doubles,
        ids,
        mask,
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]

    #[test]
    fn every_operation_is_that_of_plain_numbers(case in case()) {
        let plain = case.plain();
        for level in Level::all() {
            for (part, (found, plain)) in dispatch(level, &case).iter().zip(&plain).enumerate() {
                for ((name, found), (plain_name, plain)) in found.iter().zip(plain) {
                    prop_assert_eq!(name, plain_name);
                    if *name == "fma" {
                        let fused = if part == 0 { case.fused::<LANES>() } else { case.fused::<8>() };
                        let either = found.iter().zip(plain.iter().zip(&fused)).all(|(f, (p, q))| f == p || f == q);
                        prop_assert!(either, "{:?} {} in {}: {:?}", level, name, part, found);
                    } else {
                        prop_assert_eq!(found, plain, "{:?} {} in {}", level, name, part);
                    }
                }
            }
        }
    }
}
