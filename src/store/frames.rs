//! The write-ahead log frame by frame, as `SQLite` finds what a process left behind.
//!
//! Each frame's checksum goes on from the one before it, and what follows the first that is wrong never happened for `SQLite`.
//! That is right for a change that was cut off while it was written. A change is only begun once the one before it is synced,
//! so where two that ended stand behind a wrong frame, what was acknowledged would go without a word.
//! <https://sqlite.org/fileformat2.html#walformat>

use std::fs::File;
use std::io::{self, BufReader, ErrorKind, Read, Seek};
use std::path::Path;

const HEADER: usize = 32;
const FRAME_HEADER: usize = 24;
/// The last bit tells the order of bytes in checksums.
const MAGIC: u32 = 0x377f_0682;

/// The cumulative checksum of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Sum(u32, u32);

impl Sum {
    fn stored(bytes: &[u8]) -> Self {
        Self(word(bytes, 0), word(bytes, 4))
    }

    /// Goes on over bytes, a multiple of eight.
    fn over(self, bytes: &[u8], is_big: bool) -> Self {
        let word = |four: &[u8]| {
            let four = four.try_into().expect("four bytes");
            if is_big { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) }
        };
        bytes.chunks_exact(8).fold(self, |Self(a, b), eight| {
            let a = a.wrapping_add(word(&eight[..4])).wrapping_add(b);
            Self(a, b.wrapping_add(word(&eight[4..])).wrapping_add(a))
        })
    }
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_be_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
}

/// The first frame, from 1, that is not what was written, where acknowledged changes come after it; 0 is the log's header.
///
/// Damage within the last two changes of a log cannot be told from one that was cut off, nor that of how its frames are read.
///
/// # Errors
/// When the log is there and cannot be read.
pub(super) fn first_damaged(log: &Path) -> io::Result<Option<u64>> {
    let file = match File::open(log) {
        Ok(file) => file,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
    };
    let mut log = BufReader::with_capacity(1 << 16, file);
    let mut header = [0; HEADER];
    if !read_whole(&mut log, &mut header)? {
        return Ok(None);
    }
    let (magic, page_size) = (word(&header, 0), word(&header, 8) as usize);
    if magic & !1 != MAGIC || !(512..=65_536).contains(&page_size) || !page_size.is_power_of_two() {
        return Ok(None);
    }
    let is_big = magic & 1 == 1;
    let mut before = Sum::stored(&header[24..]);
    let mut damaged = (Sum(0, 0).over(&header[..24], is_big) != before).then_some(0);
    // Of this round of the log, not of one before whose frames were not written over yet.
    let mut salt = damaged.is_none().then(|| header[16..24].to_vec());
    let (mut frame, mut number, mut ended) = (vec![0; FRAME_HEADER + page_size], 0, 0);
    while read_whole(&mut log, &mut frame)? {
        number += 1;
        let own = Sum::stored(&frame[16..]);
        let is_right = before.over(&frame[..8], is_big).over(&frame[FRAME_HEADER..], is_big) == own;
        let salt = salt.get_or_insert_with(|| frame[8..16].to_vec());
        if is_right && frame[8..16] == salt[..] {
            ended += u32::from(damaged.is_some() && word(&frame, 4) != 0);
        } else {
            damaged.get_or_insert(number);
        }
        before = own;
    }
    // Begun anew meanwhile, it was read half before and half after.
    let mut now = [0; HEADER];
    log.rewind()?;
    let is_same = read_whole(&mut log, &mut now)? && now == header;
    Ok(damaged.filter(|_| ended >= 2 && is_same))
}

/// Fills `bytes`; `false` where the file ends before.
fn read_whole(file: &mut impl Read, bytes: &mut [u8]) -> io::Result<bool> {
    match file.read_exact(bytes) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::fixture::Fixture;
    use super::*;
    use crate::consolidation::Method;
    use crate::lineage::ModelSettings;

    /// The log after a number of changes, as it lies on the disk.
    async fn log(changes: u16) -> (tempfile::TempDir, std::path::PathBuf) {
        let fixture = Fixture::new().await;
        assert!(fixture.store.fold_log().await.unwrap());
        let model_id = fixture.model("m", Method::Naive, &ModelSettings::default()).await;
        for mark in 1..changes {
            fixture.batch(model_id, "fast", mark..mark + 1).await;
        }
        let folder = tempfile::tempdir().unwrap();
        let copy = folder.path().join("log");
        fs::copy(super::super::beside(fixture.store.path(), "-wal"), &copy).unwrap();
        (folder, copy)
    }

    #[tokio::test]
    async fn a_log_that_is_whole_or_cut_off_anywhere_is_not_damaged() {
        let (_folder, path) = log(4).await;
        let whole = fs::read(&path).unwrap();
        assert_eq!(first_damaged(&path).unwrap(), None);
        for end in (0..whole.len()).step_by(997) {
            fs::write(&path, &whole[..end]).unwrap();
            assert_eq!(first_damaged(&path).unwrap(), None, "{end} bytes");
        }
        fs::remove_file(&path).unwrap();
        assert_eq!(first_damaged(&path).unwrap(), None);
    }

    #[tokio::test]
    async fn a_bit_that_flips_before_the_last_changes_is_found_where_it_is() {
        let (_folder, path) = log(6).await;
        let whole = fs::read(&path).unwrap();
        let frame = FRAME_HEADER + 4096;
        let last = (whole.len() - HEADER) / frame;
        let commits: Vec<usize> = (0..last).filter(|at| word(&whole[HEADER + at * frame..], 4) != 0).collect();
        // Two changes that ended come after all of these.
        let told = commits[commits.len() - 3];
        for at in (12..HEADER + told * frame).step_by(331) {
            let mut flipped = whole.clone();
            flipped[at] ^= 4;
            fs::write(&path, &flipped).unwrap();
            let found = first_damaged(&path).unwrap().expect("it is found");
            let is = if at < HEADER { 0 } else { (at - HEADER) / frame + 1 };
            assert!(found as usize == is || is == 0, "byte {at}: frame {found} instead of {is}");
        }
    }
}
