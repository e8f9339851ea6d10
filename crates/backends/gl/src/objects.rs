//! What a session holds of OpenGL's objects: shader programs, buffers, textures.

use crate::device::Entered;
use glow::HasContext;
use hemicube_contract::backend::BackendError;
use std::ops::Range;

/// A linked program of some stages.
pub(crate) fn program(
    entered: &Entered<'_>,
    name: &str,
    stages: &[(u32, &str)],
) -> Result<glow::Program, BackendError> {
    let gl = entered.gl;
    let wrong = |what: &str, log: String| BackendError::Internal(format!("shader `{name}` does not {what}: {log}"));
    // SAFETY: the context is current, and all names are its own.
    unsafe {
        let program = gl.create_program().map_err(BackendError::Internal)?;
        for &(kind, source) in stages {
            let shader = gl.create_shader(kind).map_err(BackendError::Internal)?;
            gl.shader_source(shader, source);
            gl.compile_shader(shader);
            if !gl.get_shader_compile_status(shader) {
                return Err(wrong("compile", gl.get_shader_info_log(shader)));
            }
            gl.attach_shader(program, shader);
            // It goes when the program does.
            gl.delete_shader(shader);
        }
        gl.link_program(program);
        if !gl.get_program_link_status(program) {
            return Err(wrong("link", gl.get_program_info_log(program)));
        }
        Ok(program)
    }
}

/// What a loaded scene holds; emptied before the next is loaded.
#[derive(Debug, Default)]
pub(crate) struct Objects {
    buffers: Vec<glow::Buffer>,
    textures: Vec<glow::Texture>,
    framebuffers: Vec<glow::Framebuffer>,
    vertex_arrays: Vec<glow::VertexArray>,
    queries: Vec<glow::Query>,
}

impl Objects {
    /// A buffer of `words` words, all 0. With `mapped`, one that [`Objects::map`] takes.
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

    /// A framebuffer on one layer of `depths`, and of `items` where given.
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

/// A buffer that the host reads while it stays mapped.
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

/// A number of bytes as OpenGL's bindings take it.
fn size(bytes: u64) -> Result<i32, BackendError> {
    i32::try_from(bytes).map_err(|_| {
        BackendError::Unsupported(format!(
            "{bytes} bytes in one buffer: OpenGL's bindings take 2 GiB; use a smaller scene"
        ))
    })
}

/// Numbers as the bytes that the device reads.
pub(crate) fn bytes_of(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|w| w.to_ne_bytes()).collect()
}
