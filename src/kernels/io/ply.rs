//! Polygon files (Stanford PLY): ASCII and binary of both byte orders.

use super::error::{ReadError, fan};
use crate::kernels::geometry::mesh::{TriMesh, Vec3};

const FORMAT: &str = "PLY";

/// Reads the vertices and faces, whatever other elements and properties there are and in any order.
///
/// Polygons are cut into fans; without any, it is a point cloud.
///
/// # Errors
/// With the line of the header or an ASCII body, or the byte of a binary one.
pub fn read_ply(bytes: &[u8]) -> Result<TriMesh, ReadError> {
    let header = Header::read(bytes)?;
    let mut body = Body::new(bytes, &header)?;
    let mut vertices = Vec::new();
    let mut polygons = Polygons::default();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => vertices = read_vertices(&mut body, element)?,
            "face" => polygons = read_faces(&mut body, element)?,
            _ => skip(&mut body, element)?,
        }
    }
    let n_vertices = vertices.len();
    let Polygons { faces, first_corner_at } = polygons;
    let mut triangles = Vec::with_capacity(faces.len());
    for (face, corners) in faces.iter().enumerate() {
        let mut checked = [0; 3];
        for (corner, &index) in checked.iter_mut().zip(corners) {
            // Indices were read as numbers, so a negative one or a fraction is still visible.
            if !(index >= 0.0 && index < n_vertices as f64 && index.fract() == 0.0) {
                let what = format!(
                    "face {} refers to vertex {index}, but there are {n_vertices}",
                    first_corner_at[face]
                );
                return Err(ReadError::content(FORMAT, what));
            }
            *corner = index as u32;
        }
        triangles.push(checked);
    }
    TriMesh::new(vertices, triangles).map_err(ReadError::mesh(FORMAT))
}

/// What a PLY file holds beside positions and faces.
#[derive(Debug, Clone, Copy, Default)]
pub struct PlyExtras<'a> {
    /// One sRGB colour a vertex.
    pub colours: Option<&'a [[u8; 3]]>,
    /// Named scalars, one a vertex. Names must be words.
    pub scalars: &'a [(&'a str, &'a [f64])],
}

/// Writes binary little-endian PLY in single precision; scalars in double.
///
/// # Panics
/// If there is not one colour or scalar for every vertex.
pub fn write_ply(mesh: &TriMesh, extras: PlyExtras<'_>) -> Vec<u8> {
    let n_vertices = mesh.n_vertices();
    assert!(extras.colours.is_none_or(|it| it.len() == n_vertices), "a colour for every vertex");
    assert!(extras.scalars.iter().all(|it| it.1.len() == n_vertices), "a scalar for every vertex");
    let mut head = format!("ply\nformat binary_little_endian 1.0\nelement vertex {n_vertices}\n");
    for name in ["x", "y", "z"] {
        head += &format!("property float {name}\n");
    }
    if extras.colours.is_some() {
        for name in ["red", "green", "blue"] {
            head += &format!("property uchar {name}\n");
        }
    }
    for (name, _) in extras.scalars {
        head += &format!("property double {name}\n");
    }
    head += &format!("element face {}\n", mesh.n_faces());
    head += "property list uchar int vertex_indices\nend_header\n";
    let mut out = head.into_bytes();
    for (vertex, position) in mesh.vertices().iter().enumerate() {
        out.extend(position.iter().flat_map(|&it| (it as f32).to_le_bytes()));
        if let Some(colours) = extras.colours {
            out.extend_from_slice(&colours[vertex]);
        }
        out.extend(extras.scalars.iter().flat_map(|it| it.1[vertex].to_le_bytes()));
    }
    for corners in mesh.faces() {
        out.push(3);
        out.extend(corners.iter().flat_map(|it| it.to_le_bytes()));
    }
    out
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

struct Property {
    name: String,
    scalar: Scalar,
    /// The type of a list's length.
    length: Option<Scalar>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    /// Where the body starts.
    bytes: usize,
    lines: usize,
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, ReadError> {
        if bytes.is_empty() {
            return Err(ReadError::Empty { format: FORMAT });
        }
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut start = 0;
        for line in 1.. {
            let end = bytes[start..]
                .iter()
                .position(|&it| it == b'\n')
                .ok_or_else(|| ReadError::content(FORMAT, "the file ends inside of the header"))?;
            let content = String::from_utf8_lossy(&bytes[start..start + end]);
            start += end + 1;
            let fail = |what: String| ReadError::line(FORMAT, line, what);
            let tokens: Vec<&str> = content.split_whitespace().collect();
            if line == 1 {
                if tokens != ["ply"] {
                    return Err(fail("the file does not start with `ply`".to_owned()));
                }
                continue;
            }
            match tokens[..] {
                ["format", name, _] => encoding = Some(parse_encoding(name).map_err(fail)?),
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| fail(format!("`{count}` elements")))?;
                    elements.push(Element { name: name.to_owned(), count, properties: vec![] });
                }
                ["property", ref rest @ ..] => {
                    let element = elements
                        .last_mut()
                        .ok_or_else(|| fail("a property before the first element".to_owned()))?;
                    let property = parse_property(rest)
                        .ok_or_else(|| fail(format!("cannot read `{}`", content.trim())))?;
                    element.properties.push(property);
                }
                ["end_header"] => {
                    let encoding =
                        encoding.ok_or_else(|| fail("the header has no format".to_owned()))?;
                    return Ok(Self { encoding, elements, bytes: start, lines: line });
                }
                ["comment" | "obj_info", ..] | [] => {}
                _ => return Err(fail(format!("cannot read `{}`", content.trim()))),
            }
        }
        unreachable!("lines are counted without end")
    }
}

