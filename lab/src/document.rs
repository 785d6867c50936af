//! Sections of Markdown files that a command writes, between `<!-- NAME:begin -->` and `<!-- NAME:end -->`.

use std::ops::Range;

/// The text between the markers of a section; `None` when a marker is missing.
pub fn section<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    range(text, name).map(|range| &text[range])
}

/// The text with a section replaced; `None` when a marker is missing.
pub fn with_section(text: &str, name: &str, section: &str) -> Option<String> {
    let range = range(text, name)?;
    let (before, after) = (&text[..range.start], &text[range.end..]);
    Some(format!("{before}\n{}\n{after}", section.trim_end()))
}

/// An empty section.
pub fn empty_section(name: &str) -> String {
    format!("{}\n{}\n", begin(name), end(name))
}

/// The rows of the tables in a text.
pub fn table_rows(text: &str) -> impl Iterator<Item = &str> {
    text.lines()
        .map(str::trim)
        .filter(|line| line.starts_with('|'))
}

fn range(text: &str, name: &str) -> Option<Range<usize>> {
    let marker = begin(name);
    let start = text.find(&marker)? + marker.len();
    let length = text[start..].find(&end(name))?;
    Some(start..start + length)
}

fn begin(name: &str) -> String {
    format!("<!-- {name}:begin -->")
}

fn end(name: &str) -> String {
    format!("<!-- {name}:end -->")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_is_replaced_and_read_back() {
        let text = format!("before\n\n{}\nafter\n", empty_section("results"));
        let filled = with_section(&text, "results", "| a | b |\n|---|---|\n").unwrap();
        assert_eq!(
            filled,
            "before\n\n<!-- results:begin -->\n| a | b |\n|---|---|\n<!-- results:end -->\n\nafter\n"
        );
        let section = section(&filled, "results").unwrap();
        assert_eq!(table_rows(section).count(), 2);
        // Writing the same section again changes nothing.
        assert_eq!(
            with_section(&filled, "results", section.trim_start()).as_ref(),
            Some(&filled)
        );
    }

    #[test]
    fn a_missing_marker_is_no_section() {
        assert_eq!(section("text", "results"), None);
        assert_eq!(with_section("<!-- results:begin -->", "results", ""), None);
    }
}
