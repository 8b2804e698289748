//! Plain text.

/// A text of any length: what a program printed, a report.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Text(pub String);
