//! What rows are computed for: light, heat, sky, sensors, and mirrors, panes, symmetry and periods.

mod bodies;
mod cie_171;
mod glazed_sky;
mod heat;
mod heat_cases;
mod heat_closes;
mod light;
mod networks;
mod optics;
mod point_tables;
mod points;
mod portal_cities;
mod portal_combined;
mod portal_forms;
mod portal_refusals;
mod portal_uses;
mod portals;
mod sky_settling;
mod suns;
mod yardsticks;
