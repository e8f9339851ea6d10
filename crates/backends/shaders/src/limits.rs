//! Sizes of submissions, and the check of a scene against a device's limits.

use crate::chunks::{CHUNK_WORDS, OF_A_RUN};
use crate::output::{ENTRY_WORDS, HEADER_WORDS};
use crate::upload::{Upload, VERTEX_BYTES};
use crate::view::{FACES, VIEW_BYTES};
use hemicube_contract::backend::{BackendError, RenderSettings};
use hemicube_contract::face::pixel_count;

/// Work groups of 64 threads for the lists of a layer: a thousand pixels and ten thousand edges at N = 256.
pub const SETTLE_GROUPS: u32 = 16;

/// The judge of pixel centres near edges: the option `edges`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Edges {
    /// The driver. It snaps corners to a fraction of a pixel, mostly 1/256.
    Driver,
    /// The corners themselves, by a stage more (`wgsl/settle.wgsl`).
    #[default]
    Exact,
}

impl Edges {
    /// Reads the option's value; `None` for any other word.
    pub fn parse(value: &str) -> Option<Self> {
        match value {
            "driver" => Some(Self::Driver),
            "exact" => Some(Self::Exact),
            _ => None,
        }
    }
}

/// The way of drawing: the option `draw`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Draw {
    /// By the device's rasteriser.
    #[default]
    Raster,
    /// By compute shaders (`wgsl/tiles.wgsl`), with exact edges.
    Compute,
}

/// Columns and rows of a tile of `wgsl/tiles.wgsl`.
pub const TILE: [u32; 2] = [32, 16];

/// Tiles of a submission at most: those of 128 hemicubes at N = 128. A choice: with more, a GPU of few units is at one
/// submission for longer than its driver waits before it resets the device (2 s on Windows, `TdrDelay`); with fewer,
/// [`Limits::tile_groups`] have hardly a tile each. Not measured on a GPU.
const TILES_AT_ONCE: u32 = 12_288;

/// What a stage of a device may have at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OfStage {
    /// Threads of a work group.
    pub threads: u32,
    /// Bytes that they share.
    pub shared_bytes: u32,
    /// Storage buffers.
    pub storage_buffers: u32,
}

/// What `draw=compute` asks of a device: no more than every device of WebGPU has (`maxComputeInvocationsPerWorkgroup`,
/// `maxComputeWorkgroupStorageSize` and `maxStorageBuffersPerShaderStage` of its specification: 256, 16 KiB and 8).
pub const TILES_ASK: OfStage = OfStage {
    threads: 256,
    shared_bytes: 16 << 10,
    storage_buffers: 8,
};

/// What a device has at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AtOnce {
    /// [`Limits::group`].
    pub group: u32,
    /// [`Limits::batch`].
    pub batch: u32,
    /// [`Limits::tile_groups`].
    pub tile_groups: u32,
    /// [`Limits::tiles_each`].
    pub tiles_each: u32,
}

impl Draw {
    /// What a device is given at once. Choices: with fewer hemicubes or work groups a GPU's units run dry; more
    /// hemicubes take memory, and of more work groups none takes a second tile. 2,048 groups of 64 threads and 15 KiB
    /// are what 132 processors of 228 KiB hold (NVIDIA H100). On software, more hemicubes side by side gain nothing and
    /// lose caches. Not measured on a GPU by compute.
    ///
    /// On software a group draws one tile and ends: Mesa ends the loops of a thread after 65,535 rounds together
    /// (`LP_MAX_TGSI_LOOP_ITERATIONS`), and a tile takes hundreds to thousands. With 16 tiles a room takes 61 ms in place
    /// of 65 (`device_rate 128 16 room vulkan:draw=compute`), but a sixteenth of the rounds is left for each.
    pub fn at_once(self, is_software: bool) -> AtOnce {
        let (group, batch, tile_groups, tiles_each) = match (is_software, self) {
            (true, _) => (1, 16, 1, 1),
            (false, Self::Raster) => (16, 64, 1, u32::MAX),
            (false, Self::Compute) => (128, 128, 2048, u32::MAX),
        };
        AtOnce {
            group,
            batch,
            tile_groups,
            tiles_each,
        }
    }

