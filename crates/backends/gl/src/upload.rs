//! A scene on the device: its buffers, images and framebuffers, and their binding points.

use crate::conv::{bytes_of, size};
use crate::device::Entered;
use crate::hierarchy::Hierarchy;
use glow::HasContext;
use hemicube_contract::backend::{BackendError, Geometry};
use hemicube_shaders::stage::binding;
use hemicube_shaders::upload::{VERTEX_BYTES, contents, split};
use hemicube_shaders::view::{FACES, VIEW_BYTES};
use hemicube_shaders::{Draw, Edges, Plan, Upload};
use std::collections::BTreeMap;
use std::ops::Range;

/// The OpenGL objects of a loaded scene, deleted before the next is loaded.
#[derive(Debug, Default)]
pub(crate) struct Objects {
    buffers: Vec<glow::Buffer>,
    textures: Vec<glow::Texture>,
    framebuffers: Vec<glow::Framebuffer>,
    vertex_arrays: Vec<glow::VertexArray>,
    queries: Vec<glow::Query>,
}

impl Objects {
    /// Makes a buffer of `words` words, all 0. With `mapped`, [`Mapped`] can map it.
    pub(crate) fn buffer(
        &mut self,
        entered: &Entered<'_>,
        words: u64,
        mapped: bool,
    ) -> Result<glow::Buffer, BackendError> {
        // A buffer of no bytes is an error of OpenGL, and a scene need not have any chunk.
        let bytes = size(words.max(4) * 4)?;
        let mut flags = glow::DYNAMIC_STORAGE_BIT;
        if mapped {
            flags |= MAPPING;
        }
        let buffer = self.new_buffer(entered)?;
        // SAFETY: the context is current and the buffer its own.
        unsafe { entered.gl.named_buffer_storage(buffer, bytes, None, flags) };
        entered.check("reserving memory")?;
        entered.clear_words(buffer, 0..usize::try_from(words).unwrap_or(usize::MAX));
        Ok(buffer)
    }

    /// A buffer of these bytes.
    pub(crate) fn filled(&mut self, entered: &Entered<'_>, bytes: &[u8]) -> Result<glow::Buffer, BackendError> {
        if bytes.is_empty() {
            return self.buffer(entered, 4, false);
        }
        let length = size(bytes.len() as u64)?;
        let buffer = self.new_buffer(entered)?;
        // SAFETY: as above; the bytes are copied by the call.
        unsafe { entered.gl.named_buffer_storage(buffer, length, Some(bytes), 0) };
        entered.check("uploading the scene")?;
        Ok(buffer)
    }

    fn new_buffer(&mut self, entered: &Entered<'_>) -> Result<glow::Buffer, BackendError> {
        // SAFETY: the context is current.
        let buffer = unsafe { entered.gl.create_named_buffer() }.map_err(BackendError::Internal)?;
        self.buffers.push(buffer);
        Ok(buffer)
    }

    /// An array of textures, `width` by `height` by `layers`.
    pub(crate) fn texture(
        &mut self,
        entered: &Entered<'_>,
        format: u32,
        [width, height, layers]: [u32; 3],
    ) -> Result<glow::Texture, BackendError> {
        let [width, height, layers] = [width, height, layers].map(|n| i32::try_from(n).unwrap_or(i32::MAX));
        let gl = entered.gl;
        // SAFETY: the context is current and the texture its own.
        let texture = unsafe {
            let texture = gl
                .create_named_texture(glow::TEXTURE_2D_ARRAY)
                .map_err(BackendError::Internal)?;
            self.textures.push(texture);
            gl.texture_storage_3d(texture, 1, format, width, height, layers);
            let nearest = i32::try_from(glow::NEAREST).unwrap_or(0);
            gl.texture_parameter_i32(texture, glow::TEXTURE_MIN_FILTER, nearest);
            gl.texture_parameter_i32(texture, glow::TEXTURE_MAG_FILTER, nearest);
            texture
        };
        entered.check("reserving item buffers")?;
        Ok(texture)
    }

