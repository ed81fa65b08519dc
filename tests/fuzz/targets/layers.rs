//! See [`umbrage_fuzz::layers`] for the claim.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| umbrage_fuzz::layers::run(data));
