//! What can go wrong. "These maps do not overlap" and "two answers fit" are values, not errors.

/// An error of the core. Every variant maps to one Python exception.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// A grid that is no occupancy grid: sizes, resolution, origin or cell values out of range.
    #[error("map {map}: {field}: {problem}")]
    Grid {
        /// Name or index of the map.
        map: String,
        /// The field that is wrong.
        field: &'static str,
        /// What is wrong with it and what to do.
        problem: String,
    },
    /// A configuration value out of its range, or a key that does not exist.
    #[error("config: {key}: {problem}")]
    Config {
        /// Dotted path of the key.
        key: String,
        /// What is wrong with it and what to do.
        problem: String,
    },
    /// The caller's observer asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// Result of the core's fallible functions.
pub type Result<T> = std::result::Result<T, Error>;
