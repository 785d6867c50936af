//! Wavefront OBJ.
//!
//! Rows are parsed here, not by `tobj`: it reads a polyline as a polygon, leaves out vertices without a face (all of a cloud) and the order of the others, scales
//! by weights, knows no continued lines, names no line of a fault, and overflows on a negative texture index out of range.

use std::path::Path;

use nalgebra::Point3;

use super::polygon;
use super::texture::{Coordinates, decoded};
use crate::files::read_regular;
use crate::shape::Shape;
use crate::texture::Texture;

/// Parses a file; error messages name the line. The texture is read when the path of the file is given, beside which its
/// material library lies.
pub(super) fn parse(
    bytes: &[u8],
    texture_beside: Option<&Path>,
) -> Result<(Shape, Option<Texture>), String> {
    let mut parser = Parser::default();
    let mut logical = String::new();
    for (number, line) in bytes.split(|byte| *byte == b'\n').enumerate() {
        let text = String::from_utf8_lossy(line);
        let text = text.trim();
        // A backslash continues the line.
        if let Some(begun) = text.strip_suffix('\\') {
            logical.push_str(begun);
            logical.push(' ');
            continue;
        }
        let outcome = if logical.is_empty() {
            parser.row(text)
        } else {
            logical.push_str(text);
            let outcome = parser.row(&logical);
            logical.clear();
            outcome
        };
        outcome.map_err(|message| format!("line {}: {message}", number + 1))?;
    }
    if parser.shape.positions.is_empty() && !parser.has_known_row && !bytes.is_empty() {
        return Err("no row begins with v, f, l or p".to_owned());
    }
    let texture = match texture_beside {
        Some(path) => parser.texture(path)?,
        None => None,
    };
    Ok((parser.finish(), texture))
}

/// The image that a material library names for a material.
fn image_of_material(library: &str, material: &str) -> Option<String> {
    let mut is_wanted = false;
    for line in library.lines() {
        let Some((word, rest)) = line.trim().split_once(char::is_whitespace) else {
            continue;
        };
        match word {
            "newmtl" => is_wanted = rest.trim() == material,
            // Options come before the name.
            "map_Kd" if is_wanted => return rest.split_whitespace().last().map(str::to_owned),
            _ => {}
        }
    }
    None
}

#[derive(Default)]
struct Parser {
    shape: Shape,
    /// Colours of all vertices so far, or none.
    colors: Vec<[u8; 3]>,
    has_known_row: bool,
    /// Texture coordinates; `None` for those that are no numbers.
    coordinates: Vec<Option<[f64; 2]>>,
    /// Indices into `coordinates` of each triangle, where it has them.
    places: Vec<[Option<usize>; 3]>,
    library: Option<String>,
    /// Vertices and texture coordinates of the face that is read.
    corners: Vec<(u32, Option<usize>)>,
    /// Materials of faces; a file with several has no texture.
    materials: Vec<String>,
}

