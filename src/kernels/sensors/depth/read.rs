//! Depth pictures: 16-bit PNG and floating-point EXR.

use std::io::Cursor;

use exr::prelude::{ReadChannels, ReadLayers, read};

use crate::kernels::io::ReadError;

/// One picture of depths.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthPicture {
    pub width: usize,
    pub height: usize,
    /// `height * width` metres; 0 where nothing was measured.
    pub depths: Vec<f32>,
}

/// Extensions that can be read, in lower case.
pub const EXTENSIONS: [&str; 2] = ["exr", "png"];

/// Reads a picture; the extension (in lower case, without dot) decides.
///
/// `metres_per_unit` is what one of a file's units means: 0.001 for the usual millimetres in PNG,
/// 1 for metres in EXR.
///
/// # Errors
/// [`ReadError`] if the file is damaged or holds no depths.
pub fn read_depth(
    extension: &str,
    bytes: &[u8],
    metres_per_unit: f64,
) -> Result<DepthPicture, ReadError> {
    match extension {
        "png" => read_depth_png(bytes, metres_per_unit),
        "exr" => read_depth_exr(bytes, metres_per_unit),
        _ => Err(ReadError::Unknown {
            extension: extension.to_owned(),
            known: EXTENSIONS.map(|it| format!("`.{it}`")).join(", "),
        }),
    }
}

/// Reads a grey PNG of 16 bits a pixel; 0 stands for no measurement.
fn read_depth_png(bytes: &[u8], metres_per_unit: f64) -> Result<DepthPicture, ReadError> {
    let wrong = |what: String| ReadError::Content { format: "png", what };
    if bytes.is_empty() {
        return Err(ReadError::Empty { format: "png" });
    }
    let mut reader =
        png::Decoder::new(Cursor::new(bytes)).read_info().map_err(|e| wrong(e.to_string()))?;
    let info = reader.info();
    let (width, height) = (info.width as usize, info.height as usize);
    let (color, bits) = (info.color_type, info.bit_depth);
    if (color, bits) != (png::ColorType::Grayscale, png::BitDepth::Sixteen) {
        return Err(wrong(format!("depths are 16-bit grey, but this is {bits:?}-bit {color:?}")));
    }
    let size =
        reader.output_buffer_size().ok_or_else(|| wrong("the picture is too large".into()))?;
    let mut data = vec![0; size];
    reader.next_frame(&mut data).map_err(|e| wrong(e.to_string()))?;
    let metres = |it: &[u8; 2]| (f64::from(u16::from_be_bytes(*it)) * metres_per_unit) as f32;
    let depths = data.as_chunks::<2>().0.iter().map(metres).collect();
    Ok(DepthPicture { width, height, depths })
}

/// Reads the channel `Z`, or else the only channel or `R`, of the first layer that has it.
///
/// What is not finite, not positive or at least 65504 (the largest half, which renderers write for
/// the background) is no measurement.
fn read_depth_exr(bytes: &[u8], metres_per_unit: f64) -> Result<DepthPicture, ReadError> {
    let wrong = |what: String| ReadError::Content { format: "exr", what };
    if bytes.is_empty() {
        return Err(ReadError::Empty { format: "exr" });
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| wrong(e.to_string()))?;
    let layer = image.layer_data;
    let channels = &layer.channel_data.list;
    let named = |name: &str| channels.iter().find(|it| it.name.to_string() == name);
    let only = if channels.len() == 1 { channels.first() } else { None };
    let channel = named("Z").or(only).or_else(|| named("R")).ok_or_else(|| {
        let names: Vec<String> = channels.iter().map(|it| format!("`{}`", it.name)).collect();
        wrong(format!("there is no channel `Z` among {}", names.join(", ")))
    })?;
    let metres = |it: f32| match it.is_finite() && it > 0.0 && it < 65504.0 {
        true => (f64::from(it) * metres_per_unit) as f32,
        false => 0.0,
    };
    let depths: Vec<f32> = channel.sample_data.values_as_f32().map(metres).collect();
    let (width, height) = (layer.size.width(), layer.size.height());
    if depths.len() != width * height {
        return Err(wrong(format!("{} samples for {width} x {height} pixels", depths.len())));
    }
    Ok(DepthPicture { width, height, depths })
}

/// Writes a grey PNG of 16 bits a pixel, in millimetres; what is beyond 65.535 m is left out.
///
/// # Panics
/// If the depths are not `height * width`.
pub fn write_depth_png(width: usize, height: usize, depths: &[f32]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let mut writer = encoder.write_header().expect("writing to memory does not fail");
    let unit = |it: &f32| match (f64::from(*it) * 1000.0).round() {
        it if it <= 65535.0 => it as u16,
        _ => 0,
    };
    let data: Vec<u8> = depths.iter().flat_map(|it| unit(it).to_be_bytes()).collect();
    writer.write_image_data(&data).expect("width times height depths");
    writer.finish().expect("writing to memory does not fail");
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_png_reads_back_to_the_millimetre() {
        let depths = [0.0, 0.001, 1.2345, 65.535, 70.0, 3.0];
        let bytes = write_depth_png(3, 2, &depths);
        let picture = read_depth("png", &bytes, 0.001).unwrap();
        assert_eq!((picture.width, picture.height), (3, 2));
        assert_eq!(picture.depths, [0.0, 0.001, 1.235, 65.535, 0.0, 3.0]);
    }

    #[test]
    fn an_exr_keeps_its_floats_and_drops_the_background() {
        let depths = [0.5_f32, 1.25, f32::INFINITY, 65504.0, -1.0, 2.625];
        let picture = exr_of("Z", depths);
        assert_eq!((picture.width, picture.height), (3, 2));
        assert_eq!(picture.depths, [0.5, 1.25, 0.0, 0.0, 0.0, 2.625]);
        assert_eq!(exr_of("depth", depths), picture);
    }

    fn exr_of(name: &str, depths: [f32; 6]) -> DepthPicture {
        use exr::prelude::*;
        let channel = AnyChannel::new(name, FlatSamples::F32(depths.to_vec()));
        let channels = AnyChannels::sort([channel].into_iter().collect());
        let layer =
            Layer::new((3, 2), LayerAttributes::named("depth"), Encoding::FAST_LOSSLESS, channels);
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).unwrap();
        read_depth("exr", bytes.get_ref(), 1.0).unwrap()
    }

    #[test]
    fn a_truncated_file_is_an_error_at_every_length() {
        let bytes = write_depth_png(8, 8, &[1.5; 64]);
        for length in 0..bytes.len() - 20 {
            assert!(read_depth("png", &bytes[..length], 0.001).is_err(), "{length} bytes");
        }
        let grey = crate::kernels::image::Image { width: 1, height: 1, pixels: vec![[1; 3]] };
        let error =
            read_depth("png", &crate::kernels::io::png::write_png(&grey), 0.001).unwrap_err();
        assert_eq!(
            error.to_string(),
            "png file: depths are 16-bit grey, but this is Eight-bit Rgb"
        );
        assert!(read_depth("exr", &bytes, 1.0).is_err());
        assert!(read_depth("tif", &bytes, 1.0).is_err());
    }
}
