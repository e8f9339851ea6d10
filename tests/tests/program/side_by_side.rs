//! Two runs on one output: both end whole, or one is refused, as `docs/security.md` says.

#![cfg(unix)]

use crate::security::{COMPUTE, room};
use hemicube_tests::runs::{Place, Ran, files, finish};
use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

/// Starts a line twice, the second a little later, and waits for both.
fn race(place: &Place, line: &str, later: Duration) -> [Ran; 2] {
    let first: Child = place.spawn(place.command(line));
    std::thread::sleep(later);
    let second = place.spawn(place.command(line));
    [finish(first), finish(second)]
}

/// Has each writing command run against itself, `pairs` times.
fn race_all(pairs: u64) {
    let place = room();
    for (name, line) in [
        ("g", "generate room --patches 2000 -o g/g.obj --overwrite".to_owned()),
        ("n", format!("{COMPUTE} --split 4 -o n/n")),
        ("c", format!("{COMPUTE} -o c/n --overwrite")),
        ("e", "export m -o e/e.txt --overwrite".to_owned()),
        ("p", "export m -o p/p.csv --overwrite".to_owned()),
        ("z", "export m -o z/z.csv --by object --overwrite".to_owned()),
        ("m/solutions", "solve m --materials mat.toml -q".to_owned()),
        (
            "s",
            "solve m --materials mat.toml --solution other -o s/s.csv --overwrite".to_owned(),
        ),
        ("m/sky", "sky room.obj --matrix m --up z".to_owned()),
        ("k", "sky room.obj --up z --resolution 32 -o k --overwrite".to_owned()),
        ("r", "report m room.obj -o r/r.html --overwrite".to_owned()),
        ("v", "view sparsity m -o v/v.png --overwrite".to_owned()),
        ("b", "balance m -o b/b --closure --overwrite".to_owned()),
        ("d", "compare m m -o d/d.svg --overwrite".to_owned()),
    ] {
        if !name.starts_with("m/") {
            std::fs::create_dir_all(place.path(name)).expect("a folder");
        }
        let began = Instant::now();
        place.line(&line).is(0);
        let alone = began.elapsed();
        let whole = files(&place.path(name));
        assert!(!whole.is_empty(), "{line}");
        for pair in 0..pairs {
            let later = alone.mul_f64(((pair * 7919 + 3) % 100) as f64 / 100.0);
            let fresh = name == "n" && pair % 2 == 0;
            if fresh {
                std::fs::remove_dir_all(place.path("n/n")).expect("a store");
            }
            let ran = race(&place, &line, later);
            let codes = [ran[0].code, ran[1].code];
            assert!(
                codes.contains(&Some(0)),
                "`{line}`: {codes:?} {} {}",
                ran[0].err,
                ran[1].err
            );
            for ran in &ran {
                let is_refused = ran.code == Some(2) && ran.err.contains("writ");
                assert!(
                    ran.code == Some(0) || is_refused,
                    "`{line}`: {:?} {}",
                    ran.code,
                    ran.err
                );
            }
            let now = files(&place.path(name));
            assert_eq!(
                now.keys().collect::<Vec<_>>(),
                whole.keys().collect::<Vec<_>>(),
                "`{line}` {later:?}"
            );
            for (file, bytes) in &whole {
                assert!(now.get(file) == Some(bytes), "`{line}` {later:?}: {file} is not whole");
            }
        }
    }
    assert!(Path::new(&place.path("m/manifest.json")).is_file());
}

#[test]
fn two_runs_on_one_output_both_end_whole_or_one_is_refused() {
    race_all(1);
}

#[test]
#[ignore = "some minutes; `./test --full` runs it"]
fn two_hundred_pairs_of_each_command_on_one_output() {
    race_all(200);
}
