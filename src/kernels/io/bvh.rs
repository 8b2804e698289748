//! Motion capture in Biovision's format (`.bvh`): a hierarchy of joints and their channels, frame by
//! frame.

use nalgebra::UnitQuaternion;

use super::error::{ReadError, text};
use crate::kernels::{
    geometry::mesh::Vec3,
    rigs::{clip::Clip, skeleton::Skeleton},
};

const FORMAT: &str = "BVH";

/// What a `.bvh` file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// The joints as the file's offsets put them; ends of bones are no joints.
    pub skeleton: Skeleton,
    pub clip: Clip,
}

/// Reads a motion. Coordinates are multiplied by `scale`.
///
/// Channels come in the order of the file: `Zrotation Xrotation Yrotation` is `Rz Rx Ry`, in degrees. A
/// joint with channels of position moves to its offset plus these, or, if it has a parent, to these in
/// place of the offset.
///
/// # Errors
/// [`ReadError`] with the line: unknown words, wrong counts, values that are no finite numbers.
pub fn read_bvh(bytes: &[u8], scale: f64) -> Result<Motion, ReadError> {
    let mut tokens = Tokens::new(text(FORMAT, bytes)?);
    tokens.expect("HIERARCHY")?;
    let joints = hierarchy(&mut tokens)?;
    let skeleton = skeleton(&joints, scale)?;
    let clip = motion(&mut tokens, &joints, scale)?;
    Ok(Motion { skeleton, clip })
}

/// A joint of the hierarchy.
struct Joint {
    name: String,
    parent: Option<usize>,
    offset: Vec3,
    channels: Vec<Channel>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Channel {
    Position(usize),
    Rotation(usize),
}

/// Words and the lines they stand in.
struct Tokens<'a> {
    words: std::iter::Peekable<Box<dyn Iterator<Item = (usize, &'a str)> + 'a>>,
    line: usize,
}

impl<'a> Tokens<'a> {
    fn new(text: &'a str) -> Self {
        let words = text
            .lines()
            .enumerate()
            .flat_map(|(line, it)| it.split_whitespace().map(move |word| (line + 1, word)));
        let words: Box<dyn Iterator<Item = (usize, &'a str)>> = Box::new(words);
        Self { words: words.peekable(), line: 1 }
    }

    fn fail(&self, what: impl Into<String>) -> ReadError {
        ReadError::line(FORMAT, self.line, what)
    }

    fn next(&mut self, wanted: &str) -> Result<&'a str, ReadError> {
        let (line, word) = self
            .words
            .next()
            .ok_or_else(|| self.fail(format!("the file ends where {wanted} should stand")))?;
        self.line = line;
        Ok(word)
    }

    fn expect(&mut self, wanted: &str) -> Result<(), ReadError> {
        let word = self.next(&format!("`{wanted}`"))?;
        if word.eq_ignore_ascii_case(wanted) {
            return Ok(());
        }
        Err(self.fail(format!("`{word}` instead of `{wanted}`")))
    }

    fn number(&mut self, wanted: &str) -> Result<f64, ReadError> {
        let word = self.next(wanted)?;
        let value: Option<f64> = word.parse().ok().filter(|it: &f64| it.is_finite());
        value.ok_or_else(|| self.fail(format!("`{word}` instead of {wanted}")))
    }

    fn count(&mut self, wanted: &str) -> Result<usize, ReadError> {
        let word = self.next(wanted)?;
        word.parse().map_err(|_| self.fail(format!("`{word}` instead of {wanted}")))
    }

    fn vector(&mut self, wanted: &str) -> Result<Vec3, ReadError> {
        Ok(Vec3::new(self.number(wanted)?, self.number(wanted)?, self.number(wanted)?))
    }

