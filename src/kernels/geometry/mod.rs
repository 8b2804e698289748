//! Meshes and clouds, and how to find one's way on them: neighbours, distances, insides.

pub mod cloud_sheets;
pub mod cloud_sides;
pub mod corner_table;
pub mod delaunay_stars;
pub mod distance_field;
pub mod farthest_points;
pub mod geodesics;
pub mod isosurface;
pub mod kabsch;
pub mod landmarks;
pub mod medial_balls;
pub mod medial_graph;
pub mod mesh;
pub mod mesh_sequence;
pub mod neighbour_means;
pub mod point_tree;
pub mod shapes;
pub mod spanning_tree;
pub mod star;
pub mod topology;
pub mod triangle;
pub mod triangle_tree;
pub mod winding;
