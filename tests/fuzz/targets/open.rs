//! See [`umbrage_fuzz::open`] for the claim.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| umbrage_fuzz::open::run(data));