fn parse_encoding(name: &str) -> Result<Encoding, String> {
    match name {
        "ascii" => Ok(Encoding::Ascii),
        "binary_little_endian" => Ok(Encoding::LittleEndian),
        "binary_big_endian" => Ok(Encoding::BigEndian),
        _ => Err(format!("`{name}` is no format of PLY")),
    }
}

fn parse_property(tokens: &[&str]) -> Option<Property> {
    let (length, scalar, name) = match *tokens {
        ["list", length, scalar, name] => (Some(Scalar::parse(length)?), scalar, name),
        [scalar, name] => (None, scalar, name),
        _ => return None,
    };
    Some(Property { name: name.to_owned(), scalar: Scalar::parse(scalar)?, length })
}

/// The numbers of the body, one after the other.
struct Body<'a> {
    encoding: Encoding,
    bytes: &'a [u8],
    offset: usize,
    /// Of an ASCII body: the line of the next token.
    line: usize,
}

impl<'a> Body<'a> {
    fn new(bytes: &'a [u8], header: &Header) -> Result<Self, ReadError> {
        let body =
            Self { encoding: header.encoding, bytes, offset: header.bytes, line: header.lines + 1 };
        // A damaged count would otherwise be found only after all that fits was read.
        for element in &header.elements {
            let least: usize = element
                .properties
                .iter()
                .map(|it| {
                    if header.encoding == Encoding::Ascii {
                        1
                    } else {
                        it.length.unwrap_or(it.scalar).size()
                    }
                })
                .sum();
            let needed = header.bytes as u64 + (element.count as u64).saturating_mul(least as u64);
            if needed > bytes.len() as u64 + 1 {
                let what = format!("the list of {} elements `{}`", element.count, element.name);
                return Err(ReadError::Truncated {
                    format: FORMAT,
                    what,
                    needed,
                    len: bytes.len(),
                });
            }
        }
        Ok(body)
    }

    fn next(&mut self, scalar: Scalar) -> Result<f64, ReadError> {
        if self.encoding == Encoding::Ascii { self.next_token() } else { self.next_binary(scalar) }
    }

