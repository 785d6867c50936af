//! A surface from posed images in memory.

use std::time::Instant;

use linecarve_lines::ExtractError;
use linecarve_lines::camera::Camera;
use linecarve_lines::depth::{DepthSensor, SensorNoise, remove_unmeasurable};
use linecarve_lines::image::{GrayImage, Plane};
use linecarve_mesh::TriangleMesh;
use linecarve_sequence::ColorImage;
use nalgebra::Isometry3;

use crate::error::Error;
use crate::front_end::{FrontEndError, Keyframe, KeyframeImages, SensorFrontEnd};
use crate::map::{Map, MapUpdate};
use crate::options::Options;
use crate::recording::RecordingError;

/// An image with its depth and its pose.
#[derive(Debug, Clone, Copy)]
pub struct RgbdImage<'a> {
    /// Pose of the colour camera: `point_in_world = world_from_camera * point_in_camera`.
    pub world_from_camera: Isometry3<f64>,
    /// The colour image, without lens distortion.
    pub color: &'a ColorImage,
    /// Depth along the optical axis in units of the poses. 0, negative and not finite: unknown.
    pub depth: &'a Plane<f32>,
}

/// A map that grows with posed images in memory.
///
/// Every image becomes a keyframe: choose images that are some degrees or centimetres apart. The surface equals that of a
/// [`Reconstruction`](crate::Reconstruction) from the same images on disk, with the same median depth.
///
/// ```
/// use linecarve_engine::{ImageReconstruction, Options, RgbdImage};
/// use linecarve_lines::camera::Camera;
/// use linecarve_lines::image::Plane;
/// use nalgebra::Isometry3;
///
/// // A dark panel half a unit before a bright wall, which is 2 units away.
/// let (width, height) = (160, 120);
/// let color = image::RgbImage::from_fn(width, height, |x, y| {
///     let is_panel = (40..120).contains(&x) && (30..90).contains(&y);
///     image::Rgb([if is_panel { 60 } else { 190 }; 3])
/// });
/// let depth_of = |pixel: &image::Rgb<u8>| if pixel.0[0] == 60 { 1.5 } else { 2.0 };
/// let depth = Plane::new(160, 120, color.pixels().map(depth_of).collect())?;
/// let camera = Camera::pinhole(140.0, 140.0, 79.5, 59.5)?;
///
/// let mut wall = ImageReconstruction::new(&camera, 2.0, Options::default())?;
/// for step in 0..3 {
///     let world_from_camera = Isometry3::translation(0.0, 0.0, -0.05 * f64::from(step));
///     # let moved = color.pixels().map(|pixel| depth_of(pixel) + 0.05 * step as f32);
///     # let depth = Plane::new(160, 120, moved.collect())?;
///     wall.add(&RgbdImage { world_from_camera, color: &color, depth: &depth })?;
/// }
/// let mesh = wall.finish()?;
/// assert!(!mesh.triangles.is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct ImageReconstruction {
    camera: Camera,
    front_end: SensorFrontEnd,
    map: Map,
    count: usize,
}

