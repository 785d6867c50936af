//! When the depth of which keyframe is estimated, and from which others.

use std::collections::VecDeque;

use linecarve_lines::depth::semi_dense::{ViewGeometry, choose_neighbours};
use nalgebra::Isometry3;

use crate::front_end::SemiDenseSource;

/// An estimate that is due.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::front_end) struct Task {
    /// Number of the keyframe.
    pub(super) keyframe: usize,
    /// Numbers of its neighbours, best first.
    pub(super) neighbours: Vec<usize>,
    /// Whether this is its last estimate.
    pub(super) is_final: bool,
}

/// Decides from poses alone, keyframe by keyframe: a depth is due for the first time as soon as enough neighbours have come, and
/// for the last time when the keyframes behind it that may be neighbours have.
#[derive(Debug)]
pub(in crate::front_end) struct Schedule {
    source: SemiDenseSource,
    /// The keyframes that may still be neighbours, oldest first; `None`: could not be read.
    window: VecDeque<Option<Waiting>>,
    /// Number of the first of them.
    first: usize,
}

#[derive(Debug)]
struct Waiting {
    geometry: ViewGeometry,
    is_published: bool,
}

impl Schedule {
    pub(super) fn new(source: &SemiDenseSource) -> Self {
        Self {
            source: *source,
            window: VecDeque::new(),
            first: 0,
        }
    }

    /// Number of the oldest keyframe that a later task may need.
    pub(super) fn oldest_needed(&self) -> usize {
        self.first
    }

    /// Takes the next keyframe, `None` when it could not be read, and returns what is due.
    pub(super) fn push(&mut self, geometry: Option<ViewGeometry>) -> Vec<Task> {
        let options = &self.source.options;
        self.window.push_back(geometry.map(|geometry| Waiting {
            geometry,
            is_published: false,
        }));
        let newest = self.first + self.window.len() - 1;
        let awaiting = (newest + 1).saturating_sub(options.future).max(self.first);
        let mut tasks = Vec::new();
        for keyframe in awaiting..=newest {
            let is_open = self.window[keyframe - self.first]
                .as_ref()
                .is_some_and(|waiting| !waiting.is_published);
            if !is_open {
                continue;
            }
            let neighbours = self.neighbours(keyframe);
            if neighbours.len() >= options.first_neighbours
                && let Some(waiting) = &mut self.window[keyframe - self.first]
            {
                waiting.is_published = true;
                tasks.push(Task {
                    keyframe,
                    neighbours,
                    is_final: false,
                });
            }
        }
        if let Some(keyframe) = newest.checked_sub(options.future) {
            tasks.extend(self.last_estimate(keyframe));
        }
        while self.first + options.past + options.future < newest + 1 {
            self.window.pop_front();
            self.first += 1;
        }
        tasks
    }

    /// Gives a keyframe of the window another pose; `None` takes it out: it is nobody's neighbour any more, and nothing of it is due.
    pub(super) fn move_to(&mut self, keyframe: usize, pose: Option<Isometry3<f64>>) {
        let place = keyframe.checked_sub(self.first);
        let Some(slot) = place.and_then(|place| self.window.get_mut(place)) else {
            return;
        };
        match (slot.as_mut(), pose) {
            (Some(waiting), Some(pose)) => waiting.geometry.world_from_camera = pose,
            _ => *slot = None,
        }
    }

    /// The sequence is over: the last estimates of what is left.
    pub(super) fn finish(&self) -> Vec<Task> {
        let end = self.first + self.window.len();
        let start = end
            .saturating_sub(self.source.options.future)
            .max(self.first);
        (start..end)
            .filter_map(|keyframe| self.last_estimate(keyframe))
            .collect()
    }

    fn last_estimate(&self, keyframe: usize) -> Option<Task> {
        self.window[keyframe - self.first].as_ref()?;
        Some(Task {
            keyframe,
            neighbours: self.neighbours(keyframe),
            is_final: true,
        })
    }

