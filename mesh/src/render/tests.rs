use image::RgbImage;
use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point2, Point3, Translation3, UnitQuaternion, Vector3};

use super::{BackFaces, Background, RenderOptions, Renderer, View, up_direction};
use crate::{LineSet, TriangleMesh};

const WHITE: [u8; 3] = [255, 255, 255];

fn plain() -> RenderOptions {
    RenderOptions {
        supersampling: 1,
        background: Background::Plain(WHITE),
        occlusion_rays: 0,
        outline_darkness: 0.0,
        crease_darkness: 0.0,
        ..RenderOptions::default()
    }
}

/// A camera at the origin that looks along z.
fn view(width: u32, height: u32) -> View {
    let camera = Camera::pinhole(
        50.0,
        50.0,
        f64::from(width) / 2.0 - 0.5,
        f64::from(height) / 2.0 - 0.5,
    )
    .unwrap();
    View::from_keyframe(&camera, width, height, Isometry3::identity(), -Vector3::y())
}

fn triangle(corners: [Point3<f64>; 3]) -> TriangleMesh {
    TriangleMesh {
        positions: corners.to_vec(),
        triangles: vec![[0, 1, 2]],
        colors: None,
    }
}

/// A square across the view at depth `z`, front towards the camera.
fn square(half: f64, z: f64) -> TriangleMesh {
    TriangleMesh {
        positions: vec![
            Point3::new(-half, -half, z),
            Point3::new(half, -half, z),
            Point3::new(half, half, z),
            Point3::new(-half, half, z),
        ],
        triangles: vec![[0, 2, 1], [0, 3, 2]],
        colors: None,
    }
}

fn draw(
    mesh: &TriangleMesh,
    lines: Option<&LineSet>,
    view: &View,
    options: &RenderOptions,
) -> RgbImage {
    Renderer::new(mesh)
        .draw(lines, view, options, &|_, _| {})
        .unwrap()
}

#[test]
fn a_triangle_covers_the_pixels_whose_centres_it_covers() {
    let corners = [
        Point3::new(-0.8, -0.55, 2.0),
        Point3::new(0.1, 0.7, 2.5),
        Point3::new(0.9, -0.35, 3.0),
    ];
    let view = view(60, 40);
    let picture = draw(&triangle(corners), None, &view, &plain());
    let [a, b, c] = corners.map(|corner| view.camera.project(&corner).unwrap());
    let side = |p: Point2<f64>, q: Point2<f64>, x: Point2<f64>| (q - p).perp(&(x - p));
    let mut covered = 0;
    for (x, y, pixel) in picture.enumerate_pixels() {
        let centre = Point2::new(f64::from(x), f64::from(y));
        let signs = [side(a, b, centre), side(b, c, centre), side(c, a, centre)];
        let inside = signs.iter().all(|s| *s < 0.0) || signs.iter().all(|s| *s > 0.0);
        assert_eq!(pixel.0 != WHITE, inside, "pixel ({x}, {y})");
        covered += usize::from(inside);
    }
    assert!(covered > 200);
}

#[test]
fn an_empty_mesh_shows_the_background_alone() {
    let options = RenderOptions {
        background: Background::Gradient([0, 0, 0], WHITE),
        ..RenderOptions::default()
    };
    let picture = draw(&TriangleMesh::default(), None, &view(8, 6), &options);
    assert_eq!(picture.get_pixel(3, 0).0, [0, 0, 0]);
    assert_eq!(picture.get_pixel(3, 5).0, WHITE);
    assert!(View::dollhouse(&TriangleMesh::default(), &[], (64, 48)).is_none());
}

#[test]
fn a_segment_behind_the_mesh_is_hidden_and_one_before_it_is_drawn() {
    let mesh = square(0.6, 2.0);
    let options = RenderOptions {
        line_color: [255, 0, 0],
        line_width_px: 3.0,
        ..plain()
    };
    let view = view(60, 40);
    let row = |z: f64| LineSet::from_segments([[Point3::new(-z, 0.0, z), Point3::new(z, 0.0, z)]]);
    let red = |picture: &RgbImage, x: u32| picture.get_pixel(x, 19).0 == [255, 0, 0];
    let before = draw(&mesh, Some(&row(1.0)), &view, &options);
    let on_surface = draw(&mesh, Some(&row(2.01)), &view, &options);
    let behind = draw(&mesh, Some(&row(3.0)), &view, &options);
    // The square spans x = 14.5 to 44.5.
    for x in 2..58 {
        let outside = !(15..=44).contains(&x);
        assert!(red(&before, x), "before, {x}");
        assert!(red(&on_surface, x), "on the surface, {x}");
        assert_eq!(red(&behind, x), outside, "behind, {x}");
    }
}

