//! What explains the images: the given poses, another camera, or other poses.
//!
//! Adjusted poses always fit the matches that they were adjusted to better than the given ones do. Whether they are better is seen
//! in matches that were held back, whose points alone are free. A wrong camera is told from wrong poses in the same way: nine
//! numbers for all images then explain what otherwise takes six for each of them.

use super::correct_poses::BLOCK_KEYFRAMES;
use super::estimate_lens::LENS_KEYFRAMES;
use super::map::PointMap;
use super::rolling_shutter::{CameraMotion, best_readout, without_shutter};
use crate::pose_correction::{
    CorrectedLens, CorrectedPose, FreeLens, PosePrior, Track, adjust_bundle,
};

/// Focal length and `k1` are preferred to all parameters of a camera when their error is at most this multiple.
const FEW_SHARE: f64 = 1.005;
/// One point in so many is held back.
const HELD_BACK: usize = 5;
/// Fewest observations of a point that is held back: two always fit in one of their directions.
const LEAST_OBSERVATIONS: usize = 3;
/// Fewest points that are held back.
const LEAST_POINTS: usize = 20;
/// Most points that are looked at.
const POINTS: usize = 4000;
/// Another camera is preferred to the given one when the error of the given one is more than this multiple of its error.
const LEAST_GAIN_OF_CAMERA: f64 = 1.03;
/// Other poses are preferred to the given ones when the error of the given ones is more than this multiple of theirs.
const LEAST_GAIN_OF_POSES: f64 = 1.1;
/// Another camera, or a rolling shutter, is preferred to other poses when its error is at most this multiple of theirs.
const SHARED_SHARE: f64 = 1.05;

/// Mean squared reprojection error of matches that no adjustment saw, in variances, with Cauchy's kernel.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct HeldBackErrors {
    /// With the given poses and the given camera.
    pub given: f64,
    /// With the given poses and a camera that was fitted to the other matches; `None` where the camera is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<f64>,
    /// With poses that were adjusted to the other matches.
    pub poses: f64,
    /// With the given poses and camera and a rolling shutter; `None` where the others suffice, or motion is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rolling_shutter: Option<f64>,
}

/// Which of them to believe.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Explanation {
    Given,
    Camera,
    RollingShutter,
    Poses,
}

impl HeldBackErrors {
    fn explanation(&self) -> Explanation {
        let camera = self.camera.unwrap_or(f64::INFINITY);
        if self.given <= LEAST_GAIN_OF_CAMERA * camera
            && self.given <= LEAST_GAIN_OF_POSES * self.poses
        {
            Explanation::Given
        } else if camera <= SHARED_SHARE * self.poses {
            Explanation::Camera
        } else if self
            .rolling_shutter
            .is_some_and(|error| error <= SHARED_SHARE * self.poses)
        {
            Explanation::RollingShutter
        } else {
            Explanation::Poses
        }
    }
}

/// Matches for adjustments, and others to judge them by.
struct Trial {
    used: Vec<Track>,
    held_back: Vec<Track>,
    window: Vec<u32>,
    given: Vec<CorrectedPose>,
    prior: PosePrior,
}

impl Trial {
    /// The errors, but for those of another camera, where poses are adjusted together with `with_poses` of the lens.
    fn errors(&self, lens: &CorrectedLens, with_poses: FreeLens) -> HeldBackErrors {
        let (other_lens, other_poses) = self.adjusted(lens, with_poses, &self.window);
        HeldBackErrors {
            given: self.error(lens, &self.given),
            camera: None,
            poses: self.error(&other_lens, &other_poses),
            rolling_shutter: None,
        }
    }

    /// The error with another camera, and which parameters it differs in: few if they do.
    fn other_camera(&self, given: &CorrectedLens) -> (f64, FreeLens) {
        let [few, all] = [FreeLens::FocalLength, FreeLens::All].map(|free| {
            let (other, _) = self.adjusted(given, free, &[]);
            (self.error(&other, &self.given), free)
        });
        if few.0 <= FEW_SHARE * all.0 { few } else { all }
    }

    fn error(&self, lens: &CorrectedLens, poses: &[CorrectedPose]) -> f64 {
        self.cost_of(self.held_back.clone(), lens, poses)
    }

    /// Error of the held-back matches with a rolling shutter whose readout fits the others, and that readout, as a share of the time
    /// between two frames.
    fn rolling_shutter(
        &self,
        lens: &CorrectedLens,
        height: f64,
        motions: &[Option<CameraMotion>],
    ) -> (f64, f64) {
        let global = |tracks: &[Track], readout: f64| {
            without_shutter(tracks, readout, lens.camera(), height, &self.given, motions)
        };
        let cost = |readout: f64| self.cost_of(global(&self.used, readout), lens, &self.given);
        let readout = best_readout(cost);
        let held_back = global(&self.held_back, readout);
        (self.cost_of(held_back, lens, &self.given), readout)
    }

    /// Mean cost of an observation when the points alone are free.
    fn cost_of(
        &self,
        mut tracks: Vec<Track>,
        lens: &CorrectedLens,
        poses: &[CorrectedPose],
    ) -> f64 {
        let (mut lens, mut poses) = (lens.clone(), poses.to_vec());
        let observations: usize = tracks.iter().map(|track| track.observations.len()).sum();
        let fixed = FreeLens::Fixed;
        let done = adjust_bundle(&mut lens, fixed, &mut poses, &[], &self.prior, &mut tracks);
        done.cost_after / observations.max(1) as f64
    }

