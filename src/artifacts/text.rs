use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder, Format};
use crate::kernels::text::Text;

impl Artifact for Text {
    const TYPE: ArtifactType =
        ArtifactType { name: "text", version: 1, doc: "Text: `utf8`, its bytes." };

    const FORMATS: &'static [Format] = &[Format { extension: "txt", doc: "The text itself." }];

    const IMPORTS: &'static [&'static str] = &["txt"];

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        to.array("utf8", &[self.0.len()], self.0.as_bytes());
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        Self::import("txt", &from.vector::<u8>("utf8")?).map_err(DecodeError)
    }

    fn summary(&self) -> Vec<(String, String)> {
        let mut lines = vec![
            ("bytes".to_owned(), self.0.len().to_string()),
            ("lines".to_owned(), self.0.lines().count().to_string()),
        ];
        let shown = self.0.lines().enumerate().take(20);
        lines.extend(shown.map(|(index, line)| ((index + 1).to_string(), line.to_owned())));
        lines
    }

    fn export(&self, extension: &str) -> Result<Vec<u8>, String> {
        match extension {
            "txt" => Ok(self.0.clone().into_bytes()),
            _ => Err(format!("a text cannot be written as .{extension}")),
        }
    }

    fn import(_extension: &str, bytes: &[u8]) -> Result<Self, String> {
        match std::str::from_utf8(bytes) {
            Ok(text) => Ok(Self(text.to_owned())),
            Err(error) => Err(format!("byte {} is no UTF-8", error.valid_up_to())),
        }
    }
}
