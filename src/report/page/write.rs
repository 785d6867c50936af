//! Writes the page as one file.

use std::io::Write;
use std::path::Path;

use serde::Serialize;

use super::data::{Page, PageData};
use linecarve_mesh::files::{WriteError, write_atomically};

const TEMPLATE: &str = include_str!("../../../assets/report/report.html");
const STYLE: &str = include_str!("../../../assets/report/report.css");
const VIEWER: &str = include_str!("../../../assets/report/viewer.min.js");
const LICENCE: &str = include_str!("../../../assets/report/LICENSE-three.txt");

/// Writes a page atomically.
///
/// # Errors
/// When the file cannot be written.
pub fn write_page(path: &Path, page: &Page) -> Result<(), WriteError> {
    write_atomically(path, |out| fill(out, &PageData::new(page)))
}

/// The page of a run that goes on: without data, which it asks its server for.
///
/// # Errors
/// Only when the template is damaged.
pub(crate) fn live_page() -> std::io::Result<Vec<u8>> {
    let mut page = Vec::new();
    fill(&mut page, &serde_json::json!({ "live": true }))?;
    Ok(page)
}

/// The data of a page as its viewer reads it.
///
/// # Errors
/// When a value cannot be written as JSON, which no page has.
pub(crate) fn page_json(page: &Page) -> serde_json::Result<serde_json::Value> {
    serde_json::to_value(PageData::new(page))
}

/// Replaces each `{{name}}` of the template. Inserted text is not searched again.
fn fill(out: &mut dyn Write, data: &impl Serialize) -> std::io::Result<()> {
    let mut rest = TEMPLATE;
    while let Some((before, after)) = rest.split_once("{{") {
        out.write_all(before.as_bytes())?;
        let Some((name, after)) = after.split_once("}}") else {
            return Err(std::io::Error::other(
                "the page template has an unclosed placeholder",
            ));
        };
        match name {
            "style" => out.write_all(STYLE.as_bytes())?,
            "licence" => out.write_all(LICENCE.as_bytes())?,
            "script" => out.write_all(VIEWER.as_bytes())?,
            "data" => serde_json::to_writer(InsideScript(out), data)?,
            unknown => {
                let message = format!("the page template has the unknown placeholder {unknown}");
                return Err(std::io::Error::other(message));
            }
        }
        rest = after;
    }
    out.write_all(rest.as_bytes())
}

/// Takes JSON that must not end its script element: `<` occurs in strings only and is escaped.
struct InsideScript<'a>(&'a mut dyn Write);

impl Write for InsideScript<'_> {
    fn write(&mut self, json: &[u8]) -> std::io::Result<usize> {
        let mut parts = json.split(|byte| *byte == b'<');
        self.0.write_all(parts.next().unwrap_or_default())?;
        for part in parts {
            self.0.write_all(b"\\u003c")?;
            self.0.write_all(part)?;
        }
        Ok(json.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_leave_the_script() {
        let mut escaped = Vec::new();
        let name = "</script><script>alert(1)</script><!--";
        serde_json::to_writer(InsideScript(&mut escaped), name).unwrap();
        assert!(!escaped.contains(&b'<'));
        let back: String = serde_json::from_slice(&escaped).unwrap();
        assert_eq!(back, "</script><script>alert(1)</script><!--");
    }

    #[test]
    fn the_viewer_can_be_inlined() {
        // Any of these ends an inline script.
        assert!(!VIEWER.to_ascii_lowercase().contains("</script"));
        assert!(!VIEWER.contains("<!--"));
        assert!(!STYLE.to_ascii_lowercase().contains("</style"));
        assert!(!LICENCE.contains("--"));
    }
}
