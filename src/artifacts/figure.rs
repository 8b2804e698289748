use serde::{Deserialize, Serialize};

use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder, Format};
use crate::kernels::io::png::write_png;
use crate::kernels::pictures::figure::{Figure, Look, Mark, draw_png, write_svg};

/// What the header says of one mark.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MarkHead {
    /// So many of the array `points` follow.
    n_points: usize,
    look: Look,
}

/// What the header says of the whole.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneHead {
    title: String,
    width: usize,
    height: usize,
    marks: Vec<MarkHead>,
}

impl Artifact for Figure {
    const TYPE: ArtifactType = ArtifactType {
        name: "figure",
        version: 1,
        doc: "Figure: lines, areas, dots and texts (`scene`) at `points` (n x 2, in units of a screen's pixel, y downwards).",
    };

    const FORMATS: &'static [Format] = &[
        Format { extension: "png", doc: "Two pixels a unit." },
        Format { extension: "svg", doc: "With texts as texts." },
    ];

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        let head = |it: &Mark| MarkHead { n_points: it.points.len(), look: it.look.clone() };
        let scene = SceneHead {
            title: self.title.clone(),
            width: self.width,
            height: self.height,
            marks: self.marks.iter().map(head).collect(),
        };
        let points: Vec<f64> =
            self.marks.iter().flat_map(|it| &it.points).flatten().copied().collect();
        to.owned("points", &[points.len() / 2, 2], points);
        to.text("scene", serde_json::to_string(&scene).expect("scenes are plain data"));
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let scene: SceneHead = serde_json::from_str(from.text("scene")?)
            .map_err(|e| DecodeError(format!("`scene`: {e}")))?;
        let (n_points, n_columns, points) = from.matrix::<f64>("points")?;
        let n_expected = scene.marks.iter().try_fold(0usize, |n, it| n.checked_add(it.n_points));
        if n_columns != 2 || n_expected != Some(n_points) {
            return Err(DecodeError(format!("{n_points} x {n_columns} coordinates of points")));
        }
        let mut points = points.chunks_exact(2).map(|it| [it[0], it[1]]);
        let marks = (scene.marks.into_iter())
            .map(|it| Mark { points: points.by_ref().take(it.n_points).collect(), look: it.look })
            .collect();
        let figure = Self { title: scene.title, width: scene.width, height: scene.height, marks };
        figure.check().map_err(DecodeError)?;
        Ok(figure)
    }

    fn export(&self, extension: &str) -> Result<Vec<u8>, String> {
        match extension {
            "png" => Ok(write_png(&draw_png(self))),
            "svg" => Ok(write_svg(self).into_bytes()),
            _ => Err(format!("`figure` cannot be written as .{extension}")),
        }
    }

    fn summary(&self) -> Vec<(String, String)> {
        let texts: Vec<&str> = self.texts().collect();
        vec![
            ("size".to_owned(), format!("{} x {}", self.width, self.height)),
            ("marks".to_owned(), self.marks.len().to_string()),
            ("texts".to_owned(), texts.join(" · ")),
        ]
    }
}
