//! `linecarve render`: a picture of a mesh and lines over it, of lines, or of points.

use std::path::Path;

use anyhow::{Context, ensure};
use image::RgbImage;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use crate::cli::RenderArgs;
use crate::commands::Outcome;
use crate::compare::distance_within;
use linecarve_mesh::evaluate::NearestPointIndex;
use linecarve_mesh::render::{
    BackFaces, HeatScale, RenderOptions, Renderer, View, up_direction, with_color_bar, write_png,
};
use linecarve_mesh::{LineSet, Shape, ShapeKind, TriangleMesh, read_geometry, read_textured};
use linecarve_sequence::{OpenOptions, Sequence};

/// Diameter of the points of a cloud in the picture.
const POINT_WIDTH_PX: f64 = 2.5;

pub(super) fn run(args: &RenderArgs) -> anyhow::Result<Outcome> {
    let (shape, texture) = read_textured(&args.mesh)?;
    let over = args.lines.as_deref().map(read_geometry).transpose()?;
    let kinds = [Some(&shape), over.as_ref()].map(|it| it.map(Shape::kind));
    if kinds[0] == Some(ShapeKind::Empty) {
        return Ok(Outcome::Negative(format!(
            "{} holds nothing to draw",
            args.mesh.display()
        )));
    }
    ensure!(
        args.errors.is_none() || kinds[0] == Some(ShapeKind::Mesh),
        "--errors colours triangles, and {} has none",
        args.mesh.display()
    );
    let mut options = RenderOptions::default();
    if kinds.contains(&Some(ShapeKind::Cloud)) {
        options.line_width_px = POINT_WIDTH_PX;
    }
    // Without triangles, the lines or points of the file itself are drawn like those of --lines.
    let mut marks = match kinds[0] {
        Some(ShapeKind::Mesh) => Shape::default(),
        _ => with_dots(shape.clone()),
    };
    marks.append(over.map_or_else(Shape::default, with_dots));
    let mesh = shape.into_mesh();
    let lines = (!marks.lines.is_empty()).then(|| marks.into_lines());
    let view = if let Some(folder) = &args.sequence {
        let open = OpenOptions {
            calibration: args.calibration.clone(),
            ..OpenOptions::default()
        };
        view_of_frame(&Sequence::open(folder, &open)?, &args.frame)?
    } else if let (Some(eye), Some(target)) = (args.eye, args.target) {
        view_from(eye, target, args)?
    } else {
        options.back_faces = BackFaces::Hidden;
        let view = outside_view(&mesh, lines.as_ref(), args);
        view.with_context(|| {
            format!(
                "{} has no extent: give a view with --eye and --target",
                args.mesh.display()
            )
        })?
    };
    let mut renderer = Renderer::new(&mesh);
    if let Some(texture) = &texture {
        renderer = renderer.with_texture(texture)?;
        if args.errors.is_none() {
            options = options.unlit();
        }
    }
    let picture = match &args.errors {
        Some(path) => draw_errors(
            &renderer,
            path,
            args.errors_end,
            lines.as_ref(),
            &view,
            &options,
        )?,
        None => renderer.draw(lines.as_ref(), &view, &options, &|_, _| {})?,
    };
    write_png(&args.out, &picture)?;
    Ok(Outcome::Done)
}

/// The mesh in the colours of its distances to a ground truth, a colour bar below.
fn draw_errors(
    renderer: &Renderer<'_>,
    path: &Path,
    end: Option<f64>,
    lines: Option<&LineSet>,
    view: &View,
    options: &RenderOptions,
) -> anyhow::Result<RgbImage> {
    let truth = read_geometry(path)?;
    let reference = NearestPointIndex::new(&truth);
    ensure!(
        !truth.positions.is_empty(),
        "{}: holds nothing to measure distances to",
        path.display()
    );
    let end = end.unwrap_or_else(|| share_of(truth.diagonal()));
    let scale = HeatScale::new(end)
        .with_context(|| format!("--errors-end {end}: give a positive length"))?;
    let paint = |point: &Point3<f64>| scale.color(distance_within(&reference, point, end));
    let picture = renderer.draw_colored(&paint, lines, view, options, &|_, _| {})?;
    Ok(with_color_bar(&picture, &scale, "distance to ground truth"))
}

/// About a hundredth of a length, with one digit that is 1, 2 or 5: a scale that people can read.
fn share_of(length: f64) -> f64 {
    let wanted = 0.01 * length;
    let power = 10.0_f64.powf(wanted.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .map(|digit| digit * power)
        .into_iter()
        .find(|step| *step >= wanted)
        .unwrap_or(wanted)
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
        &Vector3::from(args.up),
        args.size,
        args.field_of_view.to_radians(),
    )?;
    Ok(view)
}

/// From outside and above, where "above" is what `--up` says: as seen by cameras that were held so.
fn outside_view(mesh: &TriangleMesh, lines: Option<&LineSet>, args: &RenderArgs) -> Option<View> {
    let upright = UnitQuaternion::rotation_between(&-Vector3::y(), &Vector3::from(args.up))
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

/// A cloud with a line from each point to itself, which is drawn as a dot; other shapes as they are.
fn with_dots(mut shape: Shape) -> Shape {
    if shape.kind() == ShapeKind::Cloud {
        shape.lines = (0..shape.positions.len() as u32).map(|i| [i, i]).collect();
    }
    shape
}
