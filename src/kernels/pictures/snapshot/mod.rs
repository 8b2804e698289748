//! Pictures of meshes and skeletons, drawn in software.
//!
//! Orthographic cameras; smooth shading by a key light, a fill light and a sky; hollows darkened from
//! the depth buffer; a soft shadow on the ground; skeletons that shine through their bodies; 2 x 2
//! samples a pixel, averaged in linear light.

mod beads;
mod bones;
mod camera;
pub mod colors;
mod curves;
mod raster;
mod shade;

use rayon::prelude::*;

use super::canvas::{Canvas, color::mix, text};
use crate::kernels::curve_skeletons::curve_skeleton::CurveSkeleton;
use crate::kernels::geometry::mesh::TriMesh;
use crate::kernels::image::Image;
use crate::kernels::rigs::skeleton::Skeleton;

pub use bones::Role;
pub use camera::{Scale, View};
pub use colors::Color;

use camera::{Camera, Extent, Placement, arrange};
use colors::BODIES;
use raster::{SeenSoup, Soup, Tiles};
use shade::{Ground, Layers};

/// One shape in a picture.
#[derive(Debug, Clone)]
pub struct Figure<'a> {
    pub mesh: &'a TriMesh,
    /// One colour a vertex; a soft plain one without.
    pub colors: Option<Vec<Color>>,
    /// A function whose level lines are drawn.
    pub isolines: Option<Isolines<'a>>,
    pub skeletons: Vec<(&'a Skeleton, Role)>,
    pub curves: Option<&'a CurveSkeleton>,
    /// Vertices to point out, each in a hue by its place in the list.
    pub dots: &'a [u32],
    /// A line of text below; may be empty.
    pub caption: String,
}

/// Level lines of a function on vertices.
#[derive(Debug, Clone, Copy)]
pub struct Isolines<'a> {
    pub values: &'a [f64],
    /// The number of lines between the least and the greatest value.
    pub count: usize,
}

impl<'a> Figure<'a> {
    /// A plain shape without a skeleton.
    pub fn new(mesh: &'a TriMesh) -> Self {
        Self {
            mesh,
            colors: None,
            isolines: None,
            skeletons: Vec::new(),
            curves: None,
            dots: &[],
            caption: String::new(),
        }
    }
}

/// How the picture is made.
#[derive(Debug, Clone)]
pub struct SnapshotOptions {
    pub width: usize,
    pub height: usize,
    /// Every figure is shown from each of these.
    pub views: Vec<View>,
    pub scale: Scale,
}

impl Default for SnapshotOptions {
    fn default() -> Self {
        Self { width: 1200, height: 800, views: vec![View::Front], scale: Scale::Fit }
    }
}

/// Why there is no picture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SnapshotError {
    #[error("nothing to show: no figures or no views")]
    Nothing,
    #[error("a picture of {width} x {height} pixels cannot hold {n_panels} panels")]
    TooSmall { width: usize, height: usize, n_panels: usize },
    #[error("figure {figure} has {n_values} {what} for a mesh of {n_vertices} vertices")]
    Count { figure: usize, what: &'static str, n_values: usize, n_vertices: usize },
    #[error("figure {figure} points out vertex {vertex}, but its mesh has {n_vertices} vertices")]
    OutOfRange { figure: usize, vertex: u32, n_vertices: usize },
}

