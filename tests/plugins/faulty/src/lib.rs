//! A backend with faults: the kind, and the call of `rows` from which it shows, are in its options,
//! `fault=NAME,after=CALLS`.
//!
//! Without a fault it is legal and sees nothing. With one that begins with `pass-` it sees what the built-in backend
//! does, and draws passes by a ray a pixel; with `rays-`, it casts rays. Panics come from the safe side, through the adapter of every backend
//! in Rust; all other faults change the table's arrays afterwards, as a backend in C might.

use hemicube_abi::contract::backend::{
    BackendError, BackendInfo, Capabilities, Counters, Geometry, Hemicube, HemicubeBackend, Pass, Rays, RenderSettings,
    WHOLE,
};
use hemicube_abi::contract::face::{Face, Items, pixel_count};
use hemicube_abi::contract::row::RowBlock;
use hemicube_abi::types::{HcBackend, HcError, HcHemicube, HcHost, HcPass, HcRays, HcRows, HcSession, HcStatus};
use hemicube_abi::{Device, DeviceKind, Log, Options, Plugin};
use hemicube_backend_cpu::CpuBackend;
use std::collections::BTreeMap;
use std::ffi::{CStr, c_char};
use std::sync::{Arc, Mutex, PoisonError};

/// The session opened by the safe side.
struct Faulty {
    info: BackendInfo,
    fault: Fault,
    calls: u64,
    pixels: usize,
    log: Log,
    /// What sees, and what it sees.
    seeing: Option<(CpuBackend, Option<Arc<Geometry>>)>,
    resolution: u32,
    /// The last pass.
    before: Option<Items>,
}

/// The fault, and the number of calls before it.
#[derive(Clone, Debug, Default)]
struct Fault {
    name: String,
    after: u64,
}

impl Plugin for Faulty {
    const NAME: &'static CStr = c"faulty";
    const VERSION: &'static CStr = c"1";
    type Session = Self;

    fn devices() -> Result<Vec<Device>, BackendError> {
        Ok(vec![Device {
            name: "a device that cannot be relied on".to_owned(),
            kind: DeviceKind::Other,
            capabilities: Capabilities {
                items: true,
                covered: true,
                passes: true,
                rays: true,
                ..Capabilities::default()
            },
            max_resolution: 1024,
            preferred_rows: 8,
        }])
    }

    fn open(device: u32, options: &str, log: Log) -> Result<Self, BackendError> {
        let mut options = Options::parse(options)?;
        let fault = Fault {
            name: options.take("fault").unwrap_or_default().to_owned(),
            after: options.take("after").and_then(|calls| calls.parse().ok()).unwrap_or(0),
        };
        options.finish()?;
        match fault.name.as_str() {
            "open-fails" => return Err(BackendError::DeviceLost("the device is on fire".to_owned())),
            "panic-in-open" => panic!("öpen {}", "ä".repeat(400)),
            _ => {}
        }
        OPENING
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone_from(&fault);
        Ok(Self {
            info: Self::devices()?[device as usize].info::<Self>(),
            seeing: ["pass-", "rays-"]
                .iter()
                .any(|of| fault.name.starts_with(of))
                .then(|| (CpuBackend::new(), None)),
            fault,
            calls: 0,
            pixels: 0,
            log,
            resolution: 0,
            before: None,
        })
    }
}

