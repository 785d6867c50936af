//! Which observations of a landmark become rays.
//!
//! Rays to a landmark from similar directions carve the same space, so a landmark has at most one ray for each *bin*, a cell
//! of a grid of directions. Of the views in a bin that observe the landmark, the first has the ray. The rays are therefore a function of the observations and of the landmark's position, and their number
//! saturates while a camera stays.

use linecarve_carving::ViewId;
use nalgebra::{Point3, Vector3};

const NONE: u32 = u32::MAX;

/// An observation with a ray in the list of its landmark.
#[derive(Debug, Clone, Copy)]
struct Ray {
    view: ViewId,
    bin: Bin,
    next: u32,
}

/// The views of a landmark among 64 with subsequent numbers. Most observations are by runs of subsequent views.
#[derive(Debug, Clone, Copy)]
struct Block {
    /// One bit for each view.
    views: u64,
    /// Number of the first of the 64 views, divided by 64.
    number: u32,
    next: u32,
}

impl Block {
    fn bit(view: ViewId) -> u64 {
        1 << (view.0 % u64::BITS)
    }

    fn number(view: ViewId) -> u32 {
        view.0 / u64::BITS
    }

    /// Its views, ascending.
    fn views(self) -> impl Iterator<Item = ViewId> {
        let without_first = |bits: &u64| Some(bits & (bits - 1)).filter(|rest| *rest != 0);
        let start = Some(self.views).filter(|bits| *bits != 0);
        let first = self.number * u64::BITS;
        std::iter::successors(start, without_first)
            .map(move |bits| ViewId(first + bits.trailing_zeros()))
    }
}

/// The lists of a landmark.
#[derive(Debug, Clone, Copy)]
struct Lists {
    /// The first block of all observations, that of the latest views.
    observations: u32,
    /// The observations with a ray, the latest first.
    rays: u32,
}

impl Lists {
    const EMPTY: Lists = Lists {
        observations: NONE,
        rays: NONE,
    };
}

/// A change of the rays of a landmark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RayChange {
    Add(ViewId),
    Remove(ViewId),
}

/// The observations of each landmark, and those of them that are rays.
#[derive(Debug, Clone, Default)]
pub(super) struct RaySelection {
    /// Cells of the direction grid along an edge of the cube, an odd number, so that the axes are not on a border; none where
    /// every observation is a ray.
    grid: Option<f64>,
    lists: Vec<Lists>,
    rays: Vec<Ray>,
    free_rays: u32,
    blocks: Vec<Block>,
    free_blocks: u32,
    /// Reused memory: rays of a landmark before, the blocks of its observations, the bins that are taken, and the result.
    before: Vec<ViewId>,
    blocks_of: Vec<Block>,
    taken: Vec<Bin>,
    changes: Vec<RayChange>,
}

/// A cell of the direction grid: the face of the cube in the upper bits, then 14 bits for each coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Bin(u32);

impl Bin {
    const LARGEST: u32 = (1 << 14) - 1;
}

impl RaySelection {
    /// No landmarks yet. Direction bins are about `angle_deg` wide; with 0 every observation is a ray.
    pub(super) fn new(angle_deg: f64) -> Self {
        Self {
            grid: (angle_deg > 0.0).then(|| 2.0 * (45.0 / angle_deg).floor() + 1.0),
            free_rays: NONE,
            free_blocks: NONE,
            ..Self::default()
        }
    }

    fn bin(grid: f64, position: &Point3<f64>, center: &Point3<f64>) -> Bin {
        let ray: Vector3<f64> = center - position;
        let axis = ray.iamax();
        let length = ray[axis].abs();
        let along = |k: usize| {
            // From -1 to 1 across the face of a cube.
            let share = ray[(axis + k) % 3] / length;
            (((share + 1.0) * 0.5 * grid) as u32).min(Bin::LARGEST)
        };
        let face = 2 * axis as u32 + u32::from(ray[axis] < 0.0);
        Bin(face << 28 | along(1) << 14 | along(2))
    }

    fn push_ray(&mut self, view: ViewId, bin: Bin, next: u32) -> u32 {
        let ray = Ray { view, bin, next };
        if self.free_rays == NONE {
            self.rays.push(ray);
            return (self.rays.len() - 1) as u32;
        }
        let place = self.free_rays;
        self.free_rays = self.rays[place as usize].next;
        self.rays[place as usize] = ray;
        place
    }

    fn release_rays(&mut self, mut first: u32) {
        while first != NONE {
            let next = self.rays[first as usize].next;
            self.rays[first as usize].next = self.free_rays;
            self.free_rays = first;
            first = next;
        }
    }

