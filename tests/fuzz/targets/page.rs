//! See [`umbrage_fuzz::page`] for the claim.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| umbrage_fuzz::page::run(data));
