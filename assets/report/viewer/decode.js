// Turns the base64 parts of the page's data into typed arrays. `src/report/page/encode.rs` is the other side.

/** Bytes of a base64 string. */
export function bytes(text) {
  if (typeof Uint8Array.fromBase64 === 'function') return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const result = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) result[i] = binary.charCodeAt(i);
  return result;
}

/** Positions as floats, three a point: each point is three numbers of 21 bits in a box. */
export function positions({ count, low, step, data }) {
  const raw = bytes(data);
  const view = new DataView(raw.buffer, raw.byteOffset, raw.byteLength);
  const result = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) {
    const first = view.getUint32(8 * i, true);
    const second = view.getUint32(8 * i + 4, true);
    const x = first & 0x1fffff;
    const y = (first >>> 21) | ((second & 0x3ff) << 11);
    const z = (second >>> 10) & 0x1fffff;
    result[3 * i] = low[0] + step[0] * x;
    result[3 * i + 1] = low[1] + step[1] * y;
    result[3 * i + 2] = low[2] + step[2] * z;
  }
  return result;
}

/** Reads numbers of variable length, seven bits a byte, the lowest first. */
class Numbers {
  constructor(raw) {
    this.raw = raw;
    this.at = 0;
  }

  next() {
    let value = 0;
    let scale = 1;
    for (;;) {
      const byte = this.raw[this.at++];
      value += (byte & 0x7f) * scale;
      if (byte < 0x80) return value;
      scale *= 128;
    }
  }
}

/** Number of states that something outlives which is still there at the end. */
const FOREVER = 0xffffffff;

/** Triangles with the states at which they come and go, in the order of coming. */
export function triangles({ count, born, data }) {
  const numbers = new Numbers(bytes(data));
  const corners = new Uint32Array(3 * count);
  const birth = new Uint32Array(count);
  const death = new Uint32Array(count);
  let i = 0;
  born.forEach((many, state) => {
    let first = 0;
    for (const end = i + many; i < end; i++) {
      first += numbers.next();
      corners[3 * i] = first;
      corners[3 * i + 1] = first + numbers.next();
      corners[3 * i + 2] = first + numbers.next();
      const life = numbers.next();
      birth[i] = state;
      death[i] = life === 0 ? FOREVER : state + life;
    }
  });
  return { count, corners, birth, death };
}

/** Elements of a single state. */
export function allAlive(count) {
  return { count, birth: new Uint32Array(count), death: new Uint32Array(count).fill(FOREVER) };
}

/** The states at which elements come and go, in the order of coming. */
export function lives({ born, life }) {
  const numbers = new Numbers(bytes(life));
  const count = born.reduce((sum, many) => sum + many, 0);
  const birth = new Uint32Array(count);
  const death = new Uint32Array(count);
  let i = 0;
  born.forEach((many, state) => {
    for (const end = i + many; i < end; i++) {
      const states = numbers.next();
      birth[i] = state;
      death[i] = states === 0 ? FOREVER : state + states;
    }
  });
  return { count, birth, death };
}
