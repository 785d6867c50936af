//! The table of rays, listed by view and by point.

use super::super::ObservationId;
use crate::growth::reserve;

const NONE: u32 = u32::MAX;
/// The bit of `RayRecord::view` that marks degenerate rays.
const DEGENERATE: u32 = 1 << 31;

/// What walks need of a ray: 24 bytes, mostly of one cache line.
#[derive(Clone, Copy, Debug)]
struct RayRecord {
    /// Standard deviation of the point, negative where it has none.
    sigma: f64,
    /// The view; the highest bit is set while the ray may meet an edge or a vertex on its way.
    view: u32,
    vertex: u32,
    weight: u32,
    /// Total weight of the rays to the point.
    support: u32,
}

/// Stands for no standard deviation.
const NO_SIGMA: f64 = -1.0;

/// Doubly linked lists through the rays of a point and of a view.
#[derive(Clone, Copy, Debug)]
struct Links {
    point: u32,
    of_point: [u32; 2],
    of_view: [u32; 2],
}

/// Rays with their view, point, vertex, standard deviation and weight.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rays {
    records: Vec<RayRecord>,
    links: Vec<Links>,
    first_of_point: Vec<u32>,
    first_of_view: Vec<u32>,
    free: Vec<u32>,
    /// Number of old numbers in use.
    renumbered: usize,
}

impl Rays {
    /// Largest number of views.
    pub(crate) const MAX_VIEWS: usize = (DEGENERATE - 1) as usize;

    /// Length of an array indexed by ray.
    pub(crate) fn capacity(&self) -> usize {
        self.records.len()
    }

    /// The vertex at which a ray ends.
    #[inline]
    pub(crate) fn vertex(&self, ray: ObservationId) -> u32 {
        self.records[ray.0 as usize].vertex
    }

    /// Whether the ray may meet an edge or a vertex, or run inside a facet.
    ///
    /// While it is false, the ray passes between the cells that list it through the interior of facets only.
    #[inline]
    pub(crate) fn is_degenerate(&self, ray: ObservationId) -> bool {
        self.records[ray.0 as usize].view & DEGENERATE != 0
    }

    /// Takes a ray out of the lists of its point and its view.
    fn unlink(&mut self, ray: ObservationId) {
        let view = self.view(ray);
        let Links {
            point,
            of_point,
            of_view,
        } = self.links[ray.0 as usize];
        match of_point[0] {
            NONE => self.first_of_point[point as usize] = of_point[1],
            before => self.links[before as usize].of_point[1] = of_point[1],
        }
        if of_point[1] != NONE {
            self.links[of_point[1] as usize].of_point[0] = of_point[0];
        }
        match of_view[0] {
            NONE => self.first_of_view[view as usize] = of_view[1],
            before => self.links[before as usize].of_view[1] = of_view[1],
        }
        if of_view[1] != NONE {
            self.links[of_view[1] as usize].of_view[0] = of_view[0];
        }
    }

    /// Gives a ray another number. The old one is in use until it is [released](Self::release).
    pub(super) fn renumber(&mut self, ray: ObservationId) -> ObservationId {
        let (view, point, weight) = (self.view(ray), self.point(ray), self.weight(ray));
        let (vertex, sigma, support) = (self.vertex(ray), self.sigma(ray), self.support(ray));
        self.unlink(ray);
        let new = self.insert(view, point, weight);
        self.set_end(new, vertex, sigma);
        self.set_support(new, support);
        self.renumbered += 1;
        new
    }

    /// Makes old numbers of rays those of the next rays.
    pub(super) fn release(&mut self, numbers: &mut Vec<u32>) {
        self.renumbered -= numbers.len();
        self.free.append(numbers);
    }

    pub(crate) fn set_degenerate(&mut self, ray: ObservationId, degenerate: bool) {
        let view = &mut self.records[ray.0 as usize].view;
        *view = if degenerate {
            *view | DEGENERATE
        } else {
            *view & !DEGENERATE
        };
    }

    /// Number of rays.
    pub(crate) fn len(&self) -> usize {
        self.records.len() - self.free.len() - self.renumbered
    }

