//! The map of a session without images: its points and segments come in messages.

use std::collections::{BTreeMap, BTreeSet};

use linecarve_carving::accept_position;
use linecarve_lines::camera::Camera;
use linecarve_mesh::LineSet;
use linecarve_sequence::{LiveCamera, LiveFrame, ModelView, Sequence};
use nalgebra::{Isometry3, Point3, Vector3};

use super::SessionError;
use super::message::{LineMessage, PointMessage, StartMessage};
use super::session_map::{NewestKeyframe, SessionMap, SessionState};
use super::shown_line::ShownPart;
use crate::front_end::far_origin;
use crate::map::{Map, ObservationChange, ObservedPoint, PointKind, SurfaceChange};
use crate::mapper::Mapper;
use crate::options::{Options, SegmentPointOptions};
use crate::run::{StageTimes, milliseconds};

/// A 3D segment and the numbers of its points in the map.
#[derive(Clone)]
struct Line {
    ends: [Point3<f64>; 2],
    /// Numbers of the keyframes that see it.
    views: Vec<u32>,
    sigma: Option<f64>,
    /// What its points are on.
    shown: ShownPart,
    points: Vec<u32>,
}

/// Keyframes, points and segments by their ids. Coordinates are in the frame of computation.
pub(super) struct MessageMap {
    camera: Option<LiveCamera>,
    keyframes: BTreeMap<u64, u32>,
    /// By number in the map, also of keyframes that were removed.
    poses: Vec<Isometry3<f64>>,
    points: BTreeMap<u64, u32>,
    lines: BTreeMap<u64, Line>,
    numbers: Numbers,
    spacing: SegmentPointOptions,
    mapper: Mapper,
    /// Processor times since the newest keyframe came.
    times: StageTimes,
}

impl MessageMap {
    /// Creates the map with the first keyframe.
    ///
    /// # Errors
    /// When the position of the keyframe is out of range.
    pub(super) fn begin(
        start: &StartMessage,
        options: &Options,
        id: u64,
        frame: LiveFrame,
    ) -> Result<Self, SessionError> {
        let has_camera = !start.calibration.is_null();
        let camera = has_camera.then(|| LiveCamera::new(&start.calibration));
        let first = Point3::from(frame.world_from_camera.translation.vector);
        let origin = match start.origin {
            Some(origin) => origin.into(),
            None => far_origin([first], start.median_depth.unwrap_or(1.0)),
        };
        let map = Map::of_observations(options, start.median_depth);
        let mut session_map = Self {
            camera: camera.transpose()?,
            keyframes: BTreeMap::new(),
            poses: Vec::new(),
            points: BTreeMap::new(),
            lines: BTreeMap::new(),
            numbers: Numbers::default(),
            spacing: options.segment_points,
            mapper: Mapper::new(map, origin),
            times: StageTimes::default(),
        };
        session_map.mapper.follow_surface();
        session_map.add(id, frame, options)?;
        Ok(session_map)
    }

    /// Adds, moves and removes points.
    pub(super) fn change_points(
        &mut self,
        points: &[PointMessage],
        removed: &[u64],
    ) -> Result<(), SessionError> {
        check_once("point", points.iter().map(|point| point.id))?;
        let mut change = ObservationChange::default();
        for point in points {
            check_sigma("point", point.id, point.sigma)?;
            change.points.push(ObservedPoint {
                number: 0,
                position: self.position("point", point.id, point.position)?,
                sigma: point.sigma,
                kind: PointKind::Single,
            });
        }
        for id in removed {
            let unknown = SessionError::UnknownPoint { id: *id };
            change
                .removed_points
                .push(*self.points.get(id).ok_or(unknown)?);
        }
        for (point, observed) in points.iter().zip(&mut change.points) {
            let number = self.points.entry(point.id);
            observed.number = *number.or_insert_with(|| self.numbers.take());
        }
        self.observe(&change)?;
        for id in removed {
            self.numbers.free.extend(self.points.remove(id));
        }
        Ok(())
    }

    /// Adds and removes observations of points by a keyframe.
    pub(super) fn change_observations(
        &mut self,
        keyframe: u64,
        points: &[u64],
        removed: &[u64],
    ) -> Result<(), SessionError> {
        let view = self.view(keyframe)?;
        let pairs = |ids: &[u64]| -> Result<Vec<[u32; 2]>, SessionError> {
            let number = |id: &u64| self.points.get(id).copied();
            ids.iter()
                .map(|id| match number(id) {
                    Some(number) => Ok([view, number]),
                    None => Err(SessionError::UnknownPoint { id: *id }),
                })
                .collect()
        };
        let change = ObservationChange {
            observations: pairs(points)?,
            removed_observations: pairs(removed)?,
            ..ObservationChange::default()
        };
        self.observe(&change)?;
        Ok(())
    }

