//! Kind `load_depth`.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::node::{
    InputFile, Node, NodeError, NodeIo, OptionalInput, OptionalOutput, Output, Spec, extension_of,
};
use crate::kernels::files::FileSet;
use crate::kernels::geometry::mesh_sequence::MeshSequence;
use crate::kernels::io::anime::read_anime;
use crate::kernels::sensors::depth::files::{CameraNotes, video_of};
use crate::kernels::sensors::depth::names::{missing_pictures, natural_order};
use crate::kernels::sensors::depth::{DepthVideo, read::EXTENSIONS};

/// Reads a depth video: pictures of a folder in the order of their names.
///
/// Numbers in names count as numbers (`9.png` comes before `10.png`); a note tells where some are missing.
/// 16-bit grey PNG in millimetres (or `depth_unit_mm` of them) or EXR in metres, channel `Z`; 0 is no
/// measurement. `path` names a JSON file of notes beside the folder with the camera's `fx`, `fy`,
/// `cx`, `cy` (pixels), `fps` and `depth_unit_mm`; parameters of these names come before the notes.
/// Or `files` is wired to a download of the pictures, with or without a `.json` file.
#[derive(Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LoadDepth {
    /// The JSON file of notes, relative to the pipeline file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub path: Option<InputFile>,
    /// The folder of the pictures, beside the notes; `depth` if it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folder: Option<String>,
    /// The true surface in camera space, a `.anime` file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<InputFile>,
    /// The first picture that is read.
    pub first: usize,
    /// How many pictures are read at most; all if it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1))]
    pub count: Option<usize>,
    /// Focal length in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fx: Option<f64>,
    /// Focal length in pixels; as `fx` if nothing else is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fy: Option<f64>,
    /// Principal point in pixels; the middle of the picture if nothing else is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cx: Option<f64>,
    /// Principal point in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cy: Option<f64>,
    /// Frames a second; 30 if nothing else is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fps: Option<f64>,
    /// Millimetres in one unit of a PNG; 1 if nothing else is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_unit_mm: Option<f64>,
}

/// Names and bytes.
type Pictures = Vec<(String, Vec<u8>)>;

impl LoadDepth {
    const FILES: OptionalInput<FileSet> =
        OptionalInput::new("files", "downloaded pictures, instead of `path`");
    const VIDEO: Output<DepthVideo> = Output::new("video", "the frames");
    const TRUTH: OptionalOutput<MeshSequence> =
        OptionalOutput::new("truth", "the true surface of the same frames");

    fn given(&self) -> CameraNotes {
        let Self { fx, fy, cx, cy, fps, depth_unit_mm, .. } = *self;
        CameraNotes { fx, fy, cx, cy, fps, depth_unit_mm }
    }

    /// The pictures beside a file of notes, in their order.
    fn pictures_beside(&self, notes: &Path) -> Vec<PathBuf> {
        let folder = notes.with_file_name(self.folder.as_deref().unwrap_or("depth"));
        let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
            .map(|entries| entries.filter_map(|it| Some(it.ok()?.path())).collect())
            .unwrap_or_default();
        paths.retain(|it| EXTENSIONS.contains(&extension_of(it).as_str()));
        let name = |it: &PathBuf| it.file_name().unwrap_or_default().to_string_lossy().into_owned();
        paths.sort_by(|a, b| natural_order(&name(a), &name(b)));
        paths
    }

    /// Those of the pictures that are read.
    fn chosen<T>(&self, pictures: impl Iterator<Item = T>) -> Vec<T> {
        pictures.skip(self.first).take(self.count.unwrap_or(usize::MAX)).collect()
    }

