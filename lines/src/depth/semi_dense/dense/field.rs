//! A plane at every grid pixel of a reduced image, improved by propagation between neighbours and by variation.

use rayon::prelude::*;

use super::plane::{Noise, PixelPlane, PlaneBounds};
use super::score::{Matcher, Patch, Sources, UNSEEN};
use crate::triangulation::{SurfaceSample, SurfaceSamples};

/// Distances of the pixels whose planes are tried, in grid steps. They are odd: the pixels have the other colour of the chequerboard.
const REACH: [usize; 3] = [1, 3, 7];
/// Planes closer than this share of the inverse depth, and as many grid steps away, are the same.
const SAME_SHARE: f32 = 2e-4;

/// A pixel grid: every second sample of a reduced image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Distance of grid pixels.
    pub(super) spacing: f32,
    /// Position of the first grid pixel.
    pub(super) offset: f32,
}

impl Grid {
    pub(super) fn of(matcher: &Matcher) -> Self {
        let level = &matcher.level;
        Self {
            columns: level.width / 2,
            rows: level.height / 2,
            spacing: 2.0 * level.factor as f32,
            offset: level.to_pixel(1),
        }
    }

    /// Number of grid pixels.
    pub(super) fn len(&self) -> usize {
        self.columns * self.rows
    }

    #[inline]
    pub(super) fn pixel(&self, column: usize, row: usize) -> [f32; 2] {
        [column, row].map(|index| self.offset + self.spacing * index as f32)
    }

    fn pixel_of(&self, index: usize) -> [f32; 2] {
        self.pixel(index % self.columns, index / self.columns)
    }

    /// From a pixel of this grid to one of another.
    pub(super) fn away(&self, from: usize, other: &Self, to: usize) -> [f32; 2] {
        let (from, to) = (self.pixel_of(from), other.pixel_of(to));
        [to[0] - from[0], to[1] - from[1]]
    }

    /// Samples at the grid pixels, row by row, as a surface.
    pub(super) fn into_surface(self, mut samples: Vec<SurfaceSample>) -> SurfaceSamples {
        let step = self.spacing as u32;
        // From the centre of a sample of the reduced image to the pixel of the surface's grid.
        let shift = (step / 2) as f32 - self.offset;
        for sample in &mut samples {
            let rho = sample.rho + shift * (sample.slope[0] + sample.slope[1]);
            sample.rho = if sample.rho > 0.0 { rho.max(0.0) } else { 0.0 };
        }
        SurfaceSamples::new(step, self.columns, self.rows, samples)
    }
}

/// The planes of all grid pixels with their scores, row by row.
pub(super) struct Field {
    pub(super) grid: Grid,
    pub(super) planes: Vec<PixelPlane>,
    pub(super) scores: Vec<f32>,
    /// The neighbours that each pixel is compared with.
    pub(super) sources: Vec<Sources>,
}

/// How far planes are varied in a round.
#[derive(Debug, Clone, Copy)]
pub(super) struct Variation {
    /// Share of the inverse depth.
    pub(super) depth: f32,
    /// Change of slope, as a tangent.
    pub(super) tilt: f32,
}

/// The search at one pixel: the best plane so far.
struct Search<'a> {
    matcher: &'a Matcher,
    bounds: &'a PlaneBounds,
    patch: Patch,
    pixel: [f32; 2],
    sources: Sources,
    plane: PixelPlane,
    score: f32,
}

impl Search<'_> {
    fn try_plane(&mut self, plane: PixelPlane) {
        if !self.bounds.contains(self.pixel, &plane) {
            return;
        }
        let score = self
            .matcher
            .score(&self.patch, self.pixel, &plane, self.sources);
        if score > self.score {
            (self.plane, self.score) = (plane, score);
        }
    }

    /// Whether a plane is the same as the best one, or nearly so, over a grid step.
    fn is_same(&self, plane: &PixelPlane, spacing: f32) -> bool {
        let bound = SAME_SHARE * self.plane.rho;
        let turn = |axis: usize| (plane.slope[axis] - self.plane.slope[axis]).abs() * spacing;
        (plane.rho - self.plane.rho).abs() < bound && turn(0) < bound && turn(1) < bound
    }
}

impl Field {
    /// The best of the candidate planes of each pixel.
    pub(super) fn new(
        matcher: &Matcher,
        bounds: &PlaneBounds,
        sources: Vec<Sources>,
        candidates: impl Fn(usize, &mut Vec<PixelPlane>) + Sync,
    ) -> Self {
        let grid = Grid::of(matcher);
        let mut field = Self {
            grid,
            planes: vec![PixelPlane::default(); grid.len()],
            scores: vec![UNSEEN; grid.len()],
            sources,
        };
        field.search(matcher, bounds, None, |search, index, list: &mut Vec<_>| {
            list.clear();
            candidates(index, list);
            for plane in list.drain(..) {
                search.try_plane(plane);
            }
        });
        field
    }

