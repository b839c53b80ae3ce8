//! Which objects of a scene are far larger than what is seen of them: see [`super::sphere::giant`]. They are described
//! around the eye, found in wide numbers, and rounded once.

use std::sync::{Mutex, PoisonError};

use glam::DVec3;

use super::interaction::lanes;
use super::{Aabb, Listed, Local};
use crate::bvh::KINDS;
use crate::numeric::{Big, V3, Vector};
use crate::scene::Scene;
use crate::simd::Simd;

/// A giant is so many times farther across than it is from the eye.
const RATIO: f64 = 512.0;
/// It is at least this large in local space, where the largest things are of about 1/4: a planet beside its sun is.
const LEAST: f64 = 1.0 / (1u64 << 40) as f64;
/// So many of each kind are kept at most, for every packet meets them all.
const MOST: usize = 32;
/// Limbs in which they are found.
pub(super) const WIDE: usize = 24;
/// What is this many bits below its terms may be nothing.
pub(super) const LOST: i64 = 1000;

/// A shape that may be far larger than what is seen of it. (What never is may say so by `Infallible`.)
pub(crate) trait MayBeGiant: Listed {
    /// The object around the eye.
    type Giant;

    /// The object as it is around `eye`, in local space of this power; `None` where it is not a giant that f64 holds.
    fn giant(&self, eye: DVec3, power: i32) -> Option<Self::Giant>;
}

/// Giants of one shape, with their places among all objects of that shape, by rising ones.
pub(super) type List<G> = Vec<(u32, G)>;

/// The object at this place, if it is a giant.
pub(super) fn find<G>(list: &[(u32, G)], place: usize) -> Option<&G> {
    let at = list.binary_search_by_key(&place, |(place, _)| *place as usize).ok()?;
    Some(&list[at].1)
}

/// `N` numbers of each of the objects at `places`, in lanes, if one of them is a giant; of what is none, nothing is
/// known.
#[inline(always)]
pub(super) fn eight<S: Simd, G, const N: usize>(
    list: &[(u32, G)],
    places: &[usize; 8],
    numbers: fn(&G) -> [f64; N],
) -> Option<[S::F64x8; N]> {
    if list.is_empty() || places.iter().all(|place| find(list, *place).is_none()) {
        return None;
    }
    Some(lanes::<S, N>(places, |place| find(list, place).map_or([f64::NAN; N], numbers)))
}

/// Objects that may be giants, by the boxes of all.
#[derive(Debug, Default)]
pub(crate) struct Candidates(Mutex<Vec<(f64, u32)>>);

impl Candidates {
    /// Looks at the box of object `id`.
    pub(crate) fn see(&self, id: u32, b: &Aabb) {
        let across = (b.hi - b.lo).max_element();
        if across < LEAST {
            return;
        }
        // How far the eye is outside the box.
        let away = b.lo.max(-b.hi).max_element().max(0.0);
        if across > RATIO * away {
            let mut found = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            found.push((across / away, id));
        }
    }

    /// The largest beside their distance; ids make the order one.
    pub(super) fn likeliest(self) -> Vec<(f64, u32)> {
        let mut candidates = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        candidates.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        candidates.truncate(4 * MOST);
        candidates
    }
}

/// The giants of one shape among `candidates` whose ids are among `kept`.
pub(super) fn of<O: MayBeGiant>(
    scene: &Scene,
    local: &Local,
    candidates: &[(f64, u32)],
    kept: &[Vec<u32>; KINDS],
) -> List<O::Giant> {
    let (objects, first, eye) = (O::all(scene), O::first(scene), scene.camera().location());
    let mut giants = Vec::new();
    for (_, id) in candidates {
        let place = id.wrapping_sub(first);
        if let Some(object) = objects.get(place as usize)
            && giants.len() < MOST
            && kept[usize::from(O::LEAF)].contains(id)
        {
            giants.extend(object.giant(eye, local.power).map(|giant| (place, giant)));
        }
    }
    giants.sort_unstable_by_key(|(place, _)| *place);
    giants
}

/// `x` to the nearest f64, `None` where its digits may be lost beside `terms` or it is beyond f64's normal numbers.
pub(super) fn known(x: &Big<WIDE>, terms: i64) -> Option<f64> {
    if x.is_zero() || x.exponent() < terms - LOST {
        return None;
    }
    let rounded = x.to_f64();
    (rounded.is_finite() && rounded.abs() > 1e-200).then_some(rounded)
}

/// The components of `v`, of which those next to nothing become 0.
pub(super) fn vector(v: &Vector<WIDE>) -> V3<f64> {
    let all = v.to_f64();
    let least = 1e-250 * all.abs().max_element();
    V3::splat(DVec3::from_array(all.to_array().map(|x| if x.abs() < least { 0.0 } else { x })))
}
