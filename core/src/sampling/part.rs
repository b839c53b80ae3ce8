//! The parts that a pixel's value is the sum of, each with edges of its own.

use crate::trace::record::Want;

/// A summand of radiance, as a function of the image plane. Its edges are where what a path
/// meets up to the part's depth changes and, for a single light, that light's shadow edges.
/// Edges of other parts do not matter to it, so each is fitted alone; and it can be followed
/// without the rays that only others need.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Part {
    /// All that the path carries from its meeting at this depth on.
    From(u32),
    /// What one light adds at the meeting at this depth.
    Light(u32, u32),
    /// What a set of lights, seen from all around, adds there.
    Lights(u32, u32),
}

impl Part {
    /// The depth of the meeting that its edges are those of.
    pub(crate) fn depth(self) -> u32 {
        match self {
            Self::From(depth) | Self::Light(depth, _) | Self::Lights(depth, _) => depth,
        }
    }

    /// What a sample needs to tell the part's sides apart.
    pub(crate) fn side(self) -> Want {
        match self {
            Self::From(depth) | Self::Lights(depth, _) => Want::Objects(depth),
            Self::Light(depth, light) => Want::Light(depth, light),
        }
    }

    /// What a sample needs to know the part's value.
    pub(crate) fn whole(self) -> Want {
        match self {
            Self::From(depth) => Want::From(depth),
            _ => self.side(),
        }
    }

    /// Whether its edges are outlines of objects as the camera sees them.
    pub(crate) fn has_outlines(self) -> bool {
        self.depth() == 1 && !matches!(self, Self::Light(..))
    }
}