#[test]
fn a_segment_that_passes_the_camera_and_broken_ones_do_no_harm() {
    let options = plain();
    let view = view(60, 40);
    let mut lines = LineSet::from_segments([
        [Point3::new(-0.1, 0.1, -5.0), Point3::new(0.2, -0.1, 5.0)],
        [Point3::new(0.0, 0.0, -1.0), Point3::new(0.0, 0.0, -2.0)],
        [Point3::new(0.0, f64::NAN, 1.0), Point3::new(0.0, 0.0, 2.0)],
        [Point3::new(0.0, 0.0, 1.0), Point3::new(0.0, 0.0, 1.0)],
        [Point3::new(-1e12, 1.0, 1.0), Point3::new(1e12, -1.0, 1.0)],
    ]);
    lines.lines.push([0, 1000]);
    let picture = draw(&TriangleMesh::default(), Some(&lines), &view, &options);
    assert!(picture.pixels().any(|pixel| pixel.0 != WHITE));
}

#[test]
fn hidden_back_faces_let_the_view_into_a_closed_room() {
    let mut wall = square(0.5, 1.0);
    for triangle in &mut wall.triangles {
        triangle.swap(1, 2);
    }
    let mut room = square(0.5, 2.0);
    room.colors = Some(vec![[0, 200, 0]; 4]);
    room.positions.extend(wall.positions);
    room.triangles
        .extend(wall.triangles.iter().map(|t| t.map(|corner| corner + 4)));
    room.colors = Some([vec![[0, 200, 0]; 4], vec![[200, 0, 0]; 4]].concat());
    let view = view(40, 40);
    let centre = |back_faces| {
        let options = RenderOptions {
            back_faces,
            ..plain()
        };
        draw(&room, None, &view, &options).get_pixel(20, 20).0
    };
    let hidden = centre(BackFaces::Hidden);
    let shown = centre(BackFaces::Shown);
    assert!(hidden[1] > 100 && hidden[0] == 0, "{hidden:?}");
    assert!(shown[0] > 100 && shown[1] == 0, "{shown:?}");
    assert_ne!(centre(BackFaces::Tinted), shown);
}

#[test]
fn threads_do_not_change_a_byte_and_progress_reaches_its_end() {
    let mut mesh = square(0.7, 2.0);
    mesh.positions.push(Point3::new(0.1, 0.2, 1.2));
    mesh.triangles
        .extend([[0, 4, 1], [1, 4, 2], [2, 4, 3], [3, 4, 0]]);
    let lines = LineSet::from_segments([[Point3::new(-0.7, 0.0, 2.0), Point3::new(0.7, 0.1, 1.4)]]);
    let view = view(80, 60);
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let last = std::sync::Mutex::new((0, 0));
        let picture = pool.install(|| {
            Renderer::new(&mesh)
                .draw(
                    Some(&lines),
                    &view,
                    &RenderOptions::default(),
                    &|done, total| {
                        let mut last = last.lock().unwrap();
                        *last = (done.max(last.0), total);
                    },
                )
                .unwrap()
        });
        let (done, total) = *last.lock().unwrap();
        assert_eq!(done, total);
        picture
    };
    assert_eq!(with_threads(1), with_threads(2));
}

#[test]
fn corners_are_darker_than_open_surfaces() {
    // Floor and wall of a room, seen from inside.
    let mesh = TriangleMesh {
        positions: vec![
            Point3::new(-5.0, 1.0, 0.5),
            Point3::new(5.0, 1.0, 0.5),
            Point3::new(5.0, 1.0, 4.0),
            Point3::new(-5.0, 1.0, 4.0),
            Point3::new(5.0, -5.0, 4.0),
            Point3::new(-5.0, -5.0, 4.0),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3], [3, 2, 4], [3, 4, 5]],
        colors: None,
    };
    let options = RenderOptions {
        occlusion_rays: 16,
        ..plain()
    };
    let view = view(60, 60);
    let picture = draw(&mesh, None, &view, &options);
    // The wall meets the floor at y = 1 / 4 * 50 + 29.5 = 42.
    let brightness = |y: u32| picture.get_pixel(30, y).0[1];
    assert!(brightness(41) + 10 < brightness(10));
    let rows: Vec<u8> = (25..60).map(|x| picture.get_pixel(x, 10).0[1]).collect();
    let spread = rows.iter().max().unwrap() - rows.iter().min().unwrap();
    assert!(spread <= 8, "an evenly lit wall has no noise: {rows:?}");
}

