//! Any bytes as a video file, MP4, MOV or Y4M: its pictures, or an error that names the file.
//!
//! In the folder above, with a recorded video as a seed:
//!
//! ```text
//! export RUSTC_BOOTSTRAP=1
//! mkdir -p fuzz/corpus/videos && cp VIDEO.mp4 fuzz/corpus/videos/
//! cargo fuzz run videos -- -rss_limit_mb=4096 -max_len=4000000
//! ```

#![no_main]

use libfuzzer_sys::fuzz_target;
use linecarve_engine::run::ProgressHook;
use linecarve_engine::video::{is_video, unpack};

fuzz_target!(|data: &[u8]| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("video.mp4");
    std::fs::write(&path, data).expect("a file in a temporary folder");
    if !is_video(&path) {
        return;
    }
    match unpack(&path, folder.path(), &ProgressHook::default()) {
        Ok(_) => assert!(folder.path().join("images").is_dir()),
        Err(error) => assert!(error.to_string().contains("video.mp4"), "{error}"),
    }
});