    /// The pictures and the notes.
    fn read(&self, io: &NodeIo<'_>) -> Result<(Pictures, CameraNotes), NodeError> {
        match (&self.path, io.get_optional(Self::FILES)) {
            (Some(InputFile(path)), None) => {
                let notes = CameraNotes::from_json(&io.read(path)?)
                    .map_err(|e| NodeError::failed(format!("`{}`: {e}", path.display())))?;
                let read = |it: PathBuf| {
                    let bytes = std::fs::read(&it).map_err(|e| {
                        NodeError::environment(format!("cannot read `{}`: {e}", it.display()))
                    })?;
                    Ok((it.file_name().unwrap_or_default().to_string_lossy().into_owned(), bytes))
                };
                let paths = self.chosen(self.pictures_beside(io.path(path)).into_iter());
                let pictures = paths.into_iter().map(read).collect::<Result<_, NodeError>>()?;
                Ok((pictures, self.given().or(notes)))
            }
            (None, Some(files)) => {
                let is = |name: &str, extensions: &[&str]| {
                    extensions.contains(&extension_of(Path::new(name)).as_str())
                };
                let notes = match files.files.iter().find(|it| is(it.0, &["json"])) {
                    Some((name, bytes)) => CameraNotes::from_json(bytes)
                        .map_err(|e| NodeError::failed(format!("`{name}`: {e}")))?,
                    None => CameraNotes::default(),
                };
                let mut pictures: Vec<_> =
                    files.files.iter().filter(|it| is(it.0, &EXTENSIONS)).collect();
                pictures.sort_by(|a, b| natural_order(a.0, b.0));
                let pictures = pictures.into_iter().map(|(k, v)| (k.clone(), v.clone()));
                let pictures = self.chosen(pictures);
                Ok((pictures, self.given().or(notes)))
            }
            _ => Err(NodeError::failed("give either the parameter `path` or the wire `files`")),
        }
    }

    /// The true surface in the frames that are read.
    fn read_truth(
        &self,
        io: &NodeIo<'_>,
        video: &DepthVideo,
    ) -> Result<Option<MeshSequence>, NodeError> {
        let Some(InputFile(path)) = &self.truth else { return Ok(None) };
        let all = read_anime(&io.read(path)?, video.frames_per_second())
            .map_err(|e| NodeError::failed(format!("`{}`: {e}", path.display())))?;
        let (first, n_frames) = (self.first, video.n_frames());
        if all.n_frames() < first + n_frames {
            return Err(NodeError::failed(format!(
                "the video has frames {first} to {}, but `truth` has {} frames",
                first + n_frames - 1,
                all.n_frames()
            )));
        }
        let frames = (first..first + n_frames).map(|it| all.frame(it).to_vec()).collect();
        let rate = video.frames_per_second();
        Ok(Some(MeshSequence::from_frames(frames, all.faces().to_vec(), rate)?))
    }
}

impl Node for LoadDepth {
    const SPEC: Spec = Spec {
        kind: "load_depth",
        version: 2,
        inputs: &[Self::FILES.port()],
        outputs: &[Self::VIDEO.port(), Self::TRUTH.port()],
        cites: &[],
        example: "[nodes.video]\nkind = \"load_depth\"\npath = \"kinect.json\"\n",
    };

    fn files(&self) -> Vec<(&'static str, &InputFile)> {
        let path = self.path.iter().map(|it| ("path", it));
        path.chain(self.truth.iter().map(|it| ("truth", it))).collect()
    }

    fn side_files(&self, path: &Path) -> Vec<PathBuf> {
        match extension_of(path).as_str() {
            "json" => self.pictures_beside(path),
            _ => Vec::new(),
        }
    }

    fn run(&self, io: &mut NodeIo<'_>) -> Result<(), NodeError> {
        let (pictures, notes) = self.read(io)?;
        let video = video_of(&pictures, &notes)?;
        if let Some(note) = missing_pictures(pictures.iter().map(|it| it.0.as_str())) {
            io.note(note);
        }
        let truth = self.read_truth(io, &video)?;
        io.put(Self::VIDEO, video);
        io.put_optional(Self::TRUTH, truth, "no `truth` was given");
        Ok(())
    }
}
