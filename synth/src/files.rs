//! The files of a rendered sequence: where they lie, by layout, and the lists beside the images.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::Camera;
use linecarve_mesh::files::write_unsynced;
use nalgebra::Isometry3;

use super::error::SynthError;
use super::options::{ColorFormat, SequenceLayout, SynthOptions};

/// Time between two frames.
const FRAME_INTERVAL_US: u64 = 100_000;
/// Time of the first frame.
const START_US: u64 = 1_000_000;

/// File paths by layout.
pub(super) struct Files<'a> {
    out: &'a Path,
    layout: SequenceLayout,
    /// Distance of the right camera: then the layout is that of KITTI.
    baseline: Option<f64>,
    extension: &'static str,
}

impl<'a> Files<'a> {
    pub(super) fn new(options: &SynthOptions, out: &'a Path) -> Self {
        Self {
            out,
            layout: options.layout,
            baseline: options.stereo_baseline,
            extension: match options.color {
                ColorFormat::Png => "png",
                ColorFormat::Jpeg { .. } => "jpg",
            },
        }
    }

    fn folders(&self) -> &'static [&'static str] {
        if self.baseline.is_some() {
            return &["image_0", "image_1"];
        }
        match self.layout {
            SequenceLayout::Tum => &["rgb", "depth"],
            SequenceLayout::SevenScenes => &[],
            SequenceLayout::Open3d => &["image", "depth"],
        }
    }

    pub(super) fn make_folders(&self) -> Result<(), SynthError> {
        let failed = |folder: &Path| {
            let folder = folder.to_owned();
            |source| SynthError::Folder { folder, source }
        };
        make_folder(self.out)?;
        for name in self.folders() {
            let folder = self.out.join(name);
            std::fs::create_dir(&folder).map_err(failed(&folder))?;
        }
        Ok(())
    }

    /// A file of a frame in the layout of 7-Scenes.
    pub(super) fn name(&self, frame: usize, ending: &str) -> PathBuf {
        self.out.join(format!("frame-{frame:06}.{ending}"))
    }

    pub(super) fn color(&self, frame: usize) -> PathBuf {
        let extension = self.extension;
        if self.baseline.is_some() {
            return self.out.join(format!("image_0/{frame:06}.{extension}"));
        }
        match self.layout {
            SequenceLayout::Tum => self.out.join(format!("rgb/{}.{extension}", stamp(frame))),
            SequenceLayout::SevenScenes => self.name(frame, &format!("color.{extension}")),
            SequenceLayout::Open3d => self.out.join(format!("image/{frame:05}.{extension}")),
        }
    }

    pub(super) fn depth(&self, frame: usize) -> PathBuf {
        match self.layout {
            SequenceLayout::Tum => self.out.join(format!("depth/{}.png", stamp(frame))),
            SequenceLayout::SevenScenes => self.name(frame, "depth.png"),
            SequenceLayout::Open3d => self.out.join(format!("depth/{frame:05}.png")),
        }
    }

    /// The image of the right camera.
    pub(super) fn right(&self, frame: usize) -> PathBuf {
        let extension = self.extension;
        self.out.join(format!("image_1/{frame:06}.{extension}"))
    }

    /// Poses, times and calibration of stereo pairs.
    fn write_kitti(
        &self,
        poses: &[Isometry3<f64>],
        camera: &Camera,
        baseline: f64,
    ) -> Result<(), SynthError> {
        let [fx, fy, cx, cy] = [camera.fx(), camera.fy(), camera.cx(), camera.cy()];
        let row = |name: &str, shift: f64| {
            format!("{name}: {fx:?} 0 {cx:?} {shift:?} 0 {fy:?} {cy:?} 0 0 0 1 0\n")
        };
        let text = row("P0", 0.0) + &row("P1", -fx * baseline);
        write_text(&self.out.join("calib.txt"), &text)?;
        let (mut times, mut lines) = (String::new(), String::new());
        for (frame, pose) in poses.iter().enumerate() {
            times += &stamp(frame);
            times.push('\n');
            let rows: Vec<String> = matrix_text(pose)
                .lines()
                .take(3)
                .map(str::to_owned)
                .collect();
            lines += &rows.join(" ");
            lines.push('\n');
        }
        write_text(&self.out.join("times.txt"), &times)?;
        write_text(&self.out.join("poses.txt"), &lines)
    }

    /// Lists of images and poses, and the calibration.
    pub(super) fn write_lists(
        &self,
        poses: &[Isometry3<f64>],
        camera: &Camera,
    ) -> Result<(), SynthError> {
        if let Some(baseline) = self.baseline {
            return self.write_kitti(poses, camera, baseline);
        }
        match self.layout {
            SequenceLayout::Tum => {
                let list = |folder: &str, extension: &str| {
                    let mut text = String::from("# timestamp filename\n");
                    for frame in 0..poses.len() {
                        let stamp = stamp(frame);
                        text += &format!("{stamp} {folder}/{stamp}.{extension}\n");
                    }
                    text
                };
                write_text(&self.out.join("rgb.txt"), &list("rgb", self.extension))?;
                write_text(&self.out.join("depth.txt"), &list("depth", "png"))?;
                let mut text = String::from("# timestamp tx ty tz qx qy qz qw\n");
                for (frame, pose) in poses.iter().enumerate() {
                    let (t, q) = (pose.translation.vector, pose.rotation.coords);
                    text += &stamp(frame);
                    for value in [t.x, t.y, t.z, q.x, q.y, q.z, q.w] {
                        text += &format!(" {value:.10}");
                    }
                    text.push('\n');
                }
                write_text(&self.out.join("groundtruth.txt"), &text)?;
            }
            SequenceLayout::SevenScenes => {
                let text = format!(
                    "{} 0 {}\n0 {} {}\n0 0 1\n",
                    camera.fx(),
                    camera.cx(),
                    camera.fy(),
                    camera.cy()
                );
                write_text(&self.out.join("camera-intrinsics.txt"), &text)?;
            }
            SequenceLayout::Open3d => {
                let mut text = String::new();
                for (frame, pose) in poses.iter().enumerate() {
                    text += &format!("{frame} {frame} {}\n{}", frame + 1, matrix_text(pose));
                }
                write_text(&self.out.join("trajectory.log"), &text)?;
            }
        }
        let scale = self.layout.depth_scale();
        let text = format!(
            "[color]\nmodel = \"pinhole\"\nfx = {:?}\nfy = {:?}\ncx = {:?}\ncy = {:?}\n\n[depth]\nscale = {scale:?}\n",
            camera.fx(),
            camera.fy(),
            camera.cx(),
            camera.cy()
        );
        write_text(&self.out.join("linecarve.toml"), &text)
    }
}