    /// Makes a framebuffer on one layer of `depths`, and of `items`, if given.
    pub(crate) fn framebuffer(
        &mut self,
        entered: &Entered<'_>,
        items: Option<glow::Texture>,
        depths: glow::Texture,
        layer: u32,
    ) -> Result<glow::Framebuffer, BackendError> {
        let layer = i32::try_from(layer).unwrap_or(i32::MAX);
        let gl = entered.gl;
        // SAFETY: the context is current, and all names are its own.
        let status = unsafe {
            let framebuffer = gl.create_named_framebuffer().map_err(BackendError::Internal)?;
            self.framebuffers.push(framebuffer);
            gl.named_framebuffer_texture_layer(Some(framebuffer), glow::DEPTH_ATTACHMENT, Some(depths), 0, layer);
            if items.is_some() {
                gl.named_framebuffer_texture_layer(Some(framebuffer), glow::COLOR_ATTACHMENT0, items, 0, layer);
                gl.named_framebuffer_draw_buffers(Some(framebuffer), &[glow::COLOR_ATTACHMENT0]);
            } else {
                gl.named_framebuffer_draw_buffers(Some(framebuffer), &[glow::NONE]);
            }
            gl.check_named_framebuffer_status(Some(framebuffer), glow::DRAW_FRAMEBUFFER)
        };
        entered.check("making a framebuffer")?;
        match (status, self.framebuffers.last()) {
            (glow::FRAMEBUFFER_COMPLETE, Some(&made)) => Ok(made),
            _ => Err(BackendError::Unsupported(format!(
                "the driver cannot render 32-bit ids ({status:#x})"
            ))),
        }
    }

    pub(crate) fn vertex_array(&mut self, entered: &Entered<'_>) -> Result<glow::VertexArray, BackendError> {
        // SAFETY: the context is current.
        let array = unsafe { entered.gl.create_vertex_array() }.map_err(BackendError::Internal)?;
        self.vertex_arrays.push(array);
        Ok(array)
    }

    /// The `number`-th query, made when first asked for.
    pub(crate) fn query(&mut self, entered: &Entered<'_>, number: usize) -> Result<glow::Query, BackendError> {
        while self.queries.len() <= number {
            // SAFETY: the context is current.
            self.queries
                .push(unsafe { entered.gl.create_query() }.map_err(BackendError::Internal)?);
        }
        Ok(self.queries[number])
    }

    /// Gives everything back to the driver.
    pub(crate) fn delete(self, entered: &Entered<'_>) {
        let gl = entered.gl;
        // SAFETY: the context is current, and all names are its own and named nowhere else. Deleting a mapped buffer
        // unmaps it.
        unsafe {
            self.framebuffers.into_iter().for_each(|f| gl.delete_framebuffer(f));
            self.textures.into_iter().for_each(|t| gl.delete_texture(t));
            self.buffers.into_iter().for_each(|b| gl.delete_buffer(b));
            self.vertex_arrays.into_iter().for_each(|v| gl.delete_vertex_array(v));
            self.queries.into_iter().for_each(|q| gl.delete_query(q));
        }
    }
}

const MAPPING: u32 = glow::MAP_READ_BIT | glow::MAP_PERSISTENT_BIT | glow::MAP_COHERENT_BIT;

/// A buffer read by the host through a lasting mapping.
#[derive(Debug)]
pub(crate) struct Mapped {
    pub(crate) buffer: glow::Buffer,
    words: *const u32,
    length: usize,
}

// SAFETY: the mapping belongs to the context, which goes from thread to thread with the session that holds both.
unsafe impl Send for Mapped {}

impl Mapped {
    pub(crate) fn new(objects: &mut Objects, entered: &Entered<'_>, words: u64) -> Result<Self, BackendError> {
        let buffer = objects.buffer(entered, words, true)?;
        let bytes = size(words * 4)?;
        // SAFETY: the context is current; the buffer was made with these flags and is as long.
        let words_at = unsafe {
            entered.gl.bind_buffer(glow::COPY_READ_BUFFER, Some(buffer));
            entered.gl.map_buffer_range(glow::COPY_READ_BUFFER, 0, bytes, MAPPING)
        };
        entered.check("mapping memory")?;
        if words_at.is_null() {
            return Err(BackendError::OutOfMemory(format!("{bytes} bytes cannot be mapped")));
        }
        Ok(Self {
            buffer,
            words: words_at.cast_const().cast(),
            length: usize::try_from(words).unwrap_or(0),
        })
    }

    /// Copies some words out. The device must be done with writing them.
    pub(crate) fn read(&self, range: Range<usize>) -> Result<Vec<u32>, BackendError> {
        if range.end > self.length || range.start > range.end {
            return Err(BackendError::Internal(format!(
                "words {range:?} of a buffer of {} were asked for",
                self.length
            )));
        }
        // SAFETY: the range is within the mapping, which lasts as long as the buffer; reads are volatile in that the
        // copy is made after the fence was waited for.
        Ok(unsafe { std::slice::from_raw_parts(self.words.add(range.start), range.len()) }.to_vec())
    }
}

