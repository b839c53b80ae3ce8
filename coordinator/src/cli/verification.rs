//! What was verified, as the report and the last lines of a render say it.

use coordinator::{CheckedTile, Verification};
use serde::Serialize;

/// See [`Verification`].
#[derive(Debug, Serialize)]
pub(crate) struct VerificationReport<'a> {
    share: f64,
    compared: usize,
    disagreed: usize,
    thrown_out: &'a [String],
    tiles_redone: u64,
    checks: Vec<CheckReport<'a>>,
}

#[derive(Debug, Serialize)]
struct CheckReport<'a> {
    /// x0, y0, x1, y1.
    region: [u32; 4],
    made_by: &'a str,
    checked_by: &'a str,
    agreed: bool,
}

impl<'a> VerificationReport<'a> {
    /// `None` where nothing was to be verified.
    pub(crate) fn new(v: &'a Verification) -> Option<Self> {
        let check = |c: &'a CheckedTile| CheckReport {
            region: [c.region.x0, c.region.y0, c.region.x1, c.region.y1],
            made_by: &c.maker,
            checked_by: c.checker.as_deref().unwrap_or("coordinator"),
            agreed: c.agreed,
        };
        (v.share > 0.0).then(|| Self {
            share: v.share,
            compared: v.checks.len(),
            disagreed: v.checks.iter().filter(|c| !c.agreed).count(),
            thrown_out: &v.thrown_out,
            tiles_redone: v.redone,
            checks: v.checks.iter().map(check).collect(),
        })
    }
}

/// What people are told of liars; `None` where there was none.
pub(crate) fn warning(v: &Verification) -> Option<String> {
    if v.thrown_out.is_empty() {
        return None;
    }
    let names = v.thrown_out.join(", ");
    Some(format!(
        "{names} delivered pixels that are not the scene's and was thrown out; {} unconfirmed tiles were rendered \
         again. Look at that machine's memory, or at who runs it",
        v.redone
    ))
}

/// A share of the tiles, 0 to 1.
pub(super) fn share(text: &str) -> Result<f64, String> {
    let wrong = || "expected a share of the tiles, such as 5%, 1/20, 0.05 or all".to_string();
    let number = |t: &str| t.trim().parse::<f64>().map_err(|_| wrong());
    let share = match (text, text.strip_suffix('%'), text.split_once('/')) {
        ("all", ..) => 1.0,
        ("none", ..) => 0.0,
        (_, Some(percent), _) => number(percent)? / 100.0,
        (_, None, Some((above, below))) => number(above)? / number(below)?,
        _ => number(text)?,
    };
    if (0.0..=1.0).contains(&share) { Ok(share) } else { Err(wrong()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_written_as_people_write_them() {
        for (text, s) in [("5%", 0.05), ("1/20", 0.05), ("0.05", 0.05), ("all", 1.0), ("100%", 1.0), ("0", 0.0)] {
            assert_eq!(share(text), Ok(s), "{text}");
        }
        for bad in ["", "5", "-1%", "101%", "1/0", "0/0", "x", "NaN", "1/2/3", "%"] {
            assert!(share(bad).is_err(), "{bad}");
        }
    }
}
