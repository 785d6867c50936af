//! Which observations of a landmark become rays.
//!
//! Rays to a landmark from similar directions and distances carve the same space, so a landmark has at most one ray for each
//! *bin*: a cell of a grid of directions, and an octave of distances. Of the views in a bin that observe the landmark, the
//! first has the ray. The rays are therefore a function of the observations and of the landmark's position, and their number
//! saturates while a camera stays.

use linecarve_carving::ViewId;
use nalgebra::{Point3, Vector3};

const NONE: u32 = u32::MAX;

/// An observation in the list of its landmark.
#[derive(Debug, Clone, Copy)]
struct Entry {
    view: ViewId,
    next: u32,
}

/// The lists of a landmark.
#[derive(Debug, Clone, Copy)]
struct Lists {
    /// All observations, the latest first.
    observations: u32,
    /// The observations with a ray.
    rays: u32,
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
    /// Cells of the direction grid along an edge of the cube; none where every observation is a ray.
    grid: Option<f64>,
    lists: Vec<Lists>,
    entries: Vec<Entry>,
    free: u32,
    /// Reused memory: views of a landmark, ascending, and the bins that are taken.
    views: Vec<ViewId>,
    taken: Vec<Bin>,
    changes: Vec<RayChange>,
}

/// A cell of the direction grid and an octave of distances.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Bin {
    face: u8,
    cell: [i16; 2],
    octave: u16,
}

impl RaySelection {
    /// No landmarks yet. Direction bins are about `angle_deg` wide; with 0 every observation is a ray.
    pub(super) fn new(angle_deg: f64) -> Self {
        Self {
            grid: (angle_deg > 0.0).then(|| (90.0 / angle_deg).max(1.0).round()),
            free: NONE,
            ..Self::default()
        }
    }

    fn bin(&self, grid: f64, position: &Point3<f64>, center: &Point3<f64>) -> Bin {
        let ray: Vector3<f64> = center - position;
        let axis = ray.iamax();
        let length = ray[axis].abs();
        let along = |k: usize| {
            // From -1 to 1 across the face of a cube.
            let share = ray[(axis + k) % 3] / length;
            ((share + 1.0) * 0.5 * grid).floor() as i16
        };
        Bin {
            face: 2 * axis as u8 + u8::from(ray[axis] < 0.0),
            cell: [along(1), along(2)],
            // The exponent of the length.
            octave: if std::env::var_os("NOOCT").is_some() { 0 } else { (ray.norm().to_bits() >> 52) as u16 },
        }
    }

    fn push(&mut self, view: ViewId, next: u32) -> u32 {
        let entry = Entry { view, next };
        if self.free == NONE {
            self.entries.push(entry);
            return (self.entries.len() - 1) as u32;
        }
        let place = self.free;
        self.free = self.entries[place as usize].next;
        self.entries[place as usize] = entry;
        place
    }

    fn release(&mut self, mut first: u32) {
        while first != NONE {
            let next = self.entries[first as usize].next;
            self.entries[first as usize].next = self.free;
            self.free = first;
            first = next;
        }
    }

    fn list(&self, mut next: u32) -> impl Iterator<Item = ViewId> + '_ {
        std::iter::from_fn(move || {
            let entry = self.entries.get(next as usize)?;
            next = entry.next;
            Some(entry.view)
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
        let empty = Lists {
            observations: NONE,
            rays: NONE,
        };
        let index = landmark as usize;
        self.lists.resize(self.lists.len().max(index + 1), empty);
        let Some(grid) = self.grid else {
            return true;
        };
        self.lists[index].observations = self.push(view, self.lists[index].observations);
        let bin = self.bin(grid, position, &center_of(view));
        let is_taken = self
            .list(self.lists[index].rays)
            .any(|other| self.bin(grid, position, &center_of(other)) == bin);
        if !is_taken {
            self.lists[index].rays = self.push(view, self.lists[index].rays);
        }
        !is_taken
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
        let mut before = std::mem::take(&mut self.views);
        before.clear();
        before.extend(self.list(lists.rays));
        self.release(lists.rays);
        let mut observations: Vec<ViewId> = self.list(lists.observations).collect();
        observations.reverse();
        self.taken.clear();
        let mut rays = NONE;
        for view in observations {
            let bin = self.bin(grid, position, &center_of(view));
            if self.taken.contains(&bin) {
                continue;
            }
            self.taken.push(bin);
            rays = self.push(view, rays);
            match before.iter().position(|other| *other == view) {
                Some(place) => {
                    before.swap_remove(place);
                }
                None => self.changes.push(RayChange::Add(view)),
            }
        }
        self.changes.extend(before.iter().map(|view| RayChange::Remove(*view)));
        self.views = before;
        self.lists[landmark as usize].rays = rays;
        &self.changes
    }

    /// Forgets a landmark that was removed.
    pub(super) fn remove(&mut self, landmark: u32) {
        if let Some(lists) = self.lists.get_mut(landmark as usize) {
            let Lists { observations, rays } = std::mem::replace(
                lists,
                Lists {
                    observations: NONE,
                    rays: NONE,
                },
            );
            self.release(observations);
            self.release(rays);
        }
    }
}