/// The named buffers of a scene, and its images.
pub(crate) struct Store {
    /// Nodes asked about: `glsl/box.vert`.
    pub(crate) asked: glow::Buffer,
    /// A bit for each: `glsl/mark.frag`.
    pub(crate) marks: Mapped,
    pub(crate) views: [glow::Buffer; 2],
    pub(crate) output: [Mapped; 2],
    pub(crate) visible: glow::Buffer,
    pub(crate) touched: glow::Buffer,
    pub(crate) drawn: glow::Buffer,
    pub(crate) cover_draws: glow::Buffer,
    pub(crate) draws: glow::Buffer,
    pub(crate) draw_counts: glow::Buffer,
    /// By layer: ids with depths, and depths alone.
    pub(crate) framebuffers: Vec<[glow::Framebuffer; 2]>,
    pub(crate) depths: glow::Texture,
    pub(crate) vertices: glow::VertexArray,
    pub(crate) no_vertices: glow::VertexArray,
}

impl Store {
    /// Makes the buffers and images of a scene; `objects` owns them, also when this ends early.
    pub(crate) fn new(
        entered: &Entered<'_>,
        geometry: &Geometry,
        upload: &Upload,
        plan: &Plan,
        hierarchy: &Hierarchy,
        objects: &mut Objects,
    ) -> Result<Self, BackendError> {
        let nodes = hierarchy.nodes.len();
        let filled: BTreeMap<_, _> = contents(upload, geometry, plan).into_iter().collect();
        let mut buffers: Vec<Option<glow::Buffer>> = vec![None; binding::COUNT as usize];
        for size in plan.sizes(upload) {
            if ![binding::VIEWS, binding::OUTPUT].contains(&size.binding) && !filled.contains_key(&size.binding) {
                buffers[size.binding as usize] = Some(objects.buffer(entered, size.bytes.div_ceil(4), false)?);
            }
        }
        for (binding, words) in filled {
            buffers[binding as usize] = Some(objects.filled(entered, &bytes_of(&words))?);
        }
        let view_words = u64::from(plan.batch * FACES * VIEW_BYTES / 4);
        let views = [
            objects.buffer(entered, view_words, false)?,
            objects.buffer(entered, view_words, false)?,
        ];
        let output = [
            Mapped::new(objects, entered, plan.output_words())?,
            Mapped::new(objects, entered, plan.output_words())?,
        ];
        let boxes = u64::from(FACES) * nodes as u64;
        let asked = objects.buffer(entered, boxes, false)?;
        let marks = Mapped::new(objects, entered, boxes.div_ceil(32).max(1))?;
        let size = [plan.resolution, 3 * plan.resolution, plan.group];
        let items = objects.texture(entered, glow::R32UI, size)?;
        let depths = objects.texture(entered, glow::DEPTH_COMPONENT32F, size)?;
        let mut framebuffers = Vec::new();
        for layer in 0..plan.group {
            framebuffers.push([
                objects.framebuffer(entered, Some(items), depths, layer)?,
                objects.framebuffer(entered, None, depths, layer)?,
            ]);
        }
        let (vertices, no_vertices) = (objects.vertex_array(entered)?, objects.vertex_array(entered)?);
        let named = |place: u32| {
            buffers[place as usize]
                .ok_or_else(|| BackendError::Internal(format!("there is no buffer for binding {place}")))
        };
        let store = Self {
            asked,
            marks,
            views,
            output,
            framebuffers,
            depths,
            vertices,
            no_vertices,
            visible: named(binding::VISIBLE)?,
            touched: named(binding::TOUCHED)?,
            drawn: named(binding::DRAWN)?,
            cover_draws: named(binding::COVER_DRAWS)?,
            draws: named(binding::DRAWS)?,
            draw_counts: named(binding::DRAW_COUNTS)?,
        };
        store.bind(entered, &buffers);
        let (vertices, indices) = (named(binding::VERTICES)?, named(binding::INDICES)?);
        store.set_state(entered, vertices, indices);
        let gl = entered.gl;
        // SAFETY: the context is current, and all names are its own.
        unsafe {
            gl.bind_texture_unit(binding::ITEMS, Some(items));
            gl.bind_texture_unit(binding::DEPTHS, Some(depths));
            if plan.edges == Edges::Exact || plan.draw == Draw::Compute {
                gl.bind_image_texture(ITEMS_UNIT, Some(items), 0, true, 0, glow::WRITE_ONLY, glow::R32UI);
            }
        }
        store.upload_boxes(entered, plan, hierarchy, objects)?;
        Ok(store)
    }

