//! Times on command lines.

use std::time::Duration;

/// A time of at least a millisecond and at most ten years: numbers with units, added up; seconds without one.
///
/// # Errors
/// What was expected instead.
pub fn duration(text: &str) -> Result<Duration, String> {
    let wrong = || "expected a time, such as 90s, 1.5m, 1h30m or 500ms".to_owned();
    let text = text.trim();
    // Months are no times of a render, and `M` is easily written for `m`.
    if text.contains('M') {
        return Err(wrong());
    }
    let bare = text.bytes().all(|b| b.is_ascii_digit() || b == b'.');
    let written = if bare { format!("{text}s") } else { text.to_owned() };
    let time = humantime::parse_duration(&written).map_err(|_| wrong())?;
    if (Duration::from_millis(1)..=Duration::from_secs(3653 * 86_400)).contains(&time) {
        Ok(time)
    } else {
        Err("a time is between a millisecond and ten years".into())
    }
}

#[cfg(test)]
mod tests {
    use super::duration;

    #[test]
    fn times_have_units() {
        for (text, seconds) in [
            ("90s", 90.0),
            ("1.5m", 90.0),
            ("1h30m", 5400.0),
            (" 1h 30min ", 5400.0),
            ("250ms", 0.25),
            ("2", 2.0),
            ("0.5", 0.5),
            ("5d", 432_000.0),
        ] {
            assert_eq!(duration(text).unwrap().as_secs_f64(), seconds, "{text}");
        }
        for bad in [
            "",
            "x",
            "s",
            "5x",
            "-1s",
            "0",
            "0s",
            "1..5s",
            "1e9",
            "1e9h",
            "inf",
            "NaN",
            "5M",
            "1h-5m",
            "9999999d",
            "99999999999999999999",
        ] {
            assert!(duration(bad).is_err(), "{bad}");
        }
    }
}
