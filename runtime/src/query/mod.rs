//! CPU twins of the shaders, over the same words: pool and page table as the device has them. Used by tests and by
//! callers that want the device's very answer; for plain lookups see `umbrage_reader::query`.

pub mod mh;
