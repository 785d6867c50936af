//! Textures from rendered photographs whose colours are known, and the files that hold them.
// Helpers of tests stand outside of test functions, where the lints would otherwise apply.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use image::{Rgb, RgbImage};
use linecarve_lines::camera::Camera;
use linecarve_mesh::raycast::RayScene;
use linecarve_mesh::render::{BackFaces, Background, RenderOptions, Renderer, View};
use linecarve_mesh::texture::{
    EncodedTexture, Texture, TextureFormat, TextureOptions, TextureView, texture_mesh,
};
use linecarve_mesh::{
    Geometry, GlbPart, TriangleMesh, read_geometry, read_textured, write_glb, write_textured_obj,
};
use nalgebra::{Isometry3, Point2, Point3, Translation3, UnitQuaternion, Vector3};

const SIZE: (u32, u32) = (160, 120);

fn camera() -> Camera {
    Camera::pinhole(150.0, 150.0, 79.5, 59.5).unwrap()
}

/// A rectangular grid of `columns` x `rows` squares from `corner` along two sides, seen from the side of `across x along`.
fn grid(
    corner: [f64; 3],
    along: [f64; 3],
    across: [f64; 3],
    [columns, rows]: [u32; 2],
) -> TriangleMesh {
    let (corner, along, across) = (
        Point3::from(corner),
        Vector3::from(along),
        Vector3::from(across),
    );
    let mut mesh = TriangleMesh::default();
    for row in 0..=rows {
        for column in 0..=columns {
            let (u, v) = (
                f64::from(column) / f64::from(columns),
                f64::from(row) / f64::from(rows),
            );
            mesh.positions.push(corner + along * u + across * v);
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let first = row * (columns + 1) + column;
            let below = first + columns + 1;
            mesh.triangles.push([first, below, first + 1]);
            mesh.triangles.push([first + 1, below, below + 1]);
        }
    }
    mesh
}

fn joined(mut mesh: TriangleMesh, other: TriangleMesh) -> TriangleMesh {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(other.positions);
    let triangles = other.triangles.iter();
    mesh.triangles
        .extend(triangles.map(|corners| corners.map(|corner| first + corner)));
    mesh
}

/// A wall of 4 x 3 at depth 2, seen from smaller depths.
fn wall() -> TriangleMesh {
    grid(
        [-2.0, -1.5, 2.0],
        [4.0, 0.0, 0.0],
        [0.0, 3.0, 0.0],
        [16, 12],
    )
}

/// Smooth waves of about 20 pixels.
fn pattern(point: &Point3<f64>) -> [f64; 3] {
    let wave = |phase: f64| {
        128.0 + 50.0 * (17.0 * point.x + phase).sin() + 40.0 * (19.0 * point.y - phase).cos()
    };
    [wave(0.0), wave(1.0), wave(2.5)]
}

fn view_from(x: f64, turn: f64) -> TextureView {
    TextureView {
        camera: camera(),
        world_from_camera: Isometry3::from_parts(
            Translation3::new(x, 0.1 * x, 0.0),
            UnitQuaternion::from_axis_angle(&Vector3::y_axis(), turn),
        ),
    }
}

fn views() -> Vec<TextureView> {
    [
        (-0.8, 0.1),
        (-0.3, 0.0),
        (0.2, -0.1),
        (0.7, -0.15),
        (0.0, 0.3),
    ]
    .map(|(x, turn)| view_from(x, turn))
    .to_vec()
}

/// What a view sees of a mesh with colours by position.
fn photo(
    mesh: &TriangleMesh,
    view: &TextureView,
    gain: [f64; 3],
    color: impl Fn(&Point3<f64>) -> [f64; 3],
) -> RgbImage {
    let scene = RayScene::new(mesh);
    let eye = Point3::from(view.world_from_camera.translation.vector);
    RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let pixel = Point2::new(f64::from(x), f64::from(y));
        let ray = view.camera.point_at_depth(&pixel, 1.0).unwrap();
        let direction = view.world_from_camera.rotation * ray.coords;
        let hit = scene.cast(&eye, &direction, f64::INFINITY);
        Rgb(hit.map_or([0; 3], |hit| {
            let color = color(&(eye + direction * hit.distance));
            std::array::from_fn(|i| (gain[i] * color[i]).round().clamp(0.0, 255.0) as u8)
        }))
    })
}

