//! Points with views carved in one process: the mesh alone, in as little memory as possible.

use std::path::Path;

use linecarve_carving::{Carver, Hull, ViewId};
use linecarve_lines::upper_median;
use linecarve_mesh::TriangleMesh;
use linecarve_sequence::{DenseCloud, ModelPoint, ModelView, SparseModel};
use nalgebra::{Point3, Vector3};

use super::ProjectError;
use super::selection::Selection;
use crate::map::cloud::{CloudSurface, JoinedPoint, SeenPoint, ViewStatistics, join, top_level};
use crate::map::{
    MapError, ModelCounts, PointSelector, carved_mesh, carver_options, close_all_holes,
    export_options,
};
use crate::options::{HoleFilling, Options};
use crate::recording::{Input, PointExtent, Recording};

/// Points of one transaction.
const POINTS_AT_ONCE: usize = 1 << 14;

/// The mesh of points.
#[derive(Debug, Clone)]
pub struct PointMesh {
    /// In the frame of the poses. With colours where the points have some.
    pub mesh: TriangleMesh,
    /// Numbers of carved and rejected points.
    pub counts: ModelCounts,
    /// Number of points that were carved, after points of a dense cloud were joined.
    pub carved: usize,
}

/// Carves the points of a model or of a dense cloud once. `None` when the input has no points with views.
///
/// The mesh is that of a [`Reconstruction`](crate::Reconstruction) of the same points. With `is_closed` it is watertight: nothing is left
/// out because it was not seen, and the surface goes on along the hull of the points.
///
/// A dense cloud of COLMAP, or with normals and cameras, is read point by point, with temporary files in `folder`.
///
/// # Errors
/// When the input cannot be read, a parameter is out of range, or a temporary file cannot be written.
pub fn mesh_points(
    input: &Input,
    options: Options,
    is_closed: bool,
    folder: &Path,
) -> Result<Option<PointMesh>, ProjectError> {
    if let Some(cloud) = input.dense_cloud()? {
        return of_cloud(&cloud, &options, is_closed, folder).map(Some);
    }
    let mut recording = Recording::open(input, options)?;
    let Some(model) = recording.take_model() else {
        return Ok(None);
    };
    let model = std::sync::Arc::unwrap_or_clone(model);
    let (options, origin) = (recording.options.clone(), recording.origin);
    drop(recording);
    of_model(model, &options, origin, is_closed).map(Some)
}

fn of_cloud(
    cloud: &DenseCloud,
    options: &Options,
    is_closed: bool,
    folder: &Path,
) -> Result<PointMesh, ProjectError> {
    let selection = Selection::of(cloud, options, folder)?;
    let file_error = |fault| ProjectError::file(folder)(fault);
    let mut points = Points::new(options, selection.centers)?;
    let top = selection.top;
    selection.spill.visit(folder, |part| {
        let joined = join(part, top, points.surface.centers());
        Ok(points.add(&joined)?)
    })?;
    let median_depth = selection.depths.upper_median().map_err(file_error)?;
    let mesh = points.carve(options, median_depth, is_closed);
    Ok(mesh.finished(options, &selection.origin, selection.counts))
}

fn of_model(
    model: SparseModel,
    options: &Options,
    origin: Vector3<f64>,
    is_closed: bool,
) -> Result<PointMesh, ProjectError> {
    let SparseModel { views, points } = model;
    if let Some((point, view)) = unknown_view(&points, views.len()) {
        let views = views.len();
        return Err(MapError::UnknownView { point, view, views }.into());
    }
    let center = |view: &ModelView| Point3::from(view.world_from_camera.translation.vector);
    let centers: Vec<Point3<f64>> = views.iter().map(center).collect();
    let mut selector = PointSelector::new(views, options, ViewStatistics::of(&points));
    // Pixels are those of features, which are matched one by one.
    let is_dense = (points.iter().flat_map(|point| &point.observations))
        .all(|observation| observation.pixel.is_none());
    let mut extent = PointExtent::default();
    let mut depths = Vec::new();
    let mut selected: Vec<SeenPoint> = Vec::new();
    for point in points {
        extent.add(&point.point_in_world);
        if let Some((point, depths_of_point)) = selector.select(&point) {
            depths.extend_from_slice(depths_of_point);
            selected.push(point);
        }
    }
    let joined = match is_dense {
        true => join(selected, top_level(extent.longest()), &centers),
        false => selected.into_iter().map(JoinedPoint::alone).collect(),
    };
    let mut points = Points::new(options, centers)?;
    points.add(&joined)?;
    drop(joined);
    let median_depth = upper_median(&mut depths, f64::total_cmp);
    drop(depths);
    let mesh = points.carve(options, median_depth, is_closed);
    Ok(mesh.finished(options, &origin, selector.counts()))
}