    /// One round over both colours of the chequerboard. The result does not depend on the number of threads.
    pub(super) fn improve(
        &mut self,
        matcher: &Matcher,
        bounds: &PlaneBounds,
        round: usize,
        variations: &[Variation],
    ) {
        let grid = self.grid;
        for color in 0..2 {
            let before = (self.planes.clone(), self.scores.clone());
            self.search(matcher, bounds, Some(color), |search, index, _| {
                let (column, row) = (index % grid.columns, index / grid.columns);
                for plane in neighbours(&grid, &before, column, row)
                    .into_iter()
                    .flatten()
                {
                    if !search.is_same(&plane, grid.spacing) {
                        search.try_plane(plane);
                    }
                }
                let mut noise = Noise::new(index, round);
                for variation in variations {
                    if search.plane.rho > 0.0 {
                        let (depth, tilt) = (variation.depth, variation.tilt);
                        search.try_plane(bounds.varied(&search.plane, depth, tilt, &mut noise));
                    }
                }
            });
        }
    }

    /// Calls `visit` for every pixel, or those of one colour, with its index and scratch memory, and takes the best planes.
    fn search(
        &mut self,
        matcher: &Matcher,
        bounds: &PlaneBounds,
        color: Option<usize>,
        visit: impl Fn(&mut Search<'_>, usize, &mut Vec<PixelPlane>) + Sync,
    ) {
        let (grid, sources) = (self.grid, &self.sources);
        let columns = grid.columns.max(1);
        self.planes
            .par_chunks_mut(columns)
            .zip(self.scores.par_chunks_mut(columns))
            .enumerate()
            .for_each_init(Vec::new, |scratch, (row, (planes, scores))| {
                for (column, (plane, score)) in planes.iter_mut().zip(scores).enumerate() {
                    if color.is_some_and(|color| (column + row) % 2 != color) {
                        continue;
                    }
                    let index = row * columns + column;
                    let mut search = Search {
                        matcher,
                        bounds,
                        patch: matcher.patch(2 * column + 1, 2 * row + 1),
                        pixel: grid.pixel(column, row),
                        sources: sources[index],
                        plane: *plane,
                        score: *score,
                    };
                    visit(&mut search, index, scratch);
                    (*plane, *score) = (search.plane, search.score);
                }
            });
    }

    /// The pixel of this field next to one of a grid of half the spacing; `None` for an empty field.
    pub(super) fn nearest(&self, fine: &Grid, index: usize) -> Option<usize> {
        let column = (index % fine.columns / 2).min(self.grid.columns.checked_sub(1)?);
        let row = (index / fine.columns / 2).min(self.grid.rows.checked_sub(1)?);
        Some(row * self.grid.columns + column)
    }

    /// The `count` neighbours that fit each pixel best.
    pub(super) fn best_sources(&self, matcher: &Matcher, count: usize) -> Vec<Sources> {
        (0..self.planes.len())
            .into_par_iter()
            .map(|index| {
                let (column, row) = (index % self.grid.columns, index / self.grid.columns);
                let patch = matcher.patch(2 * column + 1, 2 * row + 1);
                let pixel = self.grid.pixel(column, row);
                matcher.best_sources(&patch, pixel, &self.planes[index], count)
            })
            .collect()
    }
}

/// The best plane in each of four directions, at the pixel.
fn neighbours(
    grid: &Grid,
    (planes, scores): &(Vec<PixelPlane>, Vec<f32>),
    column: usize,
    row: usize,
) -> [Option<PixelPlane>; 4] {
    [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(dx, dy): (isize, isize)| {
        let mut best: Option<(f32, PixelPlane)> = None;
        for reach in REACH {
            let x = column.wrapping_add_signed(dx * reach as isize);
            let y = row.wrapping_add_signed(dy * reach as isize);
            if x >= grid.columns || y >= grid.rows {
                break;
            }
            let index = y * grid.columns + x;
            if planes[index].rho > 0.0 && best.is_none_or(|(score, _)| scores[index] > score) {
                let away = [-dx, -dy].map(|step| (step * reach as isize) as f32 * grid.spacing);
                best = Some((scores[index], planes[index].shifted(away)));
            }
        }
        best.map(|(_, plane)| plane)
    })
}
