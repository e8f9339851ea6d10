//! Carries out the steps of a batch, and reads it back.
//!
//! [`Scene::submit`] is the interpreter of [`hemicube_shaders::recording`] on OpenGL. Each dispatch is followed by a
//! barrier for storage, commands and textures. With culling by the host (`cull=view`, `marks` or `queries`), ids are
//! drawn from its lists: see [`crate::ask`].

use crate::cull::Cull;
use crate::device::Entered;
use crate::render::{Place, Programs, Scene};
use glow::HasContext;
use hemicube_contract::InputPatch;
use hemicube_contract::backend::{BackendError, Counters, Hemicube};
use hemicube_contract::face::Items;
use hemicube_contract::row::RowBlock;
use hemicube_shaders::output::{self, ENTRY_WORDS, HEADER_WORDS, append_rows, entry_words};
use hemicube_shaders::stage::{Stage, binding};
use hemicube_shaders::view::submission_views;
use hemicube_shaders::{Action, Goal, Phase, Recording};
use std::time::Instant;

/// A batch on its way.
#[derive(Debug)]
pub(crate) struct Submission {
    slots: u32,
    half: usize,
    fence: glow::Fence,
    counters: Counters,
}

/// Hemicubes side by side, each in its layer.
#[derive(Clone, Copy)]
struct Group<'a> {
    hemicubes: &'a [Hemicube],
    first_slot: u32,
    half: usize,
}

impl<'a> Group<'a> {
    fn layers(&self) -> u32 {
        u32::try_from(self.hemicubes.len()).unwrap_or(u32::MAX)
    }

    fn places(self) -> impl Iterator<Item = Place<'a>> {
        (0u32..).zip(self.hemicubes).map(move |(layer, hemicube)| Place {
            hemicube,
            slot: self.first_slot + layer,
            layer,
            half: self.half,
        })
    }
}

impl Scene {
    /// Ends a timed phase: waits until the device is done, and counts the time since the last one.
    ///
    /// No timer queries, because on a software driver they see the rasterising threads only, and not the one thread
    /// that transforms and bins triangles for most of the time.
    fn timed(&mut self, entered: &Entered<'_>, phase: Phase) {
        if !self.options.timing {
            return;
        }
        // SAFETY: the context is current.
        unsafe { entered.gl.finish() };
        let now = Instant::now();
        let spent = u64::try_from(now.duration_since(self.clock).as_nanos()).unwrap_or(u64::MAX);
        self.clock = now;
        *phase.time(&mut self.times) += spent;
    }

    /// Sends a batch of at most [`Plan::batch`](hemicube_shaders::Plan) hemicubes to the device. `half` names the free
    /// one of the two sets of buffers.
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
        let goal = if self.options.dense() {
            Goal::Weights
        } else {
            Goal::Rows
        };
        let mut slot = 0;
        for group in hemicubes.chunks(self.plan.group as usize) {
            let group = Group {
                hemicubes: group,
                first_slot: slot,
                half,
            };
            self.carry_out(entered, programs, group, goal, &mut counters)?;
            slot += group.layers();
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
        let views = submission_views(&self.geometry, &self.plan, hemicubes, self.stamp);
        let groups = hemicubes.len().div_ceil(self.plan.group as usize);
        self.stamp = self.stamp.wrapping_add(u32::try_from(groups).unwrap_or(u32::MAX));
        self.write(entered, self.store.views[half], 0, views.as_flattened());
        // SAFETY: the context is current and the buffers its own.
        unsafe {
            entered.gl.bind_buffer_base(
                glow::SHADER_STORAGE_BUFFER,
                binding::VIEWS,
                Some(self.store.views[half]),
            );
            entered.gl.bind_buffer_base(
                glow::SHADER_STORAGE_BUFFER,
                binding::OUTPUT,
                Some(self.store.output[half].buffer),
            );
        }
    }

    /// Carries out the steps of a group.
    fn carry_out(
        &mut self,
        entered: &Entered<'_>,
        programs: &Programs,
        group: Group<'_>,
        goal: Goal,
        counters: &mut Counters,
    ) -> Result<(), BackendError> {
        let recording = Recording {
            plan: &self.plan,
            upload: &self.upload,
            cull: self.cull.on_device(),
            goal,
        };
        let steps = recording.steps(group.layers());
        for (number, step) in steps.iter().enumerate() {
            match step.action {
                Action::Dispatch { stage, groups } => {
                    self.bind_view(entered, group.half, group.first_slot, 0);
                    dispatch(entered, programs.compute[stage.entry], stage, groups);
                }
                Action::DrawDepths => group.places().for_each(|at| self.draw_depths(entered, programs, at)),
                Action::CopyDepths => {
                    return Err(BackendError::Internal("OpenGL copies no depths".to_owned()));
                }
                Action::DrawItems => {
                    for at in group.places() {
                        let lists = self.list(entered, programs, at, counters)?;
                        self.draw_items(entered, programs, at, lists.as_ref(), counters);
                        self.timed(entered, Phase::Render);
                    }
                }
                Action::DrawCover => group.places().for_each(|at| self.draw_cover(entered, programs, at)),
            }
            if steps.get(number + 1).is_none_or(|next| next.phase != step.phase) {
                self.timed(entered, step.phase);
            }
        }
        Ok(())
    }

