//! Files of a tracked sequence.

use std::path::Path;

use image::RgbImage;
use linecarve_lines::upper_median;
use linecarve_mesh::files::{WriteError, write_atomically};
use linecarve_mesh::render::{RenderOptions, Renderer, View, write_png};
use linecarve_mesh::{LineSet, TriangleMesh, write_points_ply};
use linecarve_sequence::export::{PosedImage, TrajectoryFormat, posed_images, write_trajectory};
use linecarve_sequence::{SIDECAR_FILE, Sequence};
use nalgebra::{Isometry3, Point3};

use super::output_folder::OutputFolder;
use super::tracked_page::tracked_page;
use crate::report::page::write_page;
use linecarve_engine::Recording;
use linecarve_engine::tracking::{TrackReport, TrackedSequence, poses_file};

/// Size of the picture of the path.
const PICTURE_SIZE: (u32, u32) = (960, 720);

const POINT_COLOR: [u8; 3] = [150, 150, 150];
const PATH_COLOR: [u8; 3] = [30, 80, 200];

/// Where frames between two have no pose.
const GAP_COLOR: [u8; 3] = [220, 60, 40];

/// Writes `trajectory.txt`, where the poses of a recording come from tracking.
pub(crate) fn write_tracked_poses(
    recording: &Recording,
    output: &mut OutputFolder,
) -> anyhow::Result<()> {
    if recording.is_tracked {
        let images = posed_images(&recording.sequence);
        let path = output.file("trajectory.txt")?;
        write_trajectory(&path, TrajectoryFormat::Tum, &images)?;
    }
    Ok(())
}

/// Writes the poses of each sub-map, the points of the largest, and the report, which is last.
pub(crate) fn write_tracked(
    tracked: &TrackedSequence,
    sequence: &Sequence,
    report: &mut TrackReport,
    formats: &[TrajectoryFormat],
    output: &mut OutputFolder,
) -> anyhow::Result<()> {
    for number in 0..tracked.recording.submaps.len() {
        let name = poses_file(number);
        let path = output.file(&name)?;
        write_frames(
            &path,
            TrajectoryFormat::Tum,
            sequence,
            tracked.poses_in(number),
        )?;
        for format in formats {
            let Some((start, end)) = ending(*format) else {
                continue;
            };
            let path = output.file(&name.replace("poses", start).replace(".txt", end))?;
            write_frames(&path, *format, sequence, tracked.poses_in(number))?;
        }
    }
    if let Some(submap) = tracked.recording.submaps.first() {
        write_points_ply(&output.file("points.ply")?, &submap.points, None)?;
    }
    if sequence.has_assumed_camera() {
        write_calibration(&output.file(SIDECAR_FILE)?, sequence)?;
    }
    if let Some(picture) = path_picture(tracked)? {
        write_png(&output.file("path.png")?, &picture)?;
    }
    if tracked.poses().next().is_some() {
        let page = tracked_page(tracked, sequence);
        write_page(&output.file("report.html")?, &page)?;
    }
    let path = output.file("track.json")?;
    report.files = output.written().to_vec();
    write_atomically(&path, |out| {
        serde_json::to_writer_pretty(&mut *out, &report).map_err(std::io::Error::other)?;
        out.write_all(b"\n")
    })?;
    Ok(())
}

/// Start and end of the names of files in another format than that of `poses.txt`.
fn ending(format: TrajectoryFormat) -> Option<(&'static str, &'static str)> {
    match format {
        TrajectoryFormat::Tum => None,
        TrajectoryFormat::Kitti => Some(("poses-kitti", ".txt")),
        TrajectoryFormat::Euroc => Some(("poses", ".csv")),
        TrajectoryFormat::Open3dLog => Some(("poses", ".log")),
    }
}

/// The estimated camera, as a calibration file.
fn write_calibration(path: &Path, sequence: &Sequence) -> Result<(), WriteError> {
    let camera = sequence.stored_color_camera();
    let text = format!(
        "# Estimated from the images by linecarve track.\n[color]\nfx = {:?}\nfy = {:?}\ncx = {:?}\ncy = {:?}\n",
        camera.fx(),
        camera.fy(),
        camera.cx(),
        camera.cy()
    );
    write_atomically(path, |out| out.write_all(text.as_bytes()))
}

