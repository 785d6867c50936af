//! Views of points that come with normals in place of a list of views.

use std::path::Path;

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::super::super::SequenceError;
use super::super::super::layout::Folder;
use super::super::super::text::TextFile;
use super::{FoundModel, find_model, read_images_only};
use crate::sparse_model::{ModelObservation, ModelView};

/// Least cosine between a normal and the direction to a view: 80 degrees. Surfaces that are seen at wider angles are not matched.
const LEAST_COSINE: f64 = 0.17;
/// Views of a point are at most this much farther away than the nearest. A pixel there covers twice as much of the surface.
const LARGEST_RATIO: f64 = 2.0;

/// What a line of a list of cameras has.
const LINE: &str = "x y z qx qy qz qw width height fx fy cx cy";

/// Views that may see a point: their lens and pose.
#[derive(Debug)]
pub(super) struct FacingViews(Vec<Facing>);

#[derive(Debug)]
struct Facing {
    center: Point3<f64>,
    camera_from_world: Isometry3<f64>,
    camera: Camera,
    size_px: [f64; 2],
}

impl FacingViews {
    /// # Errors
    /// When a view has no lens or no image size.
    pub(super) fn new(views: &[ModelView], file: &Path) -> Result<Self, SequenceError> {
        let facing = |view: &ModelView| {
            let (Some(camera), Some(size)) = (&view.camera, view.size_px) else {
                let problem = format!(
                    "{} has no image size and focal length: add its camera",
                    view.name
                );
                let path = file.to_owned();
                return Err(SequenceError::Content { path, problem });
            };
            Ok(Facing {
                center: Point3::from(view.world_from_camera.translation.vector),
                camera_from_world: view.world_from_camera.inverse(),
                camera: camera.clone(),
                size_px: size.map(f64::from),
            })
        };
        views.iter().map(facing).collect::<Result<_, _>>().map(Self)
    }

    /// The views on the normal's side of a point in whose image it lies, unless they are much farther away than the nearest of them.
    /// Whether something hides the point is not known. None without a normal.
    pub(super) fn of(&self, point: &Point3<f64>, normal: &Vector3<f64>) -> Vec<ModelObservation> {
        let sees = |view: &Facing| {
            let towards = view.center - point;
            let distance = towards.norm();
            let faces = towards.dot(normal) > LEAST_COSINE * distance * normal.norm();
            // Comparisons with NaN are false.
            (faces && view.has_in_image(point)).then_some(distance)
        };
        let numbered = (0..).zip(&self.0);
        let seen: Vec<(u32, f64)> = numbered
            .filter_map(|(view, facing)| Some((view, sees(facing)?)))
            .collect();
        let nearest = seen.iter().map(|(_, distance)| *distance);
        let limit = LARGEST_RATIO * nearest.fold(f64::INFINITY, f64::min);
        let near = seen.into_iter().filter(|(_, distance)| *distance <= limit);
        near.map(|(view, _)| ModelObservation { view, pixel: None })
            .collect()
    }
}

impl Facing {
    fn has_in_image(&self, point: &Point3<f64>) -> bool {
        let pixel = self.camera.project(&(self.camera_from_world * point));
        pixel.is_some_and(|pixel| {
            let mut sides = pixel.iter().zip(&self.size_px);
            // The centre of the first pixel is at zero.
            sides.all(|(x, size)| *x >= -0.5 && *x <= size - 0.5)
        })
    }
}

/// The views of a model of COLMAP, of which its folder is given, or of a list of cameras.
///
/// # Errors
/// When there is neither, or it cannot be read.
pub(super) fn read_cameras(path: &Path) -> Result<Vec<ModelView>, SequenceError> {
    if !path.is_dir() {
        return read_list(path);
    }
    let folder = Folder::list(path)?;
    let Some(FoundModel { path, format, .. }) = find_model(&folder) else {
        return Err(SequenceError::Content {
            path: path.to_owned(),
            problem: format!(
                "has no model of COLMAP: give a folder with cameras and images as .txt or .bin, or a text file with a line for each \
                 camera: {LINE}"
            ),
        });
    };
    let (mut model, _) = read_images_only(&path, format)?;
    model.sort_images();
    Ok(model.views())
}

