//! See [`umbrage_fuzz::cold`] for the claim.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| umbrage_fuzz::cold::run(data));
