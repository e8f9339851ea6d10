//! Whether bits changed: hashes of eight small matrices at five levels by three engines, beside the committed ones.

use hemicube::driver::compute::Execution;
use hemicube_backend_cpu::CpuBackend;
use hemicube_scene::Subdivision;
use hemicube_scene::generate::cornell_box;
use hemicube_tests::bits::{Bits, hash};
use hemicube_tests::rows::{Rung, parts, plan, settings};
use hemicube_tests::scenes::{model, say, skip};

#[test]
fn bits_are_the_committed_ones() {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        // Sines and logarithms of another library differ in their last bit.
        skip(
            "bits_are_the_committed_ones",
            "the committed bits are of Linux on x86-64",
            "HEMICUBE_REQUIRE_BITS",
        );
        return;
    }
    let committed = std::fs::read_to_string(Bits::path()).expect("tests/golden/bits.txt");
    match Bits::compute().changed(&Bits::of_text(&committed)) {
        None => say("bits changed: no"),
        Some(what) => panic!("{what}"),
    }
}

#[test]
fn other_bits_are_told_and_named() {
    let bits = |program: &str, hashes: &[(&str, &str)]| Bits {
        program: program.to_owned(),
        hashes: hashes
            .iter()
            .map(|&(name, hash)| (name.to_owned(), hash.to_owned()))
            .collect(),
    };
    let old = bits("0+1", &[("room 1% depth", "aa"), ("room 1% order", "bb")]);
    assert_eq!(Bits::of_text(&old.to_text()), old);
    assert_eq!(old.changed(&old), None);
    let other = bits("0+1", &[("room 1% depth", "aa"), ("room 1% order", "bc")]);
    let what = other.changed(&old).expect("they differ");
    assert!(
        what.starts_with("bits changed: yes, in 1 of 2: room 1% order."),
        "{what}"
    );
    assert!(what.contains("raise `PROGRAM`") && !other.may_replace(&old), "{what}");
    let raised = bits("0+2", &[("room 1% depth", "aa"), ("room 1% order", "bc")]);
    let what = raised.changed(&old).expect("they differ");
    assert!(!what.contains("raise `PROGRAM`") && raised.may_replace(&old), "{what}");
    let same = bits("0+2", &[("room 1% depth", "aa"), ("room 1% order", "bb")]);
    assert!(
        same.changed(&old)
            .expect("another program")
            .starts_with("bits changed: no")
    );
    for (new, old) in [
        (&old, &bits("0+1", &[("room 1% depth", "aa")])),
        (&bits("0+1", &[]), &old),
    ] {
        assert!(new.changed(old).expect("a line more or less").contains("room 1% order"));
    }
}

#[test]
fn one_bit_of_one_number_is_another_hash() {
    let model = model(cornell_box(), Subdivision::None);
    let Rung { correction, resolution } = Rung::tolerance(0.02);
    let plan = plan(&model).with_correction(correction);
    let computed = || {
        let backend = Box::new(CpuBackend::new());
        let (parts, _) =
            parts(&model, &plan, settings(resolution), backend, Execution::default()).expect("a good backend");
        parts
    };
    let parts = computed();
    assert_eq!(hash(&parts), hash(&computed()));
    let mut other = parts.clone();
    other[0].errors[0].norm = f32::from_bits(other[0].errors[0].norm.to_bits() ^ 1);
    assert_ne!(hash(&parts), hash(&other));
    other = parts.clone();
    other[0].shares[0].blocked += f64::EPSILON;
    assert_ne!(hash(&parts), hash(&other));
    other = parts.clone();
    other[0].indices[0] += 1;
    assert_ne!(hash(&parts), hash(&other));
}