/// Reads a line for each camera: its pose, world from camera, and its pinhole lens.
fn read_list(path: &Path) -> Result<Vec<ModelView>, SequenceError> {
    let file = TextFile::read(path)?;
    let mut views = Vec::new();
    for row in file.rows() {
        let numbers = row.numbers::<13>();
        let numbers = numbers.map_err(|_| {
            let found = row.fields().count();
            row.error(format!(
                "a camera is 13 numbers, {LINE} (world from camera); this line has {found} fields"
            ))
        })?;
        let [x, y, z, qx, qy, qz, qw, width, height, fx, fy, cx, cy] = numbers;
        let rotation = UnitQuaternion::try_new(Quaternion::new(qw, qx, qy, qz), 1e-9);
        let rotation = rotation.filter(|_| [x, y, z].iter().all(|x| x.is_finite()));
        let Some(rotation) = rotation else {
            return Err(row.error("the pose is not finite, or its quaternion is zero".to_owned()));
        };
        let is_size = |size: &f64| (1.0..=f64::from(u32::MAX)).contains(size);
        if ![width, height].iter().all(is_size) {
            return Err(row.error(format!("{width} x {height} is no size of an image")));
        }
        let camera = Camera::pinhole(fx, fy, cx, cy);
        let camera = camera.map_err(|error| row.error(error.to_string()))?;
        views.push(ModelView {
            name: format!("line {}", row.number()),
            world_from_camera: Isometry3::from_parts(Translation3::new(x, y, z), rotation),
            camera: Some(camera),
            size_px: Some([width as u32, height as u32]),
        });
    }
    if views.is_empty() {
        return Err(SequenceError::Content {
            path: path.to_owned(),
            problem: format!("has no camera: write a line for each, {LINE} (world from camera)"),
        });
    }
    Ok(views)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cameras above the origin that look down, at these heights, and one below that looks up.
    fn views() -> FacingViews {
        let view = |height: f64| {
            let axis = Vector3::x_axis();
            let turn = if height > 0.0 {
                std::f64::consts::PI
            } else {
                0.0
            };
            ModelView {
                name: height.to_string(),
                world_from_camera: Isometry3::from_parts(
                    Translation3::new(0.0, 0.0, height),
                    UnitQuaternion::from_axis_angle(&axis, turn),
                ),
                camera: Camera::pinhole(100.0, 100.0, 49.5, 49.5).ok(),
                size_px: Some([100, 100]),
            }
        };
        FacingViews::new(&[2.0, 3.9, 4.1, -2.0].map(view), Path::new("list")).unwrap()
    }

    fn seen(point: [f64; 3], normal: [f64; 3]) -> Vec<u32> {
        let seen = views().of(&Point3::from(point), &Vector3::from(normal));
        seen.iter().map(|observation| observation.view).collect()
    }

    #[test]
    fn views_see_what_faces_them_lies_in_their_image_and_is_near() {
        let up = [0.0, 0.0, 2.0];
        assert_eq!(seen([0.0; 3], up), [0, 1]);
        assert_eq!(seen([0.0; 3], [0.0, 0.0, -1.0]), [3]);
        // Beyond the image of the first view, which reaches to half its height.
        assert_eq!(seen([1.5, 0.0, 0.0], up), [1, 2]);
        assert_eq!(seen([0.99, 0.0, 0.0], up)[0], 0);
        // At 85 degrees to the normal, without a normal, behind all.
        assert!(seen([0.0; 3], [1.0, 0.0, 0.087]).is_empty());
        assert!(seen([0.0; 3], [0.0; 3]).is_empty());
        assert!(seen([0.0; 3], [f64::NAN; 3]).is_empty());
        assert!(seen([0.0, 0.0, 9.0], up).is_empty());
    }

    #[test]
    fn a_list_has_a_line_for_each_camera() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let read = |text: &str| {
            std::fs::write(file.path(), text).unwrap();
            read_cameras(file.path()).map_err(|error| error.to_string())
        };
        let views = read("# cameras\n1 2 3 0 0 0 1 640 480 500 500 319.5 239.5\n").unwrap();
        assert_eq!(views.len(), 1);
        assert_eq!(views[0].size_px, Some([640, 480]));
        let center = views[0].world_from_camera.translation.vector;
        assert_eq!(center, Vector3::new(1.0, 2.0, 3.0));
        for (text, problem) in [
            ("1 2 3\n", "line 1: a camera is 13 numbers"),
            ("\n1 2 3 0 0 0 0 640 480 5 5 3 2\n", "line 2: the pose"),
            ("1 2 3 0 0 0 1 0 480 5 5 3 2\n", "0 x 480"),
            ("1 2 3 0 0 0 1 640 480 -5 5 3 2\n", "focal length"),
            ("# none\n", "no camera"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(problem), "{error}");
        }
    }
}
