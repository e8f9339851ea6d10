//! A loaded scene, the programs, and drawing.
//!
//! Culling never shows in a row: it looks at depths only. The ids of all possibly visible chunks are then drawn anew,
//! in the fixed order of the chunks, into a cleared depth buffer.

use crate::ask::Coherence;
use crate::conv::bytes_of;
use crate::cull::{Cull, FEW, Trial};
use crate::device::{Device, Entered};
use crate::hierarchy::{Hierarchy, runs};
use crate::options::Options;
use crate::upload::{Objects, Store};
use glow::HasContext;
use hemicube_contract::backend::{BackendError, Counters, Culling, Geometry, Hemicube, RenderSettings, StageTimes};
use hemicube_contract::face::Face;
use hemicube_shaders::output::unculled_triangles;
use hemicube_shaders::recording::{compute_stages, identify};
use hemicube_shaders::stage::{self, Stage, binding};
use hemicube_shaders::view::{FACES, FIRST_STAMP, VIEW_BYTES, stands_on_emitter};
use hemicube_shaders::{Draw, Edges, Limits, Plan, Upload};
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Instant;

/// The programs of all stages. Ids and depths have two each: of all patches, and of all but the emitter.
#[derive(Clone, Debug)]
pub(crate) struct Programs {
    depths: [glow::Program; 2],
    ids: [glow::Program; 2],
    pub(crate) cover: glow::Program,
    /// Ids of what is seen through a portal.
    pub(crate) through: glow::Program,
    /// Boxes of nodes, for queries and for marks.
    pub(crate) boxes: glow::Program,
    pub(crate) marks: glow::Program,
    /// By entry point.
    pub(crate) compute: HashMap<&'static str, glow::Program>,
}

impl Programs {
    pub(crate) fn new(entered: &Entered<'_>, draw: Draw, edges: Edges) -> Result<Self, BackendError> {
        let depth = include_str!("glsl/depth.frag");
        let compute = |stage: &Stage| program(entered, stage.entry, &[(glow::COMPUTE_SHADER, stage.glsl)]);
        let drawing = |name: &str, vertex: &str, fragment: &str| {
            program(
                entered,
                name,
                &[(glow::VERTEX_SHADER, vertex), (glow::FRAGMENT_SHADER, fragment)],
            )
        };
        let [ids, ids_of_others] = identify(edges);
        let stages = compute_stages(draw, edges, &[false]).into_iter();
        let compute = stages.map(|stage| Ok((stage.entry, compute(stage)?)));
        Ok(Self {
            depths: [
                drawing("depths", stage::RENDER.glsl, depth)?,
                drawing("depths of others", stage::RENDER.glsl, stage::OCCLUDE_OTHERS.glsl)?,
            ],
            ids: [
                drawing("ids", stage::RENDER.glsl, ids.glsl)?,
                drawing("ids of others", stage::RENDER.glsl, ids_of_others.glsl)?,
            ],
            boxes: drawing("boxes", include_str!("glsl/box.vert"), depth)?,
            marks: drawing("marks", include_str!("glsl/box.vert"), include_str!("glsl/mark.frag"))?,
            through: drawing("through", stage::THROUGH.glsl, stage::IDENTIFY_THROUGH.glsl)?,
            cover: drawing("cover", stage::COVER.glsl, stage::ADD_HIDDEN.glsl)?,
            compute: compute.collect::<Result<_, BackendError>>()?,
        })
    }
}

/// A linked program of some stages.
fn program(entered: &Entered<'_>, name: &str, stages: &[(u32, &str)]) -> Result<glow::Program, BackendError> {
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

/// A loaded scene.
pub(crate) struct Scene {
    pub(crate) geometry: Arc<Geometry>,
    pub(crate) settings: RenderSettings,
    pub(crate) plan: Plan,
    pub(crate) cull: Cull,
    pub(crate) upload: Arc<Upload>,
    pub(crate) options: Options,
    pub(crate) objects: Objects,
    pub(crate) store: Store,
    pub(crate) hierarchy: Arc<Hierarchy>,
    pub(crate) coherence: Coherence,
    /// Queries to read before the next hemicube, each with its node.
    pub(crate) pending: Vec<(glow::Query, u32)>,
    /// Queries begun for the hemicube.
    pub(crate) queries_begun: usize,
    pub(crate) stamp: u32,
    /// Nodes of no more triangles are drawn without being asked about.
    pub(crate) few: u32,
    pub(crate) trial: Trial,
    pub(crate) times: StageTimes,
    pub(crate) clock: Instant,
}

/// A hemicube, its place in the batch, its layer, and the set of buffers of the batch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place<'a> {
    pub(crate) hemicube: &'a Hemicube,
    pub(crate) slot: u32,
    pub(crate) layer: u32,
    pub(crate) half: usize,
}

