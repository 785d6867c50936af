//! `docs/configuration.md`, made from the descriptions of tables and keys.

use std::fmt::Write;
use std::path::Path;

use super::{Configuration, Key};

const HEAD: &str = r#"# Configuration

`--config FILE` of `reconstruct`, `lines`, `compare`, `tables` and `stream` reads parameters from a TOML file:

```toml
[keyframes]
rotation_degrees = 8.0

[carving]
labels = "votes"
```

A missing key has its default, an unknown key is refused, and flags override the file. `report.json` has the configuration of a
run as `parameters`: the same keys and values as TOML repeat it. All other parameters are fields of the library crates.

This file is made from the doc comments in `engine/src/configuration/keys.rs`; to make it anew:
`LINECARVE_BLESS=1 cargo test -p linecarve-engine --lib configuration`.
"#;

/// The whole file.
fn document() -> String {
    let defaults = toml::Value::try_from(Configuration::default()).expect("TOML holds numbers");
    let mut text = HEAD.to_owned();
    for table in Configuration::tables() {
        if table.keys.is_empty() {
            continue;
        }
        let doc = lines(table.doc).join("\n");
        write!(text, "\n## `[{}]`\n\n{doc}\n", table.name).expect("memory");
        for key in table.keys {
            let name = key.path.rsplit_once('.').map_or(key.path, |(_, name)| name);
            let default = default_of(&defaults, key)
                .map_or_else(|| "not set".to_owned(), |value| format!("`{value}`"));
            let doc = lines(key.doc).join("\n  ");
            write!(
                text,
                "\n- **`{name}`**: {}. Default: {default}.\n  {doc}\n",
                key.values.text
            )
            .expect("memory");
        }
    }
    text
}

/// The lines of a doc comment, without the space after its slashes.
fn lines(doc: &str) -> Vec<&str> {
    doc.lines().map(str::trim).collect()
}

/// The default as it is written; `None` when there is none.
fn default_of(defaults: &toml::Value, key: &Key) -> Option<String> {
    let value = key
        .path
        .split('.')
        .try_fold(defaults, |value, name| value.get(name))?;
    Some(value.to_string())
}

#[test]
fn the_document_is_up_to_date() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/configuration.md");
    let expected = document();
    if std::env::var_os("LINECARVE_BLESS").is_some() {
        std::fs::write(&path, expected).expect("docs can be written");
        return;
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == expected,
        "docs/configuration.md is not that of the doc comments; to write it: \
         LINECARVE_BLESS=1 cargo test -p linecarve-engine --lib configuration"
    );
}