impl ImageReconstruction {
    /// An empty map for images of a pinhole `camera`, whose depth pixels coincide with colour pixels.
    ///
    /// `median_depth` is a typical distance of the scene in units of the poses, the length scale of all thresholds:
    /// [`median_depth`](crate::front_end::median_depth) of one or several depth images.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(camera: &Camera, median_depth: f64, options: Options) -> Result<Self, Error> {
        let noise = SensorNoise::relative_at(options.sensor.relative_noise, median_depth, 0.0);
        Self::with_sensor(
            camera,
            DepthSensor::registered(camera, noise),
            median_depth,
            options,
        )
    }

    /// As [`new`](Self::new), for a depth camera with a position, a resolution or a noise of its own.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn with_sensor(
        camera: &Camera,
        sensor: DepthSensor,
        median_depth: f64,
        options: Options,
    ) -> Result<Self, Error> {
        options.validate().map_err(RecordingError::from)?;
        Ok(Self {
            camera: camera.clone(),
            map: Map::of_sensor(&options, camera, sensor.noise, median_depth)?,
            front_end: SensorFrontEnd::new(sensor, options.extract(median_depth))?,
            count: 0,
        })
    }

    /// Takes an image into the map; returns what it changed.
    ///
    /// # Errors
    /// When the sizes of image and depth do not fit each other, the camera has lens distortion, or the pose is not finite. The
    /// map is not to be used any further when it refuses a pose.
    ///
    /// # Complexity
    /// Linear in the pixels of the image, plus the rays and tetrahedra that change.
    pub fn add(&mut self, image: &RgbdImage<'_>) -> Result<MapUpdate, Error> {
        let start = Instant::now();
        let name = || self.count.to_string();
        let (width, height) = image.color.dimensions();
        let gray = GrayImage::from_rgb8(width as usize, height as usize, image.color.as_raw());
        let gray = gray.map_err(|source| FrontEndError::Extract {
            frame: name(),
            source: ExtractError::Image(source),
        })?;
        let mut depth = image.depth.clone();
        let unmeasurable = remove_unmeasurable(depth.samples_mut());
        let images = KeyframeImages {
            gray: &gray,
            color: image.color,
            depth: &depth,
            sigma: None,
            unmeasurable,
            loading: start.elapsed(),
        };
        let numbers = (self.count, self.count as u32);
        let (camera, pose) = (&self.camera, image.world_from_camera);
        let keyframe = self
            .front_end
            .extract(&images, camera, pose, numbers, name)?;
        let update = self.map.push(&Keyframe::Lines(Box::new(keyframe)))?;
        self.count += 1;
        Ok(update)
    }

    /// The map.
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// The surface of the images so far.
    pub fn surface(&self) -> TriangleMesh {
        self.map.final_surface()
    }

    /// The surface after the last image.
    ///
    /// # Errors
    /// When the map refuses a pose.
    pub fn finish(mut self) -> Result<TriangleMesh, Error> {
        self.map.finish()?;
        Ok(self.map.final_surface())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::{Input, Reconstruction};

    /// The sample, and a run over a few of its images.
    fn sample() -> Result<Reconstruction, Error> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/room");
        let mut input = Input::from(folder);
        input.selection.every = Some(8);
        input.selection.max_keyframes = Some(3);
        Reconstruction::open(input, Options::default())
    }

    #[test]
    fn images_in_memory_give_the_surface_of_the_same_images_on_disk() {
        let mut run = sample().unwrap();
        while run.advance().unwrap().is_some() {}
        let recording = run.recording();
        let (sequence, median_depth) = (&recording.sequence, recording.length_scale());
        let noise = Options::default().sensor.relative_noise;
        let sensor = sequence
            .depth_calibration()
            .unwrap()
            .sensor(noise, median_depth);
        let camera = sequence.color_camera();
        let options = Options::default();
        let mut room =
            ImageReconstruction::with_sensor(camera, sensor, median_depth, options).unwrap();
        for &frame in &recording.keyframes {
            let image = RgbdImage {
                world_from_camera: sequence.frames()[frame].world_from_camera,
                color: &sequence.load_color(frame).unwrap(),
                depth: &sequence.load_depth(frame).unwrap().unwrap(),
            };
            room.add(&image).unwrap();
        }
        let (mesh, expected) = (room.finish().unwrap(), run.surface());
        assert!(mesh.triangles.len() > 1000);
        assert_eq!(mesh.positions, expected.positions);
        assert_eq!(mesh.triangles, expected.triangles);
        assert_eq!(mesh.colors, expected.colors);
    }

    #[test]
    fn images_that_do_not_fit_their_depth_are_refused() {
        let camera = Camera::pinhole(140.0, 140.0, 79.5, 59.5).unwrap();
        let mut room = ImageReconstruction::new(&camera, 2.0, Options::default()).unwrap();
        let image = RgbdImage {
            world_from_camera: Isometry3::identity(),
            color: &ColorImage::new(160, 120),
            depth: &Plane::new(16, 12, vec![2.0; 16 * 12]).unwrap(),
        };
        let error = room.add(&image).err().unwrap().to_string();
        assert!(error.contains("16 x 12"), "{error}");
        let silent = Options {
            sensor: crate::options::SensorOptions {
                relative_noise: -1.0,
            },
            ..Options::default()
        };
        let error = ImageReconstruction::new(&camera, 2.0, silent).err();
        assert!(error.unwrap().to_string().contains("relative_noise"));
    }
}
