//! Takes the golden hashes anew: after `NUMERIC_MODE` was raised, or for new cases. It fails whenever it wrote
//! something, so that no script passes by writing.

use std::process::ExitCode;

use tessera_tests::golden::{Record, file, hashes};

fn main() -> ExitCode {
    let path = file();
    let old = std::fs::read_to_string(&path).map_or_else(|_| Record::default(), |text| Record::parse(&text));
    let new = Record::new(hashes());
    if let Err(why) = old.replace(&new) {
        eprintln!("{why}");
        return ExitCode::FAILURE;
    }
    if old == new {
        println!("nothing to write: {} hashes are as on record", new.hashes.len());
        return ExitCode::SUCCESS;
    }
    match std::fs::write(&path, new.text()) {
        Ok(()) => eprintln!("written: {} hashes, mode {}; look at what changed", new.hashes.len(), new.mode),
        Err(e) => eprintln!("cannot write {}: {e}", path.display()),
    }
    ExitCode::FAILURE
}