impl Parser {
    fn row(&mut self, text: &str) -> Result<(), String> {
        let mut words = text.split_ascii_whitespace();
        match words.next() {
            Some("v") => self.vertex(words)?,
            Some("f") => {
                let mut corners = std::mem::take(&mut self.corners);
                corners.clear();
                // Of fewer than three corners the missing one is an error.
                let first = [words.next(), words.next(), words.next()];
                for word in first.into_iter().chain(words.map(Some)) {
                    corners.push((self.corner(word)?, self.place(word)));
                }
                let add = |triangle: [usize; 3]| {
                    let [a, b, c] = triangle.map(|at| corners[at]);
                    self.shape.triangles.push([a.0, b.0, c.0]);
                    self.places.push([a.1, b.1, c.1]);
                };
                if corners.len() == 3 {
                    std::iter::once([0, 1, 2]).for_each(add);
                } else {
                    let positions = &self.shape.positions;
                    let place = |at: usize| polygon::position(positions, corners[at].0);
                    polygon::triangles(corners.len(), place)
                        .into_iter()
                        .for_each(add);
                }
                self.corners = corners;
            }
            Some("l") => {
                let (mut last, second) = (self.corner(words.next())?, self.corner(words.next())?);
                self.shape.lines.push([last, second]);
                last = second;
                for word in words {
                    let next = self.corner(Some(word))?;
                    self.shape.lines.push([last, next]);
                    last = next;
                }
            }
            Some("p") => {}
            Some("vt") => {
                let mut numbers = words.map(|word| word.parse::<f64>().ok());
                let pair = numbers.next().flatten().zip(numbers.next().flatten());
                // Counted from the lower edge.
                self.coordinates.push(pair.map(|(u, v)| [u, 1.0 - v]));
                return Ok(());
            }
            Some("mtllib") => {
                self.library = words.next().map(str::to_owned);
                return Ok(());
            }
            Some("usemtl") => {
                let name = words.next().unwrap_or_default();
                if !self.materials.iter().any(|known| known == name) {
                    self.materials.push(name.to_owned());
                }
                return Ok(());
            }
            // Comments, normals, groups, free-form surfaces.
            _ => return Ok(()),
        }
        self.has_known_row = true;
        Ok(())
    }

