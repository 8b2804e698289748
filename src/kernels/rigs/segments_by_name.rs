//! Bones that follow their namesakes.

use super::segment_map::{Segment, SegmentMap};
use super::skeleton::Skeleton;

/// Maps every bone of a target to the whole bone of the source whose joint has the same name.
///
/// Joints without a namesake follow nothing.
pub fn segments_by_name(source: &Skeleton, target: &Skeleton) -> SegmentMap {
    let segment = |name: &String| {
        let source = source.joint(name)? as u32;
        Some(Segment { source, from: 0.0, to: 1.0 })
    };
    let segments = target.names().iter().map(segment).collect();
    SegmentMap::new(source.n_joints(), segments).expect("joints of the source, and whole bones")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::mesh::Vec3;

    #[test]
    fn namesakes_are_found_in_any_order() {
        let line = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|&it| it.to_owned()).collect();
            let parents = (0..names.len()).map(|it| it.checked_sub(1)).collect();
            let places = (0..names.len()).map(|it| Vec3::x() * it as f64).collect();
            Skeleton::new(names, parents, places).unwrap()
        };
        let map = segments_by_name(&line(&["a", "b", "c"]), &line(&["b", "x", "c", "a"]));
        let found: Vec<_> = map.segments().iter().map(|it| it.map(|it| it.source)).collect();
        assert_eq!(found, [Some(1), None, Some(2), Some(0)]);
        assert_eq!(map.n_source(), 3);
    }
}
