//! Bodies and rigs made from numbers, and shapes spoiled as scans are.

pub mod degrade;
pub mod make_body;
pub mod synthesize;
