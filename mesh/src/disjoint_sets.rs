//! Disjoint sets (union-find).

/// Disjoint sets of the numbers below a limit.
///
/// # Reference
/// R. Tarjan, *Efficiency of a good but not linear set union algorithm*, JACM 22(2), 1975; with path halving.
pub struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    /// Sets of one number each.
    pub fn new(count: usize) -> Self {
        Self {
            parent: (0..count as u32).collect(),
        }
    }

    /// The representative of a number's set: its smallest member.
    pub fn find(&mut self, mut member: u32) -> u32 {
        while self.parent[member as usize] != member {
            let grandparent = self.parent[self.parent[member as usize] as usize];
            self.parent[member as usize] = grandparent;
            member = grandparent;
        }
        member
    }

    /// Joins the sets of two numbers.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    /// Number of sets.
    pub fn count(&self) -> usize {
        let is_root = |(member, parent): &(usize, &u32)| *member == **parent as usize;
        self.parent.iter().enumerate().filter(is_root).count()
    }
}
