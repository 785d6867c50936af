//! Landmarks: 3D points fused from the measurements of several keyframes.
//!
//! Every keyframe measures the end points of a segment anew, with noise. Carved individually they form a noisy shell, and
//! rays to its back carve the cells at its front. Fused landmarks are fewer and more accurate, and each has the rays of all
//! its keyframes. A landmark lies at the mean of its measurements. It is removed when more keyframes contradict than measure
//! it.

use nalgebra::{Point3, Vector3};
use rstar::primitives::GeomWithData;
use rstar::{AABB, RTree, SelectionFunction};

use super::keyframe_measurements::Correction;
use super::landmark::Landmark;
use super::large_nodes::LargeNodes;
use super::view_region::ViewRegion;
use crate::options::LandmarkOptions;

pub(super) use super::landmark::Measurement;

/// The landmark that a measurement is associated with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Association {
    /// A new landmark with this index.
    New(u32),
    /// An existing landmark.
    Existing(u32),
}

/// Outcome of [`Landmarks::update`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum LandmarkUpdate {
    /// Position and deviation are unchanged.
    Unchanged,
    /// The measurements of all keyframes so far are taken into account.
    Settled {
        /// The new position; `None` when it is close to the old one.
        position: Option<Point3<f64>>,
        /// Standard deviation of the position along the view rays.
        sigma: f64,
    },
    /// The landmark was removed from the map.
    Removed,
}

/// Selects what lies in a region.
struct Within<'a> {
    region: &'a ViewRegion,
    records: &'a [Landmark],
}

impl SelectionFunction<IndexedLandmark> for Within<'_> {
    fn should_unpack_parent(&self, envelope: &AABB<[f32; 3]>) -> bool {
        // Positions lie within a rounding of their entries.
        let low = envelope.lower().map(|it| it.next_down().into());
        let high = envelope.upper().map(|it| it.next_up().into());
        self.region.meets([low, high])
    }

    fn should_unpack_leaf(&self, landmark: &IndexedLandmark) -> bool {
        let position = &self.records[landmark.data as usize].position;
        self.region.holds(&position.coords.into())
    }
}

/// The position of a landmark, rounded, and its index.
type IndexedLandmark = GeomWithData<[f32; 3], u32>;

fn indexed(position: &Point3<f64>, id: u32) -> IndexedLandmark {
    GeomWithData::new(rounded(position), id)
}

/// Keeps the order of coordinates: what lies in a box lies in the rounded box when rounded.
fn rounded(position: &Point3<f64>) -> [f32; 3] {
    position.coords.map(|it| it as f32).into()
}

/// All landmarks, with a spatial index.
#[derive(Debug, Default)]
pub(super) struct Landmarks {
    options: LandmarkOptions,
    records: Vec<Landmark>,
    tree: RTree<IndexedLandmark, LargeNodes>,
    /// Number of the current keyframe.
    keyframe: u32,
}

impl Landmarks {
    /// No landmark yet.
    pub(super) fn new(options: LandmarkOptions) -> Self {
        Self {
            options,
            records: Vec::new(),
            tree: RTree::new_with_params(),
            keyframe: 0,
        }
    }

    /// Measurements and contradictions from here on are those of another keyframe.
    pub(super) fn begin_keyframe(&mut self) {
        self.keyframe += 1;
    }

