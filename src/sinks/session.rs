//! The page of a session: live while messages come, and as a file at the end.

use linecarve_mesh::TriangleMesh;
use nalgebra::Isometry3;

use crate::live::{ImagePace, KeyframeRow, LiveUpdate, LiveView};
use crate::report::growth_delta::NumberedSurface;
use crate::report::page::{Elements, KeyframeImage, Page, keyframe_image};
use crate::sinks::{
    GrowingView, PageRun, grouped, last_surface, line_ends, page_of, with_elements,
};
use linecarve_engine::map::SurfaceChange;
use linecarve_engine::stream::{SessionObserver, SessionState};

/// Hands on to the live page what messages change.
pub(crate) struct SessionPage {
    view: LiveView,
    outside: GrowingView,
    pace: ImagePace,
    /// Image of the newest keyframe, until it is sent.
    image: Option<KeyframeImage>,
}

impl SessionPage {
    pub(crate) fn new(view: LiveView) -> Self {
        Self {
            view,
            outside: GrowingView::default(),
            pace: ImagePace::default(),
            image: None,
        }
    }
}

impl SessionObserver for SessionPage {
    /// Makes the image of the newest keyframe, when one is due.
    fn add(&mut self, map: &dyn SessionState) {
        if !self.pace.is_due() {
            return;
        }
        let image = map.newest().and_then(|newest| {
            let image = map.sequence()?.load_color(newest.frame).ok()?;
            keyframe_image(newest.keyframe, &image, &newest.ends_px).ok()
        });
        self.image = image.or(self.image.take());
    }

    /// Shows the state after a message; `change` is that of the surface. After a correction all segments are shown anew.
    fn update(
        &mut self,
        session_map: &dyn SessionState,
        change: Option<&SurfaceChange>,
        is_correction: bool,
    ) {
        let (names, poses) = keyframes(session_map);
        let about = about(session_map, &names, poses);
        let mut scene = page_of(&about, "stream", &TriangleMesh::default());
        scene.title = "stream".to_owned();
        let map = session_map.map();
        self.outside.fit(session_map.keyframe_count(), map, &about);
        self.outside.apply(&mut scene);
        let followed = map.and_then(|map| map.followed_surface());
        let triangles = followed.map_or(0, |surface| surface.triangle_count());
        let surface = followed.zip(change);
        let surface = surface.map(|(surface, change)| (surface as &dyn NumberedSurface, change));
        let current = session_map.newest().map(|newest| KeyframeRow {
            keyframe: newest.keyframe,
            triangles,
            milliseconds: newest.times,
        });
        let image = self.image.take();
        with_elements_of(session_map, |elements| {
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
        });
    }
}

/// The page of a session that has ended with this mesh, which is in the frame of computation. Of the surface it has the last state.
pub(crate) fn last_page(session_map: &dyn SessionState, mesh: &TriangleMesh) -> Page {
    let (names, poses) = keyframes(session_map);
    let about = about(session_map, &names, poses);
    let mut page = page_of(&about, "stream", mesh);
    page.title = "stream".to_owned();
    page.subtitle = format!(
        "{} keyframes, {} triangles",
        names.len(),
        grouped(mesh.triangles.len())
    );
    let last = names.len().saturating_sub(1);
    with_elements_of(session_map, |elements| {
        let elements = elements.unwrap_or_default();
        page.surfaces = vec![last_surface("surface", "Surface", last, mesh, elements)];
    });
    page
}

/// Names and poses of the keyframes.
fn keyframes(session_map: &dyn SessionState) -> (Vec<String>, Vec<Isometry3<f64>>) {
    let (ids, poses): (Vec<u64>, Vec<_>) = session_map.poses().into_iter().unzip();
    (ids.iter().map(u64::to_string).collect(), poses)
}

fn about<'a>(
    session_map: &'a dyn SessionState,
    names: &'a [String],
    poses: Vec<Isometry3<f64>>,
) -> PageRun<'a> {
    PageRun::of_poses(
        session_map.sequence(),
        session_map.camera(),
        poses,
        names.iter().map(String::as_str).collect(),
        session_map.median_depth(),
        session_map.origin(),
    )
}

/// Hands over what the map is made of; nothing before there is one.
fn with_elements_of(session_map: &dyn SessionState, take: impl FnOnce(Option<Elements<'_>>)) {
    let Some(map) = session_map.map() else {
        return take(None);
    };
    let lines = session_map.lines().unwrap_or_default();
    let of_messages = line_ends(&lines.points, &lines.lines);
    with_elements(map, |elements| {
        let segments = match of_messages.is_empty() {
            true => elements.segments,
            false => of_messages.as_slice(),
        };
        take(Some(Elements {
            segments,
            ..elements
        }));
    });
}
