//! The device's side of a loaded scene, and the way of a hemicube through the stages.
//!
//! ```text
//! cull ▶ depths of what is thought to be in front ▶ cull ▶ ids ▶ reduce ▶ tiny ▶ compact ▶ cover ▶ pack
//! ```
//!
//! With `edges=exact`, pixels near edges are settled after `reduce`: see `hemicube_shaders`.
//!
//! What is culled never shows in a row: culling looks at depths only, and then the ids of all that may be seen are
//! drawn anew, in the fixed order of the chunks, into a cleared depth buffer.

use crate::ask::{Asking, Coherence, OnFaces, add};
use crate::cull::{ALL_FACES, Descend, FacePlanes, Hierarchy, WalkCounters, runs};
use crate::device::{Device, Entered};
use crate::objects::{Mapped, Objects, bytes_of, program};
use crate::options::{Cull, Options};
use glow::HasContext;
use hemicube_contract::backend::{BackendError, Counters, Culling, Geometry, Hemicube, RenderSettings, StageTimes};
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::face::{Face, Items};
use hemicube_contract::row::RowBlock;
use hemicube_shaders::limits::SETTLE_GROUPS;
use hemicube_shaders::output::{ENTRY_WORDS, HEADER_WORDS, append_rows, entry_words};
use hemicube_shaders::stage::{self, Stage, binding};
use hemicube_shaders::upload::{VERTEX_BYTES, split};
use hemicube_shaders::view::{FACES, FIRST_STAMP, VIEW_BYTES, settings_words, stands_on_emitter};
use hemicube_shaders::{Edges, Limits, Plan, Upload, View, views};
use std::sync::Arc;
use std::time::Instant;

/// The programs of all stages.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Programs {
    depths: glow::Program,
    depths_of_others: glow::Program,
    ids: glow::Program,
    ids_of_others: glow::Program,
    boxes: glow::Program,
    marks: glow::Program,
    cover: glow::Program,
    cull_seen: glow::Program,
    cull_hidden: glow::Program,
    cull_outside: glow::Program,
    pyramid: glow::Program,
    reduce: glow::Program,
    tiny: glow::Program,
    compact: glow::Program,
    pack: glow::Program,
    settling: Option<Settling>,
}

/// The programs that give pixels near edges to the triangle that their centre lies in.
#[derive(Clone, Copy, Debug)]
struct Settling {
    near_edges: glow::Program,
    settle: glow::Program,
    put_settled: glow::Program,
    take_back: glow::Program,
}

impl Programs {
    pub(crate) fn new(entered: &Entered<'_>, edges: Edges) -> Result<Self, BackendError> {
        let depth = include_str!("glsl/depth.frag");
        let compute = |stage: &Stage| program(entered, stage.entry, &[(glow::COMPUTE_SHADER, stage.glsl)]);
        let drawing = |name: &str, vertex: &str, fragment: &str| {
            program(
                entered,
                name,
                &[(glow::VERTEX_SHADER, vertex), (glow::FRAGMENT_SHADER, fragment)],
            )
        };
        let (ids, ids_of_others, reduce) = match edges {
            Edges::Driver => (&stage::IDENTIFY, &stage::IDENTIFY_OTHERS, &stage::REDUCE),
            Edges::Exact => (
                &stage::IDENTIFY_SIDES,
                &stage::IDENTIFY_OTHER_SIDES,
                &stage::REDUCE_SIDES,
            ),
        };
        let settling = match edges {
            Edges::Driver => None,
            Edges::Exact => Some(Settling {
                near_edges: compute(&stage::NEAR_EDGES)?,
                settle: compute(&stage::SETTLE)?,
                put_settled: compute(&stage::PUT_SETTLED)?,
                take_back: compute(&stage::TAKE_BACK)?,
            }),
        };
        Ok(Self {
            depths: drawing("depths", stage::RENDER.glsl, depth)?,
            depths_of_others: drawing("depths of others", stage::RENDER.glsl, stage::OCCLUDE_OTHERS.glsl)?,
            ids: drawing("ids", stage::RENDER.glsl, ids.glsl)?,
            ids_of_others: drawing("ids of others", stage::RENDER.glsl, ids_of_others.glsl)?,
            boxes: drawing("boxes", include_str!("glsl/box.vert"), depth)?,
            marks: drawing("marks", include_str!("glsl/box.vert"), include_str!("glsl/mark.frag"))?,
            cover: drawing("cover", stage::COVER.glsl, stage::ADD_HIDDEN.glsl)?,
            cull_seen: compute(&stage::CULL_SEEN)?,
            cull_hidden: compute(&stage::CULL_HIDDEN)?,
            cull_outside: compute(&stage::CULL_OUTSIDE)?,
            pyramid: compute(&stage::PYRAMID_OF)?,
            reduce: compute(reduce)?,
            tiny: compute(&stage::TINY)?,
            compact: compute(&stage::COMPACT)?,
            pack: compute(&stage::PACK)?,
            settling,
        })
    }
}

/// A loaded scene.
pub(crate) struct Scene {
    pub(crate) geometry: Arc<Geometry>,
    pub(crate) settings: RenderSettings,
    pub(crate) plan: Plan,
    pub(crate) cull: Cull,
    upload: Arc<Upload>,
    options: Options,
    objects: Objects,
    views: [glow::Buffer; 2],
    output: [Mapped; 2],
    visible: glow::Buffer,
    touched: glow::Buffer,
    drawn: glow::Buffer,
    cover_draws: glow::Buffer,
    draws: glow::Buffer,
    draw_counts: glow::Buffer,
    /// By layer: ids with depths, and depths alone.
    framebuffers: Vec<[glow::Framebuffer; 2]>,
    vertices: glow::VertexArray,
    no_vertices: glow::VertexArray,
    hierarchy: Arc<Hierarchy>,
    coherence: Coherence,
    /// Queries whose result is due before the next hemicube, and the node that each is of.
    pending: Vec<(glow::Query, u32)>,
    asked: glow::Buffer,
    marks: Mapped,
    stamp: u32,
    /// Nodes of no more triangles are drawn without being asked about.
    few: u32,
    trial: Trial,
    pub(crate) times: StageTimes,
    clock: Instant,
}

/// True if culling pays, by what it did for the first hemicubes.
#[derive(Clone, Copy, Debug, Default)]
struct Trial {
    in_view: u64,
    hidden: u64,
    /// Triangles in view of faces, and those sent to the device.
    triangles: u64,
    transformed: u64,
    hemicubes: u64,
    over: bool,
    gave_up: bool,
}