    /// `v x y z`, optionally followed by a weight or by red, green and blue from 0 to 1.
    fn vertex<'a>(&mut self, words: impl Iterator<Item = &'a str>) -> Result<(), String> {
        let mut numbers = [0.0_f64; 7];
        let mut count = 0;
        for word in words {
            if word.starts_with('#') {
                break;
            }
            if count == numbers.len() {
                return Err("more than seven numbers in a vertex".to_owned());
            }
            numbers[count] = word
                .parse()
                .map_err(|_| format!("`{word}` is not a number"))?;
            count += 1;
        }
        if count < 3 {
            return Err(format!("a vertex has three coordinates, not {count}"));
        }
        if self.shape.positions.len() == u32::MAX as usize {
            return Err("more vertices than 32 bits can count".to_owned());
        }
        let [x, y, z, ..] = numbers;
        let before = self.shape.positions.len();
        self.shape.positions.push(Point3::new(x, y, z));
        // Colours are used only if all vertices have them.
        if count >= 6 && self.colors.len() == before {
            let [r, g, b] = [count - 3, count - 2, count - 1]
                .map(|at| (numbers[at] * 255.0).round().clamp(0.0, 255.0) as u8);
            self.colors.push([r, g, b]);
        }
        Ok(())
    }

    /// A corner such as `7`, `7/1/3` or `-1`, as an index from 0.
    fn corner(&self, word: Option<&str>) -> Result<u32, String> {
        let word = word.ok_or("an element with too few corners")?;
        let number = word.split('/').next().unwrap_or_default();
        let count = self.shape.positions.len();
        let given: i64 = number
            .parse()
            .map_err(|_| format!("`{word}` is not a vertex index"))?;
        let index = match given {
            1.. => given - 1,
            0 => return Err("a reference to vertex 0; vertices count from 1".to_owned()),
            _ => count as i64 + given,
        };
        // A positive index may refer to a later vertex: the range is checked at the end.
        u32::try_from(index)
            .map_err(|_| format!("a reference to vertex {given}, but there are {count} so far"))
    }

    /// The texture coordinate of a corner such as `7/1` or `-1/-1/3`, as an index from 0.
    fn place(&self, word: Option<&str>) -> Option<usize> {
        let given: i64 = word?.split('/').nth(1)?.parse().ok()?;
        let index = if given < 0 {
            self.coordinates.len() as i64 + given
        } else {
            given - 1
        };
        usize::try_from(index).ok()
    }

    /// The texture, when all triangles have texture coordinates and one material with an image.
    fn texture(&self, path: &Path) -> Result<Option<Texture>, String> {
        let ([material], Some(library)) = (self.materials.as_slice(), &self.library) else {
            return Ok(None);
        };
        let coordinate = |place: &Option<usize>| *self.coordinates.get((*place)?)?;
        let of_triangle = |places: &[Option<usize>; 3]| {
            let [a, b, c] = places.each_ref().map(coordinate);
            Some([a?, b?, c?])
        };
        let coordinates: Option<Coordinates> = self.places.iter().map(of_triangle).collect();
        let Some(coordinates) = coordinates.filter(|all| !all.is_empty()) else {
            return Ok(None);
        };
        let library = path.with_file_name(library);
        let text = read_regular(&library)
            .and_then(|bytes| String::from_utf8(bytes).map_err(std::io::Error::other))
            .map_err(|error| format!("its material library {}: {error}", library.display()))?;
        let Some(image) = image_of_material(&text, material) else {
            return Ok(None);
        };
        let image = path.with_file_name(image);
        let file = read_regular(&image)
            .map_err(|error| format!("its texture {}: {error}", image.display()))?;
        let mut texture = decoded(&file, &coordinates)?;
        texture.file = Some(image);
        Ok(Some(texture))
    }

    fn finish(mut self) -> Shape {
        if !self.colors.is_empty() && self.colors.len() == self.shape.positions.len() {
            self.shape.colors = Some(self.colors);
        }
        self.shape
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(bytes: &[u8]) -> Result<Shape, String> {
        super::parse(bytes, None).map(|(shape, _)| shape)
    }

    #[test]
    fn groups_share_their_vertices_and_unused_ones_stay() {
        let text = "# a comment\no one\nv 0 0 0\nv 1 0 0 # beside\nv 1 1 0\nv 9 9 9\nvt 0 0\nvn 0 0 1\n\
                    f 1/1/1 2/1/1 3/1/1\ng two\nusemtl red\nv 0 1 0\nf 1//1 3//1 -1//1\n";
        let shape = parse(text.as_bytes()).unwrap();
        assert_eq!(shape.positions.len(), 5);
        assert_eq!(shape.triangles, [[0, 1, 2], [0, 2, 4]]);
    }

    #[test]
    fn polygons_polylines_and_continued_lines_are_cut() {
        let text =
            "v 0 0 0\r\nv 1 0 0\r\nv 1 1 0\r\nv 0 1 0\r\nf 1 2 \\\r\n 3 4\r\nl 1 2 3 4\r\np 1\r\n";
        let shape = parse(text.as_bytes()).unwrap();
        assert_eq!(shape.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(shape.lines, [[0, 1], [1, 2], [2, 3]]);
    }

    #[test]
    fn colours_count_when_every_vertex_has_them() {
        let shape = parse(b"v 0 0 0 1 0 0.5\nv 1 1 1 0 0 2\n").unwrap();
        assert_eq!(shape.colors, Some(vec![[255, 0, 128], [0, 0, 255]]));
        let shape = parse(b"v 0 0 0 1 0 0.5\nv 1 1 1\nv 2 2 2 1 1 1\n").unwrap();
        assert_eq!(shape.colors, None);
    }

    #[test]
    fn faults_are_named_with_their_line() {
        for (text, line, word) in [
            ("v 0 0\n", "line 1", "three coordinates"),
            ("v 0 0 0\nv x 0 0\n", "line 2", "`x`"),
            ("v 0 0 0\nf 1 1\n", "line 2", "too few"),
            ("v 0 0 0\nf\n", "line 2", "too few"),
            ("v 0 0 0\nf 1 0 1\n", "line 2", "count from 1"),
            ("v 0 0 0\nf 1 -2 1\n", "line 2", "there are 1"),
            ("v 0 0 0\nf 1 a/b 1\n", "line 2", "a/b"),
            ("v 0 0 0\nl 1\n", "line 2", "too few"),
            ("v 0 0 0 1 2 3 4 5\n", "line 1", "seven"),
            ("v 0 0 0\nf 1 99999999999 1\n", "line 2", "99999999999"),
        ] {
            let message = parse(text.as_bytes()).unwrap_err();
            assert!(
                message.contains(line) && message.contains(word),
                "{text:?}: {message}"
            );
        }
        assert!(parse(b"\x00\x01 garbage\n").is_err());
    }
}
