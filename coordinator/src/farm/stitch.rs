//! Tiles into the picture, on a thread of its own.

use bytes::Bytes;
use tessera_core::film::Region;
use tessera_proto::{PixelFormat, Pixels};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

/// Tiles that wait to be stitched, at most: all that the picture takes beside itself.
const WAITING: usize = 4;

/// A tile on its way into the picture.
#[derive(Debug)]
pub(super) struct Stitch {
    pub(super) region: Region,
    pub(super) pixels: Bytes,
    /// Whether the picture had nothing in this place before.
    pub(super) first: bool,
}

/// What has been stitched.
#[derive(Debug)]
pub(super) struct Stitched {
    pub(super) image: Pixels,
    pub(super) done: Vec<Region>,
}

/// Starts a stitcher of `whole`. It ends, and gives the picture, when the sender is dropped, or
/// `None` at once where there is no memory for it.
pub(super) fn start(whole: Region, format: PixelFormat) -> (mpsc::Sender<Stitch>, JoinHandle<Option<Stitched>>) {
    let (sender, mut tiles) = mpsc::channel::<Stitch>(WAITING);
    let stitcher = tokio::task::spawn_blocking(move || {
        let mut image = Pixels::black(format, usize::try_from(whole.area()).ok()?)?;
        let mut done = Vec::new();
        while let Some(Stitch { region, pixels, first }) = tiles.blocking_recv() {
            let row_bytes = region.width() as usize * format.bytes_per_pixel();
            for (y, row) in (region.y0..region.y1).zip(pixels.chunks_exact(row_bytes)) {
                let at = u64::from(y - whole.y0) * u64::from(whole.width()) + u64::from(region.x0 - whole.x0);
                image.put(at as usize, row);
            }
            if first {
                done.push(region);
            }
        }
        Some(Stitched { image, done })
    });
    (sender, stitcher)
}
