//! The libraries that carry the wire, and how loud they are in a program's log.

/// By their names in a log.
const LAYERS: [&str; 6] = ["h2", "hyper", "hyper_util", "tonic", "tower", "rustls"];

/// Directives of a log's filter by which they say only what is of `level` or worse: `error`, `warn` ….
#[must_use]
pub fn layers_at(level: &str) -> String {
    LAYERS.map(|layer| format!("{layer}={level}")).join(",")
}
