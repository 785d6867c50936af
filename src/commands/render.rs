//! `linecarve render`: a picture of a mesh and lines over it, of lines, or of points.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use image::RgbImage;
use nalgebra::Point3;

use crate::cli::RenderArgs;
use crate::commands::Outcome;
use crate::commands::render_view::{given_view, outside_view};
use crate::sinks::{check_ending, check_outputs};
use linecarve_mesh::evaluate::NearestPointIndex;
use linecarve_mesh::render::{
    BackFaces, HeatScale, RenderOptions, Renderer, View, with_color_bar, write_png,
};
use linecarve_mesh::{LineSet, Shape, ShapeKind, read_geometry, read_textured};

/// Diameter of the points of a cloud in the picture.
const POINT_WIDTH_PX: f64 = 2.5;

pub(super) fn run(args: &RenderArgs) -> anyhow::Result<Outcome> {
    let output = ("--out", args.out.as_path());
    check_ending(output, "png")?;
    let inputs = [&args.mesh].into_iter().chain(&args.lines);
    let inputs = inputs.chain(&args.errors).chain(&args.calibration);
    let inputs: Vec<&Path> = inputs.map(PathBuf::as_path).collect();
    check_outputs(&[output], &inputs)?;
    let (shape, texture) = read_textured(&args.mesh)?;
    if let Some(file) = texture.as_ref().and_then(|it| it.file.as_deref()) {
        check_outputs(&[output], &[file])?;
    }
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
    let view = match given_view(args)? {
        Some(view) => view,
        None => {
            options.back_faces = BackFaces::Hidden;
            let view = outside_view(&mesh, lines.as_ref(), args);
            view.with_context(|| {
                format!(
                    "{} has no extent: give a view with --eye and --target",
                    args.mesh.display()
                )
            })?
        }
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
    let paint = |points: &[Point3<f64>]| {
        let distances = reference.distances_within(points, end);
        distances.iter().map(|it| scale.color(*it)).collect()
    };
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

/// A cloud with a line from each point to itself, which is drawn as a dot; other shapes as they are.
fn with_dots(mut shape: Shape) -> Shape {
    if shape.kind() == ShapeKind::Cloud {
        shape.lines = (0..shape.positions.len() as u32).map(|i| [i, i]).collect();
    }
    shape
}
