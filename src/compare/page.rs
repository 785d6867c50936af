//! The page of a comparison.

use std::path::Path;

use linecarve_mesh::TriangleMesh;
use linecarve_mesh::render::HeatScale;

use super::ground_truth::{ERROR_LABEL, GroundTruth};
use super::result::SurfaceSummary;
use super::run::ComparedRun;
use super::table::score_table;
use crate::report::page::{ErrorScale, KeyframeImage, PageTable, triangle_errors, write_page};
use crate::sinks::{PageRun, growth_plots, page_of, page_surface};

/// The page with both surfaces.
///
/// # Errors
/// When an image cannot be encoded or the page not written.
pub(crate) fn write_compare_page(
    path: &Path,
    run: &PageRun<'_>,
    runs: [ComparedRun; 2],
    truth: Option<&GroundTruth>,
    summaries: &[SurfaceSummary],
    warnings: &[String],
) -> anyhow::Result<()> {
    let empty = TriangleMesh::default();
    let mesh = runs
        .iter()
        .map(|run| &run.surface.mesh)
        .max_by_key(|mesh| mesh.triangles.len())
        .unwrap_or(&empty);
    let mut page = page_of(run, "compare", mesh);
    page.images = runs[0].recorder.images(run)?;
    keep_images_small(&mut page.images);
    page.subtitle = format!(
        "surfaces from {} and from {}, {} keyframes",
        runs[0].surface.label,
        runs[1].surface.label,
        run.numbers.len()
    );
    page.warnings = warnings.to_vec();
    let labels = runs.each_ref().map(|run| run.surface.label);
    let table = score_table(summaries, &labels);
    page.tables = vec![PageTable {
        title: "Surfaces".to_owned(),
        columns: table.columns,
        rows: table.rows,
        note: match truth {
            Some(truth) => format!(
                "Accuracy: distance of points on the surface to {}; completeness: the other way round; F: harmonic mean of \
                 the shares of points nearer than the threshold. Lengths in units of the poses, points uniform by area, \
                 inside the box of the ground truth.",
                truth.summary.file
            ),
            None => "Without a ground truth (--ground-truth) there are counts and times alone."
                .to_owned(),
        },
    }];
    let plots: Vec<(&str, &[_])> = runs
        .iter()
        .map(|run| (run.surface.label, run.surface.keyframes.as_slice()))
        .collect();
    page.count_plots = growth_plots(run.numbers, &plots);
    page.error_scale = truth.map(|truth| ErrorScale {
        label: ERROR_LABEL.to_owned(),
        colors: HeatScale::colors(),
        ticks: truth.scale.ticks(),
    });
    for compared in runs {
        let ComparedRun {
            surface, recorder, ..
        } = compared;
        let errors = truth.map(|truth| {
            let paint = truth.paint(&run.origin);
            triangle_errors(&recorder.history, truth.scale.max(), |points| {
                paint.distances(points)
            })
        });
        let mut on_page = page_surface(
            surface.name,
            surface.label,
            recorder,
            run.numbers,
            &surface.keyframes,
        );
        on_page.errors = errors;
        page.surfaces.push(on_page);
    }
    write_page(path, &page)?;
    Ok(())
}

/// Images of very many keyframes would make most of the page.
fn keep_images_small(images: &mut Vec<KeyframeImage>) {
    const MOST: usize = 300;
    while images.len() > MOST {
        let mut place = 0;
        images.retain(|_| {
            place += 1;
            place % 2 == 1
        });
    }
}
