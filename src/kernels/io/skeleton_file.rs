//! Files of joints: JSON or separated values.

use std::collections::HashMap;

use serde::Deserialize;

use super::error::ReadError;
use crate::kernels::{
    geometry::mesh::Vec3,
    rigs::skeleton::{Skeleton, SkeletonError},
};

/// A joint as files give it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct JointEntry {
    pub name: String,
    /// The parent's name; roots have none.
    #[serde(default)]
    pub parent: Option<String>,
    pub position: [f64; 3],
}

/// Reads a skeleton; `extension` tells the format.
///
/// - `json`: an object with a list of joints under the key `list`, each with `name`, `parent` (a name
///   or null) and `position` (three numbers);
/// - others: a line `name,parent,x,y,z` a joint, an empty parent for roots. Commas, semicolons or tabs
///   separate; empty lines and those that begin with `#` or `name,` are skipped.
///
/// Joints may come in any order: parents are put before their children, apart from which the order of
/// the file stays.
///
/// # Errors
/// [`ReadError`] with the line or the joint.
pub fn read_skeleton(bytes: &[u8], extension: &str, list: &str) -> Result<Skeleton, ReadError> {
    let (format, joints) = match extension {
        "json" => ("JSON", from_json(bytes, list)?),
        _ => ("CSV", from_lines(bytes)?),
    };
    skeleton(format, joints)
}

fn from_json(bytes: &[u8], list: &str) -> Result<Vec<JointEntry>, ReadError> {
    let fail = |what: String| ReadError::content("JSON", what);
    let file: serde_json::Map<String, serde_json::Value> =
        serde_json::from_slice(bytes).map_err(|e| fail(e.to_string()))?;
    let Some(joints) = file.get(list) else {
        let lists = file.iter().filter(|it| it.1.is_array()).map(|it| format!("`{}`", it.0));
        let lists = lists.collect::<Vec<_>>().join(", ");
        return Err(fail(format!("there is no list `{list}` (lists: {lists})")));
    };
    let joints = joints.as_array().ok_or_else(|| fail(format!("`{list}` is no list")))?;
    let read = |(index, joint): (usize, &serde_json::Value)| {
        JointEntry::deserialize(joint).map_err(|e| fail(format!("joint {index} of `{list}`: {e}")))
    };
    joints.iter().enumerate().map(read).collect()
}

fn from_lines(bytes: &[u8]) -> Result<Vec<JointEntry>, ReadError> {
    let text = super::error::text("CSV", bytes)?;
    let lines = text.lines().enumerate().map(|(index, line)| (index + 1, line.trim()));
    let is_joint = |line: &str| {
        !line.is_empty() && !line.starts_with('#') && !line.to_lowercase().starts_with("name,")
    };
    lines.filter(|it| is_joint(it.1)).map(|(number, line)| from_line(number, line)).collect()
}

fn from_line(number: usize, line: &str) -> Result<JointEntry, ReadError> {
    let fields: Vec<&str> = line.split([',', ';', '\t']).map(str::trim).collect();
    let [name, parent, x, y, z] = fields[..] else {
        let what = format!("{} fields instead of name, parent, x, y, z", fields.len());
        return Err(ReadError::line("CSV", number, what));
    };
    let coordinate = |text: &str| {
        text.parse().map_err(|_| ReadError::line("CSV", number, format!("`{text}` is no number")))
    };
    Ok(JointEntry {
        name: name.to_owned(),
        parent: (!parent.is_empty()).then(|| parent.to_owned()),
        position: [coordinate(x)?, coordinate(y)?, coordinate(z)?],
    })
}

/// Puts parents before children and names into indices.
fn skeleton(format: &'static str, joints: Vec<JointEntry>) -> Result<Skeleton, ReadError> {
    let index: HashMap<&str, usize> =
        joints.iter().enumerate().map(|(index, it)| (it.name.as_str(), index)).collect();
    let mut parents = Vec::with_capacity(joints.len());
    for joint in &joints {
        let find = |name: &String| {
            index.get(name.as_str()).copied().ok_or_else(|| {
                let what = format!("joint `{}` has the unknown parent `{name}`", joint.name);
                ReadError::content(format, what)
            })
        };
        parents.push(joint.parent.as_ref().map(find).transpose()?);
    }
    let order = parents_first(&parents).ok_or_else(|| {
        ReadError::content(format, "the joints' parents go round in a circle".to_owned())
    })?;
    let mut new_of_old = vec![0; joints.len()];
    for (new, &old) in order.iter().enumerate() {
        new_of_old[old] = new;
    }
    let names = order.iter().map(|&it| joints[it].name.clone()).collect();
    let new_parents = order.iter().map(|&it| parents[it].map(|old| new_of_old[old])).collect();
    let positions = order.iter().map(|&it| Vec3::from(joints[it].position)).collect();
    Skeleton::new(names, new_parents, positions)
        .map_err(|error: SkeletonError| ReadError::Skeleton { format, error })
}

/// The joints so that parents come first, or nothing if they go round in a circle.
fn parents_first(parents: &[Option<usize>]) -> Option<Vec<usize>> {
    let mut placed = vec![false; parents.len()];
    let mut order = Vec::with_capacity(parents.len());
    while order.len() < parents.len() {
        let before = order.len();
        for (joint, parent) in parents.iter().enumerate() {
            if !placed[joint] && parent.is_none_or(|it| placed[it]) {
                placed[joint] = true;
                order.push(joint);
            }
        }
        if order.len() == before {
            return None;
        }
    }
    Some(order)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_and_lines_hold_the_same() {
        let json = br#"{"unit": "m", "joints": [
            {"name": "knee", "parent": "hip", "position": [0, 0.5, 0], "tail": [0, 0, 0]},
            {"name": "hip", "parent": null, "position": [0, 1, 0]}]}"#;
        let from_json = read_skeleton(json, "json", "joints").unwrap();
        assert_eq!(from_json.names(), ["hip", "knee"]);
        assert_eq!(from_json.parents(), [None, Some(0)]);
        let lines = b"name,parent,x,y,z\n# two\nknee,hip,0,0.5,0\nhip,,0,1,0\n";
        assert_eq!(read_skeleton(lines, "csv", "").unwrap(), from_json);
    }

    #[test]
    fn mistakes_are_named() {
        let check = |bytes: &[u8], extension: &str, expected: &str| {
            let error = read_skeleton(bytes, extension, "joints").unwrap_err().to_string();
            assert_eq!(error, expected);
        };
        check(
            br#"{"core_joints": []}"#,
            "json",
            "JSON file: there is no list `joints` (lists: `core_joints`)",
        );
        check(br#"{"joints": []}"#, "json", "JSON file: the skeleton has no joints");
        check(b"a,,1,2", "csv", "CSV file, line 1: 4 fields instead of name, parent, x, y, z");
        check(b"a,,1,2,q", "csv", "CSV file, line 1: `q` is no number");
        check(b"a,b,1,2,3", "csv", "CSV file: joint `a` has the unknown parent `b`");
        check(b"a,b,1,2,3\nb,a,0,0,0", "csv", "CSV file: the joints' parents go round in a circle");
        check(b"a,,1,2,3\na,,0,0,0", "csv", "CSV file: two joints have the name `a`");
        check(b"a,,1,2,inf", "csv", "CSV file: joint `a` has the coordinate inf");
    }
}
