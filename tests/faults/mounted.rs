use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use reqwest::Method;

use crate::SETTINGS;
use crate::full::{learned, predicted, upload};
use crate::process::{Home, Process};
use crate::remains::Remains;

const MODEL: &str = "/v1/models/default";

/// A mount that goes with its owner.
struct Mount(PathBuf);

impl Mount {
    /// None where this user or this system may not mount; why is told.
    fn new(arguments: &[&str], at: &Path) -> Option<Self> {
        let mounted = Command::new("mount").args(arguments).arg(at).output();
        match mounted {
            Ok(output) if output.status.success() => Some(Self(at.to_owned())),
            Ok(output) => {
                println!("left out: {}", String::from_utf8_lossy(&output.stderr));
                None
            }
            Err(error) => {
                println!("left out: mount: {error}");
                None
            }
        }
    }
}

impl Drop for Mount {
    fn drop(&mut self) {
        // A process that was just killed may hold it for a moment yet.
        let _ = Command::new("umount").arg("--lazy").arg(&self.0).status();
    }
}

fn settings() -> Vec<&'static str> {
    [&SETTINGS[..], &["model.schedule=manual", "model.epochs=1"]].concat()
}

/// Takes all the room there is but `spare` bytes.
fn fill(folder: &Path, spare: u64) -> PathBuf {
    let path = folder.join("ballast");
    let mut file = File::create(&path).unwrap();
    let mut written = 0;
    while file.write_all(&[0; 4096]).is_ok() {
        written += 4096;
    }
    file.set_len(written - spare).unwrap();
    path
}

async fn batches(process: &Process) -> usize {
    process.list(&format!("{MODEL}/batches"), "batches").await.len()
}

#[tokio::test]
async fn a_small_file_system_that_is_full_is_answered_507_and_goes_on_once_it_is_emptied() {
    let home = Home::new(&settings());
    // Database, spooled bodies and the log of the process, all on it.
    let Some(_mount) = Mount::new(&["-t", "tmpfs", "-o", "size=8m", "tmpfs"], home.path()) else { return };
    fs::create_dir(home.path().join("spool")).unwrap();
    let mut process = learned(&home).await;
    let expected = predicted(&process).await;
    for spare in [0, 65_536] {
        let ballast = fill(home.path(), spare);
        for (seed, events) in [(2, 400), (3, 400)] {
            let refused = upload(&process, seed, events).await.expect(507);
            assert_eq!(refused["code"], "storage_full", "{refused}");
        }
        assert_eq!(predicted(&process).await, expected);
        assert_eq!(batches(&process).await, 1);
        fs::remove_file(ballast).unwrap();
    }
    upload(&process, 2, 400).await.expect(201);
    // Filled by uploads alone, and killed while it is full.
    let reserve = fill(home.path(), 4 << 20);
    let mut acknowledged = 2;
    for seed in 3.. {
        let answer = upload(&process, seed, 400).await;
        if answer.status == 507 {
            break;
        }
        answer.expect(201);
        acknowledged += 1;
    }
    assert_eq!(predicted(&process).await, expected);
    process.kill();
    fs::remove_file(reserve).unwrap();
    let process = home.start();
    assert_eq!(batches(&process).await, acknowledged);
    assert_eq!(predicted(&process).await, expected);
    upload(&process, 1000, 24).await.expect(201);
    drop(process);
    let mut remains = Remains::of(&home).await;
    remains.check().await;
    assert_eq!(remains.count("batch").await, acknowledged + 1);
    remains.close().await;
    assert!(!home.log().contains("panicked"), "{}", home.log());
}

#[tokio::test]
async fn a_database_that_may_not_be_written_is_said_to_be_so_at_the_start() {
    let home = Home::new(&settings());
    let expected = predicted(&learned(&home).await).await;
    let database = home.database();
    let name = database.to_str().unwrap();
    let Some(mount) = Mount::new(&["--bind", name], &database) else { return };
    let options = ["-o", "remount,bind,ro", name];
    assert!(Command::new("mount").args(options).status().unwrap().success());
    assert!(home.start_or_refuse().is_none(), "it serves what it cannot write");
    assert!(home.log().contains("read-only") || home.log().contains("readonly"), "{}", home.log());
    drop(mount);
    let process = home.start();
    assert_eq!(predicted(&process).await, expected);
    process.send(process.request(Method::GET, "/readyz")).await.expect(200);
}
