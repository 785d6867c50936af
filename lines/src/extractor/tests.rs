use nalgebra::{Point2, Point3};

use super::*;
use crate::depth::InverseDepth;

#[test]
fn refusals() {
    let mut extractor = SegmentExtractor::new(ExtractOptions::default()).unwrap();
    let camera = Camera::pinhole(50.0, 50.0, 20.0, 15.0).unwrap();
    let image = GrayImage::new(40, 30, vec![0; 1200]).unwrap();
    let map = InverseDepthMap::unknown(40, 31).unwrap();
    assert!(matches!(
        extractor.extract(&image, None, &map, &camera, 0),
        Err(ExtractError::Size {
            depth_height: 31,
            ..
        })
    ));
    let map = InverseDepthMap::unknown(40, 30).unwrap();
    assert!(matches!(
        extractor.extract(&image, Some(&[0; 1200]), &map, &camera, 0),
        Err(ExtractError::Image(ImageError::SampleCount {
            expected: 3600,
            actual: 1200,
            ..
        }))
    ));
    let distortion = crate::camera::Distortion::KannalaBrandt {
        k1: 0.1,
        k2: 0.0,
        k3: 0.0,
        k4: 0.0,
    };
    let distorting = Camera::with_distortion(50.0, 50.0, 20.0, 15.0, distortion).unwrap();
    assert_eq!(
        extractor
            .extract(&image, None, &map, &distorting, 0)
            .unwrap_err(),
        ExtractError::Distorted
    );
}

#[test]
fn no_depth_gives_no_segment() {
    let mut extractor = SegmentExtractor::new(ExtractOptions::default()).unwrap();
    let camera = Camera::pinhole(50.0, 50.0, 20.0, 15.0).unwrap();
    let samples = (0..1200)
        .map(|i| if i % 40 < 20 { 0 } else { 200 })
        .collect();
    let image = GrayImage::new(40, 30, samples).unwrap();
    let mut map = InverseDepthMap::unknown(40, 30).unwrap();
    let extraction = extractor.extract(&image, None, &map, &camera, 0).unwrap();
    assert!(extraction.edge_pixels > 20);
    assert_eq!(
        (extraction.segments.len(), extraction.edge_pixels_with_depth),
        (0, 0)
    );
    for y in 0..30 {
        for x in 0..40 {
            map.set(x, y, InverseDepth::new(0.5, 0.002));
        }
    }
    assert_eq!(
        extractor
            .extract(&image, None, &map, &camera, 0)
            .unwrap()
            .segments
            .len(),
        1
    );
}

/// A turned panel with a printed frame before a slanted, striped wall.
struct Room {
    camera: Camera,
}

const WIDTH: usize = 320;
const HEIGHT: usize = 240;

impl Room {
    /// Depth and grey level at a position in the image.
    fn see(&self, x: f64, y: f64) -> (f64, f64) {
        let ray = self.camera.point_at_depth(&Point2::new(x, y), 1.0).unwrap();
        // Panel: z = 1.2 + 0.3 x; wall: z = 2.4 - 0.2 y.
        let panel = ray * (1.2 / (1.0 - 0.3 * ray.x));
        if panel.x.abs() < 0.25 && panel.y.abs() < 0.18 {
            let is_print = (panel.x.abs() - 0.15).abs() < 0.03 && panel.y.abs() < 0.12;
            return (panel.z, if is_print { 200.0 } else { 40.0 });
        }
        let wall = ray * (2.4 / (1.0 + 0.2 * ray.y));
        (
            wall.z,
            if (wall.x * 4.0).rem_euclid(2.0) < 1.0 {
                120.0
            } else {
                230.0
            },
        )
    }

    fn distance_to_surface(&self, p: &Point3<f64>) -> f64 {
        let panel_is_near = p.x.abs() < 0.26 && p.y.abs() < 0.19;
        let to_wall = (p.z - 2.4 + 0.2 * p.y).abs() / 1.04_f64.sqrt();
        let to_panel = (p.z - 1.2 - 0.3 * p.x).abs() / 1.09_f64.sqrt();
        if panel_is_near {
            to_panel.min(to_wall)
        } else {
            to_wall
        }
    }

