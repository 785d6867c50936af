use nalgebra::{Translation3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::front_end::Keyframe;
use crate::map::Map;
use crate::options::Options;

fn view(x: f64) -> ModelView {
    ModelView {
        name: String::new(),
        world_from_camera: Isometry3::from_parts(
            Translation3::new(x, 0.0, 0.0),
            UnitQuaternion::identity(),
        ),
        camera: None,
        size_px: None,
    }
}

fn random_point(rng: &mut impl Rng) -> Point3<f64> {
    Point3::new(
        rng.random_range(-2.0..2.0),
        rng.random_range(-2.0..2.0),
        rng.random_range(3.0..4.0),
    )
}

/// Views and points as they should be.
#[derive(Default)]
struct Expected {
    views: Vec<Option<ModelView>>,
    points: Vec<Option<(Point3<f64>, BTreeSet<u32>)>>,
}

impl Expected {
    /// A random change, which is made here at once.
    fn change(&mut self, rng: &mut impl Rng) -> ObservationChange {
        let mut change = ObservationChange::default();
        if self.views.len() < 4 || rng.random_bool(0.3) {
            let new = view(rng.random_range(-1.0..1.0));
            self.views.push(Some(new.clone()));
            change.views.push(new);
        }
        let known: Vec<u32> = (0..self.views.len() as u32)
            .filter(|view| self.views[*view as usize].is_some())
            .collect();
        if let Some(&moved) = known.first()
            && rng.random_bool(0.3)
        {
            let pose = view(rng.random_range(-1.0..1.0)).world_from_camera;
            change.moved_views.push((moved, pose));
            self.views[moved as usize]
                .as_mut()
                .unwrap()
                .world_from_camera = pose;
        }
        if known.len() > 4 && rng.random_bool(0.2) {
            let gone = known[rng.random_range(0..known.len())];
            change.removed_views.push(gone);
            self.views[gone as usize] = None;
            for (_, seen) in self.points.iter_mut().flatten() {
                seen.remove(&gone);
            }
        }
        for _ in 0..rng.random_range(0..12) {
            let number = rng.random_range(0..=self.points.len());
            let position = random_point(rng);
            match self.points.get_mut(number) {
                Some(Some((place, _))) => *place = position,
                Some(None) => continue,
                None => self.points.push(Some((position, BTreeSet::new()))),
            }
            change.points.push(ObservedPoint {
                number: number as u32,
                position,
                sigma: None,
                kind: PointKind::Single,
            });
        }
        if self.points.len() > 10 && rng.random_bool(0.3) {
            let gone = rng.random_range(0..self.points.len());
            if self.points[gone].take().is_some() {
                change.removed_points.push(gone as u32);
            }
        }
        for number in 0..self.points.len() {
            let Some((_, seen)) = &mut self.points[number] else {
                continue;
            };
            for view in 0..self.views.len() as u32 {
                if self.views[view as usize].is_none() {
                    continue;
                }
                if rng.random_bool(0.2) && seen.insert(view) {
                    change.observations.push([view, number as u32]);
                } else if rng.random_bool(0.05) && seen.remove(&view) {
                    change.removed_observations.push([view, number as u32]);
                }
            }
        }
        change
    }

    /// All of it as a model.
    fn model(&self) -> SparseModel {
        let mut numbers = vec![0; self.views.len()];
        let mut views = Vec::new();
        for (number, view) in self.views.iter().enumerate() {
            if let Some(view) = view {
                numbers[number] = views.len() as u32;
                views.push(view.clone());
            }
        }
        let points = self
            .points
            .iter()
            .flatten()
            .map(|(position, seen)| ModelPoint {
                point_in_world: *position,
                color: None,
                observations: seen
                    .iter()
                    .map(|view| ModelObservation {
                        view: numbers[*view as usize],
                        pixel: None,
                    })
                    .collect(),
            });
        SparseModel {
            points: points.collect(),
            views,
        }
    }
}

#[test]
fn any_changes_end_with_the_map_of_the_final_model() {
    // By default the number of views follows from a whole model, which a session does not know.
    let mut options = Options::default();
    options.point_model.min_views = 3;
    for seed in 0..200 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut expected = Expected::default();
        let mut map = Map::of_observations(&options, None);
        map.follow_surface();
        for _ in 0..10 {
            let change = expected.change(&mut rng);
            map.observe(&change).unwrap();
            map.take_surface_change();
        }
        map.finish().unwrap();
        map.take_surface_change();
        map.carver().check().unwrap();
        let model = expected.model();
        let views = model.views.len();
        let mut batch = Map::of_model(&options, model).unwrap();
        batch.push(&Keyframe::Views(0..views)).unwrap();
        assert_eq!(map.median_depth(), batch.median_depth(), "seed {seed}");
        let (ours, theirs) = (map.surface(), batch.surface());
        assert_eq!(ours.positions, theirs.positions, "seed {seed}");
        assert_eq!(ours.triangles, theirs.triangles, "seed {seed}");
    }
}

#[test]
fn points_on_lines_need_one_view_before_them() {
    let mut map = Map::of_observations(&Options::default(), Some(2.0));
    let point = |number: u32, z: f64| ObservedPoint {
        number,
        position: Point3::from(Vector3::new(0.1 * f64::from(number), 0.0, z)),
        sigma: Some(0.01),
        kind: PointKind::OnLine,
    };
    let change = ObservationChange {
        views: vec![view(0.0)],
        points: vec![point(0, 2.0), point(1, -2.0), point(2, 2.0)],
        observations: vec![[0, 0], [0, 1]],
        ..ObservationChange::default()
    };
    map.observe(&change).unwrap();
    assert_eq!(map.points().len(), 1);
}
