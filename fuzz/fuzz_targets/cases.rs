//! The files that are damaged, each well at first.

use std::path::{Path, PathBuf};

use base64::Engine;
use linecarve_engine::front_end::{EdgePoint, FeatureKeyframe, KeyframeColors, LineKeyframe};
use linecarve_engine::run::StageTimes;
use linecarve_lines::fit::Segment;
use linecarve_lines::triangulation::SurfaceSamples;
use linecarve_points::{Descriptor, Features};
use linecarve_sequence::export::{RecordingLayout, write_recording};
use linecarve_sequence::{OpenOptions, Sequence};
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Vector2};
use serde::Serialize;
use tempfile::TempDir;

use crate::folder_writers::{write_pose_folder, write_replica};
use crate::geometry_files::write_geometry_files;
use crate::support::{
    color_image, depth_image, poses, write_open3d, write_seven_scenes, write_tum,
};
use crate::writers::{
    stamp_ns, write_colmap_binary, write_colmap_text, write_euroc, write_mvs, write_nvm,
    write_orb_slam, write_pose_list, write_stella, write_transforms,
};

/// What reads a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A sequence to which it belongs.
    Sequence,
    /// The same, with the file given as poses.
    Trajectory,
    /// Meshes, lines and clouds.
    Geometry,
    /// Lines of a stream.
    Messages,
    /// What a run has kept.
    Kept,
}

/// A file.
pub struct Case {
    /// What reads it.
    pub kind: Kind,
    /// Folder of the sequence.
    pub folder: PathBuf,
    /// The file in it.
    pub file: PathBuf,
    /// What stands in it when it is well.
    pub well: Vec<u8>,
}

/// All files.
pub struct Cases {
    /// In an order that does not change from run to run.
    pub list: Vec<Case>,
    folders: Vec<TempDir>,
}

impl Cases {
    /// Writes a folder for each layout.
    pub fn write() -> Self {
        let mut cases = Self {
            list: Vec::new(),
            folders: Vec::new(),
        };
        let layouts: [fn(&Path); 12] = [
            |folder| write_seven_scenes(folder, 2),
            |folder| write_tum(folder, 3),
            |folder| write_open3d(folder, 2, 1),
            write_colmap_text,
            write_colmap_binary,
            write_nvm,
            write_mvs,
            write_transforms,
            write_stella,
            write_orb_slam,
            write_euroc,
            write_pose_list,
        ];
        for write in layouts {
            let folder = cases.folder();
            write(&folder);
            let files = files_in(&folder);
            for (number, file) in files.iter().enumerate() {
                // Of the images of a folder the first of each extension stands for all.
                let is_first = |end: &str| {
                    files[..number]
                        .iter()
                        .all(|other| !other.to_string_lossy().ends_with(end))
                };
                if !is_image(file)
                    || (file.to_string_lossy().ends_with("depth.png") && is_first("depth.png"))
                {
                    cases.add_existing(Kind::Sequence, &folder, file);
                }
            }
        }
        cases.add_folders();
        cases.add_recordings();
        cases.add_images();
        cases.add_trajectories();
        cases.add_geometry();
        let folder = cases.folder();
        cases.add(Kind::Messages, &folder, "messages.jsonl", messages());
        let folder = cases.folder();
        cases.add(
            Kind::Kept,
            &folder,
            "lines.keyframe",
            kept(&lines_keyframe()),
        );
        cases.add(
            Kind::Kept,
            &folder,
            "points.keyframe",
            kept(&points_keyframe()),
        );
        assert!(cases.list.len() <= 256, "a byte chooses the case");
        cases
    }

    /// Writes each case as a file that the fuzzer may begin with.
    pub fn write_seeds(&self, folder: &Path) {
        std::fs::create_dir_all(folder).expect("a folder for seeds");
        for (number, case) in self.list.iter().enumerate() {
            let bytes = [&[number as u8], case.well.as_slice()].concat();
            std::fs::write(folder.join(format!("seed-{number:03}")), bytes).expect("a seed");
        }
    }

    fn folder(&mut self) -> PathBuf {
        self.folders
            .push(tempfile::tempdir().expect("a temporary folder"));
        let folder = self.folders.last().map(|folder| folder.path().to_owned());
        folder.expect("one was pushed")
    }

    fn add(&mut self, kind: Kind, folder: &Path, file: &str, well: Vec<u8>) {
        std::fs::write(folder.join(file), &well).expect("a file in a temporary folder");
        self.list.push(Case {
            kind,
            folder: folder.to_owned(),
            file: file.into(),
            well,
        });
    }

