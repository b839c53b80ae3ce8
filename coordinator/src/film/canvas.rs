//! A picture in the making, for whoever looks at it meanwhile.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use tessera_core::film::Region;
use tessera_proto::Pixels;

use super::{Film, OnDisk};

/// Tiles of which is remembered who rendered them: whoever has not seen older ones looks at the picture as a whole.
const REMEMBERED: usize = 16_384;

/// Points of the curve of errors that are kept, at most.
const CURVE: usize = 512;

/// What is known of a tile beside its pixels.
#[derive(Clone, Debug)]
pub(crate) struct TileNote {
    pub(crate) region: Region,
    pub(crate) worker: Arc<str>,
    pub(crate) pass: u32,
    /// Expected error in 8-bit steps, where it was estimated.
    pub(crate) error: Option<f64>,
    /// When it came, in seconds since the render began, and the error of the picture then in 8-bit steps.
    pub(crate) so_far: Option<(f64, f64)>,
    pub(crate) rays: u64,
    pub(crate) busy_us: u64,
}

/// What of a picture is shown: pixels as they are, or as they will be encoded.
#[derive(Clone, Debug)]
pub(crate) enum Excerpt {
    Codes(Vec<[u8; 3]>),
    Linear(Vec<[f32; 3]>),
}

/// A picture that is stitched and looked at. Clones are the same.
#[derive(Clone, Debug, Default)]
pub struct Canvas(Arc<Mutex<Option<Arc<Mutex<View>>>>>);

/// The picture, and what is known of its tiles.
#[derive(Debug)]
pub(crate) struct View {
    pub(crate) whole: Region,
    pub(crate) image: Film,
    notes: VecDeque<TileNote>,
    /// Tiles that came before the first that is remembered.
    forgotten: u64,
    /// Seconds, and the error of the picture then in 8-bit steps.
    curve: Vec<(f64, f64)>,
}

impl View {
    pub(crate) fn new(whole: Region, image: Film) -> Self {
        Self { whole, image, notes: VecDeque::new(), forgotten: 0, curve: Vec::new() }
    }

    pub(crate) fn note(&mut self, note: TileNote) {
        if self.notes.len() >= REMEMBERED {
            self.notes.pop_front();
            self.forgotten += 1;
        }
        self.curve.extend(note.so_far);
        // Every second point will do where there are many.
        if self.curve.len() > CURVE {
            let mut nth = 0;
            self.curve.retain(|_| {
                nth += 1;
                nth % 2 == 1
            });
        }
        self.notes.push_back(note);
    }
}

impl Canvas {
    /// The stitcher begins.
    pub(crate) fn open(&self, view: &Arc<Mutex<View>>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(view.clone());
    }

