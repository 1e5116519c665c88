use std::fs;
use std::path::PathBuf;

use headway::car_following::TrafficRegime;
use reqwest::Method;
use tempfile::TempDir;

use crate::SETTINGS;
use crate::points::all_points;
use crate::preloaded::library;
use crate::process::Home;
use crate::traffic::lines;

/// A disk under a database that forgets what was not synced when the power goes.
pub(crate) struct Disk {
    folder: TempDir,
    library: PathBuf,
}

impl Disk {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let library = library(folder.path(), "unsynced.c");
        fs::create_dir(folder.path().join("kept")).unwrap();
        Self { folder, library }
    }

    /// An empty database on this disk.
    pub(crate) fn home(&self, settings: &[&str]) -> Home {
        let mut home = Home::new(settings);
        home.set_variable("LD_PRELOAD", self.library.to_str().unwrap());
        home.set_variable("UNSYNCED_KEPT", self.kept().to_str().unwrap());
        for entry in fs::read_dir(self.kept()).unwrap() {
            fs::remove_file(entry.unwrap().path()).unwrap();
        }
        home
    }

    /// The power goes: what of the database was not synced is lost. The process must be dead.
    pub(crate) fn lose_unsynced(&self, home: &Home) {
        for name in ["headway.db", "headway.db-wal", "headway.db-shm"] {
            let _ = fs::remove_file(home.path().join(name));
            if self.kept().join(name).exists() {
                fs::copy(self.kept().join(name), home.path().join(name)).unwrap();
            }
        }
    }

    fn kept(&self) -> PathBuf {
        self.folder.path().join("kept")
    }
}

/// How many batches are there after one was uploaded and acknowledged, and the power went.
async fn batches_left(home: &Home, disk: &Disk) -> usize {
    let mut process = home.start();
    let request = process.request(Method::POST, "/v1/models/default/batches?regime=fast");
    let body = lines(TrafficRegime::Fast, 1, 20).concat();
    process.send(request.header("content-type", "application/x-ndjson").body(body)).await.expect(201);
    process.kill();
    disk.lose_unsynced(home);
    home.start().list("/v1/models/default/batches", "batches").await.len()
}

#[tokio::test]
async fn what_was_acknowledged_was_synced_before() {
    let disk = Disk::new();
    assert_eq!(batches_left(&disk.home(&SETTINGS), &disk).await, 1);
}

#[tokio::test]
async fn a_disk_that_lies_loses_what_was_acknowledged() {
    // Otherwise the test above could not fail.
    let disk = Disk::new();
    let mut home = disk.home(&SETTINGS);
    home.set_variable("UNSYNCED_LIES", "1");
    assert_eq!(batches_left(&home, &disk).await, 0);
}

#[tokio::test]
async fn a_life_comes_out_the_same_wherever_the_power_goes() {
    all_points(7, Some(&Disk::new())).await;
}
