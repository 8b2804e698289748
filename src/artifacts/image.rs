use crate::engine::artifact::{Artifact, ArtifactType, DecodeError, Decoder, Encoder, Format};
use crate::kernels::{image::Image, io::png::write_png};

impl Artifact for Image {
    const TYPE: ArtifactType = ArtifactType {
        name: "image",
        version: 1,
        doc: "Picture: `pixels` (height x width*3 bytes, sRGB, rows from the top).",
    };
    const FORMATS: &'static [Format] = &[Format { extension: "png", doc: "8-bit sRGB picture" }];

    fn encode<'a>(&'a self, to: &mut Encoder<'a>) {
        let bytes: &[u8] = bytemuck::cast_slice(&self.pixels);
        to.array("pixels", &[self.height, self.width * 3], bytes);
    }

    fn decode(from: &Decoder<'_>) -> Result<Self, DecodeError> {
        let (height, columns, bytes) = from.matrix::<u8>("pixels")?;
        if columns % 3 != 0 {
            return Err(DecodeError(format!("{columns} bytes a row are no pixels")));
        }
        let pixels = bytes.chunks_exact(3).map(|it| [it[0], it[1], it[2]]).collect();
        Ok(Self { width: columns / 3, height, pixels })
    }

    fn summary(&self) -> Vec<(String, String)> {
        vec![("size".to_owned(), format!("{} x {}", self.width, self.height))]
    }

    fn export(&self, extension: &str) -> Result<Vec<u8>, String> {
        match extension {
            "png" => Ok(write_png(self)),
            _ => Err(format!("`image` cannot be written as .{extension}")),
        }
    }
}
