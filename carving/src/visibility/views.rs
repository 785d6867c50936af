//! The table of views, and the cells of their centres.

use nalgebra::Point3;

use crate::tetrahedralization::{CellId, Location, Tetrahedralization};

/// Location of the centre of a view.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Viewpoint {
    /// In the open interior of this finite cell, where its rays begin.
    Inside(CellId),
    /// Strictly outside the hull, beyond the facet of this ghost cell.
    Outside(CellId),
    /// On a facet, an edge or a vertex.
    OnBoundary,
    /// There are no cells.
    NoCells,
}

/// Centres of views; the entry of a removed view is never used again.
#[derive(Clone, Debug, Default)]
pub(crate) struct Views {
    centers: Vec<[f64; 3]>,
    viewpoints: Vec<Option<Viewpoint>>,
}

impl Views {
    /// Number of ids given out.
    pub(crate) fn capacity(&self) -> usize {
        self.centers.len()
    }

    pub(crate) fn is_alive(&self, view: u32) -> bool {
        self.viewpoints
            .get(view as usize)
            .is_some_and(Option::is_some)
    }

    #[inline]
    pub(crate) fn center(&self, view: u32) -> &[f64; 3] {
        &self.centers[view as usize]
    }

    /// Where the centre of a living view lies.
    #[inline]
    pub(crate) fn viewpoint(&self, view: u32) -> Viewpoint {
        self.viewpoints[view as usize].unwrap_or(Viewpoint::NoCells)
    }

    /// Adds a view, not yet located.
    pub(crate) fn add(&mut self, center: [f64; 3]) -> u32 {
        self.centers.push(center);
        self.viewpoints.push(Some(Viewpoint::NoCells));
        (self.centers.len() - 1) as u32
    }

    pub(crate) fn remove(&mut self, view: u32) {
        self.viewpoints[view as usize] = None;
    }

    /// Moves a view, which is then not located.
    pub(crate) fn move_to(&mut self, view: u32, center: [f64; 3]) {
        self.centers[view as usize] = center;
        self.viewpoints[view as usize] = Some(Viewpoint::NoCells);
    }

    /// Ids of all views in use, increasing.
    pub(crate) fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.viewpoints.len() as u32).filter(|&v| self.is_alive(v))
    }

    /// Locates again all views whose cell satisfies `is_stale`, and those on the boundary of cells.
    ///
    /// A centre strictly outside a hull facet stays outside the hull while that facet exists, and one inside a cell
    /// stays inside that cell, so nothing else can have changed.
    ///
    /// # Complexity
    ///
    /// One test per view, one point location per stale view.
    pub(crate) fn locate_stale(
        &mut self,
        tetrahedra: &Tetrahedralization,
        mut is_stale: impl FnMut(CellId) -> bool,
    ) {
        let mut hint = None;
        for (center, viewpoint) in self.centers.iter().zip(&mut self.viewpoints) {
            let Some(viewpoint) = viewpoint else { continue };
            if let Viewpoint::Inside(cell) | Viewpoint::Outside(cell) = *viewpoint
                && !is_stale(cell)
            {
                continue;
            }
            let location = tetrahedra
                .locate(&Point3::from(*center), hint)
                .expect("centres were accepted when they were added");
            *viewpoint = match location {
                Location::InCell(cell) => Viewpoint::Inside(cell),
                Location::Outside(cell) => Viewpoint::Outside(cell),
                Location::OnFacet { .. } | Location::OnEdge { .. } | Location::OnVertex(_) => {
                    Viewpoint::OnBoundary
                }
                Location::NoCells => Viewpoint::NoCells,
            };
            if let Viewpoint::Inside(cell) | Viewpoint::Outside(cell) = *viewpoint {
                hint = Some(cell);
            }
        }
        if tetrahedra.dimension() < 3 {
            for viewpoint in self.viewpoints.iter_mut().flatten() {
                *viewpoint = Viewpoint::NoCells;
            }
        }
    }
}
