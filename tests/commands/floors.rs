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

/// Crates that only the program needs.
const OF_PROGRAM: [&str; 7] = [
    "anyhow",
    "clap",
    "ctrlc",
    "hyper",
    "hyper-util",
    "indicatif",
    "tokio",
];

/// The packages of the workspace, as cargo describes them.
fn packages() -> Vec<Value> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version=1", "--no-deps", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo starts");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    metadata["packages"].as_array().expect("packages").clone()
}

/// What a package is built from; its tests may use what stands above it.
fn dependencies(package: &Value) -> impl Iterator<Item = &Value> {
    let all = package["dependencies"].as_array().expect("a list").iter();
    all.filter(|dependency| dependency["kind"].is_null())
}

fn name(value: &Value) -> &str {
    value["name"].as_str().expect("a name")
}

/// Names of the crates of the workspace, each with those of the workspace that it is built from.
fn crates() -> BTreeMap<String, Vec<String>> {
    let below = |package: &Value| {
        let of_workspace = dependencies(package).filter(|other| !other["path"].is_null());
        of_workspace.map(|other| name(other).to_owned()).collect()
    };
    let packages = packages();
    let packages = packages.iter();
    packages
        .map(|package| (name(package).to_owned(), below(package)))
        .collect()
}

#[test]
fn the_library_is_built_without_what_only_the_program_needs() {
    for package in packages().iter().filter(|package| name(package) != LAB) {
        for dependency in dependencies(package) {
            let is_of_program = OF_PROGRAM.contains(&name(dependency));
            let is_optional = name(package) == "linecarve" && dependency["optional"] == true;
            assert!(
                !is_of_program || is_optional,
                "{} uses {}",
                name(package),
                name(dependency)
            );
        }
    }
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
