//! The page of one surface: over keyframes of lines, over map points, over a model.

use std::path::Path;

use crate::commands::page::{PageRecorder, grouped, growth_plots, page_of, page_surface};
use crate::commands::page_run::PageRun;
use crate::commands::run_report::RunLog;
use crate::report::page::{PageTable, write_page};
use linecarve_mesh::TriangleMesh;

/// What a surface was carved from.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum MadeFrom {
    Lines,
    Points,
}

/// Writes the page with the surface over keyframes.
pub(super) fn write_surface_page(
    path: &Path,
    made_from: MadeFrom,
    recorder: PageRecorder,
    run: &PageRun<'_>,
    mesh: &TriangleMesh,
    log: &mut RunLog,
) -> anyhow::Result<()> {
    let (command, id, name) = match made_from {
        MadeFrom::Lines => ("reconstruct", "lines", "3D lines"),
        MadeFrom::Points => ("reconstruct --from map-points", "map-points", "map points"),
    };
    let reports = log.keyframes().to_vec();
    let mut page = page_of(run, command, mesh);
    page.images = recorder.images(run)?;
    page.warnings = log.warnings().to_vec();
    page.count_plots = growth_plots(&run.numbers, &[("surface", &reports)]);
    page.surfaces = vec![page_surface(id, name, recorder, &run.numbers, &reports)];
    let result = log.result();
    let of_what = match made_from {
        MadeFrom::Lines => format!(
            "{} segments in {} clusters",
            grouped(result.segments),
            grouped(result.clusters)
        ),
        MadeFrom::Points => format!("{} points", grouped(result.points)),
    };
    page.subtitle = format!(
        "{} keyframes, {of_what}, {} triangles",
        reports.len(),
        grouped(result.triangles)
    );
    let of_lines = [("segments", result.segments), ("clusters", result.clusters)];
    let of_all = [
        ("points", result.points),
        ("rays", result.rays),
        ("tetrahedra", result.cells),
        ("vertices", result.vertices),
        ("triangles", result.triangles),
    ];
    let mut columns: Vec<(&str, String)> = of_lines
        .into_iter()
        .filter(|_| made_from == MadeFrom::Lines)
        .chain(of_all)
        .map(|(column, count)| (column, grouped(count)))
        .collect();
    if let Some(rms) = result.reprojection_rms_px {
        columns.push(("projections off by (RMS)", format!("{rms:.2} px")));
    }
    let (columns, row): (Vec<&str>, Vec<String>) = columns.into_iter().unzip();
    page.tables = vec![PageTable {
        title: "Result".to_owned(),
        columns: columns.into_iter().map(str::to_owned).collect(),
        rows: vec![row],
        note: String::new(),
    }];
    write_page(path, &page)?;
    Ok(())
}
