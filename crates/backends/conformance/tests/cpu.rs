//! The suite on the built-in backend, and on copies of it that do wrong in ways that only a comparison can find.

use hemicube::backend::{
    BackendError, BackendInfo, Capabilities, Counters, Geometry, Hemicube, HemicubeBackend, RenderSettings,
};
use hemicube::face::Items;
use hemicube::row::RowBlock;
use hemicube_backend_cpu::{CpuBackend, EngineChoice};
use hemicube_conformance::{Case, Outcome, cases, run};
use std::sync::Arc;

fn cpu(engine: EngineChoice) -> CpuBackend {
    CpuBackend::new().with_engine(engine)
}

#[test]
fn the_built_in_backend_keeps_all_of_it() {
    let engines = [
        (EngineChoice::Depth, EngineChoice::Auto),
        (EngineChoice::Claims, EngineChoice::Depth),
    ];
    for (case, (first, second)) in cases()
        .into_iter()
        .flat_map(|case| engines.map(|engines| (case, engines)))
    {
        let outcome = run(case, &mut cpu(first), &mut cpu(second));
        match outcome {
            Outcome::Held(_) => {}
            Outcome::NotClaimed(what) => assert!(
                ["read back", "portals", "rays"].iter().any(|of| what.contains(of)),
                "{case}: {what} is claimed"
            ),
            Outcome::Broken(wrong) => panic!("{case}: {wrong}"),
        }
    }
}

/// What a doctored backend does with the rows of the built-in one.
type Doctor = fn(&mut Doctored, &mut RowBlock, usize, &mut Counters);

/// The built-in backend, with its rows changed before they leave.
struct Doctored {
    inner: Box<dyn HemicubeBackend>,
    info: BackendInfo,
    doctor: Doctor,
    culling: bool,
    calls: u32,
}

impl Doctored {
    fn new(doctor: Doctor) -> Self {
        let inner = Box::new(CpuBackend::new());
        Self {
            info: inner.info().clone(),
            inner,
            doctor,
            culling: true,
            calls: 0,
        }
    }
}

impl HemicubeBackend for Doctored {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.culling = settings.culling == hemicube::backend::Culling::On;
        self.inner.load(geometry, settings)
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        self.inner.fork()
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let mut rows = RowBlock::default();
        let mut counters = self.inner.rows(hemicubes, &mut rows)?;
        self.calls += 1;
        (self.doctor)(self, &mut rows, hemicubes.len(), &mut counters);
        let start = out.patches.len();
        out.row_end.extend(rows.row_end.iter().map(|end| start + end));
        out.patches.extend(rows.patches);
        out.visible.extend(rows.visible);
        out.covered.extend(rows.covered);
        out.escaped.extend(rows.escaped);
        out.blocked.extend(rows.blocked);
        Ok(counters)
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        self.inner.items(hemicube)
    }
}

/// Moves a little weight from what the first row sees to what it does not: still a legal row.
fn move_weight(rows: &mut RowBlock) {
    let entry = rows
        .visible
        .iter()
        .position(|&weight| weight > 0)
        .expect("something is seen");
    rows.visible[entry] -= 1;
    let row = rows
        .row_end
        .iter()
        .position(|&end| end > entry)
        .expect("an entry of a row");
    rows.escaped[row] += 1;
}

#[test]
fn every_check_finds_what_it_is_there_for() {
    let doctors: [(&str, Doctor); 9] = [
        ("room/contract", |_, rows, _, _| rows.escaped[0] += 1),
        ("room/contract", |_, _, _, counters| counters.hemicubes = 0),
        ("room/batches", |_, rows, count, _| {
            if count == 1 {
                move_weight(rows);
            }
        }),
        ("room/repeat", |doctored, rows, _, _| {
            if doctored.calls > 2 {
                move_weight(rows);
            }
        }),
        ("room/culling", |doctored, rows, _, _| {
            if !doctored.culling {
                move_weight(rows);
            }
        }),
        ("towers/culls", |_, _, _, counters| counters.triangles_drawn = 5),
        ("room/reduction", |_, rows, _, _| move_weight(rows)),
        ("room/bytes", |_, _, _, counters| counters.bytes_read_back = 1 << 30),
        ("empty-room/unoccluded", |_, rows, _, _| rows.covered[0] += 1),
    ];
    for (name, doctor) in doctors {
        let case: Case = name.parse().expect("a case");
        let outcome = run(case, &mut Doctored::new(doctor), &mut CpuBackend::new());
        assert!(matches!(outcome, Outcome::Broken(_)), "{name}: {outcome:?}");
    }
    // Tiny patches that vanish, and rows that are far from the reference's.
    let lose_tiny: Doctor = |_, rows, _, _| {
        let keep: Vec<bool> = rows
            .visible
            .iter()
            .zip(&rows.covered)
            .map(|(&v, &c)| v > 0 || c > 0)
            .collect();
        for end in &mut rows.row_end {
            *end = keep[..*end].iter().filter(|&&keep| keep).count();
        }
        for array in [&mut rows.patches, &mut rows.visible, &mut rows.covered] {
            let mut kept = keep.iter();
            array.retain(|_| *kept.next().expect("as long"));
        }
    };
    let far: Doctor = |_, rows, _, _| {
        let row = rows.row_end.len() - 1;
        let start = if row == 0 { 0 } else { rows.row_end[row - 1] };
        let gone: u32 = rows.visible[start..].iter_mut().map(std::mem::take).sum();
        rows.escaped[row] += gone;
    };
    for (name, doctor) in [("towers/tiny", lose_tiny), ("city/reference", far)] {
        let case: Case = name.parse().expect("a case");
        let outcome = run(case, &mut Doctored::new(doctor), &mut CpuBackend::new());
        assert!(matches!(outcome, Outcome::Broken(_)), "{name}: {outcome:?}");
    }
}

#[test]
fn what_is_not_claimed_is_never_held() {
    for name in [
        "room/culling",
        "room/reduction",
        "empty-room/unoccluded",
        "towers/tiny",
        "room/bytes",
        "room/rays",
    ] {
        let case: Case = name.parse().expect("a case");
        let mut modest = Doctored::new(|_, _, _, _| {});
        modest.info.capabilities = Capabilities::default();
        let outcome = run(case, &mut modest, &mut CpuBackend::new());
        assert!(matches!(outcome, Outcome::NotClaimed(_)), "{name}: {outcome:?}");
    }
}
