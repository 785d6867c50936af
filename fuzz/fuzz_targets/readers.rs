//! Any bytes as any file that a reader reads: what it holds, or an error that names the place. The first byte chooses the
//! case, the rest is what stands in its file; the other files of its folder are well.
//!
//! In the folder above, with a stable toolchain (`cargo +nightly` needs no variable):
//!
//! ```text
//! export RUSTC_BOOTSTRAP=1
//! LINECARVE_FUZZ_SEEDS=fuzz/corpus/readers cargo fuzz run readers -- -runs=1     # writes a well file of each case
//! cargo fuzz run readers -- -rss_limit_mb=1024
//! ```

#![no_main]
#![allow(dead_code, reason = "the tests of layouts use more of the writers")]

#[path = "../../sequence/tests/layouts/folder_writers.rs"]
mod folder_writers;
#[path = "../../sequence/tests/layouts/geometry_files.rs"]
mod geometry_files;
#[path = "../../sequence/tests/layouts/support.rs"]
mod support;
#[path = "../../sequence/tests/layouts/writers.rs"]
mod writers;

mod cases;

use std::path::Path;
use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use linecarve_engine::Options;
use linecarve_engine::front_end::{FeatureKeyframe, Keyframe, LineKeyframe};
use linecarve_engine::map::Map;
use linecarve_engine::run::{CHECKPOINT_FOLDER, Checkpoint, RunDescription};
use linecarve_engine::stream::{Message, Session};
use linecarve_mesh::read_geometry;
use linecarve_sequence::export::{
    TrajectoryFormat, posed_images, write_colmap, write_trajectory, write_transforms,
};
use linecarve_sequence::{InspectOptions, OpenOptions, Sequence, inspect};

use cases::{Case, Cases, Kind};

fn cases() -> &'static Cases {
    static CASES: OnceLock<Cases> = OnceLock::new();
    CASES.get_or_init(Cases::write)
}

fuzz_target!(
    init: {
        if let Some(folder) = std::env::var_os("LINECARVE_FUZZ_SEEDS") {
            cases().write_seeds(Path::new(&folder));
        }
    },
    |data: &[u8]| {
        let Some((&which, bytes)) = data.split_first() else {
            return;
        };
        let cases = cases();
        let case = &cases.list[usize::from(which) % cases.list.len()];
        if case.kind == Kind::Messages {
            converse(bytes);
            return;
        }
        let path = case.folder.join(&case.file);
        if case.kind == Kind::Kept {
            resume(&case.folder, bytes);
            return;
        }
        std::fs::write(&path, bytes).expect("a file in a temporary folder");
        match case.kind {
            Kind::Geometry => geometry(&path),
            _ => sequence(case, &path, bytes.len()),
        }
        std::fs::write(&path, &case.well).expect("a file in a temporary folder");
    }
);

/// Opens the sequence and does with it what commands do; each only now and then, as it takes longer than reading.
fn sequence(case: &Case, path: &Path, length: usize) {
    let mut options = OpenOptions::default();
options.poses = (case.kind == Kind::Trajectory).then(|| path.to_owned());
    let sequence = match Sequence::open(&case.folder, &options) {
        Ok(sequence) => sequence,
        Err(error) => {
            let message = error.to_string();
            assert!(
                message.contains(&*case.folder.to_string_lossy()),
                "{message}"
            );
            return;
        }
    };
    for frame in sequence.frames() {
        let pose = frame.world_from_camera.to_homogeneous();
        assert!(pose.iter().all(|value| value.is_finite()));
    }
    if let Some(model) = sequence.sparse_model() {
        for point in &model.points {
            assert!(point.point_in_world.iter().all(|value| value.is_finite()));
            assert!(
                point
                    .observations
                    .iter()
                    .all(|s| (s.view as usize) < model.views.len())
            );
        }
    }
    if !sequence.frames().is_empty() {
        let _ = sequence.load_gray(0);
        let _ = sequence.load_color(0);
        let _ = sequence.load_depth(0);
    }
    match length % 8 {
        0 => {
            let _ = inspect(&sequence, &InspectOptions::default());
        }
        1 => {
            let folder = tempfile::tempdir().expect("a temporary folder");
            let _ = write_colmap(folder.path(), &sequence);
            let _ = write_transforms(&folder.path().join("transforms.json"), &sequence);
            let images = posed_images(&sequence);
            write_trajectory(
                &folder.path().join("poses.txt"),
                TrajectoryFormat::Tum,
                &images,
            )
            .expect("a file in a temporary folder");
        }
        2 => {
            if let Some(model) = sequence.sparse_model()
                && let Ok(mut map) = Map::of_model(&Options::default(), model.clone())
                && map.push(&Keyframe::Views(0..model.views.len())).is_ok()
            {
                let _ = map.surface();
            }
        }
        _ => {}
    }
}

fn geometry(path: &Path) {
    match read_geometry(path) {
        Ok(shape) => shape.validate().expect("what is read is valid"),
        Err(error) => {
            let message = error.to_string();
            assert!(message.contains(&*path.to_string_lossy()), "{message}");
        }
    }
}

/// Messages of a stream, a line each.
fn converse(bytes: &[u8]) {
    let mut session = Session::new(Options::default()).expect("a temporary folder");
    for line in bytes.split(|byte| *byte == b'\n') {
        if let Ok(message) = serde_json::from_slice::<Message>(line)
            && let Err(error) = session.handle(&message)
        {
            assert!(!error.to_string().is_empty());
        }
    }
    let _ = session.finish();
}

/// What a run has kept, under a right checksum: damage that only a hostile hand can do.
fn resume(output: &Path, bytes: &[u8]) {
    let description = RunDescription {
        text: String::new(),
        files: Vec::new(),
    };
    let run = Checkpoint::open(output, &description, false).expect("a temporary folder");
    let sum = bytes.iter().fold(0xcbf2_9ce4_8422_2325_u64, |sum, byte| {
        (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    });
    let file = output.join(CHECKPOINT_FOLDER).join("000000.keyframe");
    std::fs::write(file, [bytes, &sum.to_le_bytes()].concat())
        .expect("a file in a temporary folder");
    let _ = run.load::<LineKeyframe>(0);
    let _ = run.load::<FeatureKeyframe>(0);
}