impl HemicubeBackend for Faulty {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        assert!(self.fault.name != "panic-in-load", "the scene is ugly");
        self.pixels = pixel_count(settings.resolution);
        self.resolution = settings.resolution;
        if let Some((backend, seen)) = &mut self.seeing {
            *seen = Some(Arc::clone(geometry));
            backend.load(geometry, settings)?;
        }
        Ok(())
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        Err(BackendError::Unsupported("the host opens a session instead".to_owned()))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        self.calls += 1;
        if self.calls > self.fault.after {
            match self.fault.name.as_str() {
                "panic-in-rows" => panic!("no row {}", 7),
                "panic-with-a-bomb" => std::panic::panic_any(Bomb),
                "device-lost" => return Err(BackendError::DeviceLost("it was pulled out".to_owned())),
                "out-of-memory" => return Err(BackendError::OutOfMemory("1 GiB wanted".to_owned())),
                "few-rows" => return Ok(Counters::default()),
                "abort" => std::process::abort(),
                "exit" => std::process::exit(0),
                "hang" => loop {
                    std::thread::sleep(std::time::Duration::from_secs(1));
                },
                _ => {}
            }
        }
        if let Some((backend, _)) = &mut self.seeing {
            return backend.rows(hemicubes, out);
        }
        self.log.debug("nothing is seen");
        hemicubes.iter().for_each(|_| out.end_row(WHOLE, 0));
        Ok(Counters {
            hemicubes: hemicubes.len() as u64,
            ..Counters::default()
        })
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        match &mut self.seeing {
            Some((backend, _)) => backend.items(hemicube),
            None => Ok(Items {
                resolution: 0,
                seen: vec![Items::ESCAPED; self.pixels],
            }),
        }
    }

    fn pass(&mut self, pass: &Pass<'_>) -> Result<Items, BackendError> {
        let Some((_, Some(geometry))) = &self.seeing else {
            return Ok(Items {
                resolution: 0,
                seen: vec![Items::ESCAPED; self.pixels],
            });
        };
        let all = vec![u32::MAX; self.pixels / 32];
        let drawn = match self.fault.name.as_str() {
            "pass-ignores-mask" => Pass { open: &all, ..*pass },
            "pass-ignores-plane" => Pass { offset: -1e9, ..*pass },
            _ => *pass,
        };
        let mut items = by_rays(geometry, &drawn, self.resolution);
        match self.fault.name.as_str() {
            "pass-wrong-pixel" => {
                // Amid others that show the same, so that no edge tells them apart.
                let row = self.resolution as usize;
                let is_amid = |at: usize| {
                    let near = [
                        at - row - 1,
                        at - row,
                        at - row + 1,
                        at - 1,
                        at + 1,
                        at + row - 1,
                        at + row,
                        at + row + 1,
                    ];
                    pass.is_open(at) && near.iter().all(|&near| items.seen[near] == items.seen[at])
                };
                let places = row + 1..row * row - row - 1;
                if let Some(at) = places.into_iter().find(|&at| is_amid(at)) {
                    items.seen[at] = u32::from(items.seen[at] == 0);
                }
            }
            "pass-out-of-range" => {
                if let Some(at) = (0..self.pixels).rev().find(|&at| pass.is_open(at)) {
                    items.seen[at] = geometry.patch_count;
                }
            }
            "pass-of-before" => {
                let now = items.clone();
                if let Some(before) = self.before.replace(now) {
                    return Ok(before);
                }
            }
            _ => {}
        }
        Ok(items)
    }

    fn rays(&mut self, rays: &Rays<'_>) -> Result<Vec<u32>, BackendError> {
        let Some((_, Some(geometry))) = &self.seeing else {
            return Ok(vec![Rays::DOUBTFUL; rays.ends.len()]);
        };
        let stretch = if self.fault.name == "rays-ignore-ends" {
            20.0
        } else {
            1.0
        };
        let numbers = 0..rays.ends.len();
        let mut met: Vec<u32> = numbers.map(|ray| first_met(geometry, rays, ray, stretch)).collect();
        match self.fault.name.as_str() {
            "rays-fail" => return Err(BackendError::DeviceLost("it was pulled out".to_owned())),
            "rays-few" => met.truncate(rays.ends.len() / 2),
            "rays-doubtful" => met.fill(Rays::DOUBTFUL),
            "rays-out-of-range" => met.fill(geometry.patch_count),
            "rays-escape" => met.fill(Items::ESCAPED),
            "rays-wrong" => {
                if let Some(last) = met.last_mut() {
                    *last = u32::from(*last == 0);
                }
            }
            _ => {}
        }
        Ok(met)
    }
}

/// What a ray meets first, that many times as long.
fn first_met(geometry: &Geometry, rays: &Rays<'_>, ray: usize, stretch: f64) -> u32 {
    let [start, end] = rays.ends[ray];
    let mut nearest = (1.0, Items::ESCAPED);
    for surface in &geometry.surfaces {
        let heights = surface.corners.map(|corner| rays.normal.dot(corner) - rays.offset);
        let is_own = surface.front == rays.emitter || surface.back == Some(rays.emitter);
        if is_own || heights.iter().all(|&height| height <= geometry.plane_tolerance) {
            continue;
        }
        let along = (end - start) * stretch;
        let [a, b, c] = surface.corners.map(|corner| corner - start);
        let sides = [b.cross(c), c.cross(a), a.cross(b)].map(|edge| edge.dot(along));
        let place = a.dot(b.cross(c)) / sides.iter().sum::<f64>();
        let is_met = sides.iter().all(|&side| side >= 0.0) || sides.iter().all(|&side| side <= 0.0);
        if is_met && place > 0.0 && place < nearest.0 {
            let back = surface.back.map_or(Items::BLOCKED, |patch| patch.0);
            nearest = (
                place,
                if sides.iter().sum::<f64>() < 0.0 {
                    surface.front.0
                } else {
                    back
                },
            );
        }
    }
    nearest.1
}

