//! The live page of a run over a recording.

use super::page::{GrowingView, page_of, with_elements};
use super::page_run::PageRun;
use crate::live::{ImagePace, KeyframeRow, LiveUpdate, LiveView};
use crate::report::growth_delta::NumberedSurface;
use crate::report::page::{KeyframeImage, Page, keyframe_image};
use linecarve_engine::front_end::Keyframe;
use linecarve_engine::map::{Map, SurfaceChange};
use linecarve_engine::{KeyframeUpdate, Reconstruction, Recording, Sink, SinkError};
use linecarve_mesh::TriangleMesh;

/// Hands on to the live page what keyframes change.
pub(crate) struct LiveSink {
    view: LiveView,
    command: &'static str,
    outside: GrowingView,
    pace: ImagePace,
    /// The last keyframe and the ends of its segments, while its image was not sent.
    without_image: Option<(usize, Vec<[[f64; 2]; 2]>)>,
}

impl LiveSink {
    /// Shows a run that is about to begin.
    pub(crate) fn new(view: LiveView, run: &Reconstruction, command: &'static str) -> Self {
        let about = PageRun::new(run.recording(), run.map());
        let scene = page_of(&about, command, &TriangleMesh::default());
        view.publish(&LiveUpdate {
            scene: Some(&scene),
            keyframes: Some(&scene.keyframes),
            ..LiveUpdate::default()
        });
        Self {
            view,
            command,
            outside: GrowingView::default(),
            pace: ImagePace::default(),
            without_image: None,
        }
    }

    /// The scene, when the view from outside has changed after this number of keyframes.
    fn scene(&mut self, keyframes: usize, recording: &Recording, map: &Map) -> Option<Page> {
        let about = PageRun::new(recording, map);
        if !self.outside.fit(keyframes, Some(map), &about) {
            return None;
        }
        let mut scene = page_of(&about, self.command, &TriangleMesh::default());
        self.outside.apply(&mut scene);
        Some(scene)
    }

    /// The image of the last keyframe; `None` when it was made before, or cannot be read.
    fn image(&mut self, recording: &Recording) -> Option<KeyframeImage> {
        let (keyframe, segments) = self.without_image.take()?;
        let frame = *recording.keyframes.get(keyframe)?;
        let image = recording.sequence.load_color(frame).ok()?;
        keyframe_image(keyframe, &image, &segments).ok()
    }
}

impl Sink for LiveSink {
    fn wants_surface(&self) -> bool {
        true
    }

    fn update(
        &mut self,
        recording: &Recording,
        map: &Map,
        update: &mut KeyframeUpdate,
    ) -> Result<(), SinkError> {
        if let Keyframe::Lines(keyframe) = &update.keyframe {
            self.without_image = Some((update.number, keyframe.ends_px()));
        }
        let is_due = self.pace.is_due();
        let image = is_due.then(|| self.image(recording)).flatten();
        let surface = map.followed_surface().zip(update.surface.as_ref());
        let surface = surface.map(|(surface, change)| (surface as &dyn NumberedSurface, change));
        let row = KeyframeRow {
            keyframe: update.number,
            triangles: surface.map_or(0, |(surface, _)| surface.triangle_count()),
            milliseconds: update.times,
        };
        let scene = self.scene(update.order + 1, recording, map);
        with_elements(map, |elements| {
            self.view.publish(&LiveUpdate {
                scene: scene.as_ref(),
                current: Some(row),
                surface,
                elements: Some(elements),
                image,
                ..LiveUpdate::default()
            });
        });
        Ok(())
    }

    /// Shows the end of the map, and the image of its last keyframe.
    fn finished(
        &mut self,
        recording: &Recording,
        map: &Map,
        change: Option<&SurfaceChange>,
    ) -> Result<(), SinkError> {
        let image = self.image(recording);
        let surface = map.followed_surface().zip(change);
        let surface = surface.map(|(surface, change)| (surface as &dyn NumberedSurface, change));
        with_elements(map, |elements| {
            self.view.publish(&LiveUpdate {
                surface,
                elements: Some(elements),
                image,
                ..LiveUpdate::default()
            });
        });
        Ok(())
    }
}
