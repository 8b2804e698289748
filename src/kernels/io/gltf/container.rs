//! From bytes to a validated document and its buffers.

use gltf::{
    Document,
    buffer::Source,
    json::{Root, deserialize, mesh::Semantic, validation::Checked},
};

use super::FORMAT;
use crate::kernels::{
    files::check_relative,
    io::{error::ReadError, uri::percent_decoded},
};

/// Opens a `.glb` or `.gltf`.
pub fn open(
    bytes: &[u8],
    side_file: &dyn Fn(&str) -> Option<Vec<u8>>,
) -> Result<(Document, Vec<Vec<u8>>), ReadError> {
    let (json, blob) = chunks(bytes)?;
    let document = parse(json)?;
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let index = buffer.index();
        let fail = |what: String| ReadError::content(FORMAT, format!("buffer {index}: {what}"));
        let data = match buffer.source() {
            Source::Bin => {
                blob.ok_or_else(|| fail("the file has no binary chunk".to_owned()))?.to_vec()
            }
            Source::Uri(uri) => match uri.split_once(";base64,") {
                Some((_, data)) if uri.starts_with("data:") => {
                    base64(data).ok_or_else(|| fail("the data is no base64".to_owned()))?
                }
                _ => {
                    let name = file_name(uri);
                    check_relative(&name).map_err(fail)?;
                    side_file(&name).ok_or_else(|| fail(format!("cannot find `{uri}`")))?
                }
            },
        };
        if data.len() < buffer.length() {
            let what = format!("it should have {} bytes, but has {}", buffer.length(), data.len());
            return Err(fail(what));
        }
        buffers.push(data);
    }
    Ok((document, buffers))
}

/// The files that a `.gltf` names, in order; none if the file cannot be read. Those that would lie
/// outside of its folder are left out, and [`open`] refuses them.
pub fn external_buffers(bytes: &[u8]) -> Vec<String> {
    let Some(document) = chunks(bytes).ok().and_then(|it| parse(it.0).ok()) else {
        return Vec::new();
    };
    document
        .buffers()
        .filter_map(|it| match it.source() {
            Source::Uri(uri) if !uri.starts_with("data:") => Some(file_name(uri)),
            _ => None,
        })
        .filter(|it| check_relative(it).is_ok())
        .collect()
}

/// The relative path that a URI stands for.
fn file_name(uri: &str) -> String {
    let bytes = percent_decoded(uri).unwrap_or_else(|| uri.as_bytes().to_vec());
    String::from_utf8_lossy(&bytes).into_owned()
}

fn parse(json: &[u8]) -> Result<Document, ReadError> {
    if json.starts_with(b"glTF") {
        return Err(ReadError::content(FORMAT, "a binary file inside of a binary file"));
    }
    let root: Root =
        deserialize::from_slice(json).map_err(|e| ReadError::content(FORMAT, e.to_string()))?;
    check_positions(&root)?;
    let document =
        Document::from_json(root).map_err(|e| ReadError::content(FORMAT, e.to_string()))?;
    check_animations(&document)?;
    Ok(document)
}

/// What the validation of the `gltf` crate (1.4) itself panics on: positions that lead nowhere.
fn check_positions(root: &Root) -> Result<(), ReadError> {
    for (index, mesh) in root.meshes.iter().enumerate() {
        let positions = |it: &gltf::json::mesh::Primitive| {
            it.attributes.get(&Checked::Valid(Semantic::Positions)).map(|it| it.value())
        };
        let n_accessors = root.accessors.len();
        let wrong = mesh.primitives.iter().filter_map(positions).find(|&it| it >= n_accessors);
        if let Some(accessor) = wrong {
            let what = format!(
                "mesh {index} has its positions in accessor {accessor}, but there are {n_accessors}"
            );
            return Err(ReadError::content(FORMAT, what));
        }
    }
    Ok(())
}

/// What the validation of the `gltf` crate (1.4) leaves out, and its accessors then panic on.
fn check_animations(document: &Document) -> Result<(), ReadError> {
    let root = document.as_json();
    let (n_nodes, n_accessors) = (root.nodes.len(), root.accessors.len());
    for (index, animation) in root.animations.iter().enumerate() {
        let channels = animation.channels.iter().all(|it| {
            matches!(it.target.path, Checked::Valid(_))
                && it.target.node.value() < n_nodes
                && it.sampler.value() < animation.samplers.len()
        });
        let samplers = animation.samplers.iter().all(|it| {
            matches!(it.interpolation, Checked::Valid(_))
                && it.input.value() < n_accessors
                && it.output.value() < n_accessors
        });
        if !channels || !samplers {
            let what = format!("animation {index} has a channel or sampler that leads nowhere");
            return Err(ReadError::content(FORMAT, what));
        }
    }
    Ok(())
}

/// The JSON and the binary chunk. A text file is all JSON.
fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), ReadError> {
    if bytes.is_empty() {
        return Err(ReadError::Empty { format: FORMAT });
    }
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes, None));
    }
    let word = |offset: usize, what: &str| {
        let it = bytes
            .get(offset..offset + 4)
            .ok_or_else(|| truncated(bytes, what, offset as u64 + 4))?;
        Ok(u32::from_le_bytes(it.try_into().expect("four bytes")))
    };
    let version = word(4, "the header")?;
    if version != 2 {
        return Err(ReadError::content(FORMAT, format!("version {version} instead of 2")));
    }
    let length = u64::from(word(8, "the header")?);
    if length > bytes.len() as u64 {
        return Err(truncated(bytes, "the file by its header", length));
    }
    let chunk = |offset: usize, what: &str| {
        let start = offset + 8;
        let end = start as u64 + u64::from(word(offset, what)?);
        word(offset + 4, what)?;
        if end > bytes.len() as u64 {
            return Err(truncated(bytes, what, end));
        }
        Ok((&bytes[start..end as usize], &bytes[offset + 4..start]))
    };
    let (json, kind) = chunk(12, "the JSON chunk")?;
    if kind != b"JSON" {
        return Err(ReadError::content(FORMAT, "the first chunk is no JSON"));
    }
    let next = 20 + json.len();
    if next >= bytes.len() {
        return Ok((json, None));
    }
    let (data, kind) = chunk(next, "the binary chunk")?;
    Ok((json, (kind == b"BIN\0").then_some(data)))
}

fn truncated(bytes: &[u8], what: &str, needed: u64) -> ReadError {
    ReadError::Truncated { format: FORMAT, what: what.to_owned(), needed, len: bytes.len() }
}

/// Decodes standard base64, padded or not.
fn base64(text: &str) -> Option<Vec<u8>> {
    let mut res = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut n_bits) = (0u32, 0);
    for byte in text.trim_end_matches('=').bytes() {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        n_bits += 6;
        if n_bits >= 8 {
            n_bits -= 8;
            res.push((bits >> n_bits) as u8);
            bits &= (1 << n_bits) - 1;
        }
    }
    Some(res)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_rfc_4648() {
        let pairs =
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9vYg", "foob"), ("Zm9vYmFy", "foobar")];
        for (text, bytes) in pairs {
            assert_eq!(base64(text).unwrap(), bytes.as_bytes());
        }
        assert_eq!(base64("Zm9*"), None);
    }
}
