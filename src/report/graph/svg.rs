//! The drawing as SVG. An inner pipeline is laid out on its own and is then one box of its outer
//! one, so that nothing else can lie within it.

use std::{collections::HashMap, fmt::Write};

use petgraph::graph::NodeIndex;

use super::{
    Group,
    layout::{Layout, Position, layout},
    own_name, wires,
};
use crate::engine::graph::Graph;

/// Of a letter of the name, and of the smaller ones below it.
const LETTER: f64 = 7.3;
const SMALL_LETTER: f64 = 6.1;
const PADDING: f64 = 12.0;
const TITLE_HEIGHT: f64 = 22.0;
const MARGIN: f64 = 16.0;

/// A self-contained picture; follows the reader's choice of a dark or a light page.
pub fn svg(graph: &Graph) -> String {
    let mut drawing = Drawing::default();
    let whole = measure(graph, &Group::of(graph), true);
    drawing.place(&whole, Position { x: MARGIN, y: MARGIN });
    drawing.wires(graph);
    let (width, height) = (whole.size.0 + 2.0 * MARGIN, whole.size.1 + 2.0 * MARGIN);
    let title = graph
        .title
        .as_deref()
        .map_or(String::new(), |it| format!("<title>{}</title>\n", escaped(it)));
    let (groups, wires, boxes) = (drawing.groups, drawing.wires, drawing.boxes);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
         width=\"{width:.0}\" height=\"{height:.0}\">\n{title}{STYLE}{groups}{wires}{boxes}</svg>\n"
    )
}

