//! A reader of journals that shares no code with the one under test: written from `journal.proto`'s words.

use std::collections::BTreeMap;
use std::path::Path;

use prost::Message;
use tessera_proto::journal::{Checked, Head, Passed, Record, ThrownOut, Tile, record::Kind};

/// What a journal holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contents {
    /// The first record.
    pub head: Option<Head>,
    /// Tiles in the order in which they were accepted.
    pub tiles: Vec<Tile>,
    /// Passes that ended.
    pub passed: Vec<Passed>,
    /// Tiles that were rendered a second time.
    pub checked: Vec<Checked>,
    /// Workers that lied; what they made, and nobody had confirmed, is not among the tiles any more.
    pub thrown_out: Vec<ThrownOut>,
    /// Bytes of all that.
    pub bytes: u64,
}

impl Contents {
    /// What stands in the file at `path` up to the first frame that is not whole; nothing where there is no file.
    ///
    /// # Panics
    /// When the file does not begin as a journal does, or holds what no journal may.
    #[must_use]
    pub fn read(path: &Path) -> Self {
        let Ok(bytes) = std::fs::read(path) else { return Self::default() };
        let magic = b"TSRJRN01";
        assert!(bytes.starts_with(&magic[..bytes.len().min(8)]), "no journal");
        let mut contents = Self { bytes: 8, ..Self::default() };
        let mut rest = bytes.get(8..).unwrap_or_default();
        while let Some((record, length)) = frame(rest) {
            rest = &rest[length..];
            contents.bytes += length as u64;
            match record.kind.expect("a record of a kind") {
                Kind::Head(head) => assert!(contents.head.replace(head).is_none(), "two heads"),
                Kind::Tile(tile) => contents.tiles.push(tile),
                Kind::Passed(passed) => contents.passed.push(passed),
                Kind::Checked(checked) => contents.checked.push(checked),
                Kind::ThrownOut(out) => contents.throw_out(out),
            }
        }
        contents
    }

    fn throw_out(&mut self, out: ThrownOut) {
        let Self { tiles, checked, .. } = self;
        tiles.retain(|tile| {
            let lease = tile.lease.as_ref().expect("a lease");
            let confirms = |c: &Checked| c.confirmed && c.pass == lease.pass && c.region == lease.region;
            tile.key != out.key || checked.iter().any(confirms)
        });
        self.thrown_out.push(out);
    }

    /// Pixels that were accepted, over all passes.
    ///
    /// # Panics
    /// When a pixel was accepted twice in one pass.
    #[must_use]
    pub fn pixels(&self) -> u64 {
        let mut passes = BTreeMap::<u32, Vec<(u32, u32, u32, u32)>>::new();
        for tile in &self.tiles {
            let lease = tile.lease.as_ref().expect("a lease");
            let r = lease.region.as_ref().expect("a region");
            passes.entry(lease.pass).or_default().push((r.x0, r.y0, r.x1, r.y1));
        }
        let mut pixels = 0;
        for (pass, tiles) in passes {
            let (width, height) = tiles.iter().fold((0, 0), |(w, h), t| (w.max(t.2), h.max(t.3)));
            let mut seen = vec![false; width as usize * height as usize];
            for (x0, y0, x1, y1) in tiles {
                for y in y0..y1 {
                    for x in x0..x1 {
                        let pixel = &mut seen[y as usize * width as usize + x as usize];
                        assert!(!std::mem::replace(pixel, true), "pixel {x},{y} of pass {pass} was rendered twice");
                        pixels += 1;
                    }
                }
            }
        }
        pixels
    }
}

/// The first frame's record and the frame's length; `None` where it is not whole.
fn frame(bytes: &[u8]) -> Option<(Record, usize)> {
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let (length, check, head) = (word(0)? as usize, word(4)?, word(16)?);
    if crc32(&bytes[..16]) != head {
        return None;
    }
    let body = bytes.get(20..20 + length)?;
    (crc32(body) == check).then(|| (Record::decode(body).expect("a record"), 20 + length))
}

/// CRC-32 as Ethernet has it (IEEE 802.3), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let mut table = [0u32; 256];
    for (i, entry) in table.iter_mut().enumerate() {
        *entry = (0..8).fold(i as u32, |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 });
    }
    !bytes.iter().fold(u32::MAX, |c, &b| table[((c ^ u32::from(b)) & 255) as usize] ^ (c >> 8))
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_checksum_is_the_standard_one() {
        assert_eq!(super::crc32(b"123456789"), 0xcbf4_3926);
    }
}