    fn bind(&self, entered: &Entered<'_>, buffers: &[Option<glow::Buffer>]) {
        let gl = entered.gl;
        // SAFETY: the context is current, and all names are its own.
        unsafe {
            for (place, &buffer) in (0u32..).zip(buffers).filter(|(_, buffer)| buffer.is_some()) {
                let kind = if place == binding::SETTINGS {
                    glow::UNIFORM_BUFFER
                } else {
                    glow::SHADER_STORAGE_BUFFER
                };
                gl.bind_buffer_base(kind, place, buffer);
            }
            gl.bind_buffer_base(glow::SHADER_STORAGE_BUFFER, ASKED, Some(self.asked));
            gl.bind_buffer_base(glow::SHADER_STORAGE_BUFFER, MARKS, Some(self.marks.buffer));
        }
    }

    /// Sets the vertex attributes and the constant state.
    fn set_state(&self, entered: &Entered<'_>, vertices: glow::Buffer, indices: glow::Buffer) {
        let gl = entered.gl;
        // SAFETY: the context is current, and all names are its own. The attributes are within a vertex.
        unsafe {
            gl.bind_vertex_array(Some(self.vertices));
            gl.bind_buffer(glow::ARRAY_BUFFER, Some(vertices));
            gl.bind_buffer(glow::ELEMENT_ARRAY_BUFFER, Some(indices));
            let stride = i32::try_from(VERTEX_BYTES).unwrap_or(0);
            gl.vertex_attrib_pointer_f32(0, 3, glow::FLOAT, false, stride, 0);
            gl.vertex_attrib_pointer_f32(1, 3, glow::FLOAT, false, stride, 12);
            gl.vertex_attrib_pointer_i32(2, 2, glow::UNSIGNED_INT, stride, 24);
            gl.vertex_attrib_pointer_f32(3, 3, glow::FLOAT, false, stride, 32);
            for attribute in 0..4 {
                gl.enable_vertex_attrib_array(attribute);
            }
            gl.clear_depth_f32(0.0);
            gl.disable(glow::DITHER);
            gl.disable(glow::CULL_FACE);
            gl.disable(glow::SCISSOR_TEST);
            // Faces look along w, with u to the right and v up: a front turns clockwise on them.
            gl.front_face(glow::CW);
        }
        entered.set_conventions();
    }

    /// Uploads the nodes' boxes.
    fn upload_boxes(
        &self,
        entered: &Entered<'_>,
        plan: &Plan,
        hierarchy: &Hierarchy,
        objects: &mut Objects,
    ) -> Result<(), BackendError> {
        let n = f64::from(plan.resolution);
        // Boxes are nearer than their contents by more than the error of depths. Sub-pixel patches may lie a little
        // behind visible ones: boxes are nearer by that, too.
        let wider = 1.0 / 256.0 + if plan.covered { 16.0 / n } else { 0.0 };
        #[allow(clippy::cast_possible_truncation, reason = "the widening is above the rounding")]
        let words: Vec<u32> = hierarchy
            .nodes
            .iter()
            .flat_map(|node| {
                let (high, low) = split(node.bounds.center);
                let half = node.bounds.half.to_array().map(|h| h as f32);
                [
                    high[0],
                    high[1],
                    high[2],
                    0.0,
                    low[0],
                    low[1],
                    low[2],
                    wider as f32,
                    half[0],
                    half[1],
                    half[2],
                    0.0,
                ]
            })
            .map(f32::to_bits)
            .collect();
        let boxes = objects.filled(entered, &bytes_of(&words))?;
        // SAFETY: the context is current and the buffer its own.
        unsafe {
            entered
                .gl
                .bind_buffer_base(glow::SHADER_STORAGE_BUFFER, BOXES, Some(boxes))
        };
        Ok(())
    }
}

/// Bindings besides the shared shaders' (`glsl/`): boxes, asked-about nodes, and the answers.
const BOXES: u32 = 0;
/// The image unit of `binding::SETTLED_ITEMS`.
const ITEMS_UNIT: u32 = 0;
const ASKED: u32 = binding::COUNT;
const MARKS: u32 = binding::COUNT + 1;
const _: () = assert!(
    ASKED == 30 && MARKS == 31 && MARKS + 1 == crate::device::STORAGE_BINDINGS.unsigned_abs(),
    "as `glsl/box.vert` and `glsl/mark.frag` say"
);
