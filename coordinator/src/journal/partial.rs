//! The picture that a journal holds, as far as it is.

use std::fs::File;
use std::path::Path;

use tessera_core::film::Region;
use tessera_core::settings::Transfer;
use tessera_proto::Pixels;

use super::{JournalError, recover};

/// A picture, whole or not.
#[derive(Debug)]
pub struct Partial {
    /// Where its pixels are in the view.
    pub region: Region,
    /// What its codes mean, or would.
    pub transfer: Transfer,
    /// The pixels of `region`, black where not done.
    pub image: Pixels,
    /// Which of them are done.
    pub present: Vec<bool>,
    /// Where the journal is damaged, if it is: what stood behind that is not here.
    pub damaged: Option<u64>,
}

impl Partial {
    /// Reads the picture out of the journal at `path`, which may be written meanwhile.
    ///
    /// # Errors
    /// When it cannot be read, is no journal, or holds nothing of a picture.
    pub fn read(path: &Path) -> Result<Self, JournalError> {
        let failed = |e| JournalError::Io(path.into(), e);
        let file = File::open(path).map_err(failed)?;
        if !file.metadata().map_err(failed)?.is_file() {
            return Err(JournalError::Foreign(path.into()));
        }
        let nothing = || JournalError::Unsound(path.into(), "it holds nothing yet".into());
        let recovered = recover::read(file, path)?.ok_or_else(nothing)?;
        let (region, format) = (recovered.head.region, recovered.head.pixels);
        let memory = || JournalError::Unsound(path.into(), "there is no memory for its picture".into());
        let count = usize::try_from(region.area()).map_err(|_| memory())?;
        let mut image = Pixels::black(format, count).ok_or_else(memory)?;
        let mut present = vec![false; count];
        // A later pass takes the place of an earlier one.
        for tile in recovered.passes.values().flat_map(|pass| &pass.tiles) {
            let pixels = super::pixels(&recovered.reader, tile.place).map_err(failed)?;
            if pixels.is_empty() {
                continue;
            }
            let r = tile.lease.region;
            let row_bytes = r.width() as usize * format.bytes_per_pixel();
            for (y, row) in (r.y0..r.y1).zip(pixels.chunks_exact(row_bytes)) {
                let at = (y - region.y0) as usize * region.width() as usize + (r.x0 - region.x0) as usize;
                image.put(at, row);
                present[at..at + r.width() as usize].fill(true);
            }
        }
        let damaged = recovered.damaged.then_some(recovered.end);
        Ok(Self { region, transfer: recovered.head.settings.transfer, image, present, damaged })
    }

    /// The share of its pixels that are done.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.present.iter().filter(|&&p| p).count() as f64 / self.present.len() as f64
    }
}
