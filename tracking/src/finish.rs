//! The end of a run: global adjustment, and a pose for every frame.

use std::time::Instant;

use nalgebra::{Isometry3, Matrix6, Point3, UnitQuaternion};

use crate::adjust::PosePrior;
use crate::camera::Measurement;
use crate::map::{KeyframeId, Map, PointId};
use crate::records::{FrameRecord, LoopReport, MapCheck, NoPose, PosedFrame, StageTimes};
use crate::smooth::{PathPose, smooth_path};
use crate::snapshot::points_of;
use crate::solve::{information_of, refine_pose};
use crate::tracker::Tracker;

/// Steps of the robust and of the last round of the global adjustment.
const GLOBAL_STEPS: [usize; 2] = [10, 15];

/// Sweeps over frames without a pose, backwards and forwards in turn.
const MAX_SWEEPS: usize = 4;

/// Fewest frames of a sub-map that is believed, unless it is the only one.
const MIN_SUBMAP_FRAMES: usize = 5;

/// The pose of a frame in the final map.
struct FoundPose {
    submap: u32,
    world_from_camera: Isometry3<f64>,
    matches: usize,
    /// About small motions of points in the camera (translation, then rotation).
    information: Matrix6<f64>,
}

/// The pose of a frame, or why there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FramePose {
    /// In the frame of a sub-map.
    Known {
        /// Number of the sub-map, 0 for the one with most frames.
        submap: usize,
        /// `point_in_world = world_from_camera * point_in_camera`.
        world_from_camera: Isometry3<f64>,
        /// Number of features that agree.
        matches: usize,
    },
    /// There is none.
    Unknown(NoPose),
}

/// A part of the recording with a common frame of coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Submap {
    /// Frames with a pose in it.
    pub frames: usize,
    /// Frame numbers of its keyframes.
    pub keyframes: Vec<u32>,
    /// Its points that at least two keyframes see.
    pub points: Vec<Point3<f64>>,
}

/// The result of tracking a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedRecording {
    /// The pose of each frame, in order.
    pub poses: Vec<FramePose>,
    /// The sub-maps, that with most frames first.
    pub submaps: Vec<Submap>,
    /// Loops that were closed or refused.
    pub loops: Vec<LoopReport>,
    /// Of one camera: how the map compares with the images around some keyframes.
    pub check: Option<MapCheck>,
    /// Durations.
    pub times: StageTimes,
    /// Information of each pose; zero without one, and for poses as they were known live.
    pub(crate) information: Vec<Matrix6<f64>>,
}

impl TrackedRecording {
    /// Moves poses to where a camera that does not jump most likely was, given the time of each frame in any unit. How much poses scatter, and how
    /// strongly the camera accelerates, is estimated from the poses. Poses as they were known live stay, and so do those whose times do
    /// not ascend. Points stay.
    ///
    /// # Complexity
    /// Linear in the number of frames.
    pub fn smooth(&mut self, times: &[f64]) {
        for submap in 0..self.submaps.len() {
            let (frames, mut path): (Vec<usize>, Vec<PathPose>) = (self.poses.iter())
                .zip(times.iter().zip(&self.information))
                .enumerate()
                .filter_map(|(frame, (pose, (time, information)))| match pose {
                    FramePose::Known {
                        submap: own,
                        world_from_camera,
                        ..
                    } if *own == submap => Some((
                        frame,
                        PathPose {
                            time: *time,
                            world_from_camera: *world_from_camera,
                            information: *information,
                        },
                    )),
                    _ => None,
                })
                .unzip();
            smooth_path(&mut path);
            for (frame, smoothed) in frames.into_iter().zip(path) {
                if let FramePose::Known {
                    world_from_camera, ..
                } = &mut self.poses[frame]
                {
                    *world_from_camera = smoothed.world_from_camera;
                }
            }
        }
    }

    /// Replaces the camera by one that is turned at the same position: `point_in_new = new_from_old * point_in_old`. The world of
    /// each sub-map turns with its first camera.
    pub fn turn_camera(&mut self, new_from_old: &UnitQuaternion<f64>) {
        for pose in &mut self.poses {
            if let FramePose::Known {
                world_from_camera, ..
            } = pose
            {
                *world_from_camera = new_from_old * *world_from_camera * new_from_old.inverse();
            }
        }
        for point in self.submaps.iter_mut().flat_map(|one| &mut one.points) {
            *point = new_from_old * *point;
        }
    }
}