    /// All rays, view by view.
    pub(crate) fn all(&self) -> impl Iterator<Item = ObservationId> + '_ {
        (0..self.first_of_view.len() as u32).flat_map(|view| self.of_view(view))
    }

    /// The rays to a point, latest first.
    pub(crate) fn of_point(&self, point: u32) -> impl Iterator<Item = ObservationId> + '_ {
        let mut next = self
            .first_of_point
            .get(point as usize)
            .copied()
            .unwrap_or(NONE);
        std::iter::from_fn(move || {
            let ray = next;
            next = self.links.get(ray as usize)?.of_point[1];
            Some(ObservationId(ray))
        })
    }

    /// The rays from a view, latest first.
    pub(crate) fn of_view(&self, view: u32) -> impl Iterator<Item = ObservationId> + '_ {
        let mut next = self
            .first_of_view
            .get(view as usize)
            .copied()
            .unwrap_or(NONE);
        std::iter::from_fn(move || {
            let ray = next;
            next = self.links.get(ray as usize)?.of_view[1];
            Some(ObservationId(ray))
        })
    }

    /// The ray from a view to a point. Linear in the number of rays to the point.
    pub(crate) fn find(&self, view: u32, point: u32) -> Option<ObservationId> {
        self.of_point(point).find(|&ray| self.view(ray) == view)
    }

    #[inline]
    pub(crate) fn view(&self, ray: ObservationId) -> u32 {
        self.records[ray.0 as usize].view & !DEGENERATE
    }

    #[inline]
    pub(crate) fn point(&self, ray: ObservationId) -> u32 {
        self.links[ray.0 as usize].point
    }

    /// Standard deviation of the point along the ray.
    #[inline]
    pub(crate) fn sigma(&self, ray: ObservationId) -> Option<f64> {
        let sigma = self.records[ray.0 as usize].sigma;
        (sigma >= 0.0).then_some(sigma)
    }

    #[inline]
    pub(crate) fn weight(&self, ray: ObservationId) -> u32 {
        self.records[ray.0 as usize].weight
    }

    /// Total weight of the rays to the point of a ray, as of the last [update](Self::update_support).
    #[inline]
    pub(crate) fn support(&self, ray: ObservationId) -> u32 {
        self.records[ray.0 as usize].support
    }

    pub(crate) fn set_support(&mut self, ray: ObservationId, support: u32) {
        self.records[ray.0 as usize].support = support;
    }

    /// Notes the total weight of the rays to the point of a ray.
    pub(crate) fn update_support(&mut self, ray: ObservationId) {
        self.set_support(ray, self.total_weight(self.point(ray)));
    }

    /// Total weight of the rays to a point. Linear in their number.
    pub(crate) fn total_weight(&self, point: u32) -> u32 {
        let weights = self.of_point(point).map(|ray| self.weight(ray));
        weights.fold(0, u32::saturating_add)
    }

    pub(crate) fn insert(&mut self, view: u32, point: u32, weight: u32) -> ObservationId {
        let grow = |firsts: &mut Vec<u32>, index: u32| {
            if firsts.len() <= index as usize {
                firsts.resize(index as usize + 1, NONE);
            }
        };
        grow(&mut self.first_of_point, point);
        grow(&mut self.first_of_view, view);
        let record = RayRecord {
            sigma: NO_SIGMA,
            view,
            vertex: NONE,
            weight,
            support: weight,
        };
        let links = Links {
            point,
            of_point: [NONE, self.first_of_point[point as usize]],
            of_view: [NONE, self.first_of_view[view as usize]],
        };
        let ray = if let Some(slot) = self.free.pop() {
            self.records[slot as usize] = record;
            self.links[slot as usize] = links;
            slot
        } else {
            reserve(&mut self.records, 1);
            reserve(&mut self.links, 1);
            self.records.push(record);
            self.links.push(links);
            (self.records.len() - 1) as u32
        };
        if links.of_point[1] != NONE {
            self.links[links.of_point[1] as usize].of_point[0] = ray;
        }
        if links.of_view[1] != NONE {
            self.links[links.of_view[1] as usize].of_view[0] = ray;
        }
        self.first_of_point[point as usize] = ray;
        self.first_of_view[view as usize] = ray;
        ObservationId(ray)
    }

    pub(crate) fn remove(&mut self, ray: ObservationId) {
        self.unlink(ray);
        self.free.push(ray.0);
    }

    pub(crate) fn set_end(&mut self, ray: ObservationId, vertex: u32, sigma: Option<f64>) {
        let record = &mut self.records[ray.0 as usize];
        record.vertex = vertex;
        record.sigma = sigma.unwrap_or(NO_SIGMA);
    }

    pub(crate) fn set_weight(&mut self, ray: ObservationId, weight: u32) {
        self.records[ray.0 as usize].weight = weight;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_are_found_by_view_and_by_point() {
        let mut rays = Rays::default();
        let ids: Vec<ObservationId> = (0..12).map(|i| rays.insert(i % 3, i / 3, 1)).collect();
        assert_eq!(rays.of_view(1).count(), 4);
        assert_eq!(rays.of_point(2).count(), 3);
        assert_eq!(rays.find(2, 1), Some(ids[5]));
        rays.remove(ids[5]);
        rays.remove(ids[0]);
        assert_eq!(rays.find(2, 1), None);
        assert_eq!((rays.of_view(2).count(), rays.of_point(1).count()), (3, 2));
        assert_eq!((rays.len(), rays.all().count()), (10, 10));
        assert_eq!(rays.insert(0, 7, 4), ids[0]);
        rays.set_degenerate(ids[0], true);
        assert_eq!((rays.view(ids[0]), rays.is_degenerate(ids[0])), (0, true));
    }
}
