//! What a picture should be, by brute force, and how sure that is.

use std::sync::Arc;

use tessera_core::film::Region;
use tessera_core::settings::{Sampling, Settings, View};
use tessera_core::trace::{PreparedScene, Tracer};

/// Linear pixels, rows from the top.
pub type Pixels = Vec<[f32; 3]>;

/// A picture taken as right.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Its pixels.
    pub pixels: Pixels,
    /// Its own root mean squared error, as a fraction of full scale.
    pub own: f64,
}

/// The picture of `scene` under `settings` by at least `samples` points a pixel.
///
/// Two pictures of twice and three times the size, each by scrambled points, and each pixel the mean of those that it
/// covers: no pixel of theirs has a number, nor points, of one that is judged. What is between the two tells how far
/// their mean is off.
///
/// # Panics
/// When the settings are out of range.
#[must_use]
pub fn truth(scene: &Arc<PreparedScene>, settings: &Settings, samples: u32) -> Truth {
    let each = samples.div_ceil(2);
    let (a, b) = (finer(scene, settings, 2, each.div_ceil(4)), finer(scene, settings, 3, each.div_ceil(9)));
    let pixels = a.iter().zip(&b).map(|(a, b)| [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]))).collect();
    Truth { pixels, own: 0.5 * rmse(&a, &b) }
}

/// By so many points in each of `times` × `times` pixels that make up one.
fn finer(scene: &Arc<PreparedScene>, settings: &Settings, times: u32, samples: u32) -> Pixels {
    let (w, h) = (settings.view.width(), settings.view.height());
    let view = View::new(times * w, times * h, settings.view.zoom(), settings.view.plane_height());
    let settings = Settings {
        view: view.unwrap_or_else(|e| panic!("{e}")),
        sampling: Sampling::Scrambled { samples },
        ..*settings
    };
    let tracer = Tracer::new(Arc::clone(scene), settings).unwrap_or_else(|e| panic!("{e}"));
    let fine = tracer.render(whole(&settings)).0.pixels;
    let share = 1.0 / f64::from(times * times);
    let mut pixels = Vec::with_capacity((w * h) as usize);
    for y in 0..h {
        for x in 0..w {
            let mut sum = [0.0; 3];
            for at in (0..times * times).map(|k| (times * y + k / times) * times * w + times * x + k % times) {
                (0..3).for_each(|k| sum[k] += f64::from(fine[at as usize][k]));
            }
            pixels.push(sum.map(|s| (s * share) as f32));
        }
    }
    pixels
}

/// All pixels of a picture.
#[must_use]
pub fn whole(settings: &Settings) -> Region {
    Region { x0: 0, y0: 0, x1: settings.view.width(), y1: settings.view.height() }
}

/// Root mean squared difference of all components.
#[must_use]
pub fn rmse(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let square = |(x, y): (&f32, &f32)| (f64::from(*x) - f64::from(*y)).powi(2);
    let (a, b) = (a.as_flattened(), b.as_flattened());
    (a.iter().zip(b).map(square).sum::<f64>() / a.len() as f64).sqrt()
}