    fn add_existing(&mut self, kind: Kind, folder: &Path, file: &Path) {
        let well = std::fs::read(folder.join(file)).expect("a file that was listed");
        self.list.push(Case {
            kind,
            folder: folder.to_owned(),
            file: file.to_owned(),
            well,
        });
    }

    /// The text files of folders as other programs leave them.
    fn add_folders(&mut self) {
        let folder = self.folder();
        write_pose_folder(&folder);
        for file in ["pose/0.txt", "intrinsics.txt"] {
            self.add_existing(Kind::Sequence, &folder, Path::new(file));
        }
        let above = self.folder();
        write_replica(&above);
        self.add_existing(Kind::Sequence, &above.join("room0"), Path::new("traj.txt"));
    }

    /// Recordings of phones and results of models: of the files of each extension the first.
    fn add_recordings(&mut self) {
        let source = self.folder();
        write_tum(&source, 2);
        let sequence = Sequence::open(&source, &OpenOptions::default()).expect("a well sequence");
        for layout in [
            RecordingLayout::StrayScanner,
            RecordingLayout::Record3d,
            RecordingLayout::Polycam,
            RecordingLayout::Scannet,
            RecordingLayout::ArkitScenes,
            RecordingLayout::DepthAnything3,
            RecordingLayout::ColmapDense,
            RecordingLayout::MvsNet,
            RecordingLayout::Exr,
            RecordingLayout::Pfm,
        ] {
            let folder = self.folder();
            write_recording(&folder, &sequence, layout).expect("a folder that is new");
            if layout == RecordingLayout::Record3d {
                // Damage of an archive ends at its checksums: also its members, which are read as they are.
                let unpacked = self.folder();
                unpack(&folder.join("recording.r3d"), &unpacked);
                self.add_first_files(&unpacked);
            }
            self.add_first_files(&folder);
        }
    }

    fn add_first_files(&mut self, folder: &Path) {
        let mut seen = Vec::new();
        for file in files_in(folder) {
            let extension = file.extension().map(ToOwned::to_owned);
            if !is_image(&file) && !seen.contains(&extension) {
                seen.push(extension);
                self.add_existing(Kind::Sequence, folder, &file);
            }
        }
    }

    /// An image in each format, whatever its name says.
    fn add_images(&mut self) {
        use image::ImageFormat::{Bmp, Jpeg, Pnm, Tiff, WebP};
        for format in [Jpeg, Pnm, Tiff, Bmp, WebP] {
            let folder = self.folder();
            write_seven_scenes(&folder, 1);
            let mut bytes = std::io::Cursor::new(Vec::new());
            color_image(&poses(1)[0])
                .write_to(&mut bytes, format)
                .expect("an image");
            self.add(
                Kind::Sequence,
                &folder,
                "frame-000000.color.png",
                bytes.into_inner(),
            );
        }
    }

    fn add_trajectories(&mut self) {
        let folder = self.folder();
        write_euroc(&folder);
        let formats: [fn(usize, &Isometry3<f64>) -> String; 5] = [
            |i, p| {
                let (t, q) = (p.translation, p.rotation);
                let stamp = stamp_ns(i) as f64 / 1e9;
                format!(
                    "{stamp:.6} {} {} {} {} {} {} {}\n",
                    t.x, t.y, t.z, q.i, q.j, q.k, q.w
                )
            },
            |i, p| {
                let (t, q) = (p.translation, p.rotation);
                format!(
                    "{},{},{},{},{},{},{},{}\n",
                    stamp_ns(i),
                    t.x,
                    t.y,
                    t.z,
                    q.w,
                    q.i,
                    q.j,
                    q.k
                )
            },
            |_, p| format!("{}\n", rows(p, 3).join(" ")),
            |_, p| format!("{}\n", rows(p, 4).join(" ")),
            |i, p| format!("{i} {i} {}\n{}\n", i + 1, rows(p, 4).join("\n")),
        ];
        for (number, line) in formats.iter().enumerate() {
            let text: String = poses(6)
                .iter()
                .enumerate()
                .map(|(i, pose)| line(i, pose))
                .collect();
            self.add(
                Kind::Trajectory,
                &folder,
                &format!("given-{number}.txt"),
                text.into_bytes(),
            );
        }
    }

    fn add_geometry(&mut self) {
        let folder = self.folder();
        write_geometry_files(&folder);
        for file in files_in(&folder) {
            self.add_existing(Kind::Geometry, &folder, &file);
        }
    }
}

