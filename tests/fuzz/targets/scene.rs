//! See [`umbrage_fuzz::scene`] for the claim.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| umbrage_fuzz::scene::run(data));