/// Root mean square difference of the texture to colours by position, over triangles for which `is_checked`.
fn difference(
    mesh: &TriangleMesh,
    texture: &Texture,
    color: impl Fn(&Point3<f64>) -> [f64; 3],
    is_checked: impl Fn(&Point3<f64>) -> bool,
) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        for shares in [
            [0.6, 0.2, 0.2],
            [0.2, 0.6, 0.2],
            [0.2, 0.2, 0.6],
            [0.02, 0.49, 0.49],
        ] {
            let parts = corners.iter().zip(shares);
            let point = parts
                .map(|(c, s)| mesh.positions[*c as usize].coords * s)
                .sum::<Vector3<f64>>();
            let point = Point3::from(point);
            if is_checked(&point) {
                let found = texture.color_at(triangle as u32, shares);
                let wanted = color(&point);
                sum += (0..3).map(|i| (found[i] - wanted[i]).powi(2)).sum::<f64>();
                count += 3;
            }
        }
    }
    assert!(count > 100, "{count} colours compared");
    (sum / f64::from(count)).sqrt()
}

/// Photographs of all views at the same exposure.
fn photos(
    mesh: &TriangleMesh,
    views: &[TextureView],
    color: impl Fn(&Point3<f64>) -> [f64; 3],
) -> Vec<RgbImage> {
    let views = views.iter();
    views
        .map(|view| photo(mesh, view, [1.0; 3], &color))
        .collect()
}

fn made(
    mesh: &TriangleMesh,
    views: &[TextureView],
    photos: &[RgbImage],
) -> (Texture, linecarve_mesh::texture::TextureSummary) {
    let load = |view: usize| Some(photos[view].clone());
    let (texture, summary) = texture_mesh(mesh, views, &load, &TextureOptions::default()).unwrap();
    assert_eq!(texture.validate(mesh.triangles.len()), Ok(()));
    (texture, summary)
}

/// The part of the wall that every view sees.
fn in_the_middle(point: &Point3<f64>) -> bool {
    point.x.abs() < 0.5 && point.y.abs() < 0.5
}

#[test]
fn a_pattern_on_a_plane_is_reproduced() {
    let (mesh, views) = (wall(), views());
    let photos = photos(&mesh, &views, pattern);
    let (texture, summary) = made(&mesh, &views, &photos);
    let rms = difference(&mesh, &texture, pattern, in_the_middle);
    // Interpolation between pixels, twice, of waves of 20 pixels.
    assert!(rms < 3.0, "{rms}");
    assert_eq!(summary.views, 5);
    for gain in summary.gains.as_flattened() {
        assert!((gain - 1.0).abs() < 0.01, "{:?}", summary.gains);
    }
}

#[test]
fn large_triangles_are_made_of_several_views() {
    let mesh = grid([-2.0, -1.5, 2.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], [1, 1]);
    let views = views();
    let photos = photos(&mesh, &views, pattern);
    let (texture, _) = made(&mesh, &views, &photos);
    let scene = RayScene::new(&mesh);
    // No view sees a whole triangle.
    for step in 0..40 {
        let x = -1.6 + 3.2 * f64::from(step) / 39.0;
        let hit = scene
            .cast(&Point3::new(x, 0.0, 0.0), &Vector3::z(), 9.0)
            .unwrap();
        let found = texture.color_at(hit.triangle, hit.barycentric);
        let wanted = pattern(&Point3::new(x, 0.0, 2.0));
        for channel in 0..3 {
            let error = found[channel] - wanted[channel];
            assert!(error.abs() < 16.0, "{found:?} at {x}, not {wanted:?}");
        }
    }
}

#[test]
fn a_hidden_wall_never_shows_what_hides_it() {
    // A red board in front of a blue wall, at another place in each view.
    let board = grid([-0.3, -0.3, 1.2], [0.6, 0.0, 0.0], [0.0, 0.6, 0.0], [4, 4]);
    let mesh = joined(wall(), board);
    let color = |point: &Point3<f64>| {
        if point.z < 1.6 {
            [200.0, 20.0, 20.0]
        } else {
            [20.0, 20.0, 200.0]
        }
    };
    let views = views();
    let photos = photos(&mesh, &views, color);
    let (texture, _) = made(&mesh, &views, &photos);
    let mut seen = 0;
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        let point = corners.map(|corner| mesh.positions[corner as usize].coords);
        let point = Point3::from(point.iter().sum::<Vector3<f64>>() / 3.0);
        if point.x.abs() < 0.9 && point.y.abs() < 0.5 {
            let found = texture.color_at(triangle as u32, [1.0 / 3.0; 3]);
            let wanted = color(&point);
            let is_right = (0..3).all(|i| (found[i] - wanted[i]).abs() < 12.0);
            assert!(is_right, "{found:?} at {point}");
            seen += 1;
        }
    }
    assert!(seen > 60, "{seen}");
}