    /// The best neighbours among the keyframes that have come.
    fn neighbours(&self, keyframe: usize) -> Vec<usize> {
        let options = &self.source.options;
        let Some(own) = &self.window[keyframe - self.first] else {
            return Vec::new();
        };
        let end = (keyframe + options.future + 1).min(self.first + self.window.len());
        let start = keyframe.saturating_sub(options.past).max(self.first);
        let (numbers, candidates): (Vec<usize>, Vec<&ViewGeometry>) = (start..end)
            .filter(|&other| other != keyframe)
            .filter_map(|other| {
                let waiting = self.window[other - self.first].as_ref()?;
                Some((other, &waiting.geometry))
            })
            .unzip();
        choose_neighbours(
            &own.geometry,
            &candidates,
            self.source.median_depth,
            &options.neighbours,
        )
        .into_iter()
        .map(|position| numbers[position])
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::front_end::SemiDenseStage;
    use linecarve_lines::camera::Camera;

    fn view(x: f64) -> ViewGeometry {
        ViewGeometry {
            camera: Camera::pinhole(500.0, 500.0, 319.5, 239.5).unwrap(),
            world_from_camera: Isometry3::translation(x, 0.0, 0.0),
            width: 640,
            height: 480,
        }
    }

    fn schedule() -> Schedule {
        Schedule::new(&SemiDenseSource {
            options: SemiDenseStage {
                past: 4,
                future: 3,
                ..SemiDenseStage::default()
            },
            median_depth: 2.0,
        })
    }

    #[test]
    fn every_keyframe_is_published_at_three_neighbours_and_finished_once() {
        let mut schedule = schedule();
        let mut published = vec![Vec::new(); 12];
        let mut finished = vec![Vec::new(); 12];
        for step in 0..=12 {
            let tasks = if step < 12 {
                schedule.push(Some(view(0.1 * step as f64)))
            } else {
                schedule.finish()
            };
            for task in tasks {
                assert!(
                    task.neighbours
                        .iter()
                        .all(|&other| other <= step && other != task.keyframe)
                );
                assert!(task.neighbours.len() >= 3);
                if task.is_final {
                    finished[task.keyframe].push(step);
                } else {
                    published[task.keyframe].push(step);
                }
            }
            assert!(schedule.window.len() <= 8);
        }
        for keyframe in 0..12_usize {
            // The first has three neighbours when its last has come: it is finished at once.
            let expected = if keyframe == 0 {
                vec![]
            } else {
                vec![keyframe.max(3)]
            };
            assert_eq!(published[keyframe], expected);
            assert_eq!(finished[keyframe], [(keyframe + 3).min(12)]);
        }
    }

    #[test]
    fn keyframes_that_are_taken_out_are_in_no_task() {
        let mut schedule = schedule();
        for step in 0..4 {
            schedule.push(Some(view(0.1 * f64::from(step))));
        }
        schedule.move_to(2, None);
        // Numbers that are no longer there, or not yet, are nobody.
        schedule.move_to(99, None);
        // Far away, it sees nothing of what the others see.
        schedule.move_to(1, Some(Isometry3::translation(50.0, 0.0, 0.0)));
        let mut tasks = schedule.push(Some(view(0.4)));
        tasks.extend(schedule.finish());
        assert!(!tasks.is_empty());
        for task in tasks {
            assert_ne!(task.keyframe, 2);
            assert!(!task.neighbours.contains(&2));
            assert_eq!(task.keyframe == 1, task.neighbours.is_empty());
            assert!(!task.neighbours.contains(&1));
        }
    }

    #[test]
    fn unreadable_and_lone_keyframes_are_passed_over() {
        let mut schedule = schedule();
        let mut tasks = schedule.push(Some(view(0.0)));
        for _ in 0..5 {
            tasks.extend(schedule.push(None));
        }
        tasks.extend(schedule.finish());
        assert_eq!(
            tasks,
            [Task {
                keyframe: 0,
                neighbours: Vec::new(),
                is_final: true
            }]
        );
    }
}
