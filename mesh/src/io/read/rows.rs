//! Text with one point per row: `x y z`, separated by blanks, commas or semicolons.
//!
//! Three integers from 0 to 255 after the coordinates are a colour if every row has them; other columns are ignored.
//! Rows that begin with `#` or `//` are comments. A first row of column names or with the number of points is
//! ignored.

use nalgebra::Point3;

use crate::shape::Shape;

/// Parses a file; error messages name the line.
pub(super) fn parse(bytes: &[u8]) -> Result<Shape, String> {
    let mut shape = Shape::default();
    let mut colors = Vec::new();
    let mut is_first = true;
    for (number, line) in bytes.split(|byte| *byte == b'\n').enumerate() {
        let text = String::from_utf8_lossy(line);
        let text = text.trim();
        if text.is_empty() || text.starts_with('#') || text.starts_with("//") {
            continue;
        }
        let words: Vec<&str> = text
            .split(|c: char| c.is_ascii_whitespace() || c == ',' || c == ';')
            .filter(|word| !word.is_empty())
            .collect();
        let numbers: Option<Vec<f64>> =
            words.iter().take(6).map(|word| word.parse().ok()).collect();
        let is_head = std::mem::take(&mut is_first)
            && (words.len() == 1
                || words
                    .first()
                    .is_some_and(|word| word.parse::<f64>().is_err()));
        if is_head {
            continue;
        }
        let Some([x, y, z, rest @ ..]) = numbers.as_deref() else {
            return Err(format!("line {}: three numbers are expected", number + 1));
        };
        if let [r, g, b] = rest
            && colors.len() == shape.positions.len()
            && [r, g, b]
                .iter()
                .all(|c| (0.0..=255.0).contains(*c) && c.fract() == 0.0)
        {
            colors.push([*r as u8, *g as u8, *b as u8]);
        }
        shape.positions.push(Point3::new(*x, *y, *z));
    }
    if !colors.is_empty() && colors.len() == shape.positions.len() {
        shape.colors = Some(colors);
    }
    Ok(shape)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_several_kinds_are_points() {
        let shape = parse(b"# cloud\nx,y,z\n1,2,3\n 4;5 ; 6 \n\n7\t8\t9 0.5\n").unwrap();
        assert_eq!(shape.positions.len(), 3);
        assert_eq!(shape.positions[1], Point3::new(4.0, 5.0, 6.0));
        assert_eq!(shape.colors, None);
        let shape = parse(b"2\n1 2 3 255 0 7\n4 5 6 1 2 3\n").unwrap();
        assert_eq!(shape.colors, Some(vec![[255, 0, 7], [1, 2, 3]]));
    }

    #[test]
    fn a_row_without_three_numbers_is_named() {
        for (text, line) in [("1 2 3\n4 5\n", "line 2"), ("1 2 3\n4 x 6\n", "line 2")] {
            assert!(parse(text.as_bytes()).unwrap_err().contains(line));
        }
        assert!(parse(b"").unwrap().positions.is_empty());
    }
}