/// The path and the points of the largest sub-map from outside and above; `None` when there is nothing to see.
fn path_picture(tracked: &TrackedSequence) -> anyhow::Result<Option<RgbImage>> {
    let Some(submap) = tracked.recording.submaps.first() else {
        return Ok(None);
    };
    let poses: Vec<(usize, Isometry3<f64>)> = tracked.poses().collect();
    let mut drawing = LineSet::default();
    let mut colors = Vec::new();
    let mut draw = |ends: [Point3<f64>; 2], color| {
        let at = drawing.points.len() as u32;
        drawing.points.extend(ends);
        drawing.lines.push([at, at + 1]);
        colors.extend([color; 2]);
    };
    for point in near_points(&submap.points) {
        draw([point; 2], POINT_COLOR);
    }
    for pair in poses.windows(2) {
        let ends = [0, 1].map(|at| Point3::from(pair[at].1.translation.vector));
        // A gap is not drawn as if the camera had gone straight.
        let is_gap = pair[0].0 + 1 != pair[1].0;
        draw(ends, if is_gap { GAP_COLOR } else { PATH_COLOR });
    }
    drawing.colors = Some(colors);
    let cameras: Vec<Isometry3<f64>> = poses.iter().map(|(_, pose)| *pose).collect();
    let framed = drawing.bounds().map(corners);
    let Some(view) = framed.and_then(|framed| View::outside(&framed, &cameras, PICTURE_SIZE))
    else {
        return Ok(None);
    };
    let nothing = TriangleMesh::default();
    let picture = Renderer::new(&nothing).draw(
        Some(&drawing),
        &view,
        &RenderOptions::default(),
        &|_, _| {},
    )?;
    Ok(Some(picture))
}

/// The corners of a box. A view of these has all that is in the box in it, while a view of many points leaves out a few that lie apart.
fn corners((low, high): (Point3<f64>, Point3<f64>)) -> [Point3<f64>; 8] {
    let ends = [low, high];
    std::array::from_fn(|index| Point3::from([0, 1, 2].map(|axis| ends[index >> axis & 1][axis])))
}

/// Points without the few far ones, which would make all others small.
fn near_points(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let middle = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        upper_median(&mut values, f64::total_cmp)
    };
    let [Some(x), Some(y), Some(z)] = [0, 1, 2].map(middle) else {
        return Vec::new();
    };
    let center = Point3::new(x, y, z);
    let mut distances: Vec<f64> = points.iter().map(|point| (point - center).norm()).collect();
    let most = (distances.len() - 1) * 9 / 10;
    let reach = 1.5 * *distances.select_nth_unstable_by(most, f64::total_cmp).1;
    let near = points
        .iter()
        .filter(|point| (*point - center).norm() <= reach);
    near.copied().collect()
}

fn write_frames(
    path: &Path,
    format: TrajectoryFormat,
    sequence: &Sequence,
    poses: impl Iterator<Item = (usize, Isometry3<f64>)>,
) -> Result<(), WriteError> {
    let images = posed_images(sequence);
    let posed: Vec<PosedImage> = poses
        .map(|(frame, world_from_camera)| PosedImage {
            world_from_camera,
            ..images[frame].clone()
        })
        .collect();
    write_trajectory(path, format, &posed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_path_beside_many_points_is_in_the_picture() {
        let mut points: Vec<Point3<f64>> = (0..2000)
            .map(|i| Point3::new(f64::from(i % 40) * 0.05, f64::from(i / 40) * 0.02, 5.0))
            .collect();
        points.push(Point3::new(1.0, 0.5, -4.0));
        let cameras = [Isometry3::identity()];
        let is_seen = |framed: &[Point3<f64>]| {
            let view = View::outside(framed, &cameras, PICTURE_SIZE).unwrap();
            points.iter().all(|point| {
                let pixel = view
                    .camera
                    .project(&(view.world_from_camera.inverse() * point));
                let (width, height) = (f64::from(view.width), f64::from(view.height));
                pixel.is_some_and(|at| at.x > 0.0 && at.y > 0.0 && at.x < width && at.y < height)
            })
        };
        assert!(!is_seen(&points));
        let drawing = LineSet {
            points: points.clone(),
            ..LineSet::default()
        };
        assert!(is_seen(&corners(drawing.bounds().unwrap())));
    }
}
