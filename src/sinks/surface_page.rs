//! The page of one surface over its keyframes.

use std::path::Path;

use linecarve_mesh::TriangleMesh;
use linecarve_mesh::texture::EncodedTexture;

use super::page::{PageRecorder, grouped, growth_plots, page_of, page_surface};
use super::page_run::PageRun;
use super::report::RunLog;
use crate::report::page::{PageStructure, PageTable, PageTexture, write_page};
use linecarve_engine::Reconstruction;

/// Writes the page with the surface over keyframes; `mesh` is the final one, in the frame of computation.
pub(crate) fn write_surface_page(
    path: &Path,
    run: &Reconstruction,
    mut recorder: PageRecorder,
    mesh: &TriangleMesh,
    texture: Option<&EncodedTexture>,
    structure: Option<PageStructure>,
    log: &mut RunLog,
) -> anyhow::Result<()> {
    let map = run.map();
    recorder.finish(run, mesh);
    let is_of_lines = map.segments().is_some();
    let (command, id, name) = if is_of_lines {
        ("reconstruct", "lines", "3D lines")
    } else {
        ("reconstruct --from map-points", "map-points", "map points")
    };
    let run = &PageRun::new(run.recording(), map);
    let reports = log.keyframes().to_vec();
    let mut page = page_of(run, command, mesh);
    page.images = recorder.images(run)?;
    page.structure = structure;
    page.warnings = log.warnings().to_vec();
    page.count_plots = growth_plots(run.numbers, &[("surface", &reports)]);
    let mut surface = page_surface(id, name, recorder, run.numbers, &reports);
    surface.texture = texture.map(|texture| PageTexture::new(mesh, texture));
    page.surfaces = vec![surface];
    let result = log.result();
    let of_what = if is_of_lines {
        format!(
            "{} segments in {} clusters",
            grouped(result.segments),
            grouped(result.clusters)
        )
    } else {
        format!("{} points", grouped(result.points))
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
        .filter(|_| is_of_lines)
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