impl Scene {
    pub(crate) fn new(
        device: &Device,
        entered: &Entered<'_>,
        geometry: &Arc<Geometry>,
        settings: RenderSettings,
        options: Options,
    ) -> Result<Self, BackendError> {
        let upload = Upload::of(geometry, options.draw)?;
        let plan = Plan::new(&upload, settings, limits(device, &options))?;
        let cull = options.cull_for(
            settings.culling == Culling::On,
            device.software,
            device.can_count_draws(),
            upload.triangle_count(),
        );
        let mut objects = Objects::default();
        let hierarchy = Hierarchy::new(&geometry.octree, &runs(&upload), options.max_level);
        let store = match Store::new(entered, geometry, &upload, &plan, &hierarchy, &mut objects) {
            Ok(store) => store,
            Err(error) => {
                objects.delete(entered);
                return Err(error);
            }
        };
        let scene = Self {
            geometry: Arc::clone(geometry),
            settings,
            plan,
            cull,
            options,
            objects,
            store,
            coherence: Coherence::new(hierarchy.nodes.len()),
            pending: Vec::new(),
            queries_begun: 0,
            hierarchy: Arc::new(hierarchy),
            stamp: FIRST_STAMP,
            few: options.min_patches.unwrap_or(FEW),
            trial: Trial::default(),
            times: StageTimes::default(),
            clock: Instant::now(),
            upload,
        };
        if cull == Cull::Off {
            let all = vec![1; plan.group as usize * FACES as usize * scene.upload.chunks.len()];
            scene.write(entered, scene.store.drawn, 0, &all);
        }
        if let Err(error) = entered.check("loading the scene") {
            scene.delete(entered);
            return Err(error);
        }
        Ok(scene)
    }

    pub(crate) fn delete(self, entered: &Entered<'_>) {
        self.objects.delete(entered);
    }

    pub(crate) fn write(&self, entered: &Entered<'_>, buffer: glow::Buffer, word: usize, words: &[u32]) {
        let place = i32::try_from(word * 4).unwrap_or(i32::MAX);
        // SAFETY: the context is current; a range beyond the buffer is an error of OpenGL. The words are copied by the
        // call.
        unsafe {
            entered
                .gl
                .named_buffer_sub_data_u8_slice(buffer, place, &bytes_of(words))
        };
    }

    /// Makes the view of a face current.
    pub(crate) fn bind_view(&self, entered: &Entered<'_>, half: usize, slot: u32, face: u32) {
        let place = i32::try_from((slot * FACES + face) * VIEW_BYTES).unwrap_or(i32::MAX);
        let long = i32::try_from(VIEW_BYTES).unwrap_or(0);
        // SAFETY: the context is current; the view is within the buffer, as `slot` is below `Plan::batch`.
        unsafe {
            entered.gl.bind_buffer_range(
                glow::UNIFORM_BUFFER,
                binding::VIEW,
                Some(self.store.views[half]),
                place,
                long,
            );
        }
    }

    /// Makes the depths of a layer the target; `clear`: for a new hemicube.
    pub(crate) fn begin_depths(&self, entered: &Entered<'_>, programs: &Programs, at: Place<'_>, clear: bool) {
        self.begin_layer(entered, at, 1, &programs.depths);
        if clear {
            // SAFETY: the context is current.
            unsafe { entered.gl.clear(glow::DEPTH_BUFFER_BIT) };
        }
    }

    fn begin_items(&self, entered: &Entered<'_>, programs: &Programs, at: Place<'_>) {
        self.begin_layer(entered, at, 0, &programs.ids);
        // SAFETY: the context is current.
        unsafe {
            entered
                .gl
                .clear_buffer_u32_slice(glow::COLOR, 0, &[self.upload.patch_count + 1; 4]);
            entered.gl.clear(glow::DEPTH_BUFFER_BIT);
        }
    }

    /// Makes a layer's framebuffer the target, with depths tested and written.
    fn begin_layer(&self, entered: &Entered<'_>, at: Place<'_>, target: usize, programs: &[glow::Program; 2]) {
        let on_emitter = stands_on_emitter(&self.geometry, &self.upload, at.hemicube);
        let gl = entered.gl;
        let framebuffer = self.store.framebuffers[at.layer as usize][target];
        // SAFETY: the context is current, and all names are its own.
        unsafe {
            gl.bind_framebuffer(glow::FRAMEBUFFER, Some(framebuffer));
            gl.enable(glow::DEPTH_TEST);
            gl.disable(glow::CULL_FACE);
            gl.depth_mask(true);
            gl.depth_func(glow::GREATER);
            gl.use_program(Some(programs[usize::from(!on_emitter)]));
            gl.bind_vertex_array(Some(self.store.vertices));
        }
    }

    /// Makes a face's view current, and its rows of the image.
    pub(crate) fn begin_face(&self, entered: &Entered<'_>, at: Place<'_>, face: Face) {
        let n = self.settings.resolution;
        let [first, width, rows] = [face.first_row(n), n, face.rows(n)].map(|k| i32::try_from(k).unwrap_or(i32::MAX));
        self.bind_view(entered, at.half, at.slot, face as u32);
        // SAFETY: the context is current.
        unsafe { entered.gl.viewport(0, first, width, rows) };
    }

