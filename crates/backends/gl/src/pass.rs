//! Passes: what is seen through a portal, in its open pixels.
//!
//! Depths are preset: closed pixels are as near as the near plane, so that nothing is drawn there. The shaders cut away
//! what lies before the portal's plane. Chunks outside a face, before the plane, or on a face without open pixels are
//! left out, and nothing is drawn outside the rectangle of a face's open pixels. Pixels near edges are judged by the
//! driver: the settle stage knows nothing of planes.

use crate::ask::add;
use crate::device::Entered;
use crate::hierarchy::{CullBox, Descend, FacePlanes, WalkCounters};
use crate::render::{Place, Programs, Scene};
use glow::HasContext;
use hemicube_contract::backend::{BackendError, Hemicube, Pass};
use hemicube_contract::face::{Face, Items, pixel_count};
use hemicube_shaders::stage::binding;
use hemicube_shaders::view::pass_views;

/// A rectangle of open pixels: the first column and row of the face, and one past the last.
type Opening = [[u32; 2]; 2];

/// The rectangle of a face's open pixels; none if all are closed.
fn opening(pass: &Pass<'_>, face: Face, n: u32) -> Option<Opening> {
    let mut found: Option<Opening> = None;
    for y in 0..face.rows(n) {
        for x in 0..n {
            if pass.is_open(((face.first_row(n) + y) * n + x) as usize) {
                let [low, high] = found.unwrap_or([[x, y], [x + 1, y + 1]]);
                found = Some([[low[0].min(x), low[1].min(y)], [high[0].max(x + 1), high[1].max(y + 1)]]);
            }
        }
    }
    found
}

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
        let openings = Face::ALL.map(|face| opening(pass, face, n));
        let lists = self.lists_of_pass(pass, &hemicube, &openings);
        let views = pass_views(&self.geometry, &self.upload, pass, n);
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
        for (face, opening) in Face::ALL.into_iter().zip(openings) {
            let list = &lists[face as usize];
            let Some([low, high]) = opening.filter(|_| !list.is_empty()) else {
                continue;
            };
            self.begin_face(entered, at, face);
            let corner = [low[0], low[1] + face.first_row(n), high[0] - low[0], high[1] - low[1]];
            let [x, y, width, height] = corner.map(|k| i32::try_from(k).unwrap_or(i32::MAX));
            // SAFETY: the context is current.
            unsafe { gl.scissor(x, y, width, height) };
            self.draw_list(entered, list);
        }
        // SAFETY: as above. All else is drawn and cleared without it.
        unsafe { gl.disable(glow::SCISSOR_TEST) };
        self.read_items(entered)
    }

    /// Lists the chunks to draw on each face, ascending.
    fn lists_of_pass(&self, pass: &Pass<'_>, hemicube: &Hemicube, openings: &[Option<Opening>; 5]) -> [Vec<u32>; 5] {
        let open = (0u8..).zip(openings).filter(|(_, opening)| opening.is_some());
        let faces = open.fold(0, |faces, (face, _)| faces | 1 << face);
        let is_before = |bounds: &CullBox| {
            let reach = pass.normal.abs().dot(bounds.half);
            pass.normal.dot(bounds.center) + reach <= pass.offset
        };
        let mut lists: [Vec<u32>; 5] = Default::default();
        let planes = FacePlanes::new(hemicube, self.geometry.plane_tolerance);
        let counters = &mut WalkCounters::default();
        self.hierarchy.walk(0, faces, &planes, counters, |place, faces| {
            let node = &self.hierarchy.nodes[place as usize];
            if is_before(&node.bounds) {
                return Descend::No;
            }
            if node.is_leaf(place) {
                add(&mut lists, faces, node.chunks.clone());
            }
            Descend::Yes
        });
        lists.iter_mut().for_each(|list| list.sort_unstable());
        lists
    }

    /// Sets the first layer's depths: nearest in closed pixels, infinitely far in open ones.
    fn preset_depths(&self, entered: &Entered<'_>, pass: &Pass<'_>) {
        let n = self.settings.resolution;
        let pixels = 0..pixel_count(n);
        let depths = pixels.map(|pixel| if pass.is_open(pixel) { 0f32 } else { 1.0 });
        let bytes: Vec<u8> = depths.flat_map(f32::to_ne_bytes).collect();
        let [width, height] = [n, 3 * n].map(|k| i32::try_from(k).unwrap_or(i32::MAX));
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