    /// Lists the chunks to draw on each face, if the host culls.
    fn list(
        &mut self,
        entered: &Entered<'_>,
        programs: &Programs,
        at: Place<'_>,
        counters: &mut Counters,
    ) -> Result<Option<[Vec<u32>; 5]>, BackendError> {
        let lists = match self.cull {
            Cull::Queries | Cull::Marks => self.ask(entered, programs, at, counters)?,
            Cull::View => {
                let mut asking = self.begin_asking(at.hemicube, u32::MAX);
                let lists = asking.lists(None);
                self.note_lists(entered, &mut asking, &lists, at, counters);
                lists
            }
            Cull::Off | Cull::Frustum | Cull::Depth => return Ok(None),
        };
        self.timed(entered, Phase::Cull);
        Ok(Some(lists))
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
            let output = &self.store.output[submission.half];
            let headers = output.read(0..(submission.slots * HEADER_WORDS) as usize)?;
            let first = self.plan.output_entries() as usize;
            let words = entry_words(&self.plan, &headers, submission.slots)?;
            debug_assert!(words.is_multiple_of(ENTRY_WORDS as usize), "whole entries");
            let entries = output.read(first..first + words)?;
            counters += append_rows(&headers, &entries, submission.slots, self.settings.covered, out);
        }
        self.timed(entered, Phase::ReadBack);
        self.judge(&counters);
        Ok(counters)
    }

    /// Reads a whole row of visible weights and zeroes it, for the baselines.
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
            entered.gl.bind_buffer(glow::COPY_READ_BUFFER, Some(self.store.visible));
            entered.gl.get_buffer_sub_data(glow::COPY_READ_BUFFER, 0, &mut bytes);
        }
        entered.clear_words(self.store.visible, 0..count + 2);
        entered.clear_words(self.store.touched, 0..self.plan.word_count as usize);
        let (words, _) = bytes.as_chunks::<4>();
        for (&word, patch) in words[..count].iter().zip(0u32..) {
            let weight = u32::from_ne_bytes(word);
            if weight != 0 {
                out.push(InputPatch(patch), weight, 0);
            }
        }
        out.end_row(u32::from_ne_bytes(words[count + 1]), u32::from_ne_bytes(words[count]));
        counters.bytes_read_back += bytes.len() as u64;
        entered.check("reading a row")
    }

    /// The item buffer of one hemicube.
    pub(crate) fn items(
        &mut self,
        entered: &Entered<'_>,
        programs: &Programs,
        hemicube: &Hemicube,
    ) -> Result<Items, BackendError> {
        let group = Group {
            hemicubes: std::slice::from_ref(hemicube),
            first_slot: 0,
            half: 0,
        };
        self.begin(entered, group.hemicubes, group.half);
        self.carry_out(entered, programs, group, Goal::Items, &mut Counters::default())?;
        self.read_items(entered)
    }

    /// Reads the item buffer of the first layer.
    pub(crate) fn read_items(&self, entered: &Entered<'_>) -> Result<Items, BackendError> {
        let gl = entered.gl;
        let n = self.settings.resolution;
        let mut bytes = vec![0u8; 12 * n as usize * n as usize];
        let [width, height] = [n, 3 * n].map(|k| i32::try_from(k).unwrap_or(i32::MAX));
        // SAFETY: the context is current; there is room for 3N² numbers.
        unsafe {
            gl.bind_framebuffer(glow::FRAMEBUFFER, Some(self.store.framebuffers[0][0]));
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
        let ids = words.iter().map(|&word| u32::from_ne_bytes(word));
        Ok(output::items(ids, self.upload.patch_count, n))
    }
}

/// Runs a compute stage. The shared plan sizes its buffers and work groups.
fn dispatch(entered: &Entered<'_>, program: glow::Program, stage: &Stage, [x, y, z]: [u32; 3]) {
    let gl = entered.gl;
    // The item buffer is read as a texture before, then written as an image, and then read and drawn to.
    let writes_items = stage.writes.contains(&binding::SETTLED_ITEMS);
    // SAFETY: the context is current.
    unsafe {
        if writes_items {
            gl.memory_barrier(glow::SHADER_IMAGE_ACCESS_BARRIER_BIT);
        }
        gl.use_program(Some(program));
        gl.dispatch_compute(x, y, z);
        gl.memory_barrier(
            glow::SHADER_STORAGE_BARRIER_BIT | glow::COMMAND_BARRIER_BIT | glow::TEXTURE_FETCH_BARRIER_BIT,
        );
        if writes_items {
            gl.memory_barrier(glow::SHADER_IMAGE_ACCESS_BARRIER_BIT | glow::FRAMEBUFFER_BARRIER_BIT);
        }
    }
}

/// Waits until the device has passed a fence.
pub(crate) fn wait(entered: &Entered<'_>, fence: glow::Fence) -> Result<(), BackendError> {
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
