// What the page carries: arrays, each deflated and written in base64 into a <script> of its own, so that nothing is fetched
// and rows are only unpacked when somebody asks for them.

const TYPES = { u8: Uint8Array, u16: Uint16Array, u32: Uint32Array, f32: Float32Array };

/** The bytes of the block `name`. */
export async function bytes(name) {
  const element = document.getElementById(`block-${name}`);
  if (!element) throw new Error(`the page has no block "${name}": it is damaged`);
  const text = atob(element.textContent.trim());
  const packed = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) packed[k] = text.charCodeAt(k);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The array in the block `name`: little-endian numbers of one of `TYPES`. */
export async function array(name, type) {
  const data = await bytes(name);
  return new TYPES[type](data.buffer, 0, data.byteLength / TYPES[type].BYTES_PER_ELEMENT);
}

const word = new DataView(new ArrayBuffer(4));

/** A form factor from its 16 bits: those of an f32 without the last 13 of its mantissa, from 2^-63 up (docs/store.md). */
export function factor(code) {
  if (code === 0) return 0;
  word.setUint32(0, (code << 13) + (64 << 23));
  return word.getFloat32(0);
}

/** Reads numbers of 7 bits a byte, the lowest first, and pairs of bytes. */
class Reader {
  constructor(data) {
    this.data = data;
    this.place = 0;
  }
  number() {
    let value = 0;
    for (let scale = 1; ; scale *= 128) {
      const byte = this.data[this.place++];
      value += (byte & 127) * scale;
      if (byte < 128) return value;
    }
  }
  factor() {
    const code = this.data[this.place] | (this.data[this.place + 1] << 8);
    this.place += 2;
    return factor(code);
  }
}

const unpacked = new Map();

/**
 * The row of a patch: its largest entries, largest first, and the objects that most of it goes to; `null` where none was
 * computed. `perBlock` rows share a block.
 */
export async function row(patch, perBlock) {
  const block = Math.floor(patch / perBlock);
  if (!unpacked.has(block)) {
    if (unpacked.size > 16) unpacked.delete(unpacked.keys().next().value);
    unpacked.set(block, bytes(`rows-${block}`).then(split));
  }
  return (await unpacked.get(block))[patch - block * perBlock] ?? null;
}

function split(data) {
  const reader = new Reader(data);
  const rows = [];
  while (reader.place < data.length) {
    const count = reader.number();
    if (count === 0) {
      rows.push(null);
      continue;
    }
    const entries = [];
    let patch = -1;
    for (let k = 1; k < count; k++) entries.push({ patch: (patch += 1 + reader.number()), factor: 0 });
    for (const entry of entries) entry.factor = reader.factor();
    entries.sort((a, b) => b.factor - a.factor || a.patch - b.patch);
    const objects = [];
    for (let k = reader.number(); k > 0; k--) objects.push({ object: reader.number(), factor: 0 });
    for (const object of objects) object.factor = reader.factor();
    rows.push({ entries, objects });
  }
  return rows;
}
