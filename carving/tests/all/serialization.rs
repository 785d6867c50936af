//! Ids, options, meshes and deltas survive serialisation; unknown keys are refused.

use linecarve_carving::{
    CarverOptions, CutOptions, ExportOptions, Hull, IndexedMesh, Labels, SurfaceDelta, Votes,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::helpers::carvings::random_carving;

fn returned<T: Serialize + DeserializeOwned>(value: &T) -> T {
    let text = serde_json::to_string(value).unwrap();
    serde_json::from_str(&text).unwrap()
}

#[test]
fn what_is_written_is_read() {
    // Even seeds have whole coordinates, which JSON keeps to the bit.
    let carver = random_carving(4, Hull::Keep);
    let mesh: IndexedMesh = carver.mesh(&ExportOptions::default());
    assert_eq!(returned(&mesh), mesh);
    let delta = SurfaceDelta {
        added: carver.triangles().collect(),
        ..SurfaceDelta::default()
    };
    assert_eq!(returned(&delta), delta);
    for labels in [
        Labels::Votes(Votes::default()),
        Labels::Cut(CutOptions::default()),
    ] {
        let options = CarverOptions::new(labels, Hull::Keep);
        assert_eq!(returned(&options), options);
    }
    let points: Vec<_> = carver.points().collect();
    assert_eq!(returned(&points), points);
}

#[test]
fn keys_left_out_have_their_defaults_and_unknown_keys_are_refused() {
    let options: CarverOptions =
        serde_json::from_str(r#"{"labels": {"cut": {"quality_weight": 2.0}}}"#).unwrap();
    let mut expected = CutOptions::default();
    expected.quality_weight = 2.0;
    assert_eq!(options.labels, Labels::Cut(expected));
    assert!(serde_json::from_str::<ExportOptions>(r#"{"manifolds": true}"#).is_err());
}
