//! Which bones of one skeleton follow which bones of another.

/// The part of a source's bone that a bone of the target follows.
///
/// A bone is named by the joint at its end; a root names the place where its skeleton begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// The joint at the end of the source's bone.
    pub source: u32,
    /// Where along the source's bone the target's begins, in `0..=1` from parent to joint.
    pub from: f64,
    /// Where it ends, not before `from`.
    pub to: f64,
}

/// For every joint of a target skeleton what its bone follows; nothing: it follows its parent stiffly.
#[derive(Debug, Clone, PartialEq)]
pub struct SegmentMap {
    n_source: usize,
    segments: Vec<Option<Segment>>,
}

/// Why something is no map of segments.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SegmentMapError {
    #[error("joint {joint} follows joint {source_joint}, but the source has {n_source} joints")]
    OutOfRange { joint: usize, source_joint: u32, n_source: usize },
    #[error("joint {joint} follows its bone from {from} to {to}, which is no part of 0 to 1")]
    Span { joint: usize, from: f64, to: f64 },
}

impl SegmentMap {
    /// Checks and wraps what every target joint follows.
    ///
    /// # Errors
    /// See [`SegmentMapError`]; the first offending joint is named.
    pub fn new(n_source: usize, segments: Vec<Option<Segment>>) -> Result<Self, SegmentMapError> {
        for (joint, segment) in segments.iter().enumerate() {
            let Some(Segment { source, from, to }) = *segment else { continue };
            if source as usize >= n_source {
                let source_joint = source;
                return Err(SegmentMapError::OutOfRange { joint, source_joint, n_source });
            }
            if !(0.0 <= from && from <= to && to <= 1.0) {
                return Err(SegmentMapError::Span { joint, from, to });
            }
        }
        Ok(Self { n_source, segments })
    }

    /// How many joints the source has.
    pub fn n_source(&self) -> usize {
        self.n_source
    }

    /// What every joint of the target follows.
    pub fn segments(&self) -> &[Option<Segment>] {
        &self.segments
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_is_named() {
        let check = |segment: Segment, expected: &str| {
            let made = SegmentMap::new(3, vec![None, Some(segment)]);
            assert_eq!(made.unwrap_err().to_string(), expected);
        };
        let whole = Segment { source: 2, from: 0.0, to: 1.0 };
        assert!(SegmentMap::new(3, vec![Some(whole), None]).is_ok());
        let far = Segment { source: 3, ..whole };
        check(far, "joint 1 follows joint 3, but the source has 3 joints");
        let back = Segment { from: 0.5, to: 0.25, ..whole };
        check(back, "joint 1 follows its bone from 0.5 to 0.25, which is no part of 0 to 1");
        let nan = Segment { to: f64::NAN, ..whole };
        check(nan, "joint 1 follows its bone from 0 to NaN, which is no part of 0 to 1");
    }
}
