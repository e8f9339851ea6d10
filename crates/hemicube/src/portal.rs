//! Portals: planes behind which the view goes on under a rigid motion of space.
//!
//! | portal | motion | weight |
//! |---|---|---|
//! | mirror, mixed surface | reflection in its plane | ρs |
//! | pane | identity, and reflection | τ, and ρs |
//! | plane of symmetry | reflection | 1 |
//! | sector of n | rotation by 2π / n | 1 |
//! | period | translation by the cell | 1 |
//!
//! Rows are then of the *extended* form factors (Sillion & Puech 1989, "A general two-pass method integrating specular
//! and diffuse reflection"; the exchange factor of Sparrow & Cess)
//!
//! ```text
//! F^s_ij = 1/A_i ∫ ∫ cos θ / π Σ_n w_1 … w_n [the hit after n portals lies on j] dω dA
//! ```
//!
//! the share of what leaves i diffusely that *arrives* at j, directly or through portals. Mirrors and panes are
//! columns, too: of what arrives there ρs + τ is handed on. A_i F^s_ij = A_j F^s_ji holds, and
//!
//! ```text
//! Σ_j (1 − ρs_j − τ_j) F^s_ij + escaped + blocked + unselected = 1
//! ```
//!
//! with what is cut off after the last portal in *unselected*.
//!
//! Planes of symmetry, sectors and periods are no surfaces and have the weight 1: the cell's images are put round it
//! ([`images`]), and columns of images are added into the cell's. Every accuracy level then works as ever, closed forms
//! included. Mirrors and panes ([`Specular`]) are followed after a row is finished ([`extend`]): by a hemicube's
//! pixels, or by rays from all over the patch with closed forms between the moved emitter and what it sees.
//!
//! Pixels are drawn again as seen through a portal, in windows of the tree ([`extend`]), with whatever backend drew
//! them first.

mod aim;
pub(crate) mod bands;
pub mod extend;
mod gather;
pub mod images;
mod known;
pub mod law;
mod motion;
mod pairs;
mod pass;
pub(crate) mod sensors;
pub mod sight;
pub mod specular;
mod trace;
mod window;

pub use images::{ImageError, ImageSettings, Images, Period, Sector, Symmetry};
pub use law::Law;
pub use specular::{Optics, Specular};

use serde::Serialize;

/// The portals of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Portals {
    /// Images of the cell, where there are planes of symmetry, sectors or periods.
    pub images: Option<Images>,
    /// Mirrors and panes.
    pub specular: Option<Specular>,
}

impl Portals {
    /// Returns whether there is a portal.
    pub fn is_empty(&self) -> bool {
        self.images.is_none() && self.specular.is_none()
    }

    /// The portals for manifests and reports.
    pub fn record(&self) -> PortalRecord {
        PortalRecord {
            symmetry: self.images.as_ref().map_or_else(Vec::new, Images::symmetry_text),
            sector: self.images.as_ref().and_then(Images::sector_text),
            periodic: self.images.as_ref().map_or_else(Vec::new, Images::periods_text),
            repeats: self.images.as_ref().and_then(Images::repeats),
            specular: self.specular.as_ref().map(specular::Specular::record),
        }
    }
}

/// Portals in a manifest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PortalRecord {
    /// Planes of symmetry, `x=0`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub symmetry: Vec<String>,
    /// The sector, `z,12`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sector: Option<String>,
    /// Periods, `x=0..100`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub periodic: Vec<String>,
    /// Repeats of the cell on either side.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repeats: Option<u32>,
    /// Mirrors and panes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub specular: Option<specular::SpecularRecord>,
}