    /// Draws depths of a layer by the list of the cull stage.
    pub(crate) fn draw_depths(&self, entered: &Entered<'_>, programs: &Programs, at: Place<'_>) {
        self.begin_depths(entered, programs, at, true);
        self.draw_counted(entered, at);
    }

    /// Draws ids of a layer: by `lists` of the host, by the list of the cull stage, or all.
    pub(crate) fn draw_items(
        &self,
        entered: &Entered<'_>,
        programs: &Programs,
        at: Place<'_>,
        lists: Option<&[Vec<u32>; 5]>,
        counters: &mut Counters,
    ) {
        self.begin_items(entered, programs, at);
        match (self.cull, lists) {
            (_, Some(lists)) => self.draw_lists(entered, at, lists),
            (Cull::Off, None) => {
                let all = i32::try_from(self.upload.indices.len()).unwrap_or(i32::MAX);
                for face in Face::ALL {
                    self.begin_face(entered, at, face);
                    // SAFETY: the context is current, and there are as many indices.
                    unsafe { entered.gl.draw_elements(glow::TRIANGLES, all, glow::UNSIGNED_INT, 0) };
                }
                let triangles = unculled_triangles(&self.upload, 1);
                counters.triangles_transformed += triangles;
                counters.triangles_drawn += triangles;
            }
            _ => self.draw_counted(entered, at),
        }
    }

    /// Draws the entries of a layer's row alone. The compact stage wrote how many; each corner is found by its number.
    pub(crate) fn draw_cover(&self, entered: &Entered<'_>, programs: &Programs, at: Place<'_>) {
        let gl = entered.gl;
        // SAFETY: the context is current, and all names are its own.
        unsafe {
            gl.bind_framebuffer(glow::FRAMEBUFFER, Some(self.store.framebuffers[at.layer as usize][1]));
            gl.disable(glow::DEPTH_TEST);
            gl.use_program(Some(programs.cover));
            gl.bind_vertex_array(Some(self.store.no_vertices));
            gl.bind_buffer(glow::DRAW_INDIRECT_BUFFER, Some(self.store.cover_draws));
            for face in Face::ALL {
                self.begin_face(entered, at, face);
                gl.draw_arrays_indirect_offset(glow::TRIANGLES, i32::try_from(16 * at.layer).unwrap_or(0));
            }
            gl.memory_barrier(glow::SHADER_STORAGE_BARRIER_BIT);
        }
    }

    /// Draws the list of the cull stage for a layer.
    fn draw_counted(&self, entered: &Entered<'_>, at: Place<'_>) {
        let chunks = u32::try_from(self.upload.chunks.len()).unwrap_or(u32::MAX);
        // SAFETY: the context is current; the buffers have draws of five words for every face and chunk, and a count
        // for every face.
        unsafe {
            entered
                .gl
                .bind_buffer(glow::DRAW_INDIRECT_BUFFER, Some(self.store.draws));
            entered
                .gl
                .bind_buffer(glow::PARAMETER_BUFFER, Some(self.store.draw_counts));
            for face in Face::ALL {
                self.begin_face(entered, at, face);
                let list = (at.layer * FACES + face as u32) as usize;
                entered.draw_indirect(list * chunks as usize * 20, list * 4, chunks);
            }
        }
    }

    /// Draws listed chunks, ascending on each face.
    pub(crate) fn draw_lists(&self, entered: &Entered<'_>, at: Place<'_>, lists: &[Vec<u32>; 5]) {
        for face in Face::ALL {
            let list = &lists[face as usize];
            if !list.is_empty() {
                self.begin_face(entered, at, face);
                self.draw_list(entered, list);
            }
        }
    }

    fn draw_list(&self, entered: &Entered<'_>, list: &[u32]) {
        let (mut firsts, mut counts): (Vec<usize>, Vec<i32>) = (Vec::new(), Vec::new());
        let mut end = u32::MAX;
        for &chunk in list {
            let chunk = &self.upload.chunks[chunk as usize];
            let count = i32::try_from(chunk.index_count).unwrap_or(i32::MAX);
            match counts.last_mut() {
                Some(last) if end == chunk.first_index => *last += count,
                _ => {
                    firsts.push(chunk.first_index as usize * 4);
                    counts.push(count);
                }
            }
            end = chunk.first_index + chunk.index_count;
        }
        // SAFETY: the context is current, the scene's vertex array is bound, and chunks are within its indices.
        unsafe { entered.draw_runs(&firsts, &counts) };
    }
}

fn limits(device: &Device, options: &Options) -> Limits {
    let at_once = options.draw.at_once(device.software);
    let batch = if options.dense() {
        1
    } else {
        options.batch.unwrap_or(at_once.batch)
    };
    Limits {
        storage_range: device.limits.storage_range.min(i32::MAX as u64),
        memory: options.memory.unwrap_or(u64::MAX),
        layers: device.limits.layers,
        image_edge: device.limits.texture_size,
        group: options.group.unwrap_or(at_once.group).min(batch),
        batch,
        tile_groups: at_once.tile_groups,
        tiles_each: at_once.tiles_each,
        copies_depths: false,
        edges: options.edges,
        draw: options.draw,
    }
}
