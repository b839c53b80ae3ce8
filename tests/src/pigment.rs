//! Colours as the image model has them, from the numbers a scene holds.

use tessera_core::scene::{Pigment, Rgb, Scene, Texture};
use tessera_core::settings::Transfer;

/// How a coordinate outside the picture is brought inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edge {
    /// The picture repeats.
    Wrap,
    /// The border's colour goes on.
    Clamp,
}

/// A component as linear light.
#[must_use]
pub fn linear(component: f64, transfer: Transfer) -> f64 {
    match transfer {
        Transfer::Linear => component,
        Transfer::Srgb if component <= 0.04045 => component / 12.92,
        Transfer::Srgb => libm::pow((component + 0.055) / 1.055, 2.4),
    }
}

/// A colour as linear light.
#[must_use]
pub fn linear_rgb(color: Rgb, transfer: Transfer) -> Rgb {
    color.map(|c| linear(c, transfer))
}

/// The picture's colour at (u, v), u to the right, v upward, bilinear between texel centres.
#[must_use]
pub fn bilinear(picture: &Texture, [u, v]: [f64; 2], edges: [Edge; 2], transfer: Transfer) -> Rgb {
    let (w, h) = (i64::from(picture.width()), i64::from(picture.height()));
    let (x, y) = (u * w as f64 - 0.5, (1.0 - v) * h as f64 - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let texel = |i: f64, j: f64| -> Rgb {
        let bring = |k: f64, n: i64, edge: Edge| match edge {
            Edge::Wrap => (k as i64).rem_euclid(n),
            Edge::Clamp => (k as i64).clamp(0, n - 1),
        };
        let at = 3 * (bring(j, h, edges[1]) * w + bring(i, w, edges[0])) as usize;
        [0, 1, 2].map(|c| linear(f64::from(picture.sample(at + c)) / f64::from(picture.maxval()), transfer))
    };
    let [a, b, c, d] = [texel(x0, y0), texel(x0 + 1.0, y0), texel(x0, y0 + 1.0), texel(x0 + 1.0, y0 + 1.0)];
    [0, 1, 2].map(|k| (a[k] * (1.0 - fx) + b[k] * fx) * (1.0 - fy) + (c[k] * (1.0 - fx) + d[k] * fx) * fy)
}

/// The pigment's linear colour, given a way to find (u, v) and the picture's edges.
pub fn color(scene: &Scene, pigment: &Pigment, transfer: Transfer, uv: impl FnOnce() -> ([f64; 2], [Edge; 2])) -> Rgb {
    match pigment {
        Pigment::Color(c) => linear_rgb(*c, transfer),
        Pigment::Texture(id) => {
            let (uv, edges) = uv();
            bilinear(&scene.textures()[id.0 as usize], uv, edges, transfer)
        }
    }
}
