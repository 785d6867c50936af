//! `docs/faults.md` names the tests that hold its rows. They exist.

use std::collections::BTreeSet;
use std::path::Path;

/// Rows without a test of their own. There must not be more.
const UNTESTED: usize = 2;

/// Adds the names of the test functions of a file of Rust.
fn add_tests(text: &str, names: &mut BTreeSet<String>) {
    let mut is_test = false;
    for line in text.lines().map(str::trim) {
        let function = line
            .strip_prefix("fn ")
            .and_then(|rest| rest.split('(').next());
        match function {
            Some(name) if is_test => {
                names.insert(name.to_owned());
                is_test = false;
            }
            Some(_) => is_test = false,
            None => is_test |= line == "#[test]",
        }
    }
}

/// Adds the names of the tests below a folder.
fn add_folder(folder: &Path, names: &mut BTreeSet<String>) {
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        if path.is_dir() {
            add_folder(&path, names);
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            add_tests(&std::fs::read_to_string(&path).unwrap(), names);
        }
    }
}

#[test]
fn every_fault_names_tests_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut names = BTreeSet::new();
    for member in std::fs::read_dir(root).unwrap().flatten() {
        for part in ["src", "tests"].map(|part| member.path().join(part)) {
            if part.is_dir() {
                add_folder(&part, &mut names);
            }
        }
    }
    for part in ["src", "tests"] {
        add_folder(&root.join(part), &mut names);
    }
    assert!(names.contains("every_fault_names_tests_that_exist"));

    let page = std::fs::read_to_string(root.join("docs/faults.md")).unwrap();
    let is_row = |line: &&str| line.starts_with("| ") && !line.ends_with("| test |");
    let (mut rows, mut untested) = (0, 0);
    for row in page.lines().filter(is_row) {
        let tests = row.trim_end_matches(" |").rsplit(" | ").next().unwrap();
        rows += 1;
        if tests == "—" {
            untested += 1;
            continue;
        }
        for name in tests.split(", ").map(|name| name.trim_matches('`')) {
            assert!(names.contains(name), "{name}: there is no such test\n{row}");
        }
    }
    assert!(rows > 60, "{rows}");
    assert!(untested <= UNTESTED, "{untested} rows have no test");
}
