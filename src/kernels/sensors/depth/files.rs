//! A depth video from a folder of pictures.

use rayon::prelude::*;
use serde::Deserialize;

use super::read::{DepthPicture, read_depth};
use super::{DepthError, DepthVideo, Intrinsics};
use crate::kernels::io::ReadError;

/// What a recording says about its camera; each can be missing.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
pub struct CameraNotes {
    pub fx: Option<f64>,
    pub fy: Option<f64>,
    pub cx: Option<f64>,
    pub cy: Option<f64>,
    pub fps: Option<f64>,
    /// Millimetres in one unit of a PNG.
    pub depth_unit_mm: Option<f64>,
}

impl CameraNotes {
    /// Reads the notes from JSON; other fields do not matter.
    ///
    /// # Errors
    /// [`ReadError`] with the line.
    pub fn from_json(bytes: &[u8]) -> Result<Self, ReadError> {
        serde_json::from_slice(bytes).map_err(|e| ReadError::Line {
            format: "json",
            line: e.line(),
            what: e.to_string(),
        })
    }

    /// These notes, and others where these are silent.
    pub fn or(self, other: Self) -> Self {
        Self {
            fx: self.fx.or(other.fx),
            fy: self.fy.or(other.fy),
            cx: self.cx.or(other.cx),
            cy: self.cy.or(other.cy),
            fps: self.fps.or(other.fps),
            depth_unit_mm: self.depth_unit_mm.or(other.depth_unit_mm),
        }
    }
}

/// Why a folder holds no depth video.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FilesError {
    #[error("there are no pictures (.png or .exr)")]
    NoPictures,
    #[error("`{name}`: {error}")]
    Read { name: String, error: ReadError },
    #[error(
        "`{name}` has {width} x {height} pixels, but the first picture {first_width} x {first_height}"
    )]
    Size { name: String, width: usize, height: usize, first_width: usize, first_height: usize },
    #[error("the camera's `{name}` is not known: give it, or a file of notes that has it")]
    Unknown { name: &'static str },
    #[error("`depth_unit_mm` is {value}")]
    Unit { value: f64 },
    #[error(transparent)]
    Depth(#[from] DepthError),
}

/// Puts named pictures, in their order, together to a video.
///
/// The principal point is the middle of the picture if it is not noted, the rate 30 frames a second.
///
/// # Errors
/// See [`FilesError`].
pub fn video_of(
    pictures: &[(String, Vec<u8>)],
    notes: &CameraNotes,
) -> Result<DepthVideo, FilesError> {
    let unit_mm = notes.depth_unit_mm.unwrap_or(1.0);
    if !(unit_mm > 0.0 && unit_mm.is_finite()) {
        return Err(FilesError::Unit { value: unit_mm });
    }
    let read = |(name, bytes): &(String, Vec<u8>)| {
        let extension = name.rsplit('.').next().unwrap_or_default().to_lowercase();
        let unit = if extension == "png" { unit_mm / 1000.0 } else { 1.0 };
        read_depth(&extension, bytes, unit)
            .map_err(|error| FilesError::Read { name: name.clone(), error })
    };
    let read: Vec<DepthPicture> = pictures.par_iter().map(read).collect::<Result<_, _>>()?;
    let first = read.first().ok_or(FilesError::NoPictures)?;
    let (first_width, first_height) = (first.width, first.height);
    for (picture, (name, _)) in read.iter().zip(pictures) {
        let (width, height) = (picture.width, picture.height);
        if (width, height) != (first_width, first_height) {
            let name = name.clone();
            return Err(FilesError::Size { name, width, height, first_width, first_height });
        }
    }
    let known = |name, value: Option<f64>| value.ok_or(FilesError::Unknown { name });
    let intrinsics = Intrinsics {
        fx: known("fx", notes.fx)?,
        fy: known("fy", notes.fy.or(notes.fx))?,
        cx: notes.cx.unwrap_or((first_width as f64 - 1.0) / 2.0),
        cy: notes.cy.unwrap_or((first_height as f64 - 1.0) / 2.0),
    };
    let frames = read.into_iter().map(|it| it.depths).collect();
    let rate = notes.fps.unwrap_or(30.0);
    Ok(DepthVideo::new([first_width, first_height], intrinsics, rate, frames)?)
}

#[cfg(test)]
mod tests {
    use super::super::read::write_depth_png;
    use super::*;

    fn named(name: &str, width: usize, height: usize, depth: f32) -> (String, Vec<u8>) {
        (name.to_owned(), write_depth_png(width, height, &vec![depth; width * height]))
    }

    #[test]
    fn pictures_and_notes_make_a_video() {
        let notes =
            CameraNotes::from_json(br#"{"fx": 500.0, "cy": 3.0, "fps": 15, "R": [[1]]}"#).unwrap();
        let video =
            video_of(&[named("0.png", 4, 3, 1.5), named("1.png", 4, 3, 0.0)], &notes).unwrap();
        assert_eq!((video.n_frames(), video.frames_per_second()), (2, 15.0));
        let expected = Intrinsics { fx: 500.0, fy: 500.0, cx: 1.5, cy: 3.0 };
        assert_eq!(video.intrinsics(), expected);
        assert_eq!(video.frame(0)[0], 1.5);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_file() {
        let notes = CameraNotes { fx: Some(500.0), ..CameraNotes::default() };
        let check = |pictures: &[(String, Vec<u8>)], notes: &CameraNotes, expected: &str| {
            let error = video_of(pictures, notes).unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        };
        check(&[], &notes, "there are no pictures");
        let sizes = [named("a.png", 4, 3, 1.0), named("b.png", 4, 4, 1.0)];
        check(&sizes, &notes, "`b.png` has 4 x 4 pixels, but the first picture 4 x 3");
        let (name, mut bytes) = named("c.png", 4, 3, 1.0);
        bytes.truncate(bytes.len() / 2);
        check(&[(name, bytes)], &notes, "`c.png`: png file: ");
        let one = [named("d.png", 4, 3, 1.0)];
        check(&one, &CameraNotes::default(), "the camera's `fx` is not known");
        let nan = CameraNotes { fx: Some(f64::NAN), ..notes };
        check(&one, &nan, "`fx` is NaN");
        assert!(CameraNotes::from_json(b"{\"fx\": }").is_err());
    }
}
