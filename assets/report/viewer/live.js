// A run that goes on: its state as the messages of `/events` bring it. `src/live/state.rs` is the other side.

import { bytes, positions } from './decode.js';

const NOTHING = { count: 0, low: [0, 0, 0], step: [0, 0, 0], data: '' };
const NO_LINES = { born: [], life: '', ends: NOTHING };

/** An array of at least `length` elements that begins with the old ones. */
function grown(array, length) {
  if (array.length >= length) return array;
  const larger = new array.constructor(Math.ceil(length * 1.5));
  larger.set(array);
  return larger;
}

/** A surface that follows changes: the format of `keyframes/NNNNNN.delta`, see docs/outputs.md. */
class LiveSurface {
  constructor() {
    /** Three floats a vertex, by its number. */
    this.positions = new Float32Array(0);
    /** Three numbers a face. */
    this.corners = new Uint32Array(0);
    this.count = 0;
    this.vertexCount = 0;
    this.slots = new Map();
  }

  apply(raw) {
    const view = new DataView(raw.buffer, raw.byteOffset, raw.byteLength);
    let at = 8 + 3 * 8;
    const next = () => {
      at += 4;
      return view.getUint32(at - 4, true);
    };
    const counts = Array.from({ length: 7 }, next);
    const [vertices, triangles, removed, freed, placed, recolored, added] = counts;
    for (let i = 0; i < removed; i++) this.#remove(next(), next(), next());
    at += 4 * freed;
    for (let i = 0; i < placed; i++) {
      const number = next();
      this.positions = grown(this.positions, 3 * number + 3);
      for (let axis = 0; axis < 3; axis++) {
        this.positions[3 * number + axis] = view.getFloat32(at, true);
        at += 4;
      }
      at += 4; // its colour
    }
    at += 8 * recolored;
    this.corners = grown(this.corners, 3 * (this.count + added));
    for (let i = 0; i < added; i++) this.#add(next(), next(), next());
    this.vertexCount = vertices;
    if (this.count !== triangles) throw new Error(`${this.count} triangles in place of ${triangles}`);
  }

  #add(a, b, c) {
    this.slots.set(`${a} ${b} ${c}`, this.count);
    this.corners.set([a, b, c], 3 * this.count);
    this.count += 1;
  }

  /** The last face takes the place of one that goes. */
  #remove(a, b, c) {
    const key = `${a} ${b} ${c}`;
    const slot = this.slots.get(key);
    if (slot === undefined) throw new Error(`no triangle ${key}`);
    this.slots.delete(key);
    this.count -= 1;
    if (slot === this.count) return;
    const last = this.corners.subarray(3 * this.count, 3 * this.count + 3);
    this.corners.set(last, 3 * slot);
    this.slots.set(last.join(' '), slot);
  }
}

/** Everything that a page shows of a run. */
export class LiveState {
  constructor() {
    this.#forget();
  }

  #forget() {
    this.scene = null;
    this.keyframes = [];
    this.rows = [];
    this.surface = new LiveSurface();
    this.lines = { segments: new Float32Array(0), clusters: new Float32Array(0) };
    this.points = new Float32Array(0);
    this.image = null;
    this.ended = false;
  }

  /** Takes a message. What it does not mention stays. */
  apply(message) {
    if (message.whole) this.#forget();
    const { scene, keyframes, rows, surface, segments, clusters, points, image } = message;
    if (scene) this.scene = scene;
    if (keyframes) this.keyframes = [...this.keyframes.slice(0, keyframes.from), ...keyframes.list];
    if (rows) this.rows = [...this.rows.slice(0, rows.from), ...rows.list];
    if (surface) {
      if (surface.anew) this.surface = new LiveSurface();
      this.surface.apply(bytes(surface.delta));
    }
    if (segments) {
      const added = positions(segments.list);
      const all = new Float32Array(6 * segments.from + added.length);
      all.set(this.lines.segments.subarray(0, 6 * segments.from));
      all.set(added, 6 * segments.from);
      this.lines.segments = all;
    }
    if (clusters) this.lines.clusters = positions(clusters);
    if (points) this.points = positions(points);
    if (image) this.image = image;
    this.ended = message.ended;
  }

  /** The keyframe that was added last. */
  get current() {
    return this.rows.length > 0 ? this.rows[this.rows.length - 1].keyframe : 0;
  }

  /** The data of a page without a surface so far. */
  emptyPage() {
    const lines = [
      { name: 'segments', color: '#de5828', ...NO_LINES },
      { name: 'clusters', color: '#2060c8', ...NO_LINES },
    ];
    const points = { color: '#2060c8', born: [], life: '', places: NOTHING };
    const surface = {
      name: 'surface',
      label: 'Surface',
      states: [],
      vertex_counts: [],
      vertices: NOTHING,
      triangles: { count: 0, born: [], data: '' },
      errors: null,
      lines,
      points,
      timing: { stages: [] },
    };
    return { ...this.scene, live: true, keyframes: this.keyframes, surfaces: [surface], images: [] };
  }

  /** Milliseconds of each stage over the keyframes, as on a page of a finished run. */
  timing() {
    const names = this.rows.length > 0 ? Object.keys(this.rows[0].milliseconds) : [];
    const stages = names.map((name) => {
      const milliseconds = this.keyframes.map(() => null);
      for (const row of this.rows) milliseconds[row.keyframe] = row.milliseconds[name];
      return { name, milliseconds };
    });
    return { stages };
  }

  /** The number of triangles over the keyframes. */
  triangles() {
    const values = this.keyframes.map(() => null);
    for (const row of this.rows) values[row.keyframe] = row.triangles;
    return values;
  }
}

/** Follows the run that serves this page; `onChange` is called at most once a picture of the screen. */
export function follow(onChange) {
  const state = new LiveState();
  const source = new EventSource('events');
  let pending = false;
  const changed = (connected) => {
    state.connected = connected;
    if (pending) return;
    pending = true;
    requestAnimationFrame(() => {
      pending = false;
      onChange(state);
    });
  };
  source.addEventListener('message', (event) => {
    state.apply(JSON.parse(event.data));
    // Else the browser would ask again and again.
    if (state.ended) source.close();
    changed(true);
  });
  source.addEventListener('error', () => changed(state.ended));
}
