//! The gate between those who rely on what is stored and those who remove it.
//!
//! Whoever plans a run or writes results stands in the gate (a shared lock of one file), for that
//! moment only; housekeeping waits until nobody does, and then holds it alone. So housekeeping and
//! runs go on beside each other, and neither sees the other's work half done.

use std::{
    fs::File,
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
    thread,
    time::{Duration, Instant},
};

use super::{
    StoreError,
    disk::{Disk, is_at},
};

pub struct Gate {
    disk: Disk,
    path: PathBuf,
    state: Mutex<State>,
}

struct State {
    file: File,
    /// Passes of this process.
    n_passes: usize,
}

/// The right to rely on what is stored, until it is dropped.
pub struct Pass {
    gate: Arc<Gate>,
}

impl Gate {
    pub fn open(disk: &Disk, path: &Path) -> Result<Arc<Self>, StoreError> {
        let file = disk.open_or_create(path).map_err(StoreError::new("write", path))?;
        let state = Mutex::new(State { file, n_passes: 0 });
        Ok(Arc::new(Self { disk: disk.clone(), path: path.to_owned(), state }))
    }

    /// Waits for housekeeping to end.
    pub fn enter(self: &Arc<Self>) -> Result<Pass, StoreError> {
        let mut state = self.state.lock().expect("nobody panics in the gate");
        if state.n_passes == 0 {
            // If somebody removed the folder, the gate of everybody else is another file.
            if !is_at(&state.file, &self.path)
                && let Ok(file) = self.disk.open_or_create(&self.path)
            {
                state.file = file;
            }
            let fail = StoreError::new("lock", &self.path);
            self.disk.lock_shared(&state.file, &self.path).map_err(fail)?;
        }
        state.n_passes += 1;
        Ok(Pass { gate: Arc::clone(self) })
    }
}

impl Drop for Pass {
    fn drop(&mut self) {
        let Ok(mut state) = self.gate.state.lock() else { return };
        state.n_passes -= 1;
        if state.n_passes == 0 {
            // It can only fail for a file that is no file any more.
            let _ = state.file.unlock();
        }
    }
}

/// Takes the gate alone; `None` if somebody stands in it for longer than `patience`.
pub fn close(disk: &Disk, path: &Path, patience: Duration) -> Result<Option<File>, StoreError> {
    let file = disk.open_or_create(path).map_err(StoreError::new("write", path))?;
    let start = Instant::now();
    loop {
        if disk.try_lock(&file, path).map_err(StoreError::new("lock", path))? {
            return Ok(Some(file));
        }
        if start.elapsed() > patience {
            return Ok(None);
        }
        thread::sleep(Duration::from_millis(1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gate_is_closed_only_when_nobody_stands_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        let disk = Disk::default();
        let gate = Gate::open(&disk, &path).unwrap();
        let (first, second) = (gate.enter().unwrap(), gate.enter().unwrap());
        drop(first);
        assert!(close(&disk, &path, Duration::ZERO).unwrap().is_none());
        drop(second);
        let alone = close(&disk, &path, Duration::ZERO).unwrap();
        assert!(alone.is_some());
        thread::scope(|scope| {
            let entered = scope.spawn(|| gate.enter().map(drop));
            thread::sleep(Duration::from_millis(5));
            assert!(!entered.is_finished());
            drop(alone);
            entered.join().unwrap().unwrap();
        });
    }
}
