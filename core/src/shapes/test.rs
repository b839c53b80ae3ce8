//! Where a ray may meet an object, by tests that know their own error, and where it meets what it is known to meet.

use super::beam::Figure;
use super::coplanar::FlatObject;
use super::{Decision, Listed, Local, ObjectId, Ray, Span, SurfaceInteraction, of_shape};
use crate::numeric::{DoubleDouble, Real, Scalar};
use crate::scene::{Order, Scene, SurfaceId};
use crate::simd::Simd;

/// What all shapes are to rays over any [`Real`]; the files of other facets have a trait for each.
pub(crate) trait Shape: Listed {
    /// Whether a ray that starts on it may meet it again, from inside.
    const HAS_INSIDE: bool;

    /// An object in local space, also as it is around the eye if it is a giant.
    type Local<R: Real>;

    /// Its surface and place in the document.
    fn surface_and_order(&self) -> (SurfaceId, Order);

    /// The object, which is the `i`-th of its shape, in local space.
    fn local(&self, i: usize, local: &Local) -> Self::Local<f64>;

    /// The same to twice the digits, where differences do not overflow.
    fn double(&self, i: usize, local: &Local) -> Self::Local<DoubleDouble>;

    /// The objects at `places` among those of this shape, one in each lane.
    fn eight<S: Simd>(scene: &Scene, local: &Local, places: &[usize; 8]) -> Self::Local<S::F64x8>;

    /// Where `ray`, which starts on the object as `own` says, if it does, may meet it. Of what has no inside, only rays
    /// that start elsewhere are asked about.
    fn test<R: Scalar>(ray: &Ray<R>, object: &Self::Local<R>, own: Option<Decision>) -> Option<Span<R>>;

    /// Where `ray` meets the object it is known to meet: its inner side where `inner` > 0, having started on it where
    /// `own` > 0.
    fn interaction<R: Real>(ray: &Ray<R>, object: &Self::Local<R>, inner: R, own: R) -> SurfaceInteraction<R>;

    /// What it is to beams.
    #[inline(always)]
    fn figure(&self, _i: usize, _local: &Local) -> Figure {
        Figure::Unknown
    }

    /// The object, if it lies in a plane.
    fn in_plane<'a>(&'a self, _i: usize, _local: &'a Local) -> Option<FlatObject<'a>> {
        None
    }

    /// Whether a ray that starts on an object as `own` says, if it does, surely does not meet it again.
    fn is_left_by(own: Option<Decision>) -> bool {
        !Self::HAS_INSIDE && own.is_some()
    }
}

/// Where `ray`, which starts on this object as `own` says, if it does, may meet object `id`.
pub(crate) fn test(scene: &Scene, local: &Local, ray: &Ray, id: ObjectId, own: Option<Decision>) -> Option<Span> {
    of_shape!(scene, id, O, i => {
        if O::is_left_by(own) { None } else { O::test(ray, &O::all(scene)[i].local(i, local), own) }
    })
}

/// The same to twice the digits; `None` where numbers are too large for them.
pub(crate) fn test_double(
    scene: &Scene,
    local: &Local,
    ray: &Ray<DoubleDouble>,
    id: ObjectId,
    own: Option<Decision>,
) -> Option<Option<Span<DoubleDouble>>> {
    let local = local.doubles()?;
    Some(of_shape!(scene, id, O, i => {
        if O::is_left_by(own) { None } else { O::test(ray, &O::all(scene)[i].double(i, local), own) }
    }))
}

/// Where `ray`, which starts on `from`, meets the object it is known to meet, to twice the digits; `None` where numbers
/// are too large for them.
pub(crate) fn interaction_double(
    scene: &Scene,
    local: &Local,
    ray: &Ray<DoubleDouble>,
    Decision { id, inside }: Decision,
    from: Option<Decision>,
) -> Option<SurfaceInteraction<DoubleDouble>> {
    let flag = |b: bool| DoubleDouble::splat(if b { 1.0 } else { 0.0 });
    let (inner, own) = (flag(inside), flag(from.is_some_and(|f| f.id == id)));
    let local = local.doubles()?;
    Some(of_shape!(scene, id, O, i => O::interaction(ray, &O::all(scene)[i].double(i, local), inner, own)))
}
