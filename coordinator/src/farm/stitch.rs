//! Tiles into the picture, on a thread of its own.

use std::fs::File;
use std::io;

use bytes::Bytes;
use tessera_core::film::Region;
use tessera_proto::{PixelFormat, Pixels};
use tokio::sync::{mpsc, oneshot};

use super::passes::Again;
use crate::job::RenderError;
use crate::journal;

/// Tiles that wait to be stitched, at most: all that the picture takes beside itself.
const WAITING: usize = 4;

/// A tile on its way into the picture.
#[derive(Debug)]
pub(super) enum Stitch {
    /// That came; `first` where the picture had nothing in this place before.
    New { region: Region, pixels: Bytes, first: bool },
    /// Of an earlier run, all at once: nobody waits until they are read.
    Again(Vec<Again>),
}

/// What has been stitched.
#[derive(Debug)]
pub(super) struct Stitched {
    pub(super) image: Pixels,
    pub(super) done: Vec<Region>,
}

/// The picture to come.
type Given = oneshot::Receiver<Result<Stitched, RenderError>>;

impl Stitched {
    fn put(&mut self, whole: &Region, region: Region, pixels: &[u8], first: bool) {
        let row_bytes = region.width() as usize * self.image.format().bytes_per_pixel();
        for (y, row) in (region.y0..region.y1).zip(pixels.chunks_exact(row_bytes)) {
            let at = u64::from(y - whole.y0) * u64::from(whole.width()) + u64::from(region.x0 - whole.x0);
            self.image.put(at as usize, row);
        }
        if first {
            self.done.push(region);
        }
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
    format: PixelFormat,
    journal: Option<File>,
) -> io::Result<(mpsc::Sender<Stitch>, Given)> {
    let (sender, mut tiles) = mpsc::channel::<Stitch>(WAITING);
    let (give, given) = oneshot::channel();
    let mut stitch = move || {
        let memory = || RenderError::Memory(whole.area());
        let count = usize::try_from(whole.area()).map_err(|_| memory())?;
        let image = Pixels::black(format, count).ok_or_else(memory)?;
        let mut stitched = Stitched { image, done: Vec::new() };
        while let Some(tiles) = tiles.blocking_recv() {
            match tiles {
                Stitch::New { region, pixels, first } => stitched.put(&whole, region, &pixels, first),
                Stitch::Again(tiles) => {
                    let file = journal.as_ref().ok_or_else(|| RenderError::Internal("no journal".into()))?;
                    for Again { region, place, first } in tiles {
                        let pixels = journal::pixels(file, place).map_err(RenderError::Journal)?;
                        stitched.put(&whole, region, &pixels, first);
                    }
                }
            }
        }
        Ok(stitched)
    };
    // Nobody may be left to take it.
    let run = move || drop(give.send(stitch()));
    std::thread::Builder::new().name("stitch".into()).spawn(run)?;
    Ok((sender, given))
}