    fn next_token(&mut self) -> Result<f64, ReadError> {
        while let Some(byte) = self.bytes.get(self.offset).filter(|it| it.is_ascii_whitespace()) {
            self.line += usize::from(*byte == b'\n');
            self.offset += 1;
        }
        let rest = &self.bytes[self.offset..];
        let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        if end == 0 {
            return Err(ReadError::line(FORMAT, self.line, "the file ends too early"));
        }
        self.offset += end;
        let token = String::from_utf8_lossy(&rest[..end]);
        token
            .parse()
            .map_err(|_| ReadError::line(FORMAT, self.line, format!("`{token}` is no number")))
    }

    fn next_binary(&mut self, scalar: Scalar) -> Result<f64, ReadError> {
        let end = self.offset + scalar.size();
        let Some(bytes) = self.bytes.get(self.offset..end) else {
            let what = "the next number".to_owned();
            let len = self.bytes.len();
            return Err(ReadError::Truncated { format: FORMAT, what, needed: end as u64, len });
        };
        self.offset = end;
        let mut little = [0; 8];
        little[..bytes.len()].copy_from_slice(bytes);
        if self.encoding == Encoding::BigEndian {
            little[..bytes.len()].reverse();
        }
        let [a, b, c, d, ..] = little;
        Ok(match scalar {
            Scalar::I8 => f64::from(a as i8),
            Scalar::U8 => f64::from(a),
            Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
            Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
            Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Scalar::F64 => f64::from_le_bytes(little),
        })
    }

    /// A list's length.
    fn next_length(&mut self, length: Scalar) -> Result<usize, ReadError> {
        let (offset, value) = (self.offset, self.next(length)?);
        if value >= 0.0 && value.fract() == 0.0 && value <= self.bytes.len() as f64 {
            return Ok(value as usize);
        }
        let what = format!("a list of {value} numbers");
        Err(ReadError::Byte { format: FORMAT, offset, what })
    }
}

fn read_vertices(body: &mut Body<'_>, element: &Element) -> Result<Vec<Vec3>, ReadError> {
    for name in ["x", "y", "z"] {
        let given = |it: &Property| it.name == name && it.length.is_none();
        if !element.properties.iter().any(given) {
            return Err(ReadError::content(FORMAT, format!("vertices have no property `{name}`")));
        }
    }
    // An ASCII file may claim any number; only what is read counts.
    let mut vertices = Vec::with_capacity(element.count.min(1 << 16));
    for _ in 0..element.count {
        let mut position = Vec3::zeros();
        for property in &element.properties {
            if let Some(length) = property.length {
                for _ in 0..body.next_length(length)? {
                    body.next(property.scalar)?;
                }
                continue;
            }
            let value = body.next(property.scalar)?;
            match property.name.as_str() {
                "x" => position.x = value,
                "y" => position.y = value,
                "z" => position.z = value,
                _ => {}
            }
        }
        vertices.push(position);
    }
    Ok(vertices)
}

/// Triangles whose indices are not checked yet.
#[derive(Default)]
struct Polygons {
    faces: Vec<[f64; 3]>,
    /// By triangle: the polygon it comes from.
    first_corner_at: Vec<usize>,
}

fn read_faces(body: &mut Body<'_>, element: &Element) -> Result<Polygons, ReadError> {
    let mut polygons = Polygons::default();
    let mut list = Vec::new();
    for face in 0..element.count {
        for property in &element.properties {
            let length = property.length.map_or(Ok(1), |it| body.next_length(it))?;
            list.clear();
            for _ in 0..length {
                list.push(body.next(property.scalar)?);
            }
            if property.length.is_some()
                && matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
            {
                if length < 3 {
                    let what = format!("face {face} has {length} corners");
                    return Err(ReadError::content(FORMAT, what));
                }
                polygons.faces.extend(fan(&list));
                polygons.first_corner_at.resize(polygons.faces.len(), face);
            }
        }
    }
    Ok(polygons)
}