    /// Adds, replaces and removes segments. Each is carved by points along it, as dense as those of segments in images where the
    /// camera is known, else by its ends.
    pub(super) fn change_lines(
        &mut self,
        lines: &[LineMessage],
        removed: &[u64],
    ) -> Result<(), SessionError> {
        check_once("line", lines.iter().map(|line| line.id))?;
        let mut new = Vec::with_capacity(lines.len());
        for line in lines {
            let ends = [
                self.position("line", line.id, line.ends[0])?,
                self.position("line", line.id, line.ends[1])?,
            ];
            check_sigma("line", line.id, line.sigma)?;
            let views = line.keyframes.iter().map(|id| self.view(*id));
            let line_of_map = Line {
                ends,
                views: views.collect::<Result<_, _>>()?,
                sigma: line.sigma,
                shown: ShownPart::WHOLE,
                points: Vec::new(),
            };
            new.push((line.id, line_of_map));
        }
        for id in removed {
            let unknown = SessionError::UnknownLine { id: *id };
            self.lines.get(id).ok_or(unknown)?;
        }
        self.replace_lines(new, removed)
    }

    /// Carves new lines by points along them, and removes those of the same ids and of the ids `removed`.
    fn replace_lines(
        &mut self,
        mut new: Vec<(u64, Line)>,
        removed: &[u64],
    ) -> Result<(), SessionError> {
        let mut change = ObservationChange::default();
        for (_, line) in &mut new {
            let [from, to] = line.ends;
            line.points.clear();
            line.shown = self.shown(line);
            let [begin, end] = line.shown.shares;
            for share in self.spacing.shares(line.shown.length_px) {
                let share = begin + share * (end - begin);
                let number = self.numbers.take();
                line.points.push(number);
                change.points.push(ObservedPoint {
                    number,
                    position: from + share * (to - from),
                    sigma: line.sigma,
                    kind: PointKind::OnLine,
                });
                let observed = line.views.iter().map(|view| [*view, number]);
                change.observations.extend(observed);
            }
        }
        let mut gone: Vec<u64> = removed.to_vec();
        gone.extend(new.iter().map(|(id, _)| *id));
        gone.sort_unstable();
        gone.dedup();
        let old = gone.iter().filter_map(|id| self.lines.get(id));
        change.removed_points = old.flat_map(|line| line.points.iter().copied()).collect();
        self.observe(&change)?;
        self.numbers.free.extend(change.removed_points);
        for id in gone {
            self.lines.remove(&id);
        }
        self.lines.extend(new);
        Ok(())
    }

    /// Spaces the points anew on lines of which these keyframes show another part, or another length in the images.
    ///
    /// # Complexity
    /// One look at each line and its keyframes.
    fn space_lines(&mut self, views: &BTreeSet<u32>) -> Result<(), SessionError> {
        let is_other = |line: &Line| {
            if !line.views.iter().any(|view| views.contains(view)) {
                return false;
            }
            let shown = self.shown(line);
            let is_same = shown.shares == line.shown.shares
                && self.spacing.shares(shown.length_px).count() == line.points.len();
            !is_same
        };
        let lines = self.lines.iter().filter(|(_, line)| is_other(line));
        let other: Vec<(u64, Line)> = lines.map(|(id, line)| (*id, line.clone())).collect();
        match other.is_empty() {
            true => Ok(()),
            false => self.replace_lines(other, &[]),
        }
    }

    /// What the keyframes of a segment can show of it.
    fn shown(&self, line: &Line) -> ShownPart {
        let Some(camera) = &self.camera else {
            return ShownPart::WHOLE;
        };
        let poses = line.views.iter().map(|view| &self.poses[*view as usize]);
        ShownPart::new(&line.ends, camera.camera(), poses)
    }

    fn observe(&mut self, change: &ObservationChange) -> Result<(), SessionError> {
        let times = self.mapper.observe(change)?.times;
        self.times.points += milliseconds(times.matching);
        self.times.carve += milliseconds(times.carving);
        Ok(())
    }

    fn view(&self, id: u64) -> Result<u32, SessionError> {
        let known = self.keyframes.get(&id).copied();
        known.ok_or(SessionError::UnknownKeyframe { id })
    }

    /// The pose of a colour camera in the frame of computation.
    fn pose(&self, id: u64, recorded: &Isometry3<f64>) -> Result<Isometry3<f64>, SessionError> {
        let mut pose = match &self.camera {
            Some(camera) => camera.world_from_color(recorded),
            None => *recorded,
        };
        pose.translation.vector -= self.mapper.origin();
        match accept_position(&pose.translation.vector.into()) {
            Ok(_) => Ok(pose),
            Err(source) => Err(SessionError::Position { id, source }),
        }
    }

    /// A position in the frame of computation.
    fn position(
        &self,
        what: &'static str,
        id: u64,
        position: [f64; 3],
    ) -> Result<Point3<f64>, SessionError> {
        let position = Point3::from(position) - self.mapper.origin();
        match accept_position(&position) {
            Ok(_) => Ok(position),
            Err(source) => Err(SessionError::Observed {
                what,
                id,
                problem: source.to_string(),
            }),
        }
    }
}

