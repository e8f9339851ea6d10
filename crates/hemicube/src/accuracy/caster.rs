//! Rays on a backend's device, where it casts them. A certain answer is the processor's; the others are left to it.

use crate::backend::{BackendError, HemicubeBackend, Rays};

/// What casts rays beside the processor, if anything does.
pub(crate) struct Caster<'s> {
    session: Option<&'s mut dyn HemicubeBackend>,
    failed: Option<BackendError>,
}

impl<'s> Caster<'s> {
    pub(crate) fn new(session: &'s mut dyn HemicubeBackend) -> Self {
        Self {
            session: session.info().capabilities.rays.then_some(session),
            failed: None,
        }
    }

    /// The processor alone.
    pub(crate) fn none() -> Self {
        Self {
            session: None,
            failed: None,
        }
    }

    /// Returns whether a device casts rays.
    pub(crate) fn is_there(&self) -> bool {
        self.session.is_some()
    }

    /// The answers to rays; none after the device has failed, and [`Self::end`] tells why.
    pub(crate) fn cast(&mut self, rays: &Rays<'_>) -> Vec<u32> {
        let Some(session) = &mut self.session else {
            return Vec::new();
        };
        session.rays(rays).unwrap_or_else(|error| {
            self.failed = Some(error);
            self.session = None;
            Vec::new()
        })
    }

    /// Fails if the device has failed.
    pub(crate) fn end(self) -> Result<(), BackendError> {
        self.failed.map_or(Ok(()), Err)
    }
}
