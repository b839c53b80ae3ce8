//! Tiles into the picture, on a thread of its own.

use std::fs::File;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bytes::Bytes;
use tessera_core::film::Region;
use tessera_proto::{PixelFormat, Pixels};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc, oneshot};
use tracing::Span;

use super::passes::Again;
use crate::error::RenderError;
use crate::film::{Canvas, Film, Scratch, TileNote, View};
use crate::journal;

/// Bytes of tiles that wait to be stitched, at most: all that the picture takes beside itself. Five of the largest.
const WAITING: u32 = 4 << 20;
/// Where tiles come closer together than this, the stitcher lets some gather: to be woken for each costs more than
/// its place in the picture.
const GATHER: Duration = Duration::from_millis(1);

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

/// Where tiles go that are to be stitched.
#[derive(Clone, Debug)]
pub(super) struct Tiles {
    sender: mpsc::UnboundedSender<(Stitch, Option<OwnedSemaphorePermit>)>,
    room: Arc<Semaphore>,
}

/// Nobody stitches any more.
#[derive(Debug)]
pub(super) struct Stopped;

impl Tiles {
    /// Waits while there is no room.
    pub(super) async fn send(&self, stitch: Stitch) -> Result<(), Stopped> {
        let room = match &stitch {
            Stitch::New { pixels, .. } => {
                let bytes = u32::try_from(pixels.len()).unwrap_or(WAITING).clamp(1, WAITING);
                Some(self.room.clone().acquire_many_owned(bytes).await.map_err(|_| Stopped)?)
            }
            Stitch::Again(_) | Stitch::Take(_) => None,
        };
        self.sender.send((stitch, room)).map_err(|_| Stopped)
    }
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
    fn stitch(&mut self, stitch: Stitch, journal: Option<&File>) -> Result<(), RenderError> {
        match stitch {
            Stitch::New { region, pixels, first, note, span } => {
                self.put(region, &pixels, first)?;
                drop(span);
                if let Some(note) = note {
                    self.view().note(note);
                }
                Ok(())
            }
            Stitch::Take(region) => self.take(region),
            Stitch::Again(tiles) => {
                let file = journal.ok_or_else(|| RenderError::Internal("no journal".into()))?;
                for Again { region, place, first } in tiles {
                    let pixels = journal::pixels(file, place).map_err(RenderError::Journal)?;
                    self.put(region, &pixels, first)?;
                }
                Ok(())
            }
        }
    }

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
) -> io::Result<(Tiles, Stitcher)> {
    let (sender, mut tiles) = mpsc::unbounded_channel();
    let (give, given) = oneshot::channel();
    let mut stitch = move || {
        let image = Film::black(format, whole.area(), &scratch)?;
        let view = Arc::new(Mutex::new(View::new(whole, image)));
        canvas.open(&view);
        let mut picture = Picture { whole, view, done: Vec::new(), taken: Vec::new() };
        let mut idle_since = Instant::now();
        while let Some((next, room)) = tiles.blocking_recv() {
            if idle_since.elapsed() < GATHER {
                std::thread::sleep(GATHER);
            }
            picture.stitch(next, journal.as_ref())?;
            drop(room);
            while let Ok((next, _room)) = tiles.try_recv() {
                picture.stitch(next, journal.as_ref())?;
            }
            idle_since = Instant::now();
        }
        canvas.close();
        // Whoever looks at it still sees nothing of it.
        let image = std::mem::replace(&mut picture.view().image, Film::Memory(Pixels::Rgb8(Vec::new())));
        Ok(Stitched { image, done: picture.done })
    };
    // Nobody may be left to take it.
    let run = move || drop(give.send(stitch()));
    std::thread::Builder::new().name("stitch".into()).spawn(run)?;
    Ok((Tiles { sender, room: Arc::new(Semaphore::new(WAITING as usize)) }, given))
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
