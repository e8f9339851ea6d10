//! Culling, frusta, Morton order, the octree, and its checks.

mod cull;
mod frustum;
mod morton;
mod octree;
mod validate;