/// Time stamp of a frame in seconds.
fn stamp(frame: usize) -> String {
    let us = START_US + FRAME_INTERVAL_US * frame as u64;
    format!("{}.{:06}", us / 1_000_000, us % 1_000_000)
}

/// The 4x4 matrix of a pose, row by row.
pub(super) fn matrix_text(pose: &Isometry3<f64>) -> String {
    let matrix = pose.to_homogeneous();
    let mut text = String::new();
    for row in matrix.row_iter() {
        let values: Vec<String> = row.iter().map(|value| format!("{value:.12}")).collect();
        text += &values.join(" ");
        text.push('\n');
    }
    text
}

pub(super) fn write_text(path: &Path, text: &str) -> Result<(), SynthError> {
    Ok(write_unsynced(path, |out| out.write_all(text.as_bytes()))?)
}

/// Makes a folder, which must be empty if it is there.
pub(super) fn make_folder(folder: &Path) -> Result<(), SynthError> {
    let failed = |source| SynthError::Folder {
        folder: folder.to_owned(),
        source,
    };
    std::fs::create_dir_all(folder).map_err(failed)?;
    let mut entries = std::fs::read_dir(folder).map_err(failed)?;
    match entries.next() {
        Some(_) => Err(SynthError::NotEmpty {
            folder: folder.to_owned(),
        }),
        None => Ok(()),
    }
}
