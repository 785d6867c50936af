//! The view of `linecarve render`: of a frame, from a point, or from outside.

use anyhow::{Context, ensure};
use linecarve_mesh::render::{View, up_direction};
use linecarve_mesh::{LineSet, TriangleMesh};
use linecarve_sequence::{OpenOptions, Sequence};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use crate::cli::RenderArgs;
use crate::sinks::keep_sequence;

/// What a frame saw, or the view from a point; `None` when neither is asked for.
pub(super) fn given_view(args: &RenderArgs) -> anyhow::Result<Option<View>> {
    if let Some(folder) = &args.sequence {
        let mut open = OpenOptions::default();
        open.calibration = args.calibration.clone();
        let sequence = Sequence::open(folder, &open)?;
        keep_sequence(("--out", &args.out), &sequence)?;
        return Ok(Some(view_of_frame(&sequence, &args.frame)?));
    }
    match (args.eye, args.target) {
        (Some(eye), Some(target)) => Ok(Some(view_from(eye, target, args)?)),
        _ => Ok(None),
    }
}

/// What a frame, given by name or index, saw.
fn view_of_frame(sequence: &Sequence, wanted: &str) -> anyhow::Result<View> {
    let frames = sequence.frames();
    let index = frames
        .iter()
        .position(|frame| frame.name == wanted)
        .or_else(|| wanted.parse().ok())
        .filter(|index| *index < frames.len())
        .with_context(|| {
            format!(
                "--frame {wanted}: neither a name (such as {}) nor an index below {}",
                frames.first().map_or("", |frame| &frame.name),
                frames.len()
            )
        })?;
    let poses: Vec<Isometry3<f64>> = frames.iter().map(|frame| frame.world_from_camera).collect();
    let size = sequence.color_size();
    Ok(View::from_keyframe(
        sequence.color_camera(),
        size.width,
        size.height,
        poses[index],
        up_direction(&poses),
    ))
}

fn view_from(eye: [f64; 3], target: [f64; 3], args: &RenderArgs) -> anyhow::Result<View> {
    ensure!(eye != target, "--eye and --target are the same point");
    ensure!(
        args.field_of_view > 0.0 && args.field_of_view < 170.0,
        "--field-of-view {}: give an angle between 0 and 170 degrees",
        args.field_of_view
    );
    let view = View::look_at(
        &Point3::from(eye),
        &Point3::from(target),
        &up_of(args),
        args.size,
        args.field_of_view.to_radians(),
    )?;
    Ok(view)
}

/// What the command line says is up, else the report of the run that made the mesh.
fn up_of(args: &RenderArgs) -> Vector3<f64> {
    let reported = || {
        let text = std::fs::read(args.mesh.with_file_name("report.json")).ok()?;
        let report: serde_json::Value = serde_json::from_slice(&text).ok()?;
        let up = report.pointer("/sequence/up")?;
        serde_json::from_value::<[f64; 3]>(up.clone()).ok()
    };
    Vector3::from(args.up.or_else(reported).unwrap_or([0.0, -1.0, 0.0]))
}

/// From outside and above, where "above" is what `--up` says: as seen by cameras that were held so.
pub(super) fn outside_view(
    mesh: &TriangleMesh,
    lines: Option<&LineSet>,
    args: &RenderArgs,
) -> Option<View> {
    let upright = UnitQuaternion::rotation_between(&-Vector3::y(), &up_of(args))
        .unwrap_or_else(|| UnitQuaternion::from_scaled_axis(Vector3::z() * std::f64::consts::PI));
    let pose = Isometry3::from_parts(Vector3::zeros().into(), upright);
    if !mesh.triangles.is_empty() {
        return View::dollhouse(mesh, &[pose], args.size);
    }
    let lines = lines?;
    let ends = lines.lines.iter().flatten();
    let ends = ends.filter_map(|end| lines.points.get(*end as usize).copied());
    let ends: Vec<Point3<f64>> = ends
        .filter(|end| end.iter().all(|value| value.is_finite()))
        .collect();
    View::outside(&ends, &[pose], args.size)
}
