//! How much memory a scene may take here.

use std::str::FromStr;

/// Bytes that a scene takes once prepared, for each of its binary form, at most: as read, in place for rays, and
/// its hierarchy. Of scenes of triangles, spheres and lights, the last need the most.
const PREPARED: u64 = 8;

/// A number of bytes, written as people do: `512M`, `8G`, `1.5GiB`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bytes(pub u64);

impl FromStr for Bytes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?} is not an amount of memory, such as 512M, 8G or 1.5GiB");
        let digits = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
        let number: f64 = text[..digits].parse().map_err(|_| wrong())?;
        let shift = match text[digits..].to_ascii_lowercase().trim_end_matches("ib").trim_end_matches('b') {
            "" => 0,
            "k" => 10,
            "m" => 20,
            "g" => 30,
            "t" => 40,
            _ => return Err(wrong()),
        };
        let bytes = number * (1u64 << shift) as f64;
        if bytes >= 1.0 && bytes < (1u64 << 60) as f64 { Ok(Self(bytes as u64)) } else { Err(wrong()) }
    }
}

/// Three quarters of what this machine, or the group that this process is confined to, has; everything where
/// that cannot be known.
#[must_use]
pub fn default_limit() -> u64 {
    let text = |path| std::fs::read_to_string(path).ok();
    let total = text("/proc/meminfo").and_then(|info| {
        let line = info.lines().find_map(|l| l.strip_prefix("MemTotal:"))?.trim().strip_suffix("kB")?;
        Some(line.trim().parse::<u64>().ok()? * 1024)
    });
    let group = text("/sys/fs/cgroup/memory.max").and_then(|max| max.trim().parse().ok());
    let least = total.into_iter().chain(group).min();
    least.map_or(u64::MAX, |bytes| bytes / 4 * 3)
}

/// Memory that a scene takes once prepared, at most.
pub(crate) fn prepared_bytes(scene_bytes: u64) -> u64 {
    scene_bytes.saturating_mul(PREPARED)
}

/// Why a scene of so many bytes cannot be held within `limit`, if it cannot.
pub(crate) fn too_large(scene_bytes: u64, limit: u64) -> Option<String> {
    let needed = prepared_bytes(scene_bytes);
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    (needed > limit).then(|| {
        format!("the scene may take {} MiB of memory, and --max-memory allows {} MiB here", mib(needed), mib(limit))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_are_read_as_they_are_written() {
        for (text, bytes) in [("512M", 512 << 20), ("8G", 8 << 30), ("1.5GiB", 3 << 29), ("1kb", 1024), ("77", 77)] {
            assert_eq!(text.parse(), Ok(Bytes(bytes)), "{text}");
        }
        for bad in ["", "G", "-1G", "0", "1X", "1e9", "NaN", "inf", "99999999T", "1.2.3G"] {
            assert!(bad.parse::<Bytes>().is_err(), "{bad}");
        }
    }

    #[test]
    fn what_is_too_large_is_refused_with_both_numbers() {
        assert_eq!(too_large(1 << 20, 8 << 20), None);
        let why = too_large(u64::MAX, 1 << 30).unwrap();
        assert!(why.contains("1024 MiB"), "{why}");
        assert!(default_limit() > 1 << 20);
    }
}
