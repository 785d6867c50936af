//! The table of rays, listed per view and per point.

/// An observation as the crossing lists know it. Ids of removed rays are given out again.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub(crate) struct RayId(pub(crate) u32);

const NONE: u32 = u32::MAX;
const HALF: u32 = 1 << 31;

/// What walks need of a ray: 12 bytes.
#[derive(Clone, Copy, Debug)]
struct Hot {
    /// The view; the highest bit is set while the ray may meet an edge or a vertex on its way.
    view: u32,
    vertex: u32,
    weight: u32,
}

/// Doubly linked lists through the rays of a point and of a view.
#[derive(Clone, Copy, Debug)]
struct Links {
    point: u32,
    of_point: [u32; 2],
    of_view: [u32; 2],
}

/// Rays with their view, point, vertex and weight.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rays {
    hot: Vec<Hot>,
    links: Vec<Links>,
    first_of_point: Vec<u32>,
    first_of_view: Vec<u32>,
    free: Vec<u32>,
}

impl Rays {
    /// Number of views that ids can tell apart.
    pub(crate) const MAX_VIEWS: usize = (HALF - 1) as usize;

    /// Number of rays.
    pub(crate) fn len(&self) -> usize {
        self.hot.len() - self.free.len()
    }

    /// Length of an array indexed by ray.
    pub(crate) fn capacity(&self) -> usize {
        self.hot.len()
    }

    /// The view of a ray.
    #[inline]
    pub(crate) fn view(&self, ray: RayId) -> u32 {
        self.hot[ray.0 as usize].view & !HALF
    }

    /// The point of a ray.
    #[inline]
    pub(crate) fn point(&self, ray: RayId) -> u32 {
        self.links[ray.0 as usize].point
    }

    /// The vertex at which a ray ends.
    #[inline]
    pub(crate) fn vertex(&self, ray: RayId) -> u32 {
        self.hot[ray.0 as usize].vertex
    }

    /// The weight of a ray.
    #[inline]
    pub(crate) fn weight(&self, ray: RayId) -> u32 {
        self.hot[ray.0 as usize].weight
    }

    /// Whether the ray may meet an edge or a vertex, or run inside a facet.
    ///
    /// While it is false, the ray passes between the cells that list it through the interior of facets only.
    #[inline]
    pub(crate) fn is_degenerate(&self, ray: RayId) -> bool {
        self.hot[ray.0 as usize].view & HALF != 0
    }

    pub(crate) fn set_degenerate(&mut self, ray: RayId, degenerate: bool) {
        let view = &mut self.hot[ray.0 as usize].view;
        *view = if degenerate {
            *view | HALF
        } else {
            *view & !HALF
        };
    }

    pub(crate) fn set_vertex(&mut self, ray: RayId, vertex: u32) {
        self.hot[ray.0 as usize].vertex = vertex;
    }

    pub(crate) fn set_weight(&mut self, ray: RayId, weight: u32) {
        self.hot[ray.0 as usize].weight = weight;
    }

    /// Adds a ray. The vertex is that of the point.
    pub(crate) fn add(&mut self, view: u32, point: u32, vertex: u32, weight: u32) -> RayId {
        let grow = |firsts: &mut Vec<u32>, index: u32| {
            if firsts.len() <= index as usize {
                firsts.resize(index as usize + 1, NONE);
            }
        };
        grow(&mut self.first_of_point, point);
        grow(&mut self.first_of_view, view);
        let hot = Hot {
            view,
            vertex,
            weight,
        };
        let links = Links {
            point,
            of_point: [NONE, self.first_of_point[point as usize]],
            of_view: [NONE, self.first_of_view[view as usize]],
        };
        let ray = if let Some(slot) = self.free.pop() {
            self.hot[slot as usize] = hot;
            self.links[slot as usize] = links;
            slot
        } else {
            self.hot.push(hot);
            self.links.push(links);
            (self.hot.len() - 1) as u32
        };
        if links.of_point[1] != NONE {
            self.links[links.of_point[1] as usize].of_point[0] = ray;
        }
        if links.of_view[1] != NONE {
            self.links[links.of_view[1] as usize].of_view[0] = ray;
        }
        self.first_of_point[point as usize] = ray;
        self.first_of_view[view as usize] = ray;
        RayId(ray)
    }

    /// Removes a ray.
    pub(crate) fn remove(&mut self, ray: RayId) {
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
        self.free.push(ray.0);
    }

    /// The rays to a point, latest first.
    pub(crate) fn of_point(&self, point: u32) -> impl Iterator<Item = RayId> + '_ {
        let mut next = self
            .first_of_point
            .get(point as usize)
            .copied()
            .unwrap_or(NONE);
        std::iter::from_fn(move || {
            let ray = next;
            next = self.links.get(ray as usize)?.of_point[1];
            Some(RayId(ray))
        })
    }

    /// The rays from a view, latest first.
    pub(crate) fn of_view(&self, view: u32) -> impl Iterator<Item = RayId> + '_ {
        let mut next = self
            .first_of_view
            .get(view as usize)
            .copied()
            .unwrap_or(NONE);
        std::iter::from_fn(move || {
            let ray = next;
            next = self.links.get(ray as usize)?.of_view[1];
            Some(RayId(ray))
        })
    }

    /// The ray from a view to a point; linear in the number of rays to the point.
    pub(crate) fn find(&self, view: u32, point: u32) -> Option<RayId> {
        self.of_point(point).find(|&ray| self.view(ray) == view)
    }

    /// All rays in use, view by view.
    pub(crate) fn all(&self) -> impl Iterator<Item = RayId> + '_ {
        (0..self.first_of_view.len() as u32).flat_map(|view| self.of_view(view))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_are_found_by_view_and_by_point() {
        let mut rays = Rays::default();
        let ids: Vec<RayId> = (0..12).map(|i| rays.add(i % 3, i / 3, i / 3, 1)).collect();
        assert_eq!(rays.of_view(1).count(), 4);
        assert_eq!(rays.of_point(2).count(), 3);
        assert_eq!(rays.find(2, 1), Some(ids[5]));
        rays.remove(ids[5]);
        rays.remove(ids[0]);
        assert_eq!(rays.find(2, 1), None);
        assert_eq!((rays.of_view(2).count(), rays.of_point(1).count()), (3, 2));
        assert_eq!((rays.len(), rays.all().count()), (10, 10));
        assert_eq!(rays.add(0, 7, 9, 4), ids[0]);
        rays.set_degenerate(ids[0], true);
        assert_eq!((rays.view(ids[0]), rays.is_degenerate(ids[0])), (0, true));
    }
}
