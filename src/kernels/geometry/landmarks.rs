//! Landmarks: named vertices that correspond across shapes.

/// Named vertices of one shape, in an order that corresponds across shapes.
#[derive(Debug, Clone, PartialEq)]
pub struct Landmarks {
    pub names: Vec<String>,
    /// One vertex index a name.
    pub vertices: Vec<u32>,
}

impl Landmarks {
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty()
    }
}
