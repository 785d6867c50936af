//! What rays say about cells beyond crossing them, summed per cell: the material of cut labels.
//!
//! A ray says that its centre is in free space, that there is free space in front of its point, the surer the further
//! from it, and that there is matter a little behind it. Each of that is a rounded number of one ray and one cell, a
//! function of their geometry alone:
//!
//! * for a cell that the ray crosses and leaves, towards the centre, through the open interior of a facet: the
//!   [cost](super::softness) of that facet. Where it leaves through an edge or a vertex, nothing;
//! * for the cell that the ray crosses and whose closure holds the centre: its full weight;
//! * for the cell whose open interior holds the place [behind](Sight::behind) its point: the weight of the tie.
//!
//! The first two come and go with the entries of the crossing lists. For the third, every cell lists the rays whose
//! place it holds, or holds in its boundary; those of destroyed cells are located anew.

use crate::predicates::orient3d;
use crate::tetrahedralization::{CellId, Location, Tetrahedralization, VertexId, accept};

use super::rays::RayId;
use super::segment::Exit;
use super::softness::{Sight, Softness};
use super::walk::Walker;

const NONE: u32 = u32::MAX;

/// Sums of one cell, in units of [`UNIT`](super::softness::UNIT) for each ray of weight 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct CellEvidence {
    /// Cost of being matter behind free space, for each of the four facets.
    pub(crate) entered: [u64; 4],
    /// Centres of rays inside.
    pub(crate) free: u64,
    /// Places behind points inside.
    pub(crate) matter: u64,
}

impl CellEvidence {
    /// The sum that a ray which leaves by `exit` adds to.
    #[inline]
    pub(crate) fn of_exit(&mut self, exit: Exit) -> Option<&mut u64> {
        match exit {
            Exit::Through(facet) => Some(&mut self.entered[facet]),
            Exit::AtCenter => Some(&mut self.free),
            Exit::Elsewhere => None,
        }
    }

    pub(crate) fn add(&mut self, other: &CellEvidence) {
        for (sum, more) in self.entered.iter_mut().zip(other.entered) {
            *sum += more;
        }
        self.free += other.free;
        self.matter += other.matter;
    }

    fn subtract(&mut self, other: &CellEvidence) {
        for (sum, less) in self.entered.iter_mut().zip(other.entered) {
            *sum -= less;
        }
        self.free -= other.free;
        self.matter -= other.matter;
    }
}

/// A ray's own part.
#[derive(Clone, Copy, Debug)]
struct RayRecord {
    sigma: Option<f64>,
    /// The cell that lists it for its place behind the point.
    cell: u32,
    /// Whether that place is in the open interior of that cell.
    is_inside: bool,
    links: [u32; 2],
}

impl RayRecord {
    const EMPTY: RayRecord = RayRecord {
        sigma: None,
        cell: NONE,
        is_inside: false,
        links: [NONE; 2],
    };
}

/// Sums of all cells; nothing at all while switched off.
#[derive(Clone, Debug, Default)]
pub(crate) struct Evidence {
    softness: Option<Softness>,
    cells: Vec<CellEvidence>,
    /// Per cell the first ray whose place behind the point is listed by it.
    first: Vec<u32>,
    rays: Vec<RayRecord>,
    touched: Vec<CellId>,
    is_touched: Vec<bool>,
    /// Rays whose place is to be located.
    adrift: Vec<RayId>,
}

impl Evidence {
    /// Nothing recorded; nothing ever will be without a `softness`.
    pub(crate) fn new(softness: Option<Softness>) -> Self {
        Self {
            softness,
            ..Self::default()
        }
    }

    /// Whether anything is recorded.
    pub(crate) fn is_on(&self) -> bool {
        self.softness.is_some()
    }

    /// Makes room for cells and rays with indices below.
    pub(crate) fn grow(&mut self, cells: usize, rays: usize) {
        if self.softness.is_none() {
            return;
        }
        if self.cells.len() < cells {
            self.cells.resize(cells, CellEvidence::default());
            self.first.resize(cells, NONE);
            self.is_touched.resize(cells, false);
        }
        if self.rays.len() < rays {
            self.rays.resize(rays, RayRecord::EMPTY);
        }
    }