    /// Words up to a brace: names may hold spaces.
    fn name(&mut self) -> Result<String, ReadError> {
        let mut words = Vec::new();
        while self.words.peek().is_some_and(|it| it.1 != "{") {
            words.push(self.next("a name")?);
        }
        self.expect("{")?;
        if words.is_empty() {
            return Err(self.fail("a joint has no name"));
        }
        Ok(words.join(" "))
    }
}

/// Reads joints up to the word `MOTION`, which is taken as well.
fn hierarchy(tokens: &mut Tokens<'_>) -> Result<Vec<Joint>, ReadError> {
    let mut joints: Vec<Joint> = Vec::new();
    // The joints whose braces are open.
    let mut open: Vec<usize> = Vec::new();
    loop {
        let word = tokens.next("a joint, `}` or `MOTION`")?;
        match word.to_ascii_uppercase().as_str() {
            "ROOT" | "JOINT" => {
                let name = tokens.name()?;
                let parent = open.last().copied();
                open.push(joints.len());
                joints.push(Joint { name, parent, offset: Vec3::zeros(), channels: Vec::new() });
            }
            "END" => {
                tokens.name()?;
                tokens.expect("OFFSET")?;
                tokens.vector("an offset")?;
                tokens.expect("}")?;
            }
            "OFFSET" => {
                let offset = tokens.vector("an offset")?;
                inside(tokens, &mut joints, &open)?.offset = offset;
            }
            "CHANNELS" => {
                let n_channels = tokens.count("a number of channels")?;
                let channels =
                    (0..n_channels).map(|_| channel(tokens)).collect::<Result<_, _>>()?;
                inside(tokens, &mut joints, &open)?.channels = channels;
            }
            "}" => {
                open.pop().ok_or_else(|| tokens.fail("a `}` too many"))?;
            }
            "MOTION" if open.is_empty() => return Ok(joints),
            "MOTION" => return Err(tokens.fail(format!("{} `}}` too few", open.len()))),
            _ => return Err(tokens.fail(format!("the word `{word}` is unknown here"))),
        }
    }
}

fn inside<'a>(
    tokens: &Tokens<'_>,
    joints: &'a mut [Joint],
    open: &[usize],
) -> Result<&'a mut Joint, ReadError> {
    match open.last() {
        Some(&joint) => Ok(&mut joints[joint]),
        None => Err(tokens.fail("this stands outside of a joint")),
    }
}

fn channel(tokens: &mut Tokens<'_>) -> Result<Channel, ReadError> {
    let word = tokens.next("a channel")?.to_ascii_lowercase();
    let axis = ["x", "y", "z"].iter().position(|it| word.starts_with(it));
    match (axis, word.get(1..)) {
        (Some(axis), Some("position")) => Ok(Channel::Position(axis)),
        (Some(axis), Some("rotation")) => Ok(Channel::Rotation(axis)),
        _ => Err(tokens.fail(format!("the channel `{word}` is unknown"))),
    }
}

fn skeleton(joints: &[Joint], scale: f64) -> Result<Skeleton, ReadError> {
    let mut positions: Vec<Vec3> = Vec::with_capacity(joints.len());
    for joint in joints {
        let parent = joint.parent.map_or_else(Vec3::zeros, |it| positions[it]);
        positions.push(parent + joint.offset * scale);
    }
    let names = joints.iter().map(|it| it.name.clone()).collect();
    let parents = joints.iter().map(|it| it.parent).collect();
    Skeleton::new(names, parents, positions)
        .map_err(|error| ReadError::Skeleton { format: FORMAT, error })
}

fn motion(tokens: &mut Tokens<'_>, joints: &[Joint], scale: f64) -> Result<Clip, ReadError> {
    tokens.expect("Frames:")?;
    let n_frames = tokens.count("a number of frames")?;
    tokens.expect("Frame")?;
    tokens.expect("Time:")?;
    let seconds = tokens.number("the time of a frame")?;
    if !(seconds > 0.0) {
        return Err(tokens.fail(format!("a frame takes {seconds} seconds")));
    }
    let mut clip = Clip {
        name: "motion".to_owned(),
        frames_per_second: 1.0 / seconds,
        n_joints: joints.len(),
        rotations: Vec::new(),
        translations: Vec::new(),
    };
    for frame in 0..n_frames {
        for joint in joints {
            let wanted = format!("a value of frame {frame}, joint `{}`", joint.name);
            let (rotation, position) = pose(tokens, joint, &wanted)?;
            clip.rotations.push(rotation);
            clip.translations.push(position * scale);
        }
    }
    match tokens.words.next() {
        Some((line, word)) => {
            let what = format!("`{word}` after the last of {n_frames} frames");
            Err(ReadError::line(FORMAT, line, what))
        }
        None => Ok(clip),
    }
}