/// Gives numbers to points; those of removed points again.
#[derive(Default)]
struct Numbers {
    free: Vec<u32>,
    count: u32,
}

impl Numbers {
    fn take(&mut self) -> u32 {
        self.free.pop().unwrap_or_else(|| {
            self.count += 1;
            self.count - 1
        })
    }
}

fn check_sigma(what: &'static str, id: u64, sigma: Option<f64>) -> Result<(), SessionError> {
    match sigma {
        Some(sigma) if !(sigma.is_finite() && sigma > 0.0) => Err(SessionError::Observed {
            what,
            id,
            problem: format!("`sigma` is {sigma}: a positive length is needed, or leave it out"),
        }),
        _ => Ok(()),
    }
}

/// Refuses an id that occurs twice.
fn check_once(what: &'static str, ids: impl Iterator<Item = u64>) -> Result<(), SessionError> {
    let mut known = BTreeSet::new();
    for id in ids {
        if !known.insert(id) {
            let problem = "it is twice in one message".to_owned();
            return Err(SessionError::Observed { what, id, problem });
        }
    }
    Ok(())
}

impl SessionState for MessageMap {
    fn keyframe_count(&self) -> usize {
        self.keyframes.len()
    }

    fn segment_count(&self) -> usize {
        self.lines.len()
    }

    fn lines(&self) -> Option<LineSet> {
        let lines = self.lines.values().map(|line| line.ends);
        Some(LineSet::from_segments(lines))
    }

    fn map(&self) -> Option<&Map> {
        Some(self.mapper.map())
    }

    fn origin(&self) -> Vector3<f64> {
        self.mapper.origin()
    }

    fn median_depth(&self) -> Option<f64> {
        self.mapper.map().median_depth()
    }

    fn sequence(&self) -> Option<&Sequence> {
        None
    }

    fn poses(&self) -> Vec<(u64, Isometry3<f64>)> {
        let keyframes = self.keyframes.iter();
        keyframes
            .map(|(id, view)| (*id, self.poses[*view as usize]))
            .collect()
    }

    fn camera(&self) -> Option<&Camera> {
        self.camera.as_ref().map(LiveCamera::camera)
    }

    fn newest(&self) -> Option<NewestKeyframe> {
        let views = self.keyframes.values().enumerate();
        let (keyframe, _) = views.max_by_key(|(_, view)| **view)?;
        Some(NewestKeyframe {
            keyframe,
            frame: 0,
            ends_px: Vec::new(),
            times: self.times,
        })
    }
}

impl SessionMap for MessageMap {
    fn contains(&self, id: u64) -> bool {
        self.keyframes.contains_key(&id)
    }

    fn add(&mut self, id: u64, frame: LiveFrame, _options: &Options) -> Result<(), SessionError> {
        let pose = self.pose(id, &frame.world_from_camera)?;
        let view = ModelView {
            name: frame.name,
            world_from_camera: pose,
            camera: self.camera.as_ref().map(|camera| camera.camera().clone()),
            size_px: None,
        };
        self.times = StageTimes::default();
        self.observe(&ObservationChange {
            views: vec![view],
            ..ObservationChange::default()
        })?;
        self.keyframes.insert(id, self.poses.len() as u32);
        self.poses.push(pose);
        Ok(())
    }

    fn messages(&mut self) -> Option<&mut MessageMap> {
        Some(self)
    }

    fn change(
        &mut self,
        keyframes: &[(u64, Option<Isometry3<f64>>)],
        _options: &Options,
    ) -> Result<(), SessionError> {
        let mut change = ObservationChange::default();
        for (id, pose) in keyframes {
            let view = self.view(*id)?;
            match pose {
                Some(pose) => change.moved_views.push((view, self.pose(*id, pose)?)),
                None => change.removed_views.push(view),
            }
        }
        self.observe(&change)?;
        let mut other: BTreeSet<u32> = change.moved_views.iter().map(|(view, _)| *view).collect();
        for (view, pose) in change.moved_views {
            self.poses[view as usize] = pose;
        }
        let removed = BTreeSet::from_iter(change.removed_views);
        self.keyframes.retain(|_, view| !removed.contains(view));
        let is_other = |line: &&mut Line| line.views.iter().any(|view| removed.contains(view));
        for line in self.lines.values_mut().filter(is_other) {
            line.views.retain(|view| !removed.contains(view));
            other.extend(&line.views);
        }
        self.space_lines(&other)
    }

    fn finish(&mut self, _options: &Options) -> Result<bool, SessionError> {
        self.mapper.finish()?;
        Ok(true)
    }

    fn take_surface_change(&mut self) -> Option<SurfaceChange> {
        self.mapper.take_surface_change()
    }
}