impl Tracker {
    /// Ends the run: adjusts each sub-map as a whole, and finds the pose of every frame in the final map.
    pub fn finish(mut self) -> TrackedRecording {
        let start = Instant::now();
        let keyframes_ms = self.times.keyframes_ms;
        if !self.options.looks_ahead {
            self.stop_waiting();
        }
        self.start_at_end();
        if self.options.looks_ahead {
            if !self.map.keyframes.is_empty() {
                self.resume_missing();
            }
            self.join_submaps();
            for submap in 0..self.submaps {
                self.adjust_submap(submap);
            }
            if !self.map.keyframes.is_empty() {
                self.verify();
                self.retry_missing();
            }
        }
        let found: Vec<Result<FoundPose, NoPose>> = self
            .records
            .iter()
            .enumerate()
            .map(|(number, record)| match record {
                FrameRecord::Missing { reason, .. } => Err(*reason),
                FrameRecord::Posed(frame) if self.options.looks_ahead => Ok(self.final_pose(frame)),
                FrameRecord::Posed(_) if (number as u32) < self.first_answered => {
                    Err(NoPose::Waiting)
                }
                FrameRecord::Posed(frame) => Ok(FoundPose {
                    submap: frame.live_submap,
                    world_from_camera: frame.live.inverse(),
                    matches: frame.inliers,
                    information: Matrix6::zeros(),
                }),
            })
            .collect();
        self.times.finish_ms = start.elapsed().as_secs_f64() * 1e3;
        self.times.total_ms += self.times.keyframes_ms - keyframes_ms;
        self.summarise(found)
    }

    /// Compares the map of one camera with the images, and separates what they contradict.
    fn verify(&mut self) {
        if !self.options.is_monocular {
            return;
        }
        let mut check = self.check_map(0);
        let kept = self.separate(0, &mut check);
        for submap in kept.iter().filter(|_| !check.cuts.is_empty()) {
            self.adjust_submap(*submap);
        }
        self.check = Some(check);
    }

    fn adjust_submap(&mut self, submap: u32) {
        let keyframes: Vec<KeyframeId> = self.map.keyframes_of(submap).collect();
        if keyframes.len() < 2 {
            return;
        }
        self.align_submap(&keyframes);
        self.adjust_aligned(&keyframes);
        // With depth the points of a place hardly drift apart.
        if self.options.is_monocular {
            self.match_again(submap, &keyframes);
            self.adjust_aligned(&keyframes);
        }
    }

    /// Adjusts keyframes with aligned observations.
    fn adjust_aligned(&mut self, keyframes: &[KeyframeId]) {
        for id in keyframes {
            self.align_observations(*id);
        }
        self.adjust(keyframes, GLOBAL_STEPS);
    }

    /// Looks for all points of a sub-map in all of its keyframes, and triangulates what still has no point.
    fn match_again(&mut self, submap: u32, keyframes: &[KeyframeId]) {
        let points: Vec<PointId> = (0..self.map.points.len() as u32)
            .map(PointId)
            .filter(|id| {
                let seen = self.map.point(*id).observations.first();
                seen.is_some_and(|(at, _)| self.map.keyframe(*at).submap == submap)
            })
            .collect();
        for &id in keyframes {
            self.fuse_into(id, &points, 1.0);
            self.map.update_neighbors(id);
        }
        for &id in keyframes {
            self.triangulate(id);
            for point in self.points_of(id) {
                self.map.update_point(point);
            }
            self.map.update_neighbors(id);
        }
    }

    /// Pose of a frame from the final map.
    fn final_pose(&self, frame: &PosedFrame) -> FoundPose {
        let start = frame.from_reference * self.map.pose_of(frame.reference);
        let reference = self.map.keyframe(frame.reference);
        let submap = reference.submap;
        let matches: Vec<(Point3<f64>, Measurement)> = frame
            .seen
            .iter()
            .filter_map(|(point, measurement)| {
                let point = self.map.current(*point)?;
                let (first, _) = self.map.point(point).observations.first()?;
                if self.map.keyframe(*first).submap != submap {
                    return None;
                }
                Some((self.map.point(point).position, *measurement))
            })
            .collect();
        // With aligned depth images, the pose of a keyframe was adjusted with all that is known of it.
        let is_adjusted = frame.is_keyframe && !reference.motions.is_empty();
        let motions = match is_adjusted {
            true => reference.motions.as_slice(),
            false => frame.dense.as_slice(),
        };
        let priors: Vec<PosePrior> = motions
            .iter()
            .map(|motion| motion.prior(&self.map.pose_of(motion.reference)))
            .collect();
        let (mut pose, mut inliers) = (start, frame.inliers);
        if !is_adjusted {
            let prior = priors.first();
            let mut is_inlier = Vec::new();
            let refined = refine_pose(&self.camera, &start, &matches, prior, &mut is_inlier);
            let least = frame.inliers.min(2 * self.options.min_matches);
            if let Some(found) = refined.filter(|found| 2 * found.inliers >= least) {
                (pose, inliers) = (found.camera_from_world, found.inliers);
            }
        }
        FoundPose {
            submap,
            world_from_camera: pose.inverse(),
            matches: inliers,
            information: information_of(&self.camera, &pose, &matches, &priors),
        }
    }