    /// The sums of a cell.
    #[inline]
    pub(crate) fn of(&self, cell: CellId) -> &CellEvidence {
        &self.cells[cell.index()]
    }

    /// Sets the standard deviation of a ray's point, before the ray is recorded.
    pub(crate) fn describe(&mut self, ray: RayId, sigma: Option<f64>) {
        if self.softness.is_some() {
            self.grow(0, ray.0 as usize + 1);
            self.rays[ray.0 as usize].sigma = sigma;
        }
    }

    /// Lists a cell as changed.
    #[inline]
    pub(crate) fn touch(&mut self, cell: CellId) {
        if !std::mem::replace(&mut self.is_touched[cell.index()], true) {
            self.touched.push(cell);
        }
    }

    /// Moves the list of changed cells, each once, to `cells`, which is cleared first.
    pub(crate) fn take_touched(&mut self, cells: &mut Vec<CellId>) {
        cells.clear();
        cells.append(&mut self.touched);
        for cell in cells {
            self.is_touched[cell.index()] = false;
        }
    }

    /// A ray as it speaks; `None` while nothing is recorded.
    #[inline]
    pub(crate) fn sight<'a>(&self, walker: &Walker<'a>, ray: RayId) -> Option<Sight<'a>> {
        let softness = self.softness?;
        let center = walker.views.center(walker.rays.view(ray));
        let target = walker.tetrahedra.coordinates(walker.target(ray));
        let record = self.rays.get(ray.0 as usize);
        let sigma = record.and_then(|record| record.sigma);
        let weight = walker.rays.weight(ray);
        Some(Sight::new([center, target], sigma, weight, softness))
    }

    /// What a ray says about a finite cell that it crosses and leaves by `exit`.
    #[inline]
    pub(crate) fn passage(
        tetrahedra: &Tetrahedralization,
        cell: CellId,
        sight: &Sight<'_>,
        exit: Exit,
    ) -> u64 {
        match exit {
            Exit::Through(facet) => {
                let vertices = tetrahedra.cell_vertices(cell);
                let [a, b, c] = Tetrahedralization::FACET[facet];
                let corner = |k: usize| tetrahedra.coordinates(vertices[k]);
                sight.cost([corner(a), corner(b), corner(c)])
            }
            Exit::AtCenter => sight.full(),
            Exit::Elsewhere => 0,
        }
    }

    /// How what is said falls off near points; `None` while switched off.
    pub(crate) fn softness(&self) -> Option<&Softness> {
        self.softness.as_ref()
    }

    /// Adds what something other than a ray says about a cell.
    pub(super) fn add_said(&mut self, cell: CellId, said: &CellEvidence) {
        self.cells[cell.index()].add(said);
        self.touch(cell);
    }

    /// Takes back what [`add_said`](Self::add_said) added.
    pub(super) fn subtract_said(&mut self, cell: CellId, said: &CellEvidence) {
        self.cells[cell.index()].subtract(said);
        self.touch(cell);
    }

    /// Adds what a ray says about a cell that it crosses; nothing without a sight.
    #[inline]
    pub(crate) fn add(
        &mut self,
        tetrahedra: &Tetrahedralization,
        cell: CellId,
        sight: Option<&Sight<'_>>,
        exit: Exit,
    ) {
        self.change(tetrahedra, cell, sight, exit, |sum, cost| *sum += cost);
    }

    /// Takes back what [`add`](Self::add) added; nothing that it depends on may have changed since.
    #[inline]
    pub(crate) fn subtract(
        &mut self,
        tetrahedra: &Tetrahedralization,
        cell: CellId,
        sight: Option<&Sight<'_>>,
        exit: Exit,
    ) {
        self.change(tetrahedra, cell, sight, exit, |sum, cost| *sum -= cost);
    }

    #[inline]
    fn change(
        &mut self,
        tetrahedra: &Tetrahedralization,
        cell: CellId,
        sight: Option<&Sight<'_>>,
        exit: Exit,
        by: impl FnOnce(&mut u64, u64),
    ) {
        let Some(sight) = sight else { return };
        if let Some(sum) = self.cells[cell.index()].of_exit(exit) {
            by(sum, Self::passage(tetrahedra, cell, sight, exit));
            self.touch(cell);
        }
    }

    /// Forgets the sums of a cell that is destroyed or reshaped; places behind points inside are to be located anew.
    pub(crate) fn reset(&mut self, cell: CellId) {
        if self.softness.is_none() {
            return;
        }
        self.cells[cell.index()] = CellEvidence::default();
        let mut ray = std::mem::replace(&mut self.first[cell.index()], NONE);
        while ray != NONE {
            self.adrift.push(RayId(ray));
            let record = &mut self.rays[ray as usize];
            ray = record.links[1];
            record.cell = NONE;
        }
    }

    /// Locates the places of all rays that have lost theirs.
    pub(crate) fn locate_adrift(&mut self, walker: &Walker<'_>) {
        let mut adrift = std::mem::take(&mut self.adrift);
        for ray in adrift.drain(..) {
            self.place(walker, ray);
        }
        self.adrift = adrift;
    }

    /// Finds the cell behind a ray's point and ties it to matter.
    pub(crate) fn place(&mut self, walker: &Walker<'_>, ray: RayId) {
        let Some(sight) = self.sight(walker, ray) else {
            return;
        };
        let place = sight.behind();
        let target = walker.target(ray);
        let hint = walker.tetrahedra.cell_of(target);
        // A place out of range is beyond everything.
        let Ok(location) = walker.tetrahedra.locate(&place.into(), hint) else {
            return;
        };
        let at_vertex = |v: VertexId| walker.tetrahedra.cell_of(v);
        let (cell, is_inside) = match location {
            Location::InCell(cell) => (Some(cell), true),
            Location::OnFacet { cell, .. }
            | Location::OnEdge { cell, .. }
            | Location::Outside(cell) => (Some(cell), false),
            Location::OnVertex(vertex) => (at_vertex(vertex), false),
            Location::NoCells => (None, false),
        };
        let Some(cell) = cell else { return };
        let tie = sight.tie();
        let next = std::mem::replace(&mut self.first[cell.index()], ray.0);
        if next != NONE {
            self.rays[next as usize].links[0] = ray.0;
        }
        let record = &mut self.rays[ray.0 as usize];
        record.cell = cell.index() as u32;
        record.is_inside = is_inside;
        record.links = [NONE, next];
        if is_inside {
            self.cells[cell.index()].matter += tie;
            self.touch(cell);
        }
    }

    /// Takes the tie behind a ray's point away.
    pub(crate) fn lift(&mut self, walker: &Walker<'_>, ray: RayId) {
        let Some(sight) = self.sight(walker, ray) else {
            return;
        };
        let tie = sight.tie();
        let RayRecord {
            cell,
            is_inside,
            links: [before, after],
            ..
        } = self.rays[ray.0 as usize];
        if cell == NONE {
            return;
        }
        self.rays[ray.0 as usize].cell = NONE;
        let cell = CellId::from_index(cell as usize);
        match before {
            NONE => self.first[cell.index()] = after,
            before => self.rays[before as usize].links[1] = after,
        }
        if after != NONE {
            self.rays[after as usize].links[0] = before;
        }
        if is_inside {
            self.cells[cell.index()].matter -= tie;
            self.touch(cell);
        }
    }

    /// What a ray says about matter in a finite cell, by the rule alone; for tests.
    pub(crate) fn tie(&self, walker: &Walker<'_>, cell: CellId, ray: RayId) -> u64 {
        let Some(sight) = self.sight(walker, ray) else {
            return 0;
        };
        let Ok(place) = accept(&sight.behind().into()) else {
            return 0;
        };
        let vertices = walker.tetrahedra.cell_vertices(cell);
        let is_inside = Tetrahedralization::FACET.iter().all(|facet| {
            let [a, b, c] = facet.map(|k| walker.tetrahedra.coordinates(vertices[k]));
            orient3d(a, b, c, &place) > 0.0
        });
        if is_inside { sight.tie() } else { 0 }
    }

    /// Forgets all sums and places, not the deviations.
    pub(crate) fn clear(&mut self) {
        self.cells.fill(CellEvidence::default());
        self.first.fill(NONE);
        for ray in &mut self.rays {
            ray.cell = NONE;
        }
        self.adrift.clear();
    }
}
