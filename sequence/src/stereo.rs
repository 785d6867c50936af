//! Stereo pairs: rectification, so that a point has the same row in both images.

use std::sync::OnceLock;

use linecarve_lines::camera::{Camera, UndistortionMap};
use linecarve_lines::image::{GrayImage, ImageError};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::calibration::{ImageSize, RightCamera};
use super::image_file::{decode, gray_of, size_error, undecodable};
use super::{FrameError, Sequence};

/// Largest angle between the baseline and the rows of the images: cameras side by side, not one above the other.
const MAX_TILT_DEGREES: f64 = 30.0;

/// A pair of rectified cameras: both are this pinhole camera, and the right one is displaced along x by the baseline.
#[derive(Debug)]
pub struct StereoPair {
    camera: Camera,
    size: ImageSize,
    baseline: f64,
    color_from_rectified: UnitQuaternion<f64>,
    /// Left and right.
    resampling: [Resampling; 2],
    right_size: ImageSize,
}

/// How an image of one of the cameras becomes a rectified one.
#[derive(Debug)]
struct Resampling {
    stored: Camera,
    stored_from_rectified: UnitQuaternion<f64>,
    map: OnceLock<Result<UndistortionMap, ImageError>>,
}

/// Checks that the right camera is at the right of the left one.
///
/// # Errors
/// What is wrong with the positions of the cameras.
pub(super) fn check_position(right: &RightCamera) -> Result<(), String> {
    let baseline = right.color_from_right.translation.vector;
    let length = baseline.norm();
    if !(length.is_finite() && length > 0.0) {
        return Err("left and right camera are at the same position".to_owned());
    }
    let tilt = baseline.angle(&Vector3::x()).to_degrees();
    if tilt > MAX_TILT_DEGREES {
        return Err(format!(
            "the right camera is not at the right of the left one: its direction is {tilt:.0} degrees off the rows of \
             the left image (are the cameras exchanged?)"
        ));
    }
    Ok(())
}

impl StereoPair {
    /// The pair of a left camera and a right one.
    ///
    /// # Errors
    /// What is wrong with the positions of the cameras.
    pub(super) fn new(left: &Camera, right: &RightCamera, size: ImageSize) -> Result<Self, String> {
        check_position(right)?;
        let baseline = right.color_from_right.translation.vector;
        let length = baseline.norm();
        // Both cameras turn half of the way between them.
        let color_from_right = right.color_from_right.rotation;
        let forward = Vector3::z() + color_from_right * Vector3::z();
        let x = baseline / length;
        let y = forward.cross(&x).normalize();
        let axes = Matrix3::from_columns(&[x, y, x.cross(&y)]);
        let color_from_rectified =
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let cameras = [left, &right.camera.camera];
        let rotations = [
            color_from_rectified,
            color_from_right.inverse() * color_from_rectified,
        ];
        let right_size = right.camera.size.unwrap_or(size);
        let inscribed = [(cameras[0], size), (cameras[1], right_size)].map(|(camera, size)| {
            let (width, height) = (size.width as usize, size.height as usize);
            match camera.is_pinhole() {
                true => camera.clone(),
                false => UndistortionMap::inscribed_camera(camera, width, height),
            }
        });
        let [a, b] = &inscribed;
        let camera = Camera::pinhole(
            a.fx().max(b.fx()),
            a.fy().max(b.fy()),
            0.5 * (a.cx() + b.cx()),
            0.5 * (a.cy() + b.cy()),
        )
        .map_err(|error| error.to_string())?;
        let resampling = [0, 1].map(|at| Resampling {
            stored: cameras[at].clone(),
            stored_from_rectified: rotations[at],
            map: OnceLock::new(),
        });
        Ok(Self {
            camera,
            size,
            baseline: length,
            color_from_rectified,
            resampling,
            right_size,
        })
    }

    /// The pinhole camera of both rectified images.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Size of the rectified images: that of the left images as stored.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// The cameras of the stored images, left and right.
    pub fn stored_cameras(&self) -> [&Camera; 2] {
        self.resampling.each_ref().map(|one| &one.stored)
    }

    /// Distance between the cameras, in units of the poses.
    pub fn baseline(&self) -> f64 {
        self.baseline
    }

    /// `point_in_color = color_from_rectified * point_in_rectified_left`.
    pub fn color_from_rectified(&self) -> &UnitQuaternion<f64> {
        &self.color_from_rectified
    }
}