#[test]
fn exposures_are_found_and_taken_out() {
    let (mesh, views) = (wall(), views());
    let gains = [
        [1.0; 3],
        [0.7; 3],
        [1.2, 1.1, 0.9],
        [0.8, 0.9, 1.0],
        [1.1; 3],
    ];
    let photos: Vec<RgbImage> = views
        .iter()
        .zip(gains)
        .map(|(view, gain)| photo(&mesh, view, gain, pattern))
        .collect();
    let (texture, summary) = made(&mesh, &views, &photos);
    for channel in 0..3 {
        let products: Vec<f64> = summary
            .gains
            .iter()
            .zip(gains)
            .map(|(found, given)| f64::from(found[channel]) * given[channel])
            .collect();
        for product in &products {
            let ratio = product / products[0];
            assert!(
                (ratio - 1.0).abs() < 0.02,
                "channel {channel}: {products:?}"
            );
        }
        // The texture is as bright as the darkest photograph.
        assert!((products[0] - 0.7).abs() < 0.05, "{products:?}");
        // No seams: one factor explains the whole wall.
        let scaled = |point: &Point3<f64>| {
            let color = pattern(point);
            std::array::from_fn(|i| {
                let gain = f64::from(summary.gains[0][i]) * gains[0][i];
                color[i] * gain
            })
        };
        let rms = difference(&mesh, &texture, scaled, in_the_middle);
        assert!(rms < 4.0, "{rms}");
    }
}

#[test]
fn surfaces_too_bright_for_most_photographs_look_as_in_the_dark_one() {
    let (mesh, views) = (wall(), views());
    // Bright on the left side.
    let color = |point: &Point3<f64>| {
        let bright = if point.x < 0.0 { 2.5 } else { 1.0 };
        pattern(point).map(|value| bright * value)
    };
    let gains = [1.0, 1.0, 0.4, 1.0, 1.0];
    let photos: Vec<RgbImage> = views
        .iter()
        .zip(gains)
        .map(|(view, gain)| photo(&mesh, view, [gain; 3], color))
        .collect();
    let (texture, _) = made(&mesh, &views, &photos);
    let dark = |point: &Point3<f64>| color(point).map(|value| 0.4 * value);
    let is_clipped = |point: &Point3<f64>| {
        in_the_middle(point) && color(point).iter().any(|value| *value > 300.0)
    };
    let rms = difference(&mesh, &texture, dark, is_clipped);
    // Four clipped photographs with a twentieth of the weight each make it a sixth of 70 steps darker.
    assert!(rms < 12.0, "{rms}");
}

#[test]
fn triangles_without_a_view_have_the_colours_of_their_vertices() {
    let back = grid([-1.0, -1.0, -3.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [2, 2]);
    let mut mesh = joined(wall(), back);
    mesh.colors = Some(mesh.positions.iter().map(|_| [10, 200, 30]).collect());
    let views = views();
    let photos = photos(&mesh, &views, pattern);
    let (texture, summary) = made(&mesh, &views, &photos);
    assert!(summary.unseen_triangles >= 8);
    for triangle in mesh.triangles.len() - 8..mesh.triangles.len() {
        let found = texture.color_at(triangle as u32, [0.3, 0.3, 0.4]);
        assert_eq!(found.map(f64::round), [10.0, 200.0, 30.0]);
    }
}

#[test]
fn triangles_never_overlap_in_the_atlas() {
    let board = grid([-0.3, -0.3, 1.2], [0.6, 0.0, 0.0], [0.0, 0.6, 0.0], [4, 4]);
    let mesh = joined(wall(), board);
    let views = views();
    let photos = photos(&mesh, &views, pattern);
    let (texture, _) = made(&mesh, &views, &photos);
    let (width, height) = texture.image.dimensions();
    let mut owners = vec![None; width as usize * height as usize];
    for (triangle, [a, b, c]) in texture.corners.iter().enumerate() {
        let side = |p: &[f32; 2], q: &[f32; 2], x: f32, y: f32| {
            (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0])
        };
        for y in 0..height {
            for x in 0..width {
                let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
                let sides = [side(a, b, px, py), side(b, c, px, py), side(c, a, px, py)];
                // Texels on an edge may belong to both of its triangles.
                if sides.iter().all(|s| *s > 1e-2) || sides.iter().all(|s| *s < -1e-2) {
                    let owner = &mut owners[(y * width + x) as usize];
                    assert_eq!(*owner, None, "triangle {triangle} at {x}, {y}");
                    *owner = Some(triangle);
                }
            }
        }
    }
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let (mesh, views) = (wall(), views());
    let photos = photos(&mesh, &views, pattern);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build()
            .unwrap()
            .install(|| made(&mesh, &views, &photos))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(3));
}