    /// Lens and poses that fit the used matches, from the given poses; those of `free` keyframes.
    fn adjusted(
        &self,
        lens: &CorrectedLens,
        free_lens: FreeLens,
        free: &[u32],
    ) -> (CorrectedLens, Vec<CorrectedPose>) {
        let (mut lens, mut poses) = (lens.clone(), self.given.clone());
        let mut tracks = self.used.clone();
        adjust_bundle(
            &mut lens,
            free_lens,
            &mut poses,
            free,
            &self.prior,
            &mut tracks,
        );
        (lens, poses)
    }
}

impl PointMap {
    /// How well the rival explanations fit matches that were held back, by the last [`adjust_all`](Self::adjust_all); `None` before, or
    /// with too few points. If another camera explains the images, the errors are those with it.
    pub fn held_back_errors(&self) -> Option<HeldBackErrors> {
        self.held_back_errors
    }

    /// Time from the first to the last row as a share of the time between two frames, where a rolling shutter is why the images
    /// disagree with the poses; found by the last [`adjust_all`](Self::adjust_all).
    pub fn readout(&self) -> Option<f64> {
        self.readout
    }

    /// Whether adjusted poses explain the images, and neither the given ones nor these with another camera: false before the first
    /// [`adjust_all`](Self::adjust_all).
    pub fn has_adjusted_poses(&self) -> bool {
        let errors = self.held_back_errors;
        errors.is_some_and(|errors| errors.explanation() == Explanation::Poses)
    }

    /// Decides, after all keyframes were adjusted with a `prior`, between the given poses and camera, the given poses with another camera, and
    /// adjusted poses, which stay if the others explain the images less well. Where little can be held back, the given ones are kept.
    ///
    /// # Complexity
    /// That of some adjustments of at most a hundred keyframes and four thousand points.
    pub(super) fn choose_explanation(&mut self, depth: f64, prior: PosePrior) {
        let given = CorrectedLens::new(self.camera.clone());
        (self.held_back_errors, self.readout) = (None, None);
        let Some(trial) = self.trial(prior) else {
            return self.restore_given_poses(given);
        };
        let with_poses = match self.lens.correction() {
            None => FreeLens::Fixed,
            Some(_) => FreeLens::Distortion,
        };
        let is_lens_free = self.correction.lens && trial.window.len() >= LENS_KEYFRAMES[0];
        let mut errors = trial.errors(&given, with_poses);
        let camera = is_lens_free.then(|| trial.other_camera(&given));
        errors.camera = camera.map(|(error, _)| error);
        let free = camera.map_or(FreeLens::Fixed, |(_, free)| free);
        if errors.explanation() == Explanation::Poses && self.motions.iter().any(Option::is_some) {
            let (error, readout) = trial.rolling_shutter(&given, self.size[1], &self.motions);
            errors.rolling_shutter = Some(error);
            if errors.explanation() == Explanation::RollingShutter {
                self.readout = Some(readout);
            }
        }
        self.held_back_errors = Some(errors);
        match errors.explanation() {
            Explanation::Poses => {}
            Explanation::Given | Explanation::RollingShutter => self.restore_given_poses(given),
            Explanation::Camera => {
                let (mut lens, mut poses) = (given, trial.given.clone());
                let mut tracks = [trial.used.as_slice(), &trial.held_back].concat();
                adjust_bundle(&mut lens, free, &mut poses, &[], &trial.prior, &mut tracks);
                self.restore_given_poses(lens.clone());
                let prior = self.adjust_from_given_accuracy(depth);
                let Some(trial) = self.trial(prior) else {
                    return self.restore_given_poses(lens);
                };
                let errors = trial.errors(&lens, FreeLens::Fixed);
                self.held_back_errors = Some(errors);
                if errors.explanation() == Explanation::Given {
                    self.restore_given_poses(lens);
                }
            }
        }
    }

    /// The matches between the corrected keyframes; between a hundred in the middle if there are more.
    fn trial(&self, prior: PosePrior) -> Option<Trial> {
        let corrected = self.corrected_keyframes();
        let count = corrected.len().min(BLOCK_KEYFRAMES);
        let start = (corrected.len() - count) / 2;
        let window = corrected[start..start + count].to_vec();
        let (_, tracks) = self.tracks_of(&window)?;
        let every = tracks.len().div_ceil(POINTS);
        let mut trial = Trial {
            used: Vec::new(),
            held_back: Vec::new(),
            given: self.keyframes.iter().map(|k| k.pose.as_given()).collect(),
            prior,
            window,
        };
        for (index, track) in tracks.into_iter().step_by(every).enumerate() {
            if index % HELD_BACK != 0 {
                trial.used.push(track);
            } else if track.observations.len() >= LEAST_OBSERVATIONS {
                trial.held_back.push(track);
            }
        }
        (trial.held_back.len() >= LEAST_POINTS).then_some(trial)
    }

    /// Takes back the corrections of all poses, and takes a lens.
    fn restore_given_poses(&mut self, lens: CorrectedLens) {
        self.lens = lens;
        for keyframe in &mut self.keyframes {
            keyframe.pose = keyframe.pose.as_given();
            keyframe.undistort(self.lens.camera(), &self.camera);
        }
        self.dirty.extend_from_slice(&self.living);
        self.refine_dirty();
        self.living
            .retain(|id| self.points[id.0 as usize].is_some());
    }
}