    /// Checks that a device can draw so.
    ///
    /// # Errors
    /// [`BackendError::Unsupported`] naming what it lacks.
    pub fn check(self, device: &str, has: OfStage) -> Result<(), BackendError> {
        if self == Self::Raster {
            return Ok(());
        }
        let asked = [
            (has.threads, TILES_ASK.threads, "threads of a work group"),
            (has.shared_bytes, TILES_ASK.shared_bytes, "bytes shared by a work group"),
            (
                has.storage_buffers,
                TILES_ASK.storage_buffers,
                "storage buffers of a stage",
            ),
        ];
        match asked.into_iter().find(|(has, least, _)| has < least) {
            None => Ok(()),
            Some((has, least, what)) => Err(BackendError::Unsupported(format!(
                "`draw=compute` takes {least} {what}; `{device}` has {has}; take `draw=raster` or another device"
            ))),
        }
    }
}

/// The limits of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The longest range of a storage buffer, in bytes.
    pub storage_range: u64,
    /// Memory to take at most, in bytes.
    pub memory: u64,
    /// Layers of an image.
    pub layers: u32,
    /// The longest edge of an image.
    pub image_edge: u32,
    /// Hemicubes side by side in the stages: 1 on software, because more gain nothing and lose caches; more on GPUs, to
    /// fill their units.
    pub group: u32,
    /// Hemicubes of a submission.
    pub batch: u32,
    /// Work groups that take tiles from the queue of [`Draw::Compute`]: enough to fill the device.
    pub tile_groups: u32,
    /// Tiles that one of them draws at most. More groups draw the rest.
    pub tiles_each: u32,
    /// True to copy depths to a buffer for the pyramid ([`crate::stage::PYRAMID_OF_COPY`]). Software reads buffers
    /// faster than textures.
    pub copies_depths: bool,
    /// The judge of pixels near edges.
    pub edges: Edges,
    /// The way of drawing.
    pub draw: Draw,
}

/// The use of a device for a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Pixels along the edge of the top face.
    pub resolution: u32,
    /// Hemicubes side by side in the stages, each in its layer.
    pub group: u32,
    /// Hemicubes of a submission: a multiple of `group`.
    pub batch: u32,
    /// The most entries of a row.
    pub capacity: u32,
    /// Words of a bit a patch.
    pub word_count: u32,
    /// True for covered rows: sub-pixel patches are then looked for.
    pub covered: bool,
    /// True if depths are copied to a buffer before they are read: [`Limits::copies_depths`].
    pub copies_depths: bool,
    /// The judge of pixels near edges: [`Limits::edges`].
    pub edges: Edges,
    /// The way of drawing: [`Limits::draw`].
    pub draw: Draw,
    /// [`Limits::tile_groups`].
    tile_groups: u32,
    /// [`Limits::tiles_each`].
    pub tiles_each: u32,
}

/// A buffer sized by the scene or the plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Its name in messages.
    pub name: &'static str,
    /// Its binding.
    pub binding: u32,
    /// Its bytes.
    pub bytes: u64,
}

