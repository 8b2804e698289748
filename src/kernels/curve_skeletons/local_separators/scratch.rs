//! Memory that one search for a separator leaves to the next.

use std::sync::Mutex;

use super::graph::SpatialGraph;

/// What a point is during one search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    Unseen,
    /// In the separator.
    Inside,
    /// In front of it, on one of its sides.
    Side(u32),
}

/// Marks of all points that are forgotten at once: a search pays for what it touches only.
#[derive(Debug)]
pub struct Scratch {
    marks: Vec<u32>,
    /// Marks below are of earlier searches. `base` is inside, `base + 1 + k` is side `k`.
    base: u32,
    /// Of points inside, their place in a list.
    places: Vec<u32>,
    visits: Vec<u32>,
    visit: u32,
    stack: Vec<u32>,
}

/// Sides that one search may tell apart: more than any point has neighbours in practice.
const MOST_SIDES: u32 = 1 << 12;

impl Scratch {
    pub fn new(n_points: usize) -> Self {
        Self {
            marks: vec![0; n_points],
            base: 1,
            places: vec![0; n_points],
            visits: vec![0; n_points],
            visit: 0,
            stack: vec![],
        }
    }

    /// Forgets all marks.
    pub fn forget(&mut self) {
        if self.base > u32::MAX - 3 * MOST_SIDES {
            self.marks.fill(0);
            self.base = 1;
        } else {
            self.base += MOST_SIDES + 1;
        }
    }

    pub fn mark(&self, point: u32) -> Mark {
        match self.marks[point as usize].checked_sub(self.base) {
            None => Mark::Unseen,
            Some(0) => Mark::Inside,
            Some(side) => Mark::Side(side - 1),
        }
    }

    pub fn is_inside(&self, point: u32) -> bool {
        self.marks[point as usize] == self.base
    }

    pub fn put_inside(&mut self, point: u32) {
        self.marks[point as usize] = self.base;
    }

    pub fn put_side(&mut self, point: u32, side: u32) {
        // What has so many sides is refused for its quality; it must only not be mixed up.
        self.marks[point as usize] = self.base + 1 + side.min(MOST_SIDES - 1);
    }

    /// Marks the points of a list as inside, with their places.
    pub fn put_all_inside(&mut self, points: &[u32]) {
        for (place, &point) in points.iter().enumerate() {
            self.put_inside(point);
            self.places[point as usize] = place as u32;
        }
    }

    /// The place of a point in the list that was put inside.
    pub fn place(&self, point: u32) -> usize {
        self.places[point as usize] as usize
    }

    /// Tells the sides of the marked points apart: every connected part of them becomes a side.
    /// Returns how many points each has.
    pub fn label_sides(&mut self, graph: &SpatialGraph, front: &[u32]) -> Vec<usize> {
        let mut sizes = vec![];
        let mut part = vec![];
        self.begin_walk();
        for &from in front {
            part.clear();
            let is_front = |it: &Self, next| matches!(it.mark(next), Mark::Side(_));
            if self.flood(graph, from, is_front, |it| part.push(it)) > 0 {
                part.iter().for_each(|&it| self.put_side(it, sizes.len() as u32));
                sizes.push(part.len());
            }
        }
        sizes
    }

    /// Begins a walk over points none of which is visited.
    pub fn begin_walk(&mut self) {
        if self.visit == u32::MAX {
            self.visits.fill(0);
            self.visit = 0;
        }
        self.visit += 1;
    }

    /// Whether this is the first visit of the walk.
    pub fn visits_first(&mut self, point: u32) -> bool {
        let is_first = self.visits[point as usize] != self.visit;
        self.visits[point as usize] = self.visit;
        is_first
    }

    /// Visits what can be reached from a point over points that satisfy a condition; returns how many.
    pub fn flood(
        &mut self,
        graph: &SpatialGraph,
        from: u32,
        holds: impl Fn(&Self, u32) -> bool,
        mut meet: impl FnMut(u32),
    ) -> usize {
        if !self.visits_first(from) {
            return 0;
        }
        let mut stack = std::mem::take(&mut self.stack);
        stack.push(from);
        let mut n_visited = 0;
        while let Some(point) = stack.pop() {
            n_visited += 1;
            meet(point);
            for &next in graph.neighbors(point) {
                if holds(self, next) && self.visits_first(next) {
                    stack.push(next);
                }
            }
        }
        self.stack = stack;
        n_visited
    }
}

/// Scratches that threads take and give back; which one is taken changes nothing.
#[derive(Debug)]
pub struct ScratchPool {
    n_points: usize,
    free: Mutex<Vec<Scratch>>,
}

impl ScratchPool {
    pub fn new(n_points: usize) -> Self {
        Self { n_points, free: Mutex::new(Vec::new()) }
    }

    /// Lends a scratch to a function.
    pub fn with<T>(&self, work: impl FnOnce(&mut Scratch) -> T) -> T {
        let taken = self.free.lock().expect("no thread panics while it holds the pool").pop();
        let mut scratch = taken.unwrap_or_else(|| Scratch::new(self.n_points));
        let result = work(&mut scratch);
        self.free.lock().expect("no thread panics while it holds the pool").push(scratch);
        result
    }
}
