// The model: one draw of all patches, each in its colour from a texture, and what lies under the mouse by a draw of one pixel.

import {
  BufferAttribute, BufferGeometry, DataTexture, DoubleSide, FrontSide, GLSL3, Matrix4, Mesh, NearestFilter,
  PerspectiveCamera, RawShaderMaterial, RGBAFormat, Scene, UnsignedByteType, Vector3, WebGLRenderer, WebGLRenderTarget,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

const TEXTURE_WIDTH = 2048;

/** Milliseconds between two pictures from which on turning stutters. */
const PATIENCE = 50;

// Three corners a triangle and no index, so that the corner's number says which triangle it is of.
const VERTEX = `
precision highp float;
precision highp int;
in vec4 position;
uniform mat4 modelViewMatrix;
uniform mat4 projectionMatrix;
flat out int id;
out vec3 place;
out vec3 corner;
void main() {
  id = gl_VertexID / 3;
  int k = gl_VertexID - 3 * id;
  corner = vec3(k == 0, k == 1, k == 2);
  vec4 seen = modelViewMatrix * vec4(position.xyz, 1.0);
  place = seen.xyz;
  gl_Position = projectionMatrix * seen;
}`;

const COLOR = `
precision highp float;
precision highp int;
flat in int id;
in vec3 place;
in vec3 corner;
uniform highp sampler2D colors;
uniform float shade;
uniform float edges;
out vec4 color;
void main() {
  vec3 value = texelFetch(colors, ivec2(id % ${TEXTURE_WIDTH}, id / ${TEXTURE_WIDTH}), 0).rgb;
  if (!gl_FrontFacing) value = vec3(0.36);
  vec3 normal = normalize(cross(dFdx(place), dFdy(place)));
  value *= mix(1.0, 0.72 + 0.28 * abs(dot(normal, normalize(place))), shade);
  vec3 width = fwidth(corner);
  float inside = min(min(corner.x / width.x, corner.y / width.y), corner.z / width.z);
  value *= mix(1.0, clamp(0.45 + inside, 0.45, 1.0), edges);
  color = vec4(value, 1.0);
}`;

const PICK = `
precision highp float;
precision highp int;
flat in int id;
in vec3 place;
in vec3 corner;
out vec4 color;
void main() {
  int n = gl_FrontFacing ? id + 1 : 0;
  color = vec4(n & 255, (n >> 8) & 255, (n >> 16) & 255, (n >> 24) & 255) / 255.0;
}`;

/** Whether this browser draws without a GPU, where several samples a pixel take much longer than one. */
function isSoftware() {
  const context = document.createElement("canvas").getContext("webgl2");
  if (!context) return false;
  const info = context.getExtension("WEBGL_debug_renderer_info");
  const name = context.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : context.RENDERER);
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

export class Model {
  /**
   * @param canvas where it is drawn
   * @param corners Uint16Array, three a vertex, 0 to 65535 from `low` to `high`
   * @param triangles Uint32Array, three vertices each
   * @param head `low`, `high`, `up` of the scene
   * @param patchOf Uint32Array, the patch of each triangle; null where each is its own
   */
  constructor(canvas, corners, triangles, head, patchOf = null) {
    this.canvas = canvas;
    this.patchOf = patchOf;
    this.count = triangles.length / 3;
    this.corners = corners;
    const software = isSoftware();
    this.renderer = new WebGLRenderer({ canvas, antialias: !software, alpha: true });
    this.renderer.setClearColor(0, 0);
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(40, 1, 0.001, 100);
    this.camera.up.copy({ x: new Vector3(1, 0, 0), y: new Vector3(0, 1, 0), z: new Vector3(0, 0, 1) }[head.up]);

    const positions = new Uint16Array(12 * this.count);
    for (let k = 0; k < triangles.length; k++) {
      positions.set(corners.subarray(3 * triangles[k], 3 * triangles[k] + 3), 4 * k);
    }
    this.positions = positions;
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(positions, 4, true));
    // The scene is shown about the origin with a radius of 1, whatever its unit.
    const [low, high] = [new Vector3(...head.low), new Vector3(...head.high)];
    const extent = high.clone().sub(low);
    this.radius = extent.length() / 2 || 1;
    const middle = low.clone().add(high).multiplyScalar(0.5);
    const matrix = new Matrix4()
      .makeScale(extent.x / this.radius, extent.y / this.radius, extent.z / this.radius)
      .setPosition(low.sub(middle).divideScalar(this.radius));

    this.texels = new Uint8Array(4 * TEXTURE_WIDTH * Math.ceil(this.count / TEXTURE_WIDTH)).fill(255);
    this.texture = new DataTexture(
      this.texels, TEXTURE_WIDTH, this.texels.length / 4 / TEXTURE_WIDTH, RGBAFormat, UnsignedByteType,
    );
    this.texture.minFilter = this.texture.magFilter = NearestFilter;
    const material = (fragmentShader, uniforms) =>
      new RawShaderMaterial({ glslVersion: GLSL3, vertexShader: VERTEX, fragmentShader, uniforms, side: FrontSide });
    this.shown = material(COLOR, { colors: { value: this.texture }, shade: { value: 1 }, edges: { value: 0 } });
    this.picked = material(PICK, {});
    this.mesh = new Mesh(geometry, this.shown);
    this.mesh.frustumCulled = false;
    this.mesh.matrixAutoUpdate = false;
    this.mesh.matrix.copy(matrix);
    this.scene.add(this.mesh);
    this.pixel = new WebGLRenderTarget(1, 1);

    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.listenToKeyEvents(canvas);
    this.controls.addEventListener("change", () => this.draw());
    // Where pictures come too slowly while it is turned, as without a GPU, they get a quarter of the pixels until it rests, and
    // a quarter of those. Without a GPU a model at rest has four pixels for each of the screen's: edges are smooth all the same.
    this.patience = PATIENCE;
    this.ratio = 1;
    this.finest = software ? 2 : 1;
    this.halvings = 0;
    this.turning = false;
    this.controls.addEventListener("start", () => { this.turning = true; });
    this.controls.addEventListener("end", () => {
      this.turning = false;
      this.draw();
    });
    this.frames = 0;
    this.pending = false;
    this.fit();
  }

  /** Looks at all of the scene from a corner, a little above. */
  fit() {
    const up = this.camera.up;
    const aside = up.y === 1 ? new Vector3(0.55, 0, 0.7) : up.x === 1 ? new Vector3(0, 0.55, -0.7) : new Vector3(0.55, -0.7, 0);
    this.look(aside.addScaledVector(up, 0.55).normalize());
  }

  /** Looks down at all of it. */
  top() {
    const aside = this.camera.up.y === 1 ? new Vector3(0, 0, 1e-3) : new Vector3(0, -1e-3, 0);
    this.look(aside.add(this.camera.up).normalize());
  }

  /** The corners of a triangle, where they are shown. */
  cornersOf(triangle) {
    return [0, 1, 2].map((k) => {
      const place = 4 * (3 * triangle + k);
      return new Vector3(...this.positions.subarray(place, place + 3)).divideScalar(65535).applyMatrix4(this.mesh.matrix);
    });
  }

  /** The triangle that stands for a patch: its largest. */
  triangleOf(patch) {
    if (!this.patchOf) return patch;
    if (!this.largest) {
      this.largest = [];
      const most = [];
      for (let triangle = 0; triangle < this.count; triangle++) {
        const [a, b, c] = this.cornersOf(triangle);
        const area = b.sub(a).cross(c.sub(a)).length();
        const own = this.patchOf[triangle];
        if (!(area <= most[own])) [this.largest[own], most[own]] = [triangle, area];
      }
    }
    return this.largest[patch];
  }

  /** Centres a patch where it is seen from its front: from where the camera is, from straight ahead, nearer and nearer. */
  async goTo(patch) {
    const [a, b, c] = this.cornersOf(this.triangleOf(patch));
    const middle = a.clone().add(b).add(c).divideScalar(3);
    const normal = b.clone().sub(a).cross(c.clone().sub(a)).normalize();
    const size = Math.max(a.distanceTo(b), b.distanceTo(c), c.distanceTo(a));
    const now = this.camera.position.clone().sub(this.controls.target);
    const kept = now.length();
    const ahead = normal.clone().addScaledVector(this.camera.up, 0.2).normalize();
    const ways = [now.normalize(), ahead, normal].filter((way) => way.dot(normal) > 0.2);
    for (const distance of [Math.min(kept, 1), 0.4, 0.15, 0.05, 0.02]) {
      for (const way of ways) {
        this.controls.target.copy(middle);
        this.camera.position.copy(middle).addScaledVector(way, Math.max(distance, 2 * size));
        this.controls.update();
        this.drawNow();
        const { clientWidth: width, clientHeight: height } = this.canvas;
        if ((await this.pick(width / 2, height / 2)) === patch) return;
      }
    }
  }

  look(back) {
    const right = this.camera.up.clone().cross(back).normalize();
    const above = back.clone().cross(right);
    const tall = Math.tan((this.camera.fov * Math.PI) / 360);
    const wide = tall * this.camera.aspect;
    const places = [];
    for (let k = 0; k < this.corners.length; k += 3) {
      const corner = new Vector3(...this.corners.subarray(k, k + 3)).divideScalar(65535).applyMatrix4(this.mesh.matrix);
      places.push([corner.dot(right), corner.dot(above), corner.dot(back)]);
    }
    // Each side of the picture touches the outermost corner: where it does depends on the distance, which settles at once.
    let [x, y, distance] = [0, 0, 0];
    for (let turn = 0; turn < 4; turn++) {
      let [left, rightmost, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
      distance = 0;
      for (const [r, a, b] of places) {
        distance = Math.max(distance, Math.max(Math.abs(r - x) / wide, Math.abs(a - y) / tall) + b);
      }
      for (const [r, a, b] of places) {
        const [h, v] = [(r - x) / (distance - b || 1), (a - y) / (distance - b || 1)];
        [left, rightmost, low, high] = [Math.min(left, h), Math.max(rightmost, h), Math.min(low, v), Math.max(high, v)];
      }
      if (turn < 3) {
        x += ((left + rightmost) / 2) * distance;
        y += ((low + high) / 2) * distance;
      }
    }
    this.controls.target.copy(right.multiplyScalar(x)).addScaledVector(above, y);
    this.camera.position.copy(this.controls.target).addScaledVector(back, 1.03 * distance);
    this.controls.update();
    this.draw();
  }

  resize(width, height, ratio) {
    this.ratio = ratio;
    this.halvings = 0;
    this.renderer.setPixelRatio(this.finest * ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  /** Draws before the next frame, however often it is called until then. */
  draw() {
    if (this.pending) return;
    this.pending = true;
    const asked = performance.now();
    // A browser that is still at the last picture calls late.
    requestAnimationFrame(() => this.drawNow(performance.now() - asked));
  }

  /** Draws with all pixels along each edge, halved so often. */
  coarsen(halvings) {
    if (this.halvings === halvings) return;
    this.halvings = halvings;
    this.renderer.setPixelRatio((this.finest * this.ratio) / 2 ** halvings);
  }

  /** Draws; `late` is how many milliseconds it had to wait for its turn. */
  drawNow(late = 0) {
    this.pending = false;
    if (!this.turning) this.coarsen(0);
    else if (late > this.patience) this.coarsen(Math.min(this.halvings + 1, this.finest));
    // Near and far follow the camera, so that walls a thousandth of the scene apart keep their order.
    const distance = this.camera.position.length();
    this.camera.near = Math.max(distance - 1.1, 0.002 * Math.max(distance, 0.25));
    this.camera.far = distance + 1.1;
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.scene, this.camera);
    this.frames++;
  }

  /** Gives each patch the colour that `of(patch)` says: three numbers from 0 to 255. */
  paint(of) {
    const colors = this.patchOf && new Map();
    for (let triangle = 0; triangle < this.count; triangle++) {
      const patch = this.patchOf ? this.patchOf[triangle] : triangle;
      if (colors && !colors.has(patch)) colors.set(patch, of(patch));
      this.texels.set(colors ? colors.get(patch) : of(patch), 4 * triangle);
    }
    this.texture.needsUpdate = true;
    this.draw();
  }

  set(what, value) {
    if (what === "backs") this.shown.side = value ? DoubleSide : FrontSide;
    else this.shown.uniforms[what].value = value ? 1 : 0;
    this.draw();
  }

  /** The patch at a place of the canvas in CSS pixels; -1 where none is, or a back. Asynchronous, so that nothing waits. */
  async pick(x, y) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.camera.setViewOffset(width, height, Math.floor(x), Math.floor(y), 1, 1);
    this.picked.side = this.shown.side;
    this.mesh.material = this.picked;
    this.renderer.setRenderTarget(this.pixel);
    this.renderer.render(this.scene, this.camera);
    const read = this.renderer.readRenderTargetPixelsAsync(this.pixel, 0, 0, 1, 1, new Uint8Array(4));
    this.renderer.setRenderTarget(null);
    this.mesh.material = this.shown;
    this.camera.clearViewOffset();
    const found = await read;
    const triangle = found[0] + 256 * found[1] + 65536 * found[2] + 16777216 * found[3] - 1;
    return this.patchOf ? (this.patchOf[triangle] ?? -1) : triangle;
  }

  /** Where on the canvas, in CSS pixels, the middle of a patch is. */
  placeOf(patch) {
    const middle = new Vector3();
    const triangle = this.triangleOf(patch);
    for (let k = 3 * triangle; k < 3 * triangle + 3; k++) {
      middle.add(new Vector3(...this.positions.subarray(4 * k, 4 * k + 3)));
    }
    middle.divideScalar(3 * 65535).applyMatrix4(this.mesh.matrix).project(this.camera);
    const { clientWidth: width, clientHeight: height } = this.canvas;
    return [((middle.x + 1) / 2) * width, ((1 - middle.y) / 2) * height];
  }
}
