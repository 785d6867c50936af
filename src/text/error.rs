//! Errors with their causes.

/// An error and its causes in one line. A cause that the text before it contains is not said again: many errors quote theirs.
pub fn error_text(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for part in error.chain().map(ToString::to_string) {
        if text.is_empty() {
            text = part;
        } else if !text.contains(&part) {
            text.push_str(": ");
            text.push_str(&part);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, thiserror::Error)]
    #[error("cannot read a.txt: {source} (copy it again)")]
    struct Quoting {
        source: std::io::Error,
    }

    #[test]
    fn causes_are_said_once() {
        let source = std::io::Error::other("the disk is gone");
        let error = anyhow::Error::new(Quoting { source }).context("the trajectory");
        let expected = "the trajectory: cannot read a.txt: the disk is gone (copy it again)";
        assert_eq!(error_text(&error), expected);
    }
}