#[test]
fn a_view_towards_a_point_shows_it_in_the_middle_with_up_above() {
    let (eye, target) = (Point3::new(3.0, 1.0, -2.0), Point3::new(-1.0, 0.5, 4.0));
    let up = Vector3::new(0.1, -1.0, 0.2);
    let view = View::look_at(&eye, &target, &up, (101, 51), 0.8).unwrap();
    let camera_from_world = view.world_from_camera.inverse();
    let pixel = view.camera.project(&(camera_from_world * target)).unwrap();
    assert!((pixel - Point2::new(50.0, 25.0)).norm() < 1e-9);
    let above = view
        .camera
        .project(&(camera_from_world * (target + up)))
        .unwrap();
    assert!(above.y < 25.0 && (above.x - 50.0).abs() < 1e-9);
    // Straight down, no roll is upright: any will do.
    let down = View::look_at(&eye, &(eye - up), &up, (101, 51), 0.8).unwrap();
    assert!(down.world_from_camera.iter_is_finite());
    assert!(View::look_at(&eye, &target, &up, (101, 51), 0.0).is_err());
}

trait Finite {
    fn iter_is_finite(&self) -> bool;
}

impl Finite for Isometry3<f64> {
    fn iter_is_finite(&self) -> bool {
        self.to_homogeneous().iter().all(|v| v.is_finite())
    }
}

#[test]
fn an_outside_view_holds_the_whole_mesh_and_fills_most_of_the_picture() {
    let mut mesh = square(1.0, 2.0);
    mesh.positions.push(Point3::new(0.3, -2.0, 5.0));
    mesh.triangles.push([0, 1, 4]);
    // A vertex of no triangle does not count.
    mesh.positions.push(Point3::new(1e6, 0.0, 0.0));
    for poses in [
        vec![],
        vec![Isometry3::identity()],
        vec![
            Isometry3::identity(),
            Isometry3::from_parts(
                Translation3::identity(),
                UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI),
            ),
        ],
    ] {
        for size in [(640, 480), (300, 600)] {
            let view = View::dollhouse(&mesh, &poses, size).unwrap();
            let camera_from_world = view.world_from_camera.inverse();
            let (mut low, mut high) = (Point2::new(1.0, 1.0), Point2::new(0.0, 0.0));
            for position in &mesh.positions[..5] {
                let pixel = view
                    .camera
                    .project(&(camera_from_world * position))
                    .unwrap();
                let relative = Point2::new(
                    (pixel.x + 0.5) / f64::from(size.0),
                    (pixel.y + 0.5) / f64::from(size.1),
                );
                low = low.inf(&relative);
                high = high.sup(&relative);
            }
            assert!(low.x > 0.0 && low.y > 0.0 && high.x < 1.0 && high.y < 1.0);
            let extent = high - low;
            assert!(extent.x.max(extent.y) > 0.6, "{extent:?}");
            // From above: the camera lies above the mesh's middle.
            assert!(view.world_from_camera.translation.y < -2.0);
        }
    }
}

#[test]
fn up_is_where_the_cameras_were_held() {
    assert_eq!(up_direction(&[]), -Vector3::y());
    let rolled = Isometry3::from_parts(
        Translation3::identity(),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.5),
    );
    let tilted_back = Isometry3::from_parts(
        Translation3::identity(),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -0.5),
    );
    assert!((up_direction(&[rolled, tilted_back]) + Vector3::y()).norm() < 1e-12);
}

#[test]
fn options_and_sizes_out_of_range_are_refused() {
    let mesh = TriangleMesh::default();
    let renderer = Renderer::new(&mesh);
    let refused = |view: &View, options: &RenderOptions| {
        renderer
            .draw(None, view, options, &|_, _| {})
            .unwrap_err()
            .to_string()
    };
    let options = RenderOptions {
        line_width_px: f64::NAN,
        ..RenderOptions::default()
    };
    assert!(refused(&view(8, 8), &options).contains("line_width_px"));
    let options = RenderOptions {
        supersampling: 0,
        ..RenderOptions::default()
    };
    assert!(refused(&view(8, 8), &options).contains("supersampling"));
    assert!(refused(&view(0, 8), &RenderOptions::default()).contains("0 x 8"));
    assert!(refused(&view(1 << 20, 1 << 20), &RenderOptions::default()).contains("1048576"));
}
