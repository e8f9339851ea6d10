//! Engines of the processor, plugins and devices: they see the same, and a faulty one harms nothing.

mod device_rays;
mod engines;
mod gpu_plugins;
mod item_buffer;
mod plugin_faults;
mod plugins;
mod portal_backends;
mod reduction;