    /// Position of a landmark.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn position(&self, id: u32) -> Point3<f64> {
        self.records[id as usize].position
    }

    /// Whether a landmark has not been removed.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn is_in_use(&self, id: u32) -> bool {
        !self.records[id as usize].is_removed
    }

    /// Indices and positions of the landmarks in a region; unordered.
    pub(super) fn within<'a>(
        &'a self,
        region: &'a ViewRegion,
    ) -> impl Iterator<Item = (u32, Point3<f64>)> + 'a {
        let within = Within {
            region,
            records: &self.records,
        };
        self.tree
            .locate_with_selection_function(within)
            .map(|entry| (entry.data, self.position(entry.data)))
    }

    /// Associates a measurement with the nearest landmark within the gates, or creates one.
    ///
    /// The distance combines pixels across the view ray and standard deviations along it, each relative to its gate. Ties go to
    /// the oldest landmark. Expected O(log n).
    pub(super) fn associate(&mut self, measurement: &Measurement) -> Association {
        if let Some(id) = self.find(measurement) {
            self.add_measurement(id, measurement);
            return Association::Existing(id);
        }
        let id = self.records.len() as u32;
        let position = measurement.point_in_world;
        self.records.push(Landmark::new(measurement, self.keyframe));
        self.tree.insert(indexed(&position, id));
        Association::New(id)
    }

    /// The landmark that [`associate`](Self::associate) would choose; changes nothing. Expected O(log n).
    pub(super) fn find(&self, measurement: &Measurement) -> Option<u32> {
        self.options
            .join
            .then(|| self.nearest_within_gates(measurement))
            .flatten()
    }

    /// Adds a measurement to a landmark.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn add_measurement(&mut self, id: u32, measurement: &Measurement) {
        self.records[id as usize].add(measurement, self.keyframe);
    }

    /// Adds an observed sRGB colour to a landmark.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn add_color(&mut self, id: u32, color: [u8; 3]) {
        let colors = &mut self.records[id as usize].colors;
        for (sum, value) in colors.iter_mut().zip(color.into_iter().chain([1])) {
            *sum = sum.saturating_add(value.into());
        }
    }

    /// Mean colour of a landmark; `None` without any observed colour.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn color(&self, id: u32) -> Option<[u8; 3]> {
        let [r, g, b, count] = self.records[id as usize].colors;
        (count > 0).then(|| [r, g, b].map(|sum| ((sum + count / 2) / count) as u8))
    }

    /// Counts a keyframe that measured a surface behind a landmark.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn add_contradiction(&mut self, id: u32) {
        self.records[id as usize].contradictions += 1;
    }

    /// Takes back that a keyframe contradicted a landmark. Returns whether the landmark, which was removed for that, is in use again: it
    /// then lies at the mean of its measurements. It stays removed where another landmark took its place.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn take_back_contradiction(&mut self, id: u32) -> bool {
        let landmark = &mut self.records[id as usize];
        landmark.contradictions = landmark.contradictions.saturating_sub(1);
        let may_return = landmark.is_removed
            && landmark.measurements > 0
            && landmark.contradictions <= landmark.keyframes;
        if !may_return {
            return false;
        }
        let mean = Point3::from(landmark.weighted / landmark.weight);
        let reach = Vector3::repeat(landmark.sigma());
        let around = AABB::from_corners(rounded(&(mean - reach)), rounded(&(mean + reach)));
        let is_replaced = {
            let mut others = self.tree.locate_in_envelope_intersecting(around);
            others.next().is_some()
        };
        if is_replaced {
            return false;
        }
        landmark.is_removed = false;
        landmark.position = mean;
        landmark.settled_at = landmark.keyframes;
        self.tree.insert(indexed(&mean, id));
        true
    }

    /// Standard deviation of the position of a landmark along the view rays.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn sigma(&self, id: u32) -> f64 {
        let landmark = &self.records[id as usize];
        landmark.sigma() / f64::from(landmark.keyframes).sqrt()
    }

    /// Moves a landmark to the mean of its measurements, or removes it when more keyframes contradict than measured it.
    ///
    /// It is settled when the number of keyframes that measured it has passed 1, 2, 4, 8..., as the mean changes little between
    /// them. The errors of several measurements by one keyframe are those of the same depth image, and do not average out.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn update(&mut self, id: u32) -> LandmarkUpdate {
        let landmark = &mut self.records[id as usize];
        if landmark.is_removed {
            return LandmarkUpdate::Unchanged;
        }
        if landmark.contradictions > landmark.keyframes {
            landmark.is_removed = true;
            self.tree.remove(&indexed(&landmark.position, id));
            return LandmarkUpdate::Removed;
        }
        if landmark.keyframes.checked_ilog2() == landmark.settled_at.checked_ilog2() {
            return LandmarkUpdate::Unchanged;
        }
        landmark.settled_at = landmark.keyframes;
        self.settle(id)
    }

    /// Applies the correction of a measurement.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn correct(&mut self, correction: &Correction) {
        let landmark = &mut self.records[correction.landmark as usize];
        landmark.weighted += correction.weighted;
        landmark.weight -= correction.weight;
        landmark.measurements -= correction.measurements;
    }

    /// One keyframe less measured the landmark.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn forget_keyframe(&mut self, id: u32) {
        let landmark = &mut self.records[id as usize];
        landmark.keyframes = landmark.keyframes.saturating_sub(1).max(1);
    }

    /// Moves a landmark to the mean of its corrected measurements where that is far enough, or removes it when it has none any
    /// more.
    ///
    /// # Panics
    /// When the index is out of range.
    pub(super) fn settle_again(&mut self, id: u32) -> LandmarkUpdate {
        let landmark = &mut self.records[id as usize];
        if landmark.is_removed {
            return LandmarkUpdate::Unchanged;
        }
        if landmark.measurements == 0 {
            landmark.is_removed = true;
            self.tree.remove(&indexed(&landmark.position, id));
            return LandmarkUpdate::Removed;
        }
        match self.settle(id) {
            LandmarkUpdate::Settled { position: None, .. } => LandmarkUpdate::Unchanged,
            moved => moved,
        }
    }

    /// Moves a landmark to the mean of its measurements, where that is far enough.
    fn settle(&mut self, id: u32) -> LandmarkUpdate {
        let landmark = &mut self.records[id as usize];
        let mean = Point3::from(landmark.weighted / landmark.weight);
        let sigma = landmark.sigma();
        let moved = (mean - landmark.position).norm();
        // False also for a NaN mean.
        let is_significant = moved > self.options.settling_share * sigma;
        let keyframes = landmark.keyframes;
        if is_significant {
            self.tree.remove(&indexed(&landmark.position, id));
            landmark.position = mean;
            self.tree.insert(indexed(&mean, id));
        }
        LandmarkUpdate::Settled {
            position: is_significant.then_some(mean),
            sigma: sigma / f64::from(keyframes).sqrt(),
        }
    }

    fn nearest_within_gates(&self, measurement: &Measurement) -> Option<u32> {
        let lateral = self.options.lateral_px * measurement.pixel;
        let axial = self.options.depth_sigmas * measurement.sigma;
        if !(lateral > 0.0 && axial > 0.0) {
            return None;
        }
        let reach = measurement.direction.map(|along| {
            // Half extent of the gate ellipsoid along a coordinate axis.
            (lateral.powi(2) + (axial.powi(2) - lateral.powi(2)) * along.powi(2)).sqrt()
        });
        let low = measurement.point_in_world - reach;
        let high = measurement.point_in_world + reach;
        let candidates = AABB::from_corners(rounded(&low), rounded(&high));
        self.tree
            .locate_in_envelope_intersecting(candidates)
            .filter_map(|entry| {
                let offset = self.position(entry.data) - measurement.point_in_world;
                let along = offset.dot(&measurement.direction);
                let across = (offset.norm_squared() - along * along).max(0.0);
                let share = (along / axial).powi(2) + across / (lateral * lateral);
                (share < 1.0).then_some((share, entry.data))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
            .map(|(_, id)| id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NARROW: LandmarkOptions = LandmarkOptions {
        join: true,
        lateral_px: 2.5,
        depth_sigmas: 2.0,
        settling_share: 0.5,
    };

    fn at(x: f64, y: f64, z: f64) -> Measurement {
        Measurement {
            point_in_world: Point3::new(x, y, z),
            direction: Vector3::z_axis(),
            pixel: 0.002,
            sigma: 0.01,
        }
    }

    #[test]
    fn gates_are_pixels_across_and_deviations_along_the_ray() {
        let mut landmarks = Landmarks::new(NARROW);
        assert_eq!(landmarks.associate(&at(0.0, 0.0, 2.0)), Association::New(0));
        assert_eq!(
            landmarks.associate(&at(0.0, 0.0, 2.019)),
            Association::Existing(0)
        );
        assert_eq!(
            landmarks.associate(&at(0.0049, 0.0, 2.0)),
            Association::Existing(0)
        );
        assert_eq!(
            landmarks.associate(&at(0.0051, 0.0, 2.0)),
            Association::New(1)
        );
        assert_eq!(
            landmarks.associate(&at(0.0, 0.0, 2.021)),
            Association::New(2)
        );
        assert_eq!(landmarks.tree.size(), 3);
    }

    #[test]
    fn the_nearest_landmark_is_chosen_and_ties_go_to_the_oldest() {
        let mut landmarks = Landmarks::new(NARROW);
        landmarks.associate(&at(-0.004, 0.0, 2.0));
        landmarks.associate(&at(0.004, 0.0, 2.0));
        assert_eq!(
            landmarks.associate(&at(0.001, 0.0, 2.0)),
            Association::Existing(1)
        );
        assert_eq!(
            landmarks.associate(&at(0.0, 0.0, 2.0)),
            Association::Existing(0)
        );
    }

    #[test]
    fn a_landmark_moves_to_the_mean() {
        let mut landmarks = Landmarks::new(NARROW);
        landmarks.associate(&at(0.0, 0.0, 2.0));
        landmarks.add_measurement(0, &at(0.0, 0.0, 2.02));
        let mean = settled_position(landmarks.update(0)).expect("a centimetre is a deviation");
        assert!((mean - Point3::new(0.0, 0.0, 2.01)).norm() < 1e-12);
        assert_eq!(
            landmarks.associate(&at(0.0, 0.0, 2.029)),
            Association::Existing(0)
        );
        // Still the first keyframe.
        assert_eq!(landmarks.update(0), LandmarkUpdate::Unchanged);
    }

    fn settled_position(update: LandmarkUpdate) -> Option<Point3<f64>> {
        match update {
            LandmarkUpdate::Settled { position, .. } => position,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_landmark_settles_with_any_number_of_measurements_a_keyframe() {
        // Three is no power of two, nor is any multiple of it.
        let mut landmarks = Landmarks::new(NARROW);
        let mut settled = Vec::new();
        for keyframe in 1..=9 {
            landmarks.begin_keyframe();
            let z = if keyframe == 1 { 2.0 } else { 2.015 };
            for _ in 0..3 {
                assert_ne!(landmarks.associate(&at(0.0, 0.0, z)), Association::New(1));
            }
            if let LandmarkUpdate::Settled { sigma, .. } = landmarks.update(0) {
                assert!((sigma - 0.01 / f64::from(keyframe).sqrt()).abs() < 1e-12);
                settled.push(keyframe);
            }
        }
        assert_eq!(settled, [1, 2, 4, 8]);
        // The mean of the first eight keyframes; after four it was too close to the position to move.
        assert!((landmarks.position(0).z - (2.0 + 7.0 * 2.015) / 8.0).abs() < 1e-12);
    }

    #[test]
    fn a_landmark_settles_after_it_has_passed_a_power_of_two() {
        let mut landmarks = Landmarks::new(NARROW);
        landmarks.associate(&at(0.0, 0.0, 2.0));
        landmarks.update(0);
        // Measured after the update of the second keyframe, as corrections are.
        for _ in 0..2 {
            landmarks.begin_keyframe();
            landmarks.add_measurement(0, &at(0.0, 0.0, 2.018));
        }
        let mean = settled_position(landmarks.update(0)).expect("more than half a deviation");
        assert!((mean.z - 2.012).abs() < 1e-12);
    }

    #[test]
    fn keyframes_are_weighed_against_keyframes() {
        let mut landmarks = Landmarks::new(NARROW);
        for _ in 0..5 {
            landmarks.associate(&at(0.0, 0.0, 2.0));
        }
        for _ in 0..2 {
            landmarks.begin_keyframe();
            landmarks.add_contradiction(0);
        }
        assert_eq!(landmarks.update(0), LandmarkUpdate::Removed);
    }

    #[test]
    fn a_landmark_is_removed_when_most_keyframes_contradict_it() {
        let mut landmarks = Landmarks::new(NARROW);
        landmarks.associate(&at(0.0, 0.0, 2.0));
        landmarks.add_contradiction(0);
        assert_eq!(settled_position(landmarks.update(0)), None);
        landmarks.add_contradiction(0);
        assert_eq!(landmarks.update(0), LandmarkUpdate::Removed);
        assert_eq!((landmarks.tree.size(), landmarks.is_in_use(0)), (0, false));
        assert_eq!(landmarks.update(0), LandmarkUpdate::Unchanged);
        assert_eq!(landmarks.associate(&at(0.0, 0.0, 2.0)), Association::New(1));
    }

    #[test]
    fn a_landmark_comes_back_when_contradictions_are_taken_back() {
        let mut landmarks = Landmarks::new(NARROW);
        for _ in 0..2 {
            landmarks.begin_keyframe();
            landmarks.associate(&at(0.0, 0.0, 2.0));
        }
        for _ in 0..4 {
            landmarks.add_contradiction(0);
        }
        assert_eq!(landmarks.update(0), LandmarkUpdate::Removed);
        assert!(!landmarks.take_back_contradiction(0));
        assert!(landmarks.take_back_contradiction(0));
        assert!(landmarks.is_in_use(0));
        assert_eq!(
            landmarks.associate(&at(0.0, 0.0, 2.0)),
            Association::Existing(0)
        );
        assert!(!landmarks.take_back_contradiction(0));
    }

    #[test]
    fn a_landmark_that_another_replaced_does_not_come_back() {
        let mut landmarks = Landmarks::new(NARROW);
        landmarks.associate(&at(0.0, 0.0, 2.0));
        landmarks.add_contradiction(0);
        landmarks.add_contradiction(0);
        landmarks.update(0);
        assert_eq!(
            landmarks.associate(&at(0.001, 0.0, 2.0)),
            Association::New(1)
        );
        assert!(!landmarks.take_back_contradiction(0));
        assert!(!landmarks.is_in_use(0));
    }

    #[test]
    fn colours_are_averaged() {
        let mut landmarks = Landmarks::new(NARROW);
        landmarks.associate(&at(0.0, 0.0, 2.0));
        assert_eq!(landmarks.color(0), None);
        landmarks.add_color(0, [10, 20, 255]);
        landmarks.add_color(0, [20, 21, 255]);
        assert_eq!(landmarks.color(0), Some([15, 21, 255]));
    }

    #[test]
    fn without_fusion_every_measurement_is_a_landmark() {
        let mut landmarks = Landmarks::new(LandmarkOptions {
            join: false,
            ..LandmarkOptions::default()
        });
        assert_eq!(landmarks.associate(&at(0.0, 0.0, 2.0)), Association::New(0));
        assert_eq!(landmarks.associate(&at(0.0, 0.0, 2.0)), Association::New(1));
    }
}