/// One joint in one frame: its rotation against and its offset from the parent.
fn pose(
    tokens: &mut Tokens<'_>,
    joint: &Joint,
    wanted: &str,
) -> Result<(UnitQuaternion<f64>, Vec3), ReadError> {
    let mut rotation = UnitQuaternion::identity();
    let mut position = joint.offset;
    for channel in &joint.channels {
        let value = tokens.number(wanted)?;
        match *channel {
            Channel::Position(axis) if joint.parent.is_none() => position[axis] += value,
            Channel::Position(axis) => position[axis] = value,
            Channel::Rotation(axis) => {
                rotation *= UnitQuaternion::new(Vec3::ith(axis, value.to_radians()));
            }
        }
    }
    Ok((rotation, position))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::motion::fit_clip::world_positions;

    const ARM: &str = "HIERARCHY
ROOT Hips
{
\tOFFSET 0 1 0
\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
\tJOINT Left Arm
\t{
\t\tOFFSET 2 0 0
\t\tCHANNELS 3 Zrotation Yrotation Xrotation
\t\tEnd Site
\t\t{
\t\t\tOFFSET 1 0 0
\t\t}
\t}
}
MOTION
Frames: 2
Frame Time: 0.025
0 0 0 0 0 0 0 0 0
1 0 0 90 0 0 90 90 0
";

    #[test]
    fn a_motion_by_hand() {
        let Motion { skeleton, clip } = read_bvh(ARM.as_bytes(), 0.5).unwrap();
        assert_eq!(skeleton.names(), ["Hips", "Left Arm"]);
        assert_eq!(skeleton.positions(), [Vec3::new(0.0, 0.5, 0.0), Vec3::new(1.0, 0.5, 0.0)]);
        assert_eq!((clip.n_frames(), clip.frames_per_second), (2, 40.0));
        assert_eq!(world_positions(&clip, 0, skeleton.parents()), skeleton.positions());
        let posed = world_positions(&clip, 1, skeleton.parents());
        assert!((posed[0] - Vec3::new(0.5, 0.5, 0.0)).norm() < 1e-12);
        assert!((posed[1] - Vec3::new(0.5, 1.5, 0.0)).norm() < 1e-12);
        // Rz Ry takes what points along +Z first to +X, then to +Y.
        let turned = clip.rotations[3] * Vec3::z();
        assert!((turned - Vec3::y()).norm() < 1e-12, "{turned}");
    }

    #[test]
    fn mistakes_have_their_line() {
        let check = |from: &str, to: &str, expected: &str| {
            let error = read_bvh(ARM.replacen(from, to, 1).as_bytes(), 1.0).unwrap_err();
            assert_eq!(error.to_string(), format!("BVH file, {expected}"));
        };
        check("HIERARCHY", "HIERACHY", "line 1: `HIERACHY` instead of `HIERARCHY`");
        check("Xposition", "Wposition", "line 5: the channel `wposition` is unknown");
        check("OFFSET 2 0 0", "OFFSET 2 0 x", "line 8: `x` instead of an offset");
        check("}\nMOTION", "MOTION", "line 15: 1 `}` too few");
        check("0.025", "0", "line 18: a frame takes 0 seconds");
        check(
            "1 0 0 90 0 0 90 90 0\n",
            "1 0 0 90\n",
            "line 20: the file ends where a value of frame 1, joint `Hips` should stand",
        );
        check("90 90 0\n", "90 90 0 7\n", "line 20: `7` after the last of 2 frames");
        check(
            "90 90 0\n",
            "90 90 nan\n",
            "line 20: `nan` instead of a value of frame 1, joint `Left Arm`",
        );
    }

    #[test]
    fn all_motions_of_the_corpus_are_read() {
        let folder = std::path::Path::new("../shared/data/mocap");
        let Ok(entries) = std::fs::read_dir(folder) else {
            return eprintln!("skipped: `{}` is not there", folder.display());
        };
        let mut n_read = 0;
        for path in entries.map(|it| it.unwrap().path()) {
            if path.extension().is_some_and(|it| it == "bvh") {
                let motion = read_bvh(&std::fs::read(&path).unwrap(), 1.0);
                let motion = motion.unwrap_or_else(|e| panic!("{}: {e}", path.display()));
                assert!(motion.clip.n_frames() > 40 && motion.skeleton.n_joints() > 20);
                n_read += 1;
            }
        }
        assert!(n_read > 5, "{n_read}");
    }
}
