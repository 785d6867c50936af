//! Options that would have no effect are refused: nobody is to believe that they had one.

use std::path::Path;

use anyhow::ensure;

use linecarve_engine::configuration::Configuration;

/// Refuses options that have no effect, for this reason.
///
/// # Errors
/// When one was given.
pub(super) fn refuse_unused(given: &[&'static str], reason: &str) -> anyhow::Result<()> {
    let names = given.join(", ");
    ensure!(
        given.is_empty(),
        "no effect of {names}: {reason}; leave out {names}"
    );
    Ok(())
}

/// Reads a configuration in which these tables have no effect.
///
/// # Errors
/// When it cannot be read, or one of the tables has a value that is not the default.
pub(super) fn read_configuration(path: &Path, unused: &[&str]) -> anyhow::Result<Configuration> {
    let (found, plain) = (Configuration::read(path)?, Configuration::default());
    let set = [
        ("keyframes", found.keyframes != plain.keyframes),
        ("images", found.images != plain.images),
        ("sensor", found.sensor != plain.sensor),
        ("semi_dense", found.semi_dense != plain.semi_dense),
        (
            "pose_correction",
            found.pose_correction != plain.pose_correction,
        ),
        ("simplify", found.simplify != plain.simplify),
    ];
    for (name, is_set) in set {
        let remedy = match name {
            "simplify" => ", and use `linecarve simplify` on the mesh",
            _ => "",
        };
        ensure!(
            !is_set || !unused.contains(&name),
            "{}: [{name}] has no effect on this command: leave the table out{remedy}",
            path.display()
        );
    }
    Ok(found)
}
