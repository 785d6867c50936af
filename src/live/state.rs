//! What a live page shows, and the messages that bring it there.

use linecarve_mesh::LineSet;
use nalgebra::{Point3, Vector3};
use serde::Serialize;

use super::surface_copy::{SurfaceContent, SurfaceCopy};
use crate::report::growth_delta::{NumberedSurface, encode};
use crate::report::page::{
    Base64, Elements, KeyframeImage, Page, PageKeyframe, Positions, page_json,
};
use linecarve_engine::map::SurfaceChange;
use linecarve_engine::run::StageTimes;

/// Times and size after one keyframe.
#[derive(Debug, Clone, Copy, Serialize)]
pub(crate) struct KeyframeRow {
    /// Position among the keyframes of the page.
    pub(crate) keyframe: usize,
    /// Triangles of the surface.
    pub(crate) triangles: usize,
    /// Milliseconds of each stage.
    pub(crate) milliseconds: StageTimes,
}

/// What is new. Everything is in the frame of computation.
#[derive(Default)]
pub(crate) struct LiveUpdate<'a> {
    /// What is known of the run, without keyframes and surfaces.
    pub(crate) scene: Option<&'a Page>,
    /// All keyframes, when any is new or at another pose.
    pub(crate) keyframes: Option<&'a [PageKeyframe]>,
    /// The keyframe that was added last, by its position among the keyframes, and its times.
    pub(crate) current: Option<KeyframeRow>,
    /// The surface, and the change that led to it.
    pub(crate) surface: Option<(&'a dyn NumberedSurface, &'a SurfaceChange)>,
    /// Segments and clusters, or points.
    pub(crate) elements: Option<Elements<'a>>,
    /// Whether segments may have changed: else they are only added.
    pub(crate) are_segments_anew: bool,
    /// Image of the last keyframe.
    pub(crate) image: Option<KeyframeImage>,
    /// Whether the run has ended.
    pub(crate) has_ended: bool,
}

/// The state of a live page.
#[derive(Debug, Default)]
pub(super) struct LiveState {
    surface: SurfaceCopy,
    rest: Rest,
}

/// The state but for the surface.
#[derive(Debug, Clone, Default)]
struct Rest {
    scene: Option<serde_json::Value>,
    keyframes: Vec<PageKeyframe>,
    segments: Vec<[Point3<f64>; 2]>,
    clusters: Vec<Point3<f64>>,
    points: Vec<Point3<f64>>,
    rows: Vec<KeyframeRow>,
    image: Option<KeyframeImage>,
    has_ended: bool,
}

/// A copy of the state, from which a whole message is made without holding up the run.
pub(super) struct Snapshot {
    surface: SurfaceContent,
    rest: Rest,
}

/// A list of which the first `from` elements are those that the client has.
#[derive(Debug, Serialize)]
struct Tail<T> {
    from: usize,
    list: T,
}

/// What a client is sent. The fields that are missing stay as they were.
#[derive(Serialize)]
struct Message<'a> {
    /// Whether the client is to forget everything before.
    whole: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    scene: Option<&'a serde_json::Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    keyframes: Option<Tail<&'a [PageKeyframe]>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rows: Option<Tail<&'a [KeyframeRow]>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    surface: Option<SurfaceMessage>,
    #[serde(skip_serializing_if = "Option::is_none")]
    segments: Option<Tail<Positions>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    clusters: Option<Positions>,
    #[serde(skip_serializing_if = "Option::is_none")]
    points: Option<Positions>,
    #[serde(skip_serializing_if = "Option::is_none")]
    image: Option<&'a KeyframeImage>,
    ended: bool,
}

/// A change of the surface.
#[derive(Serialize)]
struct SurfaceMessage {
    /// Whether the surface before is gone.
    anew: bool,
    /// The bytes of a `.delta` file, in base64.
    delta: Base64,
}

impl SurfaceMessage {
    fn new(surface: &dyn NumberedSurface, change: &SurfaceChange) -> Self {
        let mut bytes = Vec::new();
        encode(surface, change, &Vector3::zeros(), &mut bytes);
        Self {
            anew: change.is_anew,
            delta: Base64(bytes),
        }
    }
}

