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
//! The first two come and go with the entries of the crossing lists. For the third, every cell lists the [places](super::ties)
//! that it holds, or holds in its boundary; those of destroyed cells are located anew. Sheets tie
//! [places](SheetSight::behind) behind their segments to matter in the same way.

use crate::tetrahedralization::{CellId, Tetrahedralization};

use super::rays::RayId;
use super::segment::Exit;
use super::sheet_evidence::{PLACES, SheetSight};
use super::softness::{Sight, Softness};
use super::ties::{Ties, is_inside};
use super::walk::Walker;

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

/// Sums of all cells; nothing at all while switched off.
#[derive(Clone, Debug, Default)]
pub(crate) struct Evidence {
    softness: Option<Softness>,
    cells: Vec<CellEvidence>,
    /// Per ray the standard deviation of its point.
    sigmas: Vec<Option<f64>>,
    /// Per ray the place behind its point.
    behind_rays: Ties,
    /// Per sheet the places behind its segment.
    behind_sheets: Ties,
    touched: Vec<CellId>,
    is_touched: Vec<bool>,
    adrift: Vec<u32>,
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
            self.is_touched.resize(cells, false);
        }
        if self.sigmas.len() < rays {
            self.sigmas.resize(rays, None);
        }
        self.behind_rays.grow(cells, rays);
    }

    /// Makes room for cells and sheets with numbers below.
    pub(super) fn grow_sheets(&mut self, cells: usize, sheets: usize) {
        if self.softness.is_some() {
            self.behind_sheets.grow(cells, PLACES * sheets);
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
            self.sigmas[ray.0 as usize] = sigma;
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
        let sigma = self.sigmas.get(ray.0 as usize).copied().flatten();
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
        self.behind_rays.set_adrift(cell);
        self.behind_sheets.set_adrift(cell);
    }

    /// Locates the places of all rays that have lost theirs.
    pub(crate) fn locate_adrift(&mut self, walker: &Walker<'_>) {
        let mut adrift = std::mem::take(&mut self.adrift);
        self.behind_rays.take_adrift(&mut adrift);
        for &ray in &adrift {
            self.place(walker, RayId(ray));
        }
        self.adrift = adrift;
    }

    /// Finds the cell behind a ray's point and ties it to matter.
    pub(crate) fn place(&mut self, walker: &Walker<'_>, ray: RayId) {
        let Some(sight) = self.sight(walker, ray) else {
            return;
        };
        let hint = walker.tetrahedra.cell_of(walker.target(ray));
        let place = sight.behind();
        let hung = self
            .behind_rays
            .hang(walker.tetrahedra, ray.0, &place, hint);
        if let Some(cell) = hung {
            self.cells[cell.index()].matter += sight.tie();
            self.touch(cell);
        }
    }

    /// Takes the tie behind a ray's point away.
    pub(crate) fn lift(&mut self, walker: &Walker<'_>, ray: RayId) {
        let Some(sight) = self.sight(walker, ray) else {
            return;
        };
        if let Some(cell) = self.behind_rays.lift(ray.0) {
            self.cells[cell.index()].matter -= sight.tie();
            self.touch(cell);
        }
    }

    /// Ties what is behind a sheet's segment to matter, where it is not tied already.
    pub(super) fn place_sheet(
        &mut self,
        tetrahedra: &Tetrahedralization,
        sheet: RayId,
        sight: &SheetSight<'_>,
        places: impl IntoIterator<Item = usize>,
        hint: Option<CellId>,
    ) {
        let Some(softness) = self.softness else {
            return;
        };
        let tie = sight.tie(&softness);
        let frame = sight.frame(&softness);
        for k in places {
            let id = PLACES as u32 * sheet.0 + k as u32;
            let place = sight.behind(&frame, &softness, k);
            if let Some(cell) = self.behind_sheets.hang(tetrahedra, id, &place, hint) {
                self.cells[cell.index()].matter += tie;
                self.touch(cell);
            }
        }
    }

    /// Takes the ties behind a sheet's segment away.
    pub(super) fn lift_sheet(&mut self, sheet: RayId, sight: &SheetSight<'_>) {
        let Some(softness) = &self.softness else {
            return;
        };
        let tie = sight.tie(softness);
        for k in 0..PLACES as u32 {
            if let Some(cell) = self.behind_sheets.lift(PLACES as u32 * sheet.0 + k) {
                self.cells[cell.index()].matter -= tie;
                self.touch(cell);
            }
        }
    }

    /// The sheets with places that have lost their cell, and which of them; moved to `adrift`, which is cleared first.
    pub(super) fn take_adrift_sheets(&mut self, adrift: &mut Vec<(RayId, usize)>) {
        adrift.clear();
        let mut ids = std::mem::take(&mut self.adrift);
        self.behind_sheets.take_adrift(&mut ids);
        adrift.extend(ids.iter().map(|id| {
            let places = PLACES as u32;
            (RayId(id / places), (id % places) as usize)
        }));
        self.adrift = ids;
    }

    /// What a sheet with an area says about matter in a finite cell, by the rule alone; for tests.
    pub(crate) fn sheet_tie(
        &self,
        tetrahedra: &Tetrahedralization,
        cell: CellId,
        sight: &SheetSight<'_>,
    ) -> u64 {
        let Some(softness) = &self.softness else {
            return 0;
        };
        let frame = sight.frame(softness);
        let inside = (0..PLACES)
            .map(|k| sight.behind(&frame, softness, k))
            .filter(|place| is_inside(tetrahedra, cell, *place));
        inside.count() as u64 * sight.tie(softness)
    }

    /// What a ray says about matter in a finite cell, by the rule alone; for tests.
    pub(crate) fn tie(&self, walker: &Walker<'_>, cell: CellId, ray: RayId) -> u64 {
        let Some(sight) = self.sight(walker, ray) else {
            return 0;
        };
        if is_inside(walker.tetrahedra, cell, sight.behind()) {
            sight.tie()
        } else {
            0
        }
    }

    /// Forgets all sums and places, not the deviations.
    pub(crate) fn clear(&mut self) {
        self.cells.fill(CellEvidence::default());
        self.behind_rays.clear();
        self.behind_sheets.clear();
    }
}