/// What a ray through each open pixel's centre meets beyond the plane of a pass.
fn by_rays(geometry: &Geometry, pass: &Pass<'_>, resolution: u32) -> Items {
    let mut seen = vec![Items::ESCAPED; pixel_count(resolution)];
    let n = f64::from(resolution);
    for face in Face::ALL {
        let (places, signs) = face.axes();
        let [u, v, w] = std::array::from_fn(|k| pass.axes[places[k]] * signs[k]);
        let below = if face.is_top() { 1.0 } else { 0.0 };
        for (y, x) in (0..face.rows(resolution)).flat_map(|y| (0..resolution).map(move |x| (y, x))) {
            let pixel = ((face.first_row(resolution) + y) * resolution + x) as usize;
            if pass.is_open(pixel) {
                let a = 2.0 * (f64::from(x) + 0.5) / n - 1.0;
                let b = 2.0 * (f64::from(y) + 0.5) / n - below;
                let towards = w + u * a + v * b;
                let mut nearest = (f64::INFINITY, Items::ESCAPED);
                for surface in &geometry.surfaces {
                    let heights = surface.corners.map(|corner| pass.normal.dot(corner) - pass.offset);
                    if heights.iter().all(|&height| height <= geometry.plane_tolerance) {
                        continue;
                    }
                    let [a, b, c] = surface.corners.map(|corner| corner - pass.origin);
                    let sides = [b.cross(c), c.cross(a), a.cross(b)].map(|edge| edge.dot(towards));
                    let volume = a.dot(b.cross(c));
                    let distance = volume / sides.iter().sum::<f64>();
                    let is_met = sides.iter().all(|&side| side >= 0.0) || sides.iter().all(|&side| side <= 0.0);
                    let height = pass.normal.dot(pass.origin + towards * distance) - pass.offset;
                    if is_met && distance > 0.0 && distance < nearest.0 && height > 0.0 {
                        let back = surface.back.map_or(Items::BLOCKED, |patch| patch.0);
                        nearest = (distance, if volume < 0.0 { surface.front.0 } else { back });
                    }
                }
                seen[pixel] = nearest.1;
            }
        }
    }
    Items { resolution, seen }
}

/// A payload panicking on drop.
struct Bomb;

impl Drop for Bomb {
    fn drop(&mut self) {
        panic!("dropped");
    }
}

const GOOD: HcBackend = hemicube_abi::table::<Faulty>();

/// The fault of the session being opened.
static OPENING: Mutex<Fault> = Mutex::new(Fault {
    name: String::new(),
    after: 0,
});

/// Faults and calls of open sessions, by address.
static SESSIONS: Mutex<BTreeMap<usize, (Fault, u64)>> = Mutex::new(BTreeMap::new());

/// The table: the safe side's, with functions of our own before five of them.
#[allow(non_upper_case_globals, reason = "the name is part of the ABI")]
#[unsafe(no_mangle)]
pub static hemicube_backend: HcBackend = HcBackend {
    open: Some(open),
    rows: Some(rows),
    items: Some(items),
    pass: Some(pass),
    rays: Some(rays),
    ..GOOD
};

unsafe extern "C" fn open(
    host: *const HcHost,
    device: u32,
    options: *const c_char,
    session: *mut *mut HcSession,
    error: *mut HcError,
) -> HcStatus {
    // One at a time, so that the fault belongs to this session.
    static ONE: Mutex<()> = Mutex::new(());
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(open) = GOOD.open else { return 5 };
    // SAFETY: the host's own pointers, handed on.
    let status = unsafe { open(host, device, options, session, error) };
    if status == 0 {
        let fault = OPENING.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if fault.name == "no-session" {
            // SAFETY: a place for a session, by the ABI; the one in it is leaked.
            unsafe { *session = std::ptr::null_mut() };
            return 0;
        }
        // SAFETY: as above, and it was filled.
        let address = unsafe { *session } as usize;
        let mut sessions = SESSIONS.lock().unwrap_or_else(PoisonError::into_inner);
        sessions.insert(address, (fault, 0));
    }
    status
}

/// The fault of a session, if its time has come.
fn fault_of(session: *mut HcSession) -> String {
    let mut sessions = SESSIONS.lock().unwrap_or_else(PoisonError::into_inner);
    let Some((fault, calls)) = sessions.get_mut(&(session as usize)) else {
        return String::new();
    };
    *calls += 1;
    if *calls > fault.after {
        fault.name.clone()
    } else {
        String::new()
    }
}