    /// The picture is given away.
    pub(crate) fn close(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    fn view(&self) -> Option<Arc<Mutex<View>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Tiles that came so far.
    pub(crate) fn tiles(&self) -> u64 {
        let Some(view) = self.view() else { return 0 };
        let view = view.lock().unwrap_or_else(PoisonError::into_inner);
        view.forgotten + view.notes.len() as u64
    }

    /// The tiles from the one of number `since` on, `most` of them, and the number of the first that is given.
    pub(crate) fn notes(&self, since: u64, most: usize) -> (u64, Vec<TileNote>) {
        let Some(view) = self.view() else { return (since, Vec::new()) };
        let view = view.lock().unwrap_or_else(PoisonError::into_inner);
        let first = since.clamp(view.forgotten, view.forgotten + view.notes.len() as u64);
        let skip = (first - view.forgotten) as usize;
        (first, view.notes.iter().skip(skip).take(most).cloned().collect())
    }

    /// Seconds since the render began, and the error of the picture then in 8-bit steps.
    pub(crate) fn curve(&self) -> Vec<(f64, f64)> {
        self.view().map_or_else(Vec::new, |v| v.lock().unwrap_or_else(PoisonError::into_inner).curve.clone())
    }

    /// What is seen of `region` in `width` x `height` pixels of its own: the pixel in the middle of each.
    pub(crate) fn look(&self, region: &Region, width: u32, height: u32) -> Option<Excerpt> {
        let view = self.view()?;
        let view = view.lock().unwrap_or_else(PoisonError::into_inner);
        match &view.image {
            Film::Memory(pixels) => look(pixels, &view.whole, region, (width, height)),
            Film::Disk(disk) => look_up(disk, &view.whole, region, (width, height)),
        }
    }
}

/// As [`look`], of a picture that is not in memory: row by row.
fn look_up(disk: &OnDisk, whole: &Region, region: &Region, (width, height): (u32, u32)) -> Option<Excerpt> {
    if !whole.contains(region) || width == 0 || height == 0 {
        return None;
    }
    let (mut codes, mut linear) = (Vec::new(), Vec::new());
    for y in 0..height {
        let y = middle(y, height, region.y0, region.height());
        let row = Region { y0: y, y1: y + 1, ..*region };
        let at = u64::from(y - whole.y0) * u64::from(whole.width()) + u64::from(region.x0 - whole.x0);
        let pixels = disk.read(at..at + u64::from(region.width())).ok()?;
        match look(&pixels, &row, &row, (width, 1))? {
            Excerpt::Codes(row) => codes.extend(row),
            Excerpt::Linear(row) => linear.extend(row),
        }
    }
    Some(if linear.is_empty() { Excerpt::Codes(codes) } else { Excerpt::Linear(linear) })
}

/// The pixel in the middle of the `n`th of so many parts of a length.
fn middle(n: u32, of: u32, from: u32, length: u32) -> u32 {
    from + ((2 * u64::from(n) + 1) * u64::from(length) / (2 * u64::from(of))).min(u64::from(length) - 1) as u32
}

/// As [`Canvas::look`], of a picture that is there.
pub(crate) fn look(image: &Pixels, whole: &Region, region: &Region, (width, height): (u32, u32)) -> Option<Excerpt> {
    if !whole.contains(region) || width == 0 || height == 0 {
        return None;
    }
    let columns: Vec<usize> =
        (0..width).map(|x| (middle(x, width, region.x0, region.width()) - whole.x0) as usize).collect();
    let rows = (0..height).map(|y| (middle(y, height, region.y0, region.height()) - whole.y0) as usize);
    let stride = whole.width() as usize;
    let pixels = rows.flat_map(|row| columns.iter().map(move |column| row * stride + column));
    Some(match image {
        Pixels::Rgb8(p) => Excerpt::Codes(pixels.map(|at| p.get(at).copied().unwrap_or_default()).collect()),
        Pixels::Rgb16(p) => {
            let high = |c: u16| (c >> 8) as u8;
            Excerpt::Codes(pixels.map(|at| p.get(at).map_or([0; 3], |p| p.map(high))).collect())
        }
        Pixels::F32(p) => Excerpt::Linear(pixels.map(|at| p.get(at).copied().unwrap_or_default()).collect()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_seen_pixel_by_pixel_or_fewer() {
        let whole = Region { x0: 10, y0: 20, x1: 14, y1: 22 };
        let image = Pixels::Rgb8((0..8).map(|n| [n; 3]).collect());
        let seen = |region: Region, size| match look(&image, &whole, &region, size) {
            Some(Excerpt::Codes(codes)) => codes.iter().map(|c| c[0]).collect::<Vec<u8>>(),
            _ => Vec::new(),
        };
        assert_eq!(seen(whole, (4, 2)), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(seen(Region { x0: 12, y0: 21, x1: 14, y1: 22 }, (2, 1)), [6, 7]);
        assert_eq!(seen(whole, (2, 1)), [5, 7]);
        assert!(seen(Region { x0: 0, y0: 20, x1: 14, y1: 22 }, (1, 1)).is_empty());
    }
}
