//! What of a line or an area lies within the axes.

use super::scene::Point;

/// A rectangle: its least and its greatest corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rect {
    pub low: Point,
    pub high: Point,
}

impl Rect {
    pub fn contains(&self, point: Point) -> bool {
        (0..2).all(|it| self.low[it] <= point[it] && point[it] <= self.high[it])
    }

    pub fn corners(&self) -> [Point; 4] {
        let Self { low: [left, top], high: [right, bottom] } = *self;
        [[left, top], [right, top], [right, bottom], [left, bottom]]
    }
}

/// The pieces of a chain of segments within a rectangle (Liang & Barsky 1984).
pub fn clip_line(points: &[Point], rect: &Rect) -> Vec<Vec<Point>> {
    let mut pieces: Vec<Vec<Point>> = Vec::new();
    for pair in points.windows(2) {
        let Some([from, to]) = clip_segment(pair[0], pair[1], rect) else { continue };
        match pieces.last_mut() {
            Some(piece) if piece.last() == Some(&from) => piece.push(to),
            _ => pieces.push(vec![from, to]),
        }
    }
    pieces
}

fn clip_segment(from: Point, to: Point, rect: &Rect) -> Option<[Point; 2]> {
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for axis in 0..2 {
        let along = to[axis] - from[axis];
        for (distance, direction) in
            [(rect.low[axis] - from[axis], along), (from[axis] - rect.high[axis], -along)]
        {
            if direction == 0.0 && distance > 0.0 {
                return None;
            }
            let t = distance / direction;
            if direction > 0.0 {
                enter = enter.max(t);
            } else if direction < 0.0 {
                leave = leave.min(t);
            }
        }
    }
    let at = |t: f64| match t {
        0.0 => from,
        1.0 => to,
        _ => [0, 1].map(|it| from[it] + t * (to[it] - from[it])),
    };
    (enter <= leave).then(|| [at(enter), at(leave)])
}

/// The part of a polygon within a rectangle (Sutherland & Hodgman 1974).
pub fn clip_area(points: &[Point], rect: &Rect) -> Vec<Point> {
    let mut area = points.to_vec();
    for axis in 0..2 {
        area = clip_side(&area, axis, rect.low[axis], 1.0);
        area = clip_side(&area, axis, rect.high[axis], -1.0);
    }
    area
}

fn clip_side(points: &[Point], axis: usize, limit: f64, sign: f64) -> Vec<Point> {
    let is_inside = |it: &Point| sign * (it[axis] - limit) >= 0.0;
    let mut res = Vec::new();
    for (index, to) in points.iter().enumerate() {
        let from = &points[(index + points.len() - 1) % points.len()];
        if is_inside(from) != is_inside(to) {
            let t = (limit - from[axis]) / (to[axis] - from[axis]);
            let mut crossing = [0, 1].map(|it| from[it] + t * (to[it] - from[it]));
            crossing[axis] = limit;
            res.push(crossing);
        }
        if is_inside(to) {
            res.push(*to);
        }
    }
    res
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: Rect = Rect { low: [0.0, 0.0], high: [1.0, 1.0] };

    #[test]
    fn lines_are_cut_where_they_leave_and_go_on_where_they_return() {
        let zigzag = [[0.5, 0.5], [1.5, 0.5], [1.5, 0.75], [0.5, 0.75], [0.5, 0.25]];
        let pieces = clip_line(&zigzag, &UNIT);
        let expected = [vec![[0.5, 0.5], [1.0, 0.5]], vec![[1.0, 0.75], [0.5, 0.75], [0.5, 0.25]]];
        assert_eq!(pieces, expected);
        assert!(clip_line(&[[2.0, 0.0], [2.0, 1.0]], &UNIT).is_empty());
        assert_eq!(clip_line(&[[-1.0, -1.0], [2.0, 2.0]], &UNIT), [vec![[0.0, 0.0], [1.0, 1.0]]]);
    }

    #[test]
    fn areas_are_cut_at_every_side() {
        let large = [[-1.0, -1.0], [2.0, -1.0], [2.0, 2.0], [-1.0, 2.0]];
        let area = |points: &[Point]| {
            let n = points.len();
            let cross = |i: usize| {
                points[i][0] * points[(i + 1) % n][1] - points[i][1] * points[(i + 1) % n][0]
            };
            (0..n).map(cross).sum::<f64>() / 2.0
        };
        assert_eq!(area(&clip_area(&large, &UNIT)), 1.0);
        let triangle = [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]];
        assert_eq!(area(&clip_area(&triangle, &UNIT)), 1.0);
        assert!(clip_area(&[[3.0, 3.0], [4.0, 3.0], [3.0, 4.0]], &UNIT).is_empty());
    }
}