const STYLE: &str = r##"<style>
  text { font: 12px ui-monospace, Menlo, Consolas, monospace; fill: #1c2733; text-anchor: middle }
  .kind { font-size: 10px; fill: #6b7885 }
  .name { text-anchor: start; font-size: 10px; fill: #6b7885 }
  .node { fill: #fff; stroke: #4a6fa5; stroke-width: 1.2 }
  .file { fill: #fdf6e3; stroke: #b58900; stroke-dasharray: 4 3 }
  .group { fill: #4a6fa5; fill-opacity: .07; stroke: #4a6fa5; stroke-opacity: .35 }
  .wire { fill: none; stroke: #8796a5; stroke-width: 1.3 }
  .tip { fill: #8796a5 }
  @media (prefers-color-scheme: dark) {
    text { fill: #dce3ea } .node { fill: #1f2a36; stroke: #7da3d8 } .file { fill: #2c2a1f }
  }
</style>
"##;

/// A box and, for an inner pipeline, what is in it.
struct Block {
    content: Content,
    size: (f64, f64),
}

enum Content {
    Node {
        index: NodeIndex,
        name: String,
        kind: String,
    },
    /// The number of an output and its path.
    File {
        index: usize,
        path: String,
    },
    Group {
        name: String,
        blocks: Vec<Block>,
        wires: Vec<(usize, usize)>,
        layout: Layout,
    },
}

/// The end of a wire within the graph.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum End {
    Node(NodeIndex),
    File(usize),
}

fn measure(graph: &Graph, group: &Group, is_whole: bool) -> Block {
    let mut blocks: Vec<Block> = group.nodes.iter().map(|&it| node_block(graph, it)).collect();
    blocks.extend(group.groups.values().map(|it| measure(graph, it, false)));
    if is_whole {
        let outputs = graph.outputs.iter().enumerate();
        blocks.extend(outputs.map(|(i, it)| file_block(i, it.path.display().to_string())));
    }
    let sizes: Vec<(f64, f64)> = blocks.iter().map(|it| it.size).collect();
    let wires = wires_between(graph, &blocks);
    let layout = layout(&sizes, &wires);
    let name = group.path.rsplit('/').next().unwrap_or_default().to_owned();
    let (border, title) = if is_whole { (0.0, 0.0) } else { (PADDING, TITLE_HEIGHT) };
    let width = layout.width.max(name.chars().count() as f64 * SMALL_LETTER) + 2.0 * border;
    let size = (width, layout.height + title + border);
    Block { content: Content::Group { name, blocks, wires, layout }, size }
}

fn node_block(graph: &Graph, index: NodeIndex) -> Block {
    let instance = &graph.instances[index];
    let (name, kind) = (own_name(instance), instance.kind.spec.kind.to_owned());
    let width = (name.chars().count() as f64 * LETTER).max(kind.len() as f64 * SMALL_LETTER);
    Block { content: Content::Node { index, name, kind }, size: (width + 2.0 * PADDING, 38.0) }
}

fn file_block(index: usize, path: String) -> Block {
    let width = path.chars().count() as f64 * SMALL_LETTER + 2.0 * PADDING;
    Block { content: Content::File { index, path }, size: (width, 24.0) }
}

/// The wires of the graph as wires between blocks, each once.
fn wires_between(graph: &Graph, blocks: &[Block]) -> Vec<(usize, usize)> {
    let mut block_of = HashMap::new();
    for (index, block) in blocks.iter().enumerate() {
        block.for_each_end(&mut |end| {
            block_of.insert(end, index);
        });
    }
    let mut res: Vec<(usize, usize)> = ends(graph)
        .into_iter()
        .filter_map(|(from, to, _)| Some((*block_of.get(&from)?, *block_of.get(&to)?)))
        .filter(|(from, to)| from != to)
        .collect();
    res.sort_unstable();
    res.dedup();
    res
}

/// All wires, with the names of the ports that they lead to.
fn ends(graph: &Graph) -> Vec<(End, End, String)> {
    let mut res = Vec::new();
    for to in graph.instances.node_indices() {
        for (port, from) in wires(&graph.instances[to]) {
            let title = format!("{} → {port}", from.port);
            res.push((End::Node(from.instance), End::Node(to), title));
        }
    }
    for (index, output) in graph.outputs.iter().enumerate() {
        let title = output.from.port.to_owned();
        res.push((End::Node(output.from.instance), End::File(index), title));
    }
    res
}

impl Block {
    /// What wires lead to, unless it is a group.
    fn end(&self) -> Option<End> {
        match self.content {
            Content::Node { index, .. } => Some(End::Node(index)),
            Content::File { index, .. } => Some(End::File(index)),
            Content::Group { .. } => None,
        }
    }

    fn for_each_end(&self, visit: &mut dyn FnMut(End)) {
        match &self.content {
            Content::Node { index, .. } => visit(End::Node(*index)),
            Content::File { index, .. } => visit(End::File(*index)),
            Content::Group { blocks, .. } => blocks.iter().for_each(|it| it.for_each_end(visit)),
        }
    }
}

/// What is drawn so far: groups behind wires behind boxes.
#[derive(Default)]
struct Drawing {
    groups: String,
    wires: String,
    boxes: String,
    /// Corner and size.
    placed: HashMap<End, (Position, (f64, f64))>,
    /// Where wires between two ends of the same group pass.
    bends: HashMap<(End, End), Vec<Position>>,
}

impl Drawing {
    fn place(&mut self, block: &Block, at: Position) {
        match &block.content {
            Content::Node { index, name, kind } => {
                self.placed.insert(End::Node(*index), (at, block.size));
                self.draw_box(at, block.size, "node", name, kind);
            }
            Content::File { index, path } => {
                self.placed.insert(End::File(*index), (at, block.size));
                self.draw_box(at, block.size, "node file", "", path);
            }
            Content::Group { name, blocks, wires, layout } => {
                let is_whole = name.is_empty();
                let inside = if is_whole { at } else { self.draw_group(at, block.size, name) };
                for (&(from, to), bends) in wires.iter().zip(&layout.bends) {
                    let bends = bends.iter().map(|it| moved(inside, *it)).collect();
                    self.bends.extend(blocks[from].end().zip(blocks[to].end()).zip(Some(bends)));
                }
                for (inner, position) in blocks.iter().zip(&layout.positions) {
                    self.place(inner, moved(inside, *position));
                }
            }
        }
    }

    /// Returns where its content starts.
    fn draw_group(&mut self, at: Position, size: (f64, f64), name: &str) -> Position {
        let _ = writeln!(
            self.groups,
            "<rect class=\"group\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" \
             rx=\"8\"/>\n<text class=\"name\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            at.x,
            at.y,
            size.0,
            size.1,
            at.x + 8.0,
            at.y + 14.0,
            escaped(name)
        );
        Position { x: at.x + PADDING, y: at.y + TITLE_HEIGHT }
    }

    /// A box with a line in its middle, or a large and a small one.
    fn draw_box(&mut self, at: Position, size: (f64, f64), class: &str, name: &str, small: &str) {
        let _ = writeln!(
            self.boxes,
            "<rect class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" \
             rx=\"5\"/>",
            at.x, at.y, size.0, size.1
        );
        let (x, middle) = (at.x + size.0 / 2.0, at.y + size.1 / 2.0);
        let small_y = if name.is_empty() { middle + 3.5 } else { middle + 12.0 };
        if !name.is_empty() {
            let (y, name) = (middle - 2.0, escaped(name));
            let _ = writeln!(self.boxes, "<text x=\"{x:.1}\" y=\"{y:.1}\">{name}</text>");
        }
        let small = escaped(small);
        let _ = writeln!(
            self.boxes,
            "<text class=\"kind\" x=\"{x:.1}\" y=\"{small_y:.1}\">{small}</text>"
        );
    }

    fn wires(&mut self, graph: &Graph) {
        for (from, to, title) in ends(graph) {
            let (start, start_size) = self.placed[&from];
            let (end, end_size) = self.placed[&to];
            let mut points =
                vec![moved(start, Position { x: start_size.0 / 2.0, y: start_size.1 })];
            points.extend(self.bends.get(&(from, to)).into_iter().flatten());
            points.push(moved(end, Position { x: end_size.0 / 2.0, y: -5.0 }));
            self.draw_wire(&points, &title);
        }
    }

    /// A smooth line downwards through the points, with a tip.
    fn draw_wire(&mut self, points: &[Position], title: &str) {
        let mut path = format!("M{:.1} {:.1}", points[0].x, points[0].y);
        for pair in points.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let middle = (a.y + b.y) / 2.0;
            let _ = write!(
                path,
                " C{:.1} {middle:.1} {:.1} {middle:.1} {:.1} {:.1}",
                a.x, b.x, b.x, b.y
            );
        }
        let Position { x, y } = points[points.len() - 1];
        let title = escaped(title);
        let _ = writeln!(
            self.wires,
            "<path class=\"wire\" d=\"{path}\"><title>{title}</title></path>\n\
             <path class=\"tip\" d=\"M{:.1} {y:.1} h8 l-4 5z\"/>",
            x - 4.0
        );
    }
}

fn moved(by: Position, position: Position) -> Position {
    Position { x: by.x + position.x, y: by.y + position.y }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