unsafe extern "C" fn rows(session: *mut HcSession, rows: *mut HcRows, error: *mut HcError) -> HcStatus {
    let fault = fault_of(session);
    if fault == "nothing-written" {
        return 0;
    }
    let Some(good) = GOOD.rows else { return 5 };
    // SAFETY: the host's own pointers, handed on.
    let status = unsafe { good(session, rows, error) };
    if fault == "called-again" && status == 0 {
        // Nothing may follow on this; if something does, the process ends.
        let mut sessions = SESSIONS.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((fault, _)) = sessions.get_mut(&(session as usize)) {
            "abort-now".clone_into(&mut fault.name);
        }
        return 5;
    }
    // SAFETY: rows of the host, whose arrays have room for one row and one entry at least, and, where a fault writes
    // more than that, a guard. That is what is tested.
    unsafe {
        let raw = &mut *rows;
        let last = raw.row_count as usize - 1;
        let capacity = usize::try_from(raw.capacity).unwrap_or(usize::MAX);
        // The last row gets an entry, or two, to do wrong with.
        let entry = |k: usize, patch: u32, visible: u32, covered: u32| {
            raw.patches.add(k).write(patch);
            raw.visible.add(k).write(visible);
            if !raw.covered.is_null() {
                raw.covered.add(k).write(covered);
            }
            raw.escaped.add(last).write(raw.escaped.add(last).read() - visible);
            raw.row_end.add(last).write(k as u64 + 1);
        };
        match fault.as_str() {
            "patch-out-of-range" => entry(0, u32::MAX - 5, 10, 10),
            "not-ascending" => {
                entry(0, 3, 10, 10);
                entry(1, 2, 10, 10);
            }
            "patch-twice" => {
                entry(0, 3, 10, 10);
                entry(1, 3, 10, 10);
            }
            "covered-below-visible" => entry(0, 3, 10, 9),
            "row-end-decreasing" => {
                raw.row_end.write(2);
                raw.row_end.add(last).write(1);
            }
            "row-end-beyond" => raw.row_end.add(last).write(raw.capacity + 1),
            "light-lost" => raw.escaped.add(last).write(raw.escaped.add(last).read() - 1),
            "light-invented" => raw.blocked.add(last).write(1),
            "past-patches" => raw.patches.add(capacity).write(1),
            "past-visible" => raw.visible.add(capacity + 3).write(1),
            "past-covered" if !raw.covered.is_null() => raw.covered.add(capacity).write(1),
            "past-row-end" => raw.row_end.add(last + 1).write(1),
            "past-escaped" => raw.escaped.add(last + 1).write(1),
            "past-blocked" => raw.blocked.add(last + 1).write(1),
            "past-message" => error.cast::<u8>().add(512).write(1),
            "past-struct" => rows.add(1).cast::<u8>().write(1),
            "unknown-status" => return 77,
            "segfault" => std::ptr::without_provenance_mut::<u32>(4).write_volatile(1),
            "abort-now" => std::process::abort(),
            _ => {}
        }
    }
    status
}

unsafe extern "C" fn items(
    session: *mut HcSession,
    hemicube: *const HcHemicube,
    out: *mut u32,
    error: *mut HcError,
) -> HcStatus {
    let Some(good) = GOOD.items else { return 5 };
    // SAFETY: the host's own pointers, handed on.
    let status = unsafe { good(session, hemicube, out, error) };
    // SAFETY: what is written behind the item buffer of resolution 64, at which the suite asks for it, is a guard.
    unsafe {
        match fault_of(session).as_str() {
            "past-items" => out.add(pixel_count(64)).write(1),
            "item-out-of-range" => out.write(u32::MAX - 5),
            _ => {}
        }
    }
    status
}

unsafe extern "C" fn pass(session: *mut HcSession, raw: *const HcPass, out: *mut u32, error: *mut HcError) -> HcStatus {
    let fault = fault_of(session);
    if fault == "pass-unwritten" {
        return 0;
    }
    let Some(good) = GOOD.pass else { return 5 };
    // SAFETY: the host's own pointers, handed on.
    let status = unsafe { good(session, raw, out, error) };
    if fault == "pass-past-items" {
        // SAFETY: a pass of the host's, and behind its item buffer of 32 pixels a word is a guard.
        unsafe { out.add(32 * usize::try_from((*raw).word_count).unwrap_or(0)).write(1) };
    }
    status
}

unsafe extern "C" fn rays(session: *mut HcSession, raw: *mut HcRays, error: *mut HcError) -> HcStatus {
    let fault = fault_of(session);
    if fault == "rays-unwritten" {
        return 0;
    }
    let Some(good) = GOOD.rays else { return 5 };
    // SAFETY: the host's own pointers, handed on.
    let status = unsafe { good(session, raw, error) };
    if fault == "rays-past" {
        // SAFETY: rays of the host's, and behind their answers is a guard.
        unsafe { (*raw).met.add(usize::try_from((*raw).ray_count).unwrap_or(0)).write(1) };
    }
    status
}
