//! Beams: what the pixels of a tile may show, all of their points at once.
//!
//! Seen from one apex, with directions that are linear in the coordinates of the image plane ([`lens::Lens`]), an
//! object's outline is made of linear functions of these coordinates, or is one quadratic, and so is the inverse of
//! its distance. Over a pixel's square these have bounds, so that it is known which pixels an object may touch and
//! which it covers ([`cover`]); the hierarchy gives the objects that a pyramid, or a shaft towards a light, may
//! meet ([`gather`]). A flat mirror, and a flat surface seen from a light, are lenses again (Heckbert and
//! Hanrahan, *Beam tracing polygonal objects*, 1984).
//!
//! Everything here errs on one side: what is said to be covered is, what is not said to be touched is not.

pub(crate) mod cover;
pub(crate) mod gather;
pub(crate) mod lens;

#[cfg(test)]
mod tests;