impl Plan {
    /// Chooses the largest group and batch within the limits.
    ///
    /// # Errors
    /// [`BackendError::Unsupported`] if a single buffer is beyond them, [`BackendError::OutOfMemory`] if all together
    /// are.
    pub fn new(upload: &Upload, settings: RenderSettings, limits: Limits) -> Result<Self, BackendError> {
        let resolution = settings.resolution;
        let pixels = u32::try_from(pixel_count(resolution)).unwrap_or(u32::MAX);
        if limits.image_edge < 3 * resolution {
            return Err(BackendError::Unsupported(format!(
                "resolution {resolution} needs an image of {} rows; the device's images have at most {}; ask for less",
                3 * resolution,
                limits.image_edge
            )));
        }
        if limits.edges == Edges::Exact && upload.patch_count > u32::MAX / 2 - 2 {
            return Err(BackendError::Unsupported(format!(
                "{} patches and their backs are more than 32-bit ids can tell apart; leave out `edges=exact`",
                upload.patch_count
            )));
        }
        let mut plan = Self {
            resolution,
            group: limits.group.min(limits.layers).max(1),
            batch: 0,
            // A row may hold any number of sub-pixel patches besides those of its pixels.
            capacity: if settings.covered {
                upload.patch_count
            } else {
                upload.patch_count.min(pixels)
            }
            .max(1),
            word_count: upload.patch_count.div_ceil(32).max(1),
            covered: settings.covered,
            copies_depths: limits.copies_depths,
            edges: limits.edges,
            draw: limits.draw,
            tile_groups: limits.tile_groups,
            tiles_each: limits.tiles_each.max(1),
        };
        let mut batch = limits.batch;
        if plan.draw == Draw::Compute {
            let most = (TILES_AT_ONCE / plan.tiles()).max(1);
            plan.group = plan.group.min(most);
            batch = batch.min(most);
        }
        plan.batch = batch.max(plan.group) / plan.group * plan.group;
        loop {
            let too_long = plan
                .sizes(upload)
                .into_iter()
                .find(|size| size.bytes > limits.storage_range);
            let bytes = plan.bytes(upload);
            if too_long.is_none() && bytes <= limits.memory {
                return Ok(plan);
            }
            if plan.batch > plan.group {
                plan.batch = (plan.batch / 2).max(plan.group) / plan.group * plan.group;
            } else if plan.group > 1 {
                plan.group /= 2;
                plan.batch = plan.group;
            } else if let Some(Size { name, bytes, .. }) = too_long {
                return Err(BackendError::Unsupported(format!(
                    "{name} of {} patches at resolution {resolution} need {bytes} bytes in one piece; \
                     the device allows {}; take a coarser scene, a lower resolution or the CPU",
                    upload.patch_count, limits.storage_range
                )));
            } else {
                return Err(BackendError::OutOfMemory(format!(
                    "{} patches at resolution {resolution} need {bytes} bytes on the device, \
                     of which {} may be used; take a coarser scene, a lower resolution, a higher limit or the CPU",
                    upload.patch_count, limits.memory
                )));
            }
        }
    }

    /// Lists the buffers sized by the scene or the plan.
    pub fn sizes(&self, upload: &Upload) -> Vec<Size> {
        use crate::stage::binding as b;
        let (group, batch) = (u64::from(self.group), u64::from(self.batch));
        let chunks = upload.chunks.len().max(1) as u64;
        let patches = u64::from(upload.patch_count.max(1));
        let faces = u64::from(FACES);
        let pixels = pixel_count(self.resolution) as u64;
        let is_raster = self.draw == Draw::Raster;
        let of_raster = |words: u64| if is_raster { group * words } else { 1 };
        let settled = |words: u64| {
            if self.settles() { group * words } else { 1 }
        };
        let words = |name, binding, words: u64| Size {
            name,
            binding,
            bytes: 4 * words,
        };
        vec![
            words("views", b::VIEWS, batch * faces * u64::from(VIEW_BYTES) / 4),
            words(
                "chunks",
                b::CHUNKS,
                (chunks + chunks.div_ceil(OF_A_RUN as u64)) * CHUNK_WORDS as u64,
            ),
            words(
                "depth pyramids",
                b::PYRAMID,
                of_raster(u64::from(self.pyramid_stride())),
            ),
            words("indirect draws", b::DRAWS, of_raster(faces * chunks * 5)),
            words("draw counts", b::DRAW_COUNTS, group * faces),
            words("marks of seen chunks", b::SEEN, chunks),
            words("marks of drawn chunks", b::DRAWN, group * faces * chunks),
            words("counters", b::TALLIES, group * 8),
            words("pixel weights", b::WEIGHTS, pixel_count(self.resolution) as u64),
            // And the number of the next tile.
            words("visible weights", b::VISIBLE, group * (patches + 2) + 1),
            words(
                "marks of visible patches",
                b::TOUCHED,
                group * u64::from(self.word_count),
            ),
            words(
                "corners",
                b::VERTICES,
                upload.vertices.len().max(1) as u64 * u64::from(VERTEX_BYTES) / 4,
            ),
            words(
                "corner numbers",
                b::INDICES,
                upload.indices.len().max(3) as u64 * if self.settles() { 2 } else { 1 },
            ),
            words("triangles of patches", b::TRIANGLE_OF_PATCH, patches),
            words("row entries", b::ENTRIES, group * u64::from(self.capacity) * 2),
            words("chunks of patches", b::CHUNK_OF_PATCH, patches),
            words("cover draws", b::COVER_DRAWS, group * 4),
            words("row totals", b::TOTALS, batch * 4),
            words("hidden weights", b::HIDDEN, group * u64::from(self.capacity)),
            words("rows to read back", b::OUTPUT, self.output_words()),
            words(
                "centroids",
                b::CENTROIDS,
                6 * if self.covered {
                    upload.triangle_count().max(1) as u64
                } else {
                    1
                },
            ),
            words(
                "copied depths",
                b::DEPTH_COPY,
                if self.copies_depths || !is_raster {
                    group * pixel_count(self.resolution) as u64
                } else {
                    1
                },
            ),
            words("marks of pixels near edges", b::NEAR, settled(pixels / 32 + 2)),
            words("pixels near edges", b::LISTED, settled(4 * pixels)),
            words("weights of sides", b::SIDES, settled(2 * patches + 2)),
        ]
    }

