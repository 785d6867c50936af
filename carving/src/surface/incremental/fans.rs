//! Fans: triangles around a vertex that hang together by edges. Each is a vertex of the mesh.

use super::NONE;
use super::locate::Located;
use super::splits::EdgeGroup;
use super::update::Update;
use crate::tetrahedralization::VertexId;

impl Update<'_> {
    /// Gives each fan around a vertex its mesh vertex, and lists the edges at the vertex.
    pub(super) fn settle_fans(&mut self, vertex: VertexId) {
        let mut around = std::mem::take(&mut self.around);
        self.surroundings.list(self.carved, vertex, &mut around);
        let records = &mut self.mesh.records;
        around.retain(|located| {
            records.get_mut(&located.corners).is_some_and(|record| {
                let corner = corner_at(located, vertex);
                let has_corner = record.exported().has_corner(corner);
                if !has_corner {
                    record.corners[corner] = NONE;
                }
                has_corner
            })
        });
        let mut fans = std::mem::take(&mut self.fans);
        fans.clear();
        if self.mesh.manifold {
            fans.extend(0..around.len());
            self.join_fans(vertex, &around, &mut fans);
        } else {
            fans.resize(around.len(), 0);
        }
        self.number_fans(vertex, &around, &fans);
        self.around = around;
        self.fans = fans;
    }

    /// Joins the triangles that share an edge at the vertex; `fans` holds the smallest member of the fan of each.
    fn join_fans(&mut self, vertex: VertexId, around: &[Located], fans: &mut [usize]) {
        let mut has_partner = vec![false; around.len()];
        for (index, located) in around.iter().enumerate() {
            let k = corner_at(located, vertex);
            if !self.has_edge(located, k) {
                continue;
            }
            let partner = self.carved.across(located, k);
            let partner = partner.and_then(|partner| around.iter().position(|it| *it == partner));
            let partner = partner.filter(|partner| {
                let partner = &around[*partner];
                self.has_edge(partner, (corner_at(partner, vertex) + 2) % 3)
            });
            let other = partner.map(|partner| {
                has_partner[partner] = true;
                let (low, high) = (
                    fans[index].min(fans[partner]),
                    fans[index].max(fans[partner]),
                );
                for fan in fans.iter_mut().filter(|fan| **fan == high) {
                    *fan = low;
                }
                (
                    around[partner].corners,
                    (corner_at(&around[partner], vertex) + 2) % 3,
                )
            });
            self.edges.push(EdgeGroup {
                at: vertex,
                one: (located.corners, k),
                other,
            });
        }
        // Border edges that end at the vertex.
        for (located, _) in around.iter().zip(has_partner).filter(|(_, has)| !has) {
            let edge = (corner_at(located, vertex) + 2) % 3;
            if self.has_edge(located, edge) {
                self.edges.push(EdgeGroup {
                    at: vertex,
                    one: (located.corners, edge),
                    other: None,
                });
            }
        }
    }

    /// Whether the edge that starts at a corner of a triangle is exported.
    fn has_edge(&self, located: &Located, edge: usize) -> bool {
        let record = self.mesh.records.get(&located.corners);
        record.is_some_and(|record| record.exported().has_edge(edge))
    }

    /// Chooses a mesh vertex for each fan: one that a triangle of the fan had, else one that no fan needs any more, else a new
    /// one.
    fn number_fans(&mut self, vertex: VertexId, around: &[Located], fans: &[usize]) {
        let mut numbers = vec![NONE; around.len()];
        let mut taken: Vec<u32> = Vec::new();
        for fan in (0..around.len()).filter(|&index| fans[index] == index) {
            let members = (0..around.len()).filter(|&index| fans[index] == fan);
            let known = members.filter_map(|index| {
                let known = self.corner(&around[index], vertex);
                (known != NONE && !taken.contains(&known)).then_some(known)
            });
            if let Some(known) = known.min() {
                numbers[fan] = known;
                taken.push(known);
            }
        }
        for fan in (0..around.len()).filter(|&index| fans[index] == index) {
            if numbers[fan] == NONE {
                let copies = self.mesh.vertices.copies(vertex);
                let spare = copies.filter(|copy| !taken.contains(copy)).min();
                numbers[fan] = spare.unwrap_or_else(|| self.add_vertex(Some(vertex)));
                taken.push(numbers[fan]);
            }
        }
        for (located, fan) in around.iter().zip(fans) {
            let k = corner_at(located, vertex);
            if let Some(record) = self.mesh.records.get_mut(&located.corners)
                && std::mem::replace(&mut record.corners[k], numbers[*fan]) != numbers[*fan]
            {
                self.stale.push(located.corners);
            }
        }
    }

    /// The mesh vertex of a triangle at a vertex before the update.
    fn corner(&self, located: &Located, vertex: VertexId) -> u32 {
        let record = self.mesh.records.get(&located.corners);
        record.map_or(NONE, |record| record.corners[corner_at(located, vertex)])
    }
}

/// Which corner of a triangle a vertex is.
fn corner_at(located: &Located, vertex: VertexId) -> usize {
    let at = located.corners.iter().position(|corner| *corner == vertex);
    at.expect("a triangle around a vertex has it as a corner")
}