    /// Tracks frames without a pose again, from either side, against the map of all frames, which they extend.
    fn resume_missing(&mut self) {
        for sweep in 0..MAX_SWEEPS {
            let mut order: Vec<usize> = (0..self.records.len()).collect();
            if sweep % 2 == 0 {
                order.reverse();
            }
            let mut gained = 0;
            self.forget_last();
            for number in order {
                let FrameRecord::Missing { view, .. } = &mut self.records[number] else {
                    self.forget_last();
                    continue;
                };
                if view.len() < self.options.min_matches {
                    continue;
                }
                let view = std::mem::take(&mut **view);
                gained += usize::from(self.track_missing(number as u32, view));
            }
            if gained == 0 {
                break;
            }
        }
    }

    /// Looks for frames without a pose in the final map.
    fn retry_missing(&mut self) {
        for number in 0..self.records.len() {
            let FrameRecord::Missing { view, .. } = &mut self.records[number] else {
                continue;
            };
            if view.len() < self.options.min_matches {
                continue;
            }
            let view = std::mem::take(&mut **view);
            if let Some(record) = self.retry(number as u32, view) {
                self.records[number] = record;
            }
        }
    }

    /// Numbers the sub-maps by their frames, and drops short ones.
    fn summarise(self, found: Vec<Result<FoundPose, NoPose>>) -> TrackedRecording {
        let mut counts = vec![0_usize; self.submaps as usize];
        for one in found.iter().flatten() {
            counts[one.submap as usize] += 1;
        }
        let mut order: Vec<usize> = (0..counts.len())
            .filter(|&at| counts[at] > 0 && !self.refuted.contains(&(at as u32)))
            .collect();
        order.sort_by_key(|&at| (std::cmp::Reverse(counts[at]), at));
        let mut rank = 0;
        // Two views of a plane have two solutions: without depth, a map that hardly any other frame fits is not believed.
        let least = match self.options.is_monocular {
            true => MIN_SUBMAP_FRAMES.min(found.len() / 2),
            false => 1,
        };
        order.retain(|&at| {
            rank += 1;
            counts[at] >= if rank == 1 { least } else { MIN_SUBMAP_FRAMES }
        });
        let information = |one: &Result<FoundPose, NoPose>| {
            one.as_ref().map_or(Matrix6::zeros(), |one| one.information)
        };
        let information = found.iter().map(information).collect();
        let poses = found
            .into_iter()
            .map(|one| match one {
                Ok(one) => {
                    let number = order.iter().position(|&at| at == one.submap as usize);
                    let reason = match self.refuted.contains(&one.submap) {
                        true => NoPose::Contradicted,
                        false => NoPose::ShortMap,
                    };
                    number.map_or(FramePose::Unknown(reason), |submap| FramePose::Known {
                        submap,
                        world_from_camera: one.world_from_camera,
                        matches: one.matches,
                    })
                }
                Err(reason) => FramePose::Unknown(reason),
            })
            .collect();
        let submaps = order
            .iter()
            .map(|&at| submap_of(&self.map, at as u32, counts[at]))
            .collect();
        TrackedRecording {
            poses,
            submaps,
            loops: self.loops,
            check: self.check,
            times: self.times,
            information,
        }
    }
}

fn submap_of(map: &Map, submap: u32, frames: usize) -> Submap {
    let keyframes: Vec<u32> = map
        .keyframes_of(submap)
        .map(|id| map.keyframe(id).frame)
        .collect();
    Submap {
        frames,
        keyframes,
        points: points_of(map, submap),
    }
}
