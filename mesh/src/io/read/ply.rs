//! PLY, ASCII and binary of both byte orders.
//!
//! Elements read: `vertex` (`x`, `y`, `z`, and `red`, `green`, `blue` if all three are present), `face` (a list
//! `vertex_indices` or `vertex_index`) and `edge` (`vertex1`, `vertex2`). Other elements and properties are ignored.

use std::io::{BufRead, Cursor, Read};
use std::marker::PhantomData;

use nalgebra::Point3;
use rustc_hash::FxHashSet;
use serde::Deserialize;
use serde::de::{Deserializer, Error as _, SeqAccess, Visitor};
use serde_ply::{ElementDef, PlyFormat, PlyHeader, PlyReader, PropertyType, ScalarType};

use super::polygon;
use crate::shape::Shape;

/// Parses a file.
pub(super) fn parse(bytes: &[u8]) -> Result<Shape, String> {
    if bytes.is_empty() {
        return Err("the file is empty".to_owned());
    }
    // The parser needs a blank after the last number of a text file.
    let source = Cursor::new(bytes).chain(&b"\n"[..]);
    let mut reader = PlyReader::from_reader(source).map_err(|error| error.0.to_string())?;
    check_names(reader.header())?;
    check_declared_sizes(&reader, bytes.len())?;
    let mut shape = Shape::default();
    while let Some(element) = reader.current_element().cloned() {
        read_element(&mut reader, &element, &mut shape)
            .map_err(|message| format!("element {}: {message}", element.name))?;
    }
    Ok(shape)
}

/// Refuses an element or a property that is declared twice: which of them counts is not known.
fn check_names(header: &PlyHeader) -> Result<(), String> {
    let read = |element: &&ElementDef| ["vertex", "face", "edge"].contains(&element.name.as_str());
    let elements: Vec<&ElementDef> = header.elem_defs.iter().filter(read).collect();
    if let Some(name) = repeated(elements.iter().map(|element| element.name.as_str())) {
        return Err(format!(
            "the header declares the element {name} twice: declare it once"
        ));
    }
    for element in elements {
        if let Some(name) = repeated(element.properties.iter().map(|it| it.name.as_str())) {
            return Err(format!(
                "the header declares the property {name} of {} twice: declare it once, or give the other one another name",
                element.name
            ));
        }
    }
    Ok(())
}

/// The first name that occurs again.
fn repeated<'a>(names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let mut seen = FxHashSet::default();
    names.into_iter().find(|name| !seen.insert(*name))
}

/// Refuses a header that declares more elements than the file can hold, before memory is allocated.
fn check_declared_sizes<R: BufRead>(reader: &PlyReader<R>, length: usize) -> Result<(), String> {
    let header = reader.header();
    for element in &header.elem_defs {
        let least: usize = element
            .properties
            .iter()
            .map(|property| match (header.format, &property.property_type) {
                // At least a digit and a blank.
                (PlyFormat::Ascii, _) => 2,
                (_, PropertyType::Scalar(scalar)) => size(*scalar),
                (_, PropertyType::List { count_type, .. }) => size(*count_type),
            })
            .sum();
        if element.count > 0 && least == 0 {
            return Err(format!("element {} has rows and no property", element.name));
        }
        // The blank after the last number may be missing.
        if element.count.saturating_mul(least) > length + 1 {
            return Err(format!(
                "the header declares {} rows of {}, more than {length} bytes can hold: the file is cut short or damaged",
                element.count, element.name
            ));
        }
    }
    Ok(())
}

fn size(scalar: ScalarType) -> usize {
    match scalar {
        ScalarType::I8 | ScalarType::U8 => 1,
        ScalarType::I16 | ScalarType::U16 => 2,
        ScalarType::I32 | ScalarType::U32 | ScalarType::F32 => 4,
        ScalarType::F64 => 8,
    }
}

