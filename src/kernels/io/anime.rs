//! `.anime` files (DeformingThings4D): a mesh and its displacements.
//!
//! Little-endian: three `i32` counts `T V F`, `V x 3` single-precision positions of the first frame,
//! `F x 3` `i32` indices, and `(T - 1) x V x 3` displacements from the first frame.

use super::ReadError;
use crate::kernels::geometry::mesh::Vec3;
use crate::kernels::geometry::mesh_sequence::MeshSequence;

/// Reads a sequence; the format knows no rate.
///
/// # Errors
/// [`ReadError`] if the counts are not those of the file, or something is out of range.
pub fn read_anime(bytes: &[u8], frames_per_second: f64) -> Result<MeshSequence, ReadError> {
    let wrong = |what: String| ReadError::Content { format: "anime", what };
    if bytes.is_empty() {
        return Err(ReadError::Empty { format: "anime" });
    }
    let (words, rest) = bytes.as_chunks::<4>();
    let [a, b, c, body @ ..] = words else {
        return Err(wrong(format!("{} bytes hold no three counts", bytes.len())));
    };
    let counts = [a, b, c].map(|it| i64::from(i32::from_le_bytes(*it)));
    let [n_frames, n_vertices, n_faces] = counts;
    if n_frames < 1 || n_vertices < 1 || n_faces < 0 {
        return Err(wrong(format!("{n_frames} frames, {n_vertices} vertices, {n_faces} faces")));
    }
    let needed = 3 * (i128::from(n_frames) * i128::from(n_vertices) + i128::from(n_faces));
    if needed != body.len() as i128 || !rest.is_empty() {
        return Err(wrong(format!(
            "{n_frames} frames of {n_vertices} vertices and {n_faces} faces take {} bytes, but \
             there are {}",
            4 * (needed + 3),
            bytes.len()
        )));
    }
    let (n_vertices, n_faces) = (n_vertices as usize, n_faces as usize);
    let (first, body) = body.split_at(3 * n_vertices);
    let (indices, moves) = body.split_at(3 * n_faces);
    let points = |words: &[[u8; 4]]| -> Vec<Vec3> {
        let number = |it: usize| f64::from(f32::from_le_bytes(words[it]));
        (0..n_vertices).map(|it| Vec3::from_fn(|axis, _| number(3 * it + axis))).collect()
    };
    let first = points(first);
    // A negative index becomes a large one, which the mesh refuses.
    let index = |it: &[u8; 4]| i32::from_le_bytes(*it) as u32;
    let faces = indices.as_chunks::<3>().0.iter().map(|it| it.each_ref().map(index)).collect();
    let moved = moves
        .chunks_exact(3 * n_vertices)
        .map(|it| points(it).iter().zip(&first).map(|(by, from)| from + by).collect());
    let frames = std::iter::once(first.clone()).chain(moved).collect();
    MeshSequence::from_frames(frames, faces, frames_per_second).map_err(|e| wrong(e.to_string()))
}

/// Writes a sequence in single precision, without its rate.
pub fn write_anime(sequence: &MeshSequence) -> Vec<u8> {
    let (n_frames, n_vertices) = (sequence.n_frames(), sequence.n_vertices());
    let counts = [n_frames, n_vertices, sequence.faces().len()];
    let mut bytes: Vec<u8> = counts.iter().flat_map(|it| (*it as i32).to_le_bytes()).collect();
    let mut put = |it: &Vec3| it.iter().for_each(|it| bytes.extend((*it as f32).to_le_bytes()));
    let first = sequence.frame(0);
    first.iter().for_each(&mut put);
    let indices = sequence.faces().iter().flatten();
    bytes.extend(indices.flat_map(|it| it.to_le_bytes()));
    let mut put = |it: &Vec3| it.iter().for_each(|it| bytes.extend((*it as f32).to_le_bytes()));
    for frame in 1..n_frames {
        sequence.frame(frame).iter().zip(first).for_each(|(to, from)| put(&(to - from)));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence() -> MeshSequence {
        let frames = vec![
            vec![Vec3::zeros(), Vec3::x(), Vec3::y()],
            vec![Vec3::z(), Vec3::x() * 2.0, Vec3::y() * 0.5],
        ];
        MeshSequence::from_frames(frames, vec![[0, 1, 2]], 30.0).unwrap()
    }

    #[test]
    fn a_written_sequence_reads_back() {
        let bytes = write_anime(&sequence());
        assert_eq!(bytes.len(), 12 + 36 + 12 + 36);
        assert_eq!(read_anime(&bytes, 30.0).unwrap(), sequence());
    }

    #[test]
    fn damage_is_an_error() {
        let bytes = write_anime(&sequence());
        for length in 0..bytes.len() {
            assert!(read_anime(&bytes[..length], 30.0).is_err(), "{length} bytes");
        }
        let mut negative = bytes.clone();
        negative[48..52].copy_from_slice(&(-1_i32).to_le_bytes());
        assert!(read_anime(&negative, 30.0).is_err());
        let mut huge = bytes;
        huge[0..8].copy_from_slice(&[0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff, 0x7f]);
        assert!(read_anime(&huge, 30.0).is_err());
    }
}
