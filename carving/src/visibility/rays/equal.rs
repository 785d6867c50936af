//! Rays with equal ends, which are walked once.
//!
//! Views at one centre, and points at one position, have rays with equal ends. What a ray adds to a cell is its weight times a number that
//! depends on its ends, its standard deviation and the total weight of the rays to its point. One ray with the sum of the weights therefore
//! stands for all that have these in common.

use rustc_hash::FxHashMap;

use super::super::softness::MAX_WEIGHT;
use super::super::{ObservationId, Views};
use super::table::Rays;

/// Weights of rays that stand for others, before they did.
pub(super) struct EqualRays {
    before: Vec<(ObservationId, u32)>,
}

impl EqualRays {
    /// Moves one ray of each group of equal rays to the front and gives it the weight of all. `rays` are sorted by vertex. Also returns the
    /// number of groups.
    ///
    /// # Complexity
    ///
    /// Linear, and a sort of the rays of each vertex where views or points share a position.
    pub(super) fn join(
        table: &mut Rays,
        views: &Views,
        rays: &mut [ObservationId],
    ) -> (Self, usize) {
        let shared = Shared::new(views);
        let mut before = Vec::new();
        let (mut kept, mut begin) = (0, 0);
        while begin < rays.len() {
            let vertex = table.vertex(rays[begin]);
            let run = rays[begin..].iter();
            let end = begin + run.take_while(|ray| table.vertex(**ray) == vertex).count();
            if shared.may_be_equal(table, &rays[begin..end]) {
                let key = |table: &Rays, ray: ObservationId| {
                    let sigma = table.sigma(ray).map(f64::to_bits);
                    (shared.first(table.view(ray)), sigma, table.support(ray))
                };
                rays[begin..end].sort_unstable_by_key(|ray| (key(table, *ray), *ray));
                let mut group = None;
                for at in begin..end {
                    let (ray, weight) = (rays[at], table.weight(rays[at]));
                    let own = key(table, ray);
                    let stands = group.filter(|(of_group, _)| *of_group == own);
                    // Larger weights do not count as evidence.
                    let total = stands.and_then(|(_, (first, _))| {
                        let total = table.weight(first).checked_add(weight)?;
                        (total <= MAX_WEIGHT).then_some((first, total))
                    });
                    if let (Some((first, total)), Some((_, (_, is_noted)))) = (total, &mut group) {
                        if !std::mem::replace(is_noted, true) {
                            before.push((first, table.weight(first)));
                        }
                        table.set_weight(first, total);
                        continue;
                    }
                    group = Some((own, (ray, false)));
                    rays[kept] = ray;
                    kept += 1;
                }
            } else {
                rays.copy_within(begin..end, kept);
                kept += end - begin;
            }
            begin = end;
        }
        (Self { before }, kept)
    }

    /// Gives the rays their own weights again.
    pub(super) fn part(self, table: &mut Rays) {
        for (ray, weight) in self.before {
            table.set_weight(ray, weight);
        }
    }
}

/// Views with the centre of another view, and the first view there.
struct Shared(FxHashMap<u32, u32>);

impl Shared {
    fn new(views: &Views) -> Self {
        let mut at = FxHashMap::default();
        let mut shared = FxHashMap::default();
        for view in views.ids() {
            let first = *at
                .entry(views.center(view).map(f64::to_bits))
                .or_insert(view);
            if first != view {
                shared.insert(view, first);
            }
        }
        Self(shared)
    }

    fn first(&self, view: u32) -> u32 {
        self.0.get(&view).copied().unwrap_or(view)
    }

    /// Whether two of the rays to a vertex may be equal: a point has one ray from each view.
    fn may_be_equal(&self, table: &Rays, rays: &[ObservationId]) -> bool {
        let [first, others @ ..] = rays else {
            return false;
        };
        let point = table.point(*first);
        !others.is_empty()
            && (!self.0.is_empty() || others.iter().any(|ray| table.point(*ray) != point))
    }
}
