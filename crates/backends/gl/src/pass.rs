//! Passes: what is seen through a portal, in its open pixels.

use crate::device::Entered;
use crate::render::{Place, Programs, Scene};
use glow::HasContext;
use hemicube_contract::backend::{BackendError, Hemicube, Pass};
use hemicube_contract::face::Items;
use hemicube_shaders::pass::{draws, first_depths};
use hemicube_shaders::stage::binding;
use hemicube_shaders::view::pass_views;

impl Scene {
    /// What the open pixels of a pass show.
    pub(crate) fn pass(
        &self,
        entered: &Entered<'_>,
        programs: &Programs,
        pass: &Pass<'_>,
    ) -> Result<Items, BackendError> {
        let n = self.settings.resolution;
        let hemicube = Hemicube {
            emitter: None,
            origin: pass.origin,
            axes: pass.axes,
        };
        let views = pass_views(&self.geometry, pass, n);
        self.write(entered, self.store.views[0], 0, views.as_flattened());
        self.preset_depths(entered, pass);
        let at = Place {
            hemicube: &hemicube,
            slot: 0,
            layer: 0,
            half: 0,
        };
        let gl = entered.gl;
        // SAFETY: the context is current, and all names are its own.
        unsafe {
            gl.bind_framebuffer(glow::FRAMEBUFFER, Some(self.store.framebuffers[0][0]));
            gl.clear_buffer_u32_slice(glow::COLOR, 0, &[self.upload.patch_count + 1; 4]);
            gl.enable(glow::DEPTH_TEST);
            gl.disable(glow::CULL_FACE);
            gl.depth_mask(true);
            gl.depth_func(glow::GREATER);
            gl.use_program(Some(programs.through));
            gl.bind_vertex_array(Some(self.store.vertices));
            gl.enable(glow::SCISSOR_TEST);
        }
        for draw in draws(&self.upload, pass, n) {
            self.begin_face(entered, at, draw.face);
            let [x, y, width, height] = [draw.low[0], draw.low[1], draw.size[0], draw.size[1]].map(narrow);
            let firsts: Vec<usize> = draw.runs.iter().map(|run| 4 * run.start as usize).collect();
            let counts: Vec<i32> = draw.runs.iter().map(|run| narrow(run.end - run.start)).collect();
            // SAFETY: the context is current, the scene's vertex array is bound, and runs are within its indices.
            unsafe {
                gl.scissor(x, y, width, height);
                entered.draw_runs(&firsts, &counts);
            }
        }
        // SAFETY: as above. All else is drawn and cleared without it.
        unsafe { gl.disable(glow::SCISSOR_TEST) };
        self.read_items(entered)
    }

    /// Sets the first layer's depths: nearest in closed pixels, infinitely far in open ones.
    fn preset_depths(&self, entered: &Entered<'_>, pass: &Pass<'_>) {
        let n = self.settings.resolution;
        let bytes: Vec<u8> = first_depths(pass, n).into_iter().flat_map(f32::to_ne_bytes).collect();
        let [width, height] = [n, 3 * n].map(narrow);
        let gl = entered.gl;
        // SAFETY: the context is current; there are 3N² depths, copied by the call, for a layer of as many.
        unsafe {
            gl.bind_texture_unit(binding::DEPTHS, Some(self.store.depths));
            gl.active_texture(glow::TEXTURE0 + binding::DEPTHS);
            gl.pixel_store_i32(glow::UNPACK_ALIGNMENT, 4);
            gl.tex_sub_image_3d(
                glow::TEXTURE_2D_ARRAY,
                0,
                0,
                0,
                0,
                width,
                height,
                1,
                glow::DEPTH_COMPONENT,
                glow::FLOAT,
                glow::PixelUnpackData::Slice(Some(&bytes)),
            );
        }
    }
}

/// Edges of images and numbers of indices, all of which fit.
fn narrow(number: u32) -> i32 {
    i32::try_from(number).unwrap_or(i32::MAX)
}
