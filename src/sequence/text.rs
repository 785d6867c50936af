//! Small text files of data sets: lines, numbers and time stamps, with errors that name file and line.

use std::path::Path;

use super::SequenceError;

/// A text file in memory.
pub(super) struct TextFile<'a> {
    path: &'a Path,
    text: String,
}

impl<'a> TextFile<'a> {
    /// Reads a file as UTF-8 (a byte order mark is skipped) or, when its mark says so, UTF-16.
    pub(super) fn read(path: &'a Path) -> Result<Self, SequenceError> {
        let bytes = std::fs::read(path).map_err(|source| SequenceError::Unreadable {
            path: path.to_owned(),
            source,
        })?;
        Self::decode(path, &bytes)
    }

    fn decode(path: &'a Path, bytes: &[u8]) -> Result<Self, SequenceError> {
        let not_text = || SequenceError::Content {
            path: path.to_owned(),
            problem: "is not a text file (UTF-8 expected)".to_owned(),
        };
        let utf16 = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
            let units = bytes.chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
            char::decode_utf16(units)
                .collect::<Result<String, _>>()
                .map_err(|_| not_text())
        };
        let text = match bytes {
            [0xFF, 0xFE, rest @ ..] => utf16(rest, u16::from_le_bytes)?,
            [0xFE, 0xFF, rest @ ..] => utf16(rest, u16::from_be_bytes)?,
            [0xEF, 0xBB, 0xBF, rest @ ..] | rest => {
                String::from_utf8(rest.to_vec()).map_err(|_| not_text())?
            }
        };
        if text.contains('\0') {
            return Err(not_text());
        }
        Ok(Self { path, text })
    }

    /// The lines that hold something: blank lines and those that start with `#` are passed over.
    pub(super) fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.text
            .lines()
            .enumerate()
            .map(|(index, text)| Row {
                path: self.path,
                number: index + 1,
                text: text.trim(),
            })
            .filter(|row| !row.text.is_empty() && !row.text.starts_with('#'))
    }

    /// The whole text.
    pub(super) fn text(&self) -> &str {
        &self.text
    }
}

/// A line of a text file.
#[derive(Clone, Copy)]
pub(super) struct Row<'a> {
    path: &'a Path,
    number: usize,
    text: &'a str,
}

impl<'a> Row<'a> {
    /// The line without blanks at its ends.
    pub(super) fn text(&self) -> &'a str {
        self.text
    }

    /// What stands between blanks or commas.
    pub(super) fn fields(&self) -> impl Iterator<Item = &'a str> {
        self.text
            .split(|c: char| c.is_whitespace() || c == ',' || c == ';')
            .filter(|field| !field.is_empty())
    }

    /// An error at this line.
    pub(super) fn error(&self, problem: String) -> SequenceError {
        SequenceError::Line {
            path: self.path.to_owned(),
            line: self.number,
            problem,
        }
    }

    /// Exactly `N` numbers, which may be NaN or infinite.
    pub(super) fn numbers<const N: usize>(&self) -> Result<[f64; N], SequenceError> {
        let mut out = [0.0; N];
        let count = self.fields().count();
        if count != N {
            return Err(self.error(format!("{N} numbers expected, {count} found")));
        }
        for (slot, field) in out.iter_mut().zip(self.fields()) {
            *slot = parse_number(field)
                .ok_or_else(|| self.error(format!("'{}' is not a number", shorten(field))))?;
        }
        Ok(out)
    }
}

/// A field for a message, cut when it is long.
pub(super) fn shorten(field: &str) -> String {
    if field.chars().count() <= 40 {
        field.to_owned()
    } else {
        field.chars().take(37).chain("...".chars()).collect()
    }
}

/// A decimal number, or what C libraries print for numbers that are none (`nan`, `-1.#IND`, `1.#QNAN`, `1.#INF`).
pub(super) fn parse_number(field: &str) -> Option<f64> {
    match field.parse::<f64>() {
        Ok(value) => Some(value),
        Err(_) => {
            let unsigned = field.trim_start_matches(['-', '+']);
            let is_printed_nan = unsigned.starts_with("1.#") || {
                let lower = unsigned.to_ascii_lowercase();
                lower.starts_with("nan(") && lower.ends_with(')')
            };
            is_printed_nan.then_some(f64::NAN)
        }
    }
}