    fn rays_from(&self, mut next: u32) -> impl Iterator<Item = &Ray> + '_ {
        std::iter::from_fn(move || {
            let ray = self.rays.get(next as usize)?;
            next = ray.next;
            Some(ray)
        })
    }

    /// Adds a view, no earlier than the latest, to the observations of a landmark.
    fn push_observation(&mut self, landmark: usize, view: ViewId) {
        let lists = &mut self.lists[landmark];
        if let Some(latest) = self.blocks.get_mut(lists.observations as usize)
            && latest.number == Block::number(view)
        {
            latest.views |= Block::bit(view);
            return;
        }
        let block = Block {
            views: Block::bit(view),
            number: Block::number(view),
            next: lists.observations,
        };
        if self.free_blocks == NONE {
            lists.observations = self.blocks.len() as u32;
            self.blocks.push(block);
        } else {
            lists.observations = self.free_blocks;
            let free = &mut self.blocks[self.free_blocks as usize];
            self.free_blocks = free.next;
            *free = block;
        }
    }

    fn release_observations(&mut self, mut first: u32) {
        while first != NONE {
            let next = self.blocks[first as usize].next;
            self.blocks[first as usize].next = self.free_blocks;
            self.free_blocks = first;
            first = next;
        }
    }

    /// The blocks of a list, the latest views first.
    fn blocks_from(&self, mut next: u32) -> impl Iterator<Item = Block> + '_ {
        std::iter::from_fn(move || {
            let block = *self.blocks.get(next as usize)?;
            next = block.next;
            Some(block)
        })
    }

    /// Records that a view, later than all that observe the landmark at `position` so far, observes it. Returns whether it
    /// gets a ray. `center_of` gives the centre of each view.
    ///
    /// # Complexity
    /// Linear in the rays of the landmark.
    pub(super) fn observe(
        &mut self,
        landmark: u32,
        position: &Point3<f64>,
        view: ViewId,
        center_of: impl Fn(ViewId) -> Point3<f64>,
    ) -> bool {
        let Some(grid) = self.grid else {
            return true;
        };
        let index = landmark as usize;
        self.lists
            .resize(self.lists.len().max(index + 1), Lists::EMPTY);
        self.push_observation(index, view);
        let bin = Self::bin(grid, position, &center_of(view));
        let first = self.lists[index].rays;
        let is_taken = self.rays_from(first).any(|ray| ray.bin == bin);
        if !is_taken {
            self.lists[index].rays = self.push_ray(view, bin, first);
        }
        !is_taken
    }

    /// Follows views that observe a landmark, which stays where it is, to other centres: later observations are compared with the rays
    /// as they are now.
    ///
    /// # Complexity
    /// Linear in the rays of the landmark.
    pub(super) fn follow_views(
        &mut self,
        landmark: u32,
        position: &Point3<f64>,
        center_of: impl Fn(ViewId) -> Point3<f64>,
    ) {
        let (Some(grid), Some(lists)) = (self.grid, self.lists.get(landmark as usize)) else {
            return;
        };
        let mut next = lists.rays;
        while let Some(ray) = self.rays.get_mut(next as usize) {
            ray.bin = Self::bin(grid, position, &center_of(ray.view));
            next = ray.next;
        }
    }

    /// Selects the rays of a landmark anew after it moved to `position`.
    ///
    /// # Complexity
    /// The observations of the landmark times its rays.
    pub(super) fn select(
        &mut self,
        landmark: u32,
        position: &Point3<f64>,
        center_of: impl Fn(ViewId) -> Point3<f64>,
    ) -> &[RayChange] {
        self.changes.clear();
        let Some(grid) = self.grid else {
            return &self.changes;
        };
        let Some(&lists) = self.lists.get(landmark as usize) else {
            return &self.changes;
        };
        let mut before = std::mem::take(&mut self.before);
        before.clear();
        before.extend(self.rays_from(lists.rays).map(|ray| ray.view));
        self.release_rays(lists.rays);
        let mut blocks = std::mem::take(&mut self.blocks_of);
        blocks.clear();
        blocks.extend(self.blocks_from(lists.observations));
        self.taken.clear();
        let mut rays = NONE;
        for view in blocks.iter().rev().flat_map(|block| block.views()) {
            let bin = Self::bin(grid, position, &center_of(view));
            if self.taken.contains(&bin) {
                continue;
            }
            self.taken.push(bin);
            rays = self.push_ray(view, bin, rays);
            match before.iter().position(|other| *other == view) {
                Some(place) => {
                    before.swap_remove(place);
                }
                None => self.changes.push(RayChange::Add(view)),
            }
        }
        self.changes
            .extend(before.iter().map(|view| RayChange::Remove(*view)));
        self.before = before;
        self.blocks_of = blocks;
        self.lists[landmark as usize].rays = rays;
        &self.changes
    }

    /// Forgets that a view, whose rays go with it, observes a landmark. The rays of the others have to be [selected](Self::select)
    /// anew.
    ///
    /// # Complexity
    /// Linear in the observations of the landmark.
    pub(super) fn forget_view(&mut self, landmark: u32, view: ViewId) {
        let Some(lists) = self.lists.get(landmark as usize).copied() else {
            return;
        };
        let mut next = lists.observations;
        while let Some(block) = self.blocks.get_mut(next as usize) {
            if block.number == Block::number(view) {
                // A block without views counts for nothing.
                block.views &= !Block::bit(view);
            }
            next = block.next;
        }
        let mut rays: Vec<Ray> = self.rays_from(lists.rays).copied().collect();
        self.release_rays(lists.rays);
        rays.retain(|ray| ray.view != view);
        self.lists[landmark as usize].rays = NONE;
        for ray in rays.into_iter().rev() {
            let first = self.lists[landmark as usize].rays;
            self.lists[landmark as usize].rays = self.push_ray(ray.view, ray.bin, first);
        }
    }

    /// Forgets a landmark that was removed.
    pub(super) fn remove(&mut self, landmark: u32) {
        if let Some(lists) = self.lists.get_mut(landmark as usize) {
            let lists = std::mem::replace(lists, Lists::EMPTY);
            self.release_observations(lists.observations);
            self.release_rays(lists.rays);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A view on a spiral around the origin.
    fn center(view: ViewId) -> Point3<f64> {
        let turn = 0.37 * f64::from(view.0);
        let distance = 1.0 + 0.05 * f64::from(view.0);
        Point3::new(
            distance * turn.cos(),
            distance * turn.sin(),
            0.3 * turn.sin(),
        )
    }

    /// The rays of a landmark, ascending.
    fn rays_of(selection: &RaySelection, landmark: u32) -> Vec<ViewId> {
        let rays = selection.rays_from(selection.lists[landmark as usize].rays);
        let mut rays: Vec<ViewId> = rays.map(|ray| ray.view).collect();
        rays.sort_unstable();
        rays
    }

    #[test]
    fn the_rays_depend_on_the_observations_and_the_last_position_alone() {
        let places: Vec<Point3<f64>> = (0..5)
            .map(|k| Point3::new(0.1 * f64::from(k), -0.05 * f64::from(k), 0.02))
            .collect();
        let mut moved = RaySelection::new(15.0);
        let mut kept: Vec<ViewId> = Vec::new();
        for view in 0..60 {
            let place = &places[view as usize / 12];
            if view % 12 == 0 {
                for change in moved.select(0, place, center) {
                    match change {
                        RayChange::Add(view) => kept.push(*view),
                        RayChange::Remove(view) => kept.retain(|other| other != view),
                    }
                }
            }
            if moved.observe(0, place, ViewId(view), center) {
                kept.push(ViewId(view));
            }
        }
        let mut at_once = RaySelection::new(15.0);
        for view in 0..60 {
            at_once.observe(0, &places[4], ViewId(view), center);
        }
        assert_eq!(rays_of(&moved, 0), rays_of(&at_once, 0));
        kept.sort_unstable();
        assert_eq!(kept, rays_of(&at_once, 0));
        assert!(kept.len() > 5 && kept.len() < 60);
    }

    #[test]
    fn the_number_of_rays_saturates_while_a_camera_stays() {
        let mut selection = RaySelection::new(15.0);
        let stays = |view: ViewId| Point3::new(1.0, 1e-3 * f64::from(view.0 % 7), 0.1);
        let rays = (0..1000)
            .filter(|view| selection.observe(3, &Point3::origin(), ViewId(*view), stays))
            .count();
        assert_eq!(rays, 1);
        selection.remove(3);
        let memory = (selection.blocks.len(), selection.rays.len());
        assert!(selection.observe(4, &Point3::origin(), ViewId(1000), stays));
        assert_eq!((selection.blocks.len(), selection.rays.len()), memory);
    }

    #[test]
    fn the_rays_without_a_view_are_those_of_the_other_views() {
        let place = Point3::new(0.1, -0.05, 0.02);
        let (mut all, mut others) = (RaySelection::new(15.0), RaySelection::new(15.0));
        for view in (0..60).map(ViewId) {
            all.observe(0, &place, view, center);
            if view.0 % 3 > 0 {
                others.observe(0, &place, view, center);
            }
        }
        for view in (0..60).step_by(3).map(ViewId) {
            all.forget_view(0, view);
        }
        let changes = all.select(0, &place, center);
        assert!(
            changes
                .iter()
                .all(|change| matches!(change, RayChange::Add(_)))
        );
        assert_eq!(rays_of(&all, 0), rays_of(&others, 0));
        all.forget_view(7, ViewId(1));
    }

    #[test]
    fn bins_follow_views_that_are_placed_elsewhere() {
        let mut selection = RaySelection::new(15.0);
        let before = |view: ViewId| Point3::new(1.0, f64::from(view.0), 0.1);
        let after = |view: ViewId| Point3::new(1.0, f64::from(view.0) - 1.0, 0.1);
        let place = Point3::origin();
        assert!(selection.observe(0, &place, ViewId(0), before));
        selection.follow_views(0, &place, after);
        assert!(!selection.observe(0, &place, ViewId(1), |_| after(ViewId(0))));
        assert!(selection.observe(0, &place, ViewId(2), after));
    }

    #[test]
    fn without_bins_every_observation_is_a_ray() {
        let mut selection = RaySelection::new(0.0);
        for view in 0..3 {
            assert!(
                selection.observe(0, &Point3::origin(), ViewId(view), |_| Point3::new(
                    1.0, 0.0, 0.0
                ))
            );
        }
        assert!(selection.select(0, &Point3::origin(), center).is_empty());
    }
}
