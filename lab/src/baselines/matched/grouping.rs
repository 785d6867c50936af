//! Groups of segments of several views whose 3D hypotheses agree.

use nalgebra::{Point3, Vector3};

use super::matching::ViewMatches;
use super::neighbours::median;
use super::options::MatchedOptions;
use super::view::View;

/// A segment of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Member {
    pub(super) view: u32,
    pub(super) segment: u32,
}

/// The 3D hypothesis of each segment of each view.
#[derive(Debug, Clone)]
pub(super) struct Hypotheses {
    /// Number of the first segment of each view among all.
    starts: Vec<u32>,
    members: Vec<Member>,
    distances: Vec<Option<[f64; 2]>>,
    /// The median distance of each view's segments, at most that of the scene: sigma_p is constant beyond it.
    cutoffs: Vec<f64>,
}

impl Hypotheses {
    pub(super) fn new(views: &[View], best: Vec<Vec<Option<[f64; 2]>>>) -> Self {
        let medians: Vec<Option<f64>> = best
            .iter()
            .map(|view| median(view.iter().flatten().flatten().copied()))
            .collect();
        let scene = median(medians.iter().flatten().copied()).unwrap_or(f64::INFINITY);
        let mut starts = Vec::with_capacity(views.len());
        let mut members = Vec::new();
        for (view, segments) in best.iter().enumerate() {
            starts.push(members.len() as u32);
            members.extend((0..segments.len()).map(|segment| Member {
                view: view as u32,
                segment: segment as u32,
            }));
        }
        Self {
            starts,
            members,
            distances: best.into_iter().flatten().collect(),
            cutoffs: medians
                .into_iter()
                .map(|median| median.unwrap_or(scene).min(scene))
                .collect(),
        }
    }

    fn number(&self, member: Member) -> u32 {
        self.starts[member.view as usize] + member.segment
    }

    /// The 3D ends of a segment; `None` without a hypothesis.
    pub(super) fn ends(&self, views: &[View], member: Member) -> Option<[Point3<f64>; 2]> {
        let distances = self.distances[self.number(member) as usize]?;
        Some(views[member.view as usize].ends_at(member.segment, distances))
    }
}

/// A segment in space, with the terms of the similarity.
struct SpatialSegment {
    ends: [Point3<f64>; 2],
    direction: Vector3<f64>,
    /// Twice the variance of each end.
    spread: [f64; 2],
}

fn spatial_segment(
    views: &[View],
    hypotheses: &Hypotheses,
    member: Member,
) -> Option<SpatialSegment> {
    let distances = hypotheses.distances[hypotheses.number(member) as usize]?;
    let view = &views[member.view as usize];
    let ends = view.ends_at(member.segment, distances);
    let cutoff = hypotheses.cutoffs[member.view as usize];
    Some(SpatialSegment {
        ends,
        direction: (ends[1] - ends[0]).try_normalize(0.0)?,
        spread: distances.map(|d| 2.0 * (view.sigma * d.min(cutoff)).powi(2)),
    })
}

/// Similarity of two segments in space, 0 to 1: 1 on one line.
fn similarity(a: &SpatialSegment, b: &SpatialSegment, options: &MatchedOptions) -> f64 {
    let angle = a.direction.dot(&b.direction).abs().min(1.0).acos();
    let mut exponent = angle * angle / (2.0 * options.angle_sigma_rad.powi(2));
    for (line, other) in [(a, b), (b, a)] {
        for end in 0..2 {
            let offset = (other.ends[end] - line.ends[0]).cross(&line.direction);
            exponent = exponent.max(offset.norm_squared() / other.spread[end]);
        }
    }
    (-exponent).exp()
}

/// Groups of at least the minimum number of views, in the order of their first members; members in order.
///
/// # Reference
/// P. F. Felzenszwalb, D. P. Huttenlocher, Efficient Graph-Based Image Segmentation, International Journal of Computer
/// Vision, 2004: two groups are joined when the edge between them is no more dissimilar than either is within
/// itself, with an allowance of 3 over its size.
pub(super) fn group(
    views: &[View],
    matches: &[ViewMatches],
    hypotheses: &Hypotheses,
    options: &MatchedOptions,
) -> Vec<Vec<Member>> {
    let mut edges = Vec::new();
    for (number, &member) in hypotheses.members.iter().enumerate() {
        let Some(own) = spatial_segment(views, hypotheses, member) else {
            continue;
        };
        for found in matches[member.view as usize].of(member.segment as usize) {
            let other = Member {
                view: found.view,
                segment: found.segment,
            };
            let Some(target) = spatial_segment(views, hypotheses, other) else {
                continue;
            };
            let affinity = similarity(&own, &target, options);
            if affinity > options.minimum_affinity {
                let (a, b) = (number as u32, hypotheses.number(other));
                edges.push((1.0 - affinity, a.min(b), a.max(b)));
            }
        }
    }
    edges.sort_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    edges.dedup();

    let mut groups = Groups::new(hypotheses.members.len());
    for (dissimilarity, a, b) in edges {
        groups.join(a, b, dissimilarity);
    }
    collect(hypotheses, &mut groups, options)
}

fn collect(
    hypotheses: &Hypotheses,
    groups: &mut Groups,
    options: &MatchedOptions,
) -> Vec<Vec<Member>> {
    let count = hypotheses.members.len();
    let mut index_of_root: Vec<Option<u32>> = vec![None; count];
    let mut found: Vec<Vec<Member>> = Vec::new();
    for number in 0..count {
        let root = groups.root(number as u32) as usize;
        if (groups.sizes[root] as usize) < options.minimum_views {
            continue;
        }
        let index = *index_of_root[root].get_or_insert_with(|| {
            found.push(Vec::new());
            found.len() as u32 - 1
        });
        found[index as usize].push(hypotheses.members[number]);
    }
    // Members are in the order of views, so that equal views are neighbours.
    found.retain(|members| {
        let changes = members.windows(2).filter(|w| w[0].view != w[1].view);
        changes.count() + 1 >= options.minimum_views
    });
    found
}

/// Disjoint sets with the largest dissimilarity that each allows.
struct Groups {
    parents: Vec<u32>,
    sizes: Vec<u32>,
    allowances: Vec<f64>,
}

/// Allowance of a group, divided by its size.
const ALLOWANCE: f64 = 3.0;

impl Groups {
    fn new(count: usize) -> Self {
        Self {
            parents: (0..count as u32).collect(),
            sizes: vec![1; count],
            allowances: vec![ALLOWANCE; count],
        }
    }

    fn root(&mut self, mut node: u32) -> u32 {
        while self.parents[node as usize] != node {
            let above = self.parents[self.parents[node as usize] as usize];
            self.parents[node as usize] = above;
            node = above;
        }
        node
    }

    fn join(&mut self, a: u32, b: u32, dissimilarity: f64) {
        let (a, b) = (self.root(a), self.root(b));
        let limit = self.allowances[a as usize].min(self.allowances[b as usize]);
        if a == b || dissimilarity > limit {
            return;
        }
        let (into, from) = if self.sizes[a as usize] >= self.sizes[b as usize] {
            (a, b)
        } else {
            (b, a)
        };
        self.parents[from as usize] = into;
        self.sizes[into as usize] += self.sizes[from as usize];
        self.allowances[into as usize] =
            dissimilarity + ALLOWANCE / f64::from(self.sizes[into as usize]);
    }
}