impl Resampling {
    /// Resamples an image, unless it is rectified as it is stored.
    fn apply(
        &self,
        image: GrayImage,
        camera: &Camera,
        size: ImageSize,
    ) -> Result<GrayImage, ImageError> {
        if self.stored == *camera
            && self.stored_from_rectified == UnitQuaternion::identity()
            && (image.width(), image.height()) == (size.width as usize, size.height as usize)
        {
            return Ok(image);
        }
        let make = || {
            let (width, height) = (size.width as usize, size.height as usize);
            let turn = &self.stored_from_rectified;
            UndistortionMap::with_rotation(&self.stored, camera, turn, width, height)
        };
        let map = self.map.get_or_init(make).as_ref().map_err(Clone::clone)?;
        Ok(map.resample(&image))
    }
}

impl Sequence {
    /// The rectified stereo pair, if the sequence has images of a calibrated right camera.
    pub fn stereo(&self) -> Option<&StereoPair> {
        self.stereo.as_ref()
    }

    /// Loads the rectified grey images of a frame: the left one, and the right one if the frame has it. They are never
    /// downsampled.
    ///
    /// # Errors
    /// As [`Sequence::load_gray`].
    ///
    /// # Panics
    /// If the index is out of range, or [`Sequence::stereo`] is `None`.
    pub fn load_stereo(&self, index: usize) -> Result<(GrayImage, Option<GrayImage>), FrameError> {
        let pair = self.stereo().expect("the sequence is stereo");
        let frame = &self.frames[index];
        let left = gray_of(&self.decode_color(index)?, &frame.color)?;
        let rectified = |side: usize, image, path| {
            pair.resampling[side]
                .apply(image, &pair.camera, pair.size)
                .map_err(|error| undecodable(path, error.to_string()))
        };
        let left = rectified(0, left, &frame.color)?;
        let Some(path) = &frame.right else {
            return Ok((left, None));
        };
        let expected = pair.right_size;
        let image = decode(&self.containers, path, |size| {
            if size == expected {
                return Ok(());
            }
            let remedy = "all images of the right camera must have one size";
            let by = "by the calibration of the right camera".to_owned();
            Err(size_error(path, size, expected, by, remedy))
        })?;
        let right = rectified(1, gray_of(&image, path)?, path)?;
        Ok((left, Some(right)))
    }
}

#[cfg(test)]
mod tests {
    use linecarve_lines::camera::Distortion;
    use nalgebra::{Isometry3, Point3, Translation3};

    use super::*;
    use crate::calibration::CalibratedCamera;

    const SIZE: ImageSize = ImageSize {
        width: 752,
        height: 480,
    };

    fn distorting(fx: f64, cx: f64, cy: f64) -> Camera {
        let distortion = Distortion::RadialTangential {
            k1: -0.28,
            k2: 0.07,
            p1: 2e-4,
            p2: 2e-5,
            k3: 0.0,
        };
        Camera::with_distortion(fx, fx, cx, cy, distortion).unwrap()
    }

    fn right(color_from_right: Isometry3<f64>) -> RightCamera {
        RightCamera {
            camera: CalibratedCamera::known(distorting(457.0, 380.0, 255.0), Some(SIZE), ""),
            color_from_right,
        }
    }

    #[test]
    fn points_have_one_row_and_the_disparity_of_their_depth() {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.02, -0.03, 0.015));
        let color_from_right = Isometry3::from_parts(Translation3::new(0.11, 0.004, -0.006), turn);
        let left = distorting(458.0, 367.0, 248.0);
        let pair = StereoPair::new(&left, &right(color_from_right), SIZE).unwrap();
        let camera = pair.camera();
        for point in [[0.3, -0.2, 2.0], [-0.7, 0.5, 3.0], [1.0, 0.1, 5.0]] {
            let point = Point3::from(point);
            let in_left = pair.color_from_rectified.inverse() * point;
            let rotation = &pair.resampling[1].stored_from_rectified;
            let in_right = rotation.inverse() * (color_from_right.inverse() * point);
            let [a, b] = [in_left, in_right].map(|point| camera.project(&point).unwrap());
            assert!((a.y - b.y).abs() < 1e-9, "{a} {b}");
            let depth = camera.fx() * pair.baseline() / (a.x - b.x);
            assert!((depth - in_left.z).abs() < 1e-9);
        }
    }

    #[test]
    fn cameras_that_are_not_side_by_side_are_refused() {
        let left = distorting(458.0, 367.0, 248.0);
        for (position, message) in [
            ([0.0, 0.0, 0.0], "same position"),
            ([-0.1, 0.0, 0.0], "exchanged"),
            ([0.0, 0.1, 0.0], "not at the right"),
            ([f64::NAN, 0.1, 0.0], "same position"),
        ] {
            let motion = Isometry3::translation(position[0], position[1], position[2]);
            let error = StereoPair::new(&left, &right(motion), SIZE).unwrap_err();
            assert!(error.contains(message), "{error}");
        }
    }
}
