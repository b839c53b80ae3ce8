//! Points of the image plane.

/// Plane units along a pixel's edge. Points lie at odd numbers of units, so that their mean is the centre.
pub(crate) const UNIT: i32 = 1 << 15;
/// The plane's grid: its unit is half a cell.
pub(crate) const GRID: u32 = UNIT as u32 / 2;

/// A point of the image plane: `x` to the right and `y` up from the picture's middle, in
/// units of 1/(2·grid) pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PlanePoint {
    /// To the right.
    pub x: i32,
    /// Up.
    pub y: i32,
}
