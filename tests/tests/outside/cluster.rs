//! A matrix by several processes: shards on their own, an array of Slurm's with a task killed and one requeued, and
//! `mpirun`, each from Debian's packages and on this machine. Whoever computed it, the store is that of one process.

#![cfg(target_os = "linux")]

use hemicube_tests::runs::{Place, Ran, assert_same, files, finish};
use hemicube_tests::scenes::{program, skip, workspace};
use std::path::Path;
use std::process::{Command, Stdio};

/// 63 parts of 128 rows, each some tenths of a second, so that there is time to kill somebody.
const SLOW: &str = "-q --correction pixel --resolution 512 --culling off";

fn city() -> Place {
    let place = Place::new();
    place.line("generate city --patches 8000 --seed 3 -o city.obj").is(0);
    place
}

/// Tells if all of these programs are there, and says a skip otherwise.
fn has(test: &str, programs: &[&str]) -> bool {
    let is_there = |name: &&&str| {
        let found = Command::new("sh")
            .args(["-c", "command -v \"$0\"", name])
            .stdout(Stdio::null())
            .status();
        found.is_ok_and(|status| status.success())
    };
    let missing: Vec<_> = programs.iter().filter(|name| !is_there(name)).collect();
    if missing.is_empty() {
        return true;
    }
    skip(test, &format!("not installed: {missing:?}"), "HEMICUBE_REQUIRE_CLUSTER");
    false
}

/// A command in the place, with the program's path in `HEMICUBE`, and nothing of a scheduler that runs these tests.
fn command(place: &Place, name: &Path) -> Command {
    let of_place = place.command("");
    let mut command = Command::new(name);
    for (name, value) in of_place.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    command
        .current_dir(place.path(""))
        .env("HEMICUBE", program())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

#[test]
fn an_array_of_slurms_computes_the_same_matrix() {
    let test = "cluster::an_array_of_slurms_computes_the_same_matrix";
    if !has(test, &["munged", "slurmctld", "slurmd", "sbatch", "scontrol"]) {
        return;
    }
    let is_root = Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|output| output.stdout == b"0\n");
    if !is_root {
        return skip(test, "slurmd needs root", "HEMICUBE_REQUIRE_CLUSTER");
    }
    let place = city();
    place.line(&format!("compute city.obj -o whole {SLOW}")).is(0);
    let scripts = workspace().join("tests/cluster");
    let mut array = command(&place, &scripts.join("slurm.sh"));
    array
        .arg(place.path("slurm"))
        .arg(scripts.join("array.sh"))
        .arg(workspace().join("examples/cluster/slurm-array.sh"))
        .args(["city.obj", "m"])
        .args(SLOW.split_whitespace());
    let ran = finish(place.spawn(array)).is(0);
    assert!(
        ran.out.contains("task 3: 1 restarts") && ran.out.contains("task 9: 1 restarts"),
        "{}",
        ran.out
    );
    let text = |task: u32| std::fs::read_to_string(place.path(format!("task-{task}.log"))).expect("a task's log");
    // Each was at it twice: told to be quiet, they say which shard they are all the same only without `-q`.
    assert!(
        text(3).contains("CANCELLED") && text(9).contains("DUE TO JOB REQUEUE"),
        "{} {}",
        text(3),
        text(9)
    );
    place.line("merge m").is(0);
    assert_same(&place.path("m"), &place.path("whole"));
    place.line("check m").is(0);
}

#[test]
fn four_processes_of_mpi_compute_the_same_matrix() {
    if !has("cluster::four_processes_of_mpi_compute_the_same_matrix", &["mpirun"]) {
        return;
    }
    let place = city();
    let fast = "--correction pixel --resolution 64";
    place.line(&format!("compute city.obj -o whole {fast}")).is(0);
    let run = || -> Ran {
        let mut mpi = command(&place, Path::new("mpirun"));
        mpi.args(["--oversubscribe", "-n", "4"])
            .arg(workspace().join("examples/cluster/mpi.sh"))
            .args(["city.obj", "m"])
            .args(fast.split_whitespace())
            // Open MPI thinks better of root unless told twice.
            .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
            .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
        finish(place.spawn(mpi)).is(0)
    };
    let first = run();
    for rank in 1..=4 {
        assert!(
            first
                .err
                .contains(&format!("shard {rank}/4, by OMPI_COMM_WORLD_RANK={}", rank - 1)),
            "{}",
            first.err
        );
    }
    // Again is harmless.
    run();
    place.line("merge m").is(0);
    assert_same(&place.path("m"), &place.path("whole"));
}

#[test]
fn shards_of_any_order_and_place_are_merged_and_what_is_missing_is_named() {
    let place = city();
    let fast = "compute city.obj -q --correction pixel --resolution 64";
    place.line(&format!("{fast} -o whole")).is(0);
    // Three at once in one directory.
    let running: Vec<_> = [5, 1, 3]
        .map(|number| place.spawn(place.command(&format!("{fast} -o m --shard {number}/5"))))
        .into_iter()
        .collect();
    for child in running {
        finish(child).is(0);
    }
    place
        .line("merge m")
        .is(2)
        .says(&["25 of 63 parts are missing: 1, 3, 6, 8", "`--shard 2/5`, `--shard 4/5`"]);
    place.line("check m").is(1);
    // The others elsewhere, one of them on a "machine" that other variables describe.
    place.line(&format!("{fast} -o elsewhere/m --shard 2/5")).is(0);
    let mut pod = place.command(&format!("{fast} -o pod/m --shard auto/5"));
    pod.env("JOB_COMPLETION_INDEX", "3");
    finish(place.spawn(pod)).is(0);
    let report = place.line("merge m elsewhere/m --json").is(2).json();
    assert_eq!(
        (&report["missing_shards"], &report["copied"]),
        (&serde_json::json!([4]), &13.into())
    );
    place.line("merge m elsewhere/m pod/m").is(0);
    assert_same(&place.path("m"), &place.path("whole"));
    // Parts that were copied by hand into one directory do as well.
    std::fs::create_dir_all(place.path("by-hand/parts")).expect("a directory");
    for (name, bytes) in files(&place.path("m/parts")) {
        std::fs::write(place.path("by-hand/parts").join(name), bytes).expect("a copy");
    }
    place.line(&format!("{fast} -o by-hand")).is(0);
    assert_same(&place.path("by-hand"), &place.path("whole"));

    place
        .line("compute city.obj -q --correction pixel --resolution 32 -o other --shard 2/5")
        .is(0);
    place.line("merge m other").is(2).says(&[
        "`other` holds another matrix",
        "computed with resolution 32, and here it is with resolution 64",
    ]);
    place.line("merge nowhere").is(2).says(&["`nowhere` does not exist"]);
    for (line, words) in [
        ("--shard 6/5", &["3/16"][..]),
        ("--shard auto", &["no scheduler says", "hint: "]),
        ("--shard 1/2 --overwrite", &["cannot be used with"]),
        ("--shard 1/2 --verify 4", &["cannot be used with"]),
    ] {
        place.line(&format!("{fast} -o x {line}")).is(2).says(words);
    }
    // More shards than parts: those that have none are done at once.
    place.line(&format!("{fast} -o many --rows 0..200 --shard 4/4")).is(0);
    for number in 1..=3 {
        place
            .line(&format!("{fast} -o many --rows 0..200 --shard {number}/4"))
            .is(0);
    }
    place.line("merge many").is(0);
    place.line("check many").is(0);
}