impl LiveState {
    /// Takes what is new. With `wants_message` it returns the message that brings a client from the state before to this one.
    ///
    /// # Complexity
    /// Linear in what is new; clusters and points are new as a whole.
    pub(super) fn update(
        &mut self,
        update: &LiveUpdate<'_>,
        wants_message: bool,
    ) -> Option<String> {
        let rest = &mut self.rest;
        if let Some(scene) = update.scene {
            rest.scene = page_json(scene).ok();
            // They come one by one.
            if let Some(serde_json::Value::Object(fields)) = &mut rest.scene {
                fields.insert("keyframes".to_owned(), serde_json::json!([]));
            }
        }
        let mut kept = rest.keyframes.len();
        if let Some(keyframes) = update.keyframes {
            kept = (rest.keyframes.iter().zip(keyframes))
                .take_while(|(old, new)| old == new)
                .count();
            rest.keyframes.truncate(kept);
            rest.keyframes.extend_from_slice(&keyframes[kept..]);
        }
        if let Some(current) = update.current {
            // The same keyframe as of now; later ones are gone.
            while let Some(last) = rest.rows.last()
                && last.keyframe >= current.keyframe
            {
                rest.rows.pop();
            }
        }
        let known_rows = rest.rows.len();
        rest.rows.extend(update.current);
        if update.are_segments_anew {
            rest.segments.clear();
        }
        let known_segments = rest.segments.len();
        let had_points = !rest.points.is_empty();
        if let Some(elements) = update.elements {
            let known = known_segments.min(elements.segments.len());
            rest.segments.extend_from_slice(&elements.segments[known..]);
            rest.clusters = elements.clusters.map(ends).unwrap_or_default();
            rest.points = elements.points.to_vec();
        }
        if update.image.is_some() {
            rest.image.clone_from(&update.image);
        }
        rest.has_ended |= update.has_ended;
        if let Some((surface, change)) = update.surface {
            self.surface.follow(surface, change);
        }
        if !wants_message {
            return None;
        }
        let has_clusters = (update.elements).is_some_and(|elements| elements.clusters.is_some());
        let has_points = update.elements.is_some() && (had_points || !rest.points.is_empty());
        let new_segments = rest.segments[known_segments..].as_flattened();
        let message = Message {
            whole: false,
            scene: update.scene.and(rest.scene.as_ref()),
            keyframes: update.keyframes.map(|_| Tail {
                from: kept,
                list: &rest.keyframes[kept..],
            }),
            rows: update.current.map(|_| Tail {
                from: known_rows,
                list: &rest.rows[known_rows..],
            }),
            surface: update
                .surface
                .map(|(surface, change)| SurfaceMessage::new(surface, change)),
            segments: (!new_segments.is_empty() || update.are_segments_anew).then(|| Tail {
                from: known_segments,
                list: Positions::new(new_segments.iter().copied()),
            }),
            clusters: has_clusters.then(|| Positions::new(rest.clusters.iter().copied())),
            points: has_points.then(|| Positions::new(rest.points.iter().copied())),
            image: update.image.as_ref(),
            ended: rest.has_ended,
        };
        serde_json::to_string(&message).ok()
    }

    /// A copy of everything.
    pub(super) fn snapshot(&self) -> Snapshot {
        Snapshot {
            surface: self.surface.content().clone(),
            rest: self.rest.clone(),
        }
    }
}

impl Snapshot {
    /// The message that brings a client from nothing to this state.
    pub(super) fn message(&self) -> Option<String> {
        let Self { surface, rest } = self;
        let message = Message {
            whole: true,
            scene: rest.scene.as_ref(),
            keyframes: Some(Tail {
                from: 0,
                list: &rest.keyframes,
            }),
            rows: Some(Tail {
                from: 0,
                list: &rest.rows,
            }),
            surface: Some(SurfaceMessage::new(surface, &surface.change_from_nothing())),
            segments: Some(Tail {
                from: 0,
                list: Positions::new(rest.segments.iter().flatten().copied()),
            }),
            clusters: Some(Positions::new(rest.clusters.iter().copied())),
            points: Some(Positions::new(rest.points.iter().copied())),
            image: rest.image.as_ref(),
            ended: rest.has_ended,
        };
        serde_json::to_string(&message).ok()
    }
}

/// Both ends of each line.
fn ends(lines: &LineSet) -> Vec<Point3<f64>> {
    let ends = lines.lines.iter().flatten();
    ends.filter_map(|end| lines.points.get(*end as usize).copied())
        .collect()
}
