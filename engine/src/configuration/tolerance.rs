//! How a tolerance is written: `0.002` is a length, `"0.02%"` a share of the diagonal.

use linecarve_mesh::diff::Tolerance;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Written {
    Length(f64),
    Text(String),
}

pub(super) fn serialize<S: Serializer>(
    tolerance: &Option<Tolerance>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    tolerance
        .map(|tolerance| match tolerance {
            Tolerance::Length(length) => Written::Length(length),
            Tolerance::ShareOfDiagonal(share) => Written::Text(format!("{}%", percent(share))),
        })
        .serialize(serializer)
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<Tolerance>, D::Error> {
    let text = match Written::deserialize(deserializer)? {
        Written::Length(length) => length.to_string(),
        Written::Text(text) => text,
    };
    text.parse().map(Some).map_err(D::Error::custom)
}

/// The shortest number that is read back as this share.
fn percent(share: f64) -> f64 {
    (0..17)
        .filter_map(|digits| format!("{:.digits$e}", 100.0 * share).parse().ok())
        .find(|percent: &f64| percent / 100.0 == share)
        .unwrap_or(100.0 * share)
}
