//! What cameras and scanners see of a body, and a surface that follows it.

pub mod depth;
pub mod registration;
pub mod scan;
