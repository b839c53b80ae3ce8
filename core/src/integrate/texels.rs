//! Pictures on surfaces, in linear light.

use glam::{DVec2, DVec3};

use crate::scene::Texture;

/// The largest misplacement of a picture, in texels, that f64 is trusted with.
pub(crate) const TEXEL: f64 = 1e-4;

/// A picture decoded to linear components under some transfer.
#[derive(Clone, Debug)]
pub(crate) struct Texels {
    /// Linear value of each stored sample value.
    linear: Vec<f64>,
}

impl Texels {
    pub(crate) fn new(picture: &Texture, to_linear: impl Fn(f64) -> f64) -> Self {
        let max = f64::from(picture.maxval());
        Self { linear: (0..=picture.maxval()).map(|s| to_linear(f64::from(s) / max)).collect() }
    }

    /// The bilinear value at (u, v); `wrap` says whether u and v repeat or are clamped.
    pub(crate) fn sample(&self, picture: &Texture, uv: DVec2, wrap: [bool; 2]) -> DVec3 {
        let (w, h) = (i64::from(picture.width()), i64::from(picture.height()));
        let x = uv.x * picture.width() as f64 - 0.5;
        let y = (1.0 - uv.y) * picture.height() as f64 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        // (u, v) is in [0, 1], so that no texel is farther outside than one.
        let interaction = |i: i64, n: i64, wrap: bool| match wrap {
            true if i < 0 => i + n,
            true if i >= n => i - n,
            true => i,
            false => i.clamp(0, n - 1),
        };
        let columns = [0, 1].map(|dx| interaction(x0 as i64 + dx, w, wrap[0]));
        let rows = [0, 1].map(|dy| interaction(y0 as i64 + dy, h, wrap[1]) * w);
        let texel = |i: usize, j: usize| {
            let [r, g, b] = picture.texel((rows[j] + columns[i]) as usize).map(|c| self.linear[usize::from(c)]);
            DVec3::new(r, g, b)
        };
        let top = texel(0, 0) * (1.0 - fx) + texel(1, 0) * fx;
        let bottom = texel(0, 1) * (1.0 - fx) + texel(1, 1) * fx;
        top * (1.0 - fy) + bottom * fy
    }
}
