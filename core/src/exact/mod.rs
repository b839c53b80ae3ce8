//! Decisions in wide arithmetic, along the whole path from the camera.
//!
//! The fast tests know their error and pass on what they cannot tell apart: an edge met to
//! within rounding, two surfaces at nearly one distance, a start that may lie on another
//! surface. Here the path is followed again in world coordinates exactly as the scene gives
//! them, and the question is answered among the few objects it concerns.
//!
//! **Certainty.** Numbers have 256 bits first, then 1536. Beside its numbers a ray carries bounds of
//! how far they may be from the real ones, and every decision a bound of its own: what exceeds its
//! bound has the sign it shows. What does not is [`Unsure`]: it may be an exact event (a tangent, a
//! shared edge, equal distances), whose outcome the image model defines, and that is what
//! `exact::proof` finds out. What no width can tell, because the path behind it has used the digits
//! up, is decided by the numbers as they are, the same everywhere, and counted
//! (`RayCounts::unresolved`).
//!
//! **Bounds.** `lateral` bounds how far the ray's line passes from the real one at the start,
//! `place` how far the start itself is from the real one, `turn` the direction's relative error. A
//! flat mirror is an isometry and leaves `lateral` and `turn` as they are, however many follow one
//! another; a sphere met at distance h from the middle of its chord turns the ray by up to
//! 4·place/r. Each operation on numbers adds its rounding, a share of its terms.

mod proof;
mod query;

use std::cmp::Ordering;

use crate::numeric::{Big, Bound, Unsure};
use crate::shapes::exact::{Distance, ExactRay, intersect};
use crate::shapes::{Decision, ObjectId, surface_and_order};
use crate::traverse::PreparedScene;
pub(crate) use proof::{CameraPath, Point, Proof, closest_hit};
pub use query::RayHit;

/// The nearest of `candidates` along `ray`; equal distances go to the first in the document.
pub(crate) fn closest<const N: usize>(
    prepared: &PreparedScene,
    ray: &ExactRay<N>,
    candidates: impl Iterator<Item = ObjectId>,
) -> Result<Option<(Decision, Distance<N>)>, Unsure> {
    let mut best: Option<(Decision, Distance<N>, u32)> = None;
    for id in candidates {
        let Some((t, inside)) = intersect(&prepared.scene, &prepared.local, ray, id)? else { continue };
        let order = surface_and_order(&prepared.scene, id).1;
        let nearer = match &best {
            None => true,
            // No width tells equal distances behind curved mirrors; that they are equal is known of one plane.
            Some((b, _, bo)) if prepared.are_coplanar(b.id, id) => order < *bo,
            Some((_, bt, bo)) => match t.compare(bt)? {
                Ordering::Less => true,
                Ordering::Equal => order < *bo,
                Ordering::Greater => false,
            },
        };
        if nearer {
            best = Some((Decision { id, inside }, t, order));
        }
    }
    Ok(best.map(|(d, t, _)| (d, t)))
}

/// Whether one of `candidates` meets the open segment from `ray.o` to `ray.o + ray.d`.
pub(crate) fn occluded<const N: usize>(
    prepared: &PreparedScene,
    ray: &ExactRay<N>,
    candidates: impl Iterator<Item = ObjectId>,
) -> Result<bool, Unsure> {
    let one = Distance { t: Big::new(1.0), error: Bound::ZERO };
    for id in candidates {
        if let Some((t, _)) = intersect(&prepared.scene, &prepared.local, ray, id)?
            && t.compare(&one)? == Ordering::Less
        {
            return Ok(true);
        }
    }
    Ok(false)
}
