//! See [`umbrage_fuzz::intervals`] for the claim.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| umbrage_fuzz::intervals::run(data));
