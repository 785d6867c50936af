//! Rays whose points get another standard deviation, or another number of rays.
//!
//! Such a ray crosses the same cells as before. What it contributes changes near its point alone, and its anchor moves.

use crate::tetrahedralization::VertexId;

use super::super::{ObservationId, Space, Sum};
use super::RayVisibility;
use super::evidence::RayEvidence;
use super::line::ShearedLine;

impl RayVisibility {
    /// Gives rays that the cells list other standard deviations; `sigma` is that of a point. Nothing else about them, and no cell, may
    /// have changed since they were added.
    ///
    /// # Complexity
    ///
    /// Linear in the number of cells crossed; sums change near the points only.
    pub(crate) fn resoften(
        &mut self,
        space: &mut Space<'_>,
        rays: &[ObservationId],
        sigma: impl Fn(u32) -> Option<f64>,
    ) {
        let (tetrahedra, views) = (space.tetrahedra, space.views);
        for &ray in rays {
            let vertex = self.table.vertex(ray);
            let sigma = sigma(self.table.point(ray));
            if let Some(softness) = self.softness {
                let target = VertexId::from_index(vertex as usize);
                let ends = [
                    views.center(self.table.view(ray)),
                    tetrahedra.coordinates(target),
                ];
                let weights = [self.table.weight(ray), self.table.support(ray)];
                let before = self.table.sigma(ray);
                let [before, after] =
                    [before, sigma].map(|sigma| RayEvidence::new(ends, sigma, weights, softness));
                self.exchange_evidence(space, ray, [before, after]);
                if let Some(cell) = self.anchors.detach(ray.0) {
                    let weight = before.anchor_weight();
                    let evidence = &mut space.cells.evidence;
                    evidence.change(cell, Sum::Occupied, |sum| sum - weight);
                }
            }
            self.table.set_end(ray, vertex, sigma);
            self.attach(space, ray);
        }
    }

    /// Follows a change of the total weight of the rays to points: what lies behind these counts more or less. The rays are listed by the
    /// cells.
    ///
    /// # Complexity
    ///
    /// Linear in the number of rays.
    pub(crate) fn reweigh(&mut self, space: &mut Space<'_>, rays: &[ObservationId]) {
        for &ray in rays {
            let weight = |rays: &Self, space: &Space<'_>| {
                let evidence = rays.walker(space).evidence(ray);
                evidence.map_or(0, |evidence| evidence.anchor_weight())
            };
            let before = weight(self, space);
            self.table.update_support(ray);
            let after = weight(self, space);
            if before != after
                && let Some(cell) = self.anchors.cell(ray.0)
            {
                let evidence = &mut space.cells.evidence;
                evidence.change(cell, Sum::Occupied, |sum| sum - before + after);
            }
        }
    }

    /// Replaces what a ray contributes to the cells that it crosses, but for its anchor.
    fn exchange_evidence(
        &mut self,
        space: &mut Space<'_>,
        ray: ObservationId,
        [before, after]: [RayEvidence<'_>; 2],
    ) {
        let tetrahedra = space.tetrahedra;
        let mut walk = std::mem::take(&mut self.walk);
        let walker = self.walker(space);
        walk.steps.clear();
        let is_strict = !self.table.is_degenerate(ray)
            && walker.last_cell(ray).is_ok_and(|last| {
                let [center, target] = before.ends();
                let far = before.far().farther(after.far());
                let line = ShearedLine::new(center, target, Some(far));
                let steps = &mut walk.steps;
                let walked = walker.follow_from_vertex(&line, (ray, None), last, |_| true, steps);
                walked.is_ok()
            });
        if !is_strict {
            walker.walk(ray, None, &mut walk);
            for step in &mut walk.steps {
                step.is_far = false;
            }
        }
        for step in walk.steps.iter().filter(|step| !step.is_far) {
            let [before, after] =
                [before, after].map(|it| it.passage(tetrahedra, step.cell, step.exit));
            if before != after
                && let Some(sum) = Sum::of_exit(step.exit)
            {
                let evidence = &mut space.cells.evidence;
                evidence.change(step.cell, sum, |sum| sum - before + after);
            }
        }
        self.walk = walk;
    }
}
