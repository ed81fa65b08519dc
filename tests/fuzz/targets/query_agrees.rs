//! See [`umbrage_fuzz::query_agrees`] for the claim.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| umbrage_fuzz::query_agrees::run(data));
