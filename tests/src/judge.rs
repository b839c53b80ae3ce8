//! Independent programs that judge what ours says. At home a test whose judge is missing is skipped, and says so; where
//! `REQUIRE_JUDGES` is set, as in CI, it fails.

use std::process::{Command, Stdio};

/// Whether `program` answers to `args`.
///
/// # Panics
/// When it does not, where `REQUIRE_JUDGES` is set.
#[must_use]
pub fn judge(program: &str, args: &[&str]) -> bool {
    let mut command = Command::new(program);
    command.args(args).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    if command.status().is_ok() {
        return true;
    }
    assert!(std::env::var_os("REQUIRE_JUDGES").is_none(), "{program} is not installed, and REQUIRE_JUDGES is set");
    println!("skipped: {program} is not installed");
    false
}
