//! The pictures of a comparison.

use image::RgbImage;
use nalgebra::{Point3, Vector3};

use super::grid::panel_grid;
use super::result::ComparedSurface;
use linecarve_mesh::TriangleMesh;
use linecarve_mesh::evaluate::NearestPointIndex;
use linecarve_mesh::render::{
    BackFaces, HeatScale, PictureError, RenderOptions, Renderer, View, with_caption, with_color_bar,
};

/// Paints surfaces by their distance to a ground truth.
pub struct ErrorPaint<'a> {
    /// The ground truth, in the frame of the poses.
    pub ground_truth: &'a NearestPointIndex,
    /// Added to points of the surfaces to bring them into that frame.
    pub origin: Vector3<f64>,
    /// The colours.
    pub scale: HeatScale,
    /// What the colours say.
    pub label: &'a str,
}

impl ErrorPaint<'_> {
    /// Distances of points in the frame of the surfaces, infinite beyond the end of the scale.
    pub fn distances(&self, points: &[Point3<f64>]) -> Vec<f64> {
        let points: Vec<Point3<f64>> = points.iter().map(|point| point + self.origin).collect();
        self.ground_truth
            .distances_within(&points, self.scale.max())
    }

    fn colors(&self, points: &[Point3<f64>]) -> Vec<[u8; 3]> {
        let distances = self.distances(points);
        distances.iter().map(|it| self.scale.color(*it)).collect()
    }
}

/// From where the surfaces are drawn.
pub enum GalleryView {
    /// From outside and above; faces that turn away are left out.
    Outside(View),
    /// From a keyframe, its image first.
    Keyframe {
        /// The view.
        view: View,
        /// What the keyframe saw.
        photo: RgbImage,
    },
}

/// Surfaces that are ready to be drawn from any number of views.
pub struct Gallery<'a> {
    surfaces: Vec<(&'a ComparedSurface, Renderer<'a>)>,
    ground_truth: Option<Renderer<'a>>,
}

impl<'a> Gallery<'a> {
    /// Prepares surfaces, and the mesh that is their ground truth; all in one frame.
    pub fn new(surfaces: &'a [ComparedSurface], ground_truth: Option<&'a TriangleMesh>) -> Self {
        Self {
            surfaces: surfaces
                .iter()
                .map(|surface| (surface, Renderer::new(&surface.mesh)))
                .collect(),
            ground_truth: ground_truth.map(Renderer::new),
        }
    }

    /// The surfaces side by side from one view; with `errors` a second row of them coloured by distance, and a colour
    /// bar. A view from a keyframe has the photo on its left, and below that the ground truth; a view from outside the
    /// ground truth alone.
    ///
    /// # Errors
    /// When the view has no pixel or too many.
    pub fn draw(
        &self,
        view: &GalleryView,
        errors: Option<&ErrorPaint<'_>>,
    ) -> Result<RgbImage, PictureError> {
        let mut options = RenderOptions::default();
        let (camera, photo) = match view {
            GalleryView::Outside(camera) => {
                options.back_faces = BackFaces::Hidden;
                (camera, None)
            }
            GalleryView::Keyframe { view, photo } => (view, Some(photo)),
        };
        let marked = photo.is_some();
        let mut shapes = Vec::new();
        let mut painted = Vec::new();
        for (surface, renderer) in &self.surfaces {
            let marks = marked.then_some(&surface.marks);
            let Some(errors) = errors else {
                let picture = renderer.draw(marks, camera, &options, &|_, _| {})?;
                shapes.push(Some(with_caption(&picture, surface.label)));
                continue;
            };
            let paint = |points: &[Point3<f64>]| errors.colors(points);
            let [shape, error] = renderer.draw_both(&paint, marks, camera, &options)?;
            shapes.push(Some(with_caption(&shape, surface.label)));
            let label = format!("{}, error", surface.label);
            painted.push(Some(with_caption(&error, &label)));
        }
        let truth = match &self.ground_truth {
            Some(renderer) => {
                let picture = renderer.draw(None, camera, &options, &|_, _| {})?;
                Some(with_caption(&picture, "ground truth"))
            }
            None => None,
        };
        let photo = photo.map(|photo| with_caption(photo, "keyframe"));
        let rows = if errors.is_none() {
            vec![photo.into_iter().map(Some).chain(shapes).collect()]
        } else if photo.is_some() {
            shapes.insert(0, photo);
            painted.insert(0, truth);
            vec![shapes, painted]
        } else if truth.is_some() {
            shapes.insert(0, truth);
            painted.insert(0, None);
            vec![shapes, painted]
        } else {
            vec![shapes, painted]
        };
        let grid = panel_grid(&rows);
        Ok(match errors {
            Some(errors) => with_color_bar(&grid, &errors.scale, errors.label),
            None => grid,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_engine::map::CarvedCounts;
    use linecarve_mesh::{LineSet, Shape};

    fn wall(z: f64) -> TriangleMesh {
        TriangleMesh {
            positions: vec![
                Point3::new(-2.0, -2.0, z),
                Point3::new(2.0, -2.0, z),
                Point3::new(2.0, 2.0, z),
                Point3::new(-2.0, 2.0, z),
            ],
            triangles: vec![[0, 2, 1], [0, 3, 2]],
            colors: None,
        }
    }

    #[test]
    fn errors_have_the_colours_of_their_distances() {
        let surface = |label, mesh| ComparedSurface {
            name: "one",
            label,
            elements_name: "points",
            elements: 0,
            carved: CarvedCounts::default(),
            mesh,
            marks: LineSet::default(),
            keyframes: Vec::new(),
        };
        let surfaces = [
            surface("near", wall(2.0)),
            surface("empty", TriangleMesh::default()),
        ];
        let truth = NearestPointIndex::new(&Shape::from(wall(12.05)));
        let errors = ErrorPaint {
            ground_truth: &truth,
            origin: Vector3::new(0.0, 0.0, 10.0),
            scale: HeatScale::new(0.1).unwrap(),
            label: "distance",
        };
        let distances = errors.distances(&[Point3::new(0.5, 0.5, 2.0)]);
        assert!((distances[0] - 0.05).abs() < 1e-9);
        let up = -Vector3::y();
        let eye = Point3::origin();
        let camera = View::look_at(&eye, &Point3::new(0.0, 0.0, 1.0), &up, (64, 48), 0.8).unwrap();
        let view = GalleryView::Keyframe {
            photo: RgbImage::new(64, 48),
            view: camera,
        };
        let picture = Gallery::new(&surfaces, None)
            .draw(&view, Some(&errors))
            .unwrap();
        assert_eq!(picture.width(), 3 * 64 + 16);
        // Half of the scale is green: the middle panel of the second row.
        let [red, green, blue] = picture.get_pixel(64 + 8 + 32, 82 + 8 + 34 + 24).0;
        assert!(green > red && green >= blue, "{red} {green} {blue}");
    }
}
