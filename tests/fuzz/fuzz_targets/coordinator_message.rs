//! See `tessera_tests::fuzz`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    (tessera_tests::fuzz::target("coordinator_message").reads)(bytes);
});