/// Draws figures side by side, each from all views, on white; a point cloud as beads.
///
/// # Errors
/// See [`SnapshotError`].
pub fn snapshot(figures: &[Figure<'_>], options: &SnapshotOptions) -> Result<Image, SnapshotError> {
    check(figures, options)?;
    let (width, height) = (options.width, options.height);
    let panels: Vec<(usize, View)> = (0..figures.len())
        .flat_map(|figure| options.views.iter().map(move |&view| (figure, view)))
        .collect();
    let has_captions = figures.iter().any(|it| !it.caption.is_empty());
    let letter_px = (height as f32 * 0.0185).clamp(9.0, 26.0);
    let caption_px = if has_captions { (letter_px * 2.6) as usize } else { 0 };
    let extents: Vec<Extent> =
        panels.iter().map(|&(figure, view)| extent(figure, &figures[figure], view)).collect();
    let placements =
        arrange(&extents, options.views.len(), [width, height], caption_px, options.scale);
    let mut canvas = Canvas::white(width, height);
    for (index, figure) in figures.iter().enumerate() {
        let soups = Soups::of(figure, index);
        for (&(_, view), placement) in
            panels.iter().zip(&placements).filter(|(panel, _)| panel.0 == index)
        {
            draw_panel(&mut canvas, figure, &soups, view, placement);
        }
        let shown = panels.iter().zip(&placements).filter(|(panel, _)| panel.0 == index);
        let last_row = shown.clone().map(|it| it.1.cell.top).max().expect("a figure has panels");
        let shown: Vec<Placement> =
            shown.map(|it| *it.1).filter(|it| it.cell.top == last_row).collect();
        let in_row = placements.iter().filter(|it| it.cell.top == last_row);
        let lowest = in_row.map(|it| it.bottom).fold(0.0, f64::max) as f32;
        write_caption(&mut canvas, &figure.caption, &shown, lowest, letter_px);
    }
    Ok(canvas.into_image())
}

fn check(figures: &[Figure<'_>], options: &SnapshotOptions) -> Result<(), SnapshotError> {
    let n_panels = figures.len() * options.views.len();
    if n_panels == 0 {
        return Err(SnapshotError::Nothing);
    }
    let (width, height) = (options.width, options.height);
    if width < 32 * n_panels || height < 32 {
        return Err(SnapshotError::TooSmall { width, height, n_panels });
    }
    for (figure, it) in figures.iter().enumerate() {
        let n_vertices = it.mesh.n_vertices();
        let counts = [
            ("colours", it.colors.as_ref().map(Vec::len)),
            ("values", it.isolines.map(|it| it.values.len())),
        ];
        if let Some(&vertex) = it.dots.iter().find(|dot| **dot as usize >= n_vertices) {
            return Err(SnapshotError::OutOfRange { figure, vertex, n_vertices });
        }
        for (what, n_values) in counts {
            if let Some(n_values) = n_values.filter(|&it| it != n_vertices) {
                return Err(SnapshotError::Count { figure, what, n_values, n_vertices });
            }
        }
    }
    Ok(())
}

/// The corners of all that a panel shows, in the camera's plane.
fn extent(index: usize, figure: &Figure<'_>, view: View) -> Extent {
    let camera = Camera::of(view);
    let joints = figure.skeletons.iter().flat_map(|it| it.0.positions());
    let nodes = figure.curves.iter().flat_map(|it| it.positions());
    let mut extent = Extent { figure: index, low: [f64::MAX; 2], high: [f64::MIN; 2] };
    for point in figure.mesh.vertices().iter().chain(joints).chain(nodes) {
        let seen = camera.project(point);
        for axis in 0..2 {
            extent.low[axis] = extent.low[axis].min(seen[axis]);
            extent.high[axis] = extent.high[axis].max(seen[axis]);
        }
    }
    extent
}

/// A figure's triangles.
struct Soups {
    body: Soup,
    bones: Soup,
    /// The diagonal of the bounding box.
    size: f64,
}

impl Soups {
    fn of(figure: &Figure<'_>, index: usize) -> Self {
        let mesh = figure.mesh;
        let (low, high) = mesh.bounds();
        let size = (high - low).norm();
        let plain = BODIES[index % BODIES.len()];
        let is_plain = figure.colors.is_none();
        // A body with a skeleton inside is paler: it reads as translucent.
        let is_alone = figure.skeletons.is_empty() && figure.curves.is_none();
        let pale = match (is_alone, is_plain) {
            (true, _) => 0.0,
            (false, true) => 0.45,
            (false, false) => 0.22,
        };
        let color = |vertex: usize| {
            let own = figure.colors.as_ref().map_or(plain, |it| it[vertex]);
            mix(own, [1.0; 3], pale)
        };
        let colors: Vec<Color> = (0..mesh.n_vertices()).map(color).collect();
        let body = if mesh.is_point_cloud() {
            beads::beads(mesh, &colors)
        } else {
            Soup {
                points: mesh.vertices().to_vec(),
                normals: mesh.vertex_normals(),
                colors,
                triangles: mesh.faces().to_vec(),
                lifted: None,
            }
        };
        let mut bones_soup = Soup::default();
        if let Some(it) = figure.curves {
            curves::add_curves(&mut bones_soup, it, size);
        }
        for (skeleton, _) in figure.skeletons.iter().filter(|it| it.1 == Role::Own) {
            bones::add_skeleton(&mut bones_soup, skeleton, Role::Own, size);
        }
        for (index, &vertex) in figure.dots.iter().enumerate() {
            let place = mesh.vertices()[vertex as usize];
            bones::add_ball(&mut bones_soup, place, 0.011 * size, colors::joint_color(index));
        }
        // The truth is thinner: it must not vanish inside a result that is nearly right.
        bones_soup.lifted = Some((bones_soup.points.len(), 0.03 * size));
        for (skeleton, _) in figure.skeletons.iter().filter(|it| it.1 == Role::Truth) {
            bones::add_skeleton(&mut bones_soup, skeleton, Role::Truth, size);
        }
        Self { body, bones: bones_soup, size }
    }
}

/// Pixels along one side of a tile.
const TILE: usize = 32;

fn draw_panel(
    canvas: &mut Canvas,
    figure: &Figure<'_>,
    soups: &Soups,
    view: View,
    placement: &Placement,
) {
    let camera = Camera::of(view);
    let tiles = Tiles::of(placement, TILE);
    let body = SeenSoup::new(&soups.body, &camera, placement, tiles);
    let bones = SeenSoup::new(&soups.bones, &camera, placement, tiles);
    let size_px = (soups.size * placement.scale) as f32;
    // Level lines run across faces.
    let isolines = figure.isolines.filter(|_| !figure.mesh.is_point_cloud());
    let lines = isolines.map(|it| shade::Levels::of(it.values, it.count));
    let drawn: Vec<Vec<shade::Pixel>> = (0..tiles.columns * tiles.rows)
        .into_par_iter()
        .map(|tile| {
            let (body_hits, bone_hits) = (body.draw(tiles, tile), bones.draw(tiles, tile));
            let scene =
                shade::Scene { body: &body, bones: &bones, size_px, levels: lines.as_ref() };
            shade::tile(&scene, &body_hits, &bone_hits, TILE)
        })
        .collect();
    let layers = Layers::assemble(drawn, tiles, placement.cell, size_px);
    let ground = Ground::of(figure.mesh, view, &camera, placement);
    layers.compose(canvas, placement.cell, ground.as_ref());
}

/// Below a figure's panels, centred; on one line with the captions of its row.
fn write_caption(
    canvas: &mut Canvas,
    caption: &str,
    placements: &[Placement],
    lowest: f32,
    letter_px: f32,
) {
    const INK: Color = [0.075, 0.085, 0.105];
    let (first, last) = (placements[0].cell, placements[placements.len() - 1].cell);
    let (left, right) = (first.left, last.left + last.width);
    let room = (right - left) as f32 * 0.96;
    let height = letter_px.min(letter_px * room / text::width(caption, letter_px).max(1.0));
    let floor = (first.top + first.height) as f32 + letter_px * 1.2;
    let baseline = (lowest + letter_px * 4.2).min(floor).round();
    let middle = (left + right) as f32 / 2.0;
    text::write_centered(canvas, caption, [middle, baseline], height, INK);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::geometry::mesh::Vec3;
    use crate::kernels::geometry::shapes::{icosphere, torus};

    fn axis() -> Skeleton {
        let positions = vec![-Vec3::y() * 0.8, Vec3::zeros(), Vec3::y() * 0.8];
        let names = ["low", "middle", "high"].map(str::to_owned).to_vec();
        Skeleton::new(names, vec![None, Some(0), Some(1)], positions).unwrap()
    }

    fn options(width: usize, height: usize) -> SnapshotOptions {
        SnapshotOptions { width, height, ..Default::default() }
    }

    fn n_drawn(image: &Image) -> usize {
        image.pixels.iter().filter(|it| it.iter().any(|&c| c < 200)).count()
    }

    #[test]
    fn a_sphere_covers_the_area_of_its_disk() {
        let sphere = icosphere(4);
        let image = snapshot(&[Figure::new(&sphere)], &options(400, 300)).unwrap();
        // The disk fills 86 % of the height.
        let radius = 0.43 * 300.0;
        let disk = std::f64::consts::PI * radius * radius;
        let found = n_drawn(&image) as f64;
        assert!((found / disk - 1.0).abs() < 0.02, "{found} pixels instead of {disk}");
        assert_eq!(image.pixels[0], [255; 3]);
    }

    #[test]
    fn the_picture_is_the_same_at_any_number_of_threads() {
        let (sphere, ring, skeleton) = (icosphere(3), torus(1.0, 0.4, 24, 12), axis());
        let values: Vec<f64> = sphere.vertices().iter().map(|it| it.x).collect();
        let mut first = Figure::new(&sphere);
        first.isolines = Some(Isolines { values: &values, count: 5 });
        first.caption = "sphere".to_owned();
        let mut second = Figure::new(&ring);
        second.skeletons = vec![(&skeleton, Role::Own), (&skeleton, Role::Truth)];
        let options = SnapshotOptions { views: vec![View::Front, View::Top], ..options(320, 240) };
        let draw = |n_threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            pool.install(|| snapshot(&[first.clone(), second.clone()], &options).unwrap())
        };
        assert_eq!(draw(1), draw(3));
    }

    #[test]
    fn a_skeleton_shines_through_its_body() {
        let (sphere, skeleton) = (icosphere(3), axis());
        let bare = snapshot(&[Figure::new(&sphere)], &options(200, 200)).unwrap();
        let mut figure = Figure::new(&sphere);
        figure.skeletons.push((&skeleton, Role::Own));
        let image = snapshot(&[figure], &options(200, 200)).unwrap();
        let light =
            |image: &Image| image.pixels[120 * 200 + 100].map(i32::from).iter().sum::<i32>();
        assert!(light(&image) < light(&bare) - 60, "a dark bone lies behind the middle");
    }

    #[test]
    fn the_nearer_of_two_surfaces_is_seen_from_either_side() {
        let square = |z: f64| {
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, z))
        };
        let vertices = [square(-0.2), square(0.2)].concat();
        let faces = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let mesh = TriMesh::new(vertices, faces).unwrap();
        let red = [[1.0, 0.0, 0.0]; 4];
        let blue = [[0.0, 0.0, 1.0]; 4];
        for (view, expects_blue) in [(View::Front, true), (View::Back, false)] {
            let mut figure = Figure::new(&mesh);
            figure.colors = Some([red, blue].concat());
            let options = SnapshotOptions { views: vec![view], ..options(100, 100) };
            let image = snapshot(&[figure], &options).unwrap();
            let [r, _, b] = image.pixels[50 * 100 + 50];
            assert_eq!(b > r, expects_blue, "{view:?}");
        }
    }

    #[test]
    fn a_dense_cloud_covers_what_its_surface_does() {
        let sphere = icosphere(5);
        let cloud = TriMesh::from_points(sphere.vertices().to_vec()).unwrap();
        let [of_cloud, of_sphere] = [&cloud, &sphere]
            .map(|it| n_drawn(&snapshot(&[Figure::new(it)], &options(200, 200)).unwrap()) as f64);
        assert!((of_cloud / of_sphere - 1.0).abs() < 0.05, "{of_cloud} and {of_sphere} pixels");
        let alone = TriMesh::from_points(vec![Vec3::x()]).unwrap();
        snapshot(&[Figure::new(&alone)], &options(100, 100)).unwrap();
    }

    #[test]
    fn wrong_counts_are_named() {
        let sphere = icosphere(0);
        let mut figure = Figure::new(&sphere);
        figure.colors = Some(vec![[0.0; 3]; 5]);
        let error = snapshot(&[figure], &SnapshotOptions::default()).unwrap_err();
        assert_eq!(error.to_string(), "figure 0 has 5 colours for a mesh of 12 vertices");
        assert_eq!(snapshot(&[], &SnapshotOptions::default()), Err(SnapshotError::Nothing));
    }
}
