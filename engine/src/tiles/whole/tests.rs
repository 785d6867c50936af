use std::collections::BTreeMap;
use std::path::PathBuf;

use linecarve_sequence::SparseModel;
use linecarve_synth::{CityOptions, write_city};
use nalgebra::{Point3, Vector3};

use super::*;
use crate::recording::{Recording, SourceChoice};
use crate::{Reconstruction, RunOptions, run::CancelToken};

fn city(points: usize, folder: &Path) -> Input {
    let path = folder.join("city");
    write_city(&CityOptions::new(points, 3), &path).unwrap();
    input(path.join("fused.ply"))
}

fn input(path: PathBuf) -> Input {
    Input {
        source: SourceChoice::MapPoints,
        ..Input::from(path)
    }
}

fn mesh_of(input: &Input, is_closed: bool) -> PointMesh {
    let folder = tempfile::tempdir().unwrap();
    let mesh = mesh_points(input, Options::default(), is_closed, folder.path());
    mesh.unwrap().unwrap()
}

/// A model in memory with the options of its recording, in the frame of computation.
fn model_of(input: &Input) -> (SparseModel, Options, Vector3<f64>) {
    let mut recording = Recording::open(input, Options::default()).unwrap();
    let model = std::sync::Arc::unwrap_or_clone(recording.take_model().unwrap());
    (model, recording.options, recording.origin)
}

fn mesh_of_model(
    model: &SparseModel,
    options: &Options,
    origin: Vector3<f64>,
) -> Result<PointMesh, ProjectError> {
    let folder = tempfile::tempdir().unwrap();
    Selection::of_model(model, options.clone(), origin)?.mesh(false, folder.path())
}

#[test]
fn the_mesh_is_that_of_a_reconstruction() {
    let folder = tempfile::tempdir().unwrap();
    let input = city(4000, folder.path());
    let streamed = mesh_of(&input, false);
    let run = RunOptions {
        is_at_once: true,
        ..RunOptions::default()
    };
    let recording = Recording::open(&input, Options::default()).unwrap();
    let mut whole = Reconstruction::new(recording, run).unwrap();
    whole.run(CancelToken::default(), &mut []).unwrap();
    assert!(streamed.mesh.triangles.len() > 1000);
    let expected = whole.surface();
    assert!(streamed.mesh.positions == expected.positions);
    assert!(streamed.mesh.triangles == expected.triangles);
    // A model that is read as a whole.
    let (model, options, origin) = model_of(&input);
    let read = mesh_of_model(&model, &options, origin).unwrap();
    assert!(read.mesh == streamed.mesh);
    assert_eq!(read.counts, streamed.counts);
}

#[test]
fn a_closed_mesh_is_watertight() {
    let folder = tempfile::tempdir().unwrap();
    let input = city(4000, folder.path());
    let made = mesh_of(&input, true);
    let mut edges = BTreeMap::new();
    for triangle in &made.mesh.triangles {
        for k in 0..3 {
            let edge = (triangle[k], triangle[(k + 1) % 3]);
            *edges.entry(edge).or_insert(0) += 1;
        }
    }
    let is_closed = |((from, to), count): (&(u32, u32), &i32)| {
        *count == 1 && edges.get(&(*to, *from)) == Some(&1)
    };
    assert!(edges.len() > 3000 && edges.iter().all(is_closed));
}

#[test]
fn coordinates_in_single_precision_are_refused_where_they_are_rounded() {
    let folder = tempfile::tempdir().unwrap();
    let at = city(4000, folder.path());
    let bytes = std::fs::read(&at.path).unwrap();
    let start = split_cloud(&bytes).0.len();
    let offset = [500_000.0_f32, 5_400_000.0, 0.0];
    let mut moved = bytes.clone();
    for row in moved[start..].chunks_exact_mut(27) {
        for (k, offset) in offset.iter().enumerate() {
            let place = &mut row[4 * k..4 * k + 4];
            let x = f32::from_le_bytes((&*place).try_into().unwrap()) + offset;
            place.copy_from_slice(&x.to_le_bytes());
        }
    }
    std::fs::write(&at.path, moved).unwrap();
    let images = at.path.with_file_name("sparse").join("images.txt");
    let text = std::fs::read_to_string(&images).unwrap();
    // t = -R c: the offset is rotated, too.
    let shifted: Vec<String> = text.lines().map(|line| shifted(line, offset)).collect();
    std::fs::write(&images, shifted.join("\n") + "\n").unwrap();
    let refused = mesh_points(&at, Options::default(), false, folder.path()).unwrap_err();
    let text = refused.to_string();
    assert!(
        text.contains("fused.ply: ") && text.contains("multiples of 0.5,"),
        "{text}"
    );
    assert!(text.contains("colmap model_transformer"), "{text}");
}

/// A line of `images.txt` after its camera was moved.
fn shifted(line: &str, offset: [f32; 3]) -> String {
    let words: Vec<&str> = line.split(' ').collect();
    let [id, w, x, y, z, tx, ty, tz, camera, name] = words[..] else {
        return line.to_owned();
    };
    let number = |text: &str| text.parse::<f64>().unwrap();
    let rotation = nalgebra::Quaternion::new(number(w), number(x), number(y), number(z));
    let rotation = nalgebra::UnitQuaternion::new_normalize(rotation);
    let moved = rotation * Vector3::from(offset.map(f64::from));
    let t = Vector3::new(number(tx), number(ty), number(tz)) - moved;
    format!(
        "{id} {w} {x} {y} {z} {} {} {} {camera} {name}",
        t.x, t.y, t.z
    )
}

