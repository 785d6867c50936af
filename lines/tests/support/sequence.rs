//! A minimal reader of posed sequences for tests, benches and harnesses.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::Camera;
use linecarve_lines::image::{GrayImage, Plane};
use nalgebra::{Isometry3, Matrix3, Matrix4, Rotation3, Translation3, UnitQuaternion};

use crate::AnyError;

/// One posed image.
#[derive(Clone)]
pub(crate) struct View {
    pub(crate) name: String,
    color: PathBuf,
    depth: PathBuf,
    pub(crate) world_from_camera: Isometry3<f64>,
}

/// A sequence with the cameras that made it.
pub(crate) struct Sequence {
    views: Vec<View>,
    pub(crate) color_camera: Camera,
    pub(crate) depth_camera: Camera,
    pub(crate) color_from_depth: Isometry3<f64>,
    pub(crate) is_registered: bool,
    depth_scale: f32,
}

fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace()
        .filter_map(|word| word.parse().ok())
        .collect()
}

fn rigid(values: &[f64]) -> Isometry3<f64> {
    let matrix = Matrix4::from_row_slice(values);
    let rotation: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into();
    let rotation = Rotation3::from_matrix_eps(&rotation, 1e-15, 100, Rotation3::identity());
    Isometry3::from_parts(
        Translation3::new(matrix[(0, 3)], matrix[(1, 3)], matrix[(2, 3)]),
        UnitQuaternion::from_rotation_matrix(&rotation),
    )
}

fn sorted(folder: &Path, ending: &str) -> Result<Vec<PathBuf>, AnyError> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)?
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|path| path.to_string_lossy().ends_with(ending))
        .collect();
    paths.sort();
    Ok(paths)
}

impl Sequence {
    pub(crate) fn open(folder: &Path) -> Result<Self, AnyError> {
        if folder.join("groundtruth.txt").exists() {
            Self::open_tum(folder)
        } else if folder.join("trajectory.log").exists() {
            Self::open_log(folder)
        } else {
            Self::open_seven_scenes(folder)
        }
    }

    /// Colour and depth cameras as estimated for the excerpt of the 7-Scenes kitchen.
    fn open_seven_scenes(folder: &Path) -> Result<Self, AnyError> {
        let color_from_depth = Isometry3::translation(-0.0304, 0.0068, 0.0);
        let mut views = Vec::new();
        for pose in sorted(folder, ".pose.txt")? {
            let path = pose.to_string_lossy().replace(".pose.txt", "");
            let world_from_depth = rigid(&numbers(&std::fs::read_to_string(&pose)?)[..16]);
            views.push(View {
                name: Path::new(&path)
                    .file_name()
                    .unwrap_or_default()
                    .to_string_lossy()
                    .into_owned(),
                color: format!("{path}.color.jpg").into(),
                depth: format!("{path}.depth.png").into(),
                world_from_camera: world_from_depth * color_from_depth.inverse(),
            });
        }
        Ok(Self {
            views,
            color_camera: Camera::pinhole(525.8, 525.8, 322.2, 235.6)?,
            depth_camera: Camera::pinhole(585.0, 585.0, 320.0, 240.0)?,
            color_from_depth,
            is_registered: false,
            depth_scale: 1000.0,
        })
    }

    /// A rendered sequence in the TUM layout: each image has a depth image and a pose of the same position in its list.
    fn open_tum(folder: &Path) -> Result<Self, AnyError> {
        let read = |name: &str| std::fs::read_to_string(folder.join(name));
        let rows = |text: String| -> Vec<Vec<String>> {
            text.lines()
                .filter(|line| !line.starts_with('#'))
                .map(|line| line.split_whitespace().map(str::to_owned).collect())
                .collect()
        };
        let (colors, depths) = (rows(read("rgb.txt")?), rows(read("depth.txt")?));
        let poses = rows(read("groundtruth.txt")?);
        let mut views = Vec::new();
        for ((color, depth), pose) in colors.iter().zip(&depths).zip(&poses) {
            let p: Vec<f64> = pose.iter().filter_map(|word| word.parse().ok()).collect();
            let rotation = nalgebra::Quaternion::new(p[7], p[4], p[5], p[6]);
            views.push(View {
                name: color[0].clone(),
                color: folder.join(&color[1]),
                depth: folder.join(&depth[1]),
                world_from_camera: Isometry3::from_parts(
                    Translation3::new(p[1], p[2], p[3]),
                    UnitQuaternion::from_quaternion(rotation),
                ),
            });
        }
        let sidecar = read("linecarve.toml")?;
        let value = |key: &str| -> Result<f64, AnyError> {
            let line = sidecar
                .lines()
                .find(|line| line.starts_with(key))
                .ok_or("key missing")?;
            Ok(line.split('=').nth(1).ok_or("no value")?.trim().parse()?)
        };
        let camera = Camera::pinhole(value("fx")?, value("fy")?, value("cx")?, value("cy")?)?;
        Ok(Self {
            views,
            color_camera: camera.clone(),
            depth_camera: camera,
            color_from_depth: Isometry3::identity(),
            is_registered: true,
            depth_scale: value("scale")? as f32,
        })
    }

    fn open_log(folder: &Path) -> Result<Self, AnyError> {
        let text = std::fs::read_to_string(folder.join("trajectory.log"))?;
        let lines: Vec<&str> = text.lines().collect();
        let poses: Vec<Isometry3<f64>> = lines
            .chunks_exact(5)
            .map(|entry| rigid(&numbers(&entry[1..].join(" "))[..16]))
            .collect();
        let mut views = Vec::new();
        for color in sorted(&folder.join("image"), ".jpg")? {
            let name = color
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            let depth = folder.join("depth").join(format!("{name}.png"));
            let world_from_camera = poses[name.parse::<usize>()?];
            views.push(View {
                name,
                color,
                depth,
                world_from_camera,
            });
        }
        let camera = Camera::pinhole(525.0, 525.0, 319.5, 239.5)?;
        Ok(Self {
            views,
            color_camera: camera.clone(),
            depth_camera: camera,
            color_from_depth: Isometry3::identity(),
            is_registered: true,
            depth_scale: 1000.0,
        })
    }

    /// The first view, then each that has moved or turned that far since the last one taken.
    pub(crate) fn keyframes(&self, step: f64, turn_rad: f64) -> Vec<View> {
        let mut taken: Vec<View> = Vec::new();
        for view in &self.views {
            let is_new = taken.last().is_none_or(|last: &View| {
                let (a, b) = (&last.world_from_camera, &view.world_from_camera);
                (a.translation.vector - b.translation.vector).norm() >= step
                    || a.rotation.angle_to(&b.rotation) >= turn_rad
            });
            if is_new {
                taken.push(view.clone());
            }
        }
        taken
    }

    pub(crate) fn gray(&self, view: &View) -> Result<GrayImage, AnyError> {
        let rgb = image::open(&view.color)?.into_rgb8();
        Ok(GrayImage::from_rgb8(
            rgb.width() as usize,
            rgb.height() as usize,
            rgb.as_raw(),
        )?)
    }

    /// Depth in metres, 0 where unknown.
    pub(crate) fn depth(&self, view: &View) -> Result<Plane<f32>, AnyError> {
        let raw = image::open(&view.depth)?.into_luma16();
        let samples = raw.as_raw().iter().map(|&z| {
            if z == u16::MAX {
                0.0
            } else {
                f32::from(z) / self.depth_scale
            }
        });
        Ok(Plane::new(
            raw.width() as usize,
            raw.height() as usize,
            samples.collect(),
        )?)
    }
}