    /// True if pixels near edges are settled by a stage of their own.
    pub fn settles(&self) -> bool {
        self.draw == Draw::Raster && self.edges == Edges::Exact
    }

    /// Counts all bytes on the device: buffers, with views and output twice, and images.
    pub fn bytes(&self, upload: &Upload) -> u64 {
        use crate::stage::binding as b;
        let buffers: u64 = self
            .sizes(upload)
            .iter()
            .map(|size| {
                let twice = [b::VIEWS, b::OUTPUT].contains(&size.binding);
                size.bytes * if twice { 2 } else { 1 }
            })
            .sum();
        buffers + u64::from(self.group) * pixel_count(self.resolution) as u64 * 8
    }

    /// Words of a layer's pyramid.
    pub fn pyramid_stride(&self) -> u32 {
        let across = self.resolution / 4;
        3 * across * across + 3 * (across / 4) * (across / 4)
    }

    /// The first word of the entries in the output.
    pub fn output_entries(&self) -> u32 {
        self.batch * HEADER_WORDS
    }

    /// Words of the output.
    pub fn output_words(&self) -> u64 {
        u64::from(self.output_entries()) + u64::from(self.batch) * u64::from(self.capacity) * u64::from(ENTRY_WORDS)
    }

    /// Workgroups of the reduction of one layer.
    pub fn reduce_groups(&self) -> u32 {
        // 64 threads of 32 pixels each.
        (3 * self.resolution * self.resolution).div_ceil(64 * 32)
    }

    /// Tiles of a hemicube.
    pub fn tiles(&self) -> u32 {
        let (top, side) = (
            self.resolution.div_ceil(TILE[1]),
            (self.resolution / 2).div_ceil(TILE[1]),
        );
        self.resolution.div_ceil(TILE[0]) * (top + 4 * side)
    }

    /// Work groups for each of `layers` hemicubes: together [`Limits::tile_groups`], as they take tiles from a queue,
    /// or one for each tile if these are fewer; more where each draws [`Limits::tiles_each`].
    pub fn tile_groups(&self, layers: u32) -> u32 {
        let least = self.tiles().div_ceil(self.tiles_each).max(1);
        self.tile_groups
            .div_ceil(layers.max(1))
            .clamp(least, self.tiles().max(least))
    }

    /// Work groups of the search for sub-pixel patches, in x and in z.
    pub fn tiny_groups(&self, upload: &Upload) -> (u32, u32) {
        let chunks = u32::try_from(upload.chunks.len()).unwrap_or(u32::MAX);
        (chunks.min(32768), chunks.div_ceil(32768))
    }
}
