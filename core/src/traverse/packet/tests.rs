//! Numbers that are none decide nothing; what starts inside a sphere meets it where f32 says.

use glam::DVec3;
use proptest::prelude::*;

use super::rays::Rays;
use super::{LANES, Mask, Packet};
use crate::numeric::V3;
use crate::sampling::points::mix;
use crate::scene::{Sphere, Triangle};
use crate::shapes::filter::U32;
use crate::shapes::filter::{InLeaves, OneOf};
use crate::shapes::sphere::LocalSphere;
use crate::shapes::{plane, sphere, triangle};
use crate::simd::{F32x16, Kernel, Level, MOST, Simd, dispatch};

/// Sixteen rays of ten numbers each and an object of so many, of which one is not a number: a ray's or the object's.
#[derive(Clone, Debug)]
struct Case {
    rays: [[f32; LANES]; 9],
    object: [f32; triangle::filter::NUMBERS],
    /// Lanes in which nothing is known.
    spoilt: Mask,
}

impl Kernel for &Case {
    type Output = [(&'static str, Mask, Mask); 5];
    #[inline(always)]
    fn run<S: Simd>(self) -> Self::Output {
        let [x, y, z, u, v, w, near, per, ed] = self.rays;
        let packet = Packet { o: [x, y, z], d: [u, v, w], near, per, ed, ..Packet::default() };
        let ray = Rays::<S>::new(&packet).ray;
        let (all, ed, n) = (Mask::MAX, S::F32x16::load(&ed), &self.object);
        let row = |k: usize| [n[k]; MOST];
        let mut rows = ([[0.0; MOST]; triangle::filter::NUMBERS], [[0.0; MOST]; sphere::filter::NUMBERS]);
        for k in 0..triangle::filter::NUMBERS {
            rows.0[k] = row(k);
        }
        for k in 0..sphere::filter::NUMBERS {
            rows.1[k] = row(k);
        }
        let flat = plane::filter::Plane { n: [n[0], n[1], n[2]], h: n[3], through_eye: false };
        let (one, other) = ([n[4], n[5], n[6]], [n[8], n[9], n[10]]);
        let giant =
            triangle::filter::Giant { plane: flat, u: one, u0: n[7], v: other, v0: n[11], slope: n[12], terms: n[13] };
        let around = sphere::filter::Giant { m: [n[0], n[1], n[2]], q: n[3], k: n[4] };
        let meetings = [
            ("triangle", Triangle::intersect(&ray, &Triangle::load(&OneOf(&rows.0, 0)), all)),
            ("sphere", Sphere::intersect(&ray, &Sphere::load(&OneOf(&rows.1, 0)), all)),
            ("plane", plane::filter::intersect(&ray, &flat, ed, all)),
            ("giant triangle", Triangle::intersect_giant(&ray, &giant, ed, all)),
            ("giant sphere", Sphere::intersect_giant(&ray, &around, ed, all)),
        ];
        let [a, b, c, d, e] = meetings;
        [
            (a.0, a.1.may, a.1.sure),
            (b.0, b.1.may, b.1.sure),
            (c.0, c.1.may, c.1.sure),
            (d.0, d.1.may, d.1.sure),
            (e.0, e.1.may, e.1.sure),
        ]
    }
}

/// Any number: ordinary, next to nothing, infinite.
fn number(random: u64) -> f32 {
    let rare = [0.0, 1e-45, -1e-39, f32::INFINITY, -f32::MAX, 1e20];
    match (random % 5, random >> 8) {
        (0, pick) => rare[(pick % 6) as usize],
        (_, part) => (part & 0xff_ffff) as f32 / 4_194_304.0 - 2.0,
    }
}

fn case() -> impl Strategy<Value = Case> {
    // From a seed: a strategy for every number takes more than a thread's stack.
    (any::<u64>(), 0usize..10, 0usize..LANES).prop_map(|(mut seed, which, lane)| {
        let mut next = || {
            seed = mix(seed, 1);
            number(seed)
        };
        let mut rays = [[0.0; LANES]; 9];
        rays.iter_mut().flatten().for_each(|x| *x = next());
        let mut object = [0.0; triangle::filter::NUMBERS];
        object.fill_with(next);
        // The first four numbers are ones that every kind of object has.
        let spoilt = match which {
            // Where a direction leads, and where it begins.
            0..6 => {
                rays[which][lane] = f32::NAN;
                1 << lane
            }
            _ => {
                object[which - 6] = f32::NAN;
                Mask::MAX
            }
        };
        Case { rays, object, spoilt }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]
    #[test]
    fn what_is_no_number_rejects_nothing_and_is_sure_of_nothing(case in case()) {
        for level in Level::all() {
            for (what, may, sure) in dispatch(level, &case) {
                prop_assert_eq!(may & case.spoilt, case.spoilt, "{:?} rejects a {}", level, what);
                prop_assert_eq!(sure & case.spoilt, 0, "{:?} is sure of a {}", level, what);
            }
        }
    }
}

/// Rays from places on a sphere's inner side to others, sixteen each of so many numbers.
struct Chords {
    rays: [[f32; LANES]; 8],
    sphere: [f32; sphere::filter::NUMBERS],
}

impl Kernel for &Chords {
    type Output = (Mask, [[f32; LANES]; 2]);
    #[inline(always)]
    fn run<S: Simd>(self) -> Self::Output {
        let [x, y, z, u, v, w, near, per] = self.rays;
        let packet = Packet { o: [x, y, z], d: [u, v, w], near, per, ..Packet::default() };
        let ray = Rays::<S>::new(&packet).ray;
        let rows = self.sphere.map(|x| [x; MOST]);
        let sphere = Sphere::load(&OneOf(&rows, 0));
        let m = Sphere::intersect(&ray, &sphere, Mask::MAX);
        let m = Sphere::from_inside(&ray, &sphere, Mask::MAX, m);
        let mut ends = [[0.0; LANES]; 2];
        m.lo.store(&mut ends[0]);
        m.hi.store(&mut ends[1]);
        (m.sure & m.may & m.inside, ends)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]
    #[test]
    fn from_inside_the_other_root_lies_where_f32_says(mut seed in any::<u64>(), size in -9i32..0, off in -9i32..3) {
        let mut next = || {
            seed = mix(seed, 1);
            (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let r = libm::exp2(f64::from(size)) * (1.5 + 0.5 * next());
        let c = DVec3::new(next(), next(), next()) * libm::exp2(f64::from(off));
        let mut chords = Chords { rays: [[0.0; LANES]; 8], sphere: [0.0; sphere::filter::NUMBERS] };
        chords.sphere = sphere::filter::row(&LocalSphere { c: V3::splat(c), r }, 0.0);
        let mut real = [0.0; LANES];
        for lane in 0..LANES {
            let mut place = || c + DVec3::new(next(), next(), next()).normalize() * r;
            let (from, to) = (place(), place());
            // Some chords are short, and directions have any length.
            let long = libm::exp2(20.0 * next());
            let d = (to - from) * long;
            real[lane] = 1.0 / long;
            let (o, d, far) = (from.as_vec3().to_array(), d.as_vec3().to_array(), from.length() as f32);
            for k in 0..3 {
                (chords.rays[k][lane], chords.rays[3 + k][lane]) = (o[k], d[k]);
            }
            // As a wave fills packets, of rays that are exact but for their rounding here.
            let turn = 10.0 * U32 + 1e-15 / (to - from).length() as f32;
            chords.rays[6][lane] = (1e-15 + far * (turn + 2.0 * U32)) * 1.000_001;
            chords.rays[7][lane] = turn * 1.000_001;
        }
        for level in Level::all() {
            let (sure, [lo, hi]) = dispatch(level, &chords);
            prop_assert_eq!(sure, Mask::MAX, "{:?}", level);
            for lane in 0..LANES {
                let t = real[lane];
                prop_assert!(
                    f64::from(lo[lane]) <= t && t <= f64::from(hi[lane]),
                    "{:?}: {} is not in {} to {}", level, t, lo[lane], hi[lane]
                );
            }
        }
    }
}
