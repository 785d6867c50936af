//! Colours of the texels.

use image::{Rgb, RgbImage};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::chart::{Layout, texels_inside};
use super::depth_buffer::{DepthBuffer, Projected};
use super::distortion::DistortionGrid;
use super::observe::Observation;
use super::photo::{LoadPhoto, Photo, for_each_group};
use super::types::TextureView;
use crate::TriangleMesh;

/// Texels this far outside of a triangle belong to its chart, for the interpolation along the border.
const MARGIN: f64 = 1.0;
/// Views count less towards the border of their image, over this many pixels.
const FEATHER_PX: f64 = 24.0;
/// Colours with a brighter channel than this, 0 to 255, are clipped.
const CLIPPED: f32 = 254.0;
/// Colours count less towards that, over this many steps.
const CLIPPED_RANGE: f32 = 10.0;
/// How much clipped colours count.
const CLIPPED_SHARE: f32 = 0.05;

/// What the colours of a mesh are made from.
pub(super) struct Sources<'a> {
    pub(super) mesh: &'a TriangleMesh,
    pub(super) views: &'a [TextureView],
    pub(super) distortions: &'a [Option<DistortionGrid>],
    pub(super) load: &'a LoadPhoto<'a>,
    pub(super) of_triangle: &'a [Vec<Observation>],
    pub(super) labels: &'a [Option<usize>],
    pub(super) gains: &'a [[f32; 3]],
    /// Brightness of the texture over the mean of the views.
    pub(super) brightness: f32,
    pub(super) clay: [u8; 3],
}

/// The texels of each triangle.
struct Texels {
    /// Index in the atlas, row by row, triangle by triangle.
    places: Vec<u32>,
    /// First texel of each triangle, and the end of the last.
    starts: Vec<usize>,
}

/// Colours seen at a texel.
#[derive(Clone, Copy, Default)]
struct Sum {
    /// Sum of weighted colours, and of weights.
    colors: [f32; 3],
    weight: f32,
}

/// The atlas with the colours of all triangles, and which of its texels have one.
pub(super) fn fill(sources: &Sources<'_>, layout: &Layout) -> (RgbImage, Vec<bool>) {
    let texels = Texels::new(layout);
    let mut sums = vec![Sum::default(); texels.places.len()];
    let Sources { mesh, views, .. } = sources;
    for_each_group(mesh, views, sources.distortions, sources.load, |photos| {
        let mut rest = sums.as_mut_slice();
        let mut parts = Vec::with_capacity(sources.labels.len());
        for triangle in 0..sources.labels.len() {
            let (part, after) = rest.split_at_mut(texels.of(triangle).len());
            parts.push(part);
            rest = after;
        }
        parts
            .into_par_iter()
            .enumerate()
            .for_each(|(triangle, sums)| {
                let places = &texels.places[texels.of(triangle)];
                for (view, photo) in photos {
                    sources.add(triangle, layout, *view, photo, places, sums);
                }
            });
    });
    let [width, height] = layout.size;
    let mut image = RgbImage::new(width, height);
    let mut is_filled = vec![false; width as usize * height as usize];
    for triangle in 0..sources.labels.len() {
        let range = texels.of(triangle);
        let area = Flat::new(&layout.corners[triangle]);
        for (&place, sum) in texels.places[range.clone()].iter().zip(&sums[range]) {
            let at = [place % width, place / width];
            let barycentric = area.barycentric(at);
            if let Some(color) = sources.color(triangle, &barycentric, sum) {
                image.put_pixel(at[0], at[1], Rgb(color));
                is_filled[place as usize] = true;
            }
        }
    }
    (image, is_filled)
}

impl Texels {
    /// First the texels inside triangles, then those around them that are left.
    fn new(layout: &Layout) -> Self {
        let [width, height] = layout.size;
        let mut owners = vec![u32::MAX; width as usize * height as usize];
        for margin in [0.0, MARGIN] {
            for (triangle, corners) in layout.corners.iter().enumerate() {
                for (x, y) in texels_inside(&grid(corners), margin, layout.size) {
                    let owner = &mut owners[y as usize * width as usize + x as usize];
                    if *owner == u32::MAX {
                        *owner = triangle as u32;
                    }
                }
            }
        }
        let mut starts = vec![0_usize; layout.corners.len() + 1];
        for owner in owners.iter().filter(|owner| **owner != u32::MAX) {
            starts[*owner as usize + 1] += 1;
        }
        for at in 1..starts.len() {
            starts[at] += starts[at - 1];
        }
        let mut next = starts.clone();
        let mut places = vec![0; starts[layout.corners.len()]];
        for (at, owner) in (0..).zip(&owners) {
            if *owner != u32::MAX {
                let next = &mut next[*owner as usize];
                places[*next] = at;
                *next += 1;
            }
        }
        Self { places, starts }
    }

    fn of(&self, triangle: usize) -> std::ops::Range<usize> {
        self.starts[triangle]..self.starts[triangle + 1]
    }
}

/// Corners in the grid of texel centres.
fn grid(corners: &[[f32; 2]; 3]) -> [[f64; 2]; 3] {
    corners.map(|corner| corner.map(|value| f64::from(value) - 0.5))
}

/// A triangle in the atlas.
struct Flat {
    first: [f64; 2],
    /// Rows of the matrix from the offset to the barycentric coordinates of the second and third corner.
    rows: [[f64; 2]; 2],
}