    fn render(&self) -> (GrayImage, InverseDepthMap) {
        let mut map = InverseDepthMap::unknown(WIDTH, HEIGHT).unwrap();
        let mut samples = Vec::new();
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let (x_px, y_px) = (x as f64, y as f64);
                let (depth, _) = self.see(x_px, y_px);
                map.set(x, y, InverseDepth::new((1.0 / depth) as f32, 0.0015));
                // A camera averages over the pixel.
                let offsets = [-0.375, -0.125, 0.125, 0.375];
                let sum: f64 = offsets
                    .iter()
                    .flat_map(|dy| offsets.map(|dx| self.see(x_px + dx, y_px + dy).1))
                    .sum();
                samples.push((sum / 16.0).round() as u8);
            }
        }
        (GrayImage::new(WIDTH, HEIGHT, samples).unwrap(), map)
    }
}

#[test]
fn segments_of_an_exact_room_lie_on_its_surfaces() {
    let room = Room {
        camera: Camera::pinhole(262.0, 262.0, 159.5, 119.5).unwrap(),
    };
    let (image, map) = room.render();
    let mut extractor = SegmentExtractor::new(ExtractOptions::default()).unwrap();
    let extraction = extractor
        .extract(&image, None, &map, &room.camera, 3)
        .unwrap();
    assert_eq!(extractor.chains().check(), Ok(()));
    assert!(
        extraction.explained_share() > 0.85,
        "{}",
        extraction.explained_share()
    );
    let (mut close, mut total) = (0, 0);
    for segment in &extraction.segments {
        assert_eq!(segment.keyframe, 3);
        let [a, b] = segment.ends_in_camera;
        for step in 0..=20 {
            let p = a + (b - a) * (f64::from(step) / 20.0);
            total += 1;
            close += usize::from(room.distance_to_surface(&p) < 0.005);
        }
    }
    assert!(
        close as f64 >= 0.95 * f64::from(total),
        "{close} of {total} within 5 mm"
    );
}

#[test]
fn the_outline_of_the_panel_belongs_to_the_panel() {
    let room = Room {
        camera: Camera::pinhole(262.0, 262.0, 159.5, 119.5).unwrap(),
    };
    let (image, map) = room.render();
    let mut extractor = SegmentExtractor::new(ExtractOptions::default()).unwrap();
    let extraction = extractor
        .extract(&image, None, &map, &room.camera, 0)
        .unwrap();
    let [left, right] = [-0.25, 0.25].map(|x| {
        room.camera
            .project(&Point3::new(x, 0.0, 1.2 + 0.3 * x))
            .unwrap()
            .x
    });
    let mut outline = 0;
    for segment in &extraction.segments {
        let middle = nalgebra::center(&segment.ends_px[0], &segment.ends_px[1]);
        let is_outline = (middle.x - left).abs() < 1.5 || (middle.x - right).abs() < 1.5;
        if is_outline && segment.length_px() > 20.0 && (middle.y - 119.5).abs() < 30.0 {
            outline += 1;
            assert!(
                segment.ends_in_camera.iter().all(|end| end.z < 1.35),
                "{:?}",
                segment.ends_in_camera
            );
        }
    }
    assert!(outline >= 2);
}

#[test]
fn the_gradient_points_to_the_brighter_side() {
    let room = Room {
        camera: Camera::pinhole(262.0, 262.0, 159.5, 119.5).unwrap(),
    };
    let (image, map) = room.render();
    let mut extractor = SegmentExtractor::new(ExtractOptions::default()).unwrap();
    for segment in extractor
        .extract(&image, None, &map, &room.camera, 0)
        .unwrap()
        .segments
    {
        let middle = nalgebra::center(&segment.ends_px[0], &segment.ends_px[1]);
        let is_inside = (4.0..WIDTH as f64 - 4.0).contains(&middle.x)
            && (4.0..HEIGHT as f64 - 4.0).contains(&middle.y);
        if !is_inside {
            continue;
        }
        let step = segment.mean_gradient.normalize() * 3.0;
        let [dark, bright] = [middle - step, middle + step].map(|p| {
            *image
                .get(p.x.round() as usize, p.y.round() as usize)
                .unwrap()
        });
        assert!(bright > dark, "{segment:?}");
    }
}
