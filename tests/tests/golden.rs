//! Linear pixels are those on record, bit for bit.

use std::collections::BTreeMap;

use tessera_proto::limits::NUMERIC_MODE;
use tessera_tests::golden::{Record, file, hashes};

fn on_record() -> Record {
    Record::parse(&std::fs::read_to_string(file()).expect("the record is there"))
}

#[test]
fn pixels_are_those_on_record() {
    let (record, now) = (on_record(), Record::new(hashes()));
    record.replace(&now).unwrap_or_else(|why| panic!("{why}"));
    assert_eq!(record, now, "the record is not of this mode or these cases: 'cargo run -p tessera-tests --bin golden'");
}

#[test]
fn the_record_is_of_this_mode_and_large_enough_to_tell() {
    let record = on_record();
    assert_eq!(record.mode, NUMERIC_MODE);
    let mut hashes: Vec<_> = record.hashes.values().collect();
    hashes.sort();
    hashes.dedup();
    // Each is a picture of its own, but for mirrors, which are read and generated: six pictures and three errors.
    assert!(record.hashes.len() >= 36 && hashes.len() + 9 >= record.hashes.len(), "{}", hashes.len());
}

#[test]
fn changed_pixels_need_another_mode_and_new_cases_do_not() {
    let record = |mode: &str, hashes: &[(&str, &str)]| Record {
        mode: mode.into(),
        hashes: hashes.iter().map(|(case, hash)| ((*case).into(), (*hash).into())).collect::<BTreeMap<_, _>>(),
    };
    let old = record("1", &[("a", "00"), ("b", "01")]);
    assert!(old.replace(&record("1", &[("a", "00"), ("b", "01"), ("c", "02")])).is_ok());
    let why = old.replace(&record("1", &[("a", "00"), ("b", "ff")])).expect_err("b changed");
    assert!(why.contains("1 of 2") && why.ends_with("\n  b"), "{why}");
    assert!(old.replace(&record("1", &[("a", "00")])).is_err(), "a case less is a change, too");
    assert!(old.replace(&record("2", &[("a", "10"), ("b", "01")])).is_ok());
    assert_eq!(Record::parse(&old.text()), old);
}
