//! The crates of the workspace stand on floors, and use only crates below them.

use std::collections::BTreeMap;
use std::process::Command;

use serde_json::Value;

/// The floors, from the bottom up. A crate that moves up needs a reason; a new floor needs a better one.
const FLOORS: [&[&str]; 5] = [
    &["linecarve-lines", "linecarve-carving"],
    &["linecarve-mesh", "linecarve-points", "linecarve-tiles"],
    &[
        "linecarve-sequence",
        "linecarve-tracking",
        "linecarve-structure",
        "linecarve-synth",
    ],
    &["linecarve-engine"],
    &["linecarve"],
];
/// Measures the product, and is no part of it.
const LAB: &str = "linecarve-lab";

/// Names of the crates of the workspace, each with those that it is built from.
fn crates() -> BTreeMap<String, Vec<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version=1", "--no-deps", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo starts");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let text = |value: &Value| value.as_str().expect("a name").to_owned();
    let packages = metadata["packages"].as_array().expect("packages").iter();
    packages
        .map(|package| {
            let dependencies = package["dependencies"].as_array().expect("a list");
            // Tests may use what stands above.
            let of_workspace = dependencies
                .iter()
                .filter(|dependency| dependency["kind"].is_null() && !dependency["path"].is_null());
            let names = of_workspace.map(|dependency| text(&dependency["name"]));
            (text(&package["name"]), names.collect())
        })
        .collect()
}

#[test]
fn no_crate_uses_one_beside_or_above_it() {
    let floor = |name: &str| FLOORS.iter().position(|floor| floor.contains(&name));
    let crates = crates();
    let listed: usize = FLOORS.iter().map(|floor| floor.len()).sum();
    assert_eq!(crates.len(), listed + 1, "all crates and {LAB}");
    for (name, below) in crates.iter().filter(|(name, _)| *name != LAB) {
        let own = floor(name).unwrap_or_else(|| panic!("{name} has no floor"));
        for other in below {
            let lower = floor(other).unwrap_or_else(|| panic!("{name} uses {other}"));
            assert!(lower < own, "{name} uses {other}, which is not below it");
        }
    }
}

#[test]
fn lines_and_carving_do_not_know_each_other() {
    let crates = crates();
    assert!(crates["linecarve-lines"].is_empty());
    assert!(crates["linecarve-carving"].is_empty());
}
