//! Artifacts out of numpy's archives.

use serde_json::{Map, Value as Json, json};

use crate::kernels::io::npz::{NpzArray, NpzValues, read_npz};

/// The arrays and texts of an archive as a `.safetensors` file. Single values become texts, as which
/// artifacts have them.
///
/// # Errors
/// If it is no archive of arrays.
pub fn tensors_of_npz(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let (mut header, mut texts, mut data) = (Map::new(), Map::new(), Vec::new());
    for NpzArray { name, shape, values } in read_npz(bytes).map_err(|e| e.to_string())? {
        match values {
            NpzValues::Texts(list) if shape.is_empty() => {
                texts.insert(name, list.concat().into());
            }
            NpzValues::Texts(list) => {
                texts.insert(name, json!(list).to_string().into());
            }
            NpzValues::Numbers { dtype, bytes } if shape.is_empty() => {
                texts.insert(name, single(dtype, &bytes).into());
            }
            NpzValues::Numbers { dtype, bytes } => {
                let offsets = [data.len(), data.len() + bytes.len()];
                let entry =
                    json!({ "dtype": tensor_type(dtype), "shape": shape, "data_offsets": offsets });
                header.insert(name, entry);
                data.extend(bytes);
            }
        }
    }
    header.insert("__metadata__".to_owned(), Json::Object(texts));
    let header = Json::Object(header).to_string().into_bytes();
    Ok([&(header.len() as u64).to_le_bytes(), &header[..], &data].concat())
}

fn tensor_type(dtype: &str) -> String {
    match dtype.split_at(1) {
        ("b", _) => "BOOL".to_owned(),
        (letter, size) => {
            let n_bits = 8 * size.parse::<usize>().expect("a type ends with its size");
            format!("{}{n_bits}", letter.to_uppercase())
        }
    }
}

/// A single number as text.
fn single(dtype: &str, bytes: &[u8]) -> String {
    let mut wide = [0; 8];
    wide[..bytes.len()].copy_from_slice(bytes);
    let unused = 64 - 8 * bytes.len() as u32;
    match dtype {
        "f8" => f64::from_le_bytes(wide).to_string(),
        "f4" => f32::from_le_bytes([wide[0], wide[1], wide[2], wide[3]]).to_string(),
        _ if dtype.starts_with('i') => (i64::from_le_bytes(wide) << unused >> unused).to_string(),
        _ => u64::from_le_bytes(wide).to_string(),
    }
}
