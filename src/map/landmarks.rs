//! Points of the map: what several keyframes measure at one place is one point that all of them see.
//!
//! A segment's end points are measured anew in every keyframe, each time with an error. Carved one by one they form a
//! noisy shell: rays to the points at its back cut away the cells between those at its front. Joined, they are fewer
//! and calmer, and each has the rays of all its keyframes. A landmark lies at the mean of its measurements, and where
//! more keyframes look through it than see it, it is given up.

use nalgebra::{Point3, Unit, Vector3};
use rstar::primitives::GeomWithData;
use rstar::{AABB, RTree};

/// When two measurements are of one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LandmarkOptions {
    /// Whether measurements are joined at all; otherwise each is a point of its own, as in the paper.
    pub join: bool,
    /// Across the view ray: this many pixels. On two indoor sequences 6 px in place of 4 leave a quarter fewer vertices,
    /// for a loss of less than 0.01 in F at 5 cm.
    pub lateral_px: f64,
    /// Along the view ray: this many standard deviations of the depth.
    pub depth_sigmas: f64,
    /// A landmark moves to the mean of its measurements when that is further away than this share of their standard
    /// deviation (of one measurement along its ray), so that the map is not rebuilt for nothing.
    pub settling_share: f64,
}

impl Default for LandmarkOptions {
    fn default() -> Self {
        Self {
            join: true,
            lateral_px: 6.0,
            depth_sigmas: 3.0,
            settling_share: 0.5,
        }
    }
}

/// One measured point.
#[derive(Debug, Clone, Copy)]
pub struct Measurement {
    /// Where it was measured.
    pub point_in_world: Point3<f64>,
    /// From the camera to it.
    pub direction: Unit<Vector3<f64>>,
    /// Length of one pixel at its depth.
    pub pixel: f64,
    /// Standard deviation along the view ray.
    pub sigma: f64,
}

/// What became of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Observed {
    /// The first of its place: a landmark with this number, counted from 0.
    New(u32),
    /// It is this landmark, seen again.
    Again(u32),
}

/// A point of the map.
#[derive(Debug, Clone, Copy)]
pub(super) struct Landmark {
    /// Where it lies.
    pub position: Point3<f64>,
    /// Sum of the measurements, each divided by its variance.
    weighted: Vector3<f64>,
    /// Sum of the inverse variances.
    weight: f64,
    /// Number of measurements.
    measured: u32,
    /// Number of keyframes that looked through it.
    contradicted: u32,
    /// Sum of the sRGB colours under which it was seen, and their number.
    colors: [u32; 4],
    is_given_up: bool,
}

impl Landmark {
    fn add(&mut self, measurement: &Measurement) {
        let weight = 1.0 / (measurement.sigma * measurement.sigma);
        self.weighted += weight * measurement.point_in_world.coords;
        self.weight += weight;
        self.measured += 1;
    }
}

/// What [`Landmarks::settle`] decides on a landmark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Settled {
    /// It is where it was.
    Stays,
    /// It has moved here.
    Moved(Point3<f64>),
    /// It is no longer part of the map.
    GivenUp,
}

/// Every landmark so far, with a spatial index.
#[derive(Debug, Default)]
pub(super) struct Landmarks {
    options: LandmarkOptions,
    records: Vec<Landmark>,
    tree: RTree<GeomWithData<[f64; 3], u32>>,
}

impl Landmarks {
    /// No landmark yet.
    pub(super) fn new(options: LandmarkOptions) -> Self {
        Self {
            options,
            records: Vec::new(),
            tree: RTree::new(),
        }
    }

    /// Where a landmark lies.
    ///
    /// # Panics
    /// When there never was one of this number.
    pub(super) fn position(&self, id: u32) -> Point3<f64> {
        self.records[id as usize].position
    }

    /// Whether a landmark has not been given up.
    ///
    /// # Panics
    /// When there never was one of this number.
    pub(super) fn is_in_use(&self, id: u32) -> bool {
        !self.records[id as usize].is_given_up
    }