#[test]
fn missing_photographs_are_passed_over() {
    let (mesh, views) = (wall(), views());
    let photo = photo(&mesh, &views[1], [1.0; 3], pattern);
    let options = TextureOptions::default();
    let load = |view: usize| (view == 1).then(|| photo.clone());
    let (texture, summary) = texture_mesh(&mesh, &views, &load, &options).unwrap();
    assert_eq!(summary.views, 1);
    let rms = difference(&mesh, &texture, pattern, in_the_middle);
    assert!(rms < 3.0, "{rms}");
    assert_eq!(texture_mesh(&mesh, &views, &|_| None, &options), None);
    let empty = TriangleMesh::default();
    assert_eq!(texture_mesh(&empty, &views, &load, &options), None);
}

#[test]
fn a_small_atlas_has_a_lower_resolution() {
    let (mesh, views) = (wall(), views());
    let photos = photos(&mesh, &views, pattern);
    let mut options = TextureOptions::default();
    options.max_texels = 14_000;
    let load = |view: usize| Some(photos[view].clone());
    let (texture, summary) = texture_mesh(&mesh, &views, &load, &options).unwrap();
    assert!(summary.size[0] * summary.size[1] <= 14_000);
    assert_eq!(texture.validate(mesh.triangles.len()), Ok(()));
    let rms = difference(&mesh, &texture, pattern, in_the_middle);
    assert!(rms < 30.0, "{rms}");
    let mut options = TextureOptions::default();
    options.max_texels = 100;
    assert_eq!(texture_mesh(&mesh, &views, &load, &options), None);
}

/// A plane with its texture, from one view.
fn textured() -> (TriangleMesh, Texture) {
    let (mesh, views) = (wall(), views());
    let photos = photos(&mesh, &views, pattern);
    let (texture, _) = made(&mesh, &views, &photos);
    (mesh, texture)
}

fn encoded(texture: &Texture, format: TextureFormat) -> EncodedTexture {
    texture.clone().encoded(format).unwrap()
}

fn write_textured_glb(path: &Path, mesh: &TriangleMesh, texture: &EncodedTexture) {
    let part = GlbPart {
        name: "surface",
        geometry: Geometry::Textured(mesh, texture),
        color: [200; 3],
    };
    write_glb(path, &[part], &Vector3::zeros()).unwrap();
}

#[test]
fn glb_files_are_valid_and_hold_the_image() {
    let (mesh, texture) = textured();
    let folder = tempfile::tempdir().unwrap();
    for format in [TextureFormat::Jpeg, TextureFormat::Png] {
        let path = folder.path().join("mesh.glb");
        write_textured_glb(&path, &mesh, &encoded(&texture, format));
        // Reading validates indices, accessors and required fields.
        let file = gltf::Gltf::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        let blob = file.blob.as_deref().unwrap();
        let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|_| Some(blob));
        let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        let bounds = primitive.bounding_box();
        for axis in 0..3 {
            let low = positions
                .iter()
                .map(|p| p[axis])
                .fold(f32::INFINITY, f32::min);
            let high = positions
                .iter()
                .map(|p| p[axis])
                .fold(f32::NEG_INFINITY, f32::max);
            assert_eq!([low, high], [bounds.min[axis], bounds.max[axis]]);
        }
        let coordinates: Vec<[f32; 2]> = reader.read_tex_coords(0).unwrap().into_f32().collect();
        assert_eq!(coordinates.len(), positions.len());
        assert!(
            coordinates
                .iter()
                .flatten()
                .all(|c| (0.0..=1.0).contains(c))
        );
        let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        assert_eq!(indices.len(), 3 * mesh.triangles.len());
        assert!(
            indices
                .iter()
                .all(|index| (*index as usize) < positions.len())
        );
        assert!(
            reader.read_colors(0).is_none(),
            "readers multiply them with the texture"
        );
        let material = primitive.material();
        assert!(material.unlit());
        let info = material
            .pbr_metallic_roughness()
            .base_color_texture()
            .unwrap();
        assert_eq!(info.tex_coord(), 0);
        let gltf::image::Source::View { view, mime_type } = info.texture().source().source() else {
            panic!("the image is inside");
        };
        assert_eq!(mime_type, format.media_type());
        let image = &blob[view.offset()..view.offset() + view.length()];
        let image = image::load_from_memory(image).unwrap();
        assert_eq!((image.width(), image.height()), texture.image.dimensions());
        for view in file.views() {
            assert!(view.offset() % 4 == 0 && view.offset() + view.length() <= blob.len());
        }
    }
}

