//! Text files of data sets: lines, numbers and time stamps, with errors that name file and line.

use std::path::Path;

use super::{SequenceError, container};

/// A text file in memory.
pub(super) struct TextFile<'a> {
    path: &'a Path,
    text: String,
}

impl<'a> TextFile<'a> {
    /// Reads a file as UTF-8, or as UTF-16 if it has that byte order mark.
    pub(super) fn read(path: &'a Path) -> Result<Self, SequenceError> {
        let bytes = container::read(path).map_err(|source| SequenceError::Unreadable {
            path: path.to_owned(),
            source,
        })?;
        Self::decode(path, &bytes)
    }

    fn decode(path: &'a Path, bytes: &[u8]) -> Result<Self, SequenceError> {
        let not_text = || SequenceError::Content {
            path: path.to_owned(),
            problem: "is not a text file: UTF-8 expected".to_owned(),
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
        // Lines ending with a carriage return alone.
        let text = if text.contains('\r') && !text.contains('\n') {
            text.replace('\r', "\n")
        } else {
            text
        };
        Ok(Self { path, text })
    }

    /// The lines with data; blank lines and `#` comments are skipped.
    pub(super) fn rows(&self) -> impl Iterator<Item = TextLine<'_>> {
        self.lines()
            .filter(|row| !row.text.is_empty() && !row.text.starts_with('#'))
    }

    /// All lines.
    pub(super) fn lines(&self) -> impl Iterator<Item = TextLine<'_>> {
        self.text.lines().enumerate().map(|(index, text)| TextLine {
            path: self.path,
            number: index + 1,
            text: text.trim(),
        })
    }

    /// The whole text.
    pub(super) fn text(&self) -> &str {
        &self.text
    }
}

/// A line of a text file.
#[derive(Clone, Copy)]
pub(super) struct TextLine<'a> {
    path: &'a Path,
    number: usize,
    text: &'a str,
}

impl<'a> TextLine<'a> {
    /// The line, trimmed.
    pub(super) fn text(&self) -> &'a str {
        self.text
    }

    /// Fields separated by blanks, commas or semicolons.
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

    /// Line number in the file, from 1.
    pub(super) fn number(&self) -> usize {
        self.number
    }

    /// Exactly `N` numbers, which may be NaN or infinite.
    pub(super) fn numbers<const N: usize>(&self) -> Result<[f64; N], SequenceError> {
        let count = self.fields().count();
        if count != N {
            return Err(self.error(format!("expected {N} numbers, found {count}")));
        }
        self.numbers_from(0)
    }

    /// `N` numbers after the first `skipped` fields; further fields are ignored.
    pub(super) fn numbers_from<const N: usize>(
        &self,
        skipped: usize,
    ) -> Result<[f64; N], SequenceError> {
        let mut out = [0.0; N];
        let mut count = 0;
        for (slot, field) in out.iter_mut().zip(self.fields().skip(skipped)) {
            *slot = parse_number(field)
                .ok_or_else(|| self.error(format!("'{}' is not a number", shorten(field))))?;
            count += 1;
        }
        if count < N {
            return Err(self.error(format!(
                "expected at least {} fields, found {}",
                skipped + N,
                skipped + count
            )));
        }
        Ok(out)
    }
}

/// A field for a message, truncated to 40 characters.
pub(super) fn shorten(field: &str) -> String {
    if field.chars().count() <= 40 {
        field.to_owned()
    } else {
        field.chars().take(37).chain("...".chars()).collect()
    }
}

/// Parses a decimal number, or what C libraries print for NaN and infinity (`nan`, `-1.#IND`, `1.#QNAN`, `1.#INF`).
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

/// Parses seconds in decimal or scientific notation as nanoseconds. The conversion is exact: a double would round the
/// nanoseconds of a present-day stamp to multiples of 238.
///
/// Numbers with at least 16 digits before the point are nanoseconds. Digits beyond the ninth decimal are rounded half
/// away from zero. `None` if the text is not a number or does not fit.
pub(crate) fn parse_stamp_ns(field: &str) -> Option<i64> {
    parse_stamp(field)?.as_written_ns()
}