/// The header of a cloud with its last line, and the rows after it.
fn split_cloud(bytes: &[u8]) -> (String, &[u8]) {
    let end = b"end_header\n";
    let start = bytes.windows(end.len()).position(|it| it == end).unwrap() + end.len();
    let header = String::from_utf8(bytes[..start].to_vec()).unwrap();
    (header, &bytes[start..])
}

#[test]
fn numbers_in_other_forms_give_the_same_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let at = city(3000, folder.path());
    let expected = mesh_of(&at, false).mesh;
    assert!(expected.triangles.len() > 1000);
    let bytes = std::fs::read(&at.path).unwrap();
    let (header, rows) = split_cloud(&bytes);
    let big_header = header.replace("little_endian", "big_endian");
    let double_header = header.replace("float", "double");
    let (mut big, mut double) = (big_header.into_bytes(), double_header.into_bytes());
    for row in rows.chunks_exact(27) {
        let (floats, colors) = row.split_at(24);
        for float in floats.chunks_exact(4) {
            let number = f32::from_le_bytes(float.try_into().unwrap());
            big.extend(number.to_be_bytes());
            double.extend(f64::from(number).to_le_bytes());
        }
        big.extend(colors);
        double.extend(colors);
    }
    for (bytes, is_streamed) in [(big, false), (double, true)] {
        std::fs::write(&at.path, bytes).unwrap();
        assert_eq!(at.dense_cloud().unwrap().is_some(), is_streamed);
        assert!(mesh_of(&at, false).mesh == expected);
    }
}

#[test]
fn views_that_do_not_fit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = city(3000, folder.path());
    let path = at.path.with_file_name("fused.ply.vis");
    let bytes = std::fs::read(&path).unwrap();
    let mut another_count = bytes.clone();
    another_count[0] ^= 1;
    let mut unknown_image = bytes.clone();
    unknown_image[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    let cut_off = bytes[..bytes.len() - 2].to_vec();
    for (bytes, remedy) in [
        (another_count, "fuse both again"),
        (unknown_image, "give the model that was fused"),
        (cut_off, "copy it again"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let refused = mesh_points(&at, Options::default(), false, folder.path());
        let text = refused.unwrap_err().to_string();
        assert!(
            text.contains("fused.ply") && text.contains(remedy),
            "{text}"
        );
    }
}

/// Observations that cannot be used leave the others alone.
#[test]
fn hostile_clouds_end() {
    let folder = tempfile::tempdir().unwrap();
    let at = city(3000, folder.path());
    let whole = mesh_of(&at, false);
    let (model, options, _) = model_of(&at);
    let mesh = |model: SparseModel| {
        let made = mesh_of_model(&model, &options, Vector3::zeros()).unwrap();
        (made.mesh.triangles.len(), made)
    };
    let center = |model: &SparseModel, view: usize| {
        Point3::from(model.views[view].world_from_camera.translation.vector)
    };
    let usual = whole.mesh.triangles.len();
    // Points at the centre of a camera: one, and five hundred.
    for (count, share) in [(1, 2), (500, 8)] {
        let mut with = model.clone();
        let at = center(&with, 0);
        (with.points.iter_mut().take(count)).for_each(|point| point.point_in_world = at);
        let (triangles, made) = mesh(with);
        assert!(triangles > usual / share, "{triangles} of {usual}");
        assert!(made.counts.wrong_observations >= count);
    }
    // Every point twice.
    let mut twice = model.clone();
    twice.points.extend(model.points.clone());
    assert!(mesh(twice).0 > usual / 2);
    // Two views each.
    let mut pairs = model.clone();
    pairs
        .points
        .iter_mut()
        .for_each(|point| point.observations.truncate(2));
    assert!(mesh(pairs).0 > 300);
    // Coordinates that are no numbers.
    let mut broken = model.clone();
    broken.points[7].point_in_world.x = f64::NAN;
    broken.points[8].point_in_world.z = f64::INFINITY;
    let (triangles, made) = mesh(broken);
    assert!(triangles > usual / 2 && made.counts.not_finite == 2);
    // A view that there is not.
    let mut unknown = model;
    unknown.points[5].observations[0].view = 1 << 20;
    let refused = mesh_of_model(&unknown, &options, Vector3::zeros()).unwrap_err();
    assert!(refused.to_string().contains("point 5"), "{refused}");
}

/// Two thousand positions with a hundred points each: equal rays are walked once.
#[test]
fn points_at_one_position_cost_one_point() {
    let folder = tempfile::tempdir().unwrap();
    let at = city(2000, folder.path());
    let (model, options, _) = model_of(&at);
    let mut many = model.clone();
    many.points = (0..100).flat_map(|_| model.points.clone()).collect();
    let made = mesh_of_model(&many, &options, Vector3::zeros()).unwrap();
    assert!(made.carved >= made.mesh.positions.len() / 2);
    assert!(!made.mesh.triangles.is_empty());
}