fn read_element<R: BufRead>(
    reader: &mut PlyReader<R>,
    element: &ElementDef,
    shape: &mut Shape,
) -> Result<(), String> {
    match element.name.as_str() {
        "vertex" => {
            for name in ["x", "y", "z"] {
                if !element.has_property(name) {
                    return Err(format!("there is no property {name}"));
                }
            }
            match channel_scale(element) {
                Some(scale) => {
                    let rows: Vec<ColoredVertex> = rows(reader)?;
                    let colors = rows.iter().map(|row| row.color(scale)).collect();
                    shape.colors = Some(colors);
                    shape.positions = rows.iter().map(ColoredVertex::position).collect();
                }
                None => {
                    let rows: Vec<Vertex> = rows(reader)?;
                    shape.positions = rows.iter().map(Vertex::position).collect();
                }
            }
        }
        "face" => {
            let rows: Vec<Face> = rows(reader)?;
            shape.triangles.reserve(rows.len());
            for (number, row) in rows.iter().enumerate() {
                let Some(corners) = row.vertex_indices.as_ref().or(row.vertex_index.as_ref())
                else {
                    return Err(
                        "there is no list vertex_indices or vertex_index of its corners".to_owned(),
                    );
                };
                corners
                    .add_to(&shape.positions, &mut shape.triangles)
                    .map_err(|message| format!("row {number}: {message}"))?;
            }
        }
        "edge" => {
            let rows: Vec<Edge> = rows(reader)?;
            for (number, row) in rows.iter().enumerate() {
                let line = [index(row.vertex1), index(row.vertex2)];
                let [Some(a), Some(b)] = line else {
                    return Err(format!("row {number}: a negative or huge index"));
                };
                shape.lines.push([a, b]);
            }
        }
        "tristrips" if element.count > 0 => {
            return Err("strips are not read; store the triangles as faces".to_owned());
        }
        _ => {
            rows::<Ignored, R>(reader)?;
        }
    }
    Ok(())
}

/// Factor from colour channels to 0..255; `None` when the vertices have no colours.
fn channel_scale(element: &ElementDef) -> Option<f32> {
    let mut scale = None;
    for name in ["red", "green", "blue"] {
        scale = match element.get_property(name)?.property_type {
            PropertyType::Scalar(ScalarType::F32 | ScalarType::F64) => Some(255.0),
            PropertyType::Scalar(ScalarType::U16 | ScalarType::I16) => Some(1.0 / 257.0),
            PropertyType::Scalar(_) => Some(1.0),
            PropertyType::List { .. } => return None,
        };
    }
    scale
}

fn rows<T: for<'de> Deserialize<'de>, R: BufRead>(
    reader: &mut PlyReader<R>,
) -> Result<Vec<T>, String> {
    let rows: Rows<T> = reader.next_element().map_err(|error| error.0.to_string())?;
    Ok(rows.0)
}

/// The rows of an element; error messages name the row.
struct Rows<T>(Vec<T>);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Rows<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Collect<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Collect<T> {
            type Value = Rows<T>;

            fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                formatter.write_str("rows")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut rows: A) -> Result<Rows<T>, A::Error> {
                // The declared count was checked against the file length.
                let mut all = Vec::with_capacity(rows.size_hint().unwrap_or(0));
                loop {
                    match rows.next_element() {
                        Ok(Some(row)) => all.push(row),
                        Ok(None) => return Ok(Rows(all)),
                        Err(error) => {
                            let row = all.len();
                            return Err(A::Error::custom(format!("row {row}: {error}")));
                        }
                    }
                }
            }
        }
        deserializer.deserialize_seq(Collect(PhantomData))
    }
}

#[derive(Deserialize)]
struct Vertex {
    x: f64,
    y: f64,
    z: f64,
}

impl Vertex {
    fn position(&self) -> Point3<f64> {
        Point3::new(self.x, self.y, self.z)
    }
}

#[derive(Deserialize)]
struct ColoredVertex {
    x: f64,
    y: f64,
    z: f64,
    red: f32,
    green: f32,
    blue: f32,
}

impl ColoredVertex {
    fn position(&self) -> Point3<f64> {
        Point3::new(self.x, self.y, self.z)
    }

    fn color(&self, scale: f32) -> [u8; 3] {
        // The conversion saturates and maps NaN to 0.
        [self.red, self.green, self.blue].map(|channel| (channel * scale).round() as u8)
    }
}

