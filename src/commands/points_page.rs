//! The page of a surface from points.

use std::path::Path;

use crate::commands::page::{PageRecorder, grouped, growth_plots, page_of, page_surface};
use crate::commands::page_run::PageRun;
use crate::commands::run_report::RunLog;
use crate::mesh::TriangleMesh;
use crate::report::page::{PageTable, write_page};

/// Writes the page with the surface over keyframes.
pub(super) fn write_points_page(
    path: &Path,
    recorder: PageRecorder,
    run: &PageRun<'_>,
    mesh: &TriangleMesh,
    log: &mut RunLog,
) -> anyhow::Result<()> {
    let reports = log.keyframes().to_vec();
    let mut page = page_of(run, "reconstruct --from map-points", mesh);
    page.images = recorder.images(run)?;
    page.warnings = log.warnings().to_vec();
    page.count_plots = growth_plots(&run.numbers, &[("surface", &reports)]);
    page.surfaces = vec![page_surface(
        "map-points",
        "map points",
        recorder,
        &run.numbers,
        &reports,
    )];
    let result = log.result();
    page.subtitle = format!(
        "{} keyframes, {} points, {} triangles",
        reports.len(),
        grouped(result.points),
        grouped(result.triangles)
    );
    let mut columns = ["points", "rays", "tetrahedra", "vertices", "triangles"]
        .map(str::to_owned)
        .to_vec();
    let counts = [
        result.points,
        result.rays,
        result.cells,
        result.vertices,
        result.triangles,
    ];
    let mut row = counts.map(grouped).to_vec();
    if let Some(rms) = result.reprojection_rms_px {
        columns.push("projections off by (RMS)".to_owned());
        row.push(format!("{rms:.2} px"));
    }
    page.tables = vec![PageTable {
        title: "Result".to_owned(),
        columns,
        rows: vec![row],
        note: String::new(),
    }];
    write_page(path, &page)?;
    Ok(())
}