/// A unit of time stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TimeUnit {
    Second,
    Millisecond,
    Microsecond,
    Nanosecond,
}

impl TimeUnit {
    pub(super) const ALL: [Self; 4] = [
        Self::Second,
        Self::Nanosecond,
        Self::Microsecond,
        Self::Millisecond,
    ];

    /// Name of the unit.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Second => "seconds",
            Self::Millisecond => "milliseconds",
            Self::Microsecond => "microseconds",
            Self::Nanosecond => "nanoseconds",
        }
    }
}

/// A time stamp of unknown unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stamp {
    /// The number times 1e9.
    billionths: i128,
    /// Whether it looks like nanoseconds: at least 16 digits before the point, no exponent.
    pub(super) is_nanoseconds: bool,
}

impl std::fmt::Display for Stamp {
    /// The number, with nine decimals if it is not an integer.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let unit: u128 = 1_000_000_000;
        let magnitude = self.billionths.unsigned_abs();
        if self.billionths < 0 {
            write!(f, "-")?;
        }
        write!(f, "{}", magnitude / unit)?;
        match magnitude % unit {
            0 => Ok(()),
            decimals => write!(f, ".{decimals:09}"),
        }
    }
}

impl Stamp {
    /// The unit suggested by the notation.
    pub(super) fn unit_as_written(self) -> TimeUnit {
        if self.is_nanoseconds {
            TimeUnit::Nanosecond
        } else {
            TimeUnit::Second
        }
    }

    /// The time in nanoseconds, in the unit suggested by the notation; `None` if it does not fit.
    pub(super) fn as_written_ns(self) -> Option<i64> {
        self.in_nanoseconds(self.unit_as_written())
    }

    /// The number, if it is a non-negative integer.
    pub(super) fn whole_number(self) -> Option<u64> {
        let unit: i128 = 1_000_000_000;
        (self.billionths % unit == 0)
            .then(|| u64::try_from(self.billionths / unit).ok())
            .flatten()
    }

    /// The time in nanoseconds if the number counts `unit`s; `None` if it does not fit.
    pub(super) fn in_nanoseconds(self, unit: TimeUnit) -> Option<i64> {
        let divisor: i128 = match unit {
            TimeUnit::Second => 1,
            TimeUnit::Millisecond => 1_000,
            TimeUnit::Microsecond => 1_000_000,
            TimeUnit::Nanosecond => 1_000_000_000,
        };
        let half = self.billionths.signum() * (divisor / 2);
        i64::try_from((self.billionths + half) / divisor).ok()
    }
}

/// Parses a number in decimal or scientific notation, exact to nine decimals; `None` if the text is not a number or too
/// large for a time.
pub(super) fn parse_stamp(field: &str) -> Option<Stamp> {
    /// More than a 64-bit time in nanoseconds with nine decimals has.
    const MAX_DIGITS: i64 = 31;
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
    let has_exponent = mantissa.len() != unsigned.len();
    // The value is 0.DIGITS * 10^(whole.len() + exponent); its billionths are the first `kept` digits.
    let digits = whole.bytes().chain(decimals.bytes()).map(|b| b - b'0');
    let kept = i64::try_from(whole.len()).ok()? + i64::from(exponent) + 9;
    let available = (whole.len() + decimals.len()) as i64;
    let mut value: i128 = 0;
    for (position, digit) in (0_i64..).zip(digits) {
        if position < kept {
            value = value.checked_mul(10)?.checked_add(i128::from(digit))?;
        } else {
            if position == kept && digit >= 5 {
                value = value.checked_add(1)?;
            }
            break;
        }
    }
    if value != 0 {
        if kept - available > MAX_DIGITS {
            return None;
        }
        for _ in available..kept {
            value = value.checked_mul(10)?;
        }
    }
    // Leaves room for rounding in the unit conversion.
    if value > i128::MAX / 4 {
        return None;
    }
    Some(Stamp {
        billionths: if is_negative { -value } else { value },
        is_nanoseconds: !has_exponent && whole.trim_start_matches('0').len() >= 16,
    })
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
            ("1403715274312143104.0000000000", 1_403_715_274_312_143_104),
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
            "poses.txt, line 4: expected 3 numbers, found 2"
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