/// What the rounds of questions of a hemicube cost, in triangles: some 0.4 ms.
const ROUNDS: u64 = 6000;

/// Hemicubes after which it is decided whether occlusion culling pays.
const TRIAL: u64 = 32;

/// Nodes of more triangles than this are asked about, where nobody says: chunks have up to 256, so that these are most
/// nodes.
const FEW: u32 = 64;
/// The same where hardly anything is hidden, so that most answers say nothing, and the share of the triangles in view
/// that counts as hardly anything (`docs/study.md` has what was measured).
const FEW_IN_THE_OPEN: u32 = 600;
const IN_THE_OPEN: f64 = 0.125;

/// A batch on its way.
#[derive(Debug)]
pub(crate) struct Submission {
    slots: u32,
    half: usize,
    fence: glow::Fence,
    counters: Counters,
}

/// Where a hemicube is: its place in the batch, its layer, and which set of buffers the batch has.
#[derive(Clone, Copy, Debug)]
struct Place {
    slot: u32,
    layer: u32,
    half: usize,
}

/// Boxes to be drawn: for each in the shader's list which of the nodes asked about it is, and on which face; the list's
/// end for each face; and the faces of each node that need not be asked about.
struct Boxes {
    within: Vec<u8>,
    places: Vec<(usize, u8)>,
    ends: [usize; 5],
}

/// The queries of a node, with the face of each.
type Queries = Vec<(u8, glow::Query)>;

/// The faces on which each node is in front, once its queries are done.
fn answers(entered: &Entered<'_>, asked: &[OnFaces], queries: &[Queries]) -> Vec<u8> {
    let each = asked.iter().zip(queries);
    each.map(|(&(_, faces), queries)| {
        let hidden = queries
            .iter()
            .filter(|(_, query)| !is_visible(entered, *query))
            .fold(0, |bits, (bit, _)| bits | bit);
        faces & !hidden
    })
    .collect()
}

/// Where time goes.
#[derive(Clone, Copy, Debug)]
enum Time {
    Cull,
    Render,
    Cover,
    Reduce,
    ReadBack,
}

impl Scene {
    pub(crate) fn new(
        device: &Device,
        entered: &Entered<'_>,
        geometry: &Arc<Geometry>,
        settings: RenderSettings,
        options: Options,
    ) -> Result<Self, BackendError> {
        let kept = geometry.kept(|geometry| Upload::new(geometry).map(Arc::new).map_err(|error| error.to_string()));
        let upload = match &*kept {
            Ok(upload) => Arc::clone(upload),
            Err(reason) => return Err(BackendError::Unsupported(reason.clone())),
        };
        let plan = Plan::new(&upload, settings, limits(device, &options))?;
        let cull = options.cull_for(
            settings.culling == Culling::On,
            device.software,
            device.can_count_draws(),
            upload.triangle_count(),
        );
        let mut objects = Objects::default();
        let hierarchy = Hierarchy::new(&geometry.octree, &runs(&upload), options.max_level);
        let made = Self::make(
            entered,
            geometry,
            &upload,
            &plan,
            settings,
            hierarchy.nodes.len(),
            &mut objects,
        );
        let made = match made {
            Ok(made) => made,
            Err(error) => {
                objects.delete(entered);
                return Err(error);
            }
        };
        let mut scene = Self {
            geometry: Arc::clone(geometry),
            settings,
            plan,
            cull,
            options,
            objects,
            views: made.views,
            output: made.output,
            visible: made.visible,
            touched: made.touched,
            drawn: made.drawn,
            cover_draws: made.cover_draws,
            draws: made.draws,
            draw_counts: made.draw_counts,
            framebuffers: made.framebuffers,
            vertices: made.vertices,
            no_vertices: made.no_vertices,
            coherence: Coherence::new(hierarchy.nodes.len()),
            pending: Vec::new(),
            asked: made.asked,
            marks: made.marks,
            hierarchy: Arc::new(hierarchy),
            stamp: FIRST_STAMP,
            few: options.min_patches.unwrap_or(FEW),
            trial: Trial::default(),
            times: StageTimes::default(),
            clock: Instant::now(),
            upload,
        };
        if let Err(error) = scene
            .upload_boxes(entered)
            .and_then(|()| entered.check("loading the scene"))
        {
            scene.delete(entered);
            return Err(error);
        }
        Ok(scene)
    }

    pub(crate) fn delete(self, entered: &Entered<'_>) {
        self.objects.delete(entered);
    }

