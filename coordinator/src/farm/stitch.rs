//! Tiles into the picture, on a thread of its own.

use std::fs::File;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use tessera_core::film::Region;
use tessera_proto::{PixelFormat, Pixels};
use tokio::sync::{mpsc, oneshot};
use tracing::Span;

use super::passes::Again;
use crate::error::RenderError;
use crate::film::{Canvas, Film, Scratch, TileNote, View};
use crate::journal;

/// Tiles that wait to be stitched, at most: all that the picture takes beside itself.
const WAITING: usize = 4;

/// What becomes of the picture.
#[derive(Debug)]
pub(super) enum Stitch {
    /// That came; `first` where the picture had nothing in this place before. `span` ends when it is in the picture.
    New { region: Region, pixels: Bytes, first: bool, note: Option<TileNote>, span: Span },
    /// Of an earlier run, all at once: nobody waits until they are read.
    Again(Vec<Again>),
    /// These pixels are not what they should be: as if they had never come.
    Take(Region),
}

/// What has been stitched.
#[derive(Debug)]
pub(super) struct Stitched {
    pub(super) image: Film,
    pub(super) done: Vec<Region>,
}

/// The picture to come.
pub(super) type Stitcher = oneshot::Receiver<Result<Stitched, RenderError>>;

/// The picture in the making.
struct Picture {
    whole: Region,
    view: Arc<Mutex<View>>,
    done: Vec<Region>,
    /// What was taken back, and was not put again.
    taken: Vec<Region>,
}

impl Picture {
    fn put(&mut self, region: Region, pixels: &[u8], first: bool) -> Result<(), RenderError> {
        self.paint(&region, pixels, first && self.taken.is_empty())?;
        let back = cut_out(&mut self.taken, &region);
        if first {
            self.done.push(region);
        } else {
            self.done.extend(back);
        }
        Ok(())
    }

    fn take(&mut self, region: Region) -> Result<(), RenderError> {
        self.paint(&region, &vec![0; self.row_bytes(&region) * region.height() as usize], false)?;
        self.taken.extend(cut_out(&mut self.done, &region));
        Ok(())
    }

    fn view(&self) -> MutexGuard<'_, View> {
        self.view.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// `first`: there is nothing in its place.
    fn paint(&mut self, region: &Region, pixels: &[u8], first: bool) -> Result<(), RenderError> {
        let row_bytes = self.row_bytes(region);
        let mut view = self.view.lock().unwrap_or_else(PoisonError::into_inner);
        for (y, row) in (region.y0..region.y1).zip(pixels.chunks_exact(row_bytes)) {
            let at =
                u64::from(y - self.whole.y0) * u64::from(self.whole.width()) + u64::from(region.x0 - self.whole.x0);
            view.image.put(at, row, first)?;
        }
        Ok(())
    }

    fn row_bytes(&self, region: &Region) -> usize {
        region.width() as usize * self.view().image.format().bytes_per_pixel()
    }
}

/// Starts a stitcher of `whole`, on a thread of its own whatever else may occupy the runtime's. What an earlier run
/// did is read from `journal`. It ends, and gives the picture, when the sender is dropped; at once where there is no
/// memory for it, or where the journal cannot be read.
///
/// # Errors
/// When there is no thread to be had.
pub(super) fn start(
    whole: Region,
    (format, scratch): (PixelFormat, Scratch),
    journal: Option<File>,
    canvas: Canvas,
) -> io::Result<(mpsc::Sender<Stitch>, Stitcher)> {
    let (sender, mut tiles) = mpsc::channel::<Stitch>(WAITING);
    let (give, given) = oneshot::channel();
    let mut stitch = move || {
        let image = Film::black(format, whole.area(), &scratch)?;
        let view = Arc::new(Mutex::new(View::new(whole, image)));
        canvas.open(&view);
        let mut picture = Picture { whole, view, done: Vec::new(), taken: Vec::new() };
        while let Some(tiles) = tiles.blocking_recv() {
            match tiles {
                Stitch::New { region, pixels, first, note, span } => {
                    picture.put(region, &pixels, first)?;
                    drop(span);
                    if let Some(note) = note {
                        picture.view().note(note);
                    }
                }
                Stitch::Take(region) => picture.take(region)?,
                Stitch::Again(tiles) => {
                    let file = journal.as_ref().ok_or_else(|| RenderError::Internal("no journal".into()))?;
                    for Again { region, place, first } in tiles {
                        let pixels = journal::pixels(file, place).map_err(RenderError::Journal)?;
                        picture.put(region, &pixels, first)?;
                    }
                }
            }
        }
        canvas.close();
        // Whoever looks at it still sees nothing of it.
        let image = std::mem::replace(&mut picture.view().image, Film::Memory(Pixels::Rgb8(Vec::new())));
        Ok(Stitched { image, done: picture.done })
    };
    // Nobody may be left to take it.
    let run = move || drop(give.send(stitch()));
    std::thread::Builder::new().name("stitch".into()).spawn(run)?;
    Ok((sender, given))
}

/// Cuts `hole` out of disjoint `regions`, and gives what was cut out.
fn cut_out(regions: &mut Vec<Region>, hole: &Region) -> Vec<Region> {
    let mut cut = Vec::new();
    if regions.is_empty() {
        return cut;
    }
    let mut rest = Vec::with_capacity(regions.len());
    for r in regions.drain(..) {
        let (x0, x1) = (r.x0.max(hole.x0), r.x1.min(hole.x1));
        let (y0, y1) = (r.y0.max(hole.y0), r.y1.min(hole.y1));
        let Some(common) = Region::new(x0, y0, x1, y1) else {
            rest.push(r);
            continue;
        };
        cut.push(common);
        // Above and below it over the whole width, then left and right of it.
        rest.extend(Region::new(r.x0, r.y0, r.x1, y0));
        rest.extend(Region::new(r.x0, y1, r.x1, r.y1));
        rest.extend(Region::new(r.x0, y0, x0, y1));
        rest.extend(Region::new(x1, y0, r.x1, y1));
    }
    *regions = rest;
    cut
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(x0: u32, y0: u32, x1: u32, y1: u32) -> Region {
        Region { x0, y0, x1, y1 }
    }

    #[tokio::test]
    async fn what_is_taken_back_is_not_done_until_it_is_put_again() {
        let whole = region(10, 10, 14, 12);
        let (tiles, stitcher) = start(whole, (PixelFormat::Rgb8, Scratch::default()), None, Canvas::default()).unwrap();
        let put = |region: Region, first| Stitch::New {
            region,
            pixels: vec![9; 3 * region.area() as usize].into(),
            first,
            note: None,
            span: Span::none(),
        };
        for stitch in [
            put(region(10, 10, 12, 12), true),
            put(region(12, 10, 14, 12), true),
            Stitch::Take(region(11, 10, 13, 12)),
            put(region(11, 10, 12, 12), false),
        ] {
            tiles.send(stitch).await.unwrap();
        }
        drop(tiles);
        let Stitched { image, done } = stitcher.await.unwrap().unwrap();
        assert_eq!(done.iter().map(Region::area).sum::<u64>(), 6);
        let Some(Pixels::Rgb8(pixels)) = image.into_pixels() else { panic!("not bytes") };
        let lit: Vec<bool> = pixels.iter().map(|p| p[0] == 9).collect();
        assert_eq!(lit, [true, true, false, true, true, true, false, true]);
    }
}