/// An observation of a view that there is not: index of its point, and the view.
fn unknown_view(points: &[ModelPoint], views: usize) -> Option<(usize, u32)> {
    let observations = (points.iter().enumerate())
        .flat_map(|(index, point)| point.observations.iter().map(move |it| (index, it.view)));
    let mut unknown = observations.filter(|(_, view)| *view as usize >= views);
    unknown.next()
}

/// Points in a carver that has not carved, and what the surface needs of them.
struct Points {
    carver: Carver,
    surface: CloudSurface,
    views: Vec<ViewId>,
    is_dense: bool,
}

impl Points {
    fn new(options: &Options, centers: Vec<Point3<f64>>) -> Result<Self, MapError> {
        let mut carver = Carver::deferred(carver_options(options));
        let rejected = |source| MapError::Observations { source };
        let mut transaction = carver.transaction();
        let ids = centers.iter().map(|center| transaction.add_view(*center));
        let views = ids.collect::<Result<Vec<ViewId>, _>>().map_err(rejected)?;
        transaction.commit().map_err(rejected)?;
        Ok(Self {
            carver,
            surface: CloudSurface::of([].iter(), centers),
            views,
            is_dense: false,
        })
    }

    fn add(&mut self, points: &[JoinedPoint]) -> Result<(), MapError> {
        let rejected = |source| MapError::Observations { source };
        for block in points.chunks(POINTS_AT_ONCE) {
            let mut transaction = self.carver.transaction();
            for point in block {
                self.is_dense |= point.is_dense;
                self.surface.add_point(point);
                let id = transaction.add_point(point.position).map_err(rejected)?;
                transaction.set_sigma(id, point.sigma).map_err(rejected)?;
                for [view, weight] in &point.rays {
                    let view = self.views[*view as usize];
                    (transaction.add_observation(view, id, *weight)).map_err(rejected)?;
                }
            }
            transaction.commit().map_err(rejected)?;
        }
        Ok(())
    }

    fn carve(mut self, options: &Options, median_depth: Option<f64>, is_closed: bool) -> Carved {
        let mut export = export_options(options, median_depth);
        if is_closed {
            self.carver.carve_closed();
            export.longest_edge = None;
            export.manifold = true;
        } else {
            if self.is_dense {
                // Which triangles on the hull are surface, points and views say.
                self.carver.set_hull(Hull::Keep);
            }
            self.carver.carve_and_forget();
        }
        let carved = self.carver.point_count();
        let mesh = match self.is_dense {
            true => self.surface.mesh_of(&self.carver, &export, is_closed),
            false => carved_mesh(&self.carver, &export),
        };
        Carved { mesh, carved }
    }
}

/// A mesh in the frame of computation, and the number of points that were carved.
struct Carved {
    mesh: TriangleMesh,
    carved: usize,
}

impl Carved {
    fn finished(self, options: &Options, origin: &Vector3<f64>, counts: ModelCounts) -> PointMesh {
        let mut mesh = self.mesh;
        if options.surface.holes == HoleFilling::All {
            close_all_holes(&mut mesh);
        }
        mesh.translate(origin);
        PointMesh {
            mesh,
            counts,
            carved: self.carved,
        }
    }
}

#[cfg(test)]
mod tests;