/// Seconds in decimal or scientific notation as whole nanoseconds, without passing through a float: a stamp of the
/// year 2011 has ten digits before the point, and a double would round its nanoseconds to multiples of 238.
///
/// Whole numbers of 16 digits and more are nanoseconds already. `None` when the text is not a number or does not fit.
/// Digits beyond the ninth decimal are rounded half away from zero.
pub(crate) fn parse_stamp_ns(field: &str) -> Option<i64> {
    let (is_negative, unsigned) = match field.as_bytes().first()? {
        b'-' => (true, &field[1..]),
        b'+' => (false, &field[1..]),
        _ => (false, field),
    };
    let (mantissa, exponent) = match unsigned.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
        None => (unsigned, 0),
    };
    let (whole, decimals) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let is_digits = |text: &str| text.bytes().all(|b| b.is_ascii_digit());
    if whole.len() + decimals.len() == 0 || !is_digits(whole) || !is_digits(decimals) {
        return None;
    }
    let is_bare = whole.len() == unsigned.len();
    let exponent = if is_bare && whole.trim_start_matches('0').len() >= 16 {
        -9
    } else {
        exponent
    };
    // The value is 0.DIGITS * 10^(whole.len() + exponent); its nanoseconds are the first `kept` digits.
    let digits = whole.bytes().chain(decimals.bytes()).map(|b| b - b'0');
    let kept = i64::try_from(whole.len()).ok()? + i64::from(exponent) + 9;
    let available = (whole.len() + decimals.len()) as i64;
    let mut value: i64 = 0;
    for (position, digit) in (0_i64..).zip(digits) {
        if position < kept {
            value = value.checked_mul(10)?.checked_add(i64::from(digit))?;
        } else {
            if position == kept && digit >= 5 {
                value = value.checked_add(1)?;
            }
            break;
        }
    }
    if value != 0 {
        for _ in available..kept {
            value = value.checked_mul(10)?;
        }
    }
    Some(if is_negative { -value } else { value })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn stamps_are_exact() {
        for (text, expected) in [
            ("1305031102.175304", 1_305_031_102_175_304_000),
            ("1305031102.175304001", 1_305_031_102_175_304_001),
            ("1305031102.1753040014", 1_305_031_102_175_304_001),
            ("1305031102.1753040015", 1_305_031_102_175_304_002),
            ("1.305031102175304001e+09", 1_305_031_102_175_304_001),
            ("1305031102175304001e-9", 1_305_031_102_175_304_001),
            ("1305031102175304001", 1_305_031_102_175_304_001),
            ("12", 12_000_000_000),
            ("12.", 12_000_000_000),
            (".5", 500_000_000),
            ("-0.25", -250_000_000),
            ("0", 0),
            ("1e-10", 0),
            ("0e400", 0),
        ] {
            assert_eq!(parse_stamp_ns(text), Some(expected), "{text}");
        }
        for text in [
            "",
            ".",
            "-",
            "e5",
            "1e",
            "1e400",
            "nan",
            "inf",
            "1.2.3",
            "0x10",
            "12 ",
            "99999999999",
        ] {
            assert_eq!(parse_stamp_ns(text), None, "{text}");
        }
    }

    #[test]
    fn printed_nan_is_nan() {
        for text in [
            "nan",
            "NaN",
            "-nan",
            "-1.#IND",
            "1.#QNAN0",
            "nan(ind)",
            "-nan(ind)",
        ] {
            assert!(parse_number(text).unwrap().is_nan(), "{text}");
        }
        assert_eq!(parse_number("inf"), Some(f64::INFINITY));
        assert_eq!(parse_number("1,5"), None);
    }

    #[test]
    fn rows_know_their_line_whatever_the_line_ends() {
        let path = Path::new("poses.txt");
        let file =
            TextFile::decode(path, b"\xEF\xBB\xBF# head\r\n\r\n 1, 2\t3 \r\n1 2\r\n").unwrap();
        let rows: Vec<_> = file.rows().collect();
        assert_eq!(rows[0].numbers::<3>().unwrap(), [1.0, 2.0, 3.0]);
        assert_eq!(
            rows[1].numbers::<3>().unwrap_err().to_string(),
            "poses.txt, line 4: 3 numbers expected, 2 found"
        );
    }

    #[test]
    fn utf16_is_read_and_binary_is_refused() {
        let path = Path::new("poses.txt");
        let mut bytes = vec![0xFF, 0xFE];
        bytes.extend("1 2\n".encode_utf16().flat_map(u16::to_le_bytes));
        let file = TextFile::decode(path, &bytes).unwrap();
        assert_eq!(file.rows().next().unwrap().numbers().unwrap(), [1.0, 2.0]);
        for bytes in [&b"\x80abc"[..], b"a\0b", &[0xFE, 0xFF, 0xD8, 0x00]] {
            assert!(TextFile::decode(path, bytes).is_err());
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_stamp_or_none(text in "\\PC{0,30}|[0-9.eE+-]{0,30}") {
            let _ = parse_stamp_ns(&text);
            let _ = parse_number(&text);
        }

        #[test]
        fn stamps_survive_printing(ns in 0_i64..i64::MAX) {
            let text = format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000);
            prop_assert_eq!(parse_stamp_ns(&text), Some(ns));
        }

        #[test]
        fn any_bytes_are_text_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(file) = TextFile::decode(Path::new("x"), &bytes) {
                for row in file.rows() {
                    let _ = row.numbers::<4>();
                }
            }
        }
    }
}