fn rows(pose: &Isometry3<f64>, count: usize) -> Vec<String> {
    let matrix = pose.to_homogeneous();
    (0..count)
        .map(|r| {
            format!(
                "{} {} {} {}",
                matrix[(r, 0)],
                matrix[(r, 1)],
                matrix[(r, 2)],
                matrix[(r, 3)]
            )
        })
        .collect()
}

fn is_image(file: &Path) -> bool {
    file.extension().is_some_and(|end| end == "png")
}

/// Files below a folder, relative to it, sorted.
fn files_in(folder: &Path) -> Vec<PathBuf> {
    let (mut found, mut open) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(&next).expect("a folder that was written") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else if let Ok(inside) = path.strip_prefix(folder) {
                found.push(inside.to_owned());
            }
        }
    }
    found.sort();
    found
}

/// A small conversation with every type of message.
fn messages() -> Vec<u8> {
    let base64 = |bytes: Vec<u8>| base64::engine::general_purpose::STANDARD.encode(bytes);
    let mut text = serde_json::json!({
        "type": "start",
        "calibration": {
            "color": {"fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5},
            "depth": {"scale": 1000.0},
        },
    })
    .to_string();
    for (id, pose) in poses(2).iter().enumerate() {
        let (mut color, mut depth) = (
            std::io::Cursor::new(Vec::new()),
            std::io::Cursor::new(Vec::new()),
        );
        color_image(pose)
            .write_to(&mut color, image::ImageFormat::Png)
            .expect("an image");
        depth_image(pose, 1000.0)
            .write_to(&mut depth, image::ImageFormat::Png)
            .expect("an image");
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        text += "\n";
        text += &serde_json::json!({
            "type": "keyframe",
            "id": id,
            "world_from_camera": {"translation": t.as_slice(), "rotation": q.as_slice()},
            "color": {"base64": base64(color.into_inner())},
            "depth": {"base64": base64(depth.into_inner())},
        })
        .to_string();
    }
    text += r#"
{"type":"poses","poses":[{"id":1,"world_from_camera":{"matrix":[[1,0,0,0.1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}]}
{"type":"remove","ids":[0]}
{"type":"end"}
"#;
    text.into_bytes()
}

/// What a run writes for a keyframe, without its checksum.
fn kept<T: Serialize>(yielded: &T) -> Vec<u8> {
    rmp_serde::to_vec(yielded).expect("bytes of a keyframe")
}

fn lines_keyframe() -> LineKeyframe {
    let segment = Segment {
        keyframe: 0,
        ends_in_camera: [Point3::new(0.0, 0.0, 1.0), Point3::new(1.0, 0.0, 1.0)],
        end_covariances: [Matrix3::identity(); 2],
        ends_px: [Point2::new(1.0, 2.0), Point2::new(30.0, 2.0)],
        inverse_depths: [1.0; 2],
        inverse_depth_sigmas: [0.01; 2],
        pixels: 0..29,
        chain: 0,
        inliers: 29,
        image_rms_px: 0.2,
        depth_rms_sigmas: 1.0,
        mean_gradient: Vector2::new(0.0, 9.0),
    };
    LineKeyframe {
        frame: 0,
        world_from_camera: poses(2)[1],
        segments: vec![segment],
        edge_points: vec![EdgePoint {
            pixel: Point2::new(20.0, 30.0),
            inverse_depth: 0.5,
            sigma: 0.01,
        }],
        surface: SurfaceSamples::default(),
        unmeasurable_depths: 0,
        colors: KeyframeColors::of(&image::RgbImage::new(8, 8)),
        edge_chains: 1,
        edge_pixels: 29,
        edge_pixels_with_depth: 29,
        times: StageTimes::default(),
    }
}

fn points_keyframe() -> FeatureKeyframe {
    FeatureKeyframe {
        frame: 0,
        world_from_camera: poses(2)[1],
        features: Features {
            pixels: vec![[1.5, 2.25], [0.1, 40.0]],
            octaves: vec![0, 7],
            angles_rad: vec![0.5, -3.0],
            descriptors: vec![Descriptor([1, 2, 3, u64::MAX]), Descriptor([0; 4])],
            grey: vec![9, 255],
        },
        times: StageTimes::default(),
    }
}

/// Writes the members of an archive as files.
fn unpack(archive: &Path, folder: &Path) {
    let file = std::fs::File::open(archive).expect("an archive");
    let mut archive = zip::ZipArchive::new(file).expect("a well archive");
    archive.extract(folder).expect("files in a temporary folder");
}
