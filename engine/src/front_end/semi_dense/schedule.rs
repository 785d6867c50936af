//! Schedule of depth estimates: when a keyframe is estimated, and from which neighbours.

use std::collections::VecDeque;

use linecarve_lines::depth::semi_dense::{ViewGeometry, choose_neighbours};
use nalgebra::Isometry3;

use crate::front_end::SemiDenseSource;

/// A depth estimate to compute.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::front_end) struct Task {
    /// Number of the keyframe.
    pub(super) keyframe: usize,
    /// Numbers of its neighbours, best first.
    pub(super) neighbours: Vec<usize>,
    /// Whether this is its final estimate.
    pub(super) is_final: bool,
}

/// Schedules estimates from poses alone. The first estimate of a keyframe is due when it has enough neighbours, the final one
/// when all later possible neighbours have arrived.
#[derive(Debug)]
pub(in crate::front_end) struct Schedule {
    source: SemiDenseSource,
    /// Possible neighbours, oldest first; `None` for unreadable keyframes.
    window: VecDeque<Option<ScheduledView>>,
    /// Number of the first keyframe in the window.
    first: usize,
}

#[derive(Debug)]
struct ScheduledView {
    geometry: ViewGeometry,
    has_first_estimate: bool,
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

    /// Adds the next keyframe, `None` when it is unreadable, and returns the tasks due.
    pub(super) fn push(&mut self, geometry: Option<ViewGeometry>) -> Vec<Task> {
        let options = &self.source.options;
        self.window
            .push_back(geometry.map(|geometry| ScheduledView {
                geometry,
                has_first_estimate: false,
            }));
        let newest = self.first + self.window.len() - 1;
        let start = (newest + 1).saturating_sub(options.future).max(self.first);
        let mut tasks = Vec::new();
        for keyframe in start..=newest {
            let is_pending = self.window[keyframe - self.first]
                .as_ref()
                .is_some_and(|view| !view.has_first_estimate);
            if !is_pending {
                continue;
            }
            let neighbours = self.neighbours(keyframe);
            if neighbours.len() >= options.first_neighbours
                && let Some(view) = &mut self.window[keyframe - self.first]
            {
                view.has_first_estimate = true;
                tasks.push(Task {
                    keyframe,
                    neighbours,
                    is_final: false,
                });
            }
        }
        if let Some(keyframe) = newest.checked_sub(options.future) {
            tasks.extend(self.final_task(keyframe));
        }
        while self.first + options.past + options.future < newest + 1 {
            self.window.pop_front();
            self.first += 1;
        }
        tasks
    }

    /// Camera and pose of a keyframe in the window.
    pub(super) fn geometry(&self, keyframe: usize) -> Option<&ViewGeometry> {
        let index = keyframe.checked_sub(self.first)?;
        Some(&self.window.get(index)?.as_ref()?.geometry)
    }

    /// Replaces the pose of a keyframe in the window; `None` removes it from all later tasks.
    pub(super) fn set_pose(&mut self, keyframe: usize, pose: Option<Isometry3<f64>>) {
        let index = keyframe.checked_sub(self.first);
        let Some(slot) = index.and_then(|index| self.window.get_mut(index)) else {
            return;
        };
        match (slot.as_mut(), pose) {
            (Some(view), Some(pose)) => view.geometry.world_from_camera = pose,
            _ => *slot = None,
        }
    }

    /// Final estimates of the remaining keyframes, after the last one.
    pub(super) fn finish(&self) -> Vec<Task> {
        let end = self.first + self.window.len();
        let start = end
            .saturating_sub(self.source.options.future)
            .max(self.first);
        (start..end)
            .filter_map(|keyframe| self.final_task(keyframe))
            .collect()
    }

    fn final_task(&self, keyframe: usize) -> Option<Task> {
        self.window[keyframe - self.first].as_ref()?;
        Some(Task {
            keyframe,
            neighbours: self.neighbours(keyframe),
            is_final: true,
        })
    }

    /// The best neighbours among the keyframes in the window.
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
                let view = self.window[other - self.first].as_ref()?;
                Some((other, &view.geometry))
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
    use crate::options::SemiDenseStage;
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
    fn every_keyframe_has_a_first_and_a_final_estimate() {
        let mut schedule = schedule();
        let mut first_estimates = vec![Vec::new(); 12];
        let mut final_estimates = vec![Vec::new(); 12];
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
                    final_estimates[task.keyframe].push(step);
                } else {
                    first_estimates[task.keyframe].push(step);
                }
            }
            assert!(schedule.window.len() <= 8);
        }
        for keyframe in 0..12_usize {
            // The first keyframe gets its third neighbour together with its final estimate, so it has no first one.
            let expected = if keyframe == 0 {
                vec![]
            } else {
                vec![keyframe.max(3)]
            };
            assert_eq!(first_estimates[keyframe], expected);
            assert_eq!(final_estimates[keyframe], [(keyframe + 3).min(12)]);
        }
    }

    #[test]
    fn removed_keyframes_are_in_no_task() {
        let mut schedule = schedule();
        for step in 0..4 {
            schedule.push(Some(view(0.1 * f64::from(step))));
        }
        schedule.set_pose(2, None);
        // Numbers outside the window are ignored.
        schedule.set_pose(99, None);
        // Far away: no overlap with the others.
        schedule.set_pose(1, Some(Isometry3::translation(50.0, 0.0, 0.0)));
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
    fn unreadable_keyframes_are_skipped() {
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
