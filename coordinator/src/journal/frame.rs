//! Records in a file: how they are framed, and where what can be read of them ends.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

use bytes::Bytes;
use prost::Message;
use tessera_proto::journal::Record;

/// What a journal begins with: six letters that never change, two of the format's version.
pub(super) const MAGIC: &[u8; 8] = b"TSRJRN01";
/// The letters that every version has.
pub(super) const LETTERS: usize = 6;
/// Bytes before a record's own.
const HEAD: usize = 20;
/// The longest body.
const MAX_BODY: u32 = 1 << 20;

/// Where the body of a record stands in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Location {
    pub(super) at: u64,
    pub(super) length: u32,
}

/// Appends `record` to `out`; so many bytes of the file are known to be on the disk.
pub(super) fn put(out: &mut Vec<u8>, record: &Record, synced: u64) {
    let start = out.len();
    out.extend_from_slice(&[0; HEAD]);
    record.encode_raw(out);
    let (head, body) = out[start..].split_at_mut(HEAD);
    head[..4].copy_from_slice(&(body.len() as u32).to_le_bytes());
    head[4..8].copy_from_slice(&crc32fast::hash(body).to_le_bytes());
    head[8..16].copy_from_slice(&synced.to_le_bytes());
    let check = crc32fast::hash(&head[..16]);
    head[16..].copy_from_slice(&check.to_le_bytes());
}

/// What a frame's head says.
struct Head {
    length: u32,
    check: u32,
    synced: u64,
}

impl Head {
    /// `None` where these bytes are no head.
    fn parse(bytes: &[u8; HEAD]) -> Option<Self> {
        let four = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let (length, check) = (four(0), four(4));
        let synced = u64::from(four(8)) | u64::from(four(12)) << 32;
        // The cheap question first: this is asked of every byte behind a damage.
        ((1..=MAX_BODY).contains(&length) && crc32fast::hash(&bytes[..16]) == four(16)).then_some(Self {
            length,
            check,
            synced,
        })
    }
}

/// What can be read of a file.
#[derive(Debug)]
pub(super) enum Extent {
    /// Records up to here; what follows, if anything, is a tail that never got to the disk.
    Until(u64),
    /// Records up to here, and damage: what follows was on the disk once.
    Damaged(u64),
    /// The file does not begin as a journal does.
    Foreign,
}

/// Gives every record of `file` and its place to `each`, in order, as far as they are sound.
///
/// # Errors
/// When the file cannot be read, or what `each` says.
pub(super) fn scan<E: From<io::Error>>(
    mut file: &File,
    mut each: impl FnMut(Location, Record) -> Result<(), E>,
) -> Result<Extent, E> {
    file.seek(SeekFrom::Start(0))?;
    let mut from = BufReader::with_capacity(1 << 20, file);
    let mut magic = [0; MAGIC.len()];
    let got = fill(&mut from, &mut magic)?;
    if magic[..got] != MAGIC[..got] {
        return Ok(Extent::Foreign);
    }
    let mut at = got as u64;
    loop {
        let mut found = next(&mut from, at)?;
        if found.is_none() {
            if !was_synced(file, at)? {
                return Ok(Extent::Until(at));
            }
            // Whoever writes the file may have got so far meanwhile.
            from.seek(SeekFrom::Start(at))?;
            found = next(&mut from, at)?;
        }
        let Some((place, record)) = found else { return Ok(Extent::Damaged(at)) };
        each(place, record)?;
        at = place.at + u64::from(place.length);
    }
}

/// The record that stands at `at`, where `from` is; `None` where it is not whole or not sound.
fn next(from: &mut impl Read, at: u64) -> io::Result<Option<(Location, Record)>> {
    let mut head = [0; HEAD];
    if fill(from, &mut head)? < HEAD {
        return Ok(None);
    }
    let Some(Head { length, check, .. }) = Head::parse(&head) else { return Ok(None) };
    let mut body = vec![0; length as usize];
    if fill(from, &mut body)? < body.len() || crc32fast::hash(&body) != check {
        return Ok(None);
    }
    // Pixels are not copied out of the body.
    let record = Record::decode(Bytes::from(body)).ok();
    Ok(record.map(|record| (Location { at: at + HEAD as u64, length }, record)))
}

/// Reads the record at `place` again.
pub(super) fn read_again(mut file: &File, place: Location) -> io::Result<Record> {
    file.seek(SeekFrom::Start(place.at))?;
    let mut body = vec![0; place.length as usize];
    file.read_exact(&mut body)?;
    Record::decode(Bytes::from(body)).map_err(io::Error::other)
}

/// Fills `buffer` as far as `from` reaches; gives how far that is.
fn fill(from: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut done = 0;
    while done < buffer.len() {
        match from.read(&mut buffer[done..]) {
            Ok(0) => break,
            Ok(n) => done += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(done)
}

/// Whether a frame behind `at`, wherever it begins, says that the byte at `at` was on the disk.
fn was_synced(mut file: &File, at: u64) -> io::Result<bool> {
    let mut window = vec![0; 1 << 20];
    let (mut start, mut kept) = (at, 0);
    file.seek(SeekFrom::Start(at))?;
    loop {
        let got = fill(&mut file, &mut window[kept..])?;
        let filled = kept + got;
        let says = |head: &[u8; HEAD]| {
            // Nothing is looked at twice: a head that is none costs a comparison.
            Head::parse(head).is_some_and(|h| h.synced > at && h.synced <= start + filled as u64)
        };
        if window[..filled].windows(HEAD).any(|w| w.try_into().is_ok_and(says)) {
            return Ok(true);
        }
        if got == 0 {
            return Ok(false);
        }
        // A head may lie across two windows.
        kept = filled.min(HEAD - 1);
        window.copy_within(filled - kept..filled, 0);
        start += (filled - kept) as u64;
    }
}
