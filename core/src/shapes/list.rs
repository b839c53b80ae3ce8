//! The list of shapes, and all that has a part for each of them: what is here, a new shape need not write.

use super::filter::Column;
use super::giants::{self, Candidates, List, MayBeGiant};
use super::{Local, ObjectId};
use crate::bvh::{Bvh, KINDS};
use crate::scene::{self, Scene};

/// Makes of the list of shapes what has a part for each of them:
///
/// - [`Kind`] and [`kind`], the numbering: objects have ids in the order of the list;
/// - [`Giants`] and [`Columns`], with a field for each shape that leaves hold;
/// - macros that write an expression for each shape. (What a closure or a table of functions does is not surely
///   compiled for the instructions of a level, see `simd`.)
///
/// A shape is its type in `scene` and what a scene calls all objects of it. Those that leaves hold are the last of the
/// list; of them, the folder here is named as well. `$d` is a `$`, for the names of the macros that are made.
macro_rules! shapes {
    ($d:tt [$($Shape:ident $objects:ident),*] in leaves: [$($Bounded:ident $bounded:ident $folder:ident),*]) => {
        /// Which shape an object has: its place in the list.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum Kind {
            $($Shape),*
        }

        const ALL: [Kind; SHAPES] = [$(Kind::$Shape),*];
        /// How many shapes there are.
        pub(crate) const SHAPES: usize = [$(Kind::$Shape),*].len();
        const _: () = assert!([$(Kind::$Bounded),*].len() == KINDS, "bvh::KINDS is how many shapes leaves hold");

        $(impl Listed for scene::$Shape {
            const KIND: Kind = Kind::$Shape;
            fn all(scene: &Scene) -> &[Self] {
                scene.$objects()
            }
        })*

        /// `of_shape!(scene, id, O, i => e)`: `e` where O is the shape of object `id`, the `i`-th of that.
        macro_rules! of_shape {
            ($d scene:expr, $d id:expr, $d O:ident, $d i:pat => $d e:expr) => {
                match $crate::shapes::kind($d scene, $d id) {
                    $(($crate::shapes::Kind::$Shape, i) => {
                        type $d O = $crate::scene::$Shape;
                        let $d i = i;
                        $d e
                    })*
                }
            };
        }

        /// `each_shape!(O => e)`: an array of `e` for each shape O.
        macro_rules! each_shape {
            ($d O:ident => $d e:expr) => {
                [$({
                    type $d O = $crate::scene::$Shape;
                    $d e
                }),*]
            };
        }

        /// `column!(of, kind, O, column => e)`: `e` for the field of [`Columns`] or [`Giants`] of the shape O that leaves
        /// of this kind hold; without a kind, for each field.
        macro_rules! column {
            ($d of:expr, $d kind:expr, $d O:ident, $d column:ident => $d e:expr) => {
                match $d kind {
                    $(<$crate::scene::$Bounded as $crate::shapes::Listed>::LEAF => {
                        #[allow(dead_code, reason = "not every expression names it")]
                        type $d O = $crate::scene::$Bounded;
                        let $d column = &$d of.$bounded;
                        $d e
                    })*
                    _ => unreachable!("leaves are of a kind that shapes have"),
                }
            };
            ($d of:expr, $d O:ident, $d column:ident => $d e:expr) => {
                $({
                    #[allow(dead_code, reason = "as above")]
                    type $d O = $crate::scene::$Bounded;
                    let $d column = &$d of.$bounded;
                    $d e;
                })*
            };
        }

        /// The giants of a scene.
        #[derive(Debug, Default)]
        pub(crate) struct Giants {
            $(pub(crate) $bounded: List<<scene::$Bounded as MayBeGiant>::Giant>),*
        }

        impl Giants {
            /// The giants among `candidates` whose ids are among `kept`.
            pub(crate) fn new(scene: &Scene, local: &Local, candidates: Candidates, kept: &[Vec<u32>; KINDS]) -> Self {
                let candidates = candidates.likeliest();
                Self { $($bounded: giants::of::<scene::$Bounded>(scene, local, &candidates, kept)),* }
            }
        }

        /// What leaves hold, and the giants, before rays in f32.
        #[derive(Debug)]
        pub(crate) struct Columns {
            $(pub(crate) $bounded: Column<scene::$Bounded, { super::$folder::filter::NUMBERS }>),*
        }

        impl Columns {
            pub(crate) fn new(scene: &Scene, local: &Local, bvh: &Bvh<f32>) -> Self {
                Self { $($bounded: Column::new(scene, local, bvh, &local.giants.$bounded)),* }
            }
        }

        pub(crate) use {column, each_shape, of_shape};
    };
}

shapes! { $
    [Plane planes, Sphere spheres, Triangle triangles]
    in leaves: [Triangle triangles triangle, Sphere spheres sphere]
}

/// A shape of the list.
pub(crate) trait Listed: Sized + Sync + 'static {
    const KIND: Kind;

    /// The kind of leaves that hold it: counted from the end of the list, as leaves are by falling ids.
    const LEAF: u8 = (SHAPES - 1 - Self::KIND as usize) as u8;

    /// All objects of this shape.
    fn all(scene: &Scene) -> &[Self];

    /// The id of the first of them.
    #[inline(always)]
    fn first(scene: &Scene) -> u32 {
        firsts(scene)[Self::KIND as usize]
    }
}

/// The id of the first object of each shape; those of earlier shapes are less.
#[inline(always)]
pub(crate) fn firsts(scene: &Scene) -> [u32; SHAPES] {
    let counts = each_shape!(O => O::all(scene).len() as u32);
    let mut firsts = [0; SHAPES];
    for k in 1..SHAPES {
        firsts[k] = firsts[k - 1] + counts[k - 1];
    }
    firsts
}

/// Of which shape object `id` is, and its index there.
#[inline]
pub(crate) fn kind(scene: &Scene, ObjectId(id): ObjectId) -> (Kind, usize) {
    let firsts = firsts(scene);
    let mut shape = SHAPES - 1;
    while firsts[shape] > id {
        shape -= 1;
    }
    (ALL[shape], (id - firsts[shape]) as usize)
}

/// Where kinds of leaves end, see [`Builder`](crate::bvh::Builder).
pub(crate) fn leaf_ends(scene: &Scene) -> [u32; KINDS - 1] {
    let firsts = firsts(scene);
    std::array::from_fn(|leaf| firsts[SHAPES - 1 - leaf])
}
