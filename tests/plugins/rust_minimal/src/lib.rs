//! The smallest backend in Rust: a ray through every pixel of a hemicube, held against every surface.
#![forbid(unsafe_code)]

use hemicube_abi::contract::{backend::*, delta::DeltaTable, face::*, row::RowBlock};
use hemicube_abi::{Device, DeviceKind, Log, Options, Plugin, export_backend};
use std::{ffi::CStr, sync::Arc};

struct Rays(BackendInfo, Option<(Arc<Geometry>, DeltaTable)>);
export_backend!(Rays);

impl Plugin for Rays {
    const NAME: &'static CStr = c"rust-minimal";
    const VERSION: &'static CStr = c"1";
    type Session = Self;

    fn devices() -> Result<Vec<Device>, BackendError> {
        let (name, kind, max_resolution) = ("one processor core".to_owned(), DeviceKind::Software, 1024);
        let mut capabilities = Capabilities::default();
        (capabilities.items, capabilities.lossless_culling) = (true, true);
        Ok(vec![Device {
            name,
            kind,
            capabilities,
            max_resolution,
            preferred_rows: 4,
        }])
    }

    fn open(device: u32, options: &str, _log: Log) -> Result<Self, BackendError> {
        Options::parse(options)?.finish()?;
        Ok(Self(Self::devices()?[device as usize].info::<Self>(), None))
    }
}

impl HemicubeBackend for Rays {
    fn info(&self) -> &BackendInfo {
        &self.0
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.1 = Some((Arc::clone(geometry), DeltaTable::new(settings.resolution)));
        Ok(())
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        Err(BackendError::Unsupported(
            "the host opens a session and loads instead".to_owned(),
        ))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        for hemicube in hemicubes {
            let items = self.items(hemicube)?;
            let table = self.1.as_ref().map(|(_, table)| items.reduce(table));
            let (entries, escaped, blocked) = table.unwrap_or_default();
            entries.iter().for_each(|&(patch, weight)| out.push(patch, weight, 0));
            out.end_row(escaped, blocked);
        }
        Ok(Counters {
            hemicubes: hemicubes.len() as u64,
            ..Counters::default()
        })
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        let Some((geometry, table)) = &self.1 else {
            return Err(BackendError::InvalidArgument("no scene is loaded".to_owned()));
        };
        let (resolution, mut seen) = (table.resolution(), Vec::new());
        for face in Face::ALL {
            let (axes, signs) = face.axes();
            for pixel in 0..resolution * face.rows(resolution) {
                let step = 2.0 / f64::from(resolution);
                let u = (f64::from(pixel % resolution) + 0.5) * step - 1.0;
                let v = (f64::from(pixel / resolution) + 0.5) * step - if face.is_top() { 1.0 } else { 0.0 };
                let (x, y, z) = (u * signs[0], v * signs[1], signs[2]);
                let ray = hemicube.axes[axes[0]] * x + hemicube.axes[axes[1]] * y + hemicube.axes[axes[2]] * z;
                let mut nearest = (f64::INFINITY, Items::ESCAPED);
                for surface in &geometry.surfaces {
                    let own = hemicube
                        .emitter
                        .is_some_and(|e| surface.front == e || surface.back == Some(e));
                    // Möller & Trumbore 1997.
                    let [a, b, c] = surface.corners;
                    let (ab, ac, from) = (b - a, c - a, hemicube.origin - a);
                    let (p, q) = (ray.cross(ac), from.cross(ab));
                    let det = ab.dot(p);
                    let (s, t, depth) = (from.dot(p) / det, ray.dot(q) / det, ac.dot(q) / det);
                    let hit = s >= 0.0 && t >= 0.0 && s + t <= 1.0 && depth > geometry.plane_tolerance;
                    let side = if det > 0.0 { Some(surface.front) } else { surface.back };
                    let patch = side.map_or(Items::BLOCKED, |patch| patch.0);
                    if hit && !own && (depth, patch) < nearest {
                        nearest = (depth, patch);
                    }
                }
                seen.push(nearest.1);
            }
        }
        Ok(Items { resolution, seen })
    }
}
