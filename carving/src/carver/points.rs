//! The table of points and how many of them share a vertex.

/// Marks a point that has no vertex yet.
pub(super) const NO_VERTEX: u32 = u32::MAX;

/// A point in use.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    pub(super) position: [f64; 3],
    /// [`NO_VERTEX`] while the carver defers.
    pub(super) vertex: u32,
}

/// Points by id; the entry of a removed point is never used again.
#[derive(Clone, Debug, Default)]
pub(super) struct Points {
    records: Vec<Option<Point>>,
    alive: usize,
    /// Standard deviations of points that have one; shorter than `records` where the last have none.
    sigmas: Vec<Option<f64>>,
    /// Per vertex the number of points there.
    users: Vec<u32>,
}

impl Points {
    /// Number of points in use.
    pub(super) fn len(&self) -> usize {
        self.alive
    }

    /// Number of ids given out.
    pub(super) fn capacity(&self) -> usize {
        self.records.len()
    }

    pub(super) fn get(&self, point: u32) -> Option<&Point> {
        self.records.get(point as usize)?.as_ref()
    }

    /// Ids in use, increasing.
    pub(super) fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.records.len() as u32).filter(|&p| self.get(p).is_some())
    }

    /// Standard deviation of a point in use.
    pub(super) fn sigma(&self, point: u32) -> Option<f64> {
        self.get(point)?;
        *self.sigmas.get(point as usize)?
    }

    pub(super) fn set_sigma(&mut self, point: u32, sigma: Option<f64>) {
        if self.sigmas.len() <= point as usize {
            self.sigmas.resize(point as usize + 1, None);
        }
        self.sigmas[point as usize] = sigma;
    }

    /// Gives out an id for a point that gets its vertex later.
    pub(super) fn reserve_id(&mut self) -> u32 {
        self.records.push(None);
        (self.records.len() - 1) as u32
    }

    /// Puts a point, new or detached, at a vertex.
    pub(super) fn attach(&mut self, point: u32, position: [f64; 3], vertex: u32) {
        self.put(point, position);
        self.set_vertex(point, vertex);
    }

    /// Puts a point, new or removed, at a position without a vertex.
    pub(super) fn put(&mut self, point: u32, position: [f64; 3]) {
        self.records[point as usize] = Some(Point {
            position,
            vertex: NO_VERTEX,
        });
        self.alive += 1;
    }

    /// Removes a point, whether or not it has a vertex.
    pub(super) fn remove(&mut self, point: u32) {
        let record = self.records[point as usize].take();
        self.alive -= usize::from(record.is_some());
    }

    /// Forgets the vertices of all points.
    pub(super) fn forget_vertices(&mut self) {
        for record in self.records.iter_mut().flatten() {
            record.vertex = NO_VERTEX;
        }
        self.users.clear();
    }

    /// Gives a point its vertex.
    pub(super) fn set_vertex(&mut self, point: u32, vertex: u32) {
        if let Some(record) = &mut self.records[point as usize] {
            record.vertex = vertex;
        }
        if self.users.len() <= vertex as usize {
            self.users.resize(vertex as usize + 1, 0);
        }
        self.users[vertex as usize] += 1;
    }

    /// Takes a point from its vertex, which is returned with the number of points that remain there.
    pub(super) fn detach(&mut self, point: u32) -> Option<(u32, u32)> {
        let record = self.records[point as usize].take()?;
        self.alive -= 1;
        let users = &mut self.users[record.vertex as usize];
        *users -= 1;
        Some((record.vertex, *users))
    }
}