impl Flat {
    fn new(corners: &[[f32; 2]; 3]) -> Self {
        let [a, b, c] = grid(corners);
        let (u, v) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        let doubled = u[0] * v[1] - u[1] * v[0];
        // Thinner than a hundredth of a texel: one colour.
        let inverse = if doubled.abs() > 1e-2 {
            1.0 / doubled
        } else {
            0.0
        };
        Self {
            first: a,
            rows: [
                [v[1] * inverse, -v[0] * inverse],
                [-u[1] * inverse, u[0] * inverse],
            ],
        }
    }

    /// Barycentric coordinates of a texel's centre; outside of the triangle, at most a little beyond its corners.
    fn barycentric(&self, [x, y]: [u32; 2]) -> [f64; 3] {
        let (x, y) = (f64::from(x) - self.first[0], f64::from(y) - self.first[1]);
        let [v, w] = self.rows.map(|[a, b]| (a * x + b * y).clamp(-2.0, 3.0));
        [1.0 - v - w, v, w]
    }
}

impl Sources<'_> {
    /// Adds what a view shows at the texels of a triangle.
    fn add(
        &self,
        triangle: usize,
        layout: &Layout,
        view: usize,
        photo: &Photo,
        places: &[u32],
        sums: &mut [Sum],
    ) {
        let observations = &self.of_triangle[triangle];
        let Ok(at) = observations.binary_search_by_key(&(view as u32), |o| o.view) else {
            return;
        };
        let (gain, quality) = (self.gains[view], observations[at].quality.sqrt());
        let [a, b, c] = self.mesh.triangles[triangle].map(|c| self.mesh.positions[c as usize]);
        let (along, across): (Vector3<f64>, Vector3<f64>) = (b - a, c - a);
        let flat = Flat::new(&layout.corners[triangle]);
        let width = layout.size[0];
        let whole = [a, b, c].map(|point| photo.projection.project(&point));
        let slope = match whole {
            [Some(a), Some(b), Some(c)] => DepthBuffer::slope(&[a, b, c]),
            _ => None,
        };
        for (place, sum) in places.iter().zip(sums) {
            let [_, v, w] = flat.barycentric([place % width, place / width]);
            let point = a + along * v + across * w;
            let Some(pixel) = photo.projection.project(&point) else {
                continue;
            };
            let slope = slope.or_else(|| slope_around(&point, &along, &across, photo));
            let Some(slope) = slope else {
                continue;
            };
            let visibility = photo.depth.visibility(&pixel, slope);
            if visibility <= 0.0 {
                continue;
            }
            let color = photo.color(pixel.x, pixel.y);
            let weight = quality * visibility * feather(&pixel, photo.size()) * exposed(&color);
            let weight = weight.max(f32::MIN_POSITIVE);
            let color: [f32; 3] = std::array::from_fn(|i| gain[i] * color[i]);
            for (sum, value) in sum.colors.iter_mut().zip(color) {
                *sum += weight * value;
            }
            sum.weight += weight;
        }
    }

    /// The colour of a texel; `None` where nothing is known of it.
    fn color(&self, triangle: usize, barycentric: &[f64; 3], sum: &Sum) -> Option<[u8; 3]> {
        if sum.weight > 0.0 {
            return Some(rounded(sum.colors.map(|value| value / sum.weight)));
        }
        let Some(colors) = &self.mesh.colors else {
            return self.labels[triangle].is_none().then_some(self.clay);
        };
        let corners = self.mesh.triangles[triangle].map(|corner| colors[corner as usize]);
        // Beyond the corners their colours go on.
        let shares = barycentric.map(|share| share.clamp(0.0, 1.0));
        let total: f64 = shares.iter().sum();
        Some(std::array::from_fn(|channel| {
            let parts = corners.iter().zip(shares);
            let mixed: f64 = parts
                .map(|(color, share)| f64::from(color[channel]) * share)
                .sum();
            (f64::from(self.brightness) * mixed / total).round() as u8
        }))
    }
}

/// Slope of a triangle with the given sides around one of its points.
fn slope_around(
    point: &Point3<f64>,
    along: &Vector3<f64>,
    across: &Vector3<f64>,
    photo: &Photo,
) -> Option<super::depth_buffer::Slope> {
    let project = |point: Point3<f64>| photo.projection.project(&point);
    let corners: [Projected; 3] = [
        project(*point)?,
        project(point + along * 1e-3)?,
        project(point + across * 1e-3)?,
    ];
    DepthBuffer::slope(&corners)
}

/// Weight, 0 to 1, of a pixel by its distance to the border of the image.
fn feather(pixel: &Projected, (width, height): (u32, u32)) -> f32 {
    let across = pixel.x.min(f64::from(width - 1) - pixel.x);
    let down = pixel.y.min(f64::from(height - 1) - pixel.y);
    ((across.min(down) + 1.0) / FEATHER_PX).clamp(0.02, 1.0) as f32
}

/// Weight, 0 to 1, of a colour of a photograph: clipped ones are those of brighter surfaces.
fn exposed(color: &[f32; 3]) -> f32 {
    let brightest = color.iter().copied().fold(0.0, f32::max);
    ((CLIPPED - brightest) / CLIPPED_RANGE).clamp(CLIPPED_SHARE, 1.0)
}

fn rounded(color: [f32; 3]) -> [u8; 3] {
    color.map(|value| value.round().clamp(0.0, 255.0) as u8)
}
