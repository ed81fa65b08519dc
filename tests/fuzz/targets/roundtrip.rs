//! See [`umbrage_fuzz::roundtrip`] for the claim.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| umbrage_fuzz::roundtrip::run(data));
