//! The live page of a session.

use linecarve_mesh::TriangleMesh;

use super::session_map::SessionMap;
use crate::live::{ImagePace, KeyframeRow, LiveUpdate, LiveView};
use crate::map::SurfaceChange;
use crate::report::growth_delta::NumberedSurface;
use crate::report::page::{Elements, KeyframeImage, keyframe_image};
use crate::sinks::{GrowingView, PageRun, page_of, with_elements};

/// Hands on to the live page what messages change.
pub(super) struct SessionPage {
    view: LiveView,
    outside: GrowingView,
    pace: ImagePace,
    /// Image of the newest keyframe, until it is sent.
    image: Option<KeyframeImage>,
    keyframes: usize,
}

impl SessionPage {
    pub(super) fn new(view: LiveView) -> Self {
        Self {
            view,
            outside: GrowingView::default(),
            pace: ImagePace::default(),
            image: None,
            keyframes: 0,
        }
    }

    /// Makes the image of the newest keyframe, when one is due. Images of messages are there only while the message is handled.
    pub(super) fn look(&mut self, map: &dyn SessionMap) {
        if !self.pace.is_due() {
            return;
        }
        let image = map.newest().and_then(|newest| {
            let image = map.sequence()?.load_color(newest.frame).ok()?;
            keyframe_image(newest.keyframe, &image, &newest.ends_px).ok()
        });
        self.image = image.or(self.image.take());
    }

    /// Shows the state after a message, in sessions with images; `change` is that of the surface. After a correction all segments are shown anew.
    pub(super) fn publish(
        &mut self,
        session_map: &dyn SessionMap,
        change: Option<&SurfaceChange>,
        is_correction: bool,
    ) {
        let Some(sequence) = session_map.sequence() else {
            return;
        };
        let (ids, poses): (Vec<u64>, Vec<_>) = session_map.poses().into_iter().unzip();
        let names: Vec<String> = ids.iter().map(u64::to_string).collect();
        let about = PageRun::of_session(
            sequence,
            poses,
            names.iter().map(String::as_str).collect(),
            session_map.median_depth(),
            session_map.origin(),
        );
        let mut scene = page_of(&about, "stream", &TriangleMesh::default());
        scene.title = "stream".to_owned();
        let map = session_map.map();
        self.outside.fit(session_map.keyframe_count(), map, &about);
        self.outside.apply(&mut scene);
        let surface = map.and_then(|map| map.followed_surface()).zip(change);
        let surface = surface.map(|(surface, change)| (surface as &dyn NumberedSurface, change));
        let count = session_map.keyframe_count();
        let newest = session_map.newest().filter(|_| count > self.keyframes);
        let current = newest.map(|newest| KeyframeRow {
            keyframe: newest.keyframe,
            triangles: surface.map_or(0, |(surface, _)| surface.triangle_count()),
            milliseconds: newest.times,
        });
        self.keyframes = count;
        let image = self.image.take();
        let publish = |elements: Option<Elements<'_>>| {
            self.view.publish(&LiveUpdate {
                scene: Some(&scene),
                keyframes: Some(&scene.keyframes),
                current,
                surface,
                elements,
                are_segments_anew: is_correction || change.is_some_and(|change| change.is_anew),
                image,
                ..LiveUpdate::default()
            });
        };
        match map {
            Some(map) => with_elements(map, |elements| publish(Some(elements))),
            None => publish(None),
        }
    }
}
