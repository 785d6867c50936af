//! `linecarve mesh`: the mesh of a dense cloud or of a sparse model.

use std::path::{Path, PathBuf};

use anyhow::bail;

use crate::cli::{KnownOptions, MeshArgs};
use crate::commands::Outcome;
use crate::progress::Verbosity;
use crate::sinks::{TemporaryFolder, check_outputs, folder_of, surface_part, write_part};
use crate::standard_error::say;
use linecarve_engine::map::ModelCounts;
use linecarve_engine::options::Options;
use linecarve_engine::tiles::{KEYFRAMES_OF_TASK, ProjectError, Split, Task};
use linecarve_engine::tiles::{
    Planned, PointMesh, Project, carry_out_all, mesh_points, plan, up_of_views, write_mesh,
};
use linecarve_engine::{Input, SourceChoice};
use linecarve_mesh::{GltfFrame, TriangleMesh, far_origin, read_geometry};
use linecarve_sequence::DenseCloud;

use super::input::base_options;
use super::simplify::format_of;

/// Tables of the configuration that points with views do not use.
const OF_IMAGES: [&str; 6] = [
    "keyframes",
    "images",
    "sensor",
    "semi_dense",
    "pose_correction",
    "simplify",
];
/// Clouds in a workspace, the first that exists: of `colmap stereo_fusion`, of `colmap automatic_reconstructor`, of `DensifyPointCloud`.
const CLOUDS: [&str; 4] = [
    "fused.ply",
    "dense/fused.ply",
    "dense/0/fused.ply",
    "scene_dense.mvs",
];
/// Memory that a point of a dense cloud takes in one process, in bytes: 1000 with seven views, and 52 for each view more.
const BYTES_OF_POINT: u64 = 1600;

pub(super) fn run(args: &MeshArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let format = format_of("--out", &args.out)?;
    let mut input = source(&cloud_of(&args.input));
    let inputs = [&input.path].into_iter().chain(&args.cameras);
    let inputs: Vec<&Path> = inputs.chain(&args.config).map(PathBuf::as_path).collect();
    check_outputs(&[("--out", &args.out)], &inputs)?;
    input.cameras.clone_from(&args.cameras);
    let mut options = base_options(None, args.config.as_deref(), &OF_IMAGES)?;
    let labels = &mut options.carving.labels;
    *labels = args.labels.map_or(*labels, Into::into);
    for (name, became) in translate(&args.known, &mut options) {
        if verbosity > Verbosity::Quiet {
            say!("{name}: {became}");
        }
    }
    // Tiles know nothing of the space outside all points.
    let too_large = match args.closed {
        true => None,
        false => too_large(&input)?,
    };
    let (mesh, up, left_out) = match too_large {
        Some(cloud) => {
            let points = cloud.point_count();
            if verbosity > Verbosity::Quiet {
                say!("{points} points do not fit into the memory that is free: carving in tiles");
            }
            let (mesh, counts) = in_tiles(&input, options, &args.out)?;
            let left_out = counts.and_then(|counts| counts.left_out());
            (mesh, up_of_views(cloud.views()), left_out)
        }
        None => {
            let made = at_once(&input, options, args.closed, &args.out)?;
            (made.mesh, made.up, made.counts.left_out())
        }
    };
    if mesh.triangles.is_empty() {
        let why = left_out.unwrap_or_else(|| {
            "its points enclose no occupied space that a ray has left".to_owned()
        });
        return Ok(Outcome::Negative(format!(
            "{}: the mesh is empty: {why}",
            input.path.display()
        )));
    }
    if let Some(left_out) = left_out.filter(|_| verbosity > Verbosity::Quiet) {
        say!("{left_out}");
    }
    let up = args.up.map_or(up, Into::into);
    let frame = GltfFrame::upright(far_origin(&mesh.positions), &up);
    write_part(&args.out, surface_part(&mesh), format, &frame)?;
    if verbosity > Verbosity::Quiet {
        let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
        say!(
            "{vertices} vertices, {triangles} triangles; {}",
            args.out.display()
        );
    }
    Ok(Outcome::Done)
}

/// The cloud of a workspace; other inputs are what they are.
fn cloud_of(input: &Path) -> PathBuf {
    let in_folder = CLOUDS.iter().map(|name| input.join(name));
    let found = in_folder.into_iter().find(|path| path.is_file());
    found.unwrap_or_else(|| input.to_owned())
}

fn source(input: &Path) -> Input {
    let mut options = Input::from(input);
    options.source = SourceChoice::MapPoints;
    options.progress = Verbosity::Quiet.hook();
    options
}

/// Carves all points in this process, with temporary files beside the mesh.
fn at_once(
    input: &Input,
    options: Options,
    is_closed: bool,
    out: &Path,
) -> anyhow::Result<PointMesh> {
    let Some(made) = mesh_points(input, options, is_closed, folder_of(out))? else {
        bail!(
            "{}: no points with views: give the workspace of `colmap stereo_fusion`, its fused.ply (with fused.ply.vis beside it), a PLY \
             file with normals and its --cameras, a sparse model, or a scene of OpenMVS; `linecarve reconstruct` makes surfaces from \
             images",
            input.path.display()
        );
    };
    Ok(made)
}