fn skip(body: &mut Body<'_>, element: &Element) -> Result<(), ReadError> {
    // Without properties an element has no bytes, whatever its count says.
    let count = if element.properties.is_empty() { 0 } else { element.count };
    for _ in 0..count {
        for property in &element.properties {
            for _ in 0..property.length.map_or(Ok(1), |it| body.next_length(it))? {
                body.next(property.scalar)?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> TriMesh {
        let vertices = vec![Vec3::zeros(), Vec3::x(), Vec3::new(1.0, 1.0, 0.0), Vec3::y()];
        TriMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]]).unwrap()
    }

    #[test]
    fn extras_do_not_disturb_the_mesh() {
        let mesh = square();
        let (colours, scalar) = ([[1, 2, 3]; 4], [0.5; 4]);
        let extras = PlyExtras { colours: Some(&colours), scalars: &[("phi", &scalar)] };
        assert_eq!(read_ply(&write_ply(&mesh, extras)).unwrap(), mesh);
        assert_eq!(read_ply(&write_ply(&mesh, PlyExtras::default())).unwrap(), mesh);
    }

    #[test]
    fn any_order_of_elements_and_properties() {
        let text = "ply\r\nformat ascii 1.0\r\ncomment none\r\nelement face 1\r\n\
            property uchar flag\r\nproperty list uchar int vertex_index\r\nelement edge 1\r\n\
            property int a\r\nelement vertex 4\r\nproperty float z\r\nproperty double x\r\n\
            property list uchar float more\r\nproperty float y\r\nend_header\r\n\
            7 4 0 1 2 3\r\n5\r\n0 0 0 0\r\n0 1 2 8 8 0\r\n0 1 1 9 1\r\n0 0 0 1\r\n";
        assert_eq!(read_ply(text.as_bytes()).unwrap(), square());
    }

    #[test]
    fn big_endian_is_turned() {
        let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 4\nproperty short x\n\
            property float y\nproperty double z\nelement face 1\n\
            property list ushort uint vertex_indices\nend_header\n"
            .to_vec();
        for it in square().vertices() {
            bytes.extend((it.x as i16).to_be_bytes());
            bytes.extend((it.y as f32).to_be_bytes());
            bytes.extend(it.z.to_be_bytes());
        }
        bytes.extend(4u16.to_be_bytes());
        bytes.extend([0u32, 1, 2, 3].iter().flat_map(|it| it.to_be_bytes()));
        assert_eq!(read_ply(&bytes).unwrap(), square());
    }

    #[test]
    fn errors_say_what_is_wrong() {
        let error = |bytes: &[u8]| read_ply(bytes).unwrap_err().to_string();
        let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                    property float z\n";
        let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
        assert_eq!(error(b""), "the PLY file is empty");
        assert_eq!(error(b"pl\n"), "PLY file, line 1: the file does not start with `ply`");
        let cloud = read_ply(format!("{head}end_header\n0 0 0\n1 0 0\n1 1 0\n").as_bytes());
        assert!(cloud.unwrap().is_point_cloud());
        assert_eq!(
            error(format!("{head}{faces}0 0 0\n1 0 0\n1 1 0\n3 0 1 3\n").as_bytes()),
            "PLY file: face 0 refers to vertex 3, but there are 3"
        );
        assert_eq!(
            error(format!("{head}{faces}0 0 0\n1 zero 0\n1 1 0\n3 0 1 3\n").as_bytes()),
            "PLY file, line 11: `zero` is no number"
        );
        assert_eq!(
            error(format!("{head}{faces}0 0 0\n1 nan 0\n1 1 0\n3 0 1 2\n").as_bytes()),
            "PLY file: vertex 1 has the coordinate NaN"
        );
        let bytes = write_ply(&square(), PlyExtras::default());
        let len = bytes.len();
        assert_eq!(
            error(&bytes[..len - 1]),
            format!(
                "the PLY file ends too early: the next number ends at byte {len}, but there are {}",
                len - 1
            )
        );
    }
}
