//! What a caller hears of long tasks.

use std::sync::Arc;

/// How far a task is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TaskState {
    /// What is counted, such as `frames`.
    pub unit: &'static str,
    /// What happens to them, such as `tracking`.
    pub action: &'static str,
    /// How many are done.
    pub done: usize,
    /// How many there are.
    pub total: usize,
    /// Whether the task has ended, complete or not.
    pub has_ended: bool,
}

type Listener = dyn Fn(TaskState) + Send + Sync;

/// Hears when tasks begin, after each of their steps and when they end. The default hears nothing.
#[derive(Clone, Default)]
pub struct ProgressHook(Option<Arc<Listener>>);

impl ProgressHook {
    /// Calls `listener`, on any thread. One task begins after another has ended.
    pub fn new(listener: impl Fn(TaskState) + Send + Sync + 'static) -> Self {
        Self(Some(Arc::new(listener)))
    }

    /// Begins a task.
    pub(crate) fn begin(&self, unit: &'static str, total: usize, action: &'static str) -> Task<'_> {
        let task = Task {
            hook: self,
            state: TaskState {
                unit,
                action,
                done: 0,
                total,
                has_ended: false,
            },
        };
        task.tell();
        task
    }
}

impl std::fmt::Debug for ProgressHook {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = self.0.as_ref().map(|_| "listener");
        formatter.debug_tuple("ProgressHook").field(&name).finish()
    }
}

/// A task that a hook hears of; it ends when it is dropped.
pub(crate) struct Task<'a> {
    hook: &'a ProgressHook,
    state: TaskState,
}

impl Task<'_> {
    pub(crate) fn step(&mut self) {
        self.set(self.state.done + 1);
    }

    pub(crate) fn set(&mut self, done: usize) {
        self.state.done = done;
        self.tell();
    }

    fn tell(&self) {
        if let Some(listener) = &self.hook.0 {
            listener(self.state);
        }
    }
}

impl Drop for Task<'_> {
    fn drop(&mut self) {
        self.state.has_ended = true;
        self.tell();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn a_task_tells_its_begin_its_steps_and_its_end() {
        let heard = Arc::new(Mutex::new(Vec::new()));
        let hook = ProgressHook::new({
            let heard = Arc::clone(&heard);
            move |state: TaskState| {
                assert_eq!((state.unit, state.total), ("frames", 7));
                heard.lock().unwrap().push((state.done, state.has_ended));
            }
        });
        let mut task = hook.begin("frames", 7, "tracking");
        task.step();
        task.set(5);
        drop(task);
        let told = [(0, false), (1, false), (5, false), (5, true)];
        assert_eq!(*heard.lock().unwrap(), told);
    }
}