    /// Numbers and positions of the landmarks in use in a box, given by its lowest and highest corner; in no particular order.
    pub(super) fn within(
        &self,
        [low, high]: [Point3<f64>; 2],
    ) -> impl Iterator<Item = (u32, Point3<f64>)> + '_ {
        let corners = AABB::from_corners(low.coords.into(), high.coords.into());
        self.tree
            .locate_in_envelope(corners)
            .map(|entry| (entry.data, Point3::from(*entry.geom())))
    }

    /// Finds the landmark that a measurement is of, or makes it one.
    ///
    /// The nearest landmark wins in the norm that counts pixels across the view ray and standard deviations along it,
    /// each as a share of its bound; of equally near ones the oldest. Expected O(log n).
    pub(super) fn observe(&mut self, measurement: &Measurement) -> Observed {
        if let Some(id) = self.find(measurement) {
            self.confirm(id, measurement);
            return Observed::Again(id);
        }
        let id = self.records.len() as u32;
        let position = measurement.point_in_world;
        let mut landmark = Landmark {
            position,
            weighted: Vector3::zeros(),
            weight: 0.0,
            measured: 0,
            contradicted: 0,
            colors: [0; 4],
            is_given_up: false,
        };
        landmark.add(measurement);
        self.records.push(landmark);
        self.tree
            .insert(GeomWithData::new(position.coords.into(), id));
        Observed::New(id)
    }

    /// The landmark that a measurement is of, as [`observe`](Self::observe) finds it; nothing is noted. Expected O(log n).
    pub(super) fn find(&self, measurement: &Measurement) -> Option<u32> {
        self.options
            .join
            .then(|| self.nearest_within_bounds(measurement))
            .flatten()
    }

    /// Notes another measurement of a landmark.
    ///
    /// # Panics
    /// When there never was one of this number.
    pub(super) fn confirm(&mut self, id: u32, measurement: &Measurement) {
        self.records[id as usize].add(measurement);
    }

    /// Notes the sRGB colour under which a keyframe sees a landmark.
    ///
    /// # Panics
    /// When there never was one of this number.
    pub(super) fn paint(&mut self, id: u32, color: [u8; 3]) {
        let colors = &mut self.records[id as usize].colors;
        for (sum, value) in colors.iter_mut().zip(color.into_iter().chain([1])) {
            *sum = sum.saturating_add(value.into());
        }
    }

    /// The mean colour of a landmark; `None` when no keyframe had one.
    ///
    /// # Panics
    /// When there never was one of this number.
    pub(super) fn color(&self, id: u32) -> Option<[u8; 3]> {
        let [r, g, b, count] = self.records[id as usize].colors;
        (count > 0).then(|| [r, g, b].map(|sum| ((sum + count / 2) / count) as u8))
    }

    /// Notes that a keyframe measured a surface behind a landmark, where it should have seen it.
    ///
    /// # Panics
    /// When there never was one of this number.
    pub(super) fn contradict(&mut self, id: u32) {
        self.records[id as usize].contradicted += 1;
    }

    /// Moves a landmark to the mean of its measurements, or gives it up when more keyframes contradict it than measured it.
    ///
    /// It moves with its 2nd, 4th, 8th... measurement only, and only when that is worth it: between them the mean
    /// hardly changes.
    ///
    /// # Panics
    /// When there never was one of this number.
    pub(super) fn settle(&mut self, id: u32) -> Settled {
        let landmark = &mut self.records[id as usize];
        if landmark.is_given_up {
            return Settled::Stays;
        }
        let indexed = GeomWithData::new(landmark.position.coords.into(), id);
        if landmark.contradicted > landmark.measured {
            landmark.is_given_up = true;
            self.tree.remove(&indexed);
            return Settled::GivenUp;
        }
        let mean = Point3::from(landmark.weighted / landmark.weight);
        let sigma = (f64::from(landmark.measured) / landmark.weight).sqrt();
        let moved = (mean - landmark.position).norm();
        // A mean that is not a number does not move the landmark either.
        let is_worth_it = moved > self.options.settling_share * sigma;
        if !landmark.measured.is_power_of_two() || !is_worth_it {
            return Settled::Stays;
        }
        landmark.position = mean;
        self.tree.remove(&indexed);
        self.tree.insert(GeomWithData::new(mean.coords.into(), id));
        Settled::Moved(mean)
    }

    fn nearest_within_bounds(&self, measurement: &Measurement) -> Option<u32> {
        let lateral = self.options.lateral_px * measurement.pixel;
        let axial = self.options.depth_sigmas * measurement.sigma;
        if !(lateral > 0.0 && axial > 0.0) {
            return None;
        }
        let reach = measurement.direction.map(|along| {
            // Half extent of the tolerance ellipsoid along a coordinate axis.
            (lateral.powi(2) + (axial.powi(2) - lateral.powi(2)) * along.powi(2)).sqrt()
        });
        let low = measurement.point_in_world - reach;
        let high = measurement.point_in_world + reach;
        let candidates = AABB::from_corners(low.coords.into(), high.coords.into());
        self.tree
            .locate_in_envelope_intersecting(candidates)
            .filter_map(|entry| {
                let offset = Point3::from(*entry.geom()) - measurement.point_in_world;
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
    fn bounds_are_pixels_across_and_deviations_along_the_ray() {
        let mut landmarks = Landmarks::new(NARROW);
        assert_eq!(landmarks.observe(&at(0.0, 0.0, 2.0)), Observed::New(0));
        assert_eq!(landmarks.observe(&at(0.0, 0.0, 2.019)), Observed::Again(0));
        assert_eq!(landmarks.observe(&at(0.0049, 0.0, 2.0)), Observed::Again(0));
        assert_eq!(landmarks.observe(&at(0.0051, 0.0, 2.0)), Observed::New(1));
        assert_eq!(landmarks.observe(&at(0.0, 0.0, 2.021)), Observed::New(2));
        assert_eq!(landmarks.tree.size(), 3);
    }

    #[test]
    fn the_nearest_wins_and_of_equals_the_oldest() {
        let mut landmarks = Landmarks::new(NARROW);
        landmarks.observe(&at(-0.004, 0.0, 2.0));
        landmarks.observe(&at(0.004, 0.0, 2.0));
        assert_eq!(landmarks.observe(&at(0.001, 0.0, 2.0)), Observed::Again(1));
        assert_eq!(landmarks.observe(&at(0.0, 0.0, 2.0)), Observed::Again(0));
    }

    #[test]
    fn a_landmark_moves_to_the_mean_and_is_found_there() {
        let mut landmarks = Landmarks::new(NARROW);
        landmarks.observe(&at(0.0, 0.0, 2.0));
        landmarks.confirm(0, &at(0.0, 0.0, 2.02));
        let Settled::Moved(mean) = landmarks.settle(0) else {
            panic!("a centimetre is a standard deviation");
        };
        assert!((mean - Point3::new(0.0, 0.0, 2.01)).norm() < 1e-12);
        assert_eq!(landmarks.observe(&at(0.0, 0.0, 2.029)), Observed::Again(0));
        // Three measurements: the mean hardly moves between powers of two.
        assert_eq!(landmarks.settle(0), Settled::Stays);
    }

    #[test]
    fn a_landmark_is_given_up_when_most_keyframes_look_through_it() {
        let mut landmarks = Landmarks::new(NARROW);
        landmarks.observe(&at(0.0, 0.0, 2.0));
        landmarks.contradict(0);
        assert_eq!(landmarks.settle(0), Settled::Stays);
        landmarks.contradict(0);
        assert_eq!(landmarks.settle(0), Settled::GivenUp);
        assert_eq!((landmarks.tree.size(), landmarks.is_in_use(0)), (0, false));
        assert_eq!(landmarks.settle(0), Settled::Stays);
        assert_eq!(landmarks.observe(&at(0.0, 0.0, 2.0)), Observed::New(1));
    }

    #[test]
    fn colours_are_averaged() {
        let mut landmarks = Landmarks::new(NARROW);
        landmarks.observe(&at(0.0, 0.0, 2.0));
        assert_eq!(landmarks.color(0), None);
        landmarks.paint(0, [10, 20, 255]);
        landmarks.paint(0, [20, 21, 255]);
        assert_eq!(landmarks.color(0), Some([15, 21, 255]));
    }

    #[test]
    fn nothing_is_joined_when_switched_off() {
        let mut landmarks = Landmarks::new(LandmarkOptions {
            join: false,
            ..LandmarkOptions::default()
        });
        assert_eq!(landmarks.observe(&at(0.0, 0.0, 2.0)), Observed::New(0));
        assert_eq!(landmarks.observe(&at(0.0, 0.0, 2.0)), Observed::New(1));
    }
}
