//! Source -> checked pages -> views -> CPU queries.
