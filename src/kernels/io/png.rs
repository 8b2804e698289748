//! PNG files.

use crate::kernels::image::Image;

/// Writes an 8-bit sRGB PNG. The same picture gives the same bytes.
pub fn write_png(image: &Image) -> Vec<u8> {
    let mut bytes = Vec::new();
    let (width, height) = (image.width as u32, image.height as u32);
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_compression(png::Compression::Balanced);
    let mut writer = encoder.write_header().expect("writing to memory does not fail");
    writer
        .write_image_data(bytemuck::cast_slice(&image.pixels))
        .expect("a picture has width times height pixels");
    writer.finish().expect("writing to memory does not fail");
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_written_picture_reads_back() {
        let pixels: Vec<[u8; 3]> = (0..=255).map(|it| [it, 255 - it, it / 2]).collect();
        let image = Image { width: 32, height: 8, pixels };
        let bytes = write_png(&image);
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        assert_eq!(reader.info().size(), (32, 8));
        let mut read = vec![0; 32 * 8 * 3];
        reader.next_frame(&mut read).unwrap();
        assert_eq!(read, bytemuck::cast_slice::<_, u8>(&image.pixels));
    }
}