#[test]
fn textures_read_back_from_glb_and_obj() {
    let (mesh, texture) = textured();
    let folder = tempfile::tempdir().unwrap();
    let png = encoded(&texture, TextureFormat::Png);
    let glb = folder.path().join("mesh.glb");
    write_textured_glb(&glb, &mesh, &png);
    let obj = folder.path().join("my mesh.obj");
    let beside = write_textured_obj(&obj, &mesh, &png).unwrap();
    let names = beside.map(|path| path.file_name().unwrap().to_owned());
    assert_eq!(names, ["my_mesh.mtl", "my_mesh_texture.png"]);
    for path in [&glb, &obj] {
        let (shape, found) = read_textured(path).unwrap();
        let found = found.unwrap();
        assert_eq!(shape.triangles.len(), mesh.triangles.len());
        assert_eq!(found.validate(shape.triangles.len()), Ok(()));
        assert_eq!(found.image, texture.image);
        for (a, b) in found
            .corners
            .as_flattened()
            .iter()
            .zip(texture.corners.as_flattened())
        {
            assert!(
                (a[0] - b[0]).abs() < 1e-3 && (a[1] - b[1]).abs() < 1e-3,
                "{a:?} {b:?}"
            );
        }
        // Readers of geometry need no image.
        assert_eq!(read_geometry(path).unwrap(), shape);
    }
    // A second opinion.
    let options = tobj::LoadOptions::default();
    let (models, materials) = tobj::load_obj(&obj, &options).unwrap();
    let read: usize = models
        .iter()
        .map(|model| model.mesh.texcoord_indices.len())
        .sum();
    assert_eq!(read, 3 * mesh.triangles.len());
    let materials = materials.unwrap();
    assert_eq!(
        materials[0].diffuse_texture.as_deref(),
        Some("my_mesh_texture.png")
    );

    std::fs::remove_file(folder.path().join("my_mesh_texture.png")).unwrap();
    let message = read_textured(&obj).unwrap_err().to_string();
    assert!(message.contains("my_mesh_texture.png"), "{message}");
    assert!(read_geometry(&obj).is_ok());
}

#[test]
fn a_texture_of_another_mesh_is_refused() {
    let (mut mesh, texture) = textured();
    mesh.triangles.pop();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.obj");
    let png = encoded(&texture, TextureFormat::Png);
    let message = write_textured_obj(&path, &mesh, &png)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("mesh.obj") && message.contains("384"),
        "{message}"
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    assert!(Renderer::new(&mesh).with_texture(&texture).is_err());
}

#[test]
fn pictures_show_the_texture() {
    let (mesh, texture) = textured();
    let view = View {
        camera: camera(),
        width: SIZE.0,
        height: SIZE.1,
        world_from_camera: Isometry3::identity(),
        up: -Vector3::y(),
    };
    let mut options = RenderOptions::default().unlit();
    options.background = Background::Plain([0; 3]);
    options.back_faces = BackFaces::Hidden;
    let renderer = Renderer::new(&mesh).with_texture(&texture).unwrap();
    let picture = renderer.draw(None, &view, &options, &|_, _| {}).unwrap();
    let wanted = photo(&mesh, &view_from(0.0, 0.0), [1.0; 3], pattern);
    let mut sum = 0.0;
    let mut count = 0;
    for y in 30..90 {
        for x in 50..110 {
            let (a, b) = (picture.get_pixel(x, y).0, wanted.get_pixel(x, y).0);
            sum += (0..3)
                .map(|i| (f64::from(a[i]) - f64::from(b[i])).powi(2))
                .sum::<f64>();
            count += 3;
        }
    }
    let rms = (sum / f64::from(count)).sqrt();
    assert!(rms < 5.0, "{rms}");
}
