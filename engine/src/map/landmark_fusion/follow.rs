//! The carver follows the landmarks: points that move, rays, and corrections of keyframes.

use linecarve_carving::{Carver, Transaction, TransactionError, ViewId};
use nalgebra::{Isometry3, Point3};

use super::LandmarkFusion;
use crate::map::keyframe_measurements::Correction;
use crate::map::landmarks::LandmarkUpdate;
use crate::map::ray_selection::RayChange;

impl LandmarkFusion {
    /// Updates the landmarks that the keyframe observes or contradicts. Returns how many points moved and how many were
    /// removed. Removed landmarks are no longer listed as seen.
    pub(in crate::map) fn update_landmarks(
        &mut self,
        transaction: &mut Transaction<'_>,
    ) -> Result<(usize, usize), TransactionError> {
        let mut removed = 0;
        self.moved.clear();
        for index in 0..self.contradicted.len() + self.seen.len() {
            let landmark = match index.checked_sub(self.contradicted.len()) {
                Some(seen) => self.seen[seen],
                None => self.contradicted[index],
            };
            let update = self.landmarks.update(landmark);
            removed += usize::from(update == LandmarkUpdate::Removed);
            self.follow(transaction, landmark, update)?;
        }
        let landmarks = &self.landmarks;
        self.seen.retain(|landmark| landmarks.is_in_use(*landmark));
        Ok((self.moved.len(), removed))
    }

    /// Adds a ray from the view to each observed landmark whose bin of directions has none. Selects anew the rays of
    /// landmarks that moved.
    ///
    /// # Complexity
    /// Linear in the rays of the observed landmarks, and in the observations of those that moved.
    pub(in crate::map) fn add_observations(
        &mut self,
        transaction: &mut Transaction<'_>,
        view: ViewId,
        center: &Point3<f64>,
    ) -> Result<(), TransactionError> {
        let center_of = |before: &Carver, other: ViewId| {
            if other == view {
                *center
            } else {
                before.view(other).unwrap_or(*center)
            }
        };
        self.select_rays(transaction, center_of)?;
        if let Some(measurements) = &mut self.measurements {
            measurements.set_view(view);
        }
        self.observed.clear();
        for &landmark in &self.seen {
            let position = self.landmarks.position(landmark);
            let has_ray = self.rays.observe(landmark, &position, view, |other| {
                center_of(transaction.before(), other)
            });
            if has_ray {
                self.observed.push(landmark);
                transaction.add_observation(view, self.points[landmark as usize], 1)?;
            }
        }
        Ok(())
    }

    /// Selects the rays of the landmarks that moved anew.
    fn select_rays(
        &mut self,
        transaction: &mut Transaction<'_>,
        center_of: impl Fn(&Carver, ViewId) -> Point3<f64>,
    ) -> Result<(), TransactionError> {
        for landmark in self.moved.drain(..) {
            let point = self.points[landmark as usize];
            let position = self.landmarks.position(landmark);
            let changes = self.rays.select(landmark, &position, |other| {
                center_of(transaction.before(), other)
            });
            for change in changes {
                match *change {
                    RayChange::Add(view) => transaction.add_observation(view, point, 1)?,
                    RayChange::Remove(view) => transaction.remove_observation(view, point)?,
                }
            }
        }
        Ok(())
    }

    /// Makes the carver follow what became of a landmark.
    fn follow(
        &mut self,
        transaction: &mut Transaction<'_>,
        landmark: u32,
        update: LandmarkUpdate,
    ) -> Result<(), TransactionError> {
        let point = self.points[landmark as usize];
        match update {
            LandmarkUpdate::Unchanged => {}
            LandmarkUpdate::Settled { position, sigma } => {
                transaction.set_sigma(point, Some(self.sigma_factor * sigma))?;
                if let Some(position) = position {
                    transaction.move_point(point, position)?;
                    self.moved.push(landmark);
                }
            }
            LandmarkUpdate::Removed => {
                transaction.remove_point(point)?;
                self.rays.remove(landmark);
            }
        }
        Ok(())
    }

