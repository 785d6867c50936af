//! The readers of the layouts, one file each, and parts shared by several.

pub(super) mod arkit_scenes;
mod camera_json;
pub(super) mod colmap;
pub(super) mod depth_anything;
pub(super) mod euroc;
mod frame_cameras;
pub(super) mod images;
mod intrinsics_file;
pub(super) mod kitti;
pub(super) mod mvsnet;
pub(super) mod nvm;
pub(super) mod open3d_log;
pub(super) mod openmvs;
pub(super) mod orb_slam;
mod orb_trajectory;
pub(super) mod polycam;
pub(super) mod pose_folder;
pub(super) mod record3d;
pub(super) mod replica;
mod scan_info;
pub(super) mod seven_scenes;
pub(super) mod stella;
pub(super) mod stray_scanner;
pub(super) mod transforms;
pub(super) mod tum;

pub use colmap::{DenseCloud, SkippedPoints};
