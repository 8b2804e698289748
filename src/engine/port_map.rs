//! A small map from names of ports.

use std::ops::Index;

/// Values by port, sorted by name. Nearly all have one to three, and a pipeline of ten thousand nodes
/// has as many of these maps: a list without spare room is a third of the smallest B-tree.
#[derive(Debug, Clone, PartialEq)]
pub struct PortMap<T> {
    entries: Vec<(&'static str, T)>,
}

impl<T> PortMap<T> {
    pub const fn new() -> Self {
        Self { entries: Vec::new() }
    }

    /// Sets a value; the one that was there before.
    pub fn insert(&mut self, port: &'static str, value: T) -> Option<T> {
        match self.position(port) {
            Ok(at) => Some(std::mem::replace(&mut self.entries[at].1, value)),
            Err(at) => {
                self.entries.reserve_exact(1);
                self.entries.insert(at, (port, value));
                None
            }
        }
    }

    pub fn get(&self, port: &str) -> Option<&T> {
        Some(&self.entries[self.position(port).ok()?].1)
    }

    pub fn len(&self) -> usize {
        self.entries.len()
    }

    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    pub fn contains_key(&self, port: &str) -> bool {
        self.position(port).is_ok()
    }

    pub fn iter(&self) -> impl Iterator<Item = (&'static str, &T)> {
        self.into_iter()
    }

    pub fn keys(&self) -> impl Iterator<Item = &'static str> {
        self.entries.iter().map(|it| it.0)
    }

    pub fn values(&self) -> impl Iterator<Item = &T> + Clone {
        self.entries.iter().map(|it| &it.1)
    }

    fn position(&self, port: &str) -> Result<usize, usize> {
        self.entries.binary_search_by(|it| it.0.cmp(port))
    }
}

impl<T> Default for PortMap<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T> Index<&str> for PortMap<T> {
    type Output = T;

    fn index(&self, port: &str) -> &T {
        self.get(port).expect("the map has the port")
    }
}

impl<'a, T> IntoIterator for &'a PortMap<T> {
    type Item = (&'static str, &'a T);
    type IntoIter = std::iter::Map<
        std::slice::Iter<'a, (&'static str, T)>,
        fn(&'a (&'static str, T)) -> (&'static str, &'a T),
    >;

    fn into_iter(self) -> Self::IntoIter {
        self.entries.iter().map(|(port, value)| (*port, value))
    }
}

impl<T> FromIterator<(&'static str, T)> for PortMap<T> {
    fn from_iter<I: IntoIterator<Item = (&'static str, T)>>(entries: I) -> Self {
        let mut res = Self::new();
        for (port, value) in entries {
            res.insert(port, value);
        }
        res
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_sorted_and_has_every_port_once() {
        let mut map: PortMap<i32> = [("mesh", 1), ("basis", 2), ("mesh", 3)].into_iter().collect();
        assert_eq!(map.insert("weights", 4), None);
        assert_eq!(map.insert("basis", 5), Some(2));
        let entries: Vec<(&str, i32)> = map.iter().map(|it| (it.0, *it.1)).collect();
        assert_eq!(entries, [("basis", 5), ("mesh", 3), ("weights", 4)]);
        assert_eq!((map["mesh"], map.get("nothing")), (3, None));
        assert!(map.contains_key("weights") && map.values().sum::<i32>() == 12);
    }
}