    fn make(
        entered: &Entered<'_>,
        geometry: &Geometry,
        upload: &Upload,
        plan: &Plan,
        settings: RenderSettings,
        nodes: usize,
        objects: &mut Objects,
    ) -> Result<Made, BackendError> {
        let gl = entered.gl;
        let mut buffers: Vec<Option<glow::Buffer>> = vec![None; binding::COUNT as usize];
        for size in plan.sizes(upload) {
            let content = match size.binding {
                binding::VIEWS | binding::OUTPUT => continue,
                binding::CHUNKS => Some(bytes_of(&upload.chunk_words())),
                binding::VERTICES => Some(bytes_of(upload.vertices.as_flattened())),
                binding::INDICES => Some(bytes_of(&upload.indices)),
                binding::TRIANGLE_OF_PATCH => Some(bytes_of(&upload.triangle_of_patch)),
                binding::CHUNK_OF_PATCH => Some(bytes_of(&upload.chunk_of_patch)),
                binding::CENTROIDS if settings.covered => Some(bytes_of(&upload.centroids(geometry))),
                binding::WEIGHTS => Some(bytes_of(&DeltaTable::new(settings.resolution).weights())),
                _ => None,
            };
            buffers[size.binding as usize] = Some(match content {
                Some(bytes) => objects.filled(entered, &bytes)?,
                None => objects.buffer(entered, size.bytes.div_ceil(4), false)?,
            });
        }
        let uniforms = objects.filled(entered, &bytes_of(&settings_words(plan, upload)))?;
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
        // SAFETY: the context is current, and all names are its own. The attributes are within a vertex.
        unsafe {
            for (place, buffer) in (0u32..).zip(&buffers) {
                if let Some(buffer) = buffer {
                    gl.bind_buffer_base(glow::SHADER_STORAGE_BUFFER, place, Some(*buffer));
                }
            }
            gl.bind_buffer_base(glow::SHADER_STORAGE_BUFFER, ASKED, Some(asked));
            gl.bind_buffer_base(glow::SHADER_STORAGE_BUFFER, MARKS, Some(marks.buffer));
            gl.bind_buffer_base(glow::UNIFORM_BUFFER, binding::SETTINGS, Some(uniforms));
            gl.bind_texture_unit(binding::ITEMS, Some(items));
            gl.bind_texture_unit(binding::DEPTHS, Some(depths));
            if plan.edges == Edges::Exact {
                gl.bind_image_texture(ITEMS_UNIT, Some(items), 0, true, 0, glow::WRITE_ONLY, glow::R32UI);
            }
            gl.bind_vertex_array(Some(vertices));
            gl.bind_buffer(glow::ARRAY_BUFFER, Some(named(binding::VERTICES)?));
            gl.bind_buffer(glow::ELEMENT_ARRAY_BUFFER, Some(named(binding::INDICES)?));
            let stride = i32::try_from(VERTEX_BYTES).unwrap_or(0);
            gl.vertex_attrib_pointer_f32(0, 3, glow::FLOAT, false, stride, 0);
            gl.vertex_attrib_pointer_f32(1, 3, glow::FLOAT, false, stride, 12);
            gl.vertex_attrib_pointer_i32(2, 2, glow::UNSIGNED_INT, stride, 24);
            for attribute in 0..3 {
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
        Ok(Made {
            asked,
            marks,
            views,
            output,
            framebuffers,
            vertices,
            no_vertices,
            visible: named(binding::VISIBLE)?,
            touched: named(binding::TOUCHED)?,
            drawn: named(binding::DRAWN)?,
            cover_draws: named(binding::COVER_DRAWS)?,
            draws: named(binding::DRAWS)?,
            draw_counts: named(binding::DRAW_COUNTS)?,
        })
    }

    /// The boxes that queries draw, and marks of drawn chunks where nothing will be culled.
    fn upload_boxes(&mut self, entered: &Entered<'_>) -> Result<(), BackendError> {
        let n = f64::from(self.settings.resolution);
        // Boxes are nearer than what is in them by more than depths can be off, and where tiny patches are asked for by
        // as much as these may lie behind what is seen.
        let wider = 1.0 / 256.0 + if self.settings.covered { 16.0 / n } else { 0.0 };
        #[allow(clippy::cast_possible_truncation, reason = "the widening is above the rounding")]
        let words: Vec<u32> = self
            .hierarchy
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
        let boxes = self.objects.filled(entered, &bytes_of(&words))?;
        // SAFETY: the context is current and the buffer its own.
        unsafe {
            entered
                .gl
                .bind_buffer_base(glow::SHADER_STORAGE_BUFFER, BOXES, Some(boxes))
        };
        if self.cull == Cull::Off {
            let all = vec![1; self.plan.group as usize * FACES as usize * self.upload.chunks.len()];
            self.write(entered, self.drawn, 0, &all);
        }
        Ok(())
    }

    fn write(&self, entered: &Entered<'_>, buffer: glow::Buffer, word: usize, words: &[u32]) {
        let place = i32::try_from(word * 4).unwrap_or(i32::MAX);
        // SAFETY: the context is current; a range beyond the buffer is an error of OpenGL. The words are copied by the
        // call.
        unsafe {
            entered
                .gl
                .named_buffer_sub_data_u8_slice(buffer, place, &bytes_of(words))
        };
    }

    /// Ends a stage, where stages are timed: the time until the device has done all that it was asked.
    ///
    /// Not by timer queries: of a software driver they see the threads that rasterise and not the one that transforms
    /// and bins triangles, which is where most of its time goes.
    fn timed(&mut self, entered: &Entered<'_>, stage: Time) {
        if !self.options.timing {
            return;
        }
        // SAFETY: the context is current.
        unsafe { entered.gl.finish() };
        let now = Instant::now();
        let spent = u64::try_from(now.duration_since(self.clock).as_nanos()).unwrap_or(u64::MAX);
        self.clock = now;
        *match stage {
            Time::Cull => &mut self.times.cull,
            Time::Render => &mut self.times.render,
            Time::Cover => &mut self.times.cover,
            Time::Reduce => &mut self.times.reduce,
            Time::ReadBack => &mut self.times.read_back,
        } += spent;
    }

    /// Sends a batch to the device, at most [`Plan::batch`] hemicubes. `half` says which of the two sets of buffers is
    /// free.
    pub(crate) fn submit(
        &mut self,
        entered: &Entered<'_>,
        programs: &Programs,
        hemicubes: &[Hemicube],
        half: usize,
    ) -> Result<Submission, BackendError> {
        self.clock = Instant::now();
        let mut counters = Counters::default();
        let slots = u32::try_from(hemicubes.len()).unwrap_or(u32::MAX);
        self.begin(entered, hemicubes, half);
        let mut slot = 0;
        for group in hemicubes.chunks(self.plan.group as usize) {
            self.draw_group(entered, programs, group, slot, half, &mut counters)?;
            self.reduce_group(entered, programs, group, slot, half)?;
            slot += u32::try_from(group.len()).unwrap_or(u32::MAX);
        }
        // SAFETY: the context is current.
        let fence = unsafe {
            entered.gl.memory_barrier(glow::CLIENT_MAPPED_BUFFER_BARRIER_BIT);
            let fence = entered.gl.fence_sync(glow::SYNC_GPU_COMMANDS_COMPLETE, 0);
            entered.gl.flush();
            fence
        };
        let fence = fence.map_err(BackendError::Internal)?;
        entered.check("rendering")?;
        Ok(Submission {
            slots,
            half,
            fence,
            counters,
        })
    }

    /// Uploads the views of a batch.
    fn begin(&mut self, entered: &Entered<'_>, hemicubes: &[Hemicube], half: usize) {
        let mut words = Vec::with_capacity(hemicubes.len() * (FACES * VIEW_BYTES / 4) as usize);
        for (hemicube, slot) in hemicubes.iter().zip(0u32..) {
            let (layer, group) = (slot % self.plan.group, slot / self.plan.group);
            let at = View {
                slot,
                layer,
                stamp: self.stamp + group,
            };
            words.extend_from_slice(views(&self.geometry, hemicube, self.settings.resolution, at).as_flattened());
        }
        let groups = u32::try_from(hemicubes.len())
            .unwrap_or(u32::MAX)
            .div_ceil(self.plan.group);
        self.stamp = self.stamp.wrapping_add(groups);
        self.write(entered, self.views[half], 0, &words);
        // SAFETY: the context is current and the buffers its own.
        unsafe {
            entered
                .gl
                .bind_buffer_base(glow::SHADER_STORAGE_BUFFER, binding::VIEWS, Some(self.views[half]));
            entered.gl.bind_buffer_base(
                glow::SHADER_STORAGE_BUFFER,
                binding::OUTPUT,
                Some(self.output[half].buffer),
            );
        }
    }

    /// Makes the view of a face current.
    fn bind_view(&self, entered: &Entered<'_>, half: usize, slot: u32, face: u32) {
        let place = i32::try_from((slot * FACES + face) * VIEW_BYTES).unwrap_or(i32::MAX);
        let long = i32::try_from(VIEW_BYTES).unwrap_or(0);
        // SAFETY: the context is current; the view is within the buffer, as `slot` is below `Plan::batch`.
        unsafe {
            entered
                .gl
                .bind_buffer_range(glow::UNIFORM_BUFFER, binding::VIEW, Some(self.views[half]), place, long);
        }
    }

    fn dispatch(&self, entered: &Entered<'_>, program: glow::Program, groups: [u32; 3]) {
        // SAFETY: the context is current. Each stage writes within its buffers, whose sizes and groups the shared plan
        // gives.
        unsafe {
            entered.gl.use_program(Some(program));
            entered.gl.dispatch_compute(groups[0], groups[1], groups[2]);
            entered.gl.memory_barrier(
                glow::SHADER_STORAGE_BARRIER_BIT | glow::COMMAND_BARRIER_BIT | glow::TEXTURE_FETCH_BARRIER_BIT,
            );
        }
    }

    /// Draws the ids of a group of hemicubes, and finds what to draw.
    fn draw_group(
        &mut self,
        entered: &Entered<'_>,
        programs: &Programs,
        group: &[Hemicube],
        slot: u32,
        half: usize,
        counters: &mut Counters,
    ) -> Result<(), BackendError> {
        let layers = u32::try_from(group.len()).unwrap_or(u32::MAX);
        let n = self.settings.resolution;
        match self.cull {
            Cull::Frustum => {
                self.bind_view(entered, half, slot, 0);
                self.dispatch(entered, programs.cull_outside, [FACES, layers, 1]);
            }
            Cull::Depth => {
                self.bind_view(entered, half, slot, 0);
                self.dispatch(entered, programs.cull_seen, [FACES, layers, 1]);
                self.timed(entered, Time::Cull);
                for (hemicube, layer) in group.iter().zip(0u32..) {
                    self.begin_depths(entered, programs, hemicube, layer, true);
                    self.draw_counted(
                        entered,
                        Place {
                            slot: slot + layer,
                            layer,
                            half,
                        },
                    );
                }
                self.timed(entered, Time::Render);
                self.bind_view(entered, half, slot, 0);
                self.dispatch(entered, programs.pyramid, [n / 16, 3 * n / 16, layers]);
                self.dispatch(entered, programs.cull_hidden, [FACES, layers, 1]);
            }
            Cull::Off | Cull::View | Cull::Queries | Cull::Marks => {}
        }
        self.timed(entered, Time::Cull);
        for (hemicube, layer) in group.iter().zip(0u32..) {
            let at = Place {
                slot: slot + layer,
                layer,
                half,
            };
            let lists = match self.cull {
                Cull::Queries | Cull::Marks => Some(self.ask(entered, programs, hemicube, at, counters)?),
                Cull::View => {
                    let mut asking = self.begin_asking(hemicube, u32::MAX);
                    let lists = asking.lists(None);
                    self.note_lists(entered, &mut asking, &lists, at, counters);
                    Some(lists)
                }
                Cull::Off | Cull::Frustum | Cull::Depth => None,
            };
            self.timed(entered, Time::Cull);
            self.begin_ids(entered, programs, hemicube, layer);
            match (self.cull, lists) {
                (_, Some(lists)) => self.draw_lists(entered, at, &lists),
                (Cull::Off, None) => {
                    let all = i32::try_from(self.upload.indices.len()).unwrap_or(i32::MAX);
                    for face in Face::ALL {
                        self.begin_face(entered, half, slot + layer, face);
                        // SAFETY: the context is current, and there are as many indices.
                        unsafe { entered.gl.draw_elements(glow::TRIANGLES, all, glow::UNSIGNED_INT, 0) };
                    }
                    let triangles = u64::from(FACES) * self.upload.triangle_count() as u64;
                    counters.triangles_transformed += triangles;
                    counters.triangles_drawn += triangles;
                }
                _ => self.draw_counted(
                    entered,
                    Place {
                        slot: slot + layer,
                        layer,
                        half,
                    },
                ),
            }
        }
        self.timed(entered, Time::Render);
        Ok(())
    }

    /// Makes the depths of a layer the target; `clear`: for a new hemicube.
    fn begin_depths(&self, entered: &Entered<'_>, programs: &Programs, hemicube: &Hemicube, layer: u32, clear: bool) {
        let on_emitter = stands_on_emitter(&self.geometry, &self.upload, hemicube);
        let gl = entered.gl;
        let framebuffer = self.framebuffers[layer as usize][1];
        // SAFETY: the context is current, and all names are its own.
        unsafe {
            gl.bind_framebuffer(glow::FRAMEBUFFER, Some(framebuffer));
            gl.enable(glow::DEPTH_TEST);
            gl.disable(glow::CULL_FACE);
            gl.depth_mask(true);
            gl.depth_func(glow::GREATER);
            if clear {
                gl.clear(glow::DEPTH_BUFFER_BIT);
            }
            gl.use_program(Some(if on_emitter {
                programs.depths
            } else {
                programs.depths_of_others
            }));
            gl.bind_vertex_array(Some(self.vertices));
        }
    }

    fn begin_ids(&self, entered: &Entered<'_>, programs: &Programs, hemicube: &Hemicube, layer: u32) {
        let on_emitter = stands_on_emitter(&self.geometry, &self.upload, hemicube);
        let gl = entered.gl;
        let framebuffer = self.framebuffers[layer as usize][0];
        // SAFETY: the context is current, and all names are its own.
        unsafe {
            gl.bind_framebuffer(glow::FRAMEBUFFER, Some(framebuffer));
            gl.enable(glow::DEPTH_TEST);
            gl.disable(glow::CULL_FACE);
            gl.depth_mask(true);
            gl.depth_func(glow::GREATER);
            gl.clear_buffer_u32_slice(glow::COLOR, 0, &[self.upload.patch_count + 1; 4]);
            gl.clear(glow::DEPTH_BUFFER_BIT);
            gl.use_program(Some(if on_emitter {
                programs.ids
            } else {
                programs.ids_of_others
            }));
            gl.bind_vertex_array(Some(self.vertices));
        }
    }

    fn begin_face(&self, entered: &Entered<'_>, half: usize, slot: u32, face: Face) {
        let n = self.settings.resolution;
        let [first, width, rows] = [face.first_row(n), n, face.rows(n)].map(|k| i32::try_from(k).unwrap_or(i32::MAX));
        self.bind_view(entered, half, slot, face as u32);
        // SAFETY: the context is current.
        unsafe { entered.gl.viewport(0, first, width, rows) };
    }

    /// Draws what the cull stage has listed for a layer.
    fn draw_counted(&self, entered: &Entered<'_>, at: Place) {
        let chunks = u32::try_from(self.upload.chunks.len()).unwrap_or(u32::MAX);
        // SAFETY: the context is current; the buffers have draws of five words for every face and chunk, and a count
        // for every face.
        unsafe {
            entered.gl.bind_buffer(glow::DRAW_INDIRECT_BUFFER, Some(self.draws));
            entered.gl.bind_buffer(glow::PARAMETER_BUFFER, Some(self.draw_counts));
            for face in Face::ALL {
                self.begin_face(entered, at.half, at.slot, face);
                let list = (at.layer * FACES + face as u32) as usize;
                entered.draw_indirect(list * chunks as usize * 20, list * 4, chunks);
            }
        }
    }

    /// Draws listed chunks, those of each face in ascending order.
    fn draw_lists(&self, entered: &Entered<'_>, at: Place, lists: &[Vec<u32>; 5]) {
        for face in Face::ALL {
            let list = &lists[face as usize];
            if !list.is_empty() {
                self.begin_face(entered, at.half, at.slot, face);
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

    /// Finds by frustum and occlusion which chunks may be seen on each face, ascending: see [`crate::ask`].
    fn ask(
        &mut self,
        entered: &Entered<'_>,
        programs: &Programs,
        hemicube: &Hemicube,
        at: Place,
        counters: &mut Counters,
    ) -> Result<[Vec<u32>; 5], BackendError> {
        for (query, place) in std::mem::take(&mut self.pending) {
            if is_visible(entered, query) {
                self.coherence.note(place);
            }
        }
        let hierarchy = Arc::clone(&self.hierarchy);
        let mut asking = self.begin_asking(hemicube, self.few);
        let marks = self.cull == Cull::Marks;
        if self.is_tried() {
            self.trial.triangles += self.triangles_in_view(hemicube);
        }
        self.begin_depths(entered, programs, hemicube, at.layer, true);
        let mut number = 0;
        loop {
            let mut fresh: [Vec<u32>; 5] = Default::default();
            for (leaf, faces) in asking.fresh.drain(..) {
                add(&mut fresh, faces, hierarchy.nodes[leaf as usize].chunks.clone());
            }
            counters.triangles_transformed += fresh.iter().map(|list| self.triangles_of(list)).sum::<u64>();
            self.draw_lists(entered, at, &fresh);
            let asked = std::mem::take(&mut asking.asked);
            if asked.is_empty() {
                break;
            }
            let visible = if marks {
                self.mark(entered, programs, hemicube, at, &asked, counters)?
            } else {
                let queries = self.query(entered, programs, hemicube, at, &asked, &mut number, counters)?;
                answers(entered, &asked, &queries)
            };
            self.begin_depths(entered, programs, hemicube, at.layer, false);
            asking.hear(&asked, &visible);
        }
        // Behind all that this one sees, for the next hemicube.
        let mut units = asking.units();
        units.retain(|&(place, _)| hierarchy.nodes[place as usize].triangles > self.few);
        let lists = if marks {
            let visible = self.mark(entered, programs, hemicube, at, &units, counters)?;
            for (&(place, _), &faces) in units.iter().zip(&visible) {
                if faces != 0 {
                    self.coherence.note(place);
                }
            }
            asking.lists(Some((&units, &visible)))
        } else {
            let queries = self.query(entered, programs, hemicube, at, &units, &mut number, counters)?;
            for (&(place, faces), queries) in units.iter().zip(queries) {
                if queries.len() < faces.count_ones() as usize {
                    self.coherence.note(place);
                }
                self.pending
                    .extend(queries.into_iter().map(|(_, query)| (query, place)));
            }
            asking.lists(None)
        };
        self.note_lists(entered, &mut asking, &lists, at, counters);
        Ok(lists)
    }

    fn begin_asking(&mut self, hemicube: &Hemicube, few: u32) -> Asking {
        let planes = FacePlanes::new(hemicube, self.geometry.plane_tolerance);
        Asking::new(&self.hierarchy, planes, few, &mut self.coherence)
    }

    /// Counts what is drawn and why, and tells the stage that looks for tiny patches.
    fn note_lists(
        &mut self,
        entered: &Entered<'_>,
        asking: &mut Asking,
        lists: &[Vec<u32>; 5],
        at: Place,
        counters: &mut Counters,
    ) {
        counters.nodes_tested += asking.walked.tested;
        counters.nodes_outside += asking.walked.outside;
        counters.nodes_hidden += asking.hidden;
        let triangles = lists.iter().map(|list| self.triangles_of(list)).sum::<u64>();
        counters.triangles_drawn += triangles;
        counters.triangles_transformed += triangles;
        if self.settings.covered {
            let mut marks = vec![0; FACES as usize * self.upload.chunks.len()];
            for (face, list) in lists.iter().enumerate() {
                for &chunk in list {
                    marks[face * self.upload.chunks.len() + chunk as usize] = 1;
                }
            }
            self.write(entered, self.drawn, at.layer as usize * marks.len(), &marks);
        }
    }

    /// The triangles of all chunks in view, once a face.
    fn triangles_in_view(&self, hemicube: &Hemicube) -> u64 {
        let planes = FacePlanes::new(hemicube, self.geometry.plane_tolerance);
        let mut triangles = 0;
        self.hierarchy
            .walk(0, ALL_FACES, &planes, &mut WalkCounters::default(), |place, faces| {
                let node = &self.hierarchy.nodes[place as usize];
                if node.is_leaf(place) {
                    triangles += u64::from(node.triangles * faces.count_ones());
                }
                Descend::Yes
            });
        triangles
    }

    fn triangles_of(&self, list: &[u32]) -> u64 {
        list.iter()
            .map(|&chunk| u64::from(self.upload.chunks[chunk as usize].index_count / 3))
            .sum()
    }

    /// Lists the nodes to be asked about by face, for the shader, and gives where each face's begin. A node whose box
    /// the eye is in, or almost, is not asked about: its faces in `within`.
    fn list_boxes(&self, entered: &Entered<'_>, hemicube: &Hemicube, asked: &[OnFaces]) -> Boxes {
        let mut boxes = Boxes {
            within: vec![0; asked.len()],
            places: Vec::new(),
            ends: [0; 5],
        };
        let inside: Vec<bool> = asked
            .iter()
            .map(|&(place, _)| {
                let bounds = &self.hierarchy.nodes[place as usize].bounds;
                let away = (hemicube.origin - bounds.center).abs();
                // As much as the shader widens it, and more: an eye within sees the box from inside, or not at all.
                let far = away.length() + bounds.half.length();
                let wider = far * (1.0 / 64.0 + 32.0 / f64::from(self.settings.resolution));
                away.cmple(bounds.half + wider).all()
            })
            .collect();
        let mut words = Vec::new();
        for face in Face::ALL {
            let bit = 1u8 << face as u8;
            for (k, (&(place, faces), &inside)) in asked.iter().zip(&inside).enumerate() {
                if faces & bit == 0 {
                    continue;
                }
                if inside {
                    boxes.within[k] |= bit;
                } else {
                    boxes.places.push((k, bit));
                    words.push(place);
                }
            }
            boxes.ends[face as usize] = boxes.places.len();
        }
        if !words.is_empty() {
            self.write(entered, self.asked, 0, &words);
        }
        boxes
    }

    /// Makes the program that draws boxes current, for depths to be tested and not written.
    fn begin_boxes(&self, entered: &Entered<'_>, program: glow::Program) {
        // SAFETY: the context is current, and all names are its own.
        unsafe {
            entered.gl.use_program(Some(program));
            entered.gl.bind_vertex_array(Some(self.no_vertices));
            entered.gl.depth_mask(false);
            // Boxes are wound inwards, and the eye is in none: what is left are the sides that it sees.
            entered.gl.enable(glow::CULL_FACE);
            entered.gl.cull_face(glow::FRONT);
        }
    }

    /// On which faces the box of each node is in front of the depths: by a draw of all boxes of a face.
    fn mark(
        &self,
        entered: &Entered<'_>,
        programs: &Programs,
        hemicube: &Hemicube,
        at: Place,
        asked: &[OnFaces],
        counters: &mut Counters,
    ) -> Result<Vec<u8>, BackendError> {
        let boxes = self.list_boxes(entered, hemicube, asked);
        let mut visible = boxes.within;
        let words = boxes.places.len().div_ceil(32);
        if words == 0 {
            return Ok(visible);
        }
        entered.clear_words(self.marks.buffer, 0..words);
        self.begin_boxes(entered, programs.marks);
        let mut first = 0;
        for face in Face::ALL {
            let end = boxes.ends[face as usize];
            if end > first {
                self.begin_face(entered, at.half, at.slot, face);
                let [corner, count] = [36 * first, 36 * (end - first)].map(|k| i32::try_from(k).unwrap_or(i32::MAX));
                // SAFETY: as above; the shader finds the node of each corner in the list, which is as long.
                unsafe { entered.gl.draw_arrays(glow::TRIANGLES, corner, count) };
            }
            first = end;
        }
        // SAFETY: the context is current.
        let fence = unsafe {
            entered
                .gl
                .memory_barrier(glow::CLIENT_MAPPED_BUFFER_BARRIER_BIT | glow::BUFFER_UPDATE_BARRIER_BIT);
            entered.gl.fence_sync(glow::SYNC_GPU_COMMANDS_COMPLETE, 0)
        };
        wait(entered, fence.map_err(BackendError::Internal)?)?;
        let marks = self.marks.read(0..words)?;
        counters.bytes_read_back += 4 * words as u64;
        for (number, &(k, bit)) in boxes.places.iter().enumerate() {
            if marks[number / 32] >> (number % 32) & 1 == 1 {
                visible[k] |= bit;
            }
        }
        Ok(visible)
    }

    /// Begins a hardware query of each node on each of its faces. Where there is none, the eye is in the box.
    #[allow(clippy::too_many_arguments, reason = "as `mark`, and the number of queries so far")]
    fn query(
        &mut self,
        entered: &Entered<'_>,
        programs: &Programs,
        hemicube: &Hemicube,
        at: Place,
        asked: &[OnFaces],
        number: &mut usize,
        counters: &mut Counters,
    ) -> Result<Vec<Queries>, BackendError> {
        let gl = entered.gl;
        let boxes = self.list_boxes(entered, hemicube, asked);
        let mut queries: Vec<Queries> = vec![Vec::new(); asked.len()];
        self.begin_boxes(entered, programs.boxes);
        let mut first = 0;
        for face in Face::ALL {
            let end = boxes.ends[face as usize];
            if end > first {
                self.begin_face(entered, at.half, at.slot, face);
            }
            for place in first..end {
                let (k, bit) = boxes.places[place];
                let query = self.objects.query(entered, *number)?;
                *number += 1;
                counters.queries += 1;
                // SAFETY: the context is current; the shader finds the node of each corner in the list.
                unsafe {
                    gl.begin_query(glow::ANY_SAMPLES_PASSED, query);
                    gl.draw_arrays(glow::TRIANGLES, i32::try_from(36 * place).unwrap_or(i32::MAX), 36);
                    gl.end_query(glow::ANY_SAMPLES_PASSED);
                }
                queries[k].push((bit, query));
            }
            first = end;
        }
        Ok(queries)
    }

    /// From the item buffers of a group to its rows in the output.
    fn reduce_group(
        &mut self,
        entered: &Entered<'_>,
        programs: &Programs,
        group: &[Hemicube],
        slot: u32,
        half: usize,
    ) -> Result<(), BackendError> {
        let gl = entered.gl;
        let layers = u32::try_from(group.len()).unwrap_or(u32::MAX);
        self.bind_view(entered, half, slot, 0);
        self.dispatch(entered, programs.reduce, [self.plan.reduce_groups(), layers, 1]);
        if let Some(settling) = programs.settling {
            self.dispatch(entered, settling.near_edges, [SETTLE_GROUPS, layers, 1]);
            self.dispatch(entered, settling.settle, [SETTLE_GROUPS, layers, 1]);
            // SAFETY: the context is current. The item buffer is written as an image after it was read as a texture,
            // and read and drawn to after that.
            unsafe { gl.memory_barrier(glow::SHADER_IMAGE_ACCESS_BARRIER_BIT) };
            self.dispatch(entered, settling.put_settled, [SETTLE_GROUPS, layers, 1]);
            // SAFETY: as above.
            unsafe { gl.memory_barrier(glow::SHADER_IMAGE_ACCESS_BARRIER_BIT | glow::FRAMEBUFFER_BARRIER_BIT) };
        }
        if self.options.dense() {
            self.timed(entered, Time::Reduce);
            return Ok(());
        }
        if self.settings.covered {
            let (x, z) = self.plan.tiny_groups(&self.upload);
            self.dispatch(entered, programs.tiny, [x, layers, z]);
        }
        self.dispatch(entered, programs.compact, [layers, 1, 1]);
        self.timed(entered, Time::Reduce);
        if self.settings.covered {
            for layer in 0..layers {
                // SAFETY: the context is current, and all names are its own. The draw's length was written by the
                // compact stage; each corner is found by its number.
                unsafe {
                    gl.bind_framebuffer(glow::FRAMEBUFFER, Some(self.framebuffers[layer as usize][1]));
                    gl.disable(glow::DEPTH_TEST);
                    gl.use_program(Some(programs.cover));
                    gl.bind_vertex_array(Some(self.no_vertices));
                    gl.bind_buffer(glow::DRAW_INDIRECT_BUFFER, Some(self.cover_draws));
                    for face in Face::ALL {
                        self.begin_face(entered, half, slot + layer, face);
                        gl.draw_arrays_indirect_offset(glow::TRIANGLES, i32::try_from(16 * layer).unwrap_or(0));
                    }
                    gl.memory_barrier(glow::SHADER_STORAGE_BARRIER_BIT);
                }
            }
            self.bind_view(entered, half, slot, 0);
            if let Some(settling) = programs.settling {
                self.dispatch(entered, settling.take_back, [SETTLE_GROUPS, layers, 1]);
            }
            self.timed(entered, Time::Cover);
        }
        self.dispatch(entered, programs.pack, [PACK_GROUPS, layers, 1]);
        self.timed(entered, Time::ReadBack);
        Ok(())
    }

    /// Returns whether a batch is read before the next is begun: the baselines know no other way.
    pub(crate) fn one_by_one(&self) -> bool {
        self.options.dense()
    }

    /// Waits for a batch and appends its rows.
    pub(crate) fn finish(
        &mut self,
        entered: &Entered<'_>,
        submission: Submission,
        out: &mut RowBlock,
    ) -> Result<Counters, BackendError> {
        self.clock = Instant::now();
        wait(entered, submission.fence)?;
        let mut counters = submission.counters;
        if self.options.dense() {
            self.read_dense(entered, out, &mut counters)?;
            counters.hemicubes += u64::from(submission.slots);
        } else {
            let output = &self.output[submission.half];
            let headers = output.read(0..(submission.slots * HEADER_WORDS) as usize)?;
            let first = self.plan.output_entries() as usize;
            let words = entry_words(&self.plan, &headers, submission.slots)?;
            debug_assert!(words.is_multiple_of(ENTRY_WORDS as usize), "whole entries");
            let entries = output.read(first..first + words)?;
            counters += append_rows(&headers, &entries, submission.slots, self.settings.covered, out);
        }
        self.timed(entered, Time::ReadBack);
        self.judge(&counters);
        Ok(counters)
    }

    /// Reads a whole row of visible weights, as the baselines do, and zeroes it.
    fn read_dense(
        &self,
        entered: &Entered<'_>,
        out: &mut RowBlock,
        counters: &mut Counters,
    ) -> Result<(), BackendError> {
        let count = self.upload.patch_count as usize;
        let mut bytes = vec![0u8; 4 * (count + 2)];
        // SAFETY: the context is current; the buffer has a weight for each patch and two more.
        unsafe {
            entered.gl.memory_barrier(glow::BUFFER_UPDATE_BARRIER_BIT);
            entered.gl.bind_buffer(glow::COPY_READ_BUFFER, Some(self.visible));
            entered.gl.get_buffer_sub_data(glow::COPY_READ_BUFFER, 0, &mut bytes);
        }
        entered.clear_words(self.visible, 0..count + 2);
        entered.clear_words(self.touched, 0..self.plan.word_count as usize);
        let (words, _) = bytes.as_chunks::<4>();
        for (&word, patch) in words[..count].iter().zip(0u32..) {
            let weight = u32::from_ne_bytes(word);
            if weight != 0 {
                out.push(hemicube_contract::InputPatch(patch), weight, 0);
            }
        }
        out.end_row(u32::from_ne_bytes(words[count + 1]), u32::from_ne_bytes(words[count]));
        counters.bytes_read_back += bytes.len() as u64;
        entered.check("reading a row")
    }

    /// Returns whether hemicubes are counted still to decide how to cull.
    fn is_tried(&self) -> bool {
        let finds_few = self.cull == Cull::Queries && self.options.min_patches.is_none();
        !self.trial.over && (self.options.may_switch_off() || finds_few)
    }

    /// Leaves out occlusion culling from here on where it has found too little to be worth its time, or asks less. Rows
    /// stay the same.
    fn judge(&mut self, counters: &Counters) {
        if !self.is_tried() {
            return;
        }
        self.trial.hemicubes += counters.hemicubes;
        self.trial.in_view += counters.nodes_tested - counters.nodes_outside;
        self.trial.hidden += counters.nodes_hidden;
        self.trial.transformed += counters.triangles_transformed;
        if self.trial.hemicubes < TRIAL {
            return;
        }
        self.trial.over = true;
        match self.cull {
            Cull::Marks if self.trial.triangles < self.trial.transformed + ROUNDS * self.trial.hemicubes => {
                self.cull = Cull::View;
            }
            Cull::Depth if self.trial.hidden * 2 < self.trial.in_view => self.cull = Cull::Frustum,
            Cull::Queries if self.options.min_patches.is_none() => {
                // What is drawn is drawn twice, as depths and as ids.
                let drawn = 0.5 * self.trial.transformed as f64;
                if drawn > (1.0 - IN_THE_OPEN) * self.trial.triangles as f64 {
                    self.few = FEW_IN_THE_OPEN;
                }
                return;
            }
            _ => return,
        }
        self.trial.gave_up = true;
    }

    /// What was decided, for the log.
    pub(crate) fn choices(&self) -> Vec<String> {
        let chunks = self.upload.chunks.len();
        vec![
            format!(
                "{} triangles in {chunks} chunks ({} given twice); batches of {} hemicubes, {} at a time",
                self.upload.triangle_count(),
                self.upload.merged,
                self.plan.batch,
                self.plan.group
            ),
            format!(
                "culling: {}{}{}",
                self.cull.words(),
                match self.cull {
                    Cull::Queries | Cull::Marks => format!(
                        " (of nodes down to level {} with more than {} triangles)",
                        self.options.max_level, self.few
                    ),
                    _ => String::new(),
                },
                if self.trial.gave_up {
                    "; too little is hidden for more"
                } else {
                    ""
                }
            ),
        ]
    }

    /// The item buffer of one hemicube.
    pub(crate) fn items(
        &mut self,
        entered: &Entered<'_>,
        programs: &Programs,
        hemicube: &Hemicube,
    ) -> Result<Items, BackendError> {
        let gl = entered.gl;
        self.begin(entered, std::slice::from_ref(hemicube), 0);
        self.draw_group(
            entered,
            programs,
            std::slice::from_ref(hemicube),
            0,
            0,
            &mut Counters::default(),
        )?;
        if programs.settling.is_some() {
            // Ids are settled on the way to a row.
            self.reduce_group(entered, programs, std::slice::from_ref(hemicube), 0, 0)?;
        }
        let n = self.settings.resolution;
        let mut bytes = vec![0u8; 12 * n as usize * n as usize];
        let [width, height] = [n, 3 * n].map(|k| i32::try_from(k).unwrap_or(i32::MAX));
        // SAFETY: the context is current; there is room for 3N² numbers.
        unsafe {
            gl.bind_framebuffer(glow::FRAMEBUFFER, Some(self.framebuffers[0][0]));
            gl.pixel_store_i32(glow::PACK_ALIGNMENT, 4);
            gl.read_pixels(
                0,
                0,
                width,
                height,
                glow::RED_INTEGER,
                glow::UNSIGNED_INT,
                glow::PixelPackData::Slice(Some(&mut bytes)),
            );
        }
        entered.check("reading an item buffer")?;
        let (words, _) = bytes.as_chunks::<4>();
        let count = self.upload.patch_count;
        let seen = words.iter().map(|&word| match u32::from_ne_bytes(word) {
            id if id < count => id,
            id if id == count + 1 => Items::ESCAPED,
            _ => Items::BLOCKED,
        });
        Ok(Items {
            resolution: n,
            seen: seen.collect(),
        })
    }
}

struct Made {
    asked: glow::Buffer,
    marks: Mapped,
    views: [glow::Buffer; 2],
    output: [Mapped; 2],
    visible: glow::Buffer,
    touched: glow::Buffer,
    drawn: glow::Buffer,
    cover_draws: glow::Buffer,
    draws: glow::Buffer,
    draw_counts: glow::Buffer,
    framebuffers: Vec<[glow::Framebuffer; 2]>,
    vertices: glow::VertexArray,
    no_vertices: glow::VertexArray,
}

/// Bindings of what this backend has besides the shared shaders' (`glsl/`): boxes, nodes asked about, and the answers.
const BOXES: u32 = 0;
/// The image unit of `binding::SETTLED_ITEMS`.
const ITEMS_UNIT: u32 = 0;
const ASKED: u32 = binding::COUNT;
const MARKS: u32 = binding::COUNT + 1;
const _: () = assert!(
    ASKED == 30 && MARKS == 31 && MARKS + 1 == crate::device::STORAGE_BINDINGS.unsigned_abs(),
    "as `glsl/box.vert` and `glsl/mark.frag` say"
);

/// Work groups that copy the entries of a row: a few thousand at most.
const PACK_GROUPS: u32 = 8;

fn is_visible(entered: &Entered<'_>, query: glow::Query) -> bool {
    // SAFETY: the context is current, and the query was begun and ended in it.
    unsafe { entered.gl.get_query_parameter_u32(query, glow::QUERY_RESULT) != 0 }
}

/// Waits until the device has passed a fence.
fn wait(entered: &Entered<'_>, fence: glow::Fence) -> Result<(), BackendError> {
    /// A batch takes some milliseconds: after a minute, the device has hung.
    const TRIES: usize = 60;
    for _ in 0..TRIES {
        // SAFETY: the context is current and the fence its own.
        let status = unsafe {
            entered
                .gl
                .client_wait_sync(fence, glow::SYNC_FLUSH_COMMANDS_BIT, 1_000_000_000)
        };
        match status {
            glow::ALREADY_SIGNALED | glow::CONDITION_SATISFIED => {
                // SAFETY: as above; it is not used again.
                unsafe { entered.gl.delete_sync(fence) };
                return Ok(());
            }
            glow::TIMEOUT_EXPIRED => {}
            _ => {
                entered.check("waiting for a batch")?;
                return Err(BackendError::DeviceLost("waiting for a batch failed".to_owned()));
            }
        }
    }
    Err(BackendError::DeviceLost(
        "a batch has not come back for a minute".to_owned(),
    ))
}

fn limits(device: &Device, options: &Options) -> Limits {
    // On software, batches gain nothing and a second hemicube in flight costs caches; elsewhere both hide latencies.
    let (group, batch) = if device.software { (1, 16) } else { (16, 64) };
    let batch = if options.dense() {
        1
    } else {
        options.batch.unwrap_or(batch)
    };
    Limits {
        storage_range: device.limits.storage_range.min(i32::MAX as u64),
        memory: options.memory.unwrap_or(u64::MAX),
        layers: device.limits.layers,
        image_edge: device.limits.texture_size,
        group: options.group.unwrap_or(group).min(batch),
        batch,
        copies_depths: false,
        edges: options.edges,
    }
}