/// Carves the points in tiles, in a temporary folder beside the mesh.
fn in_tiles(
    input: &Input,
    options: Options,
    out: &Path,
) -> anyhow::Result<(TriangleMesh, Option<ModelCounts>)> {
    let work = TemporaryFolder::create(folder_of(out))?;
    let split = Split {
        tiles: None,
        halo: linecarve_tiles::PlanOptions::default().halo,
        keyframes_of_task: KEYFRAMES_OF_TASK,
    };
    let counts = match plan(input, options, split, work.path())? {
        Planned::Model(_, counts) => Some(counts),
        Planned::Sequence(_) => None,
    };
    let carry_out = |task: Task| Project::open(work.path())?.carry_out(task);
    let (project, _) = carry_out_all::<ProjectError>(work.path(), 1, carry_out)?;
    let (path, _) = write_mesh(&project)?;
    Ok((read_geometry(&path)?.into_mesh(), counts))
}

/// A dense cloud that does not fit into the memory that is free.
fn too_large(input: &Input) -> anyhow::Result<Option<DenseCloud>> {
    let (Some(cloud), Some(free)) = (input.dense_cloud()?, free_memory()) else {
        return Ok(None);
    };
    let bytes = cloud.point_count().saturating_mul(BYTES_OF_POINT);
    Ok((bytes > free).then_some(cloud))
}

/// Memory that is free, in bytes; `None` where the system does not say.
fn free_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text
        .lines()
        .find(|line| line.starts_with("MemAvailable:"))?;
    let kilobytes: u64 = line.split_ascii_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes << 10)
}

/// Follows the options that are known from other meshers; returns the names of those given, and what each became.
fn translate(known: &KnownOptions, options: &mut Options) -> Vec<(&'static str, String)> {
    let mut became = Vec::new();
    let cut = &mut options.carving.cut;
    for (name, factor) in [
        (
            "--DelaunayMeshing.quality_regularization",
            known.quality_regularization,
        ),
        ("--quality-factor", known.quality_factor),
    ] {
        if let Some(factor) = factor {
            cut.quality_weight *= factor;
            became.push((
                name,
                format!("carving.cut.quality_weight = {}", cut.quality_weight),
            ));
        }
    }
    for (name, factor) in [
        (
            "--DelaunayMeshing.distance_sigma_factor",
            known.distance_sigma_factor,
        ),
        ("--thickness-factor", known.thickness_factor),
    ] {
        if let Some(factor) = factor {
            cut.sigma_factor *= factor;
            became.push((name, format!("standard deviations of points x {factor}")));
        }
    }
    let joined = "no effect: points join within their noise, which is measured";
    let filtered = "no effect: long triangles stay where views see them face on";
    for (name, value, effect) in [
        (
            "--DelaunayMeshing.max_proj_dist",
            known.max_proj_dist,
            joined,
        ),
        (
            "--DelaunayMeshing.max_depth_dist",
            known.max_depth_dist,
            joined,
        ),
        ("--min-point-distance", known.min_point_distance, joined),
        (
            "--DelaunayMeshing.visibility_sigma",
            known.visibility_sigma,
            "no effect: the weight of a point follows its number of views",
        ),
        (
            "--DelaunayMeshing.max_side_length_factor",
            known.max_side_length_factor,
            filtered,
        ),
    ] {
        if value.is_some() {
            became.push((name, effect.to_owned()));
        }
    }
    became
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_options_become_parameters_or_are_said_to_have_no_effect() {
        let mut options = Options::default();
        let known = KnownOptions {
            quality_regularization: Some(4.0),
            thickness_factor: Some(2.0),
            max_proj_dist: Some(20.0),
            ..KnownOptions::default()
        };
        let names: Vec<_> = translate(&known, &mut options)
            .into_iter()
            .map(|(name, _)| name)
            .collect();
        let expected = [
            "--DelaunayMeshing.quality_regularization",
            "--thickness-factor",
            "--DelaunayMeshing.max_proj_dist",
        ];
        assert_eq!(names, expected);
        assert_eq!(
            options.carving.cut.quality_weight,
            4.0 * Options::default().carving.cut.quality_weight
        );
        assert_eq!(options.carving.cut.sigma_factor, 2.0);
    }

    #[test]
    fn tiles_give_the_mesh_of_one_process() {
        let folder = tempfile::tempdir().unwrap();
        let city = folder.path().join("city");
        let options = linecarve_synth::CityOptions::new(3000, 1);
        linecarve_synth::write_city(&options, &city).unwrap();
        let by_images = source(&cloud_of(&city));
        let mut by_normals = by_images.clone();
        by_normals.cameras = Some(city.join("sparse"));
        for input in [by_images, by_normals] {
            demand_same_in_tiles(&input, &folder.path().join("mesh.ply"));
            // Nothing is left beside the mesh.
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        }
    }

    fn demand_same_in_tiles(input: &Input, out: &Path) {
        let (tiled, _) = in_tiles(input, Options::default(), out).unwrap();
        let whole = at_once(input, Options::default(), false, out).unwrap().mesh;
        assert!(whole.triangles.len() > 1000);
        assert_eq!(tiled.triangles, whole.triangles);
        // Files have single precision.
        let single = |mesh: &TriangleMesh| -> Vec<[f32; 3]> {
            let positions = mesh.positions.iter();
            positions
                .map(|p| p.coords.map(|x| x as f32).into())
                .collect()
        };
        assert_eq!(single(&tiled), single(&whole));
        assert!(tiled.colors == whole.colors);
    }

    #[test]
    fn the_cloud_of_a_workspace_is_found() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(cloud_of(folder.path()), folder.path());
        std::fs::create_dir_all(folder.path().join("dense/0")).unwrap();
        std::fs::write(folder.path().join("dense/0/fused.ply"), "ply").unwrap();
        assert_eq!(
            cloud_of(folder.path()),
            folder.path().join("dense/0/fused.ply")
        );
    }
}
