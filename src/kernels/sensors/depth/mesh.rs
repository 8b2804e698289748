//! The surface that a depth picture shows.

use super::{DepthVideo, Intrinsics};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

/// Why there is no surface.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DepthMeshError {
    #[error("frame {frame} was asked for, but the video has {n_frames} frames")]
    Frame { frame: usize, n_frames: usize },
    #[error(
        "frame {frame} has {n_measured} measured pixels, and no three of them make a triangle with edges of at most {max_edge} m"
    )]
    NoFaces { frame: usize, n_measured: usize, max_edge: f64 },
}

/// Joins neighbouring pixels of a frame to triangles; normals face the camera.
///
/// Every 2 x 2 pixels give two triangles, those whose corners are measured and whose edges are all at
/// most `max_edge` metres long (Transfer4D, Maheshwari et al. 2023). Vertices that no triangle uses
/// do not occur; the others are in the order of a scan. With a `stride` of 2 only every second column
/// and row is used, and so on. Also returns the pixel of every vertex.
///
/// # Errors
/// See [`DepthMeshError`].
pub fn depth_mesh(
    video: &DepthVideo,
    frame: usize,
    max_edge: f64,
    stride: usize,
) -> Result<(TriMesh, Vec<u32>), DepthMeshError> {
    let n_frames = video.n_frames();
    if frame >= n_frames {
        return Err(DepthMeshError::Frame { frame, n_frames });
    }
    let depths = video.frame(frame);
    let points = unproject(depths, video.width(), &video.intrinsics());
    let faces = triangles(depths, &points, video.width(), max_edge, stride.max(1));
    if faces.is_empty() {
        let n_measured = depths.iter().filter(|it| **it > 0.0).count();
        return Err(DepthMeshError::NoFaces { frame, n_measured, max_edge });
    }
    let mut is_used = vec![false; depths.len()];
    for pixel in faces.iter().flatten() {
        is_used[*pixel as usize] = true;
    }
    let pixels: Vec<u32> = (0..depths.len() as u32).filter(|it| is_used[*it as usize]).collect();
    let mut vertex_of_pixel = vec![0_u32; depths.len()];
    for (vertex, pixel) in (0_u32..).zip(&pixels) {
        vertex_of_pixel[*pixel as usize] = vertex;
    }
    let vertices = pixels.iter().map(|it| points[*it as usize]).collect();
    let faces = faces.iter().map(|it| it.map(|pixel| vertex_of_pixel[pixel as usize])).collect();
    Ok((TriMesh::new(vertices, faces).expect("depths are finite"), pixels))
}

/// The point of every pixel; whatever is not measured is at the camera's centre.
pub fn unproject(depths: &[f32], width: usize, camera: &Intrinsics) -> Vec<Vec3> {
    let point = |(pixel, depth): (usize, &f32)| {
        camera.unproject((pixel % width) as f64, (pixel / width) as f64, f64::from(*depth))
    };
    depths.iter().enumerate().map(point).collect()
}

fn triangles(
    depths: &[f32],
    points: &[Vec3],
    width: usize,
    max_edge: f64,
    stride: usize,
) -> Vec<[u32; 3]> {
    let mut faces = Vec::new();
    let is_near = |a: u32, b: u32| {
        (points[a as usize] - points[b as usize]).norm_squared() <= max_edge * max_edge
    };
    let height = depths.len() / width;
    for row in (0..height.saturating_sub(stride)).step_by(stride) {
        for column in (0..width.saturating_sub(stride)).step_by(stride) {
            let corner = (row * width + column) as u32;
            let (right, below) = (corner + stride as u32, corner + (stride * width) as u32);
            // With y down and z forward, down before right turns towards the camera.
            for face in [[corner, below, right], [below + stride as u32, right, below]] {
                let [a, b, c] = face;
                let is_measured = face.iter().all(|it| depths[*it as usize] > 0.0);
                if is_measured && is_near(a, b) && is_near(b, c) && is_near(c, a) {
                    faces.push(face);
                }
            }
        }
    }
    faces
}

#[cfg(test)]
mod tests {
    use super::*;

    fn video(depths: Vec<f32>) -> DepthVideo {
        let camera = Intrinsics { fx: 300.0, fy: 300.0, cx: 9.5, cy: 6.0 };
        DepthVideo::new([20, 13], camera, 30.0, vec![depths]).unwrap()
    }

    #[test]
    fn a_plane_is_a_full_grid_that_faces_the_camera() {
        let (mesh, pixels) = depth_mesh(&video(vec![1.5; 260]), 0, 0.05, 1).unwrap();
        assert_eq!((mesh.n_vertices(), mesh.n_faces()), (20 * 13, 2 * 19 * 12));
        assert_eq!(pixels, (0..260).collect::<Vec<_>>());
        for (vertex, normal) in mesh.vertices().iter().zip(mesh.vertex_normals()) {
            assert!(vertex.dot(&normal) < 0.0 && (normal + Vec3::z()).norm() < 1e-12);
        }
        let expected = (19.0 * 1.5 / 300.0) * (12.0 * 1.5 / 300.0);
        assert!((mesh.area() - expected).abs() < 1e-12);
        let (coarse, _) = depth_mesh(&video(vec![1.5; 260]), 0, 0.05, 3).unwrap();
        assert_eq!((coarse.n_vertices(), coarse.n_faces()), (7 * 5, 2 * 6 * 4));
    }

    #[test]
    fn a_step_in_depth_splits_the_surface() {
        let step = |height: f32| {
            let depth = |pixel: usize| if pixel % 20 < 8 { 1.5 } else { 1.5 + height };
            depth_mesh(&video((0..260).map(depth).collect()), 0, 0.05, 1).unwrap().0
        };
        assert_eq!(step(0.04).n_faces(), 2 * 19 * 12);
        let split = step(0.06);
        assert_eq!((split.n_vertices(), split.n_faces()), (260, 2 * 18 * 12));
    }

    #[test]
    fn nothing_to_mesh_is_told() {
        let error = depth_mesh(&video(vec![0.0; 260]), 0, 0.05, 1).unwrap_err();
        assert!(error.to_string().starts_with("frame 0 has 0 measured pixels"), "{error}");
        let mut lone = vec![0.0; 260];
        lone[30] = 1.0;
        assert!(depth_mesh(&video(lone.clone()), 0, 0.05, 1).is_err());
        let error = depth_mesh(&video(lone), 3, 0.05, 1).unwrap_err();
        assert_eq!(error.to_string(), "frame 3 was asked for, but the video has 1 frames");
    }
}
