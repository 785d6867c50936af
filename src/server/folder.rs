//! A folder that is served.

use std::fs::File;
use std::path::{Path, PathBuf};

use super::{Answer, Body, Refusal, Site};

/// The file that `/` stands for.
pub(crate) const PAGE: &str = "report.html";

/// A folder that is served, by its real path.
pub(crate) struct Folder(pub(crate) PathBuf);

impl Site for Folder {
    fn answer(&self, path: &str) -> Result<Answer, Refusal> {
        let (file, path, length) = self.file(path).ok_or(Refusal::Missing)?;
        Ok(Answer {
            content_type: content_type(&path),
            body: Body::File(file, length),
        })
    }
}

impl Folder {
    /// The file that a request means, and its length; `None` when there is none, or when it is hidden or lies outside the folder.
    fn file(&self, path: &str) -> Option<(File, PathBuf, u64)> {
        let Self(root) = self;
        // Symbolic links are followed by this, so that none leads outside or to what is hidden.
        let real = root.join(relative_path(path)?).canonicalize().ok()?;
        let inside = real.strip_prefix(root).ok()?;
        let is_hidden = |part: &std::ffi::OsStr| part.as_encoded_bytes().starts_with(b".");
        if inside.iter().any(is_hidden) || !real.is_file() {
            return None;
        }
        let file = File::open(&real).ok()?;
        let length = file.metadata().ok()?.len();
        Some((file, real, length))
    }
}

/// The path below the root that a request names; `None` for what would leave it or cannot be a name.
fn relative_path(url: &str) -> Option<PathBuf> {
    let path = url.split(['?', '#']).next()?;
    let decoded = percent_decoded(path.strip_prefix('/')?)?;
    if decoded.is_empty() {
        return Some(PathBuf::from(PAGE));
    }
    let mut relative = PathBuf::new();
    for part in decoded.split('/') {
        let is_name = !part.is_empty()
            // Hidden files, and the folders `.` and `..`.
            && !part.starts_with('.')
            && !part.contains(['\\', ':'])
            && !part.contains(char::is_control);
        if !is_name {
            return None;
        }
        relative.push(part);
    }
    Some(relative)
}

/// Text with its `%41` replaced; `None` when that is malformed or not UTF-8.
fn percent_decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let mut digit = || char::from(rest.next()?).to_digit(16);
        bytes.push((digit()? * 16 + digit()?) as u8);
    }
    String::from_utf8(bytes).ok()
}

fn content_type(path: &Path) -> &'static str {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("html") => "text/html; charset=utf-8",
        Some("json") => "application/json",
        Some("png") => "image/png",
        Some("glb") => "model/gltf-binary",
        Some("obj") => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_name_files_below_the_root() {
        let path = |url: &str| relative_path(url);
        assert_eq!(path("/"), Some(PathBuf::from("report.html")));
        assert_eq!(path("/?a=1"), Some(PathBuf::from("report.html")));
        assert_eq!(
            path("/keyframes/000001.glb"),
            Some(PathBuf::from("keyframes/000001.glb"))
        );
        assert_eq!(path("/a%20b.png#x"), Some(PathBuf::from("a b.png")));
    }

    #[test]
    fn nothing_leads_outside() {
        for url in [
            "/../secret",
            "/a/../../secret",
            "/%2e%2e/secret",
            "/%2e%2e%2fsecret",
            "/..%5csecret",
            "/a//b",
            "//etc/passwd",
            "/%2fetc/passwd",
            "/C:/secret",
            "/./a",
            "/.linecarve/run.json",
            "/keyframes/.hidden",
            "/%2elinecarve",
            "/a%00b",
            "/%zz",
            "/%f",
            "/%ff",
            "report.html",
            "http://elsewhere/",
        ] {
            assert_eq!(relative_path(url), None, "{url}");
        }
    }
}