    /// Moves keyframes, given by number and view, both ascending, to these poses, or removes them, with what they measured. Landmarks follow the
    /// mean of their measurements; those without any are removed. What the keyframes contradicted before is taken back, and landmarks that
    /// were removed for that return. [`seen`](Self::seen) lists the landmarks concerned that are
    /// left, ascending.
    ///
    /// An approximation: measurements stay with the landmarks that they joined before.
    ///
    /// # Errors
    /// When the carver rejects a position.
    ///
    /// # Complexity
    /// The measurements of these keyframes, and the observations of the landmarks concerned; where landmarks return, the measurements of all
    /// keyframes.
    pub(in crate::map) fn correct(
        &mut self,
        transaction: &mut Transaction<'_>,
        keyframes: &[(usize, ViewId, Option<Isometry3<f64>>)],
    ) -> Result<(), TransactionError> {
        let Some(measurements) = &mut self.measurements else {
            return Ok(());
        };
        self.seen.clear();
        self.contradicted.clear();
        self.moved.clear();
        let mut without_view = Vec::new();
        let mut taken_back = Vec::new();
        for &(keyframe, view, pose) in keyframes {
            let first = self.seen.len();
            taken_back.extend(measurements.take_contradictions(keyframe));
            let mut apply = |correction: Correction| {
                self.landmarks.correct(&correction);
                self.seen.push(correction.landmark);
            };
            match pose {
                Some(pose) => measurements
                    .move_keyframe(keyframe, pose)
                    .for_each(&mut apply),
                None => measurements.remove_keyframe(keyframe).for_each(&mut apply),
            }
            if pose.is_none() {
                let mut measured = self.seen[first..].to_vec();
                measured.sort_unstable();
                measured.dedup();
                for &landmark in &measured {
                    self.landmarks.forget_keyframe(landmark);
                    self.rays.forget_view(landmark, view);
                }
                without_view.extend(measured);
            }
        }
        let is_back = |landmark: &u32| self.landmarks.take_back_contradiction(*landmark);
        let mut returned: Vec<u32> = taken_back.into_iter().filter(is_back).collect();
        returned.sort_unstable();
        let views_of_returned = match returned.is_empty() {
            true => Vec::new(),
            false => measurements.views_of(&returned),
        };
        self.seen.sort_unstable();
        self.seen.dedup();
        for index in 0..self.seen.len() {
            let landmark = self.seen[index];
            // Those that return get a point of their own below.
            if returned.binary_search(&landmark).is_ok() {
                continue;
            }
            let update = self.landmarks.settle_again(landmark);
            self.follow(transaction, landmark, update)?;
        }
        let landmarks = &self.landmarks;
        let is_known = |landmark: &u32| {
            landmarks.is_in_use(*landmark) && returned.binary_search(landmark).is_err()
        };
        without_view.retain(is_known);
        self.seen.retain(is_known);
        self.moved.extend(without_view);
        self.moved.sort_unstable();
        self.moved.dedup();
        let pose_of = |view: ViewId| {
            let found = keyframes.binary_search_by_key(&view, |(_, view, _)| *view);
            found.ok().and_then(|at| keyframes[at].2)
        };
        let center_of = |before: &Carver, view: ViewId| match pose_of(view) {
            Some(pose) => pose.translation.vector.into(),
            None => before.view(view).unwrap_or(Point3::origin()),
        };
        for &landmark in &self.seen {
            let position = self.landmarks.position(landmark);
            self.rays.follow_views(landmark, &position, |view| {
                center_of(transaction.before(), view)
            });
        }
        self.select_rays(transaction, center_of)?;
        for &landmark in &returned {
            let position = self.landmarks.position(landmark);
            let point = transaction.add_point(position)?;
            let sigma = self.sigma_factor * self.landmarks.sigma(landmark);
            transaction.set_sigma(point, Some(sigma))?;
            self.points[landmark as usize] = point;
        }
        for (landmark, view) in views_of_returned {
            let position = self.landmarks.position(landmark);
            let has_ray = self.rays.observe(landmark, &position, view, |other| {
                center_of(transaction.before(), other)
            });
            if has_ray {
                transaction.add_observation(view, self.points[landmark as usize], 1)?;
            }
        }
        self.seen.extend(returned);
        self.seen.sort_unstable();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use linecarve_carving::Carver;
    use nalgebra::Unit;

    use super::*;
    use crate::Options;
    use crate::map::landmarks::Measurement;

    /// Landmarks that get a ray from views at these positions, each observing the same two.
    fn rays_from(options: &Options, centers: &[[f64; 3]]) -> Vec<Vec<u32>> {
        let mut carver = Carver::default();
        let mut fusion = LandmarkFusion::new(options);
        let look = |center: &[f64; 3]| {
            let center = Point3::from(*center);
            let points = [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0]].map(Point3::from);
            let measured = points.map(|point| Measurement {
                point_in_world: point,
                direction: Unit::new_normalize(point - center),
                pixel: 0.01,
                sigma: 0.01,
            });
            let mut transaction = carver.transaction();
            let view = transaction.add_view(center).unwrap();
            fusion.begin_keyframe(&Isometry3::identity());
            fusion
                .add_points(&mut transaction, measured.into_iter())
                .unwrap();
            fusion
                .add_observations(&mut transaction, view, &center)
                .unwrap();
            transaction.commit().unwrap();
            fusion.observed().to_vec()
        };
        centers.iter().map(look).collect()
    }

    #[test]
    fn a_landmark_gets_one_ray_from_each_direction() {
        let options = Options::default();
        let both = vec![0, 1];
        // Equal and close centres add no ray, nor does one further away; one aside does.
        let rays = rays_from(
            &options,
            &[
                [0.0; 3],
                [0.06, 0.0, 0.0],
                [0.0; 3],
                [0.0, 0.0, -0.2],
                [3.0, 0.0, 0.0],
            ],
        );
        assert_eq!(rays, [both.clone(), vec![], vec![], vec![], both.clone()]);
        let mut all = Options::default();
        all.carving.ray_angle_deg = 0.0;
        assert_eq!(
            rays_from(&all, &[[0.0; 3], [1e-9, 0.0, 0.0]]),
            [both.clone(), both]
        );
    }
}
