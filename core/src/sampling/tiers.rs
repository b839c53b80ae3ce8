//! How many points of a net follow their paths how far.
//!
//! The light of a path is a sum over its meetings, and so is its mean over a pixel; each term may
//! be averaged over as many points as it needs (Heinrich, *Multilevel Monte Carlo methods*, LSSC
//! 2001). What mirrors show is weaker with every meeting and dearer: the first points of a net
//! are followed to their ends, more of them one mirror far, and most to what is looked at first.

use crate::trace::record::TIERS;

/// Variances fall with this power of the points.
const FALL: f64 = 1.5;
/// The least part of what is enough, or fixed, that variances are brought down to.
const PART: f64 = 0.1;
/// The most that a net grows by at a time, as a power of two.
const GROWTH: u32 = 3;
/// Rays of a point in a tier where the corners' paths have none, but others may.
const FEW: f64 = 0.5;
/// Powers of two that a tier stays behind the one before at most: where much is to be seen first,
/// mirrors hide much, too.
const LAG: u32 = 2;
/// How much longer a ray of each tier takes than one of the first: mirrored ones go many ways.
const DEARER: [f64; TIERS] = [1.0, 1.5, 2.0];

/// Powers of two: how many points reach each tier, ever fewer.
pub(super) type Powers = [u32; TIERS];

/// What ends the search for a pixel's value.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// The variance that is enough.
    pub(super) enough: f64,
    /// The variance that a ray must take off to be worth it; none where only what is enough counts.
    pub(super) a_ray: Option<f64>,
    /// The most points, as a power of two.
    pub(super) most: u32,
}

/// How far to go on from 2^`powers` points whose tiers' `variances` add up, to `fixed` that no point
/// takes off, and whose points cost so many rays in each; `None` where that is done.
pub(super) fn next(
    powers: Powers,
    (variances, fixed): ([f64; TIERS], f64),
    rays: [f64; TIERS],
    limits: Limits,
) -> Option<Powers> {
    let all: f64 = variances.iter().sum();
    // What is fixed may be more than enough: then the rest need not be less than a part of it.
    let enough = (limits.enough - fixed).max(PART * limits.enough.max(fixed));
    let rays: [f64; TIERS] = std::array::from_fn(|t| rays[t].max(FEW) * DEARER[t]);
    let points = powers.map(|p| f64::from(1u32 << p));
    let worth = |t: usize| limits.a_ray.is_none_or(|v| variances[t] > v * points[t] * rays[t]);
    if all <= enough || !(0..TIERS).any(|t| powers[t] < limits.most && worth(t)) {
        return None;
    }
    // Variances a·n^−1.5 at c rays a point add up to what is enough for the fewest rays where n is
    // (s·a/c)^(1/2.5); where it is 1/s what a ray takes off, each brings that.
    let a: [f64; TIERS] = std::array::from_fn(|t| variances[t] * points[t] * points[t].sqrt());
    let power = 1.0 / (FALL + 1.0);
    let scale = limits.a_ray.map_or_else(
        || {
            let sum: f64 = (0..TIERS).map(|t| libm::pow(a[t], power) * libm::pow(rays[t], 1.0 - power)).sum();
            libm::pow(sum / enough, (FALL + 1.0) / FALL)
        },
        |v| 1.0 / v,
    );
    let mut new = powers;
    for t in (0..TIERS).rev() {
        let wanted = power * libm::log2(scale * a[t] / rays[t]);
        let more = (wanted - f64::from(powers[t])).ceil().clamp(0.0, f64::from(GROWTH)) as u32;
        new[t] = (powers[t] + more).min(limits.most);
        // Who goes far comes by what is near.
        new[t] = new[t].max(new.get(t + 1).copied().unwrap_or(0));
    }
    for t in 1..TIERS {
        new[t] = new[t].max(new[t - 1].saturating_sub(LAG));
    }
    if new == powers {
        let open = (0..TIERS).filter(|&t| powers[t] < limits.most && worth(t));
        let gain = |t: &usize| variances[*t] / (points[*t] * rays[*t]);
        let best = open.max_by(|a, b| gain(a).total_cmp(&gain(b)))?;
        new[best] += 1;
        for t in (0..best).rev() {
            new[t] = new[t].max(new[t + 1]);
        }
    }
    Some(new)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits { enough: 1e-6, a_ray: None, most: 11 };

    #[test]
    fn more_points_see_what_varies_more() {
        let limits = Limits { enough: 1e-5, ..LIMITS };
        let new = next([2; TIERS], ([1e-4, 1e-5, 1e-7], 0.0), [3.0; TIERS], limits).expect("more");
        assert!(new[0] > new[1] && new[1] > new[2], "{new:?}");
    }

    #[test]
    fn who_goes_far_comes_by_what_is_near() {
        let new = next([2; TIERS], ([0.0, 0.0, 1e-3], 0.0), [3.0; TIERS], LIMITS).expect("more");
        assert_eq!(new, [5; TIERS]);
    }

    #[test]
    fn it_ends_where_nothing_is_worth_a_ray_or_all_is_enough_or_points_are_used_up() {
        assert_eq!(next([2; TIERS], ([1e-7; TIERS], 0.0), [3.0; TIERS], LIMITS), None);
        let worth = Limits { a_ray: Some(1e-3), ..LIMITS };
        assert_eq!(next([2; TIERS], ([1e-3, 1e-4, 1e-5], 0.0), [3.0; TIERS], worth), None);
        assert_eq!(next([11; TIERS], ([1.0; TIERS], 0.0), [3.0; TIERS], LIMITS), None);
    }

    #[test]
    fn what_no_point_takes_off_is_not_chased() {
        assert_eq!(next([4; TIERS], ([1e-4; TIERS], 1e-2), [3.0; TIERS], LIMITS), None);
        assert_eq!(next([4; TIERS], ([0.0; TIERS], 1e-2), [3.0; TIERS], LIMITS), None);
    }

    #[test]
    fn it_always_goes_on_until_then() {
        for a_ray in [None, Some(1e-9), Some(1e-4)] {
            let limits = Limits { a_ray, ..LIMITS };
            let (mut powers, mut rounds) = ([2; TIERS], 0);
            while let Some(new) = next(powers, ([1.0, 0.3, f64::INFINITY], 0.5), [1.0, 5.0, 0.0], limits) {
                assert!(new != powers && new.iter().zip(powers).all(|(n, p)| *n >= p));
                (powers, rounds) = (new, rounds + 1);
            }
            assert!(rounds <= 40);
        }
    }
}