#[derive(Deserialize)]
struct Face {
    #[serde(default)]
    vertex_indices: Option<Corners>,
    #[serde(default)]
    vertex_index: Option<Corners>,
}

#[derive(Deserialize)]
struct Edge {
    vertex1: i64,
    vertex2: i64,
}

#[derive(Deserialize)]
struct Ignored {}

/// Corners of a polygon; triangles are stored inline.
struct Corners {
    count: usize,
    first: [i64; 3],
    rest: Vec<i64>,
}

impl Corners {
    /// Adds the triangles of the polygon.
    fn add_to(
        &self,
        positions: &[Point3<f64>],
        triangles: &mut Vec<[u32; 3]>,
    ) -> Result<(), String> {
        if self.count < 3 {
            return Err(format!("a face of {} corners", self.count));
        }
        let vertex = |given: i64| index(given).ok_or_else(|| format!("index {given} of a corner"));
        let [a, b, c] = self.first.map(vertex);
        let first = [a?, b?, c?];
        if self.rest.is_empty() {
            triangles.push(first);
            return Ok(());
        }
        let mut corners = first.to_vec();
        for &given in &self.rest {
            corners.push(vertex(given)?);
        }
        let of_face = polygon::triangles(corners.len(), |at| {
            polygon::position(positions, corners[at])
        });
        triangles.extend(
            of_face
                .into_iter()
                .map(|triangle| triangle.map(|at| corners[at])),
        );
        Ok(())
    }
}

fn index(given: i64) -> Option<u32> {
    u32::try_from(given).ok()
}

impl<'de> Deserialize<'de> for Corners {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Collect;
        impl<'de> Visitor<'de> for Collect {
            type Value = Corners;

            fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                formatter.write_str("a list of vertex indices")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Corners, A::Error> {
                let mut corners = Corners {
                    count: 0,
                    first: [0; 3],
                    rest: Vec::new(),
                };
                while let Some(corner) = list.next_element()? {
                    match corners.first.get_mut(corners.count) {
                        Some(slot) => *slot = corner,
                        None => corners.rest.push(corner),
                    }
                    corners.count += 1;
                }
                Ok(corners)
            }
        }
        deserializer.deserialize_seq(Collect)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "comment made by hand\nelement vertex 4\nproperty float x\nproperty double y\nproperty float z\n\
                        property uchar red\nproperty uchar green\nproperty uchar blue\nproperty list uchar float extra\n\
                        element camera 1\nproperty float focal\nproperty list int short pixels\n\
                        element face 2\nproperty uchar flags\nproperty list uchar int vertex_indices\n\
                        element edge 1\nproperty int vertex1\nproperty int vertex2\nproperty uchar weight\nend_header\n";

    fn text() -> String {
        format!(
            "ply\nformat ascii 1.0\n{HEAD}\
             0 0 0 255 0 0 0\n1 0 0 0 255 0 2 0.5 0.25\n1 1 0 0 0 255 1 9\n0 1.5 0 1 2 3 0\n\
             525.5 2 7 8\n3 3 0 1 2\n0 4 0 1 2 3\n0 3 200"
        )
    }

    /// The same values in binary.
    fn binary(is_little: bool) -> Vec<u8> {
        let order = if is_little { "little" } else { "big" };
        let mut bytes = format!("ply\nformat binary_{order}_endian 1.0\n{HEAD}").into_bytes();
        let mut put = |value: &[u8]| {
            // Values come in little-endian order.
            if is_little {
                bytes.extend(value);
            } else {
                bytes.extend(value.iter().rev());
            }
        };
        for (x, y, color, extra) in [
            (0.0_f32, 0.0_f64, [255, 0, 0], &[][..]),
            (1.0, 0.0, [0, 255, 0], &[0.5_f32, 0.25]),
            (1.0, 1.0, [0, 0, 255], &[9.0]),
            (0.0, 1.5, [1, 2, 3], &[]),
        ] {
            put(&x.to_le_bytes());
            put(&y.to_le_bytes());
            put(&0.0_f32.to_le_bytes());
            for channel in color {
                put(&[channel]);
            }
            put(&[extra.len() as u8]);
            for value in extra {
                put(&value.to_le_bytes());
            }
        }
        put(&525.5_f32.to_le_bytes());
        put(&2_i32.to_le_bytes());
        put(&7_i16.to_le_bytes());
        put(&8_i16.to_le_bytes());
        for face in [&[3_u8, 0, 1, 2][..], &[0, 0, 1, 2, 3]] {
            put(&face[..1]);
            put(&[face.len() as u8 - 1]);
            for corner in &face[1..] {
                put(&i32::from(*corner).to_le_bytes());
            }
        }
        put(&0_i32.to_le_bytes());
        put(&3_i32.to_le_bytes());
        put(&[200]);
        bytes
    }

    #[test]
    fn text_and_both_byte_orders_say_the_same() {
        let shape = parse(text().as_bytes()).unwrap();
        assert_eq!(shape.positions.len(), 4);
        assert_eq!(shape.positions[3], Point3::new(0.0, 1.5, 0.0));
        assert_eq!(shape.triangles, [[0, 1, 2], [0, 1, 2], [0, 2, 3]]);
        assert_eq!(shape.lines, [[0, 3]]);
        assert_eq!(shape.colors.as_ref().unwrap()[3], [1, 2, 3]);
        assert_eq!(parse(&binary(true)).unwrap(), shape);
        assert_eq!(parse(&binary(false)).unwrap(), shape);
        let with_returns = text().replace('\n', "\r\n");
        assert_eq!(parse(with_returns.as_bytes()).unwrap(), shape);
    }

    #[test]
    fn colours_may_be_shares_of_one_and_properties_in_any_order() {
        let shape = parse(
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float red\nproperty float green\nproperty float blue\n\
              property float z\nproperty float y\nproperty float x\nend_header\n1 0.5 0 3 2 1\n",
        )
        .unwrap();
        assert_eq!(shape.positions, [Point3::new(1.0, 2.0, 3.0)]);
        assert_eq!(shape.colors, Some(vec![[255, 128, 0]]));
    }

    #[test]
    fn a_file_cut_anywhere_is_refused() {
        let (text, binary) = (text(), binary(true));
        // The last byte of the text is a digit of a property that is passed over.
        for length in 0..text.len() - 3 {
            assert!(parse(&text.as_bytes()[..length]).is_err(), "{length}");
        }
        for length in 0..binary.len() - 1 {
            assert!(parse(&binary[..length]).is_err(), "{length}");
        }
    }

    #[test]
    fn faults_are_named_with_their_place() {
        let head = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n";
        for (text, words) in [
            (
                format!("{head}end_header\n0 0\n"),
                &["element vertex", "property z"][..],
            ),
            (
                format!("{head}property float z\nproperty float x\nend_header\n0 0 0 9\n"),
                &["property x of vertex twice"],
            ),
            (
                format!("{head}property float z\nelement vertex 1\nproperty float x\nend_header\n0 0 0 9\n"),
                &["element vertex twice"],
            ),
            (
                format!("{head}property float z\nend_header\n0 zero 0\n"),
                &["element vertex", "row 0"],
            ),
            (
                text().replace("3 3 0 1 2\n", "3 3 0 -1 2\n"),
                &["element face", "row 0", "-1"],
            ),
            (
                text().replace("3 3 0 1 2\n", "3 2 0 1\n"),
                &["element face", "2 corners"],
            ),
            (
                text().replace("vertex_indices", "corners"),
                &["element face", "vertex_indices"],
            ),
            (
                text().replace("element vertex 4", "element vertex 4000000000000"),
                &["declares", "vertex"],
            ),
            (
                "ply\nformat ascii 1.0\nelement ghost 9\nend_header\n".to_owned(),
                &["ghost", "no property"],
            ),
            (
                "ply\nformat ascii 1.0\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n1 0\n".to_owned(),
                &["strips"],
            ),
        ] {
            let message = parse(text.as_bytes()).unwrap_err();
            assert!(
                words.iter().all(|word| message.contains(word)),
                "{message}"
            );
        }
    }
}
